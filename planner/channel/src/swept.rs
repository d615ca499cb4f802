//! The solid that a tool sweeps on its way along its axis, and its distance from a structure.
//!
//! In the tool's frame at the deepest place the swept solid S is everything from the tool's front outwards, as wide as the tool.
//! With s(x) the signed distance of x from S, the clearance from a structure is the least s(q) over the structure's points q: the gap where it
//! is positive, and how deep the structure lies in S where it is negative. It is found in two parts.
//!
//! 1. Balls on the axis that S holds: at height z one of radius a(z), the whole radius R from some height on. Beside the cylinder they are
//!    exact. The search along the axis passes over what cannot be nearer, since the structure's distance changes no faster
//!    than the place.
//! 2. The front below that height by boxes, halved where they could hold a nearer place. For each the nearest point q of the
//!    structure is found: s(q) is an upper bound, the distance less half the box's diagonal a lower one. The cylinder's first part is left
//!    out where whole balls on the axis, which reach beyond the front, meet nothing nearer.

use std::collections::BinaryHeap;

use bonemill_cutting::cutter::{CutterError, SolidOfRevolution};
use bonemill_geometry::{Ct, Point, basis, cancel};
use bonemill_imaging::StructureField;
use nalgebra::{Rotation3, Unit, Vector3};

/// Beyond every channel, mm.
const FAR_MM: f64 = 5e3;
/// Boxes of the front that are searched at most: more are needed only where a flat front faces a flat wall.
const MOST_BOXES: usize = 60_000;

/// What a tool sweeps along its axis.
#[derive(Debug, Clone)]
pub struct SweptTool {
    /// The tool's front, and the cylinder behind it without an end.
    solid: SolidOfRevolution,
    /// Its lowest point, mm.
    low_mm: f64,
    /// Where its cylinder begins, mm.
    rim_mm: f64,
    /// From this height on the ball about the axis has the tool's radius, mm.
    full_mm: f64,
    /// The tool's own upper end, mm.
    top_mm: f64,
}

/// A tool at the deepest place of its way.
#[derive(Debug, Clone, Copy)]
pub struct SweptPose {
    /// The tool's origin.
    pub end: Point<Ct>,
    /// Towards the handpiece.
    pub out: Unit<Vector3<f64>>,
    /// How far the tool comes along its axis, mm.
    pub way_mm: f64,
}

/// How near a structure is to a swept solid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SweptClearance {
    /// Certainly not above the true clearance, mm.
    pub at_least_mm: f64,
    /// Certainly not below it, mm.
    pub at_most_mm: f64,
    /// The point of the structure that has it.
    pub at: Point<Ct>,
    /// The height of that point over the tool's origin, mm.
    pub height_mm: f64,
    /// Unit direction from the solid to it.
    pub toward: Vector3<f64>,
}

impl SweptTool {
    /// Of a tool.
    ///
    /// # Errors
    /// [`CutterError::Profile`] for a solid whose front is none.
    pub fn new(tool: &SolidOfRevolution) -> Result<Self, CutterError> {
        let profile = tool.profile();
        let mut front = vec![profile[0]];
        let mut widest = profile[0][1];
        for pair in profile.windows(2) {
            let [[z0, r0], [z1, r1]] = [pair[0], pair[1]];
            if r1 > widest {
                if r0 < widest {
                    front.push([z0 + (z1 - z0) * (widest - r0) / (r1 - r0), widest]);
                }
                front.push([z1, r1]);
                widest = r1;
            }
        }
        front.push([FAR_MM, widest]);
        let solid = SolidOfRevolution::new(&front)?;
        let [low_mm, top_mm] = tool.z_range_mm();
        let is_full = |z: f64| -solid.signed_distance_at_mm(0.0, z) >= widest - 1e-9;
        let (mut below, mut above) = (low_mm, top_mm + widest);
        for _ in 0..50 {
            let middle = 0.5 * (below + above);
            if is_full(middle) { above = middle } else { below = middle }
        }
        let rim_mm = solid.front_height_mm(widest);
        Ok(Self { solid, low_mm, rim_mm, full_mm: above, top_mm })
    }

    /// Its largest radius, mm.
    pub fn radius_mm(&self) -> f64 {
        self.solid.max_radius_mm()
    }

