//! Labels: 3D Slicer's segmentations, DICOM SEG, folders of masks, names in NIfTI extensions, pairs of files, overlaps.

use super::dicom_file::*;
use super::*;

fn temp(name: &str, bytes: &[u8]) -> (tempfile::TempDir, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    (dir, path)
}

fn read(name: &str, bytes: &[u8]) -> Result<LabelMap, String> {
    let (_dir, path) = temp(name, bytes);
    read_label_map(&path, AUTO).map_err(|e| e.to_string())
}

fn named(map: &LabelMap) -> Vec<(u16, &str)> {
    map.names.iter().flat_map(LabelNames::iter).collect()
}

const SEGMENTATION: &str = "NRRD0005\ntype: unsigned char\ndimension: 3\nspace: left-posterior-superior\nsizes: 3 1 1\n\
    space directions: (1,0,0) (0,1,0) (0,0,1)\nkinds: domain domain domain\nencoding: raw\nspace origin: (0,0,0)\n\
    Segment0_ID:=Segment_1\nSegment0_LabelValue:=4\nSegment0_Layer:=0\nSegment0_Name:=Facial nerve\n\
    Segment1_ID:=Segment_2\nSegment1_LabelValue:=9\nSegment1_Layer:=0\nSegment1_Name:=Sigmoïd sinus\nSegment1_Extent:=0 2 0 0 0 0\n\
    Segmentation_ReferenceImageExtentOffset:=-5 12 7\n";

/// Two layers, both segments with the value 1.
fn layers(data: [u8; 6]) -> Vec<u8> {
    let text = SEGMENTATION
        .replace("dimension: 3", "dimension: 4")
        .replace("sizes: 3", "sizes: 2 3")
        .replace("directions: (", "directions: none (")
        .replace("kinds: ", "kinds: list ")
        .replace("LabelValue:=4", "LabelValue:=1")
        .replace("LabelValue:=9", "LabelValue:=1")
        .replace("Segment1_Layer:=0", "Segment1_Layer:=1");
    [text.as_bytes(), b"\n", &data].concat()
}

#[test]
fn segments_have_their_names_and_their_own_numbers() {
    let map = read("a.seg.nrrd", &[SEGMENTATION.as_bytes(), b"\n\x04\x00\x09"].concat()).unwrap();
    assert_eq!(named(&map), [(4, "Facial nerve"), (9, "Sigmoïd sinus")]);
    assert_eq!((map.image.volume.data(), &map.further[..]), (&[4, 0, 9][..], &[][..]));
    // the offset in the reference image moves nothing: the origin is that of the cropped image
    assert!(map.image.volume.grid().center([0, 0, 0]).coords.norm() < 1e-12);
    // without extents and layers, as older versions write it
    let old = SEGMENTATION.split('\n').filter(|l| !l.contains("_Layer") && !l.contains("_Extent"));
    let old = old.collect::<Vec<_>>().join("\n");
    assert_eq!(
        named(&read("a.seg.nrrd", &[old.as_bytes(), b"\n\x04\x00\x09"].concat()).unwrap()),
        named(&map)
    );
    let odd = read("a.seg.nrrd", &[SEGMENTATION.as_bytes(), b"\n\x04\x07\x09"].concat()).unwrap();
    assert_eq!(
        (odd.image.volume.data(), &odd.image.warnings[..]),
        (&[4, 0, 9][..], &[ReadWarning::Unnamed { voxels: 1 }][..])
    );
}

