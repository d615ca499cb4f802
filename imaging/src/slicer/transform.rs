//! A rigid transform of 3D Slicer as base_from_ct: ITK's text file, `.tfm` or `.txt`, or its HDF5 file, `.h5`.
//!
//! In Slicer a transform node T holds p_world = M p, RAS, mm, for what lies under it. The user places the CT under T so that it lies
//! where the robot sees it: Slicer's world is then the robot's base, and base_from_ct = M. ITK's file holds the other direction in the
//! other coordinates, since ITK's transforms resample: p_ct = A (p_base − c) + c + t, LPS. With F = diag(−1, −1, 1),
//! M = F (A, c, t)⁻¹ F.
//!
//! **Source:** 3D Slicer, "Transforms", file formats; ITK, itk::TxtTransformIO, itk::HDF5TransformIO and itk::MatrixOffsetTransformBase.

use std::path::Path;

use bonemill_geometry::{Base, Ct, Lps, Rigid};
use hdf5_reader::{Dataset, Hdf5File, OpenOptions, error::Error as Hdf5Error};
use nalgebra::{Matrix3, Vector3};

use super::{SlicerFileError, SlicerFileProblem, number};

/// What can be read.
const FORMAT: &str = "ITK's file of a transform, as 3D Slicer saves it: .h5, .tfm or .txt";
/// The first words of a text file.
const HEAD: &str = "#Insight Transform File";
/// The first bytes of an HDF5 file.
const HDF5: &[u8] = b"\x89HDF\r\n\x1a\n";
/// The largest HDF5 file, and the most that is unpacked of it: a linear transform takes some kilobytes.
const LARGEST_BYTES: usize = 1 << 20;
/// Names of transforms that hold a matrix and an offset, without the type of their numbers.
const MATRICES: [&str; 2] = ["AffineTransform", "MatrixOffsetTransformBase"];

/// Reads p_base = R p_ct + t, mm, from the transform under which the CT lies in 3D Slicer where the robot's base sees it.
///
/// # Errors
/// [`SlicerFileError`] for a file that is not ITK's, holds several transforms or a deformation, or whose matrix is not a rotation
/// to 1e-3.
pub fn read_base_from_ct(path: impl AsRef<Path>) -> Result<Rigid<Base, Ct>, SlicerFileError> {
    let path = path.as_ref();
    let read = || from_bytes(std::fs::read(path).map_err(SlicerFileProblem::Unreadable)?);
    read().map_err(|problem| SlicerFileError { path: path.into(), problem })
}

fn from_bytes(bytes: Vec<u8>) -> Result<Rigid<Base, Ct>, SlicerFileProblem> {
    if bytes.starts_with(HDF5) {
        return from_hdf5(&bytes);
    }
    from_text(&String::from_utf8(bytes).map_err(|_| SlicerFileProblem::NotText { expected: FORMAT })?)
}

fn from_text(text: &str) -> Result<Rigid<Base, Ct>, SlicerFileProblem> {
    let first = text.lines().next().unwrap_or_default();
    if !first.starts_with(HEAD) {
        let found: String = first.chars().take(60).collect();
        return Err(SlicerFileProblem::part("line 1", format!("{found:?}"), FORMAT));
    }
    let values =
        |key: &'static str| text.lines().filter_map(move |line| line.strip_prefix(key)?.strip_prefix(':'));
    let kinds: Vec<&str> = values("Transform").map(str::trim).collect();
    let words = |key| {
        let line = values(key).next().unwrap_or_default();
        line.split_whitespace().map(|word| number(word).unwrap_or(f64::NAN)).collect()
    };
    base_from_ct(&kinds, words(PARAMETERS), words(FIXED))
}

