//! Targets and seeds of the image formats beside NIfTI (NRRD, MetaImage, DICOM), and of what 3D Slicer saves beside images.

use std::path::Path;

use bonemill_geometry::Point;
use bonemill_imaging::slicer::{read_base_from_ct, read_markups};
use bonemill_imaging::{AffineChoice, read_ct, read_label_map};

use crate::file;

/// NRRD: a CT, a label map, segments.
pub fn nrrd(data: &[u8]) {
    read(&file("image.nrrd", data));
}

/// MetaImage: a CT and a label map.
pub fn metaimage(data: &[u8]) {
    read(&file("image.mha", data));
}

/// DICOM: a file beside a good slice, as a series, a file of many frames, and a segmentation.
pub fn dicom(data: &[u8]) {
    let path = file("one.dcm", data);
    read(&path);
    let folder = path.with_file_name("series");
    std::fs::create_dir_all(&folder).expect("a folder for slices");
    std::fs::write(folder.join("a"), data).expect("room for an input");
    std::fs::write(folder.join("b"), slice(2)).expect("room for a slice");
    read(&folder);
}

/// Points, lines and curves, and rigid transforms: what is read is finite.
pub fn markups(data: &[u8]) {
    let path = file("points.mrk.json", data);
    match read_markups(&path) {
        Ok(markups) => {
            assert!(!markups.points.is_empty());
            assert!(markups.points.iter().all(|point| point.position.is_finite()));
        }
        Err(error) => drop(error.to_string()),
    }
    match read_base_from_ct(&path) {
        Ok(base_from_ct) => {
            assert!(
                base_from_ct
                    .translation_mm
                    .iter()
                    .chain(base_from_ct.rotation.matrix().iter())
                    .all(|v| v.is_finite())
            );
        }
        Err(error) => drop(error.to_string()),
    }
}

fn read(path: &Path) {
    if let Ok(image) = read_ct(path, AffineChoice::Auto) {
        assert_eq!(image.volume.data().len(), image.volume.grid().len());
        assert!(image.volume.grid().corners().iter().all(Point::is_finite));
    }
    match read_label_map(path, AffineChoice::Auto) {
        Ok(map) => {
            let voxels = map.image.volume.grid().len();
            assert!(map.further.iter().all(|(place, label)| (*place as usize) < voxels && *label > 0));
        }
        Err(error) => drop(error.to_string()),
    }
}

/// Valid files of a target.
pub fn seeds(target: &str) -> Vec<Vec<u8>> {
    let header = "NRRD0005\ntype: short\ndimension: 3\nspace: left-posterior-superior\nsizes: 3 2 2\n\
        space directions: (0.5,0,0) (0,0.25,0) (0,0,2)\nkinds: domain domain domain\nendian: little\nencoding: raw\n\
        space origin: (10,-20,30)\n";
    let keys = "Segment0_ID:=a\nSegment0_Name:=Facial nerve\nSegment0_LabelValue:=1\nSegment0_Layer:=0\n\
        Segment1_ID:=b\nSegment1_Name:=Dura\nSegment1_LabelValue:=1\nSegment1_Layer:=1\n";
    let layers = header
        .replace("type: short", "type: uchar")
        .replace("sizes: 3 2 2", "sizes: 2 3 2 1")
        .replace("directions: ", "directions: none ");
    let meta = "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\nCompressedData = False\n\
        TransformMatrix = 0 1 0 -1 0 0 0 0 1\nOffset = 10 -20 30\nElementSpacing = 0.5 0.25 2\nDimSize = 3 2 2\n\
        ElementType = MET_SHORT\nElementDataFile = LOCAL\n";
    let join = |text: &str, bytes: &[u8]| [text.as_bytes(), bytes].concat();
    match target {
        "nrrd" => vec![
            join(&format!("{header}\n"), &[1; 24]),
            join(&format!("{}\n", header.replace("raw", "ascii")), b"1 2 3 4 5 6 7 8 9 10 11 12"),
            join(&format!("{layers}{keys}\n"), &[1, 0, 1, 1, 0, 1, 0, 0, 0, 1, 1, 1]),
            join(&format!("{header}byte skip: -1\ndata file: LIST\nimage.nrrd\n"), &[]),
        ],
        "metaimage" => vec![
            join(meta, &[1; 24]),
            join(&meta.replace("BinaryData = True", "BinaryData = False"), b"1 2 3 4 5 6 7 8 9 10 11 12"),
            join(&meta.replace("LOCAL", "LIST\nimage.mha"), &[]),
        ],
        "dicom" => vec![slice(0), frames(false), frames(true)],
        "markups" => markup_files().map(|text| text.as_bytes().to_vec()).to_vec(),
        _ => vec![],
    }
}

/// A line, points of an earlier version, and a transform.
fn markup_files() -> [&'static str; 3] {
    [
        r#"{"@schema": "markups-schema-v1.0.3.json#", "markups": [{"type": "Line", "coordinateSystem": "LPS", "coordinateUnits": "mm",
        "controlPoints": [{"id": "1", "label": "L-1", "position": [-60.5, 12.0, 3.25], "positionStatus": "defined"},
        {"id": "2", "label": "L-2", "position": [-20.0, 10.0, 3e0]}]}]}"#,
        "# Markups fiducial file version = 4.10\n# CoordinateSystem = 0\n# columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc\n\
         node_0,-30.5,20.25,-7,0,0,0,1,1,1,0,F-1,\nnode_1,1e1,2,3,0,0,0,1,1,1,0,F-2,\"on the rim, left\"\n",
        "#Insight Transform File V1.0\n#Transform 0\nTransform: AffineTransform_double_3_3\nParameters: 0 1 0 -1 0 0 0 0 1 10 20 -30\n\
         FixedParameters: 7 0 0\n",
    ]
}

