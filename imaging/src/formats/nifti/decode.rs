//! Converts stored voxels to values: byte order, scaling, and a check of every value.

use nifti::NiftiType;

use super::header::Layout;

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

/// Converts `bytes`, a whole number of voxels of `layout`'s type, and appends the values to `values`.
pub(crate) fn decode<T: Voxel>(
    layout: &Layout,
    bytes: &[u8],
    values: &mut Vec<T>,
    faults: &mut Option<Faults>,
) {
    macro_rules! stored_as {
        ($($variant:ident $number:ty),*) => { match (layout.voxel_type, layout.big_endian) {$(
            (NiftiType::$variant, false) =>
                convert(layout, bytes, |b| <$number>::from_le_bytes(b) as f64, values, faults),
            (NiftiType::$variant, true) =>
                convert(layout, bytes, |b| <$number>::from_be_bytes(b) as f64, values, faults),
        )*
            // the check of the header refuses all other types
            _ => {}
        }}
    }
    stored_as!(Uint8 u8, Int8 i8, Uint16 u16, Int16 i16, Uint32 u32, Int32 i32, Uint64 u64, Int64 i64,
        Float32 f32, Float64 f64);
}

fn convert<T: Voxel, const N: usize>(
    layout: &Layout,
    bytes: &[u8],
    number: impl Fn([u8; N]) -> f64,
    values: &mut Vec<T>,
    faults: &mut Option<Faults>,
) {
    let (stored, _) = bytes.as_chunks::<N>();
    let [slope, intercept] = layout.scaling.unwrap_or([1.0, 0.0]);
    let value = |b: &[u8; N]| slope * number(*b) + intercept;
    let start = values.len() as u64;
    let mut accepted = true;
    values.extend(stored.iter().map(|b| {
        let v = value(b);
        accepted &= T::accepts(v);
        T::from_value(v)
    }));
    if !accepted {
        for (place, v) in stored.iter().map(value).enumerate().filter(|(_, v)| !T::accepts(*v)) {
            let fault = faults.get_or_insert(Faults { first: start + place as u64, value: v, count: 0 });
            fault.count += 1;
        }
    }
}