/// `/TransformGroup/N` holds the N-th transform: its name and its numbers as datasets.
fn from_hdf5(bytes: &[u8]) -> Result<Rigid<Base, Ct>, SlicerFileProblem> {
    if bytes.len() > LARGEST_BYTES {
        let found = format!("{} bytes", bytes.len());
        return Err(SlicerFileProblem::part("the file", found, "a linear transform, at most 1 MiB"));
    }
    let of_part = |place: &str, error: Hdf5Error| {
        SlicerFileProblem::part(place, format!("what cannot be read ({error})"), FORMAT)
    };
    let options =
        OpenOptions::default().with_max_read_bytes(LARGEST_BYTES).with_max_chunk_bytes(LARGEST_BYTES);
    let file = Hdf5File::from_bytes_with_options(bytes, options).map_err(|e| of_part("the file", e))?;
    let group = file.group("/TransformGroup").map_err(|e| of_part("/TransformGroup", e))?;
    let groups = group.groups().map_err(|e| of_part("/TransformGroup", e))?;
    let mut kinds = Vec::new();
    let mut numbers = [vec![], vec![]];
    for transform in &groups {
        let dataset = |key: &str| {
            // some versions of ITK wrote the second
            let of = |name: &str| transform.dataset(&format!("{name}{key}"));
            let place = format!("/TransformGroup/{}/Transform{key}", transform.name());
            of("Transform").or_else(|first| of("Tranform").map_err(|_| first)).map_err(|e| of_part(&place, e))
        };
        let kind = dataset("Type")?;
        kinds.push(kind.read_strings().map_err(|e| of_part("TransformType", e))?.concat());
        let read = |set: Dataset| {
            let numbers = set.read_array::<f64>().map_err(|e| of_part("the transform's numbers", e))?;
            Ok::<_, SlicerFileProblem>(numbers.into_iter().collect())
        };
        if groups.len() == 1 {
            numbers = [read(dataset(PARAMETERS)?)?, read(dataset(FIXED)?)?];
        }
    }
    let kinds: Vec<&str> = kinds.iter().map(String::as_str).collect();
    let [parameters, fixed] = numbers;
    base_from_ct(&kinds, parameters, fixed)
}

/// ITK's names of a transform's numbers: nine of the matrix, row by row, and three of the shift; the centre.
const PARAMETERS: &str = "Parameters";
const FIXED: &str = "FixedParameters";

/// From the names of a file's transforms, and the numbers of the first.
fn base_from_ct(
    kinds: &[&str],
    parameters: Vec<f64>,
    fixed: Vec<f64>,
) -> Result<Rigid<Base, Ct>, SlicerFileProblem> {
    let [kind] = kinds else {
        return Err(SlicerFileProblem::part(
            "Transform",
            format!("{} of them", kinds.len()),
            "one transform",
        ));
    };
    let name = kind.split('_').next().unwrap_or_default();
    if !MATRICES.contains(&name) || !kind.ends_with("_3_3") {
        let expected =
            "a linear transform, AffineTransform_double_3_3 or MatrixOffsetTransformBase_double_3_3";
        return Err(SlicerFileProblem::part("Transform", *kind, expected));
    }
    let [a0, a1, a2, b0, b1, b2, c0, c1, c2, x, y, z] = finite(parameters, PARAMETERS, "12 numbers")?;
    let center = Vector3::from(finite(fixed, FIXED, "3 numbers, the centre")?);
    let matrix = Matrix3::new(a0, a1, a2, b0, b1, b2, c0, c1, c2);
    let offset_mm = Vector3::new(x, y, z) + center - matrix * center;
    let ct_from_base =
        Rigid::<Ct, Base>::from_matrix(&matrix, offset_mm).map_err(SlicerFileProblem::NotRigid)?;
    let base_from_ct = ct_from_base.inverse();
    let mirror = Rigid::<Lps, Ct>::lps_from_ct().rotation;
    Ok(Rigid::new(mirror * base_from_ct.rotation * mirror, mirror * base_from_ct.translation_mm))
}

/// So many finite numbers.
fn finite<const N: usize>(
    found: Vec<f64>,
    key: &str,
    expected: &'static str,
) -> Result<[f64; N], SlicerFileProblem> {
    let said = if found.is_empty() { "nothing".into() } else { format!("{found:.60?}") };
    let all = found.iter().all(|v| v.is_finite()).then_some(found);
    all.and_then(|found| found.try_into().ok())
        .ok_or_else(|| SlicerFileProblem::part(key, said.chars().take(60).collect::<String>(), expected))
}

#[cfg(test)]
mod tests {
    use bonemill_geometry::Point;

    use super::*;

    fn file(kind: &str, parameters: &str, fixed: &str) -> String {
        format!(
            "#Insight Transform File V1.0\n#Transform 0\nTransform: {kind}\nParameters: {parameters}\nFixedParameters: {fixed}\n"
        )
    }

    const AFFINE: &str = "AffineTransform_double_3_3";

