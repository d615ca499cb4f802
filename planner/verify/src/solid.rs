//! An obstacle of the case where it stands: distances from it, and how high it reaches.

use bonemill_case::{Obstacle, ObstacleFrame, ObstacleShape};
use nalgebra::{Isometry3, Vector3};

/// An obstacle of the case.
pub(crate) struct Solid {
    pub name: String,
    own_from_base: Isometry3<f64>,
    shape: ObstacleShape,
    /// Its highest place over the mounting plane, mm.
    pub highest_mm: f64,
}

impl Solid {
    pub fn new(obstacle: &Obstacle, base_from_ct: &Isometry3<f64>) -> Self {
        let own_from_base = match obstacle.frame {
            ObstacleFrame::Base => Isometry3::identity(),
            ObstacleFrame::Ct => base_from_ct.inverse(),
        };
        let highest_mm = highest_mm(&obstacle.shape, &own_from_base.inverse());
        Self { name: obstacle.name.clone(), own_from_base, shape: obstacle.shape, highest_mm }
    }

    /// Distance of a point in base from the surface, mm; negative inside.
    pub fn distance_mm(&self, p: &Vector3<f64>) -> f64 {
        let p = self.own_from_base.transform_point(&(*p).into()).coords;
        match &self.shape {
            ObstacleShape::Box { min_mm, max_mm } => {
                let past = (min_mm - p).sup(&(p - max_mm));
                let outside = past.map(|mm| mm.max(0.0)).norm();
                if outside > 0.0 { outside } else { past.max() }
            }
            ObstacleShape::Ball { center_mm, radius_mm } => (p - center_mm).norm() - radius_mm,
            ObstacleShape::Capsule { from_mm, to_mm, radius_mm } => {
                to_segment_mm(&p, from_mm, to_mm) - radius_mm
            }
            ObstacleShape::Cylinder { from_mm, to_mm, radius_mm } => {
                let axis = (to_mm - from_mm).normalize();
                let (up, length) = ((p - from_mm).dot(&axis), (to_mm - from_mm).norm());
                let across = (p - from_mm - axis * up).norm() - radius_mm;
                let over = (-up).max(up - length);
                if across > 0.0 && over > 0.0 { across.hypot(over) } else { across.max(over) }
            }
        }
    }
}

/// The highest place of a shape, mm.
fn highest_mm(shape: &ObstacleShape, base_from_own: &Isometry3<f64>) -> f64 {
    let height = |p: Vector3<f64>| base_from_own.transform_point(&p.into()).z;
    match shape {
        ObstacleShape::Box { min_mm, max_mm } => {
            let corner =
                |n: usize| Vector3::from_fn(|k, _| if n >> k & 1 == 0 { min_mm[k] } else { max_mm[k] });
            (0..8).map(|n| height(corner(n))).fold(f64::NEG_INFINITY, f64::max)
        }
        ObstacleShape::Ball { center_mm, radius_mm } => height(*center_mm) + radius_mm,
        ObstacleShape::Capsule { from_mm, to_mm, radius_mm } => {
            height(*from_mm).max(height(*to_mm)) + radius_mm
        }
        ObstacleShape::Cylinder { from_mm, to_mm, radius_mm } => {
            // the flat ends reach up by the radius times the sine of the axis's angle to the vertical
            let rise = (height(*to_mm) - height(*from_mm)) / (to_mm - from_mm).norm();
            height(*from_mm).max(height(*to_mm)) + radius_mm * (1.0 - rise * rise).max(0.0).sqrt()
        }
    }
}

/// Distance of a point from a segment, mm.
pub(crate) fn to_segment_mm(p: &Vector3<f64>, from: &Vector3<f64>, to: &Vector3<f64>) -> f64 {
    let along = to - from;
    let share = ((p - from).dot(&along) / along.norm_squared().max(1e-12)).clamp(0.0, 1.0);
    (p - from - along * share).norm()
}
