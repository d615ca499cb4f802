//! Builds a path: joins passes by links and keeps the removal-time field up to date.

use crate::scene::Class;
use bonemill_cutting::stock::removal::RemovalTime;
use bonemill_cutting::stock::sweep::Rows;
use bonemill_cutting::stock::voxels::VoxelSet;
use bonemill_geometry::{Point, Work};

use super::search::LinkSearch;
use super::{MillPath, MoveKind, Pass, PathPoint, PathSpacing, pieces};
use crate::space::BurrSpace;

/// Distance between waypoints of a link, in cutting steps.
const LINK_STEPS: f64 = 4.0;
/// Passes whose ends are nearer than this many stepovers are joined by a straight cut.
const ADJACENT_STEPOVERS: f64 = 1.6;
/// Largest number of waypoints that the burr goes back before it retracts.
const BACK_OUT: usize = 40;
/// A retract may remove cusps up to this share of a ball's volume. More than this is a ledge, which the shank would meet
/// first.
const CUSPS_SHARE: f64 = 0.02;
/// Number of failed searches for a way in from outside, after which only passes with nothing above them may begin the path.
const MOST_VAIN_STARTS: usize = 20;
/// Searches for a way between passes that may fail, so that a body of many holes ends; passes beyond are reported as unjoined.
const MOST_VAIN_WAYS: usize = 300;
/// Distance between the heights that are tried for a retract, mm.
const RETRACT_STEP_MM: f64 = 0.5;

/// Grows a path pass by pass.
#[derive(Debug)]
pub struct Builder<'a> {
    space: &'a BurrSpace<'a>,
    spacing: PathSpacing,
    points: Vec<PathPoint>,
    /// Number of moves that `removal` contains already.
    swept: usize,
    passes: Vec<Pass>,
    removal: RemovalTime,
    search: LinkSearch,
    rows: Rows,
    /// Voxels with mass, and reachable target, that still stand.
    material: VoxelSet,
    reachable: VoxelSet,
    /// Number of reachable target voxels that still stand.
    left: usize,
    unjoined: usize,
    /// Positions where a path may begin, once they are computed.
    tops: Option<Vec<Point<Work>>>,
    vain_starts: usize,
    vain_ways: usize,
    /// The pass, and the point of it, to which the burr is moving.
    heading: (u32, u32),
}

impl<'a> Builder<'a> {
    /// An empty path.
    pub fn new(space: &'a BurrSpace<'a>, spacing: PathSpacing) -> Self {
        let (class, reachable) = (space.scene().class.data(), space.reachable());
        Self {
            space,
            spacing,
            points: Vec::new(),
            swept: 0,
            passes: Vec::new(),
            removal: RemovalTime::new(space.grid()),
            search: LinkSearch::new(space),
            rows: space.rows(),
            material: VoxelSet::of(class.len(), |voxel| class[voxel].is(Class::HAS_MASS)),
            reachable: VoxelSet::of(reachable.len(), |voxel| reachable[voxel]),
            left: reachable.iter().filter(|r| **r).count(),
            unjoined: 0,
            tops: None,
            vain_starts: 0,
            vain_ways: 0,
            heading: (0, 0),
        }
    }

    /// The burr's free space.
    pub fn space(&self) -> &'a BurrSpace<'a> {
        self.space
    }

    /// Lengths that shape the path.
    pub fn spacing(&self) -> PathSpacing {
        self.spacing
    }

    /// Number of reachable target voxels that still stand.
    pub fn left(&self) -> usize {
        self.left
    }

    /// The reachable target voxels that still stand.
    pub fn reachable_left(&self) -> &VoxelSet {
        &self.reachable
    }

    /// The burr's present position.
    pub fn position(&self) -> Option<Point<Work>> {
        self.points.last().map(|p| p.position)
    }

    /// Number of reachable target voxels that the burr at `p` would remove; counting stops at about `enough`.
    pub fn gain(&self, p: Point<Work>, enough: usize) -> usize {
        self.reachable.count_within(&self.rows, [p, p], self.space.radius_mm(), enough)
    }

