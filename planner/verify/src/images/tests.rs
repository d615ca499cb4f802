//! Against the planner's reader: both read the same values at the same places, or both refuse.

use bonemill_imaging::{read_ct, read_labels};
use nalgebra::UnitQuaternion;
use proptest::prelude::*;
use std::io::Write;

use super::*;

const CHOICES: [AffineChoice; 3] = [AffineChoice::Auto, AffineChoice::Sform, AffineChoice::Qform];
/// `datatype` and bytes.
const TYPES: [(i16, usize); 10] =
    [(2, 1), (256, 1), (4, 2), (512, 2), (8, 4), (768, 4), (16, 4), (1024, 8), (1280, 8), (64, 8)];

/// A file's fields, as far as they matter.
#[derive(Debug, Clone)]
struct Written {
    dims: [i16; 3],
    kind: (i16, usize),
    scaling: [f32; 2],
    unit: u8,
    codes: [i16; 2],
    turn: [f64; 3],
    mirror: bool,
    size: [f64; 3],
    origin: [f64; 3],
    offset: f32,
    is_big: bool,
    is_gzip: bool,
    seed: u64,
}

impl Written {
    /// As NIfTI-2, with the same numbers.
    fn bytes_of_second(&self) -> Vec<u8> {
        let first = Self { is_big: false, ..self.clone() }.bytes();
        let mut out = vec![0u8; self.offset as usize + 192];
        let mut put = |at: usize, mut bytes: Vec<u8>| {
            if self.is_big {
                bytes.reverse();
            }
            out[at..at + bytes.len()].copy_from_slice(&bytes);
        };
        let short = |at: usize| i16::from_le_bytes([first[at], first[at + 1]]);
        let single = |at: usize| f64::from(f32::from_le_bytes(first[at..at + 4].try_into().unwrap()));
        put(0, 540i32.to_le_bytes().to_vec());
        [70, 72].iter().for_each(|at| put(at - 58, short(*at).to_le_bytes().to_vec()));
        (0..8).for_each(|n| put(16 + 8 * n, i64::from(short(40 + 2 * n)).to_le_bytes().to_vec()));
        put(168, (self.offset as i64 + 192).to_le_bytes().to_vec());
        for (to, from, count) in [(104, 76, 8), (176, 112, 2), (352, 256, 6), (400, 280, 12)] {
            (0..count).for_each(|n| put(to + 8 * n, single(from + 4 * n).to_le_bytes().to_vec()));
        }
        [252, 254].iter().for_each(|at| put(2 * at - 160, i32::from(short(*at)).to_le_bytes().to_vec()));
        put(500, i32::from(self.unit).to_le_bytes().to_vec());
        out[4..12].copy_from_slice(b"n+2\0\r\n\x1a\n");
        out.extend(&self.bytes()[self.offset as usize..]);
        out
    }

    fn bytes(&self) -> Vec<u8> {
        let mut out = vec![0u8; self.offset as usize];
        let mut put = |at: usize, mut bytes: Vec<u8>| {
            if self.is_big {
                bytes.reverse();
            }
            out[at..at + bytes.len()].copy_from_slice(&bytes);
        };
        put(0, 348i32.to_le_bytes().to_vec());
        let dim = [3, self.dims[0], self.dims[1], self.dims[2], 1, 1, 1, 1];
        dim.iter().enumerate().for_each(|(n, v)| put(40 + 2 * n, v.to_le_bytes().to_vec()));
        put(70, self.kind.0.to_le_bytes().to_vec());
        put(72, (8 * self.kind.1 as i16).to_le_bytes().to_vec());
        let rotation = UnitQuaternion::from_scaled_axis(Vector3::from(self.turn));
        let q = if rotation.w < 0.0 { UnitQuaternion::from_quaternion(-*rotation) } else { rotation };
        let qfac = if self.mirror { -1.0 } else { 1.0 };
        let [x, y, z] = self.size;
        let axes = rotation.to_rotation_matrix().into_inner();
        let columns = axes * Matrix3::from_diagonal(&Vector3::new(x, y, z * qfac));
        let mut singles = vec![(76, qfac), (80, x), (84, y), (88, z), (108, f64::from(self.offset))];
        singles.extend([(112, f64::from(self.scaling[0])), (116, f64::from(self.scaling[1]))]);
        singles.extend([(256, q.i), (260, q.j), (264, q.k)]);
        for r in 0..3 {
            singles.push((268 + 4 * r, self.origin[r]));
            singles.push((292 + 16 * r, self.origin[r]));
            singles.extend((0..3).map(|c| (280 + 16 * r + 4 * c, columns[(r, c)])));
        }
        singles.iter().for_each(|(at, v)| put(*at, (*v as f32).to_le_bytes().to_vec()));
        put(252, self.codes[0].to_le_bytes().to_vec());
        put(254, self.codes[1].to_le_bytes().to_vec());
        out[123] = self.unit;
        out[344..348].copy_from_slice(b"n+1\0");
        let voxels = self.dims.iter().map(|d| *d as usize).product::<usize>();
        for n in 0..voxels as u64 {
            let hash = (n ^ self.seed).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40;
            let mut stored = match self.kind {
                (16, _) => (hash as f32 / 7.0 - 900.0).to_le_bytes().to_vec(),
                (64, _) => (hash as f64 / 7.0 - 900.0).to_le_bytes().to_vec(),
                (_, size) => hash.to_le_bytes()[..size].to_vec(),
            };
            if self.is_big {
                stored.reverse();
            }
            out.extend(stored);
        }
        out
    }
}