#[test]
fn a_voxel_of_two_layers_belongs_to_both_segments() {
    let mut map = read("a.seg.nrrd", &layers([1, 0, 1, 1, 0, 1])).unwrap();
    assert_eq!(named(&map), [(1, "Facial nerve"), (2, "Sigmoïd sinus")]);
    assert_eq!((map.image.volume.data(), &map.further[..]), (&[1, 1, 2][..], &[(1, 2)][..]));
    assert_eq!(map.whole(2).data(), [1, 2, 2]);
    assert_eq!(map.whole(1).data(), [1, 1, 2]);
    // the second one ranks higher: it is shown, and the first keeps its voxel
    let shared = map.settle(|label| label as u8);
    assert_eq!(shared, [Shared { shown: 2, other: 1, voxels: 1 }]);
    assert_eq!((map.image.volume.data(), &map.further[..]), (&[1, 2, 2][..], &[(1, 1)][..]));
    assert_eq!(map.whole(1).data(), [1, 1, 2]);
    // one that nobody asks for is forgotten
    assert_eq!(map.settle(|label| u8::from(label == 2)), []);
    assert!(map.further.is_empty());
}

fn map_of(grid: Grid<Ct>, values: Vec<u16>) -> LabelMap {
    let volume = Volume::new(grid, values).unwrap();
    let provenance = Provenance { files: vec![], placement: Placement::Nrrd };
    LabelMap { image: Image { volume, provenance, warnings: vec![] }, names: None, further: vec![] }
}

#[test]
fn a_mask_is_added_as_a_label_that_is_free() {
    let mut map = read("a.seg.nrrd", &[SEGMENTATION.as_bytes(), b"\n\x04\x00\x09"].concat()).unwrap();
    let mask = map_of(map.image.volume.grid().clone(), vec![1u16, 7, 0]);
    let label = map.add((&mask, None), Fit::Touched, map.names.clone().as_ref()).unwrap().number;
    assert_eq!(
        (label, map.image.volume.data(), &map.further[..]),
        (65535, &[4, 65535, 9][..], &[(0, 65535)][..])
    );
    assert_eq!(map.whole(label).data(), [65535, 65535, 9]);
    // one label of it
    assert_eq!(map.add((&mask, Some(7)), Fit::Centres, None), Ok(Added { number: 65534, mm3: [1.0; 2] }));
    assert_eq!(map.whole(65534).data(), [4, 65534, 9]);
    assert_eq!(map.labels(), [4, 9, 65534, 65535]);
    assert_eq!(map.add((&mask, Some(3)), Fit::Centres, None), Err(AddFault::Empty { label: Some(3) }));
}

/// A rod of 0.4 mm voxels across 1 mm voxels, from 0.3 to 2.7 mm along x, at 0.9 to 1.3 mm along y, and its neighbours.
#[test]
fn a_label_of_another_grid_is_touched_or_has_centres_in_it() {
    let thin = || {
        let grid = Grid::aligned([6, 1, 1], 0.4, Point::new(0.5, 1.1, 0.0)).unwrap();
        map_of(grid, vec![3; 6])
    };
    let wide = || map_of(Grid::aligned([4, 3, 1], 1.0, Point::new(0.0, 0.0, 0.0)).unwrap(), vec![0; 12]);
    for how in [Fit::Touched, Fit::Centres] {
        let mut map = wide();
        map.add((&thin(), Some(3)), how, None).unwrap();
        let at: Vec<usize> = (0..12).filter(|n| map.image.volume.data()[*n] != 0).collect();
        // 0.3..2.7 mm meets the voxels 0, 1, 2 and 3, and holds the centres of 1 and 2
        let all = if how == Fit::Touched { vec![4, 5, 6, 7] } else { vec![5, 6] };
        assert_eq!(at, all, "{how:?}");
    }
    // and the other way round: a coarse label in finer voxels, whose faces are centres of these
    let mut fine = map_of(Grid::aligned([9, 1, 1], 0.5, Point::new(0.0, 0.0, 0.0)).unwrap(), vec![0; 9]);
    let long = nalgebra::Vector3::new(1.0, 0.5, 0.5);
    let coarse =
        Grid::new([4, 1, 1], long, nalgebra::Matrix3::identity(), nalgebra::Vector3::zeros()).unwrap();
    let coarse = map_of(coarse, vec![0, 1, 0, 0]);
    let by = |map: &LabelMap, label: u16| -> Vec<usize> {
        let whole = map.whole(label);
        (0..whole.data().len()).filter(|n| whole.data()[*n] == label).collect()
    };
    let label = fine.add((&coarse, None), Fit::Centres, None).unwrap().number;
    assert_eq!(by(&fine, label), [1, 2], "0.5 to 1.5 mm: of two centres on its faces one counts");
    let Added { number: label, mm3 } = fine.add((&coarse, None), Fit::Touched, None).unwrap();
    assert_eq!(mm3, [0.25, 0.375]);
    assert_eq!(by(&fine, label), [1, 2, 3]);
}