    /// Whether the move a–b removes no material.
    pub fn is_free(&self, a: Point<Work>, b: Point<Work>) -> bool {
        self.met(a, b, None).is_none()
    }

    /// The voxel at a position, if it still has material.
    pub fn material_at(&self, p: Point<Work>) -> Option<usize> {
        let grid = self.space.grid();
        let voxel = grid.index(grid.nearest(p)?);
        self.material.contains(voxel).then_some(voxel)
    }

    /// A voxel of material that the move a–b would remove. `before` is tested first, because similar moves are likely to meet the
    /// same voxel.
    pub fn met(&self, a: Point<Work>, b: Point<Work>, before: Option<usize>) -> Option<usize> {
        let radius_mm = self.space.radius_mm();
        let still_met = before
            .filter(|voxel| self.material.contains(*voxel) && self.rows.is_within(*voxel, a, b, radius_mm));
        still_met.or_else(|| self.material.first_within(&self.rows, [a, b], radius_mm))
    }

    /// Joins `pass` to the path and cuts it. Returns false and changes nothing if there is no link to it.
    pub fn add(&mut self, pass: Pass) -> bool {
        let number = self.passes.len() as u32;
        let before = std::mem::replace(&mut self.heading, (number, 0));
        let Some(entry) = self.enter(&pass) else {
            self.heading = before;
            self.unjoined += 1;
            return false;
        };
        // if the pass' start lies under a ledge, it is entered from a later point: first back to the start, then along the pass
        for n in (0..entry).rev() {
            self.heading = (number, n as u32);
            self.lay_cut(pass.points[n], pass.layer);
        }
        for (p, n) in pass.points.iter().zip(0u32..).skip(1) {
            self.heading = (number, n);
            self.lay_cut(*p, pass.layer);
        }
        self.sweep();
        self.passes.push(pass);
        true
    }

    /// Goes to the first point of a pass that can be reached, and returns the point's number. It tries a short straight cut, a
    /// straight link, and a retract out of the bone and back in, if necessary from a position that the burr has just left; if
    /// all fail, a search.
    fn enter(&mut self, pass: &Pass) -> Option<usize> {
        let (first, layer) = (*pass.points.first()?, pass.layer);
        let Some(from) = self.position() else { return self.begin(pass) };
        if pass.from_above
            && let Some(entry) = self.retract_to(pass)
        {
            return Some(entry);
        }
        if from.distance_mm(&first) <= ADJACENT_STEPOVERS * self.spacing.stepover_mm
            && self.is_way_clear(from, first)
        {
            self.cut_to(first, layer);
            return Some(0);
        }
        if self.is_way_free(from, first) {
            self.travel_to(first, MoveKind::Link, layer);
            return Some(0);
        }
        if let Some(entry) = self.retract_to(pass) {
            return Some(entry);
        }
        if self.vain_ways >= MOST_VAIN_WAYS {
            return None;
        }
        let Some(way) = self.find_way(from, first) else {
            self.vain_ways += 1;
            return None;
        };
        self.follow(&way, layer);
        Some(0)
    }

    /// Searches a way.
    fn find_way(&mut self, from: Point<Work>, to: Point<Work>) -> Option<Vec<Point<Work>>> {
        let mut search = std::mem::take(&mut self.search);
        let way = search.way(self, from, to);
        self.search = search;
        way
    }

    /// Follows a way; moves that remove material are cuts.
    fn follow(&mut self, way: &[Point<Work>], layer: u32) {
        for p in way {
            let here = self.points[self.points.len() - 1].position;
            if self.is_free(here, *p) {
                self.travel_to(*p, MoveKind::Link, layer);
            } else {
                self.cut_to(*p, layer);
            }
        }
    }

