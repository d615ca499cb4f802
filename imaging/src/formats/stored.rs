//! How voxels are stored as numbers, and their conversion to values: byte order, scaling, and a check of every value.

use std::io::{self, Read};

use bonemill_geometry::cancel;

use super::source::read_full;

/// 2³¹ voxels are 8 GiB of grey values: more than any scan used for planning, and half of what 32-bit voxel numbers reach.
pub(super) const MAX_VOXELS: u64 = 1 << 31;
/// Bytes converted at a time; a multiple of every number's size.
const PIECE_BYTES: usize = 1 << 18;

/// The type of a stored number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum NumberType {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    U64,
    I64,
    F32,
    F64,
}

impl NumberType {
    /// Bytes of one number.
    pub fn bytes(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::U64 | Self::I64 | Self::F64 => 8,
        }
    }
}

/// How numbers are stored.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Stored {
    pub number: NumberType,
    pub big_endian: bool,
    /// value = slope · stored + intercept; `None` when values are stored as they are.
    pub scaling: Option<[f64; 2]>,
}

/// Why voxels could not be read to the last one.
#[derive(Debug)]
pub(super) enum StreamFault {
    /// The system's, or a decoder's, reason.
    Io(io::Error),
    /// The data end too early, bytes.
    Truncated { expected_bytes: u64, found_bytes: u64 },
    /// Memory for the values cannot be had, bytes.
    Memory { bytes: u64 },
}

/// A type of voxel values: grey values or labels.
pub(crate) trait Voxel: Copy {
    /// Whether `value` can be converted to this type.
    fn accepts(value: f64) -> bool;
    /// Converts a `value` that [`Voxel::accepts`].
    fn from_value(value: f64) -> Self;
}

impl Voxel for f32 {
    fn accepts(value: f64) -> bool {
        // a double too large for single precision becomes infinite
        (value as f32).is_finite()
    }
    fn from_value(value: f64) -> Self {
        value as f32
    }
}

/// A label: a whole number, up to the rounding of a slope stored in single precision.
impl Voxel for u16 {
    fn accepts(value: f64) -> bool {
        let whole = value.round();
        (value - whole).abs() <= 1e-6 * whole.abs().max(1.0) && (0.0..=65535.0).contains(&whole)
    }
    fn from_value(value: f64) -> Self {
        value.round() as u16
    }
}

/// The values that could not be converted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Faults {
    /// Number of the first such voxel, counted from 0.
    pub first: u64,
    /// Its value.
    pub value: f64,
    /// How many there are.
    pub count: u64,
}

/// Converts `bytes`, a whole number of voxels of `stored`'s type, and appends the values to `values`.
pub(crate) fn decode<T: Voxel>(
    stored: &Stored,
    bytes: &[u8],
    values: &mut Vec<T>,
    faults: &mut Option<Faults>,
) {
    macro_rules! stored_as {
        ($($variant:ident $number:ty),*) => { match (stored.number, stored.big_endian) {$(
            (NumberType::$variant, false) =>
                convert(stored, bytes, |b| <$number>::from_le_bytes(b) as f64, values, faults),
            (NumberType::$variant, true) =>
                convert(stored, bytes, |b| <$number>::from_be_bytes(b) as f64, values, faults),
        )*
        }}
    }
    stored_as!(U8 u8, I8 i8, U16 u16, I16 i16, U32 u32, I32 i32, U64 u64, I64 i64, F32 f32, F64 f64);
}

fn convert<T: Voxel, const N: usize>(
    stored: &Stored,
    bytes: &[u8],
    number: impl Fn([u8; N]) -> f64,
    values: &mut Vec<T>,
    faults: &mut Option<Faults>,
) {
    let (numbers, _) = bytes.as_chunks::<N>();
    let [slope, intercept] = stored.scaling.unwrap_or([1.0, 0.0]);
    let value = |b: &[u8; N]| slope * number(*b) + intercept;
    let start = values.len() as u64;
    let mut accepted = true;
    values.extend(numbers.iter().map(|b| {
        let v = value(b);
        accepted &= T::accepts(v);
        T::from_value(v)
    }));
    if !accepted {
        for (place, v) in numbers.iter().map(value).enumerate().filter(|(_, v)| !T::accepts(*v)) {
            let fault = faults.get_or_insert(Faults { first: start + place as u64, value: v, count: 0 });
            fault.count += 1;
        }
    }
}

/// Reads `voxels` numbers piece by piece, so that little more than the result is ever in memory. With `reserve` the memory for all of
/// them is allocated at once: only where the file's size bears it out.
///
/// # Errors
/// [`StreamFault`].
pub(super) fn read_values<T: Voxel>(
    source: &mut dyn Read,
    stored: &Stored,
    voxels: u64,
    reserve: bool,
) -> Result<(Vec<T>, Option<Faults>), StreamFault> {
    let mut values = Vec::new();
    if reserve {
        let bytes = voxels * size_of::<T>() as u64;
        values.try_reserve_exact(voxels as usize).map_err(|_| StreamFault::Memory { bytes })?;
    }
    let (expected_bytes, mut done) = (voxels * stored.number.bytes() as u64, 0u64);
    let mut piece = vec![0; PIECE_BYTES];
    let mut faults = None;
    while done < expected_bytes {
        cancel::poll();
        let wanted = (expected_bytes - done).min(PIECE_BYTES as u64) as usize;
        let found = read_full(source, &mut piece[..wanted]).map_err(StreamFault::Io)?;
        if found < wanted {
            return Err(StreamFault::Truncated { expected_bytes, found_bytes: done + found as u64 });
        }
        decode(stored, &piece[..wanted], &mut values, &mut faults);
        done += wanted as u64;
    }
    Ok((values, faults))
}

/// Voxel (i, j, k) with the given number in memory.
pub(super) fn voxel(dims: [usize; 3], place: u64) -> [usize; 3] {
    let place = place as usize;
    let [nx, ny, _] = dims;
    [place % nx, place / nx % ny, place / (nx * ny)]
}
