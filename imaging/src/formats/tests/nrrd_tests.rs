//! NRRD: spaces, encodings, detached data, axes without direction, and headers that lie.

use super::*;

/// Stored numbers of a 3×2×2 volume.
const NUMBERS: [i16; 12] = [-1000, 5, 300, -7, 40, 1200, 0, 1, 2, 3, -2000, 30000];

const LPS: &str = "type: short\ndimension: 3\nspace: left-posterior-superior\nsizes: 3 2 2\nspace directions: (0.5,0,0) (0,0.25,0) (0,0,2)\n\
    kinds: domain domain domain\nendian: little\nencoding: raw\nspace origin: (10,-20,30)\n";

fn little() -> Vec<u8> {
    NUMBERS.iter().flat_map(|n| n.to_le_bytes()).collect()
}

/// A folder with a header and its data, and what is read.
fn read_files(header: &str, data: &[u8], others: &[(&str, Vec<u8>)]) -> Result<Image<f32>, String> {
    let dir = tempfile::tempdir().unwrap();
    for (name, bytes) in others {
        std::fs::write(dir.path().join(name), bytes).unwrap();
    }
    let path = dir.path().join("ct.nrrd");
    std::fs::write(&path, [format!("NRRD0005\n# made by a test\n{header}\n").as_bytes(), data].concat())
        .unwrap();
    read_ct(&path, AUTO).map_err(|e| e.to_string())
}

fn read(header: &str, data: &[u8]) -> Result<Image<f32>, String> {
    read_files(header, data, &[])
}

fn values() -> Vec<f32> {
    NUMBERS.map(f32::from).to_vec()
}

fn assert_refused(found: Result<Image<f32>, String>, words: &[&str]) {
    let said = found.map(|image| image.volume.data().len()).unwrap_err();
    assert!(said.contains("ct.nrrd") && words.iter().all(|word| said.contains(word)), "{said}");
}

#[test]
fn each_space_is_turned_into_ras_once() {
    for (space, signs) in [
        ("left-posterior-superior", [-1.0, -1.0, 1.0]),
        ("LPS", [-1.0, -1.0, 1.0]),
        ("right-anterior-superior", [1.0, 1.0, 1.0]),
        ("RAS", [1.0, 1.0, 1.0]),
        ("left-anterior-superior", [-1.0, 1.0, 1.0]),
    ] {
        let image = read(&LPS.replace("left-posterior-superior", space), &little()).unwrap();
        let grid = image.volume.grid();
        let last = grid.center([2, 1, 1]).coords;
        let expected = Vector3::new(signs[0] * 11.0, signs[1] * -19.75, signs[2] * 32.0);
        assert!((last - expected).amax() < 1e-12, "{space}: {last}");
        assert_eq!(image.volume.data(), values());
        assert_eq!((grid.dims(), image.provenance.placement), ([3, 2, 2], Placement::Nrrd));
    }
}

#[test]
fn a_header_that_does_not_tell_left_from_right_is_refused() {
    assert_refused(
        read(&LPS.replace("space: left-posterior-superior\n", ""), &little()),
        &["`space`", "left and right"],
    );
    assert_refused(read(&LPS.replace("left-posterior-superior", "scanner-xyz"), &little()), &["scanner-xyz"]);
    assert_refused(read(&LPS.replace("space origin: (10,-20,30)\n", ""), &little()), &["`space origin`"]);
    for origin in ["(nan,0,0)", "(0,inf,0)", "(0,0)", "10,-20,30"] {
        assert_refused(read(&LPS.replace("(10,-20,30)", origin), &little()), &["`space origin`", origin]);
    }
    assert_refused(read(&LPS.replace("(0,0,2)", "(0,nan,2)"), &little()), &["`space directions`"]);
    assert_refused(read(&LPS.replace("(0,0,2)", "(0,0.5,2)"), &little()), &["right angle"]);
    assert_refused(read(&LPS.replace("(0,0,2)", "(0,0,0)"), &little()), &["span a volume"]);
    assert_refused(read(&format!("{LPS}space units: \"cm\" \"cm\" \"cm\"\n"), &little()), &["`space units`"]);
    assert_refused(read(&format!("{LPS}space: RAS\n"), &little()), &["`space` twice"]);
}

#[test]
fn every_encoding_and_byte_order_gives_the_same_voxels() {
    let big: Vec<u8> = NUMBERS.iter().flat_map(|n| n.to_be_bytes()).collect();
    let text: String = NUMBERS.iter().map(|n| format!("{n}\n")).collect();
    let gzip_header = LPS.replace("encoding: raw", "encoding: gzip");
    for (header, data) in [
        (LPS.to_owned(), little()),
        (LPS.replace("endian: little", "endian: big"), big),
        (gzip_header.clone(), gzip(&little())),
        (LPS.replace("encoding: raw", "encoding: ascii").replace("endian: little\n", ""), text.into_bytes()),
        (LPS.replace('\n', "\r\n") + "\r", little()),
        (
            format!("{LPS}measurement frame: (0,1,0) (1,0,0) (0,0,1)\nSome key:=a value: of any kind\n"),
            little(),
        ),
        (gzip_header + "byte skip: 4\n", gzip(&[&[9; 4][..], &little()].concat())),
        (format!("{LPS}line skip: 2\nbyte skip: 3\n"), [&b"one\ntwo\nxyz"[..], &little()].concat()),
    ] {
        assert_eq!(read(&header, &data).unwrap().volume.data(), values(), "{header}");
    }
    assert_refused(read(&LPS.replace("endian: little\n", ""), &little()), &["`endian`"]);
    assert_refused(read(&LPS.replace("encoding: raw", "encoding: bzip2"), &little()), &["bzip2", "gzip"]);
}

