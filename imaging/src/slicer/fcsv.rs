//! Points of 3D Slicer before 5.0: `.fcsv`, one point a line, the columns and the coordinate system in comments.
//!
//! `# CoordinateSystem = 0` is RAS and `= 1` is LPS; later files have the words. Labels stand behind the coordinates.

use super::markups::{MarkupPoint, System};
use super::{SlicerFileProblem, number};

/// The points of a file's text.
///
/// # Errors
/// [`SlicerFileProblem::Part`] with the line that cannot be used, or for a file that says no coordinate system.
pub(super) fn points(text: &str) -> Result<Vec<MarkupPoint>, SlicerFileProblem> {
    let mut system = None;
    let mut columns = ["id", "x", "y", "z"].map(str::to_owned).to_vec();
    let mut found = Vec::new();
    for (n, line) in text.lines().enumerate() {
        let place = || format!("line {}", n + 1);
        if let Some(comment) = line.trim_start().strip_prefix('#') {
            let Some((key, value)) = comment.split_once('=') else { continue };
            match key.trim() {
                "CoordinateSystem" => system = Some(system_of(value.trim(), place)?),
                "columns" => columns = value.split(',').map(|name| name.trim().to_owned()).collect(),
                _ => {}
            }
            continue;
        }
        if line.trim().is_empty() {
            continue;
        }
        let Some(system) = system else {
            let expected = "`# CoordinateSystem = ` with LPS or RAS above the points";
            return Err(SlicerFileProblem::part(place(), "a point", expected));
        };
        let cells: Vec<&str> = line.split(',').collect();
        let cell = |name: &str| cells.get(columns.iter().position(|column| column == name)?).copied();
        let at = (|| Some([number(cell("x")?)?, number(cell("y")?)?, number(cell("z")?)?]))();
        let at = at.ok_or_else(|| {
            SlicerFileProblem::part(place(), line.chars().take(60).collect::<String>(), "x, y and z in mm")
        })?;
        found.push(MarkupPoint {
            label: cell("label").unwrap_or_default().to_owned(),
            position: system.point(at),
        });
    }
    Ok(found)
}

fn system_of(word: &str, place: impl Fn() -> String) -> Result<System, SlicerFileProblem> {
    match word {
        "0" | "RAS" => Ok(System::Ras),
        "1" | "LPS" => Ok(System::Lps),
        _ => Err(SlicerFileProblem::part(place(), word, "CoordinateSystem 0, 1, RAS or LPS")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILE: &str = "# Markups fiducial file version = 4.10\n# CoordinateSystem = 0\n\
        # columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID\n\
        vtkMRMLMarkupsFiducialNode_0,-30.5,20.25,-7,0,0,0,1,1,1,0,F-1,,\n\
        vtkMRMLMarkupsFiducialNode_1,1e1,2,3,0,0,0,1,1,1,0,F-2,\"on the rim, left\",\n";

    #[test]
    fn zero_is_ras_and_one_is_lps() {
        let at = |text: &str| {
            let points = points(text).unwrap();
            points
                .iter()
                .map(|p| (p.label.clone(), p.position.coords.into()))
                .collect::<Vec<(String, [f64; 3])>>()
        };
        let ras = [("F-1".to_owned(), [-30.5, 20.25, -7.0]), ("F-2".to_owned(), [10.0, 2.0, 3.0])];
        assert_eq!(at(FILE), ras);
        assert_eq!(at(&FILE.replace("= 0", "= RAS")), ras);
        let lps = [("F-1".to_owned(), [30.5, -20.25, -7.0]), ("F-2".to_owned(), [-10.0, -2.0, 3.0])];
        assert_eq!(at(&FILE.replace("= 0", "= 1")), lps);
        assert_eq!(at(&FILE.replace("= 0", "= LPS")), lps);
    }

    #[test]
    fn what_is_doubtful_is_refused_with_its_line() {
        for (text, part) in [
            (FILE.replace("= 0", "= 2"), "line 2: found 2"),
            (
                FILE.replace("# CoordinateSystem = 0", "#"),
                "line 4: found a point, expected `# CoordinateSystem",
            ),
            (FILE.replace("-30.5", "left"), "line 4"),
            (FILE.replace("-30.5,20.25,-7", "nan,1,1"), "x, y and z in mm"),
            (FILE.replace("id,x,y,z", "id,a,b,c"), "line 4"),
        ] {
            let said = points(&text).unwrap_err().to_string();
            assert!(said.contains(part), "{said}");
        }
    }
}