prop_compose! {
    fn written()(
        dims in prop::array::uniform3(1i16..6), kind in prop::sample::select(&TYPES[..]),
        scaling in prop::sample::select(vec![[0.0, 3.0], [1.0, 0.0], [0.5, -3.0], [2.0, 10.0], [f32::NAN, 1.0]]),
        unit in prop::sample::select(vec![2u8, 2, 2, 10, 0, 1, 3]), codes in prop::array::uniform2(0i16..3),
        turn in prop::array::uniform3(-2.5f64..2.5), mirror: bool, size in prop::array::uniform3(0.2f64..3.0),
        origin in prop::array::uniform3(-90.0f64..90.0), offset in prop::sample::select(vec![352.0f32, 368.0]),
        is_big: bool, is_gzip: bool, seed: u64,
    ) -> Written {
        Written { dims, kind, scaling, unit, codes, turn, mirror, size, origin, offset, is_big, is_gzip, seed }
    }
}

/// The same grid and values by both readers, or a refusal by both.
fn agree(bytes: &[u8], is_gzip: bool, choice: AffineChoice) -> Result<bool, String> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("image.nii");
    let stored = if is_gzip {
        let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        encoder.write_all(bytes).unwrap();
        encoder.finish().unwrap()
    } else {
        bytes.to_vec()
    };
    std::fs::write(&path, stored).unwrap();
    let grey = (ct_as_stored(&path, choice), read_ct(&path, choice));
    let is_read = same(grey.0, grey.1.map(|image| image.volume))?;
    let label = (labels(&path, choice).map(|(read, _)| read.shown), read_labels(&path, choice));
    Ok(same(label.0, label.1.map(|image| image.volume))? || is_read)
}

fn same<T: PartialEq>(
    ours: Result<Volume<T, Ct>, VerifyError>,
    theirs: Result<Volume<T, Ct>, bonemill_imaging::ImageError>,
) -> Result<bool, String> {
    match (ours, theirs) {
        (Err(_), Err(_)) => Ok(false),
        (Err(ours), Ok(_)) => Err(format!("only we refuse: {ours}")),
        (Ok(_), Err(theirs)) => Err(format!("only we accept: {theirs}")),
        (Ok(ours), Ok(theirs)) => {
            let corners = ours.grid().corners().into_iter().zip(theirs.grid().corners());
            let off_mm = corners.map(|(p, q)| p.distance_mm(&q)).fold(0.0, f64::max);
            let is_same = ours.grid().dims() == theirs.grid().dims() && ours.data() == theirs.data();
            if is_same && off_mm < 1e-9 {
                Ok(true)
            } else {
                Err(format!("{off_mm} mm apart, or other values"))
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, ..ProptestConfig::default() })]

    #[test]
    fn every_header_is_read_as_by_the_planners_reader(file in written(), choice in prop::sample::select(&CHOICES[..])) {
        agree(&file.bytes(), file.is_gzip, choice).map_err(TestCaseError::fail)?;
    }

    #[test]
    fn every_header_of_nifti_2_is_read_as_by_the_planners_reader(
        file in written(), choice in prop::sample::select(&CHOICES[..]),
        damage in prop::collection::vec((0usize..544, any::<u8>()), 0..3), is_damaged: bool,
    ) {
        let mut bytes = file.bytes_of_second();
        damage.iter().filter(|_| is_damaged).for_each(|(at, byte)| bytes[*at] = *byte);
        let is_read = agree(&bytes, file.is_gzip, choice).map_err(TestCaseError::fail)?;
        let as_first = agree(&file.bytes(), file.is_gzip, choice).map_err(TestCaseError::fail)?;
        prop_assert!(is_damaged || is_read == as_first);
    }

    #[test]
    fn damaged_files_get_the_same_verdict(
        file in written(), places in prop::collection::vec((0usize..352, any::<u8>()), 0..3), share in 0.5f64..1.3,
        choice in prop::sample::select(&CHOICES[..]),
    ) {
        let mut bytes = file.bytes();
        places.iter().for_each(|(at, byte)| bytes[*at] = *byte);
        let length = bytes.len();
        bytes.resize((share * length as f64) as usize, 0);
        agree(&bytes, file.is_gzip, choice).map_err(TestCaseError::fail)?;
    }
}