#[test]
fn data_in_other_files_are_found_beside_the_header() {
    let raw = little();
    let file = |text: &str| format!("{LPS}data file: {text}\n");
    let padded = [&[7; 5][..], &raw].concat();
    let halves = |a: &'static str, b: &'static str| vec![(a, raw[..12].to_vec()), (b, raw[12..].to_vec())];
    for (header, others) in [
        (file("ct.raw"), vec![("ct.raw", raw.clone())]),
        (
            file("ct.raw").replace("data file", "datafile") + "byte skip: -1\n",
            vec![("ct.raw", padded.clone())],
        ),
        (file("ct.raw") + "byte skip: 5\n", vec![("ct.raw", padded)]),
        (file("LIST\nb.raw\na.raw"), halves("b.raw", "a.raw")),
        (file("slice%02d.raw 3 5 2"), halves("slice03.raw", "slice05.raw")),
        (file("ct.raw.gz").replace("encoding: raw", "encoding: gzip"), vec![("ct.raw.gz", gzip(&raw))]),
    ] {
        let image = read_files(&header, b"", &others).unwrap();
        assert_eq!(image.volume.data(), values(), "{header}");
        let names: Vec<_> =
            image.provenance.files.iter().map(|f| f.file_name().unwrap().to_owned()).collect();
        let expected: Vec<&str> =
            ["ct.nrrd"].into_iter().chain(others.iter().map(|(name, _)| *name)).collect();
        assert_eq!(names, expected);
    }
    assert_refused(read(&file("gone.raw"), b""), &["gone.raw", "cannot be read"]);
    assert_refused(read(&file("%d%d.raw 1 2 0"), b""), &["data file"]);
    let short = vec![("ct.raw", raw[..20].to_vec())];
    assert_refused(read_files(&file("ct.raw"), b"", &short), &["ct.raw", "24 bytes are announced"]);
    assert_refused(
        read_files(&(file("ct.raw") + "byte skip: -1\n"), b"", &short),
        &["24 bytes are announced"],
    );
}

#[test]
fn an_axis_without_direction_is_left_out_when_it_has_one_place() {
    let four = LPS
        .replace("dimension: 3", "dimension: 4")
        .replace("directions: (", "directions: none (")
        .replace("kinds: ", "kinds: list ");
    assert_eq!(read(&four.replace("sizes: ", "sizes: 1 "), &little()).unwrap().volume.data(), values());
    assert_refused(read(&four.replace("sizes: 3 2 2", "sizes: 2 3 2 1"), &little()), &["one value a voxel"]);
    let last = LPS.replace("(0,0,2)", "(0,0,2) none").replace("sizes: 3 2 2", "sizes: 3 2 1 2");
    assert_refused(read(&last, &little()), &["that is not the first"]);
}

#[test]
fn a_header_that_promises_too_much_is_refused_before_memory_is_taken() {
    assert_refused(
        read(&LPS.replace("3 2 2", "1000 1000 1000"), &little()),
        &["2000000000 bytes are announced"],
    );
    assert_refused(read(&LPS.replace("3 2 2", "99999999 99999999 99999999"), &little()), &["expected 1 to"]);
    assert_refused(read(&LPS.replace("3 2 2", "0 2 2"), &little()), &["expected 1 to"]);
    assert_refused(read(&LPS.replace("3 2 2", "3 2"), &little()), &["space directions"]);
    assert_refused(read(LPS, &[little(), vec![0; 5000]].concat()), &["after the last voxel"]);
    let zipped = LPS.replace("encoding: raw", "encoding: gzip");
    assert_refused(read(&zipped, &gzip(&little())[..15]), &["cannot be read"]);
    let text = LPS.replace("encoding: raw", "encoding: ascii");
    assert_refused(read(&text, b"1 2 3 4 5 6 7 8 9 10 11 twelve"), &["11 numbers before \"twelve\""]);
    assert_refused(read(&text, b"1 2 3 4 5 6 7 8 9 10 11 12 13"), &["12 numbers before \"13\""]);
    let float = LPS.replace("type: short", "type: float");
    let numbers: Vec<u8> = (0..12).flat_map(|n| if n == 7 { f32::NAN } else { 1.0 }.to_le_bytes()).collect();
    assert_refused(read(&float, &numbers), &["voxel [1, 0, 1] is NaN"]);
}

#[test]
fn padding_after_the_last_voxel_is_told() {
    let image = read(LPS, &[little(), vec![0; 7]].concat()).unwrap();
    assert_eq!(image.warnings, [ReadWarning::Padding { bytes: 7 }]);
}
