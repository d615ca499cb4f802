//! Checks the shank against everything that stands, by brute force, at every waypoint and along the joint trajectory.
//!
//! Bone stands until the first move whose ball reaches it. At a pose on the way to waypoint i, everything stands that no move
//! before i reached. Structures always stand. Near the target, bone is tested on the fine lattice, elsewhere at the CT's own
//! voxels; structures are tested by their exact boxes. The trajectory is sampled so densely that no point of the shank within
//! [`REACH_MM`] moves farther than [`STRIDE_MM`] between two samples.

use bonemill_case::{Case, Sheets};
use bonemill_geometry::{Ct, Point, Rigid, Work, cancel};
use bonemill_planfile::StoredPlan;
use nalgebra::Vector3;
use rayon::prelude::*;

use super::boxes::Boxes;
use super::bricks::{Bricks, Cylinder};
use super::carve::NEVER;
use super::check::{Check, Place};
use super::lattice::{FineLattice, MATERIAL, OBSTACLE};
use super::moves::{Executed, Moves};
use super::target::TargetRule;
use super::voxels::{Doubtful, is_speck};

/// Length of the part of the shank that is near the bone, mm from the burr's centre.
const REACH_MM: f64 = 30.0;
/// Largest motion between two tested poses, mm.
const STRIDE_MM: f64 = 0.12;
/// Accuracy of the distance from the shank to a structure, mm.
const TOLERANCE_MM: f64 = 0.02;
/// A search determines distances up to the least found so far plus this, mm; a larger known distance lets more of the
/// following poses be skipped.
const AHEAD_MM: f64 = 0.5;
/// The same for the lower bound that is computed before a search, mm.
const LOOK_AHEAD_MM: f64 = 4.0;
/// Number of poses that one task searches; fixed, so that the result does not depend on the number of threads.
const PORTION: usize = 512;

/// A pose of the shank.
#[derive(Debug, Clone)]
pub struct ShankPose {
    center: Vector3<f64>,
    axis: Vector3<f64>,
    /// Number of the move during which the shank is there.
    moment: u32,
    place: Place,
}

/// The shank as cylinders; the first begins at the burr's radius.
pub fn cylinders(case: &Case) -> Vec<Cylinder> {
    let mut from_mm = case.burr.radius_mm;
    let cylinder = |segment: &bonemill_case::ShankSegment| {
        let to_mm = from_mm + segment.length_mm;
        let cylinder = Cylinder { from_mm, to_mm, radius_mm: segment.radius_mm };
        from_mm = to_mm;
        cylinder
    };
    case.shank.iter().map(cylinder).collect()
}

/// All waypoints, and the trajectory's rows a stride apart.
pub fn poses(plan: &StoredPlan, moves: &Moves, executed: &Executed) -> Vec<ShankPose> {
    let at_waypoint = |n: usize| ShankPose {
        center: moves.points[n],
        axis: moves.axes[n],
        moment: n as u32,
        place: Place::Waypoint(n),
    };
    let mut poses: Vec<ShankPose> = (0..moves.len()).map(at_waypoint).collect();
    let mut last: Option<(Vector3<f64>, Vector3<f64>, u32)> = None;
    for row in 0..executed.len() {
        let (center, axis, moment) = (executed.points[row], executed.axes[row], executed.next[row]);
        let moved = last.is_none_or(|(c, a, m)| {
            let way = (center - c).norm() + (axis - a).norm() * REACH_MM;
            // at the first row of a move the most bone stands
            way > STRIDE_MM || (moment != m && way > 0.5 * STRIDE_MM)
        });
        if moved {
            last = Some((center, axis, moment));
            let time_s = plan.trajectory.time_s[row];
            poses.push(ShankPose {
                center,
                axis,
                moment,
                place: Place::Instant { time_s, waypoint: moment as usize },
            });
        }
    }
    poses
}

