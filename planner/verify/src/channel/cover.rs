//! Balls that fill what the tool of a channel sweeps, and distances of structures from them.
//!
//! In the tool's frame at the deepest place, z to the handpiece, the solid is everything from the front outwards. Each ball lies in
//! it: the least distance of a structure from a ball is never below that from the solid, and above it by at most
//! a fiftieth of the tool's radius. [`Cover::exact_mm`] follows the nearest pair of points from there.

use bonemill_geometry::{Ct, Point};
use nalgebra::{Unit, Vector3};

use super::super::boxes::Boxes;
use super::sweep::OwnSolid;

/// Balls on the axis are this far apart, mm, or a tenth of the tool's radius.
const AXIS_STEP_MM: f64 = 0.1;
/// Places of the front's profile.
const PROFILE: usize = 240;
/// Distance between neighbouring balls of the front, and their radius, as shares of the tool's radius.
const SPACING: f64 = 0.1;
const BALL: f64 = 0.2;
/// The same at the rim.
const RIM_SPACING: f64 = SPACING / 3.0;
const RIM_BALL: f64 = 0.05;
/// Nearest balls from which pairs of points are followed, and steps of that.
const FOLLOWED: usize = 12;
const STEPS: u32 = 60;

/// A ball in the tool's frame, mm.
#[derive(Debug, Clone, Copy)]
pub struct CoverBall {
    /// Its centre.
    pub at: Vector3<f64>,
    /// Its radius, mm.
    pub radius_mm: f64,
}

/// The solid that a tool sweeps.
pub struct Cover {
    /// (radius, height) of the front, from its middle to its largest radius, mm.
    front: Vec<[f64; 2]>,
    /// Radius and length of a guide in front, mm.
    guide_mm: [f64; 2],
    radius_mm: f64,
    top_mm: f64,
}

/// A tool's pose: its tip, and the direction to the handpiece.
#[derive(Debug, Clone, Copy)]
pub struct ToolPlace {
    /// Its tip.
    pub tip: Point<Ct>,
    /// To the handpiece.
    pub out: Vector3<f64>,
}

impl ToolPlace {
    /// A point of the tool's frame in ct.
    pub fn place(&self, at: &Vector3<f64>) -> Point<Ct> {
        let x = self.out.cross(&Vector3::ith(self.out.iamin(), 1.0)).normalize();
        self.tip + (x * at.x + self.out.cross(&x) * at.y + self.out * at.z)
    }
}

impl Cover {
    /// Of a tool that has a solid.
    pub fn new(solid: &OwnSolid) -> Option<Self> {
        let radius_mm = solid.radius_mm();
        let at = |n: usize| {
            let r = radius_mm * n as f64 / PROFILE as f64;
            Some([r, solid.front_mm(r)?])
        };
        let front = (0..=PROFILE).map(at).collect::<Option<Vec<_>>>()?;
        Some(Self { front, guide_mm: solid.guide_mm(), radius_mm, top_mm: solid.top_mm() })
    }

    /// How far the surface is from a place inside, at a radius and height, mm.
    fn room_mm(&self, radius: f64, height: f64) -> f64 {
        self.nearest_of_front(radius, height).0.min(self.radius_mm - radius)
    }

    /// The distance of a place from the front, and the front's nearest place.
    fn nearest_of_front(&self, radius: f64, height: f64) -> (f64, [f64; 2]) {
        let mut best = (f64::INFINITY, [0.0; 2]);
        for pair in self.front.windows(2) {
            let [[r0, z0], [r1, z1]] = [pair[0], pair[1]];
            let (dr, dz) = (r1 - r0, z1 - z0);
            let along = (((radius - r0) * dr + (height - z0) * dz) / (dr * dr + dz * dz)).clamp(0.0, 1.0);
            let place = [r0 + along * dr, z0 + along * dz];
            let away = (radius - place[0]).hypot(height - place[1]);
            if away < best.0 {
                best = (away, place);
            }
        }
        best
    }

    /// The lowest height at which a place at a radius has this much room, mm.
    fn lowest_with_mm(&self, radius: f64, room_mm: f64) -> f64 {
        let [from, to] = [self.front[0][1], self.front[PROFILE][1] + self.radius_mm];
        let (mut below, mut above) = (from, to);
        for _ in 0..40 {
            let middle = 0.5 * (below + above);
            let is_inside = self.height_of_front(radius) <= middle;
            if is_inside && self.nearest_of_front(radius, middle).0 >= room_mm - 1e-9 {
                above = middle;
            } else {
                below = middle;
            }
        }
        above
    }

