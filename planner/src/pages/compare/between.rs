//! Distances between two paths: positions and shaft directions along their cuts, and the swept volumes on a common grid.

use bonemill_geometry::{Ct, Grid, Point, Work, cancel};
use nalgebra::Vector3;
use rayon::prelude::*;

use bonemill_cutting::cutter::{Ball, MoveKind};
use bonemill_cutting::stock::removal::RemovalTime;
use bonemill_planfile::StoredPlan;

/// Distance between positions along a cut, mm.
const STEP_MM: f64 = 0.25;
/// Number of cuts that share a bounding box, which is tested first.
const AT_ONCE: usize = 64;
/// Positions whose distances differ by at most this are equally near, mm.
const AS_NEAR_MM: f64 = 0.01;
/// Values that differ by less than this are equal up to rounding: mm, rad, entries of a rotation.
const SAME: f64 = 1e-9;

/// Distances between the cuts of two plans in ct. Positions every 0.25 mm along the cuts of each plan are compared with the
/// nearest position on the other's cuts; where several are equally near (to 0.01 mm), the smallest angle counts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BetweenPlans {
    /// Largest distance, of either plan's cuts from the other's, mm (Hausdorff); `None` where a plan has no cuts.
    pub hausdorff_mm: Option<f64>,
    /// Mean distance over the positions of both plans, mm.
    pub mean_distance_mm: Option<f64>,
    /// Mean angle between the shafts at these positions, degrees.
    pub mean_angle_deg: Option<f64>,
    /// Largest angle, degrees.
    pub largest_angle_deg: Option<f64>,
    /// Volume that the burr's ball sweeps, air included, counted on voxel centres of the planning grid, mm³: in both plans, only in
    /// the first, only in the second; `None` where the plans' grids differ.
    pub swept_mm3: Option<[f64; 3]>,
}

/// A move that cuts.
struct Cut {
    from: Point<Ct>,
    to: Point<Ct>,
    axes: [Vector3<f64>; 2],
}

/// Cuts and the corners of their bounding box.
struct Bundle<'a> {
    cuts: &'a [Cut],
    low: Vector3<f64>,
    high: Vector3<f64>,
}

impl BetweenPlans {
    /// The distances between two plans.
    pub fn of(plans: [&StoredPlan; 2]) -> Self {
        let cuts = plans.map(cuts);
        let [a, b] = cuts.each_ref().map(|cuts| bundles(cuts));
        let mut apart = apart(&cuts[0], &b);
        apart.extend(self::apart(&cuts[1], &a));
        let largest = |of: fn(&(f64, f64)) -> f64| apart.iter().map(of).reduce(f64::max);
        let mean = |of: fn(&(f64, f64)) -> f64| {
            let sum: f64 = apart.iter().map(of).sum();
            (!apart.is_empty()).then(|| sum / apart.len() as f64)
        };
        Self {
            hausdorff_mm: largest(|(mm, _)| *mm),
            mean_distance_mm: mean(|(mm, _)| *mm),
            mean_angle_deg: mean(|(_, rad)| *rad).map(f64::to_degrees),
            largest_angle_deg: largest(|(_, rad)| *rad).map(f64::to_degrees),
            swept_mm3: swept_mm3(plans),
        }
    }

    /// Names and values of the figures that are known.
    pub fn entries(&self) -> Vec<(&'static str, f64)> {
        let swept = |n: usize| self.swept_mm3.map(|mm3| mm3[n]);
        let all = [
            ("hausdorff_mm", self.hausdorff_mm),
            ("mean_distance_mm", self.mean_distance_mm),
            ("mean_angle_deg", self.mean_angle_deg),
            ("largest_angle_deg", self.largest_angle_deg),
            ("swept_by_both_mm3", swept(0)),
            ("swept_by_first_alone_mm3", swept(1)),
            ("swept_by_second_alone_mm3", swept(2)),
        ];
        all.into_iter().filter_map(|(name, value)| Some((name, value?))).collect()
    }
}

fn cuts(plan: &StoredPlan) -> Vec<Cut> {
    let moves = plan.waypoints.windows(2).filter(|pair| pair[1].kind == MoveKind::Cut);
    let cut = |pair: &[bonemill_planfile::Waypoint]| Cut {
        from: pair[0].position,
        to: pair[1].position,
        axes: [pair[0].axis, pair[1].axis],
    };
    moves.map(cut).collect()
}

fn bundles(cuts: &[Cut]) -> Vec<Bundle<'_>> {
    let around = |cuts: &'_ [Cut]| {
        let ends = || cuts.iter().flat_map(|cut| [cut.from.coords, cut.to.coords]);
        let corner = |pick: fn(f64, f64) -> f64, start: f64| {
            ends().fold(Vector3::repeat(start), |corner, end| corner.zip_map(&end, pick))
        };
        [corner(f64::min, f64::INFINITY), corner(f64::max, f64::NEG_INFINITY)]
    };
    cuts.chunks(AT_ONCE)
        .map(|cuts| {
            let [low, high] = around(cuts);
            Bundle { cuts, low, high }
        })
        .collect()
}

