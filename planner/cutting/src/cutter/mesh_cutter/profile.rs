//! The solid of revolution that a mesh sweeps when it turns: its largest radius at every height.

use bonemill_geometry::{Mesh, Tool};

use super::topology::corners;
use crate::cutter::{CutterError, SolidOfRevolution};

/// Levels between the mesh's ends beside those at its vertices.
const LEVELS: usize = 400;
/// Levels at vertices beyond this many are left to the even ones.
const MOST_VERTEX_LEVELS: usize = 2000;
/// On either side of a vertex's height, where a flat facet makes a step, parts of the height.
const BESIDE: f64 = 1e-9;

/// The swept solid. Between two levels the radius of a mesh is convex in the height, so the chord holds it.
pub(super) fn solid_of(mesh: &Mesh<Tool>) -> Result<SolidOfRevolution, CutterError> {
    let mut vertex_z: Vec<f64> = mesh.vertices.iter().map(|v| v.z()).collect();
    vertex_z.sort_by(f64::total_cmp);
    let (Some(&bottom), Some(&top)) = (vertex_z.first(), vertex_z.last()) else {
        return Err(CutterError::NoEdge);
    };
    let height = top - bottom;
    vertex_z.dedup_by(|a, b| (*a - *b).abs() <= 10.0 * BESIDE * height);
    let at_vertices = if vertex_z.len() <= MOST_VERTEX_LEVELS { vertex_z.as_slice() } else { &[] };
    let mut levels: Vec<f64> = (0..=LEVELS).map(|n| bottom + height * n as f64 / LEVELS as f64).collect();
    levels.extend(at_vertices.iter().flat_map(|z| [z - BESIDE * height, z + BESIDE * height]));
    levels.retain(|z| *z > bottom && *z < top);
    levels.push(bottom + BESIDE * height);
    levels.push(top - BESIDE * height);
    levels.sort_by(f64::total_cmp);
    levels.dedup();
    let mut radius2 = vec![0f64; levels.len()];
    for facet in 0..mesh.triangles.len() as u32 {
        let c = corners(mesh, facet);
        for (a, b) in [(c[0], c[1]), (c[1], c[2]), (c[2], c[0])] {
            let (low, high) = if a.z <= b.z { (a, b) } else { (b, a) };
            let (from, to) =
                (levels.partition_point(|z| *z < low.z), levels.partition_point(|z| *z <= high.z));
            for n in from..to {
                let s = if high.z > low.z { (levels[n] - low.z) / (high.z - low.z) } else { 0.0 };
                let p = low + (high - low) * s;
                radius2[n] = radius2[n].max(p.x * p.x + p.y * p.y);
            }
        }
    }
    if at_vertices.is_empty() {
        // between two levels the chord must hold the vertices, too
        for v in &mesh.vertices {
            let above = levels.partition_point(|z| *z < v.z());
            for n in [above.saturating_sub(1), above.min(levels.len() - 1)] {
                radius2[n] = radius2[n].max(v.x() * v.x() + v.y() * v.y());
            }
        }
    }
    let profile: Vec<[f64; 2]> = levels.iter().zip(&radius2).map(|(z, r2)| [*z, r2.sqrt()]).collect();
    SolidOfRevolution::new(&profile)
}
