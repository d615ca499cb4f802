//! MetaImage: kinds of numbers, compression, files, and what places the voxels.

use super::*;

const HEADER: &str = "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\nCompressedData = False\n\
    TransformMatrix = 0 1 0 -1 0 0 0 0 1\nOffset = 10 -20 30\nCenterOfRotation = 0 0 0\nAnatomicalOrientation = RAI\n\
    ElementSpacing = 0.5 0.25 2\nDimSize = 3 2 2\nElementType = MET_SHORT\nElementDataFile = ";
/// A type's name, and its bytes of a number.
type Kind = (&'static str, fn(i16) -> Vec<u8>);

const NUMBERS: [i16; 12] = [-1000, 5, 300, -7, 40, 1200, 0, 1, 2, 3, -2000, 30000];

fn little() -> Vec<u8> {
    NUMBERS.iter().flat_map(|n| n.to_le_bytes()).collect()
}

fn read_files(header: &str, data: &[u8], others: &[(&str, Vec<u8>)]) -> Result<Image<f32>, String> {
    let dir = tempfile::tempdir().unwrap();
    for (name, bytes) in others {
        std::fs::write(dir.path().join(name), bytes).unwrap();
    }
    let path = dir.path().join("ct.mha");
    std::fs::write(&path, [format!("{header}\n").as_bytes(), data].concat()).unwrap();
    read_ct(&path, AUTO).map_err(|e| e.to_string())
}

fn local(header: &str, data: &[u8]) -> Result<Image<f32>, String> {
    read_files(&format!("{header}LOCAL"), data, &[])
}

fn assert_refused(found: Result<Image<f32>, String>, words: &[&str]) {
    let said = found.map(|image| image.volume.data().len()).unwrap_err();
    assert!(said.contains("ct.mha") && words.iter().all(|word| said.contains(word)), "{said}");
}

#[test]
fn rows_of_the_matrix_are_the_axes_directions_in_lps() {
    let image = local(HEADER, &little()).unwrap();
    assert_eq!(image.volume.data(), NUMBERS.map(f32::from));
    let grid = image.volume.grid();
    // LPS (10, -20, 30) is RAS (-10, 20, 30); axis 0 runs along +P = -A, axis 1 along -L = +R
    assert!((grid.center([0, 0, 0]).coords - Vector3::new(-10.0, 20.0, 30.0)).amax() < 1e-12);
    assert!((grid.center([2, 0, 0]).coords - Vector3::new(-10.0, 19.0, 30.0)).amax() < 1e-12);
    assert!((grid.center([0, 1, 1]).coords - Vector3::new(-9.75, 20.0, 32.0)).amax() < 1e-12);
    assert_eq!(image.provenance.placement, Placement::MetaImage);
    // other names of the same
    let other = HEADER.replace("TransformMatrix", "Orientation").replace("Offset", "Position");
    let other = local(&other.replace("ElementSpacing", "ElementSize"), &little()).unwrap();
    assert_same_grid(other.volume.grid(), grid);
}

#[test]
fn every_kind_of_number_and_every_way_to_store_it_is_read() {
    let kinds: [Kind; 10] = [
        ("MET_CHAR", |n| (n as i8).to_le_bytes().into()),
        ("MET_UCHAR", |n| (n as u8).to_le_bytes().into()),
        ("MET_SHORT", |n| n.to_le_bytes().into()),
        ("MET_USHORT", |n| (n as u16).to_le_bytes().into()),
        ("MET_INT", |n| i32::from(n).to_le_bytes().into()),
        ("MET_UINT", |n| (n as u32).to_le_bytes().into()),
        ("MET_LONG_LONG", |n| i64::from(n).to_le_bytes().into()),
        ("MET_ULONG_LONG", |n| (n as u64).to_le_bytes().into()),
        ("MET_FLOAT", |n| f32::from(n).to_le_bytes().into()),
        ("MET_DOUBLE", |n| f64::from(n).to_le_bytes().into()),
    ];
    for (name, bytes) in kinds {
        let header = HEADER.replace("MET_SHORT", name);
        let data: Vec<u8> = (0..12).flat_map(bytes).collect();
        let expected: Vec<f32> = (0..12u8).map(f32::from).collect();
        assert_eq!(local(&header, &data).unwrap().volume.data(), expected, "{name}");
        let size = data.len() / 12;
        let big: Vec<u8> = data.chunks(size).flat_map(|n| n.iter().rev().copied()).collect();
        let header = header.replace("MSB = False", "MSB = True");
        assert_eq!(local(&header, &big).unwrap().volume.data(), expected, "{name}");
    }
    let compressed =
        HEADER.replace("CompressedData = False", "CompressedData = True\nCompressedDataSize = 30");
    let mut zlib = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::default());
    zlib.write_all(&little()).unwrap();
    let text = NUMBERS.map(|n| n.to_string()).join(" ");
    for (header, data) in [
        (compressed, zlib.finish().unwrap()),
        (HEADER.replace("BinaryData = True", "BinaryData = False"), text.into_bytes()),
    ] {
        assert_eq!(local(&header, &data).unwrap().volume.data(), NUMBERS.map(f32::from));
    }
}

