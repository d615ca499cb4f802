//! The lines of a path, and the path along them.

use bonemill_case::{Case, PathSpec, Sense};
use bonemill_toolpath::path::{Builder, Lines, MillPath, PathPoint, PathSpacing, RasterFrame, lay_path};
use bonemill_toolpath::scene::Scene;
use bonemill_toolpath::space::BurrSpace;
use nalgebra::{Unit, Vector3};

use super::PlanError;
use super::sense::PassSense;

/// Lines of a path, as chosen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Raster {
    /// Their direction and order.
    pub frame: RasterFrame,
    /// In which sense they are cut.
    pub sense: Sense,
}

impl Raster {
    /// The path of a case along these lines.
    ///
    /// # Errors
    /// When the tool, the material or the cost's weights are not usable.
    pub(super) fn lay(
        &self,
        case: &Case,
        scene: &Scene,
        space: &BurrSpace,
        spacing: PathSpacing,
    ) -> Result<MillPath, PlanError> {
        let sense = PassSense::new(case, scene, self.sense)?;
        let is_reversed = |builder: &Builder, points: &[_]| sense.is_reversed(builder, points);
        Ok(lay_path(space, spacing, &Lines { frame: self.frame, sense: &is_reversed }))
    }
}

/// How close the path's layers, lines and waypoints are.
pub(super) fn spacing(case: &Case) -> PathSpacing {
    let PathSpec { layer_mm, stepover_mm, step_mm, .. } = case.path;
    PathSpacing { layer_mm, stepover_mm, step_mm }
}

/// Unit direction of the move that ends at each waypoint; that of the last real move where the burr only turns.
pub(super) fn feeds(points: &[PathPoint]) -> Vec<Option<Unit<Vector3<f64>>>> {
    let mut last = None;
    let mut feeds = vec![None; points.len().min(1)];
    for pair in points.windows(2) {
        last = Unit::try_new(pair[1].position - pair[0].position, 1e-9).or(last);
        feeds.push(last);
    }
    feeds
}
