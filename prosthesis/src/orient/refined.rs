//! The least residual area: exact rectangles by rotating calipers, then all three angles together.
//!
//! In one plane the smallest enclosing rectangle has a side along one of the hull's edges, so the exact angle is one of finitely many
//! (Freeman and Shapira 1975). Turning a plane changes the other two; from the end of those turns the sum of the three residual
//! areas is followed downhill in steps about the block's axes that halve when none of them improves. The search runs on a coarser surface;
//! its end is refined and compared on the whole one.

use bonemill_geometry::{Mesh, Part};
use geo::MinimumRotatedRect;
use nalgebra::{Matrix3, Rotation3, SymmetricEigen, Vector3};
use rayon::prelude::*;

use super::coarse::coarse;
use super::outline::{Outline, ProjectionPlane, SeenSurface};
use super::{Laid, published, sides_in_order};

/// Share of the part's longest side that a cell of the coarser surface has.
const CELL_SHARE: f64 = 0.03;
/// First and last step of the search on the coarser surface, rad.
const COARSE_STEPS_RAD: [f64; 2] = [0.14, 1e-3];
/// And on the whole one.
const FINE_STEPS_RAD: [f64; 2] = [8e-3, 2.5e-4];
/// Rounds of turns over the three planes before the search; each is a descent of its own plane.
const CALIPER_ROUNDS: usize = 6;

/// The orientation with the least sum of residual areas that the search finds; `runs` are those of the published procedure, whose
/// end it is never worse than.
pub fn least_residual(mesh: &Mesh<Part>, surface: &SeenSurface, runs: &[published::OrientationRun]) -> Laid {
    let size_mm = Laid::as_given(mesh, surface).size_mm.max();
    let small = coarse(surface, CELL_SHARE * size_mm);
    let end = runs.last().map(|run| run.laid.block_from_part.rotation);
    let starts: Vec<Rotation3<f64>> =
        [Some(Rotation3::identity()), Some(principal_axes(mesh)), end].into_iter().flatten().collect();
    let descents =
        starts.par_iter().map(|start| descend(&small, &by_calipers(&small, start), COARSE_STEPS_RAD));
    let mut ends: Vec<(f64, Rotation3<f64>)> = descents.collect();
    ends.sort_by(|a, b| a.0.total_cmp(&b.0));
    let from = ends.first().map_or_else(Rotation3::identity, |(_, rotation)| *rotation);
    let candidates = [Some(from), end].into_iter().flatten();
    let refined = candidates.map(|start| descend(surface, &start, FINE_STEPS_RAD));
    let best = refined.min_by(|a, b| a.0.total_cmp(&b.0)).map_or(from, |(_, rotation)| rotation);
    Laid::turned(mesh, surface, &sides_in_order(mesh, &best))
}

/// Axes of the vertices' spread: widest along x, narrowest along y.
fn principal_axes(mesh: &Mesh<Part>) -> Rotation3<f64> {
    let count = mesh.vertices.len().max(1) as f64;
    let mean = mesh.vertices.iter().map(|v| v.coords).sum::<Vector3<f64>>() / count;
    let spread: Matrix3<f64> =
        mesh.vertices.iter().map(|v| (v.coords - mean) * (v.coords - mean).transpose()).sum();
    let eigen = SymmetricEigen::new(spread);
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    let [x, _, y] = order.map(|n| eigen.eigenvectors.column(n).into_owned());
    Rotation3::from_matrix_unchecked(Matrix3::from_rows(&[
        x.transpose(),
        y.transpose(),
        x.cross(&y).transpose(),
    ]))
}

/// Turns each plane to its exact rectangle, as long as the sum of the areas falls.
fn by_calipers(surface: &SeenSurface, start: &Rotation3<f64>) -> Rotation3<f64> {
    let mut best = (surface.residual(start).sum_mm2(), *start);
    for plane in ProjectionPlane::ALL.into_iter().cycle().take(3 * CALIPER_ROUNDS) {
        let turned = plane.turn(-least_angle(&surface.outline(&best.1, plane))) * best.1;
        let sum_mm2 = surface.residual(&turned).sum_mm2();
        if sum_mm2 < best.0 {
            best = (sum_mm2, turned);
        }
    }
    best.1
}

/// Direction of a side of the outline's smallest enclosing rectangle, rad.
pub(super) fn least_angle(outline: &Outline) -> f64 {
    let corners: Vec<geo::Point<f64>> = outline.hull_mm.iter().map(|p| geo::Point::new(p[0], p[1])).collect();
    let rectangle = geo::MultiPoint::new(corners).minimum_rotated_rect();
    let side = rectangle.as_ref().and_then(|r| r.exterior().lines().next());
    side.map_or(0.0, |side| side.dy().atan2(side.dx()))
}

/// Downhill from `start`: steps about the block's axes, halved from the first to the last of `steps_rad`; the sum reached, mm².
fn descend(surface: &SeenSurface, start: &Rotation3<f64>, steps_rad: [f64; 2]) -> (f64, Rotation3<f64>) {
    let mut best = (surface.residual(start).sum_mm2(), *start);
    let mut step_rad = steps_rad[0];
    while step_rad >= steps_rad[1] {
        let turns: Vec<Rotation3<f64>> = (0..6)
            .map(|n| {
                Rotation3::new(Vector3::ith(n / 2, if n % 2 == 0 { step_rad } else { -step_rad })) * best.1
            })
            .collect();
        let tried = turns.into_par_iter().map(|turned| (surface.residual(&turned).sum_mm2(), turned));
        let tried: Vec<(f64, Rotation3<f64>)> = tried.collect();
        match tried.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)).filter(|t| t.0 < best.0) {
            Some(better) => best = better,
            None => step_rad /= 2.0,
        }
    }
    best
}
