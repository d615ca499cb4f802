//! Round trips, every stored type, and files that lie.
#![allow(clippy::print_stderr)] // a test without its data says so

use std::io::Write;
use std::path::PathBuf;

use ::nifti::{IntoNdArray, NiftiObject};
use bonemill_geometry::{Grid, Point};
use nalgebra::{Matrix3, Rotation3, Vector3};
use proptest::prelude::*;

use super::*;
use crate::{write_ct_i16, write_labels_u8};

mod dicom_file;
mod dicom_tests;
mod foreign_tests;
mod label_tests;
mod metaimage_tests;
mod nifti2_tests;
mod nrrd_tests;
mod placement_tests;
mod same_image_tests;

const AUTO: AffineChoice = AffineChoice::Auto;

fn affine<T>(image: &Image<T>) -> AffineReport {
    match image.provenance.placement {
        Placement::Nifti(report) => report,
        other => panic!("{other}"),
    }
}

fn grid(turn: [f64; 3], mirror: bool) -> Grid<Ct> {
    let mut axes = Rotation3::new(Vector3::from(turn)).into_inner();
    if mirror {
        axes.set_column(1, &-axes.column(1));
    }
    Grid::new([5, 4, 3], Vector3::new(0.3, 0.5, 1.25), axes, Vector3::new(-90.0, 4.0, 210.5)).unwrap()
}

fn ct(turn: [f64; 3], mirror: bool) -> Volume<i16, Ct> {
    let grid = grid(turn, mirror);
    let data = (0..grid.len()).map(|n| n as i16 * 37 - 1000).collect();
    Volume::new(grid, data).unwrap()
}

/// A temporary file with the bytes of the 5×4×3 CT, changed.
struct Changed {
    dir: tempfile::TempDir,
    path: PathBuf,
}

impl Changed {
    fn new(change: impl FnOnce(&mut Vec<u8>)) -> Self {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("ct.nii");
        write_ct_i16(&path, &ct([0.3, -0.2, 0.5], false)).unwrap();
        let mut bytes = fs_read(&path);
        change(&mut bytes);
        std::fs::write(&path, &bytes).unwrap();
        Self { dir, path }
    }

    fn read(&self, choice: AffineChoice) -> Result<Image<f32>, NiftiProblem> {
        read_ct(&self.path, choice).map_err(|e| match e {
            ImageError::Nifti { path, problem } => {
                assert_eq!(path, self.path);
                problem
            }
            other => panic!("{other}"),
        })
    }

    fn problem(&self) -> NiftiProblem {
        self.read(AUTO).unwrap_err()
    }
}

fn fs_read(path: &Path) -> Vec<u8> {
    std::fs::read(path).unwrap()
}

fn put(bytes: &mut [u8], at: usize, value: &[u8]) {
    bytes[at..at + value.len()].copy_from_slice(value);
}

fn put_f32(bytes: &mut [u8], at: usize, value: f32) {
    put(bytes, at, &value.to_le_bytes());
}

fn put_i16(bytes: &mut [u8], at: usize, value: i16) {
    put(bytes, at, &value.to_le_bytes());
}

