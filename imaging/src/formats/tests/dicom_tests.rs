//! DICOM series: order, gaps, tilt, several series, many frames, scaling, kinds of pixels, and what stays in the header.

use super::dicom_file::*;
use super::*;

const GREY: [i16; 6] = [-1000, -3, 0, 40, 300, 1200];

/// Slices at 0, 2, 4 mm, with other values in each.
fn plain() -> Vec<Dataset> {
    (0..3).map(|n| slice(2.0 * f64::from(n), GREY.map(|v| v + n as i16))).collect()
}

fn expected() -> Vec<f32> {
    (0..3).flat_map(|n| GREY.map(|v| f32::from(v + n))).collect()
}

fn folder(files: &[(String, Vec<u8>)]) -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    for (name, bytes) in files {
        std::fs::write(dir.path().join(name), bytes).unwrap();
    }
    dir
}

fn read_files(slices: &[Dataset]) -> Result<Image<f32>, String> {
    let named = slices.iter().enumerate().map(|(n, s)| (format!("IM{n}"), bytes(s, LITTLE)));
    let dir = folder(&named.collect::<Vec<_>>());
    read_ct(dir.path(), AUTO).map_err(|e| e.to_string())
}

fn assert_refused(found: Result<Image<f32>, String>, words: &[&str]) {
    let said = found.map(|image| image.volume.data().len()).unwrap_err();
    assert!(words.iter().all(|word| said.contains(word)), "{said}");
    assert!(!said.contains("Doe") && !said.contains("PATIENT"), "{said}");
}

#[test]
fn slices_are_sorted_by_position_and_by_nothing_else() {
    let mut slices = plain();
    slices.rotate_left(1);
    // numbers and locations that say the opposite
    for (n, s) in slices.iter_mut().enumerate() {
        s.push(((0x20, 0x13), text("IS", (9 - n).to_string())));
        s.push(((0x20, 0x1041), text("DS", format!("{}", -(n as f64)))));
    }
    let image = read_files(&slices).unwrap();
    assert_eq!(image.volume.data(), expected());
    let grid = image.volume.grid();
    assert!((grid.center([0, 0, 0]).coords - Vector3::new(-10.0, 20.0, 0.0)).amax() < 1e-12);
    assert!((grid.center([2, 1, 2]).coords - Vector3::new(-11.0, 19.75, 4.0)).amax() < 1e-12);
    assert_eq!((image.provenance.placement, image.provenance.files.len()), (Placement::Dicom, 3));
    assert_eq!(image.warnings, []);
    // feet first: the normal points down, and the grid is the same body
    let down = |s: Dataset| with(s, vec![((0x20, 0x37), numbers(&[1.0, 0.0, 0.0, 0.0, -1.0, 0.0]))]);
    let image = read_files(&plain().into_iter().map(down).collect::<Vec<_>>()).unwrap();
    assert!((image.volume.grid().center([0, 1, 0]).coords - Vector3::new(-10.0, 20.25, 4.0)).amax() < 1e-12);
    assert_eq!(image.volume.data()[0], -998.0);
}

#[test]
fn slices_that_are_doubled_missing_or_uneven_are_named_with_their_positions() {
    let at = |places: &[f64]| read_files(&places.iter().map(|z| slice(*z, GREY)).collect::<Vec<_>>());
    assert_refused(at(&[0.0, 2.0, 2.0, 4.0]), &["IM1 and IM2", "same position, 2.000 mm"]);
    assert_refused(
        at(&[0.0, 2.0, 4.0, 10.0, 12.0]),
        &["IM2 at 4.000", "IM3 at 10.000", "2 slices are missing"],
    );
    assert_refused(
        at(&[0.0, 2.0, 4.0, 7.1, 9.1]),
        &["IM2 at 4.000", "IM3 at 7.100", "3.100 mm apart", "uneven"],
    );
    assert_refused(at(&[0.0]), &["IM0", "is a single slice"]);
    // rounding of positions is no gap
    assert!(at(&[0.0, 2.001, 3.999, 6.0]).is_ok());
    let aside = with(slice(2.0, GREY), vec![((0x20, 0x32), numbers(&[10.2, -20.0, 2.0]))]);
    assert_refused(read_files(&[slice(0.0, GREY), aside, slice(4.0, GREY)]), &["IM1", "beside the line"]);
}