    /// In Slicer +10 mm to the right, +20 to the front, +30 up. In LPS that is (−10, −20, 30), and the file holds its inverse.
    #[test]
    fn a_shift_to_the_right_in_slicer_is_a_shift_to_the_right_in_base() {
        let shift = from_text(&file(AFFINE, "1 0 0 0 1 0 0 0 1 10 20 -30", "0 0 0")).unwrap();
        assert_eq!((shift * Point::new(1.0, 2.0, 3.0)).coords, Vector3::new(11.0, 22.0, 33.0));
    }

    /// In Slicer a quarter turn about z that takes right to front, (x, y) to (−y, x), then +5 mm to the right. In LPS the turn is the
    /// same and the shift is −5 in x. Its inverse is p ↦ (y, −x − 5): the turn back of p − (−5, 0, 0), that is (y, −(x + 5), z).
    #[test]
    fn a_turn_is_that_of_slicer_and_its_centre_counts() {
        let turn = "0 1 0 -1 0 0 0 0 1";
        let without = from_text(&file(AFFINE, &format!("{turn} 0 -5 0"), "0 0 0")).unwrap();
        let p = Point::new(1.0, 2.0, 3.0);
        let expected = Vector3::new(-2.0 + 5.0, 1.0, 3.0);
        assert!(((without * p).coords - expected).norm() < 1e-12, "{without:?}");
        // about the centre (7, 0, 0): A(p − c) + c + t with c − A c = (7, 7, 0)
        let kind = "MatrixOffsetTransformBase_double_3_3";
        let about = from_text(&file(kind, &format!("{turn} -7 -12 0"), "7 0 0")).unwrap();
        assert!(((about * p).coords - expected).norm() < 1e-12, "{about:?}");
    }

    #[test]
    fn what_is_not_one_rigid_transform_is_refused() {
        let identity = "1 0 0 0 1 0 0 0 1 0 0 0";
        let once = file(AFFINE, identity, "0 0 0");
        for (text, part) in [
            (file(AFFINE, "-1 0 0 0 1 0 0 0 1 0 0 0", "0 0 0"), "not rigid"),
            (file(AFFINE, "1.1 0 0 0 1 0 0 0 1 0 0 0", "0 0 0"), "not rigid"),
            (file("BSplineTransform_double_3_3", identity, "0 0 0"), "BSplineTransform"),
            (file(AFFINE, "1 0 0 0 1 0 0 0 1 0 0", "0 0 0"), "12 numbers"),
            (file(AFFINE, identity, "0 0"), "FixedParameters"),
            (file(AFFINE, &identity.replace('1', "nan"), "0 0 0"), "Parameters"),
            (format!("{once}{}", once.replace("#Insight Transform File V1.0\n", "")), "2 of them"),
            ("1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n".into(), ".h5, .tfm or .txt"),
            (String::new(), "line 1"),
        ] {
            let said = from_text(&text).unwrap_err().to_string();
            assert!(said.contains(part), "{said}");
        }
    }

    /// The quarter turn of above about (7, 0, 0), as SimpleITK writes it.
    const AS_HDF5: &[u8] = include_bytes!("transform.h5");

    #[test]
    fn the_hdf5_file_of_a_transform_says_what_its_text_says() {
        let text = from_text(&file(AFFINE, "0 1 0 -1 0 0 0 0 1 1 -5 3", "7 0 0")).unwrap();
        assert_eq!(from_bytes(AS_HDF5.to_vec()).unwrap(), text);
    }

    #[test]
    fn hdf5_files_of_other_things_and_broken_ones_are_refused() {
        let said = from_bytes(include_bytes!("two_transforms.h5").to_vec()).unwrap_err().to_string();
        assert!(said.contains("2 of them"), "{said}");
        for end in (0..AS_HDF5.len()).step_by(97) {
            assert!(from_bytes(AS_HDF5[..end].to_vec()).is_err());
        }
        // a byte that differs changes a number or is refused; nothing panics
        for n in 0..AS_HDF5.len() {
            let mut bytes = AS_HDF5.to_vec();
            bytes[n] ^= 0xff;
            let _ = from_bytes(bytes);
        }
        // as some versions of ITK wrote it, with misspelt names
        let old = include_bytes!("old_transform.h5");
        assert_eq!(from_bytes(old.to_vec()).unwrap(), from_bytes(AS_HDF5.to_vec()).unwrap());
        let large = [AS_HDF5, &[0; LARGEST_BYTES]].concat();
        assert!(from_bytes(large).unwrap_err().to_string().contains("at most 1 MiB"));
    }
}