    /// Heights of the solid over the tool's origin at a pose, mm: its lowest point, and where the tool ends before its way.
    pub fn heights_mm(&self, pose: &SweptPose) -> [f64; 2] {
        [self.low_mm, pose.way_mm + self.top_mm]
    }

    /// The clearance from a structure; the bounds are `tolerance_mm` (above 0) apart, unless a flat front faces a flat wall.
    pub fn clearance(&self, field: &StructureField, pose: &SweptPose, tolerance_mm: f64) -> SweptClearance {
        let mut search = Search {
            tool: self,
            field,
            pose,
            ct_from_tool: basis::from_z(&pose.out),
            tolerance_mm,
            best_mm: f64::INFINITY,
            at: pose.end,
        };
        search.along_axis();
        let unsearched_mm = search.front();
        let (radius_mm, height_mm) = search.place_of(search.at);
        SweptClearance {
            at_least_mm: (search.best_mm - tolerance_mm).min(unsearched_mm),
            at_most_mm: search.best_mm,
            at: search.at,
            height_mm,
            toward: search.toward(radius_mm, height_mm),
        }
    }
}

struct Search<'a> {
    tool: &'a SweptTool,
    field: &'a StructureField,
    pose: &'a SweptPose,
    ct_from_tool: Rotation3<f64>,
    tolerance_mm: f64,
    best_mm: f64,
    at: Point<Ct>,
}