#[test]
fn a_tilted_gantry_is_refused_with_its_angle() {
    let tilted = |n: i16| {
        let z = 2.0 * f64::from(n);
        with(slice(z, GREY), vec![((0x20, 0x32), numbers(&[10.0, -20.0 + z * 15f64.to_radians().tan(), z]))])
    };
    assert_refused(read_files(&[tilted(0), tilted(1), tilted(2)]), &["15.00° off their normal", "gantry"]);
}

#[test]
fn of_several_series_the_case_chooses_one() {
    let other = |s: Dataset| with(s, vec![((0x20, 0x0e), text("UI", "1.2.3.10"))]);
    let mut files = plain();
    files.extend([slice(0.0, GREY), slice(1.0, [7; 6])].map(other));
    let localizer = other(slice(9.0, GREY));
    files.push(with(localizer, vec![((8, 8), text("CS", "ORIGINAL\\PRIMARY\\LOCALIZER"))]));
    assert_refused(
        read_files(&files),
        &["images.ct_series", "902425018327 (CT, 3 slices of 3×2)", "63512c0d8c3f (CT, 2 slices of 3×2)"],
    );
    let named = files.iter().enumerate().map(|(n, s)| (format!("IM{n}"), bytes(s, LITTLE)));
    let dir = folder(&named.collect::<Vec<_>>());
    for chosen in ["1.2.3.10", "63512c0d8c3f"] {
        let image = read_ct_series(dir.path(), AUTO, Some(chosen)).unwrap();
        assert_eq!(image.volume.data()[6..], [7.0; 6]);
        assert_eq!(image.warnings, [ReadWarning::Localizers { count: 1 }]);
    }
    let said = read_ct_series(dir.path(), AUTO, Some("1.2")).unwrap_err().to_string();
    let name = series_name("1.2");
    assert!(
        said.contains(&format!("no series {name} (images.ct_series)")) && said.contains("63512c0d8c3f"),
        "{said}"
    );
    // a UID is in no list and no refusal
    let several = read_ct(dir.path(), AUTO).unwrap_err().to_string();
    assert!(!said.contains("1.2.3") && !several.contains("1.2.3"), "{said} {several}");
}

#[test]
fn a_screenshot_in_another_series_does_no_harm() {
    let mut files = plain();
    let mut screenshot = with(slice(0.0, GREY), vec![((0x20, 0x0e), text("UI", "1.2.3.11"))]);
    screenshot.push(((0x28, 4), text("CS", "RGB")));
    screenshot.push(((0x28, 2), Value::Short(3)));
    files.push(screenshot);
    assert_eq!(read_files(&files).unwrap().volume.data(), expected());
    // a slice of the series that cannot be used is not left out
    files.push(with(slice(6.0, GREY), vec![((0x28, 2), Value::Short(3))]));
    assert_refused(read_files(&files), &["IM4", "SamplesPerPixel is 3"]);
}

#[test]
fn slices_that_differ_are_no_series() {
    let second = |tag, value| read_files(&[slice(0.0, GREY), with(slice(2.0, GREY), vec![(tag, value)])]);
    assert_refused(second((0x28, 0x11), Value::Short(2)), &["IM1", "Rows or Columns"]);
    assert_refused(second((0x28, 0x30), numbers(&[0.25, 0.51])), &["IM1", "PixelSpacing"]);
    assert_refused(
        second((0x20, 0x37), numbers(&[0.0, 1.0, 0.0, -1.0, 0.0, 0.0])),
        &["IM1", "ImageOrientationPatient"],
    );
    assert_refused(second((0x20, 0x37), numbers(&[1.0, 0.0, 0.0, 1.0, 0.0, 0.0])), &["perpendicular"]);
    assert_refused(second((0x20, 0x32), text("DS", "1\\2\\nan")), &["ImagePositionPatient"]);
    assert_refused(second((0x28, 4), text("CS", "RGB")), &["PhotometricInterpretation is RGB"]);
    assert_refused(second((0x28, 0x101), Value::Short(17)), &["BitsStored is 17"]);
    let bits = vec![
        ((0x28, 0x100), Value::Short(1)),
        ((0x28, 0x101), Value::Short(1)),
        ((0x28, 0x102), Value::Short(0)),
    ];
    assert_refused(
        read_files(&[slice(0.0, GREY), with(slice(2.0, GREY), bits)]),
        &["IM1", "BitsAllocated is 1"],
    );
    assert_refused(second((0x7fe0, 0x10), Value::Words(vec![1; 5])), &["IM1, frame 1", "fewer"]);
}

