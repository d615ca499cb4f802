//! Where an image lies: sform, qform, what is refused, and the real scans.

use super::*;

#[test]
fn the_sform_counts_then_the_qform_and_pixdim_alone_never() {
    let shifted = |sform_code: i16, qform_code: i16, shift_mm: f32| {
        Changed::new(|b| {
            put_i16(b, 252, qform_code);
            put_i16(b, 254, sform_code);
            // srow_x[3]
            put_f32(b, 292, -90.0 + shift_mm);
        })
    };
    let x = |f: &Changed, choice| f.read(choice).map(|i| (affine(&i).source, i.volume.grid().origin().x()));
    assert_eq!(x(&shifted(1, 0, 5.0), AUTO).unwrap(), (AffineSource::Sform, -85.0));
    assert_eq!(x(&shifted(0, 1, 5.0), AUTO).unwrap(), (AffineSource::Qform, -90.0));
    assert!(matches!(x(&shifted(0, 0, 5.0), AUTO), Err(NiftiProblem::NoTransform)));
    // 0.1 voxel is 0.03 mm here
    assert!(x(&shifted(1, 1, 0.02), AUTO).is_ok());
    assert!(matches!(x(&shifted(1, 1, 0.04), AUTO), Err(NiftiProblem::Disagreement { .. })));
    assert_eq!(x(&shifted(1, 1, 5.0), AffineChoice::Sform).unwrap(), (AffineSource::Sform, -85.0));
    assert_eq!(x(&shifted(1, 1, 5.0), AffineChoice::Qform).unwrap(), (AffineSource::Qform, -90.0));
    let report = affine(&shifted(1, 1, 5.0).read(AffineChoice::Qform).unwrap());
    assert!((report.disagreement_voxels.unwrap() - 5.0 / 0.3).abs() < 1e-3);
    assert!(matches!(x(&shifted(0, 1, 0.0), AffineChoice::Sform), Err(NiftiProblem::TransformUnset { .. })));
}

#[test]
fn a_quaternion_rounded_close_to_a_half_turn_is_no_disagreement() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("ct.nii");
    for axis in [Vector3::new(1.975, -2.293, -0.845), Vector3::x(), Vector3::new(0.3, 1.0, 0.2)] {
        for short_of_half_rad in [0.0, 1e-4, 3e-4, 7e-4, 2e-3, 1e-2, -5e-4] {
            let turn = axis.normalize() * (std::f64::consts::PI - short_of_half_rad);
            let axes = Rotation3::new(turn).into_inner();
            let grid = Grid::new([512, 3, 400], Vector3::new(0.3, 0.5, 0.6), axes, Vector3::zeros()).unwrap();
            write_labels_u8(&path, &Volume::filled(grid, 1)).unwrap();
            let affine = affine(&read_labels(&path, AUTO).unwrap());
            // without allowing for the rounding 0.3 voxels, and the file refused
            assert!(affine.disagreement_voxels.unwrap() < 0.01, "{turn:?} {affine:?}");
        }
    }
}

#[test]
fn a_turned_sform_disagrees_at_the_far_corner_only() {
    // 0.03 voxels over the first axis' 5 voxels, 0.15 over the third's: the origin agrees exactly
    let file = Changed::new(|b| {
        let turn =
            Rotation3::new(Vector3::new(0.03, 0.0, 0.0)) * Rotation3::new(Vector3::new(0.3, -0.2, 0.5));
        for (row, column) in (0..3).flat_map(|r| (0..3).map(move |c| (r, c))) {
            put_f32(b, 280 + 16 * row + 4 * column, (turn[(row, column)] * [0.3, 0.5, 1.25][column]) as f32);
        }
    });
    assert!(matches!(file.problem(), NiftiProblem::Disagreement { .. }));
}

/// With no qform, the lengths of the sform's columns are compared with pixdim.
#[test]
fn voxel_sizes_that_contradict_pixdim_are_refused_unless_the_case_chooses_the_sform() {
    let with = |pixdim: [f32; 3], unit: u8| {
        Changed::new(|b| {
            put_i16(b, 252, 0);
            b[123] = unit;
            (0..3).for_each(|a| put_f32(b, 80 + 4 * a, pixdim[a]));
            if unit == 3 {
                (0..12).filter(|n| n % 4 < 3).for_each(|n| scale_f32(b, 280 + 4 * n, 1000.0));
            }
        })
    };
    // the far corner lies at index (4.5, 3.5, 2.5); 0.1 of the smallest voxel is 0.03 mm
    for (pixdim, is_refused) in [
        ([0.3, 0.5, 1.25], false),
        ([0.306, 0.5, 1.25], false),
        ([0.307, 0.5, 1.25], true),
        ([0.3, 0.5, 1.2625], true),
        ([0.3 / 1.155, 0.5 / 1.155, 1.25 / 1.155], true),
        ([0.0, 0.5, 1.25], true),
        ([-0.3, 0.5, 1.25], true),
        ([f32::NAN, 0.5, 1.25], true),
    ] {
        let file = with(pixdim, 2);
        let found = file.read(AUTO);
        assert_eq!(matches!(found, Err(NiftiProblem::VoxelSizes { .. })), is_refused, "{pixdim:?} {found:?}");
        assert!(is_refused || found.is_ok(), "{pixdim:?}");
        assert_same_grid(
            file.read(AffineChoice::Sform).unwrap().volume.grid(),
            &grid([0.3, -0.2, 0.5], false),
        );
    }
    let said = with([0.26, 0.5, 1.25], 2).problem().to_string();
    for part in [
        "0.3 × 0.5 × 1.25 mm by the sform",
        "0.26 × 0.5 × 1.25 mm by pixdim",
        "images.ct_affine",
        "images.labels_affine",
    ] {
        assert!(said.contains(part), "{said}");
    }
    // both in µm
    assert!(with([300.0, 500.0, 1250.0], 3).read(AUTO).is_ok());
    assert!(matches!(with([0.3, 0.5, 1.25], 3).problem(), NiftiProblem::VoxelSizes { .. }));
}