/// The points of the fine lattice with the moves until which they stand; `first` is the first move at each point.
pub fn standing(lattice: &FineLattice, first: &[u32]) -> [Bricks<Work>; 2] {
    let target = lattice.class.iter().zip(first).map(|(class, first)| {
        // a point first reached by move i stands before every move up to and including i
        if class & MATERIAL == 0 { 0 } else { first.saturating_add(1) }
    });
    let outside = lattice.class.iter().zip(first).map(|(class, first)| {
        // another check tests whether the burr may remove it; here bone that it removed no longer stands
        if class & OBSTACLE == 0 { 0 } else { first.saturating_add(1) }
    });
    [
        Bricks::new(lattice.grid.clone(), target.collect()),
        Bricks::new(lattice.grid.clone(), outside.collect()),
    ]
}

/// Bone outside the target and outside the lattice, at the CT's voxels, without specks; if the case has sheets cut, only voxels
/// that belong to a cube of 2×2×2 bone voxels.
pub fn far_bone(
    target: &TargetRule<'_>,
    case: &Case,
    lattice: &FineLattice,
    grid_from_ct: &Rigid<Work, Ct>,
) -> Bricks<Ct> {
    let anatomy = target.anatomy();
    let grid = anatomy.ct.grid();
    let [nx, ny, nz] = grid.dims();
    let is_bone: Vec<bool> =
        anatomy.ct.data().par_iter().map(|hu| f64::from(*hu) >= case.density.bone_hu).collect();
    let is_target = |p: Point<Ct>| target.drawn(p, &|is| Doubtful::sure(is(anatomy.label(p)))).possibly;
    // the corner of a full cube, looking back by 0 or 1 along each axis
    let thick = |i: usize, j: usize, k: usize| {
        (0..8usize).any(|c| {
            let low = [(i, c & 1), (j, c >> 1 & 1), (k, c >> 2 & 1)].map(|(v, back)| v.wrapping_sub(back));
            let [x, y, z] = low;
            x < nx - 1
                && y < ny - 1
                && z < nz - 1
                && (0..8usize)
                    .all(|d| is_bone[x + (d & 1) + nx * (y + (d >> 1 & 1) + ny * (z + (d >> 2 & 1)))])
        })
    };
    let stays = |[i, j, k]: [usize; 3], n: usize| {
        thick(i, j, k) || case.sheets == Sheets::Keep && !is_speck([nx, ny, nz], &|m| is_bone[m], n)
    };
    let near = |p: Point<Ct>| lattice.grid.nearest(*grid_from_ct * p).is_some();
    let mut until = vec![0; grid.len()];
    until.par_chunks_mut(nx * ny).enumerate().for_each(|(k, slab)| {
        cancel::poll();
        for (n, until) in slab.iter_mut().enumerate() {
            let (i, j) = (n % nx, n / nx);
            let p = grid.center([i, j, k]);
            let place = n + k * nx * ny;
            if is_bone[place] && !near(p) && !is_target(p) && stays([i, j, k], place) {
                *until = NEVER;
            }
        }
    });
    Bricks::new(grid.clone(), until)
}