    /// Starts the path in free space: above the pass' first point with nothing above it; else at the nearest position at the top,
    /// from which a search finds a way. `None` if both fail.
    fn begin(&mut self, pass: &Pass) -> Option<usize> {
        let may_start =
            |p: &Point<Work>| self.is_open_above(*p) && self.is_free(self.above(*p), self.above(*p));
        if let Some(entry) = pass.points.iter().position(may_start) {
            self.push(self.above(pass.points[entry]), MoveKind::Link, pass.layer);
            self.lift_or_plunge(pass.points[entry], pass.layer);
            return Some(entry);
        }
        let first = *pass.points.first()?;
        if self.vain_starts >= MOST_VAIN_STARTS {
            return None;
        }
        if self.tops.is_none() {
            self.tops = Some(self.find_tops());
        }
        let nearest =
            self.tops.iter().flatten().min_by(|a, b| a.distance_mm(&first).total_cmp(&b.distance_mm(&first)));
        let start = *nearest?;
        let Some(way) = self.find_way(start, first) else {
            self.vain_starts += 1;
            return None;
        };
        self.push(start, MoveKind::Link, pass.layer);
        self.follow(&way, pass.layer);
        Some(0)
    }

    /// The highest positions where the burr may be and removes nothing.
    fn find_tops(&self) -> Vec<Point<Work>> {
        let (grid, connected) = (self.space.grid(), self.space.connected());
        let Some(highest) = connected.iter().rposition(|c| *c) else { return Vec::new() };
        let layer = grid.dims()[0] * grid.dims()[1];
        let nodes = highest / layer * layer..=highest;
        let centers = nodes.filter(|node| connected[*node]).map(|node| grid.center(grid.voxel(node)));
        centers.filter(|p| self.is_free(*p, *p)).collect()
    }

    /// Moves out of the bone along the approach and into `pass` at its first point with nothing above it; as high as the burr may
    /// be if the pass requires that.
    fn retract_to(&mut self, pass: &Pass) -> Option<usize> {
        let back = self.way_back()?;
        let entry = pass.points.iter().position(|p| self.is_open_above(*p))?;
        let (from, to) = (*back.last()?, pass.points[entry]);
        let lowest = if pass.from_above { self.above(from) } else { from };
        let height = self.crossing_height(lowest, to)?;
        for p in back.into_iter().skip(1) {
            self.travel_to(p, MoveKind::Link, pass.layer);
        }
        self.lift_or_plunge(Point::new(from.x(), from.y(), height), pass.layer);
        self.travel_to(Point::new(to.x(), to.y(), height), MoveKind::Link, pass.layer);
        self.lift_or_plunge(to, pass.layer);
        Some(entry)
    }

    /// The way back along the path from the burr's position to one from which it can retract: from under a ledge it leaves as it
    /// entered. If there is none, the way to a position above which there is only bone of the target.
    fn way_back(&self) -> Option<Vec<Point<Work>>> {
        let last = self.points.len().checked_sub(1)?;
        let came_by = (last.saturating_sub(BACK_OUT)..=last).rev().map(|n| self.points[n].position);
        let is_open = |p: &Point<Work>| self.is_open_above(*p);
        let back = came_by
            .clone()
            .position(|p| is_open(&p) && self.takes_cusps_only(p))
            .or_else(|| came_by.clone().position(|p| is_open(&p)))?;
        Some(came_by.take(back + 1).collect())
    }

    /// Whether the way straight up along the approach is free of bone outside the target and of structures.
    fn is_open_above(&self, p: Point<Work>) -> bool {
        self.is_way_clear(p, self.above(p))
    }

    /// Whether only cusps are above the burr.
    fn takes_cusps_only(&self, p: Point<Work>) -> bool {
        let most = (CUSPS_SHARE * self.space.ball_voxels()) as usize + 1;
        self.material.count_within(&self.rows, [p, self.above(p)], self.space.radius_mm(), most) < most
    }

    /// The lowest height at which the move across is clear and free.
    fn crossing_height(&self, from: Point<Work>, to: Point<Work>) -> Option<f64> {
        let top = self.above(from).z();
        let lowest = from.z().max(to.z());
        let steps = ((top - lowest) / RETRACT_STEP_MM).ceil().max(0.0) as usize;
        (0..=steps).map(|n| (lowest + n as f64 * RETRACT_STEP_MM).min(top)).find(|height| {
            self.is_way_free(Point::new(from.x(), from.y(), *height), Point::new(to.x(), to.y(), *height))
        })
    }