#[test]
fn data_in_other_files_are_found_beside_the_header() {
    let raw = little();
    let halves = |a: &'static str, b: &'static str| vec![(a, raw[..12].to_vec()), (b, raw[12..].to_vec())];
    let behind = HEADER.replace("NDims", "HeaderSize = -1\nNDims");
    for (header, others) in [
        (format!("{HEADER}ct.raw"), vec![("ct.raw", raw.clone())]),
        (format!("{behind}ct.raw"), vec![("ct.raw", [&[7; 5][..], &raw].concat())]),
        (behind.replace("-1", "5") + "ct.raw", vec![("ct.raw", [&[7; 5][..], &raw].concat())]),
        (format!("{HEADER}LIST\nb.raw\na.raw"), halves("b.raw", "a.raw")),
        (format!("{HEADER}s%03d.raw 1 2 1"), halves("s001.raw", "s002.raw")),
    ] {
        assert_eq!(
            read_files(&header, b"", &others).unwrap().volume.data(),
            NUMBERS.map(f32::from),
            "{header}"
        );
    }
    assert_refused(read_files(&format!("{HEADER}gone.raw"), b"", &[]), &["gone.raw"]);
}

#[test]
fn what_is_in_doubt_is_refused() {
    let without = |key: &str| {
        let kept: Vec<&str> = HEADER.split('\n').filter(|line| !line.starts_with(key)).collect();
        local(&kept.join("\n"), &little())
    };
    assert_refused(without("TransformMatrix"), &["`TransformMatrix`", "left and right"]);
    assert_refused(without("Offset"), &["`Offset`"]);
    assert_refused(without("ElementSpacing"), &["`ElementSpacing`"]);
    assert_refused(local(&HEADER.replace("10 -20 30", "nan 0 0"), &little()), &["`Offset`"]);
    assert_refused(local(&HEADER.replace("0 1 0 -1 0 0 0 0 1", "1 0 0 0 1 0 0 0.1 1"), &little()), &["grid"]);
    assert_refused(local(&HEADER.replace("MET_SHORT", "MET_LONG"), &little()), &["MET_LONG"]);
    assert_refused(local(&HEADER.replace("3 2 2", "3000 2000 2000"), &little()), &["expected 1 to"]);
    assert_refused(
        local(&HEADER.replace("3 2 2", "300 200 200"), &little()),
        &["24000000 bytes are announced"],
    );
    assert_refused(local(&HEADER.replace("NDims = 3", "NDims = 2"), &little()), &["`NDims`"]);
    let colour = HEADER.replace("NDims = 3", "NDims = 3\nElementNumberOfChannels = 3");
    assert_refused(local(&colour, &little()), &["ElementNumberOfChannels"]);
    assert_refused(local(&HEADER.replace("NDims", "Offset = 1 2 3\nNDims"), &little()), &["`Offset` twice"]);
}
