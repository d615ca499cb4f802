//! Access results that stay valid from one round of dropping waypoints to the next.
//!
//! A round drops a few waypoints and keeps the order of the others, so nearly every voxel is removed by the same move as before. The
//! access of a direction can change only if its shank comes near a voxel that is removed by another move. Coarse cells with such
//! voxels are found once per round; all other results are reused. Where the rounds do not match, nothing is reused.

use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};

use bonemill_geometry::{Point, Work};
use nalgebra::Vector3;

use bonemill_stock::removal::NEVER;
use bonemill_toolpath::access::{EighthTimes, ShankCylinder, ShankObstacles};
use bonemill_toolpath::orientation::FreeSets;
use bonemill_toolpath::path::{MillPath, MoveKind, Pass, PathPoint};

/// Voxels along a side of a coarse cell.
const CELL: usize = 8;
/// Cells along a side of a group.
const GROUP: usize = 4;
/// More than a march of the access test looks past the shank, mm: a voxel or a block of the handpiece's field.
const SLACK_MM: f64 = 2.0;

/// A finished round.
#[derive(Debug)]
pub struct Round {
    /// Its path.
    pub path: MillPath,
    /// When its path takes each eighth of a voxel.
    pub eighths: EighthTimes,
    /// The directions it found free.
    pub free: FreeSets,
    /// The pass points that it put off or dropped.
    pub dropped: HashSet<(u32, u32)>,
}

/// What is known of the next round's directions.
#[derive(Debug)]
pub struct KnownDirections<'a> {
    /// What was free at the round's waypoints.
    free: &'a FreeSets,
    /// The same waypoint of the round; `None` where there was none.
    then: Vec<Option<u32>>,
    /// The cells in which a voxel goes at another move than before, in groups.
    changed: Vec<CellGroup>,
    /// From a cell's centre to its corner, mm.
    cell_mm: f64,
}

/// Neighbouring cells.
#[derive(Debug)]
struct CellGroup {
    /// Their middle, and how far the corners of the farthest are from it, mm.
    middle: Vector3<f64>,
    reach_mm: f64,
    /// Centres, mm.
    cells: Vec<Vector3<f64>>,
}

impl Round {
    /// The results of this round that hold for a path made of its remaining waypoints.
    pub fn known_of(
        &self,
        solid: &ShankObstacles,
        path: &MillPath,
        eighths: &EighthTimes,
    ) -> KnownDirections<'_> {
        let then = self.same_waypoints(path);
        let grid = solid.grid();
        let goes_as_before = |(before, now): (u32, u32)| match (before, now) {
            (NEVER, NEVER) => true,
            (NEVER, _) | (_, NEVER) => false,
            (before, now) => then[now as usize] == Some(before),
        };
        let has_changed = |voxel: usize| {
            let [before, now] = [&self.eighths, eighths].map(|eighths| eighths.of(grid.voxel(voxel)));
            !before.into_iter().zip(now).all(goes_as_before)
        };
        let mut cells = BTreeSet::new();
        for voxel in (0..grid.len()).filter(|voxel| solid.goes(*voxel) != 0 && has_changed(*voxel)) {
            cells.insert(grid.voxel(voxel).map(|i| i / CELL));
        }
        let side_mm = CELL as f64 * grid.spacing_mm().x;
        let center = |cell: &[usize; 3]| {
            let first = grid.center(cell.map(|i| i * CELL)).coords;
            first + Vector3::repeat(0.5 * (CELL as f64 - 1.0) * grid.spacing_mm().x)
        };
        let mut groups: BTreeMap<[usize; 3], Vec<Vector3<f64>>> = BTreeMap::new();
        for cell in &cells {
            groups.entry(cell.map(|i| i / GROUP)).or_default().push(center(cell));
        }
        let cell_mm = 0.5 * 3f64.sqrt() * side_mm;
        let group = |cells: Vec<Vector3<f64>>| {
            let middle = cells.iter().sum::<Vector3<f64>>() / cells.len() as f64;
            let reach_mm = cells.iter().map(|c| (c - middle).norm()).fold(0.0, f64::max) + cell_mm;
            CellGroup { middle, reach_mm, cells }
        };
        KnownDirections {
            free: &self.free,
            changed: groups.into_values().map(group).collect(),
            cell_mm,
            then,
        }
    }

    /// For every waypoint of `path` the one of this round that stands at the same place on the way to the same point of a
    /// pass; in the same order, or `None`.
    fn same_waypoints(&self, path: &MillPath) -> Vec<Option<u32>> {
        type Key = (usize, [u64; 3], MoveKind);
        let key = |place: &HashMap<(u32, u32), usize>, p: &PathPoint| -> Option<Key> {
            let bits = [p.position.x(), p.position.y(), p.position.z()].map(f64::to_bits);
            place.get(&p.leads_to).map(|place| (*place, bits, p.kind))
        };
        let kept = ordinals(&self.path.passes, |at| !self.dropped.contains(&at));
        let now = ordinals(&path.passes, |_| true);
        let mut before: HashMap<Key, u32> = HashMap::new();
        for (p, i) in self.path.points.iter().zip(0u32..) {
            if let Some(key) = key(&kept, p) {
                before.entry(key).or_insert(i);
            }
        }
        let mut last = None;
        let find = |p: &PathPoint| {
            let found = before.get(&key(&now, p)?).copied().filter(|i| last.is_none_or(|l| *i > l))?;
            last = Some(found);
            Some(found)
        };
        path.points.iter().map(find).collect()
    }
}

/// The number of every kept point of the passes, in their order.
fn ordinals(passes: &[Pass], is_kept: impl Fn((u32, u32)) -> bool) -> HashMap<(u32, u32), usize> {
    let all =
        passes.iter().zip(0u32..).flat_map(|(pass, n)| (0..pass.points.len() as u32).map(move |m| (n, m)));
    all.filter(|at| is_kept(*at)).enumerate().map(|(place, at)| (at, place)).collect()
}

impl KnownDirections<'_> {
    /// Whether direction n was free at the same waypoint; `None` where there was none.
    pub fn was_free(&self, i: usize, n: usize) -> Option<bool> {
        self.then[i].map(|i| self.free.contains(i as usize, n))
    }

    /// Whether the shank along `axis` comes near a cell in which something has changed.
    pub fn may_have_changed(
        &self,
        center: Point<Work>,
        axis: &Vector3<f64>,
        shank: &[ShankCylinder],
    ) -> bool {
        let is_near = |place: &Vector3<f64>, reach_mm: f64| {
            let from = place - center.coords;
            let along = from.dot(axis);
            shank.iter().any(|cylinder| {
                let nearest = axis * along.clamp(cylinder.from_mm, cylinder.to_mm);
                (from - nearest).norm() <= cylinder.radius_mm + reach_mm + SLACK_MM
            })
        };
        self.changed.iter().any(|group| {
            is_near(&group.middle, group.reach_mm)
                && group.cells.iter().any(|cell| is_near(cell, self.cell_mm))
        })
    }
}