    /// Ends the path with a retract and returns it.
    pub fn into_path(mut self, layers: u32) -> MillPath {
        if let Some((back, end)) = self.way_back().zip(self.points.last().copied()) {
            for p in &back[1..] {
                self.travel_to(*p, MoveKind::Link, end.layer);
            }
            self.lift_or_plunge(self.above(back[back.len() - 1]), end.layer);
        }
        let Self { points, passes, removal, unjoined, .. } = self;
        MillPath { points, removal, passes, unjoined, layers }
    }

    /// The highest place above `p` where the whole ball lies in the grid.
    fn above(&self, p: Point<Work>) -> Point<Work> {
        let grid = self.space.grid();
        let top = (grid.dims()[2] - 1) as f64 * grid.spacing_mm().z - self.space.radius_mm();
        Point::new(p.x(), p.y(), top.max(p.z()))
    }

    fn is_way_clear(&self, a: Point<Work>, b: Point<Work>) -> bool {
        self.space.is_move_clear(a, b, 0.5 * self.space.grid().spacing_mm().x)
    }

    fn is_way_free(&self, a: Point<Work>, b: Point<Work>) -> bool {
        self.is_way_clear(a, b) && self.is_free(a, b)
    }

    /// Moves along the approach to `to`: a retract as far as the space is free, then a cut.
    fn lift_or_plunge(&mut self, to: Point<Work>, layer: u32) {
        let Some(from) = self.position() else { return };
        let step = LINK_STEPS * self.spacing.step_mm;
        let count = (from.distance_mm(&to) / step).ceil() as usize;
        for n in 1..=count {
            let here = self.points[self.points.len() - 1].position;
            let next = from + (to - from) * (n as f64 / count as f64);
            if self.is_free(here, next) {
                self.push(next, MoveKind::Retract, layer);
                continue;
            }
            // in steps, so that only the part that removes material has a cut's speed
            let steps = pieces(here.distance_mm(&next), self.spacing.step_mm);
            for n in 1..=steps {
                let before = self.points[self.points.len() - 1].position;
                let p = here + (next - here) * (n as f64 / steps as f64);
                let kind = if self.is_free(before, p) { MoveKind::Retract } else { MoveKind::Cut };
                self.push(p, kind, layer);
            }
        }
    }

    fn travel_to(&mut self, to: Point<Work>, kind: MoveKind, layer: u32) {
        self.lay(to, LINK_STEPS * self.spacing.step_mm, kind, layer);
        self.sweep();
    }

    fn cut_to(&mut self, to: Point<Work>, layer: u32) {
        self.lay_cut(to, layer);
        self.sweep();
    }

    /// Adds a cut that is swept later.
    fn lay_cut(&mut self, to: Point<Work>, layer: u32) {
        self.lay(to, self.spacing.step_mm, MoveKind::Cut, layer);
    }

    fn lay(&mut self, to: Point<Work>, step_mm: f64, kind: MoveKind, layer: u32) {
        let before = self.position();
        let mut place = |position| {
            self.points.push(PathPoint { position, kind, layer, leads_to: self.heading });
        };
        let Some(from) = before else { return place(to) };
        let length = from.distance_mm(&to);
        if length < 1e-9 {
            return;
        }
        let count = pieces(length, step_mm);
        (1..=count).for_each(|n| place(from + (to - from) * (n as f64 / count as f64)));
    }

    fn push(&mut self, position: Point<Work>, kind: MoveKind, layer: u32) {
        self.points.push(PathPoint { position, kind, layer, leads_to: self.heading });
        self.sweep();
    }

    /// Removes the material of the moves added since the last call. Nothing reads the stock in between.
    fn sweep(&mut self) {
        let Self { points, removal, material, reachable, left, .. } = self;
        let moves = self.swept as u32..points.len() as u32;
        let at = |n: u32| points[n as usize].position;
        removal.sweep(moves, at, self.space.ball(), |voxel| {
            material.remove(voxel);
            *left -= usize::from(reachable.remove(voxel));
        });
        self.swept = self.points.len();
    }
}
