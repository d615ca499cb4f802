//! Points, lines and curves of 3D Slicer: `.mrk.json`, and `.fcsv` of earlier versions.
//!
//! **Source:** 3D Slicer, "Markups module", markups-schema-v1.0.3; the keys are those that 3D Slicer 5 writes.

use std::path::Path;

use bonemill_geometry::{Ct, Lps, Point, Rigid};
use nalgebra::Vector3;
use serde_json::Value;

use super::{SlicerFileError, SlicerFileProblem, fcsv, text_of};

/// What is expected of a coordinate system.
const SYSTEMS: &str = "\"LPS\" or \"RAS\"";

/// Control points of a list of points, a line or a curve.
#[derive(Debug, Clone, PartialEq)]
pub struct Markups {
    /// The points in the file's order.
    pub points: Vec<MarkupPoint>,
}

/// A control point.
#[derive(Debug, Clone, PartialEq)]
pub struct MarkupPoint {
    /// Its label, such as `F-1`.
    pub label: String,
    /// Where it is.
    pub position: Point<Ct>,
}

/// The coordinates of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum System {
    /// +x left, +y back.
    Lps,
    /// +x right, +y front.
    Ras,
}

impl System {
    /// Coordinates of a file as a point in ct, mm.
    pub fn point(self, [x, y, z]: [f64; 3]) -> Point<Ct> {
        match self {
            Self::Ras => Point::new(x, y, z),
            Self::Lps => {
                let point: Point<Lps> = Point::from_coords(Vector3::new(x, y, z));
                Rigid::lps_from_ct().inverse() * point
            }
        }
    }
}

/// Reads the points of a `.mrk.json` with one markup, or of an `.fcsv`.
///
/// Points that were not placed are refused, since the points' order counts.
///
/// # Errors
/// [`SlicerFileError`] for a file that cannot be read, says no coordinate system, or has no points.
pub fn read_markups(path: impl AsRef<Path>) -> Result<Markups, SlicerFileError> {
    let path = path.as_ref();
    let read = || {
        let text = text_of(path, "3D Slicer's .mrk.json or .fcsv")?;
        let points = if text.trim_start().starts_with('{') { from_json(&text) } else { fcsv::points(&text) }?;
        if points.is_empty() {
            return Err(SlicerFileProblem::part("points", "none", "at least one point"));
        }
        Ok(Markups { points })
    };
    read().map_err(|problem| SlicerFileError { path: path.into(), problem })
}

fn from_json(text: &str) -> Result<Vec<MarkupPoint>, SlicerFileProblem> {
    let file: Value = serde_json::from_str(text).map_err(SlicerFileProblem::Json)?;
    let expected = "a list of one markup, as 3D Slicer saves each on its own";
    let markup = match file["markups"].as_array().map(Vec::as_slice) {
        Some([markup]) => markup,
        Some(several) => {
            return Err(SlicerFileProblem::part("markups", format!("{} of them", several.len()), expected));
        }
        None => return Err(SlicerFileProblem::part("markups", said(&file["markups"]), expected)),
    };
    let system = match markup["coordinateSystem"].as_str() {
        Some("LPS") => System::Lps,
        Some("RAS") => System::Ras,
        _ => {
            let found = said(&markup["coordinateSystem"]);
            return Err(SlicerFileProblem::part("markups[0].coordinateSystem", found, SYSTEMS));
        }
    };
    match &markup["coordinateUnits"] {
        Value::Null => {}
        Value::String(unit) if unit == "mm" => {}
        Value::Array(code) if code.first().and_then(Value::as_str) == Some("mm") => {}
        other => return Err(SlicerFileProblem::part("markups[0].coordinateUnits", said(other), "\"mm\"")),
    }
    let points = markup["controlPoints"].as_array();
    let points = points.ok_or_else(|| {
        SlicerFileProblem::part(
            "markups[0].controlPoints",
            said(&markup["controlPoints"]),
            "a list of points",
        )
    })?;
    points.iter().enumerate().map(|(n, point)| from_point(n, point, system)).collect()
}