/// Checks the shank against bone of the target that still stands, and against bone outside it.
pub fn against_bone(
    poses: &[ShankPose],
    cylinders: &[Cylinder],
    [target, outside]: &[Bricks<Work>; 2],
    far: &Bricks<Ct>,
    ct_from_grid: &Rigid<Ct, Work>,
) -> Vec<Check> {
    let deepest = |ask: &(dyn Fn(&ShankPose, &Cylinder) -> Option<f64> + Sync)| -> Option<(f64, usize)> {
        let of = |pose: &ShankPose| {
            cancel::poll();
            cylinders.iter().filter_map(|c| ask(pose, c)).max_by(f64::total_cmp)
        };
        let found: Vec<Option<f64>> = poses.par_iter().map(of).collect();
        let found = found.into_iter().enumerate().filter_map(|(n, depth)| Some((depth?, n)));
        // of equal ones the first
        found.reduce(|a, b| if b.0 > a.0 { b } else { a })
    };
    let check = |name, found: Option<(f64, usize)>| {
        let check = Check::at_most(name, found.map_or(-super::bricks::LOOK_MM, |f| f.0), 0.0, "mm deep");
        match found {
            Some((_, n)) => check.at(poses[n].place.clone()),
            None => check.noting("nothing that near"),
        }
    };
    let on = |bricks: &'_ Bricks<Work>| {
        deepest(&|p: &ShankPose, c: &Cylinder| bricks.deepest(&p.center, &p.axis, c, p.moment).map(|f| f.0))
    };
    let far = deepest(&|p: &ShankPose, c: &Cylinder| {
        let center = (*ct_from_grid * Point::<Work>::from_coords(p.center)).coords;
        far.deepest(&center, &ct_from_grid.rotate(&p.axis), c, p.moment).map(|f| f.0)
    });
    vec![
        check("shank in target bone that still stands", on(target)),
        check("shank in bone outside the target", on(outside)),
        check("shank in bone far from the target", far),
    ]
}

/// The least distance from the shank's surface to a structure over all poses, mm, accurate to [`TOLERANCE_MM`].
///
/// Larger distances than `most_mm` are reported as `most_mm`.
pub fn against_structure(
    poses: &[ShankPose],
    cylinders: &[Cylinder],
    boxes: &Boxes<'_>,
    ct_from_grid: &Rigid<Ct, Work>,
    most_mm: f64,
) -> Option<(f64, Option<Place>)> {
    let end_mm = cylinders.iter().map(|c| c.to_mm + c.radius_mm).fold(0.0, f64::max);
    let portions: Vec<(f64, Option<usize>)> = poses
        .par_chunks(PORTION)
        .enumerate()
        .map(|(portion, poses)| {
            cancel::poll();
            let mut best = (most_mm, None);
            // lower bound of the shank's distance since the last search
            let mut nearest_mm = 0.0;
            for (n, pose) in poses.iter().enumerate() {
                if let Some(before) = n.checked_sub(1).and_then(|b| poses.get(b)) {
                    nearest_mm -=
                        (pose.center - before.center).norm() + (pose.axis - before.axis).norm() * end_mm;
                }
                if nearest_mm >= best.0 {
                    continue;
                }
                nearest_mm = kept_by_capsules(boxes, ct_from_grid, pose, cylinders, best.0 + LOOK_AHEAD_MM);
                if nearest_mm >= best.0 {
                    continue;
                }
                let mut search = ShankDistanceSearch { boxes, ct_from_grid, pose, best: best.0 + AHEAD_MM };
                cylinders.iter().for_each(|cylinder| search.cylinder(cylinder));
                nearest_mm = search.best - TOLERANCE_MM;
                if search.best < best.0 {
                    best = (search.best, Some(portion * PORTION + n));
                }
            }
            best
        })
        .collect();
    let (least, n) = portions.into_iter().reduce(|a, b| if b.0 < a.0 { b } else { a })?;
    Some(((least - TOLERANCE_MM).max(0.0), n.and_then(|n| poses.get(n)).map(|p| p.place.clone())))
}

/// A lower bound of the shank's distance from a structure, mm, at most `cut_mm`; computed with capsules around the cylinders.
fn kept_by_capsules(
    boxes: &Boxes<'_>,
    ct_from_grid: &Rigid<Ct, Work>,
    pose: &ShankPose,
    cylinders: &[Cylinder],
    cut_mm: f64,
) -> f64 {
    let at = |along_mm: f64| *ct_from_grid * Point::<Work>::from_coords(pose.center + pose.axis * along_mm);
    let kept =
        |c: &Cylinder| boxes.kept_by_line(at(c.from_mm), at(c.to_mm), cut_mm + c.radius_mm) - c.radius_mm;
    cylinders.iter().map(kept).fold(cut_mm, f64::min)
}