/// A file that both read, changed in one field.
fn verdict(change: impl FnOnce(&mut Vec<u8>)) -> bool {
    let plain = Written {
        dims: [5, 4, 3],
        kind: (4, 2),
        scaling: [1.0, 0.0],
        unit: 2,
        codes: [1, 1],
        turn: [0.3, -0.2, 0.5],
        mirror: false,
        size: [0.3, 0.5, 1.25],
        origin: [-90.0, 4.0, 210.5],
        offset: 352.0,
        is_big: false,
        is_gzip: false,
        seed: 3,
    };
    let mut bytes = plain.bytes();
    change(&mut bytes);
    agree(&bytes, false, AffineChoice::Auto).unwrap()
}

#[test]
fn what_is_in_doubt_is_refused_by_both() {
    let put =
        |at: usize, value: f32| move |b: &mut Vec<u8>| b[at..at + 4].copy_from_slice(&value.to_le_bytes());
    assert!(verdict(|_| {}));
    // the origin by the sform, in and beyond 0.1 of a voxel of 0.3 mm
    assert!(verdict(put(292, -89.98)));
    assert!(!verdict(put(292, -89.96)));
    // no transform, NaN, a quaternion beyond 1, pixdim 0, and a size that the columns contradict without a qform
    assert!(!verdict(|b| b[252..256].fill(0)));
    assert!(!verdict(put(284, f32::NAN)));
    assert!(!verdict(put(256, 1.5)));
    assert!(!verdict(put(80, 0.0)));
    assert!(!verdict(|b| {
        b[252] = 0;
        put(88, 1.2)(b);
    }));
    // another mark, a series, complex numbers, a voxel's place in the header, a length that is short or long
    assert!(!verdict(|b| b[345] = b'i'));
    assert!(!verdict(|b| (b[40], b[48]) = (4, 2)));
    assert!(!verdict(|b| (b[70], b[72]) = (32, 64)));
    assert!(!verdict(put(108, 348.0)));
    assert!(!verdict(|b| b.truncate(b.len() - 1)));
    assert!(!verdict(|b| b.resize(b.len() + 5000, 0)));
    assert!(verdict(|b| b.resize(b.len() + 4096, 0)));
}

/// b, c and d are rounded, which moves a corner by a third of a voxel close to a half turn.
#[test]
fn a_quaternion_close_to_a_half_turn_is_no_disagreement() {
    // about axes of all directions, since rounding differs
    let axes = (0..40).map(|n| bonemill_geometry::basis::on_sphere(n, 40).into_inner());
    let half = axes.map(|axis| (0.0, axis));
    let short_of_half =
        [1e-4, 3e-4, 7e-4, 2e-3, 1e-2].map(|rad| (rad, Vector3::new(1.975, -2.293, -0.845).normalize()));
    for (short_of_half_rad, axis) in half.chain(short_of_half) {
        let turn = (axis * (std::f64::consts::PI - short_of_half_rad)).into();
        let file = Written {
            dims: [300, 3, 200],
            kind: (2, 1),
            scaling: [1.0, 0.0],
            unit: 2,
            codes: [1, 1],
            turn,
            mirror: false,
            size: [0.3, 0.5, 0.6],
            origin: [0.0; 3],
            offset: 352.0,
            is_big: false,
            is_gzip: true,
            seed: 0,
        };
        assert_eq!(agree(&file.bytes(), true, AffineChoice::Auto), Ok(true), "{short_of_half_rad} {axis}");
    }
}
