//! Images in other formats are recognised, and told how to become NIfTI-1.

use super::*;

fn mgh() -> Vec<u8> {
    let numbers = [1i32, 256, 256, 256, 1, 3, 0].map(i32::to_be_bytes).concat();
    [numbers, vec![0; 400]].concat()
}

fn message(bytes: &[u8], name: &str) -> String {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    read_ct(&path, AUTO).unwrap_err().to_string()
}

#[test]
fn another_format_is_named_with_how_to_convert_it() {
    let analyze = [&348i32.to_le_bytes()[..], &[0; 344]].concat();
    for (name, bytes, what, how) in [
        ("ct.mgz", mgh(), "is a FreeSurfer volume", "mri_convert"),
        ("ct.hdr", analyze, "is an Analyze 7.5 header", "dcm2niix"),
    ] {
        // whatever it is called, and compressed as well
        for (name, bytes) in [(name, bytes.clone()), ("ct.nii", bytes.clone()), ("ct.nii.gz", gzip(&bytes))] {
            let said = message(&bytes, name);
            assert!(said.contains(name) && said.contains(what) && said.contains(how), "{said}");
            assert!(!said.contains("first number"), "{said}");
        }
    }
}

#[test]
fn a_folder_without_images_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let series = dir.path().join("study/series 2");
    std::fs::create_dir_all(&series).unwrap();
    std::fs::write(series.join("IM0001"), "no image").unwrap();
    for said in [read_labels(dir.path(), AUTO).unwrap_err(), read_ct(dir.path(), AUTO).unwrap_err()] {
        let said = said.to_string();
        assert!(said.contains("is a folder without images") && said.contains("DICOM series"), "{said}");
    }
}

#[test]
fn numbers_that_only_look_like_another_format_are_not_taken_for_it() {
    // version 1, but a size of 0
    let mut bytes = mgh();
    bytes[4..8].fill(0);
    assert!(message(&bytes, "ct.nii").contains("is not NIfTI: the header's first number is 16777216"));
    assert!(message(b"a thesis, not a scan. ".repeat(40).as_slice(), "ct.nii").contains("is not NIfTI:"));
}
