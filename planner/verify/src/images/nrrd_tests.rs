//! NRRD by both readers, the planner's and this crate's.

use std::io::Write;
use std::path::Path;

use bonemill_imaging::{read_ct, read_label_map};

use super::*;

const AUTO: AffineChoice = AffineChoice::Auto;
const HEADER: &str = "NRRD0005\ntype: short\ndimension: 3\nspace: left-posterior-superior\nsizes: 3 2 2\n\
    space directions: (0.4,0.3,0) (-0.3,0.4,0) (0,0,2)\nkinds: domain domain domain\nendian: little\nencoding: raw\n\
    space origin: (10,-20,30)\nmeasurement frame: (0,1,0) (1,0,0) (0,0,1)\n";
const NUMBERS: [i16; 12] = [-1000, 5, 300, -7, 40, 1200, 0, 1, 2, 3, -900, 30000];

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// Whether both read the same, or both refuse; where only this crate's reader refuses, `None`.
fn agree(path: &Path) -> Option<bool> {
    match (ct(path, AUTO, None).map(|(ct, _)| ct), read_ct(path, AUTO)) {
        (Ok(ours), Ok(theirs)) => {
            let theirs = theirs.volume;
            let corners = ours.grid().corners().into_iter().zip(theirs.grid().corners());
            assert!(corners.map(|(p, q)| p.distance_mm(&q)).fold(0.0, f64::max) < 1e-9);
            assert_eq!((ours.grid().dims(), ours.data()), (theirs.grid().dims(), theirs.data()));
            Some(true)
        }
        (Err(_), Err(_)) => Some(false),
        (Err(_), Ok(_)) => None,
        (Ok(_), Err(theirs)) => panic!("only we accept: {theirs}"),
    }
}

fn verdict(header: &str, data: &[u8]) -> Option<bool> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("ct.nrrd");
    std::fs::write(dir.path().join("ct.raw"), data).unwrap();
    let attached = if header.contains("data file") { &[][..] } else { data };
    std::fs::write(&path, [header.as_bytes(), b"\n", attached].concat()).unwrap();
    agree(&path)
}

#[test]
fn both_readers_see_the_same_image_or_refuse_it() {
    let little: Vec<u8> = NUMBERS.iter().flat_map(|n| n.to_le_bytes()).collect();
    let big: Vec<u8> = NUMBERS.iter().flat_map(|n| n.to_be_bytes()).collect();
    let with = |from: &str, to: &str| HEADER.replace(from, to);
    for (header, data) in [
        (HEADER.to_owned(), little.clone()),
        (with("left-posterior-superior", "RAS"), little.clone()),
        (with("left-posterior-superior", "left-anterior-superior"), little.clone()),
        (with("endian: little", "endian: big"), big),
        (with("encoding: raw", "encoding: gzip"), gzip(&little)),
        (HEADER.to_owned() + "data file: ct.raw\n", little.clone()),
        (HEADER.to_owned() + "data file: LIST\nct.raw\n", little.clone()),
        (with("sizes: ", "sizes: 1 ").replace("directions: ", "directions: none "), little.clone()),
        (HEADER.to_owned(), [&little[..], &[0; 9]].concat()),
    ] {
        assert_eq!(verdict(&header, &data), Some(true), "{header}");
    }
    for header in [
        with("space: left-posterior-superior\n", ""),
        with("(10,-20,30)", "(nan,0,0)"),
        with("(0,0,2)", "(0,0.1,2)"),
        with("(0,0,2)", "none"),
        with("sizes: 3 2 2", "sizes: 3 2 3"),
        with("sizes: 3 2 2", "sizes: 99999999 99999999 99999999"),
        with("endian: little\n", ""),
        with("type: short", "type: block"),
        HEADER.to_owned() + "space: RAS\n",
    ] {
        assert_eq!(verdict(&header, &little), Some(false), "{header}");
    }
}

#[test]
fn what_only_the_planners_reader_reads_is_read_by_it_and_told() {
    let little: Vec<u8> = NUMBERS.iter().flat_map(|n| n.to_le_bytes()).collect();
    let text = NUMBERS.map(|n| n.to_string()).join(" ").into_bytes();
    let more = |line: &str| HEADER.to_owned() + line;
    let after = |before: &[u8]| [before, &little[..]].concat();
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("ct.nrrd");
    std::fs::write(dir.path().join("ct7.raw"), &little).unwrap();
    for (header, data, said) in [
        (HEADER.replace("encoding: raw", "encoding: ascii"), text, "numbers as text"),
        (more("byte skip: -1\n"), after(b"any bytes"), "to skip"),
        (more("byteskip: 3\n"), after(b"abc"), "to skip"),
        (more("line skip: 2\n"), after(b"a line\nanother\n"), "to skip"),
        (more("data file: ct%d.raw 7 7 1\n"), vec![], "a pattern of data files"),
    ] {
        let file = [header.as_bytes(), b"\n", &data].concat();
        for bytes in [file.clone(), gzip(&file)] {
            if header.contains("-1") && bytes != file {
                continue; // a compressed file is not counted from its end
            }
            std::fs::write(&path, bytes).unwrap();
            assert_eq!(agree(&path), Some(true), "{header}");
            let (ct, reader) = ct(&path, AUTO, None).unwrap();
            assert_eq!(ct.data(), NUMBERS.map(f32::from));
            let reader = reader.unwrap().to_string();
            assert!(reader.contains("images.ct is an NRRD") && reader.contains(said), "{reader}");
        }
    }
    // what neither reads is refused, as before, by this crate's reader
    let file = [HEADER.replace("encoding: raw", "encoding: hex").as_bytes(), b"\n", &little].concat();
    std::fs::write(&path, file).unwrap();
    assert!(ct(&path, AUTO, None).unwrap_err().to_string().contains("`encoding` in its header"));
}

