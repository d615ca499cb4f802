//! NIfTI-2 is read as NIfTI-1 is: the same image from the same fields, and the same refusals.

use super::*;

/// A NIfTI-1 file, little endian, as NIfTI-2 in one file.
fn as_nifti2(one: &[u8], big: bool) -> Vec<u8> {
    let mut two = vec![0u8; 544];
    let mut put = |at: usize, mut bytes: Vec<u8>| {
        if big {
            bytes.reverse();
        }
        two[at..at + bytes.len()].copy_from_slice(&bytes);
    };
    let short = |at: usize| i16::from_le_bytes([one[at], one[at + 1]]);
    let single = |at: usize| f32::from_le_bytes(one[at..at + 4].try_into().unwrap());
    put(0, 540i32.to_le_bytes().to_vec());
    put(12, short(70).to_le_bytes().to_vec());
    put(14, short(72).to_le_bytes().to_vec());
    (0..8).for_each(|n| put(16 + 8 * n, i64::from(short(40 + 2 * n)).to_le_bytes().to_vec()));
    put(168, (single(108) as i64 - 352 + 544).to_le_bytes().to_vec());
    // pixdim, slope and intercept, quaternion and its offset, rows
    for (to, from, count) in [(104, 76, 8), (176, 112, 2), (352, 256, 6), (400, 280, 12)] {
        for n in 0..count {
            put(to + 8 * n, f64::from(single(from + 4 * n)).to_le_bytes().to_vec());
        }
    }
    put(344, i32::from(short(252)).to_le_bytes().to_vec());
    put(348, i32::from(short(254)).to_le_bytes().to_vec());
    put(500, i32::from(one[123]).to_le_bytes().to_vec());
    two[4..12].copy_from_slice(b"n+2\0\r\n\x1a\n");
    let voxels = one[352..].chunks(2).flat_map(|v| if big { [v[1], v[0]] } else { [v[0], v[1]] });
    two.extend(voxels);
    two
}

fn second(big: bool, change: impl FnOnce(&mut Vec<u8>)) -> Changed {
    Changed::new(|bytes| {
        *bytes = as_nifti2(bytes, big);
        change(bytes);
    })
}

#[test]
fn nifti_2_is_the_same_image_in_both_byte_orders() {
    let one = Changed::new(|_| {}).read(AUTO).unwrap();
    for big in [false, true] {
        for zipped in [false, true] {
            for choice in [AffineChoice::Auto, AffineChoice::Sform, AffineChoice::Qform] {
                let file = second(big, |b| {
                    if zipped {
                        *b = gzip(b);
                    }
                });
                let two = file.read(choice).unwrap();
                assert_eq!(two.volume.data(), one.volume.data());
                assert_grids_within(two.volume.grid(), one.volume.grid(), 1e-4);
                assert_eq!((affine(&two).sform_code, affine(&two).qform_code), (1, 1));
                assert_eq!(two.warnings, []);
            }
        }
    }
}

#[test]
fn doubles_of_nifti_2_are_not_rounded_to_singles() {
    let x_mm = -90.123_456_789_012;
    let put_f64 = |b: &mut [u8], at: usize| put(b, at, &f64::to_le_bytes(x_mm));
    let file = second(false, |b| {
        put_f64(b, 376);
        put_f64(b, 424);
    });
    assert_eq!(file.read(AUTO).unwrap().volume.grid().origin().x(), x_mm);
    assert!((file.read(AffineChoice::Qform).unwrap().volume.grid().origin().x() - x_mm).abs() < 1e-12);
}

#[test]
fn a_pair_of_nifti_2_files_is_one_image() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("ct.hdr");
    let file = second(true, |b| {
        put(b, 4, b"ni2\0\r\n\x1a\n");
        put(b, 168, &[0; 8]);
        std::fs::write(dir.path().join("ct.img"), &b[544..]).unwrap();
        std::fs::write(&path, &b[..540]).unwrap();
    });
    let image = read_ct(&path, AUTO).unwrap();
    assert_eq!(image.volume.data(), Changed::new(|_| {}).read(AUTO).unwrap().volume.data());
    assert_eq!(image.provenance.files, [path, dir.path().join("ct.img")]);
    assert!(matches!(file.problem(), NiftiProblem::Pair { .. }));
}

#[test]
fn nifti_2_is_refused_for_what_nifti_1_is() {
    use NiftiProblem as P;
    let problem = |change: fn(&mut Vec<u8>)| second(false, change).problem();
    let said = problem(|b| put(b, 8, b"\n\x1a\n\n"));
    assert!(matches!(said, P::Magic { .. }), "{said}");
    assert!(said.to_string().contains(r#"expected "n+2\0\r\n\u{1a}\n""#), "{said}");
    assert!(matches!(problem(|b| b.truncate(539)), P::NoHeader { found_bytes: 539, expected_bytes: 540 }));
    assert!(matches!(problem(|b| put(b, 168, &540i64.to_le_bytes())), P::VoxOffset { least: 544, .. }));
    assert!(matches!(problem(|b| put(b, 168, &i64::MIN.to_le_bytes())), P::VoxOffset { .. }));
    for at in [24, 32, 40] {
        for bad in [0, -1, i64::MIN] {
            let file = second(false, |b| put(b, at, &bad.to_le_bytes()));
            assert!(matches!(file.problem(), P::Dims { .. }), "{at} {bad}");
        }
        for huge in [1 << 31, i64::MAX] {
            let file = second(false, |b| put(b, at, &huge.to_le_bytes()));
            assert!(matches!(file.problem(), P::TooLarge { .. }), "{at} {huge}");
        }
    }
    assert!(matches!(problem(|b| put(b, 16, &9i64.to_le_bytes())), P::Dims { .. }));
    // a fourth and a fifth dimension whose product is past 64 bits
    let four = problem(|b| {
        put(b, 16, &5i64.to_le_bytes());
        put(b, 48, &i64::MAX.to_le_bytes());
        put(b, 56, &i64::MAX.to_le_bytes());
    });
    assert!(matches!(four, P::Volumes { volumes: u64::MAX, .. }), "{four}");
    assert!(matches!(problem(|b| put(b, 400, &f64::NAN.to_le_bytes())), P::AffineNotFinite { .. }));
    assert!(matches!(problem(|b| put(b, 176, &f64::INFINITY.to_le_bytes())), P::Scaling { .. }));
    assert!(matches!(problem(|b| put(b, 14, &8i16.to_le_bytes())), P::Bits { .. }));
    assert!(matches!(problem(|b| put(b, 500, &5i32.to_le_bytes())), P::Units { code: 5 }));
    assert!(matches!(problem(|b| put(b, 344, &[0; 8])), P::NoTransform));
    assert!(matches!(problem(|b| put(b, 424, &(-89.96f64).to_le_bytes())), P::Disagreement { .. }));
    assert!(matches!(problem(|b| b.truncate(560)), P::FileTooSmall { .. }));
    assert!(matches!(problem(|b| b.extend([0; 5000])), P::Surplus { .. }));
}

proptest! {
    #[test]
    fn no_bytes_make_the_reader_of_nifti_2_panic(
        places in prop::collection::vec((0usize..600, any::<u8>()), 1..12), big: bool, cut in 0.3f64..1.2,
    ) {
        let file = second(big, |bytes| {
            places.iter().for_each(|(at, b)| bytes[*at] = *b);
            bytes.truncate((cut * bytes.len() as f64) as usize);
        });
        let _ = file.read(AUTO);
        let _ = read_labels(&file.path, AffineChoice::Qform);
    }
}