/// Distance (mm) and angle (rad) from every position of `cuts` to the nearest position of the others; empty without any.
fn apart(cuts: &[Cut], others: &[Bundle<'_>]) -> Vec<(f64, f64)> {
    if others.is_empty() {
        return Vec::new();
    }
    let of_cut = |cut: &Cut| -> Vec<(f64, f64)> {
        cancel::poll();
        let way = cut.to - cut.from;
        let parts = (way.norm() / STEP_MM).ceil().clamp(1.0, 1e4) as usize;
        let place = |n: usize| {
            let share = n as f64 / parts as f64;
            nearest(cut.from + way * share, &axis_at(&cut.axes, share), others)
        };
        (1..=parts).map(place).collect()
    };
    cuts.par_iter().flat_map_iter(of_cut).collect()
}

fn axis_at([from, to]: &[Vector3<f64>; 2], share: f64) -> Vector3<f64> {
    from.lerp(to, share).try_normalize(0.0).unwrap_or(*to)
}

/// Distance from a position to the nearest of some cuts, and the angle between the shafts; the smallest angle where several
/// cuts are equally near.
fn nearest(place: Point<Ct>, axis: &Vector3<f64>, others: &[Bundle<'_>]) -> (f64, f64) {
    let (mut least_mm, mut near) = (f64::INFINITY, Vec::new());
    for bundle in others {
        let inside = place.coords.zip_zip_map(&bundle.low, &bundle.high, f64::clamp);
        if (place.coords - inside).norm() > least_mm + AS_NEAR_MM {
            continue;
        }
        for cut in bundle.cuts {
            let (way, off) = (cut.to - cut.from, place - cut.from);
            let length2 = way.norm_squared();
            let share = if length2 > 0.0 { (off.dot(&way) / length2).clamp(0.0, 1.0) } else { 0.0 };
            let distance_mm = (off - way * share).norm();
            if distance_mm <= least_mm + AS_NEAR_MM {
                near.push((distance_mm, axis_at(&cut.axes, share)));
                least_mm = least_mm.min(distance_mm);
            }
        }
    }
    let angle = |other: &Vector3<f64>| axis.cross(other).norm().atan2(axis.dot(other));
    let as_near = near.iter().filter(|(mm, _)| *mm <= least_mm + AS_NEAR_MM);
    let angle_rad = as_near.map(|(_, other)| angle(other)).fold(f64::INFINITY, f64::min);
    [least_mm, angle_rad].map(|v| if v < SAME { 0.0 } else { v }).into()
}

/// Volumes of the voxels whose centres the burr sweeps in both plans, and in only one of them.
fn swept_mm3(plans: [&StoredPlan; 2]) -> Option<[f64; 3]> {
    let [a, b] = plans.map(|plan| &plan.record);
    let (frame, other) = (a.frames.ct_from_grid(), b.frames.ct_from_grid());
    let turned = (frame.rotation.matrix() - other.rotation.matrix()).amax();
    let moved = (frame.translation_mm - other.translation_mm).amax();
    let spacing_mm = a.case.grid.spacing_mm;
    if a.frames.grid.dims != b.frames.grid.dims
        || spacing_mm != b.case.grid.spacing_mm
        || turned.max(moved) > SAME
    {
        return None;
    }
    let grid = Grid::<Work>::aligned(a.frames.grid.dims, spacing_mm, Point::new(0.0, 0.0, 0.0)).ok()?;
    let work_from_ct = frame.inverse();
    let [a, b] = plans.map(|plan| {
        let path: Vec<_> = plan.waypoints.iter().map(|w| work_from_ct * w.position).collect();
        let mut removal = RemovalTime::new(&grid);
        let radius_mm = plan.record.cutter_radius_mm();
        removal.sweep(0..path.len() as u32, |n| path[n as usize], Ball { radius_mm }, |_| ());
        removal
    });
    let mut counts = [0usize; 3];
    for voxel in 0..grid.len() {
        match (a.is_removed(voxel), b.is_removed(voxel)) {
            (true, true) => counts[0] += 1,
            (true, false) => counts[1] += 1,
            (false, true) => counts[2] += 1,
            (false, false) => {}
        }
    }
    Some(counts.map(|n| n as f64 * spacing_mm.powi(3)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Cuts of 1 mm along x at a height, the shaft tilted by an angle.
    fn line(y_mm: f64, count: usize, tilt_rad: f64) -> Vec<Cut> {
        let axis = Vector3::new(0.0, tilt_rad.sin(), tilt_rad.cos());
        let at = |n: usize| Point::new(n as f64, y_mm, 0.0);
        (0..count).map(|n| Cut { from: at(n), to: at(n + 1), axes: [axis; 2] }).collect()
    }

    #[test]
    fn parallel_lines_are_as_far_apart_as_they_are_and_overhangs_farther() {
        let (a, b) = (line(0.0, 200, 0.0), line(0.5, 200, 0.3));
        let found = apart(&a, &bundles(&b));
        assert_eq!(found.len(), 800);
        assert!(found.iter().all(|(mm, rad)| (mm - 0.5).abs() < 1e-12 && (rad - 0.3).abs() < 1e-12));
        // 200 mm against 203: the last 3 mm are up to hypot(3, 0.5) away
        let longer = line(0.5, 203, 0.0);
        let far = apart(&longer, &bundles(&a)).into_iter().map(|(mm, _)| mm).fold(0.0, f64::max);
        assert!((far - 3f64.hypot(0.5)).abs() < 1e-12, "{far}");
        assert!(apart(&a, &bundles(&[])).is_empty());
        // a path that is followed twice, the second time tilted, is the same path
        let twice: Vec<Cut> = line(0.0, 200, 0.0).into_iter().chain(line(0.0, 200, 0.7)).collect();
        assert!(apart(&twice, &bundles(&twice)).iter().all(|apart| *apart == (0.0, 0.0)));
    }
}