/// A solid body that is turned against the map has no holes in it, whatever the angle.
#[test]
fn a_turned_label_that_is_touched_has_no_holes() {
    let map = || map_of(Grid::aligned([16; 3], 0.5, Point::new(-3.75, -3.75, -3.75)).unwrap(), vec![0; 4096]);
    for angle_rad in [0.0, 1e-6, 1e-4, 0.02, 0.2, 0.5, 0.785] {
        for side_mm in [0.3, 0.5, 0.8] {
            let axis = nalgebra::Unit::new_normalize(nalgebra::Vector3::new(1.0, 0.7, 0.2));
            let turn = nalgebra::Rotation3::from_axis_angle(&axis, angle_rad);
            let middle = nalgebra::Vector3::from_element(10.0 * side_mm);
            let origin = -(turn * middle) + nalgebra::Vector3::from_element(0.013);
            let sides = nalgebra::Vector3::from_element(side_mm);
            let solid = Grid::new([21; 3], sides, *turn.matrix(), origin).unwrap();
            let mut map = map();
            map.add((&map_of(solid, vec![1; 21 * 21 * 21]), None), Fit::Touched, None).unwrap();
            let grid = map.image.volume.grid();
            let inner_mm = (10.0 * side_mm).min(3.5);
            let holes = (0..grid.len()).filter(|n| {
                let p = grid.center(grid.voxel(*n)).coords;
                p.norm() < inner_mm && map.image.volume.data()[*n] == 0
            });
            assert_eq!(holes.count(), 0, "{angle_rad} rad, {side_mm} mm");
        }
    }
}

#[test]
fn a_map_grows_by_whole_voxels_to_hold_a_label_of_a_larger_grid() {
    let lattice = |first: f64, n: usize| Grid::aligned([n, 2, 1], 0.5, Point::new(first, 0.0, 0.0)).unwrap();
    let mut map = map_of(lattice(1.0, 2), vec![5, 0, 0, 6]);
    map.further = vec![(0, 9)];
    // voxels from 0 to 2.5 mm, of which the first and the last are the label's
    let other = map_of(lattice(0.0, 6), vec![0, 0, 0, 0, 0, 4, 4, 0, 0, 0, 0, 0]);
    for how in [Fit::Touched, Fit::Centres] {
        let mut map = map.clone();
        let label = map.add((&other, Some(4)), how, None).unwrap().number;
        let grid = map.image.volume.grid();
        assert_eq!((grid.dims(), grid.origin().x()), ([6, 2, 1], 0.0));
        let expected = [0, 0, 5, 0, 0, label, label, 0, 0, 6, 0, 0];
        assert_eq!((map.image.volume.data(), &map.further[..]), (&expected[..], &[(2, 9)][..]));
    }
    // so far away that no memory would hold both
    let far = map_of(Grid::aligned([1, 1, 1], 0.5, Point::new(9e3, 9e3, 9e3)).unwrap(), vec![1]);
    assert!(matches!(map.add((&far, None), Fit::Touched, None), Err(AddFault::TooLarge { .. })));
}