/// An element of explicit VR, little endian.
fn element(tag: [u16; 2], vr: &str, value: &[u8]) -> Vec<u8> {
    let mut value = value.to_vec();
    if value.len() % 2 == 1 {
        value.push(if vr == "UI" { 0 } else { b' ' });
    }
    let mut out = [tag[0].to_le_bytes(), tag[1].to_le_bytes()].concat();
    out.extend(vr.bytes());
    if matches!(vr, "OW" | "OB" | "SQ") {
        out.extend([0, 0]);
        out.extend((value.len() as u32).to_le_bytes());
    } else {
        out.extend((value.len() as u16).to_le_bytes());
    }
    [out, value].concat()
}

fn items(tag: [u16; 2], items: &[Vec<u8>]) -> Vec<u8> {
    let item =
        |item: &Vec<u8>| [&[0xfe, 0xff, 0, 0xe0][..], &(item.len() as u32).to_le_bytes(), item].concat();
    element(tag, "SQ", &items.iter().flat_map(item).collect::<Vec<_>>())
}

fn short(tag: [u16; 2], value: u16) -> Vec<u8> {
    element(tag, "US", &value.to_le_bytes())
}

fn whole_file(elements: Vec<Vec<u8>>) -> Vec<u8> {
    let syntax = element([2, 0x10], "UI", b"1.2.840.10008.1.2.1");
    let class = element([2, 2], "UI", b"1.2.840.10008.5.1.4.1.1.2");
    let meta = [class, element([2, 3], "UI", b"1.2.3.4"), syntax].concat();
    let length = element([2, 0], "UL", &(meta.len() as u32).to_le_bytes());
    [&[0; 128][..], b"DICM", &length, &meta, &elements.concat()].concat()
}

/// What is common to slices and frames, before and from the pixels' kind on.
fn common(class: &[u8], bits: u16) -> [Vec<Vec<u8>>; 2] {
    [
        vec![
            element([8, 8], "CS", b"ORIGINAL\\PRIMARY\\AXIAL"),
            element([8, 0x16], "UI", class),
            element([8, 0x60], "CS", b"CT"),
            element([0x20, 0x0e], "UI", b"1.2.3.9"),
        ],
        vec![
            short([0x28, 0x100], bits),
            short([0x28, 0x101], bits),
            short([0x28, 0x102], bits - 1),
            short([0x28, 0x103], u16::from(bits == 16)),
        ],
    ]
}

/// A slice of a series at a height.
fn slice(z_mm: u8) -> Vec<u8> {
    let [mut elements, pixels] = common(b"1.2.840.10008.5.1.4.1.1.2", 16);
    elements.extend([
        element([0x20, 0x32], "DS", format!("10\\-20\\{z_mm}").as_bytes()),
        element([0x20, 0x37], "DS", b"1\\0\\0\\0\\1\\0"),
        short([0x28, 2], 1),
        element([0x28, 4], "CS", b"MONOCHROME2"),
        short([0x28, 0x10], 2),
        short([0x28, 0x11], 3),
        element([0x28, 0x30], "DS", b"0.25\\0.5"),
    ]);
    elements.extend(pixels);
    elements.extend([
        element([0x28, 0x120], "SS", &(-2000i16).to_le_bytes()),
        element([0x28, 0x1052], "DS", b"-1024"),
        element([0x28, 0x1053], "DS", b"1"),
        element([0x7fe0, 0x10], "OW", &[1; 12]),
    ]);
    whole_file(elements)
}

/// A file with two frames: a CT, or a segmentation of two segments.
fn frames(is_segmentation: bool) -> Vec<u8> {
    let class: &[u8] =
        if is_segmentation { b"1.2.840.10008.5.1.4.1.1.66.4" } else { b"1.2.840.10008.5.1.4.1.1.2.1" };
    let [mut elements, pixels] = common(class, if is_segmentation { 1 } else { 16 });
    elements.extend([
        short([0x28, 2], 1),
        element([0x28, 4], "CS", b"MONOCHROME2"),
        element([0x28, 8], "IS", b"2"),
        short([0x28, 0x10], 2),
        short([0x28, 0x11], 4),
    ]);
    elements.extend(pixels);
    if is_segmentation {
        let segment = |n: u16, name: &[u8]| [short([0x62, 4], n), element([0x62, 5], "LO", name)].concat();
        elements.push(element([0x62, 1], "CS", b"BINARY"));
        elements.push(items([0x62, 2], &[segment(1, b"Facial nerve"), segment(2, b"Dura")]));
    }
    let measures = [element([0x18, 0x50], "DS", b"2"), element([0x28, 0x30], "DS", b"0.25\\0.5")].concat();
    let orientation = element([0x20, 0x37], "DS", b"1\\0\\0\\0\\1\\0");
    let shared = [items([0x20, 0x9116], &[orientation]), items([0x28, 0x9110], &[measures])].concat();
    let own = |n: u16| {
        let plane = element([0x20, 0x32], "DS", format!("1\\2\\{}", 2 * n).as_bytes());
        let of_segment = items([0x62, 0x0a], &[short([0x62, 0x0b], n)]);
        [items([0x20, 0x9113], &[plane]), if is_segmentation { of_segment } else { vec![] }].concat()
    };
    elements.push(items([0x5200, 0x9229], &[shared]));
    elements.push(items([0x5200, 0x9230], &[own(2), own(1)]));
    let bytes = if is_segmentation { 2 } else { 32 };
    elements.push(element([0x7fe0, 0x10], if is_segmentation { "OB" } else { "OW" }, &vec![0x5a; bytes]));
    whole_file(elements)
}