#[test]
fn every_slice_has_its_own_rescale() {
    let scaled = |n: i16| {
        let rescale =
            vec![((0x28, 0x1052), numbers(&[-1024.0 + f64::from(n)])), ((0x28, 0x1053), numbers(&[0.5]))];
        with(slice(2.0 * f64::from(n), [2048; 6]), rescale)
    };
    let image = read_files(&[scaled(0), scaled(1)]).unwrap();
    assert_eq!((image.volume.data()[0], image.volume.data()[6]), (0.0, 1.0));
    let mut bare = plain();
    bare.iter_mut().for_each(|s| s.retain(|(tag, _)| !matches!(tag, (0x28, 0x1052 | 0x1053))));
    let image = read_files(&bare).unwrap();
    assert_eq!(
        (image.volume.data(), &image.warnings[..]),
        (&expected()[..], &[ReadWarning::RescaleAbsent][..])
    );
}

#[test]
fn the_padding_value_becomes_air() {
    let padded = |z: f64| {
        let pixels = [-2000, 0, 1, 2, 3, -2000];
        with(slice(z, pixels), vec![((0x28, 0x120), Value::Signed(-2000))])
    };
    let image = read_files(&[padded(0.0), padded(1.0)]).unwrap();
    assert_eq!(image.volume.data()[..6], [-1000.0, 0.0, 1.0, 2.0, 3.0, -1000.0]);
    assert_eq!(image.warnings, [ReadWarning::PixelPadding { voxels: 4 }]);
    // an unsigned element for a signed value, and a range
    let range = vec![((0x28, 0x120), Value::Short(63536)), ((0x28, 0x121), Value::Short(63537))];
    let ranged = |z: f64| with(slice(z, [-2000, -1999, -1998, 0, 0, 0]), range.clone());
    let image = read_files(&[ranged(0.0), ranged(1.0)]).unwrap();
    assert_eq!(image.volume.data()[..3], [-1000.0, -1000.0, -1998.0]);
}

#[test]
fn numbers_of_12_to_16_bits_are_read_in_both_byte_orders() {
    // stored bits, high bit, signed, stored word, number
    for (stored, high, signed, word, number) in [
        (12, 11, 0, 0xffff, 4095.0),
        (12, 11, 1, 0x0fff, -1.0),
        (12, 11, 1, 0xf7ff, 2047.0),
        (12, 15, 1, 0x8000, -2048.0),
        (13, 12, 1, 0x1000, -4096.0),
        (16, 15, 0, 0xffff, 65535.0),
        (16, 15, 1, 0x8000, -32768.0),
    ] {
        let kind = vec![
            ((0x28, 0x101), Value::Short(stored)),
            ((0x28, 0x102), Value::Short(high)),
            ((0x28, 0x103), Value::Short(signed)),
            ((0x7fe0, 0x10), Value::Words(vec![word, 0, 0, 0, 0, 0])),
        ];
        for syntax in [LITTLE, BIG] {
            let file = |n: u8| {
                let dataset = with(slice(f64::from(n), [0; 6]), kind.clone());
                (format!("{n}"), bytes(&dataset, syntax))
            };
            let dir = folder(&[file(0), file(1)]);
            let image = read_ct(dir.path(), AUTO).unwrap();
            assert_eq!(image.volume.data()[0], number, "{stored} {high} {signed} {syntax}");
        }
    }
}

/// Pixels are read straight from the file: the walk that finds them must not take an icon's.
#[test]
fn pixels_are_those_of_the_image_and_not_of_its_icon() {
    let icon: Dataset = vec![
        ((0x28, 0x10), Value::Short(2)),
        ((0x28, 0x11), Value::Short(3)),
        ((0x7fe0, 0x10), Value::Words(vec![777; 6])),
    ];
    for items in [Value::Items(vec![icon.clone()]), Value::OpenItems(vec![icon.clone(), icon.clone()])] {
        for syntax in [LITTLE, BIG] {
            // before the pixels by its tag, and after them in a private group
            for tag in [(0x0088, 0x0200), (0x7fe1, 0x1010)] {
                let named = plain()
                    .into_iter()
                    .enumerate()
                    .map(|(n, s)| (format!("IM{n}"), bytes(&with(s, vec![(tag, items.clone())]), syntax)));
                let dir = folder(&named.collect::<Vec<_>>());
                let image = read_ct(dir.path(), AUTO).unwrap();
                assert_eq!(image.volume.data(), expected(), "{tag:?} {syntax}");
            }
        }
    }
}