#[test]
fn segmentations_without_voxels_or_with_contradicting_keys_are_refused() {
    let single = SEGMENTATION.replace("sizes: 3", "sizes: 1");
    let refused = |text: &str, data: &[u8], word: &str| {
        let said =
            read("a.seg.nrrd", &[text.as_bytes(), b"\n", data].concat()).map(|m| m.further).unwrap_err();
        assert!(said.contains("a.seg.nrrd") && said.contains(word), "{said}");
    };
    refused(&single, &[1], "holds no segment");
    refused(SEGMENTATION, &[0; 3], "holds no segment");
    refused(&SEGMENTATION.replace("Value:=9", "Value:=4"), &[4, 0, 4], "another value or another layer");
    refused(&SEGMENTATION.replace("Sigmoïd sinus", "Facial nerve"), &[4, 0, 9], "stands for both");
    refused(&SEGMENTATION.replace("Segment1_Layer:=0", "Segment1_Layer:=3"), &[4, 0, 9], "Segment1_Layer");
    // layers without keys are no label map
    let bare: Vec<u8> = layers([1, 0, 1, 1, 0, 1]);
    let bare = String::from_utf8_lossy(&bare).replace("Segment", "Other");
    refused(
        &format!("{}\n", bare.trim_end_matches(|c: char| c.is_control())),
        &[1, 0, 1, 1, 0, 1],
        "one value a voxel",
    );
}

/// A segmentation of 4×2 pixels; frames as (segment, plane), pixels of all frames.
fn seg(kind: &'static str, bits: u16, frames: &[(u16, f64)], pixels: Vec<u8>) -> Dataset {
    let of_frame = |(segment, z): &(u16, f64)| -> Dataset {
        vec![
            ((0x20, 0x9113), Value::Items(vec![vec![((0x20, 0x32), numbers(&[0.0, *z, 0.0]))]])),
            ((0x62, 0x0a), Value::Items(vec![vec![((0x62, 0x0b), Value::Short(*segment))]])),
        ]
    };
    // coronal: columns to the left, rows down, so the normal points to the back
    let shared: Dataset = vec![
        ((0x20, 0x9116), Value::Items(vec![vec![((0x20, 0x37), numbers(&[1.0, 0.0, 0.0, 0.0, 0.0, -1.0]))]])),
        (
            (0x28, 0x9110),
            Value::Items(vec![vec![((0x28, 0x30), numbers(&[0.5, 0.25])), ((0x18, 0x50), numbers(&[2.0]))]]),
        ),
    ];
    let segment = |n: u16, name: &str| vec![((0x62, 4), Value::Short(n)), ((0x62, 5), text("LO", name))];
    let mut dataset = slice(0.0, [0; 6]);
    dataset.retain(|(tag, _)| {
        !matches!(tag, (0x20, 0x32 | 0x37) | (0x28, 0x30 | 0x1052 | 0x1053) | (0x7fe0, _))
    });
    with(
        dataset,
        vec![
            ((8, 0x16), text("UI", SEG)),
            ((8, 0x60), text("CS", "SEG")),
            ((0x28, 8), text("IS", frames.len().to_string())),
            ((0x28, 0x10), Value::Short(2)),
            ((0x28, 0x11), Value::Short(4)),
            ((0x28, 0x100), Value::Short(bits)),
            ((0x28, 0x101), Value::Short(bits)),
            ((0x28, 0x102), Value::Short(bits - 1)),
            ((0x28, 0x103), Value::Short(0)),
            ((0x62, 1), text("CS", kind)),
            ((0x62, 2), Value::Items(vec![segment(1, "Facial nerve"), segment(2, "Dura")])),
            ((0x62, 0x0e), Value::Short(200)),
            ((0x5200, 0x9229), Value::Items(vec![shared])),
            ((0x5200, 0x9230), Value::Items(frames.iter().map(of_frame).collect())),
            ((0x7fe0, 0x10), Value::Bytes(pixels)),
        ],
    )
}