/// Before layers held several segments, each had a layer of its own, and neither key.
#[test]
fn segments_without_layer_and_value_are_the_same_by_both_readers() {
    let uchar = HEADER.replace("type: short", "type: uchar");
    let layered =
        uchar.replace("sizes: 3 2 2", "sizes: 2 3 1 1").replace("directions: ", "directions: none ");
    let keys = "Segment0_ID:=a\nSegment0_Name:=Facial nerve\nSegment1_ID:=b\n";
    let single = uchar.replace("sizes: 3 2 2", "sizes: 3 1 1");
    let dir = tempfile::tempdir().unwrap();
    for (header, keys, data, names) in [
        (&layered, keys, &[1, 0, 0, 1, 1, 1][..], 2),
        (&single, "Segment0_ID:=a\n", &[0, 1, 1][..], 1),
        // a value without a layer
        (
            &layered,
            "Segment0_ID:=a\nSegment0_LabelValue:=3\nSegment1_ID:=b\nSegment1_LabelValue:=4\n",
            &[3, 0, 0, 4, 3, 4][..],
            2,
        ),
    ] {
        let path = dir.path().join("a.seg.nrrd");
        std::fs::write(&path, [header.as_bytes(), keys.as_bytes(), b"\n", data].concat()).unwrap();
        let (ours, theirs) = (labels(&path, AUTO).unwrap(), read_label_map(&path, AUTO).unwrap());
        assert!(ours.1.is_none(), "by a reader of its own");
        let ours = ours.0;
        assert_eq!(ours.shown.data(), theirs.image.volume.data());
        let further: Vec<(u32, u16)> =
            ours.further.iter().map(|(place, label)| (*place as u32, *label)).collect();
        assert_eq!((further, ours.names.len()), (theirs.further, names));
    }
}

#[test]
fn segments_that_share_voxels_are_the_same_by_both_readers() {
    let header = HEADER
        .replace("type: short", "type: uchar")
        .replace("sizes: 3 2 2", "sizes: 2 3 1 1")
        .replace("directions: ", "directions: none ");
    let keys = "Segment0_ID:=a\nSegment0_Name:=Facial nerve\nSegment0_LabelValue:=1\nSegment0_Layer:=0\n\
        Segment1_ID:=b\nSegment1_Name:=Dura\nSegment1_LabelValue:=1\nSegment1_Layer:=1\n";
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.seg.nrrd");
    std::fs::write(&path, [header.as_bytes(), keys.as_bytes(), b"\n", &[1, 0, 1, 1, 0, 1]].concat()).unwrap();
    let rank = |label: u16| u8::from(label == 2);
    let (mut ours, mut theirs) = (labels(&path, AUTO).unwrap().0, read_label_map(&path, AUTO).unwrap());
    ours.show_by(rank);
    theirs.settle(rank);
    assert_eq!((ours.shown.data(), ours.shown.data()), (&[1, 2, 2][..], theirs.image.volume.data()));
    assert_eq!(ours.own_maps([1, 2].into_iter())[0].1.data(), [1, 1, 2]);
    let names: Vec<_> = theirs.names.iter().flat_map(|names| names.iter()).collect();
    assert_eq!(ours.names.iter().map(|(n, name)| (*n, name.as_str())).collect::<Vec<_>>(), names);
}

#[test]
fn a_format_without_a_reader_of_its_own_is_told() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.mha");
    let header = "ObjectType = Image\nNDims = 3\nDimSize = 3 1 1\nElementSpacing = 1 2 3\nOffset = 1 2 3\n\
        TransformMatrix = 1 0 0 0 1 0 0 0 1\nElementType = MET_SHORT\nElementDataFile = LOCAL\n";
    let voxels: Vec<u8> = [7i16, 0, 300].iter().flat_map(|v| v.to_le_bytes()).collect();
    std::fs::write(&path, [header.as_bytes(), &voxels].concat()).unwrap();
    let (ct, reader) = ct(&path, AUTO, None).unwrap();
    assert_eq!((ct.grid().dims(), ct.data()), ([3, 1, 1], &[7.0, 0.0, 300.0][..]));
    let said = reader.unwrap().to_string();
    // Python: hashlib.sha256(struct.pack("<3I12q3f", 3, 1, 1, -10000, 0, 0, -10000, 0, -20000, 0, -20000, 0, 0, 30000, 30000, 7, 0, 300))
    let digest = "143f81f6846bbd8125636f41e20b81bec93af390dc8729784bb1369ed022865b";
    assert!(said.contains("images.ct is a MetaImage file") && said.ends_with(digest), "{said}");
    let (labels, reader) = labels(&path, AUTO).unwrap();
    assert_eq!((labels.shown.data(), reader.unwrap().key), (&[7, 0, 300][..], "images.labels"));
    // a pair and a DICOM file go to the planner's reader, too, which refuses these
    for (name, bytes, word) in [
        ("a.dcm", [&[0; 128][..], b"DICM\x02\0\0\0UL\x04\0"].concat(), "a.dcm"),
        ("a.hdr", [&[92, 1, 0, 0][..], &[0; 340], b"ni1\0"].concat(), "a."),
    ] {
        std::fs::write(dir.path().join(name), bytes).unwrap();
        let error = super::ct(&dir.path().join(name), AUTO, None).unwrap_err();
        assert!(matches!(&error, VerifyError::Imaging(_)) && error.to_string().contains(word), "{error:?}");
    }
}