/// Scaling by whole numbers is exact in single precision; by others it is rounded once.
#[test]
fn grey_values_are_those_of_double_precision() {
    for (slope, intercept) in
        [(1.0, -1024.0), (1.0, 0.5), (0.3, -1000.1), (-2.0, 8_388_607.0), (1.0, 8_388_609.0)]
    {
        let rescale = vec![((0x28, 0x1052), numbers(&[intercept])), ((0x28, 0x1053), numbers(&[slope]))];
        let image = read_files(&plain().into_iter().map(|s| with(s, rescale.clone())).collect::<Vec<_>>());
        let scaled: Vec<f32> =
            expected().iter().map(|n| (slope * f64::from(*n) + intercept) as f32).collect();
        assert_eq!(image.unwrap().volume.data(), scaled, "{slope} {intercept}");
    }
}

/// One file with three frames in any order, places and scaling in functional groups.
fn enhanced(order: [u8; 3]) -> Dataset {
    let plane = |n: u8| numbers(&[10.0, -20.0, 2.0 * f64::from(n)]);
    let of_frame = |n: u8| -> Dataset {
        let scaling = vec![((0x28, 0x1052), numbers(&[f64::from(n)])), ((0x28, 0x1053), numbers(&[1.0]))];
        vec![
            ((0x20, 0x9113), Value::Items(vec![vec![((0x20, 0x32), plane(n))]])),
            ((0x28, 0x9145), Value::Items(vec![scaling])),
        ]
    };
    let shared: Dataset = vec![
        ((0x20, 0x9116), Value::Items(vec![vec![((0x20, 0x37), numbers(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0]))]])),
        ((0x28, 0x9110), Value::Items(vec![vec![((0x28, 0x30), numbers(&[0.25, 0.5]))]])),
    ];
    let pixels = order.iter().flat_map(|_| GREY.map(|v| v as u16)).collect();
    let mut dataset = slice(0.0, GREY);
    dataset.retain(|(tag, _)| {
        !matches!(tag, (0x20, 0x32 | 0x37) | (0x28, 0x30 | 0x1052 | 0x1053) | (0x7fe0, _))
    });
    with(
        dataset,
        vec![
            ((8, 0x16), text("UI", ENHANCED)),
            ((0x28, 8), text("IS", "3")),
            ((0x5200, 0x9229), Value::Items(vec![shared])),
            ((0x5200, 0x9230), Value::Items(order.iter().map(|n| of_frame(*n)).collect())),
            ((0x7fe0, 0x10), Value::Words(pixels)),
        ],
    )
}

#[test]
fn frames_of_one_file_are_sorted_by_their_positions() {
    let dir = folder(&[("ct.dcm".into(), bytes(&enhanced([2, 0, 1]), LITTLE))]);
    // as a file and as a folder
    for path in [dir.path().join("ct.dcm"), dir.path().to_owned()] {
        let image = read_ct(&path, AUTO).unwrap();
        assert_eq!(image.volume.data(), expected());
        assert!(
            (image.volume.grid().center([2, 1, 2]).coords - Vector3::new(-11.0, 19.75, 4.0)).amax() < 1e-12
        );
    }
    let doubled = folder(&[("ct.dcm".into(), bytes(&enhanced([2, 0, 2]), LITTLE))]);
    assert!(read_ct(doubled.path(), AUTO).unwrap_err().to_string().contains("same position"));
}

#[test]
fn nothing_of_the_patient_leaves_the_header() {
    let image = read_files(&plain()).unwrap();
    let said = format!("{:?} {:?} {}", image.warnings, image.provenance, image.provenance.placement);
    for secret in ["Doe", "Jane", "PATIENT-7", "1.2.3.9"] {
        assert!(!said.contains(secret), "{said}");
    }
}