#[test]
fn a_binary_segmentation_has_its_own_orientation_and_may_leave_planes_out_and_overlap() {
    // planes 0 and 2 of three; both segments in plane 2
    let frames = [(1, 4.0), (2, 4.0), (1, 0.0)];
    let map = read(
        "s.dcm",
        &bytes(&seg("BINARY", 1, &frames, vec![0b0000_0011, 0b1000_0010, 0b0001_0000]), LITTLE),
    )
    .unwrap();
    assert_eq!(named(&map), [(1, "Facial nerve"), (2, "Dura")]);
    let grid = map.image.volume.grid();
    assert_eq!(grid.dims(), [4, 2, 3]);
    // the first pixel of plane 2: LPS (0, 4, 0); rows run down
    assert!((grid.center([0, 0, 2]).coords - Vector3::new(0.0, -4.0, 0.0)).amax() < 1e-12);
    assert!((grid.center([3, 1, 0]).coords - Vector3::new(-0.75, 0.0, -0.5)).amax() < 1e-12);
    let mut expected = [0; 24];
    (expected[4], expected[16], expected[17], expected[23]) = (1, 1, 1, 2);
    assert_eq!((map.image.volume.data(), &map.further[..]), (&expected[..], &[(17, 2)][..]));
    assert_eq!((map.image.provenance.placement, &map.image.warnings[..]), (Placement::Dicom, &[][..]));
}

#[test]
fn a_fractional_segmentation_is_cut_at_half_and_says_so() {
    let pixels = vec![0, 99, 100, 200, 1, 150, 0, 0];
    let map = read("s.dcm", &bytes(&seg("FRACTIONAL", 8, &[(2, 0.0)], pixels), LITTLE)).unwrap();
    assert_eq!(map.image.volume.data(), [0, 0, 2, 2, 0, 2, 0, 0]);
    assert_eq!(map.image.warnings, [ReadWarning::Threshold { least: 100, most: 200 }]);
    assert!(map.image.warnings[0].to_string().contains("at least 100 of 200"));
}

#[test]
fn a_segmentation_that_is_in_doubt_is_refused() {
    let refused = |dataset: Dataset, word: &str| {
        let said = read("s.dcm", &bytes(&dataset, LITTLE)).map(|m| m.further).unwrap_err();
        assert!(said.contains("s.dcm") && said.contains(word), "{said}");
    };
    let one = |frames: &[(u16, f64)], pixels: Vec<u8>| seg("BINARY", 1, frames, pixels);
    refused(one(&[(1, 0.0)], vec![0]), "holds no segment's voxel");
    refused(one(&[(1, 0.0), (1, 3.1)], vec![1, 1]), "SpacingBetweenSlices");
    refused(one(&[(1, 0.0), (1, 2.0), (1, 4.0)], vec![1, 1]), "PixelData");
    refused(one(&[(1, 0.0), (1, 2e9)], vec![1, 1]), "SpacingBetweenSlices");
    refused(seg("FRACTIONAL", 1, &[(1, 0.0)], vec![1]), "SegmentationType");
    // a CT is no label map
    refused(slice(0.0, [1; 6]), "no DICOM segmentation");
}

#[test]
fn a_folder_of_masks_is_one_map_with_the_files_names() {
    let dir = tempfile::tempdir().unwrap();
    let mask = |name: &str, on: [usize; 2]| {
        let mut volume = ct([0.1, 0.2, 0.3], false).map(|_| 0u8);
        on.iter().for_each(|n| volume.data_mut()[*n] = 1);
        write_labels_u8(dir.path().join(name), &volume).unwrap();
    };
    mask("skull.nii.gz", [3, 4]);
    mask("facial_nerve.nii.gz", [4, 7]);
    std::fs::write(dir.path().join("statistics.json"), "{}").unwrap();
    let map = read_label_map(dir.path(), AUTO).unwrap();
    assert_eq!(named(&map), [(1, "facial_nerve"), (2, "skull")]);
    assert_eq!(
        (map.image.volume.data()[3..8].to_vec(), &map.further[..]),
        (vec![2, 1, 0, 0, 1], &[(4, 2)][..])
    );
    assert_eq!(map.image.provenance.files.len(), 2);
    let other = Grid::aligned([5, 4, 3], 0.5, Point::new(0.0, 0.0, 0.0)).unwrap();
    write_labels_u8(dir.path().join("dura.nii"), &Volume::filled(other, 1u8)).unwrap();
    let said = read_label_map(dir.path(), AUTO).unwrap_err().to_string();
    assert!(
        said.contains("facial_nerve.nii.gz") && said.contains("dura.nii") && said.contains("another grid"),
        "{said}"
    );
}

