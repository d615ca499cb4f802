//! A rigid transform of 3D Slicer as base_from_ct: the text file of ITK, `.tfm` or `.txt`.
//!
//! In Slicer a transform node T holds p_world = M p, RAS, mm, for what lies under it. The user places the CT under T so that it lies
//! where the robot sees it: Slicer's world is then the robot's base, and base_from_ct = M. ITK's file holds the other direction in the
//! other coordinates, since ITK's transforms resample: p_ct = A (p_base − c) + c + t, LPS. With F = diag(−1, −1, 1),
//! M = F (A, c, t)⁻¹ F.
//!
//! **Source:** 3D Slicer, "Transforms", file formats; ITK, itk::TxtTransformIO and itk::MatrixOffsetTransformBase.

use std::path::Path;

use bonemill_geometry::{Base, Ct, Lps, Rigid};
use nalgebra::{Matrix3, Vector3};

use super::{SlicerFileError, SlicerFileProblem, number, text_of};

/// What can be read.
const FORMAT: &str = "ITK's text file: save the transform in 3D Slicer as .tfm";
/// The first words of a file.
const HEAD: &str = "#Insight Transform File";
/// Names of transforms that hold a matrix and an offset, without the type of their numbers.
const MATRICES: [&str; 2] = ["AffineTransform", "MatrixOffsetTransformBase"];

/// Reads p_base = R p_ct + t, mm, from the transform under which the CT lies in 3D Slicer where the robot's base sees it.
///
/// # Errors
/// [`SlicerFileError`] for a file that is not ITK's text, holds several transforms or a deformation, or whose matrix is not a rotation
/// to 1e-3.
pub fn read_base_from_ct(path: impl AsRef<Path>) -> Result<Rigid<Base, Ct>, SlicerFileError> {
    let path = path.as_ref();
    let read = || from_text(&text_of(path, FORMAT)?);
    read().map_err(|problem| SlicerFileError { path: path.into(), problem })
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
    let [kind] = kinds.as_slice() else {
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
    let [a0, a1, a2, b0, b1, b2, c0, c1, c2, x, y, z] =
        numbers(values("Parameters"), "Parameters", "12 numbers")?;
    let center =
        Vector3::from(numbers(values("FixedParameters"), "FixedParameters", "3 numbers, the centre")?);
    let matrix = Matrix3::new(a0, a1, a2, b0, b1, b2, c0, c1, c2);
    let offset_mm = Vector3::new(x, y, z) + center - matrix * center;
    let ct_from_base =
        Rigid::<Ct, Base>::from_matrix(&matrix, offset_mm).map_err(SlicerFileProblem::NotRigid)?;
    let base_from_ct = ct_from_base.inverse();
    let mirror = Rigid::<Lps, Ct>::lps_from_ct().rotation;
    Ok(Rigid::new(mirror * base_from_ct.rotation * mirror, mirror * base_from_ct.translation_mm))
}

/// The numbers behind a key that stands once.
fn numbers<'a, const N: usize>(
    mut lines: impl Iterator<Item = &'a str>,
    key: &str,
    expected: &'static str,
) -> Result<[f64; N], SlicerFileProblem> {
    let line = lines.next().unwrap_or_default();
    let found: Option<Vec<f64>> = line.split_whitespace().map(number).collect();
    let found = found.and_then(|found| <[f64; N]>::try_from(found).ok());
    let said =
        || if line.is_empty() { "nothing".into() } else { line.trim().chars().take(60).collect::<String>() };
    found.ok_or_else(|| SlicerFileProblem::part(key, said(), expected))
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
            ("1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n".into(), "save the transform in 3D Slicer as .tfm"),
            (String::new(), "line 1"),
        ] {
            let said = from_text(&text).unwrap_err().to_string();
            assert!(said.contains(part), "{said}");
        }
    }

    #[test]
    fn an_hdf5_file_is_refused_with_what_to_save_instead() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("T.h5");
        std::fs::write(&path, b"\x89HDF\r\n\x1a\n\0\0").unwrap();
        let said = read_base_from_ct(&path).unwrap_err().to_string();
        assert!(said.contains("T.h5: is not a text file") && said.contains("as .tfm"), "{said}");
    }
}