fn problem(change: impl FnOnce(&mut Vec<u8>)) -> NiftiProblem {
    Changed::new(change).problem()
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

fn assert_same_grid(a: &Grid<Ct>, b: &Grid<Ct>) {
    // singles at 210 mm
    assert_grids_within(a, b, 5e-5);
}

fn assert_grids_within(a: &Grid<Ct>, b: &Grid<Ct>, tolerance_mm: f64) {
    assert_eq!(a.dims(), b.dims());
    for (p, q) in a.corners().iter().zip(b.corners()) {
        assert!(p.distance_mm(&q) < tolerance_mm, "{p:?} {q:?}");
    }
}

proptest! {
    #[test]
    fn what_is_written_is_read(
        turn in prop::array::uniform3(-3.1f64..3.1), mirror: bool, gz: bool, which in 0usize..3,
    ) {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join(if gz { "a.b.nii.gz" } else { "a.b.nii" });
        let volume = ct(turn, mirror);
        write_ct_i16(&path, &volume).unwrap();
        let choice = [AffineChoice::Auto, AffineChoice::Sform, AffineChoice::Qform][which];
        let image = read_ct(&path, choice).unwrap();
        // a quaternion keeps b, c, d as singles: a = √(1 − b² − c² − d²), and with it the turn, loses digits near a half turn
        let a = (0.5 * Vector3::from(turn).norm()).cos().abs().max(3e-4);
        let quaternion_mm = if which == 2 { 60.0 * 3.0 * 6e-8 / a } else { 0.0 };
        assert_grids_within(image.volume.grid(), volume.grid(), 5e-5 + quaternion_mm);
        prop_assert!(image.volume.data().iter().zip(volume.data()).all(|(a, b)| *a == f32::from(*b)));
        prop_assert!(affine(&image).disagreement_voxels.unwrap() < 1e-3);
        prop_assert!(affine(&image).shear_rad < 1e-6);
        prop_assert_eq!((affine(&image).sform_code, affine(&image).qform_code), (1, 1));
        prop_assert!(image.warnings.is_empty());
        prop_assert_eq!(image.volume.grid().axes().determinant() < 0.0, mirror);
    }

    #[test]
    fn no_bytes_make_the_reader_panic(places in prop::collection::vec((0usize..400, any::<u8>()), 1..12), gz: bool) {
        let file = Changed::new(|bytes| {
            places.iter().for_each(|(at, b)| bytes[*at] = *b);
            if gz { *bytes = gzip(bytes); }
        });
        let _ = file.read(AUTO);
        let _ = read_labels(&file.path, AffineChoice::Qform);
    }

    #[test]
    fn a_file_cut_anywhere_is_refused(share in 0.0f64..1.0, gz: bool) {
        let file = Changed::new(|bytes| {
            if gz { *bytes = gzip(bytes); }
            bytes.truncate((share * bytes.len() as f64) as usize);
        });
        prop_assert!(file.read(AUTO).is_err());
    }
}

#[test]
fn the_nifti_crate_reads_what_is_written() {
    let dir = tempfile::tempdir().unwrap();
    for (name, mirror) in [("ct.nii.gz", false), ("ct.nii", true)] {
        let path = dir.path().join(name);
        let volume = ct([0.4, 1.2, -0.7], mirror);
        write_ct_i16(&path, &volume).unwrap();
        let object = ::nifti::ReaderOptions::new().read_file(&path).unwrap();
        let header = object.header();
        assert_eq!(header.xyzt_to_space().unwrap(), ::nifti::Unit::Mm);
        for affine in [header.sform_affine::<f64>(), header.qform_affine::<f64>()] {
            let p = affine * nalgebra::Vector4::new(4.0, 3.0, 2.0, 1.0);
            let q = volume.grid().center([4, 3, 2]);
            assert!((p.xyz() - q.coords).norm() < 5e-5);
        }
        let array = object.into_volume().into_ndarray::<i16>().unwrap();
        assert_eq!(array.shape(), [5, 4, 3]);
        assert_eq!(array[[4, 2, 1]], *volume.get([4, 2, 1]));
    }
}

#[test]
fn the_same_volume_is_the_same_bytes_and_a_refused_path_an_error() {
    let dir = tempfile::tempdir().unwrap();
    let labels = ct([0.0; 3], false).map(|v| (*v & 15) as u8);
    let [a, b] = ["a.nii.gz", "b.nii.gz"].map(|name| dir.path().join(name));
    write_labels_u8(&a, &labels).unwrap();
    write_labels_u8(&b, &labels).unwrap();
    assert_eq!(fs_read(&a), fs_read(&b));
    let back = read_labels(&a, AUTO).unwrap();
    assert!(back.volume.data().iter().zip(labels.data()).all(|(x, y)| *x == u16::from(*y)));
    let nowhere = dir.path().join("none").join("a.nii");
    let message = write_labels_u8(&nowhere, &labels).unwrap_err().to_string();
    assert!(message.contains("none"), "{message}");
}

#[test]
fn a_full_disk_is_an_error() {
    let full = Path::new("/dev/full");
    if !full.exists() {
        eprintln!("/dev/full is absent: not tested");
        return;
    }
    // reached through a link, so that taking the broken file away takes the link
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("ct.nii.gz");
    std::os::unix::fs::symlink(full, &path).unwrap();
    assert!(matches!(write_ct_i16(&path, &ct([0.0; 3], false)), Err(ImageError::Write { .. })));
    assert!(!path.exists());
}

/// The 60 voxels stored as another type, in either byte order, with a slope and an intercept.
fn stored<const N: usize>(
    code: i16,
    big: bool,
    scale: [f32; 2],
    number: impl Fn(usize) -> [u8; N],
) -> Changed {
    Changed::new(|bytes| {
        put_i16(bytes, 70, code);
        put_i16(bytes, 72, 8 * N as i16);
        put_f32(bytes, 112, scale[0]);
        put_f32(bytes, 116, scale[1]);
        bytes.truncate(352);
        if big {
            swap_header(bytes);
        }
        for n in 0..60 {
            let mut stored = number(n);
            if big {
                stored.reverse();
            }
            bytes.extend(stored);
        }
    })
}

fn swap_header(bytes: &mut [u8]) {
    let fields =
        [(0, 4, 1), (32, 4, 1), (36, 2, 1), (40, 2, 8), (56, 4, 3), (68, 2, 4), (76, 4, 11), (120, 2, 1)];
    let more = [(124, 4, 6), (252, 2, 2), (256, 4, 18)];
    for (at, size, count) in fields.into_iter().chain(more) {
        bytes[at..at + size * count].chunks_mut(size).for_each(<[u8]>::reverse);
    }
}

#[test]
fn every_scalar_type_is_read_in_both_byte_orders() {
    for big in [false, true] {
        for scale in [[0.0, 9.0], [1.0, 0.0], [0.5, -3.0]] {
            let expected: Vec<f32> = (0..60)
                .map(|n| if scale[0] == 0.0 { n as f32 } else { n as f32 * scale[0] + scale[1] })
                .collect();
            let files = [
                stored(2, big, scale, |n| (n as u8).to_le_bytes()),
                stored(256, big, scale, |n| (n as i8).to_le_bytes()),
                stored(4, big, scale, |n| (n as i16).to_le_bytes()),
                stored(512, big, scale, |n| (n as u16).to_le_bytes()),
                stored(8, big, scale, |n| (n as i32).to_le_bytes()),
                stored(768, big, scale, |n| (n as u32).to_le_bytes()),
                stored(1024, big, scale, |n| (n as i64).to_le_bytes()),
                stored(1280, big, scale, |n| (n as u64).to_le_bytes()),
                stored(16, big, scale, |n| (n as f32).to_le_bytes()),
                stored(64, big, scale, |n| (n as f64).to_le_bytes()),
            ];
            for file in files {
                let image = file.read(AUTO).unwrap();
                assert_eq!(image.volume.data(), expected);
                assert_same_grid(image.volume.grid(), &grid([0.3, -0.2, 0.5], false));
            }
        }
    }
    let signed = stored(4, true, [1.0, 0.0], |n| (n as i16 - 30).to_le_bytes()).read(AUTO).unwrap();
    assert_eq!(signed.volume.data()[0], -30.0);
}

#[test]
fn labels_are_scaled_and_must_be_whole() {
    let labels = |f: &Changed| read_labels(&f.path, AUTO);
    // a slope of 0.1 is not exact in single precision
    let image = labels(&stored(512, false, [0.1, 5.0], |n| (10 * n as u16).to_le_bytes())).unwrap();
    assert!(image.volume.data().iter().enumerate().all(|(n, v)| usize::from(*v) == n + 5));
    let broken = |f: &Changed| match labels(f) {
        Err(ImageError::Nifti { problem: NiftiProblem::NotLabels { first, value, count }, .. }) => {
            (first, value, count)
        }
        other => panic!("{other:?}"),
    };
    // n / 2 is whole for every other voxel
    assert_eq!(broken(&stored(2, false, [0.5, 0.0], |n| [n as u8])), ([1, 0, 0], 0.5, 30));
    assert_eq!(broken(&stored(256, false, [1.0, 0.0], |n| [(57 - n as i8) as u8])), ([3, 3, 2], -1.0, 2));
    assert_eq!(
        broken(&stored(8, false, [1.0, 65530.0], |n| (n as i32).to_le_bytes())),
        ([1, 1, 0], 65536.0, 54)
    );
    let nan = stored(16, false, [0.0, 0.0], |n| (if n == 7 { f32::NAN } else { 1.0 }).to_le_bytes());
    assert_eq!(broken(&nan).0, [2, 1, 0]);
}

#[test]
fn grey_values_that_are_not_finite_are_counted_and_the_first_is_named() {
    let file = stored(64, false, [0.0, 0.0], |n| {
        match n {
            26 => f64::INFINITY,
            30 => f64::NAN,
            31 => 1e39,
            _ => 1.5,
        }
        .to_le_bytes()
    });
    match file.problem() {
        NiftiProblem::VoxelsNotFinite { first, value, count } => {
            assert_eq!((first, value, count), ([1, 1, 1], f64::INFINITY, 3))
        }
        other => panic!("{other}"),
    }
}

#[test]
fn voxels_start_where_the_header_says() {
    // vox_offset 400 without extensions
    let file = Changed::new(|bytes| {
        put_f32(bytes, 108, 400.0);
        let tail = bytes.split_off(352);
        bytes.extend([0xee; 48]);
        bytes.extend(tail);
    });
    assert_eq!(file.read(AUTO).unwrap().volume.data()[1], -963.0);
    for bad in [0.0, 348.0, 351.9, 400.5, -1.0, f32::NAN, f32::INFINITY, 1e30] {
        assert!(matches!(problem(|b| put_f32(b, 108, bad)), NiftiProblem::VoxOffset { .. }), "{bad}");
    }
}

#[test]
fn a_slope_that_is_no_number_means_no_scaling_and_an_infinite_one_is_refused() {
    let image = Changed::new(|b| put_f32(b, 112, f32::NAN)).read(AUTO).unwrap();
    assert_eq!((image.volume.data()[0], image.warnings), (-1000.0, vec![ReadWarning::SlopeNotANumber]));
    for (slope, inter) in [(f32::INFINITY, 0.0), (1.0, f32::NAN), (2.0, f32::INFINITY)] {
        let p = problem(|b| {
            put_f32(b, 112, slope);
            put_f32(b, 116, inter);
        });
        assert!(matches!(p, NiftiProblem::Scaling { .. }), "{p}");
    }
}

#[test]
fn units_are_converted_to_mm() {
    let straight = |unit: u8, scale: f32| {
        Changed::new(|b| {
            b[123] = unit | 8;
            for at in (280..328).step_by(4).chain([80, 84, 88, 268, 272, 276]) {
                let v = f32::from_le_bytes([b[at], b[at + 1], b[at + 2], b[at + 3]]);
                put_f32(b, at, v * scale);
            }
        })
    };
    for (unit, scale, warnings) in [
        (2, 1.0, vec![]),
        (0, 1.0, vec![ReadWarning::UnitUnknown]),
        (1, 1e-3, vec![ReadWarning::UnitConverted { unit: "m" }]),
        (3, 1e3, vec![ReadWarning::UnitConverted { unit: "µm" }]),
    ] {
        let image = straight(unit, scale).read(AUTO).unwrap();
        assert_same_grid(image.volume.grid(), &grid([0.3, -0.2, 0.5], false));
        assert_eq!(image.warnings, warnings);
    }
    assert!(matches!(straight(5, 1.0).problem(), NiftiProblem::Units { code: 5 }));
    // metres that say nothing, or mm
    assert!(matches!(straight(0, 1e-3).problem(), NiftiProblem::Spacing { .. }));
    assert!(matches!(straight(2, 1e3).problem(), NiftiProblem::Spacing { .. }));
}

#[test]
fn what_is_no_volume_is_refused() {
    use NiftiProblem as P;
    assert!(matches!(problem(|b| put(b, 344, b"n+2\0")), P::Magic { found, .. } if found == b"n+2\0"));
    assert!(matches!(problem(|b| put(b, 344, b"ni1\0")), P::Pair { .. }));
    assert!(matches!(problem(|b| put(b, 0, &349i32.to_le_bytes())), P::NotNifti { sizeof_hdr: 349 }));
    // the size of NIfTI-2's header before NIfTI-1's fields
    assert!(matches!(problem(|b| put(b, 0, &540i32.to_le_bytes())), P::NoHeader { found_bytes: 472, .. }));
    assert!(matches!(problem(|b| b.truncate(347)), P::NoHeader { found_bytes: 347, .. }));
    assert!(matches!(problem(Vec::clear), P::NoHeader { found_bytes: 0, .. }));
    for bad in [0, 8, -1, 300, i16::MIN] {
        assert!(matches!(problem(|b| put_i16(b, 40, bad)), P::Dims { .. }), "{bad}");
    }
    for (at, bad) in [(42, 0), (44, -4), (46, i16::MIN)] {
        assert!(matches!(problem(|b| put_i16(b, at, bad)), P::Dims { .. }), "{at} {bad}");
    }
    assert!(matches!(problem(|b| put_i16(b, 72, 8)), P::Bits { bitpix: 8, code: 4, expected: 16 }));
    assert!(matches!(problem(|b| put_i16(b, 72, -16)), P::Bits { .. }));
    for (code, name) in
        [(128, "colour"), (32, "complex"), (1536, "128-bit float"), (1, "unknown"), (-4, "unknown")]
    {
        match problem(|b| put_i16(b, 70, code)) {
            P::VoxelType { code: found, name: said } => assert_eq!((found, said), (code, name)),
            other => panic!("{other}"),
        }
    }
}

#[test]
fn a_fourth_dimension_of_one_is_a_volume_and_of_two_is_not() {
    let four = |count: i16| {
        Changed::new(|b| {
            put_i16(b, 40, 4);
            put_i16(b, 48, count);
        })
    };
    assert_eq!(four(1).read(AUTO).unwrap().volume.grid().dims(), [5, 4, 3]);
    assert!(matches!(four(2).problem(), NiftiProblem::Volumes { volumes: 2, .. }));
}

#[test]
fn a_header_that_promises_too_much_is_refused_at_once() {
    use NiftiProblem as P;
    let huge = |b: &mut Vec<u8>, size: i16| (0..3).for_each(|a| put_i16(b, 42 + 2 * a, size));
    assert!(matches!(problem(|b| huge(b, 32767)), P::TooLarge { .. }));
    // below the limit, past the file
    assert!(matches!(problem(|b| huge(b, 1000)), P::FileTooSmall { .. }));
    let zipped = problem(|b| {
        huge(b, 1000);
        *b = gzip(b);
    });
    assert!(matches!(zipped, P::FileTooSmall { .. }));
    // a gzip file that could hold it and does not
    let short = problem(|b| {
        put_i16(b, 42, 100);
        *b = gzip(b);
    });
    match short {
        P::Truncated { expected_bytes, found_bytes } => {
            assert_eq!((expected_bytes, found_bytes), (2400, 120))
        }
        other => panic!("{other}"),
    }
}

#[test]
fn more_than_the_header_says_is_padding_or_a_lie() {
    let image = Changed::new(|b| b.extend([0; 160])).read(AUTO).unwrap();
    assert_eq!(image.warnings, [ReadWarning::Padding { bytes: 160 }]);
    assert!(matches!(problem(|b| b.extend([0; 5000])), NiftiProblem::Surplus { .. }));
}

#[test]
fn a_damaged_gzip_stream_is_refused() {
    let zipped = |damage: fn(&mut Vec<u8>)| {
        problem(|b| {
            // long enough for several blocks
            *b = gzip(b);
            damage(b);
        })
    };
    // the checksum, which only the end of the stream shows
    let checksum = zipped(|b| {
        let at = b.len() - 6;
        b[at] ^= 1;
    });
    assert!(matches!(checksum, NiftiProblem::Corrupt(_)), "{checksum}");
    let cut = zipped(|b| b.truncate(b.len() - 9));
    assert!(matches!(cut, NiftiProblem::Corrupt(_)), "{cut}");
    let garbage = zipped(|b| b.extend(b"garbage"));
    assert!(matches!(garbage, NiftiProblem::Corrupt(_)), "{garbage}");
    // two members one after the other are one stream
    let two = Changed::new(|b| {
        let tail = b.split_off(200);
        *b = [gzip(b), gzip(&tail)].concat();
    });
    assert_eq!(two.read(AUTO).unwrap().volume.data()[1], -963.0);
}

#[test]
fn a_missing_file_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let missing = dir.path().join("nothing.nii.gz");
    let message = read_ct(&missing, AUTO).unwrap_err().to_string();
    assert!(message.contains("nothing.nii.gz") && message.contains("cannot be read"), "{message}");
}