#[test]
fn names_stand_in_the_extension_that_totalsegmentator_writes() {
    let xml = "<?xml version=\"1.0\"?><CaretExtension><VolumeInformation Index=\"0\"><LabelTable><Label Key=\"91\" Red=\"1\" \
        Alpha=\"1\"><![CDATA[skull]]></Label><Label Key=\"90\" Red=\"0\">brain &amp; more</Label></LabelTable></VolumeInformation></CaretExtension>";
    let with_names = |xml: &str| {
        Changed::new(|bytes| {
            let mut extension = xml.as_bytes().to_vec();
            extension.resize(extension.len().next_multiple_of(16) + 8, 0);
            let size = extension.len() as i32 + 8;
            let tail = bytes.split_off(352);
            bytes[348] = 1;
            bytes.extend([size.to_le_bytes(), 0i32.to_le_bytes()].concat());
            bytes.extend(extension);
            let offset = bytes.len() as f32;
            put_f32(bytes, 108, offset);
            bytes.extend(tail.iter().map(|_| 0));
        })
    };
    let file = with_names(xml);
    let map = read_label_map(&file.path, AUTO).unwrap();
    assert_eq!(named(&map), [(90, "brain & more"), (91, "skull")]);
    let twice = with_names(&xml.replace("\"90\"", "\"91\""));
    let said = read_label_map(&twice.path, AUTO).unwrap_err().to_string();
    assert!(said.contains("label 91 is both"), "{said}");
    let other = with_names("<other>nothing</other>");
    assert_eq!(read_label_map(&other.path, AUTO).unwrap().names, None);
}

#[test]
fn a_header_and_its_voxels_may_be_two_files() {
    let file = Changed::new(|bytes| {
        put(bytes, 344, b"ni1\0");
        put_f32(bytes, 108, 0.0);
    });
    let bytes = fs_read(&file.path);
    let header = file.dir.path().join("two.hdr");
    std::fs::write(&header, &bytes[..352]).unwrap();
    let said = read_ct(&header, AUTO).unwrap_err().to_string();
    assert!(said.contains("two.img cannot be read"), "{said}");
    for (name, voxels) in [("two.img.gz", gzip(&bytes[352..])), ("two.img", bytes[352..].to_vec())] {
        std::fs::write(file.dir.path().join(name), voxels).unwrap();
        let image = read_ct(&header, AUTO).unwrap();
        assert_eq!(image.volume.data()[..2], [-1000.0, -963.0]);
        assert_eq!(image.provenance.files, [header.clone(), file.dir.path().join(name)]);
    }
}

/// What other programs wrote: looked for in `$BONEMILL_DATA/formats`.
#[test]
fn files_of_other_programs_are_read() {
    let place = std::env::var_os("BONEMILL_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data"), PathBuf::from);
    let place = place.join("formats");
    if !place.exists() {
        eprintln!("SKIPPED: no data in {}", place.display());
        return;
    }
    let ct = read_ct(place.join("CTChest4.nrrd"), AUTO).unwrap();
    let map = read_label_map(place.join("Segmentation.seg.nrrd"), AUTO).unwrap();
    assert!(!named(&map).is_empty() && ct.volume.grid().len() > 1000, "{:?}", named(&map));
    for name in ["seg_image_ct_binary.dcm", "seg_image_ct_binary_fractional.dcm"] {
        let map = read_label_map(place.join(name), AUTO).unwrap();
        assert!(map.image.volume.data().contains(&1) && !named(&map).is_empty());
    }
    let said = read_ct(place.join("ct_image.dcm"), AUTO).unwrap_err().to_string();
    assert!(said.contains("is a single slice"), "{said}");
}
