//! What is to be removed: a label of the map, or a shape in the CT's millimetres; and how thin bone beside it is treated.

use nalgebra::Vector3;

use super::{Ct, Point, basis};

/// What is to be removed. Lengths mm, in ct. `L`: how a label is called, by a name or by its number.
#[derive(Debug, Clone, PartialEq)]
pub enum Target<L> {
    /// Every voxel of this label.
    Label(L),
    /// Bone and enclosed air in an axis-aligned box.
    Box {
        /// Lower corner.
        min_mm: Vector3<f64>,
        /// Upper corner.
        max_mm: Vector3<f64>,
    },
    /// Bone and enclosed air in a ball.
    Ball {
        /// Its centre.
        center_mm: Vector3<f64>,
        /// Its radius.
        radius_mm: f64,
    },
    /// Bone and enclosed air in a cone's frustum with flat ends.
    Frustum {
        /// Centre of the first end.
        from_mm: Vector3<f64>,
        /// Centre of the second end.
        to_mm: Vector3<f64>,
        /// Radius at the first end.
        from_radius_mm: f64,
        /// Radius at the second end.
        to_radius_mm: f64,
    },
    /// What the tool of a channel sweeps; it has no shape of its own until the channel is laid.
    Swept,
}

/// Where bone thinner than the band, outside the target, is no obstacle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sheets {
    /// Within the band of the target only.
    Keep,
    /// Anywhere.
    Cut,
}

/// A label or a shape, larger by a margin: what a target takes in besides, or what is taken away from it.
#[derive(Debug, Clone, PartialEq)]
pub struct TargetRegion<L> {
    /// The label or shape.
    pub of: Target<L>,
    /// By how much it is larger, mm: a label in every direction, a shape as [`Target::grown`].
    pub margin_mm: f64,
}

impl<L> TargetRegion<L> {
    /// The same with its label called otherwise.
    ///
    /// # Errors
    /// Those of `label`.
    pub fn with_label<M, E>(&self, label: impl FnOnce(&L) -> Result<M, E>) -> Result<TargetRegion<M>, E> {
        Ok(TargetRegion { of: self.of.with_label(label)?, margin_mm: self.margin_mm })
    }
}

impl<L: Clone> Target<L> {
    /// A shape with its faces moved outwards: a box's sides, a ball's radius, a frustum's ends and both its radii. A label
    /// stays as it is.
    pub fn grown(&self, by_mm: f64) -> Self {
        match *self {
            Self::Box { min_mm, max_mm } => {
                let by = Vector3::repeat(by_mm);
                Self::Box { min_mm: min_mm - by, max_mm: max_mm + by }
            }
            Self::Ball { center_mm, radius_mm } => Self::Ball { center_mm, radius_mm: radius_mm + by_mm },
            Self::Frustum { from_mm, to_mm, from_radius_mm, to_radius_mm } => {
                let along = (to_mm - from_mm).normalize() * by_mm;
                Self::Frustum {
                    from_mm: from_mm - along,
                    to_mm: to_mm + along,
                    from_radius_mm: from_radius_mm + by_mm,
                    to_radius_mm: to_radius_mm + by_mm,
                }
            }
            Self::Label(_) | Self::Swept => self.clone(),
        }
    }
}

impl<L> Target<L> {
    /// Volume of a shape, mm³: a frustum's is π/3 · length · (R² + R r + r²). `None` for a label, whose voxels must be counted.
    pub fn volume_mm3(&self) -> Option<f64> {
        use std::f64::consts::PI;
        match *self {
            Self::Label(_) | Self::Swept => None,
            Self::Box { min_mm, max_mm } => Some((max_mm - min_mm).product()),
            Self::Ball { radius_mm: r, .. } => Some(4.0 / 3.0 * PI * r.powi(3)),
            Self::Frustum { from_mm, to_mm, from_radius_mm: a, to_radius_mm: b } => {
                Some(PI / 3.0 * (to_mm - from_mm).norm() * (a * a + a * b + b * b))
            }
        }
    }

    /// The same with its label called otherwise.
    ///
    /// # Errors
    /// Those of `label`.
    pub fn with_label<M, E>(&self, label: impl FnOnce(&L) -> Result<M, E>) -> Result<Target<M>, E> {
        Ok(match *self {
            Self::Label(ref of) => Target::Label(label(of)?),
            Self::Swept => Target::Swept,
            Self::Box { min_mm, max_mm } => Target::Box { min_mm, max_mm },
            Self::Ball { center_mm, radius_mm } => Target::Ball { center_mm, radius_mm },
            Self::Frustum { from_mm, to_mm, from_radius_mm, to_radius_mm } => {
                Target::Frustum { from_mm, to_mm, from_radius_mm, to_radius_mm }
            }
        })
    }

    /// Whether a shape holds `p`; a label holds nothing by itself.
    pub fn contains(&self, p: Point<Ct>) -> bool {
        match *self {
            Self::Label(_) | Self::Swept => false,
            Self::Box { min_mm, max_mm } => {
                (0..3).all(|a| p.coords[a] >= min_mm[a] && p.coords[a] <= max_mm[a])
            }
            Self::Ball { center_mm, radius_mm } => {
                (p.coords - center_mm).norm_squared() <= radius_mm * radius_mm
            }
            Self::Frustum { from_mm, to_mm, from_radius_mm, to_radius_mm } => {
                let along = to_mm - from_mm;
                let t = (p.coords - from_mm).dot(&along) / along.norm_squared();
                let off_axis = (p.coords - from_mm - along * t).norm();
                (0.0..=1.0).contains(&t) && off_axis <= from_radius_mm + t * (to_radius_mm - from_radius_mm)
            }
        }
    }