impl Search<'_> {
    /// Radius and height of a point in the tool's frame, mm.
    fn place_of(&self, p: Point<Ct>) -> (f64, f64) {
        let from = p - self.pose.end;
        let height = from.dot(&self.pose.out);
        ((from - self.pose.out.as_ref() * height).norm(), height)
    }

    fn take_if_nearer(&mut self, mm: f64, at: Point<Ct>) {
        if mm < self.best_mm {
            (self.best_mm, self.at) = (mm, at);
        }
    }

    /// Balls on the axis, from where they are full outwards, then those below.
    fn along_axis(&mut self) {
        let full_mm = self.tool.full_mm;
        let [low_mm, high_mm] = self.tool.heights_mm(self.pose);
        // the gap changes by as much as the place, and below by the ball's radius, too
        self.walk([full_mm, high_mm.max(full_mm)], 1.0);
        self.walk([low_mm, full_mm], 0.5);
    }

    fn walk(&mut self, [from_mm, to_mm]: [f64; 2], share: f64) {
        let mut z = from_mm;
        loop {
            let p = self.pose.end + self.pose.out.as_ref() * z;
            let ball_mm = -self.tool.solid.signed_distance_at_mm(0.0, z);
            let (lower_mm, _) = self.field.bounds(p);
            let gap_mm = if lower_mm - ball_mm >= self.best_mm {
                lower_mm - ball_mm
            } else {
                let (distance_mm, at) = self.field.nearest(p);
                self.take_if_nearer(distance_mm - ball_mm, at);
                distance_mm - ball_mm
            };
            if z >= to_mm || self.best_mm <= -self.tool.radius_mm() {
                return;
            }
            z = (z + (share * (gap_mm - self.best_mm)).max(self.tolerance_mm)).min(to_mm);
        }
    }

    /// The front by boxes; a lower bound of what was left out, mm: infinite where nothing was.
    fn front(&mut self) -> f64 {
        let (radius_mm, low_mm) = (self.tool.radius_mm(), self.tool.low_mm);
        let high_mm = if self.is_clear_beside() { self.tool.rim_mm } else { self.tool.full_mm };
        let half_mm = Vector3::new(radius_mm, radius_mm, 0.5 * (high_mm - low_mm));
        let middle_mm = Vector3::new(0.0, 0.0, 0.5 * (high_mm + low_mm));
        let mut open = BinaryHeap::new();
        open.extend(self.boxed(middle_mm, 0, &half_mm));
        let mut boxes = 0;
        while let Some(FrontBox { at_least_mm, middle_mm, halvings }) = open.pop() {
            // nothing is nearer, or the structure is cut: how deep is told by the balls and the points met so far
            if at_least_mm >= self.best_mm - self.tolerance_mm || self.best_mm <= 0.0 {
                return f64::INFINITY;
            }
            if boxes >= MOST_BOXES {
                return at_least_mm;
            }
            boxes += 8;
            cancel::poll();
            let part_mm = half_mm * 0.5f64.powi(i32::from(halvings) + 1);
            // a flat front is halved in two directions
            for corner in 0..if part_mm.z > 0.0 { 8u8 } else { 4 } {
                let side = |a: u8| if corner >> a & 1 == 0 { -1.0 } else { 1.0 };
                let aside = part_mm.component_mul(&Vector3::new(side(0), side(1), side(2)));
                open.extend(self.boxed(middle_mm + aside, halvings + 1, &half_mm));
            }
        }
        f64::INFINITY
    }

    /// Whether nothing is nearer to the cylinder between its rim and where balls in it are full: by whole balls, which reach
    /// beyond the front.
    fn is_clear_beside(&mut self) -> bool {
        let SweptTool { rim_mm, full_mm, .. } = *self.tool;
        let mut z = rim_mm;
        loop {
            let p = self.pose.end + self.pose.out.as_ref() * z;
            let nearest_mm = self.best_mm + self.tool.radius_mm();
            let mut distance_mm = self.field.bounds(p).0;
            if distance_mm < nearest_mm {
                let (found_mm, at) = self.field.nearest(p);
                distance_mm = found_mm;
                let (radius, height) = self.place_of(at);
                self.take_if_nearer(self.tool.solid.signed_distance_at_mm(radius, height), at);
            }
            let more_mm = distance_mm - self.tool.radius_mm() - self.best_mm + self.tolerance_mm;
            if more_mm < 0.5 * self.tolerance_mm || z >= full_mm {
                return z >= full_mm && more_mm >= 0.0;
            }
            z = (z + more_mm).min(full_mm);
        }
    }

    /// A box of the front, unless nothing in it can be nearer.
    fn boxed(&mut self, middle_mm: Vector3<f64>, halvings: u8, half_mm: &Vector3<f64>) -> Option<FrontBox> {
        let reach_mm = half_mm.norm() * 0.5f64.powi(i32::from(halvings));
        let solid = &self.tool.solid;
        if solid.signed_distance_at_mm(middle_mm.xy().norm(), middle_mm.z) > reach_mm {
            return None;
        }
        let p = self.pose.end + self.ct_from_tool * middle_mm;
        if self.field.bounds(p).0 - reach_mm >= self.best_mm - self.tolerance_mm {
            return None;
        }
        let (distance_mm, at) = self.field.nearest(p);
        let (radius, height) = self.place_of(at);
        self.take_if_nearer(solid.signed_distance_at_mm(radius, height), at);
        let at_least_mm = (distance_mm - reach_mm).max(0.0);
        (at_least_mm < self.best_mm - self.tolerance_mm).then_some(FrontBox {
            at_least_mm,
            middle_mm,
            halvings,
        })
    }

    /// The direction in which the distance from the solid grows at a place.
    fn toward(&self, radius_mm: f64, height_mm: f64) -> Vector3<f64> {
        const STEP_MM: f64 = 1e-4;
        let at = |r: f64, z: f64| self.tool.solid.signed_distance_at_mm(r.abs(), z);
        let across = at(radius_mm + STEP_MM, height_mm) - at(radius_mm - STEP_MM, height_mm);
        let along = at(radius_mm, height_mm + STEP_MM) - at(radius_mm, height_mm - STEP_MM);
        let out = self.pose.out.as_ref();
        let radial = (self.at - self.pose.end - out * height_mm).try_normalize(1e-9);
        let toward = radial.unwrap_or_else(Vector3::zeros) * across + out * along;
        toward.try_normalize(1e-12).unwrap_or_else(Vector3::zeros)
    }
}

/// A box of the front, in the tool's frame.
struct FrontBox {
    at_least_mm: f64,
    middle_mm: Vector3<f64>,
    halvings: u8,
}

impl Ord for FrontBox {
    /// The nearest is the greatest; of equals the one that is halved more often.
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        let key = |b: &Self| <[f64; 3]>::from(b.middle_mm);
        other.at_least_mm.total_cmp(&self.at_least_mm).then(self.halvings.cmp(&other.halvings)).then_with(
            || {
                let (a, b) = (key(self), key(other));
                (0..3)
                    .map(|n| a[n].total_cmp(&b[n]))
                    .fold(std::cmp::Ordering::Equal, std::cmp::Ordering::then)
            },
        )
    }
}

impl PartialOrd for FrontBox {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for FrontBox {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for FrontBox {}

#[cfg(test)]
mod tests;