    fn height_of_front(&self, radius: f64) -> f64 {
        let at = (radius / self.radius_mm * PROFILE as f64).clamp(0.0, PROFILE as f64 - 1e-9);
        let n = at as usize;
        self.front[n][1] + (self.front[n + 1][1] - self.front[n][1]) * (at - n as f64)
    }

    /// Balls of the tool that comes `way_mm` along its axis; 0 for the tool itself.
    pub fn balls(&self, way_mm: f64) -> Vec<CoverBall> {
        let r = self.radius_mm;
        let full_mm = self.lowest_with_mm(0.0, r);
        let step = AXIS_STEP_MM.min(0.1 * r);
        let ball = |at: Vector3<f64>, radius_mm: f64| CoverBall { at, radius_mm };
        let up = |from: f64, to: f64, step: f64| {
            let count = ((to - from) / step).ceil().max(0.0);
            (0..=count as usize)
                .map(move |n| if count > 0.0 { from + (to - from) * n as f64 / count } else { from })
        };
        let mut balls = Vec::new();
        let axis = |z: f64| ball(Vector3::new(0.0, 0.0, z), self.room_mm(0.0, z).min(r));
        balls.extend(up(self.front[0][1], way_mm + self.top_mm, step).map(axis));
        let mut ring = |radius: f64, height: f64, spacing: f64, radius_mm: f64| {
            let count = (std::f64::consts::TAU * radius / (spacing * r)).ceil().max(1.0);
            balls.extend((0..count as usize).map(|n| {
                let (sin, cos) = (std::f64::consts::TAU * n as f64 / count).sin_cos();
                ball(Vector3::new(radius * cos, radius * sin, height), radius_mm)
            }));
        };
        let side = (1.0 - BALL) * r;
        for radius in up(0.0, side, SPACING * r) {
            ring(radius, self.lowest_with_mm(radius, BALL * r), SPACING, BALL * r);
        }
        for height in up(self.lowest_with_mm(side, BALL * r), full_mm, SPACING * r) {
            ring(side, height, SPACING, BALL * r);
        }
        let rim = (1.0 - RIM_BALL) * r;
        ring(rim, self.lowest_with_mm(rim, RIM_BALL * r), RIM_SPACING, RIM_BALL * r);
        ring(r, self.front[PROFILE][1], RIM_SPACING, 0.0);
        let [guide_mm, length_mm] = self.guide_mm;
        if guide_mm > 0.0 && length_mm > 0.0 {
            ring(guide_mm, -length_mm, RIM_SPACING, 0.0);
            for z in up(guide_mm - length_mm, self.front[0][1], 0.1 * guide_mm) {
                balls.push(ball(Vector3::new(0.0, 0.0, z), guide_mm));
            }
        }
        balls
    }

    /// The distance of a structure from the tool's solid at a place, which comes out along its axis; negative where a ball on the axis is cut. By
    /// turns the structure's point nearest to the solid's and the solid's nearest to the structure's, from the nearest balls.
    pub fn exact_mm(&self, boxes: &Boxes<'_>, tool: &ToolPlace, way_mm: f64) -> f64 {
        let mut gaps: Vec<(f64, Point<Ct>)> = self
            .balls(way_mm)
            .iter()
            .map(|ball| {
                let p = tool.place(&ball.at);
                (boxes.distance_mm(p) - ball.radius_mm, p)
            })
            .collect();
        gaps.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut least = gaps.first().map_or(f64::INFINITY, |gap| gap.0);
        for (_, p) in gaps.iter().take(FOLLOWED) {
            let mut q = boxes.nearest(*p).1;
            for _ in 0..STEPS {
                let s = self.nearest_in(tool, q);
                least = least.min(q.distance_mm(&s));
                q = boxes.nearest(s).1;
            }
        }
        least
    }

