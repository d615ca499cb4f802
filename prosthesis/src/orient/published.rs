//! The published procedure: the part is turned in one plane after the other, in equal steps, until nothing changes.
//!
//! **Source:** Castelli et al. 2020, section 3: for each step the bounding rectangle of the projection is evaluated and the angle with
//! the least residual area is kept, with the longest side along x and the shortest along y; first the plane XY, then XZ, then
//! YZ, in runs, until a run changes nothing of account. The step is not published; here it is one degree.

use std::f64::consts::PI;

use bonemill_geometry::{Mesh, Part};
use nalgebra::Rotation3;

use super::outline::{ProjectionPlane, SeenSurface};
use super::{Laid, outer_side_up};

/// Step of the angle, rad. Assumed.
pub const ANGLE_STEP_RAD: f64 = PI / 180.0;
/// Most runs. The published tables end with the third.
const MOST_RUNS: usize = 20;
/// A run that changes no residual area by more than this is the last, mm². The published tables give four decimals.
const CHANGE_MM2: f64 = 1e-4;

/// The part after one run over the three planes.
#[derive(Debug, Clone, PartialEq)]
pub struct OrientationRun {
    /// How it lies then.
    pub laid: Laid,
}

/// The runs of the procedure, from the part as its file gives it; the last one changes nothing of account.
pub fn published(mesh: &Mesh<Part>, surface: &SeenSurface) -> Vec<OrientationRun> {
    let mut rotation = Rotation3::identity();
    let mut runs: Vec<OrientationRun> = Vec::new();
    while runs.len() < MOST_RUNS {
        for plane in ProjectionPlane::ALL {
            let outline = surface.outline(&rotation, plane);
            let steps = (PI / ANGLE_STEP_RAD).round() as usize;
            let angle = |step: usize| step as f64 * ANGLE_STEP_RAD;
            let is_along = |angle_rad: f64| {
                let [along, across] = outline.sides_mm(angle_rad);
                along >= across
            };
            let allowed = (0..steps).filter(|&step| is_along(angle(step)));
            let least = allowed
                .min_by(|&a, &b| outline.residual_mm2(angle(a)).total_cmp(&outline.residual_mm2(angle(b))));
            rotation = plane.turn(angle(least.unwrap_or(0))) * rotation;
        }
        let laid = Laid::turned(mesh, surface, &outer_side_up(mesh, &rotation));
        let before = runs.last().map(|run| run.laid.residual);
        let now = laid.residual;
        runs.push(OrientationRun { laid });
        let unchanged = |b: super::Residual| {
            let changes = [b.xy_mm2 - now.xy_mm2, b.xz_mm2 - now.xz_mm2, b.yz_mm2 - now.yz_mm2];
            changes.iter().all(|c| c.abs() <= CHANGE_MM2)
        };
        if before.is_some_and(unchanged) {
            break;
        }
    }
    runs
}