fn scale_f32(bytes: &mut [u8], at: usize, by: f32) {
    let stored = f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
    put_f32(bytes, at, stored * by);
}

#[test]
fn impossible_transforms_are_refused() {
    use NiftiProblem as P;
    assert!(matches!(
        problem(|b| put_f32(b, 284, f32::NAN)),
        P::AffineNotFinite { which: AffineSource::Sform }
    ));
    assert!(matches!(
        problem(|b| put_f32(b, 256, f32::NAN)),
        P::AffineNotFinite { which: AffineSource::Qform }
    ));
    assert!(matches!(problem(|b| put_f32(b, 256, 1.5)), P::Qform { .. }));
    assert!(matches!(problem(|b| put_f32(b, 80, 0.0)), P::Qform { .. }));
    // what is wrong with the one that the case does not use does no harm
    let image = Changed::new(|b| put_f32(b, 256, f32::NAN)).read(AffineChoice::Sform).unwrap();
    assert_eq!(affine(&image).disagreement_voxels, None);

    let with_columns = |m: Matrix3<f64>| {
        Changed::new(|b| {
            put_i16(b, 252, 0);
            for (row, column) in (0..3).flat_map(|r| (0..3).map(move |c| (r, c))) {
                put_f32(b, 280 + 16 * row + 4 * column, m[(row, column)] as f32);
            }
        })
    };
    let mut sheared = Matrix3::from_diagonal(&Vector3::new(0.5, 0.5, 1.0));
    sheared[(0, 2)] = 2e-3;
    assert!(matches!(with_columns(sheared).problem(), P::Shear { .. }));
    sheared[(0, 2)] = 5e-4;
    let image = with_columns(sheared).read(AffineChoice::Sform).unwrap();
    assert!((affine(&image).shear_rad - 5e-4).abs() < 1e-7);
    let axes = image.volume.grid().axes();
    assert!((axes.transpose() * axes - Matrix3::identity()).amax() < 1e-12);

    for singular in
        [Matrix3::zeros(), Matrix3::from_element(0.4), Matrix3::from_diagonal(&Vector3::new(0.5, 0.0, 1.0))]
    {
        assert!(matches!(with_columns(singular).problem(), P::AffineSingular { .. }), "{singular}");
    }
}

#[test]
fn a_qform_with_a_mirrored_axis_is_mirrored() {
    let file = Changed::new(|b| {
        put_i16(b, 254, 0);
        put_f32(b, 76, -1.0);
    });
    let image = file.read(AUTO).unwrap();
    assert!(image.volume.grid().axes().determinant() < 0.0);
    // qfac 0 is +1
    let image = Changed::new(|b| put_f32(b, 76, 0.0)).read(AUTO).unwrap();
    assert!(image.volume.grid().axes().determinant() > 0.0);
    drop(file.dir);
}

/// The folder of real images, or a visible note that it is absent.
fn real_data(case: &str) -> Option<PathBuf> {
    let data = std::env::var_os("BONEMILL_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data"), PathBuf::from);
    let folder = data.join(case);
    if !folder.is_dir() {
        eprintln!("{} is absent: not tested on real images (set BONEMILL_DATA)", folder.display());
        return None;
    }
    Some(folder)
}

/// Sums and places found with nibabel and numpy.
#[test]
fn real_images_are_read_as_nibabel_reads_them() {
    for (case, dims, spacing, origin, sum, labels) in [
        (
            "tbone_RT143",
            [256, 256, 252],
            [0.192197993, 0.192197993, 0.192019805],
            Point::<Ct>::new(4.96531057, 133.250412, -196.804001),
            3043941008.0,
            vec![(10u16, 9983usize), (20, 665_500), (13, 2_858_666)],
        ),
        (
            "head_cranium0051",
            [256, 256, 108],
            [0.95703119, 0.95703119, 1.5],
            Point::new(0.0, 0.0, 0.0),
            -4147325847.0,
            vec![(1, 403_920), (2, 49_861), (3, 1_879_211)],
        ),
    ] {
        let Some(folder) = real_data(case) else { continue };
        let ct = read_ct(folder.join("ct.nii.gz"), AUTO).unwrap();
        let grid = ct.volume.grid();
        assert_eq!(grid.dims(), dims);
        assert!((0..3).all(|a| (grid.spacing_mm()[a] - spacing[a]).abs() < 1e-7));
        assert!(grid.origin().distance_mm(&origin) < 1e-4);
        assert_eq!(ct.volume.data().iter().map(|v| f64::from(*v)).sum::<f64>(), sum);
        crate::looks_like_hu(&ct.volume).unwrap();
        let map = read_labels(folder.join("labels.nii.gz"), AUTO).unwrap();
        for (label, count) in labels {
            assert_eq!(map.volume.data().iter().filter(|v| **v == label).count(), count);
        }
        assert!(
            crate::read_label_names(folder.join("labels.json")).unwrap().unwrap().number("bone") == Some(1)
        );
    }
}