/// Branch and bound over the points inside the shank; the distance changes no faster than the point moves.
struct ShankDistanceSearch<'a> {
    boxes: &'a Boxes<'a>,
    ct_from_grid: &'a Rigid<Ct, Work>,
    pose: &'a ShankPose,
    best: f64,
}

impl ShankDistanceSearch<'_> {
    /// The distance from a point, if it is below `cut_mm`.
    fn distance_below(&self, p: Vector3<f64>, cut_mm: f64) -> Option<f64> {
        let p = *self.ct_from_grid * Point::<Work>::from_coords(p);
        self.boxes.nearest_within(p, cut_mm).map(|(d, _)| d)
    }

    fn cylinder(&mut self, cylinder: &Cylinder) {
        let frame = bonemill_geometry::basis::from_z(&self.pose.axis);
        let half =
            Vector3::new(cylinder.radius_mm, cylinder.radius_mm, 0.5 * (cylinder.to_mm - cylinder.from_mm));
        let middle = Vector3::new(0.0, 0.0, 0.5 * (cylinder.to_mm + cylinder.from_mm));
        self.cell(&frame, cylinder.radius_mm, middle, half);
    }

    /// A box in the shank's frame; halved along its longest side until it cannot be nearer than the best.
    fn cell(
        &mut self,
        frame: &nalgebra::Rotation3<f64>,
        radius_mm: f64,
        middle: Vector3<f64>,
        half: Vector3<f64>,
    ) {
        // the box's point nearest to the axis decides whether the box contains a part of the cylinder
        let off = |c: f64, h: f64| (c.abs() - h).max(0.0);
        if off(middle.x, half.x).hypot(off(middle.y, half.y)) > radius_mm {
            return;
        }
        // the tested point must lie in the cylinder: the middle of the box, moved towards the axis
        let away = middle.x.hypot(middle.y);
        let draw = if away > radius_mm { radius_mm / away } else { 1.0 };
        let asked = Vector3::new(middle.x * draw, middle.y * draw, middle.z);
        let reach = half.norm() + (middle - asked).norm();
        let Some(d) = self.distance_below(self.pose.center + frame * asked, self.best + reach) else {
            return;
        };
        self.best = self.best.min(d);
        if d - reach >= self.best - TOLERANCE_MM || reach < 0.5 * TOLERANCE_MM {
            return;
        }
        let axis = half.imax();
        let mut smaller = half;
        smaller[axis] *= 0.5;
        for side in [-1.0, 1.0] {
            let mut part = middle;
            part[axis] += side * smaller[axis];
            self.cell(frame, radius_mm, part, smaller);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bonemill_geometry::Grid;

    #[test]
    fn bone_stands_until_the_burr_takes_it_whether_it_may_or_not() {
        let grid = Grid::aligned([4, 1, 1], 0.5, Point::new(0.0, 0.0, 0.0)).unwrap();
        let class = vec![MATERIAL, OBSTACLE, OBSTACLE, 0];
        let lattice = FineLattice { grid, class };
        let [target, outside] = standing(&lattice, &[3, 3, NEVER, NEVER]);
        let cylinder = Cylinder { from_mm: 0.3, to_mm: 5.0, radius_mm: 0.2 };
        let stands = |bricks: &Bricks<Work>, n: usize, moment| {
            let center = Vector3::new(0.5 * n as f64, 0.0, -1.0);
            bricks.deepest(&center, &Vector3::z(), &cylinder, moment).is_some_and(|found| found.0 > 0.0)
        };
        assert!(stands(&target, 0, 3) && !stands(&target, 0, 4));
        assert!(stands(&outside, 1, 3) && !stands(&outside, 1, 4));
        assert!(stands(&outside, 2, NEVER - 1) && !stands(&outside, 3, 0));
    }
}