#[test]
fn lengths_that_a_file_cannot_hold_are_refused_before_memory_is_taken() {
    let mut file = bytes(&plain()[0], LITTLE);
    // the pixels' length
    let at = file.len() - 12 - 4;
    file[at..at + 4].copy_from_slice(&0xffff_fff0u32.to_le_bytes());
    let dir = folder(&[("a".into(), file)]);
    let said = read_ct(dir.path(), AUTO).unwrap_err().to_string();
    assert!(said.contains("(7FE0,0010)") && said.contains("announces 4294967280 bytes"), "{said}");
    // in a sequence
    let inner = with(
        plain()[0].clone(),
        vec![((8, 0x1140), Value::Items(vec![vec![((8, 0x1150), Value::Bytes(vec![1; 4]))]]))],
    );
    let mut file = bytes(&inner, LITTLE);
    let at = file.windows(4).position(|w| w == [8, 0, 0x50, 0x11]).unwrap() + 8;
    file[at..at + 4].copy_from_slice(&0x7fff_fff0u32.to_le_bytes());
    let dir = folder(&[("a".into(), file)]);
    let said = read_ct(dir.path(), AUTO).unwrap_err().to_string();
    assert!(said.contains("(0008,1150)"), "{said}");
    // of a type that does not exist, which has four bytes of length: the first of its text are taken for one
    let mut file = bytes(&plain()[0], LITTLE);
    let at = file.windows(6).position(|w| w == *b"\x02\0\x10\0UI").unwrap() + 5;
    file[at] = b'E';
    let dir = folder(&[("a".into(), file)]);
    let said = read_ct(dir.path(), AUTO).unwrap_err().to_string();
    assert!(said.contains("(0002,0010)") && said.contains("announces 775040561 bytes"), "{said}");
    // elements of the meta information behind its end, which are read as any other
    let mut file = bytes(&plain()[0], "1.2.840.10008.1.2");
    file[140..144].copy_from_slice(&60u32.to_le_bytes());
    let dir = folder(&[("a".into(), file)]);
    assert!(read_ct(dir.path(), AUTO).unwrap_err().to_string().contains("announces"), "cut meta information");
    // an item in an item, which some take for an element: what follows would be read from other bytes
    let item =
        |inner: &[u8]| [&[0xfe, 0xff, 0x00, 0xe0][..], &(inner.len() as u32).to_le_bytes(), inner].concat();
    let twice = item(&item(b"\x20\0\x32\0DS\x06\x001\\2\\4 "));
    let (mut file, tail) = (bytes(&vec![], LITTLE), bytes(&plain()[0], LITTLE));
    let meta = file.len();
    file.extend(b"\x08\0\x05\0SQ\0\0");
    file.extend((twice.len() as u32).to_le_bytes());
    file.extend(twice);
    file.extend(&tail[meta..]);
    let dir = folder(&[("a".into(), file)]);
    let said = read_ct(dir.path(), AUTO).unwrap_err().to_string();
    assert!(said.contains("a sequence is broken before byte"), "{said}");
    // half a number, of which some leave a byte for what follows
    let mut file = bytes(&plain()[0], LITTLE);
    let at = file.windows(6).position(|w| w == *b"\x28\0\0\x01US").unwrap() + 6;
    file[at] = 3;
    let dir = folder(&[("a".into(), file)]);
    let said = read_ct(dir.path(), AUTO).unwrap_err().to_string();
    assert!(said.contains("(0028,0100) has 3 bytes, no whole number of values"), "{said}");
    // large sizes with few bytes
    let size = vec![((0x28, 0x10), Value::Short(65535)), ((0x28, 0x11), Value::Short(65535))];
    let large = with(plain()[0].clone(), size);
    let dir = folder(&[
        ("a".into(), bytes(&large, LITTLE)),
        ("b".into(), bytes(&with(large, vec![((0x20, 0x32), numbers(&[10.0, -20.0, 9.0]))]), LITTLE)),
    ]);
    let said = read_ct(dir.path(), AUTO).unwrap_err().to_string();
    assert!(said.contains("sizes [65535, 65535, 2]"), "{said}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn no_bytes_make_the_reader_panic(
        places in prop::collection::vec((132usize..900, any::<u8>()), 1..8), cut in 0.3f64..1.2, many: bool,
    ) {
        let mut file = bytes(&if many { enhanced([0, 1, 2]) } else { plain()[0].clone() }, LITTLE);
        places.iter().for_each(|(at, b)| if let Some(byte) = file.get_mut(*at) { *byte = *b });
        file.truncate((cut * file.len() as f64) as usize);
        let dir = folder(&[("a".into(), file), ("b".into(), bytes(&plain()[1], LITTLE))]);
        let _ = read_ct(dir.path(), AUTO).map_err(|e| e.to_string());
        let _ = read_label_map(dir.path(), AUTO).map_err(|e| e.to_string());
    }
}