    /// The solid's point nearest to a point: the point itself inside.
    fn nearest_in(&self, tool: &ToolPlace, q: Point<Ct>) -> Point<Ct> {
        let height = (q - tool.tip).dot(&tool.out);
        let across = q - tool.tip - tool.out * height;
        let radius = across.norm();
        let is_beside = height >= self.height_of_front(radius.min(self.radius_mm));
        let [r, z] = match is_beside {
            true => [radius.min(self.radius_mm), height],
            false => self.nearest_of_front(radius, height).1,
        };
        let radial = Unit::try_new(across, 1e-12).map_or(Vector3::zeros(), Unit::into_inner);
        tool.tip + (radial * r + tool.out * z)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bonemill_geometry::{Grid, Volume};

    /// A drill of radius 0.9 with a point of 59°, without a web.
    fn drill() -> OwnSolid {
        let cot = 1.0 / 59f64.to_radians().tan();
        OwnSolid::Drill { web_mm: 0.0, inner_mm: 0.0, cot, radius_mm: 0.9, top_mm: 6.0 }
    }

    /// The signed distance of a point from the drill that comes 5 mm along z, by hand.
    fn by_hand_mm(p: &Vector3<f64>) -> f64 {
        let (sin, cos) = 59f64.to_radians().sin_cos();
        let (r, z) = (p.xy().norm(), p.z);
        let rim_mm = 0.9 * cos / sin;
        // across the flank, along it from the tip
        let (above, along) = (z * sin - r * cos, r * sin + z * cos);
        if z >= rim_mm && r >= 0.9 {
            r - 0.9
        } else if above >= 0.0 && r <= 0.9 {
            -above.min(0.9 - r)
        } else if along <= 0.0 {
            p.norm()
        } else if along >= 0.9 / sin {
            (r - 0.9).hypot(z - rim_mm)
        } else {
            -above
        }
    }

    #[test]
    fn the_balls_lie_in_the_solid_and_leave_a_fiftieth_of_its_radius() {
        let cover = Cover::new(&drill()).unwrap();
        let balls = cover.balls(5.0);
        for ball in &balls {
            assert!(by_hand_mm(&ball.at) <= 1e-6 - ball.radius_mm, "{ball:?}: {}", by_hand_mm(&ball.at));
        }
        let mut worst = 0f64;
        for n in 0..6000u32 {
            let part = |k: u32| f64::from((n * k) % 5003) / 5003.0 - 0.5;
            let p = Vector3::new(4.0 * part(71), 4.0 * part(1009), 5.0 * part(2503) + 1.0);
            let hand_mm = by_hand_mm(&p);
            if hand_mm > 0.0 {
                let gap = |ball: &CoverBall| (p - ball.at).norm() - ball.radius_mm;
                let over_mm = balls.iter().map(gap).fold(f64::INFINITY, f64::min) - hand_mm;
                assert!(over_mm > -1e-6, "{p:?}");
                worst = worst.max(over_mm);
            }
        }
        assert!(worst < 0.02 * 0.9, "{worst}");
    }

    #[test]
    fn a_voxel_beside_below_and_askew_is_as_far_as_by_hand() {
        let grid = Grid::<Ct>::aligned([41, 41, 41], 0.25, Point::new(-5.0, -5.0, -5.0)).unwrap();
        let cover = Cover::new(&drill()).unwrap();
        let tool = ToolPlace { tip: Point::new(0.0, 0.0, 0.0), out: Vector3::z() };
        for voxel in [[20, 20, 14], [27, 20, 20], [26, 25, 22], [24, 20, 18], [30, 20, 36], [23, 23, 19]] {
            let mut labels = Volume::filled(grid.clone(), 0u16);
            let n = grid.index(voxel);
            labels.data_mut()[n] = 1;
            let boxes = Boxes::new(&labels, 1).unwrap();
            let center = grid.center(voxel).coords;
            let places = (0..=10).flat_map(|i| (0..=10).flat_map(move |j| (0..=10).map(move |k| [i, j, k])));
            let places = places.map(|at| center + Vector3::from(at.map(|n| 0.025 * f64::from(n) - 0.125)));
            let hand_mm = places.map(|p| by_hand_mm(&p)).fold(f64::INFINITY, f64::min);
            let found_mm = cover.exact_mm(&boxes, &tool, 5.0);
            assert!((found_mm - hand_mm).abs() < 2e-3, "{voxel:?}: {found_mm}, {hand_mm}");
        }
    }
}