    /// Points whose convex hull holds the shape; none for a label.
    pub fn hull_points(&self) -> Vec<Point<Ct>> {
        let corners = |lo: Vector3<f64>, hi: Vector3<f64>| {
            (0..8).map(move |c| {
                Point::new(
                    if c & 1 == 0 { lo.x } else { hi.x },
                    if c & 2 == 0 { lo.y } else { hi.y },
                    if c & 4 == 0 { lo.z } else { hi.z },
                )
            })
        };
        match *self {
            Self::Label(_) | Self::Swept => Vec::new(),
            Self::Box { min_mm, max_mm } => corners(min_mm, max_mm).collect(),
            Self::Ball { center_mm, radius_mm } => {
                let r = Vector3::repeat(radius_mm);
                corners(center_mm - r, center_mm + r).collect()
            }
            Self::Frustum { from_mm, to_mm, from_radius_mm, to_radius_mm } => {
                // an octagon around each end circle: circumscribed, so its hull holds the disc
                let basis = basis::from_z(&(to_mm - from_mm).normalize());
                let ring = |center: Vector3<f64>, radius: f64| {
                    (0..8).map(move |n| {
                        let angle = f64::from(n) * std::f64::consts::FRAC_PI_4;
                        let out = radius / (std::f64::consts::PI / 8.0).cos();
                        Point::from_coords(
                            center + basis * Vector3::new(angle.cos() * out, angle.sin() * out, 0.0),
                        )
                    })
                };
                ring(from_mm, from_radius_mm).chain(ring(to_mm, to_radius_mm)).collect()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shapes() -> [Target<u16>; 3] {
        [
            Target::Box { min_mm: Vector3::new(-1.0, 2.0, 3.0), max_mm: Vector3::new(4.0, 6.0, 9.0) },
            Target::Ball { center_mm: Vector3::new(1.0, -2.0, 0.5), radius_mm: 3.0 },
            Target::Frustum {
                from_mm: Vector3::new(1.0, 2.0, 3.0),
                to_mm: Vector3::new(9.0, -2.0, 6.0),
                from_radius_mm: 5.0,
                to_radius_mm: 2.0,
            },
        ]
    }

    /// Every point of a shape lies within its hull points' extent along any direction.
    #[test]
    fn hull_points_hold_the_shape() {
        for shape in shapes() {
            let hull = shape.hull_points();
            for direction in
                [Vector3::x(), -Vector3::y(), Vector3::new(0.3, -0.9, 0.4), Vector3::new(-1.0, 1.0, 2.0)]
            {
                let reach = hull.iter().map(|p| p.coords.dot(&direction)).fold(f64::MIN, f64::max);
                for n in 0..40 * 40 * 40 {
                    let at = |v: usize| (v % 40) as f64 * 0.5 - 8.0;
                    let p = Point::new(at(n), at(n / 40), at(n / 1600));
                    assert!(!shape.contains(p) || p.coords.dot(&direction) <= reach + 1e-9);
                }
            }
        }
    }

    /// Counted on a grid of 0.05 mm; the error of a count is far below a layer of its surface.
    #[test]
    fn volumes_are_those_counted_and_a_margin_moves_faces_outwards() {
        let h = 0.05;
        for shape in shapes() {
            let [lo, hi] =
                shape.hull_points().iter().fold(
                    [Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY)],
                    |[lo, hi], p| [lo.inf(&p.coords), hi.sup(&p.coords)],
                );
            let [nx, ny, nz] = [0, 1, 2].map(|a| ((hi[a] - lo[a]) / h).ceil() as usize);
            let (mut count, grown) = (0usize, shape.grown(0.4));
            for n in 0..nx * ny * nz {
                let at = [n % nx, n / nx % ny, n / (nx * ny)].map(|v| (v as f64 + 0.5) * h);
                let p = lo + Vector3::from(at);
                let is_in = shape.contains(Point::from_coords(p));
                count += usize::from(is_in);
                let beside = Point::from_coords(p + Vector3::new(0.22, -0.21, 0.23));
                assert!(!is_in || n % 101 != 0 || grown.contains(beside));
            }
            let volume = shape.volume_mm3().unwrap();
            assert!((count as f64 * h.powi(3) / volume - 1.0).abs() < 5e-3, "{shape:?} {volume}");
            assert!(grown.volume_mm3().unwrap() > volume);
        }
        assert_eq!(Target::Label(3u16).volume_mm3(), None);
    }

    #[test]
    fn a_frustum_narrows_and_ends_flat() {
        let [_, _, frustum] = shapes();
        let axis = (Vector3::new(8.0, -4.0, 3.0)).normalize();
        let side = axis.cross(&Vector3::z()).normalize();
        let (from, to) = (Vector3::new(1.0, 2.0, 3.0), Vector3::new(9.0, -2.0, 6.0));
        let holds = |p| frustum.contains(Point::from_coords(p));
        assert!(holds(from + side * 4.99) && !holds(from + side * 5.01));
        assert!(holds(to + side * 1.99 - axis * 1e-9) && !holds(to + side * 2.01));
        assert!(!holds(from - axis * 0.01) && !holds(to + axis * 0.01));
    }
}
