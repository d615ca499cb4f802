//! Cutting edges of a mesh as polylines, as the file of `mesh.edges` gives them.

use std::path::Path;

use super::PlanFileError;
use super::force_log::read_numbers;

/// The columns, in order: the edge's number, and a point of it.
const COLUMNS: [&str; 4] = ["edge", "x", "y", "z"];

/// Reads polylines: a header with exactly the columns `edge,x,y,z`; rows of one edge follow each other.
///
/// # Errors
/// [`PlanFileError`] with the line: another header, a wrong number of cells, a cell that is not a finite number, an edge that
/// goes on after another one has begun.
pub fn read_cutting_edges(path: &Path) -> Result<Vec<Vec<[f64; 3]>>, PlanFileError> {
    let mut edges: Vec<(f64, Vec<[f64; 3]>)> = Vec::new();
    for (line, [edge, x, y, z]) in read_numbers(path, &[&COLUMNS])?.1 {
        let known = edges.iter().position(|(known, _)| *known == edge);
        match known {
            None => edges.push((edge, vec![[x, y, z]])),
            Some(n) if n + 1 == edges.len() => edges[n].1.push([x, y, z]),
            Some(_) => {
                let (found, expected) =
                    (format!("edge {edge} again"), "the rows of an edge one after the other");
                return Err(PlanFileError::Row { path: path.into(), line, found, expected: expected.into() });
            }
        }
    }
    Ok(edges.into_iter().map(|(_, points)| points).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_of_an_edge_make_a_polyline_and_a_torn_one_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("edges.csv");
        let read = |rows: &str| {
            std::fs::write(&path, format!("edge,x,y,z\n{rows}")).unwrap();
            read_cutting_edges(&path).map_err(|e| e.to_string())
        };
        let found = read("1,0,0,0\n1,1,0,0.5\n7,0,0,0\n7,-1,0,0.5\n7,-2,0,1\n").unwrap();
        assert_eq!(
            found,
            [vec![[0.0; 3], [1.0, 0.0, 0.5]], vec![[0.0; 3], [-1.0, 0.0, 0.5], [-2.0, 0.0, 1.0]]]
        );
        assert!(read("1,0,0,0\n2,0,0,0\n1,1,0,0\n").unwrap_err().contains("edges.csv:4: found edge 1 again"));
        assert!(read("1,0,0,inf\n").unwrap_err().contains("edges.csv:2"));
    }
}