fn from_point(n: usize, point: &Value, system: System) -> Result<MarkupPoint, SlicerFileProblem> {
    let place = |key: &str| format!("markups[0].controlPoints[{n}].{key}");
    if let Some(status) = point["positionStatus"].as_str().filter(|status| *status != "defined") {
        return Err(SlicerFileProblem::part(place("positionStatus"), status, "\"defined\": place the point"));
    }
    let coordinates = point["position"].as_array().map(Vec::as_slice);
    let at = match coordinates {
        Some([x, y, z]) => (|| Some([x.as_f64()?, y.as_f64()?, z.as_f64()?]))(),
        _ => None,
    };
    let at = at.filter(|at| at.iter().all(|v| v.is_finite())).ok_or_else(|| {
        SlicerFileProblem::part(place("position"), said(&point["position"]), "three numbers in mm")
    })?;
    Ok(MarkupPoint {
        label: point["label"].as_str().unwrap_or_default().to_owned(),
        position: system.point(at),
    })
}

/// A value as it stands in the file, or that there is none.
fn said(value: &Value) -> String {
    if value.is_null() { "nothing".into() } else { value.to_string().chars().take(60).collect() }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    /// A file with this text, read.
    fn read(name: &str, text: &str) -> Result<Markups, SlicerFileError> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join(name);
        fs::write(&path, text).unwrap();
        read_markups(path)
    }

    fn line(system: &str) -> String {
        format!(
            r#"{{"@schema": "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/Resources/Schema/markups-schema-v1.0.3.json#",
            "markups": [{{"type": "Line", "coordinateSystem": {system}, "coordinateUnits": "mm", "controlPoints": [
            {{"id": "1", "label": "L-1", "position": [-60.5, 12.0, 3.25], "positionStatus": "defined"}},
            {{"id": "2", "label": "L-2", "position": [-20.0, 10.0, 3.0]}}]}}]}}"#
        )
    }

    #[test]
    fn positions_come_out_in_ras_whichever_the_file_says() {
        let at = |markups: &Markups| {
            markups.points.iter().map(|p| p.position.coords.into()).collect::<Vec<[f64; 3]>>()
        };
        let lps = read("a.mrk.json", &line("\"LPS\"")).unwrap();
        assert_eq!(at(&lps), [[60.5, -12.0, 3.25], [20.0, -10.0, 3.0]]);
        assert_eq!(lps.points[1].label, "L-2");
        let ras = read("a.mrk.json", &line("\"RAS\"")).unwrap();
        assert_eq!(at(&ras), [[-60.5, 12.0, 3.25], [-20.0, 10.0, 3.0]]);
    }

    #[test]
    fn a_file_that_does_not_tell_left_from_right_is_refused_and_so_are_other_oddities() {
        let healthy = line("\"LPS\"");
        for (text, parts) in [
            (line("\"IJK\""), ["coordinateSystem", "\"LPS\" or \"RAS\""]),
            (healthy.replace("\"coordinateSystem\": \"LPS\",", ""), ["coordinateSystem", "nothing"]),
            (healthy.replace("\"mm\"", "\"m\""), ["coordinateUnits", "\"mm\""]),
            (
                healthy.replace("\"defined\"", "\"undefined\""),
                ["controlPoints[0].positionStatus", "undefined"],
            ),
            (
                healthy.replace("[-20.0, 10.0, 3.0]", "[-20.0, 10.0]"),
                ["controlPoints[1].position", "three numbers"],
            ),
            (healthy.replace("\"markups\"", "\"marks\""), ["markups", "a list of one markup"]),
            (
                r#"{"markups": [{"coordinateSystem": "LPS", "controlPoints": []}]}"#.into(),
                ["points", "at least one"],
            ),
            ("{".into(), ["a.mrk.json", "JSON"]),
        ] {
            let said = read("a.mrk.json", &text).unwrap_err().to_string();
            assert!(parts.iter().all(|part| said.contains(part)), "{said}");
        }
    }
}
