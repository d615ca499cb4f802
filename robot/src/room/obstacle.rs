//! What stands in the room, each as a bound on the distance of a point from it.
//!
//! [`Obstacle::at_least_mm`] never exceeds the true distance and is negative inside, so that a minimum over a link's axis is a
//! bound, too. Boxes, cylinders, capsules and balls have closed forms; the head is a field ([`Head`]).

use bonemill_geometry::capsule::point_segment_mm;
use bonemill_geometry::{Base, Point, Rigid};
use nalgebra::Vector3;

use super::head::Head;

/// What reaches no higher above the mounting plane counts as below it, mm.
const MOUNT_MM: f64 = 1.0;

/// A shape, in base.
#[derive(Debug, Clone)]
pub enum Shape {
    /// A box about the origin of its own frame.
    Box {
        /// Base in the box's frame.
        box_from_base: Rigid<Base, Base>,
        /// Half of each side, mm.
        half_mm: Vector3<f64>,
    },
    /// A cylinder with flat ends.
    Cylinder {
        /// Centre of one end.
        from: Point<Base>,
        /// Centre of the other end.
        to: Point<Base>,
        /// Radius, mm.
        radius_mm: f64,
    },
    /// A segment's surroundings; a ball where both ends are the same.
    Capsule(bonemill_geometry::Capsule<Base>),
    /// The patient, as scanned.
    Head(Head),
}

/// Something that no link may touch.
#[derive(Debug, Clone)]
pub struct Obstacle {
    /// Its name in messages.
    pub name: String,
    /// Where it is.
    pub shape: Shape,
}

impl Obstacle {
    /// A bound on the distance of a point from the obstacle, mm: at most the true distance, and off by no more than
    /// [`Obstacle::error_mm`], or any bound that is at least `enough_mm`. Negative inside.
    pub fn at_least_mm(&self, p: &Point<Base>, enough_mm: f64) -> f64 {
        match &self.shape {
            Shape::Box { box_from_base, half_mm } => {
                let beyond = (*box_from_base * *p).coords.abs() - half_mm;
                beyond.map(|mm| mm.max(0.0)).norm() + beyond.max().min(0.0)
            }
            Shape::Cylinder { from, to, radius_mm } => {
                let (along, away) = (*to - *from, *p - *from);
                let length_mm = along.norm();
                let z_mm = along.dot(&away) / length_mm;
                let out_mm = (away.norm_squared() - z_mm * z_mm).max(0.0).sqrt() - radius_mm;
                let over_mm = (z_mm - 0.5 * length_mm).abs() - 0.5 * length_mm;
                (out_mm.max(0.0).powi(2) + over_mm.max(0.0).powi(2)).sqrt() + out_mm.max(over_mm).min(0.0)
            }
            Shape::Capsule(c) => point_segment_mm(&p.coords, &c.from.coords, &c.to.coords) - c.radius_mm,
            Shape::Head(head) => head.at_least_mm(p, enough_mm),
        }
    }

    /// The most by which [`Obstacle::at_least_mm`] falls short of the true distance outside, mm.
    pub fn error_mm(&self) -> f64 {
        if let Shape::Head(head) = &self.shape { head.error_mm() } else { 0.0 }
    }

    /// Whether its distance is convex: on a line it falls and then rises.
    pub(super) fn is_convex(&self) -> bool {
        !matches!(self.shape, Shape::Head(_))
    }

    /// Whether it reaches above the mounting plane of the arm's base, z = 0 in base; the patient always counts.
    pub(super) fn is_above_mount(&self) -> bool {
        let highest_mm = match &self.shape {
            Shape::Box { box_from_base, half_mm } => {
                let base_from_box = box_from_base.inverse();
                base_from_box.translation_mm.z
                    + base_from_box.rotation.matrix().row(2).abs().dot(&half_mm.transpose())
            }
            Shape::Cylinder { from, to, radius_mm } => {
                let along = (*to - *from).normalize();
                from.z().max(to.z()) + radius_mm * along.x.hypot(along.y)
            }
            Shape::Capsule(c) => c.from.z().max(c.to.z()) + c.radius_mm,
            Shape::Head(_) => f64::INFINITY,
        };
        highest_mm > MOUNT_MM
    }

    /// Whether the tool's handpiece may not touch it either: everything but the patient, whom the access test of the shank is
    /// for.
    pub(super) fn is_for_handpiece(&self) -> bool {
        !matches!(self.shape, Shape::Head(_))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;

    #[test]
    fn closed_forms_are_the_distances_to_sampled_surfaces() {
        let turn = Rotation3::from_euler_angles(0.3, -0.8, 1.9);
        let at = Rigid::<Base, Base>::new(turn, Vector3::new(30.0, -20.0, 55.0));
        let half_mm = Vector3::new(20.0, 45.0, 8.0);
        let block = Shape::Box { box_from_base: at.inverse(), half_mm };
        let [from, to] = [-30.0, 30.0].map(|z| at * Point::<Base>::new(0.0, 0.0, z));
        let rod = Shape::Cylinder { from, to, radius_mm: 25.0 };
        let mut surfaces = [vec![], vec![]];
        let n = 60;
        for (i, j) in (0..=n).flat_map(|i| (0..=n).map(move |j| (i, j))) {
            let (u, v) = (2.0 * f64::from(i) / f64::from(n) - 1.0, 2.0 * f64::from(j) / f64::from(n) - 1.0);
            for axis in 0..3 {
                for side in [-1.0, 1.0] {
                    let mut p = Vector3::new(u, v, 0.0);
                    p = Vector3::from_fn(|k, _| if k == axis { side } else { p[(k + 3 - axis - 1) % 3] });
                    surfaces[0].push(at * Point::<Base>::from_coords(p.component_mul(&half_mm)));
                }
            }
            let (s, c) = (std::f64::consts::PI * u).sin_cos();
            surfaces[1].push(at * Point::new(25.0 * c, 25.0 * s, 30.0 * v));
            let r = 12.5 * (v + 1.0);
            surfaces[1].extend([-30.0, 30.0].map(|z| at * Point::<Base>::new(r * c, r * s, z)));
        }
        for (shape, surface) in [block, rod].into_iter().zip(&surfaces) {
            let obstacle = Obstacle { name: String::new(), shape };
            for n in 0..200 {
                let share = |k: i32| f64::from((n * k) % 201) / 100.5 - 1.0;
                let p = at * Point::<Base>::new(80.0 * share(7), 80.0 * share(31), 60.0 * share(57));
                let sampled = surface.iter().map(|s| s.distance_mm(&p)).fold(f64::INFINITY, f64::min);
                let found = obstacle.at_least_mm(&p, f64::INFINITY).abs();
                assert!(found <= sampled + 1e-9 && found > sampled - 1.6, "{n}: {found} {sampled}");
            }
        }
    }
}
