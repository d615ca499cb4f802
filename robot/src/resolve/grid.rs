//! UR arms: dynamic programming over sampled roll, branch by branch, then refinement between the samples.
//!
//! The program has one layer per sampled pose and one node per roll and branch. Rolls change slowly along a path, so poses
//! are sampled about a millimetre apart ([`some_poses`]) and rolls are interpolated between them; where the arm cannot
//! follow the result, or a joint would move too fast, every pose is used. Nodes are computed for a portion of layers at a
//! time, in parallel, and dropped after the next portion; only one byte per node is kept, which says from where its best
//! path came. Edges lead to the same roll and its two neighbours on the same branch and are never stored.

use std::f64::consts::TAU;

use bonemill_arm::arm::inverse::{RollFrame, about_z};
use bonemill_arm::arm::{Arm, AxisPose, InverseKind, Joint};
use bonemill_arm::ur::{Branches, UrGeometry};
use bonemill_geometry::{Base, Flange, Rigid};
use nalgebra::Rotation3;
use rayon::prelude::*;

use crate::room::{Nearest, Room};

use super::rolls::{ChosenRolls, between, even_out, traced};
use super::{
    EXACT, Follower, Meeting, OutOfReach, PosePath, Posture, ReachReason, Resolved, into_range, yielding,
};

/// Number of sampled rolls.
pub(super) const ROLLS: usize = 36;
/// Angle between neighbouring rolls, rad.
pub(super) const STEP_RAD: f64 = TAU / ROLLS as f64;
/// Branches of a UR.
pub(super) const BRANCHES: usize = 8;
/// Layers computed at a time.
const PORTION: usize = 128;
/// w: weight of the joints' motion against the posture's cost, mm.
pub(super) const MOTION_MM: f64 = 20.0;
/// Shorter moves count as this long, mm, so that rotations in place have a length.
pub(super) const SHORTEST_MM: f64 = 0.05;
/// Height above the mounting plane that the lines between joints keep where there is a choice, mm. Assumed: about the
/// radius of a UR's links.
const KEPT_ABOVE_MM: f64 = 50.0;
/// Cost per mm of path of a posture with a link below that height, plus 1 for each mm that it is below. It exceeds all
/// other costs, so such a posture is taken only where there is no other.
const BELOW: f64 = 1e4;
/// Cost per mm of path of a posture in which something touches a link; it falls to 0 with the distance. It is of the order of a
/// joint at its limit. Assumed.
const CROWDING: f64 = 1.0;
/// Where one turn of rolls may begin, tried in this order.
const TURN_ENDS: [usize; 4] = [ROLLS / 2, 0, ROLLS / 4, 3 * ROLLS / 4];
/// Largest path length between sampled poses, mm.
const EVERY_MM: f64 = 1.0;
/// Largest turn of the axis between sampled poses, rad.
const EVERY_RAD: f64 = 0.1;
/// If a joint moves farther than this between two poses, every pose is used, rad.
const HURRY_RAD: f64 = 0.3;

/// Number of rolls with the last one repeated before the first and the first repeated behind the last.
const RING: usize = ROLLS + 2;

/// Every roll and branch of one pose; roll k of branch b is node b·ROLLS + k. A joint's positions are adjacent in memory,
/// so that several moves are computed at a time.
#[derive(Debug, Clone)]
struct ProgramLayer {
    /// Joint positions, rad, within half a turn around the middle of the joint's range, or around 0 where it has none, shape
    /// (branch, joint, ring of rolls); 0 where the arm cannot take the pose.
    q: Vec<f32>,
    /// The posture's cost g; infinite where the arm cannot take the pose.
    cost: Vec<f32>,
}

impl ProgramLayer {
    fn empty() -> Self {
        Self { q: vec![0.0; BRANCHES * 6 * RING], cost: vec![f32::INFINITY; BRANCHES * ROLLS] }
    }

    fn set(&mut self, branch: usize, roll: usize, q: &[f64; 6], cost: f64) {
        self.cost[branch * ROLLS + roll] = cost as f32;
        for (ring, q) in self.q[branch * 6 * RING..].chunks_exact_mut(RING).zip(q) {
            ring[roll + 1] = *q as f32;
        }
    }

    fn close_rings(&mut self) {
        for ring in self.q.chunks_exact_mut(RING) {
            ring[0] = ring[ROLLS];
            ring[RING - 1] = ring[1];
        }
    }

    /// A joint's positions on a branch.
    fn ring(&self, branch: usize, joint: usize) -> &[f32] {
        &self.q[(branch * 6 + joint) * RING..][..RING]
    }
}

pub(super) fn resolve(arm: &Arm, path: &PosePath<'_>) -> Result<Resolved, OutOfReach> {
    let InverseKind::Ur { geometry, .. } = arm.inverse_kind() else {
        return Err(OutOfReach { pose: 0, reason: ReachReason::Jump });
    };
    let nodes = Nodes::new(arm, geometry, path);
    match nodes.resolved(&some_poses(path)) {
        Ok(resolved) if !hurries(&resolved.q, arm.dof()) => Ok(resolved),
        _ => nodes.resolved(&every_pose(path)),
    }
}

/// g: what a posture costs per mm of path. Limits: Σ (u/0.25)², u the share of a joint's half range by which |q|, in such `shares`, exceeds
/// three quarters of it. Singularity: 0.02/(σ² + 1e-4), σ 0 at one.
pub(super) fn posture_cost(shares: impl Iterator<Item = f64>, sigma: f64) -> f64 {
    let limits: f64 = shares.filter(|share| *share > 0.75).map(|share| ((share - 0.75) * 4.0).powi(2)).sum();
    limits + 0.02 / (sigma * sigma + 1e-4)
}

/// The sampled poses: the first, the last, and poses between them that are at most [`EVERY_MM`] of path and [`EVERY_RAD`] of
/// turning apart where the path allows.
pub(super) fn some_poses(path: &PosePath<'_>) -> Vec<usize> {
    poses_every(path, EVERY_MM)
}

/// The same for another length of path.
pub(super) fn poses_every(path: &PosePath<'_>, every_mm: f64) -> Vec<usize> {
    let poses = path.poses;
    let (mut some, mut along_mm) = (vec![0], 0.0);
    for i in 1..poses.len() {
        // if this pose is too far from the last sampled one, the pose before it is sampled
        along_mm += path.length_mm[i];
        let last = some[some.len() - 1];
        let is_far = along_mm > every_mm || poses[last].axis.angle(&poses[i].axis) > EVERY_RAD;
        if is_far && last < i - 1 {
            some.push(i - 1);
            along_mm = path.length_mm[i];
        }
    }
    if poses.len() > 1 {
        some.push(poses.len() - 1);
    }
    some
}

pub(super) fn every_pose(path: &PosePath<'_>) -> Vec<usize> {
    (0..path.poses.len()).collect()
}

/// Whether a joint moves farther than [`HURRY_RAD`] between two poses.
pub(super) fn hurries(q: &[f64], dof: usize) -> bool {
    q.iter().zip(q.iter().skip(dof)).any(|(before, after)| (after - before).abs() > HURRY_RAD)
}

/// The joint vectors of given rolls.
fn follow(
    follower: &Follower<'_>,
    path: &PosePath<'_>,
    roll_rad: &[f64],
    arm: &Arm,
) -> Result<Resolved, OutOfReach> {
    let mut q = vec![0.0; arm.dof()];
    let mut all = Vec::with_capacity(path.poses.len() * arm.dof());
    for (pose, (at, roll)) in path.poses.iter().zip(roll_rad).enumerate() {
        follower.step(at, *roll, &mut q).map_err(|reason| OutOfReach { pose, reason })?;
        all.extend_from_slice(&q);
    }
    let mut resolved = Resolved { q: all, roll_rad: roll_rad.to_vec(), branch: follower.branch };
    into_range(arm, &mut resolved)?;
    if let Some(room) = path.room {
        for (pose, q) in resolved.q.chunks_exact(arm.dof()).enumerate() {
            let near = room.nearest(q, [room.kept_mm(); 2]).filter(|nearest| nearest.other.is_some());
            if let Some(nearest) = near {
                return Err(OutOfReach { pose, reason: ReachReason::Meets(Meeting::of(room, &nearest)) });
            }
        }
    }
    Ok(resolved)
}

/// One in this many rolls is tested before there is a path.
const ASKED_EVERY: usize = 3;

/// The branches on which an arm can take a pose at some roll, one bit per branch.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Branch {
    /// Branches that are within the joints' ranges and keep the links clear of the room.
    pub any: u8,
    /// Branches that also have every link [`KEPT_ABOVE_MM`] above the mounting plane.
    pub above: u8,
}

/// The branches on which an arm can take a pose.
pub(super) fn branches(arm: &Arm, pose: &AxisPose, frame: &RollFrame, room: Option<&Room>) -> Branch {
    let mut taken = Branch::default();
    let InverseKind::Ur { geometry, .. } = arm.inverse_kind() else { return taken };
    let upright = pose.upright(frame);
    for roll in (0..ROLLS).step_by(ASKED_EVERY) {
        let tool = Rigid::new(upright * about_z(roll as f64 * STEP_RAD), pose.position.coords);
        let flange = arm.mount().base_from_flange(&tool);
        for (branch, q) in geometry.inverse(&flange, 0.0).iter() {
            let mut q = *q;
            arm.bring_into_range(&mut q);
            if taken.above >> branch & 1 == 0 && arm.excess_at(&q).is_none() && is_clear(room, &q) {
                taken.any |= 1 << branch;
                taken.above |= u8::from(geometry.lowest_link_mm(&q, &flange) >= KEPT_ABOVE_MM) << branch;
            }
        }
        if taken.above == u8::MAX {
            break;
        }
    }
    taken
}

/// Whether every link keeps the clearance of a room.
fn is_clear(room: Option<&Room>, q: &[f64; 6]) -> bool {
    let nearest = room.and_then(|room| room.nearest(q, [room.kept_mm(); 2]));
    nearest.is_none_or(|nearest| nearest.other.is_none())
}

/// Computes the nodes of a path.
pub(super) struct Nodes<'a> {
    arm: &'a Arm,
    geometry: UrGeometry,
    path: &'a PosePath<'a>,
    rolls: [Rotation3<f64>; ROLLS],
    ranges: [Range; 6],
    /// The branches that are allowed.
    branches: Branches,
}

/// A joint's range, rad.
#[derive(Debug, Clone, Copy)]
struct Range {
    lower: f64,
    upper: f64,
    middle: f64,
    per_half: f64,
}

impl<'a> Nodes<'a> {
    pub(super) fn new(arm: &'a Arm, geometry: UrGeometry, path: &'a PosePath<'a>) -> Self {
        let range = |joint: &Joint| Range {
            lower: joint.lower,
            upper: joint.upper,
            // a range without ends has no middle; 0 is used, and no position is far from it
            middle: if joint.is_bounded() { 0.5 * (joint.lower + joint.upper) } else { 0.0 },
            per_half: 2.0 / (joint.upper - joint.lower),
        };
        Self {
            arm,
            geometry,
            path,
            rolls: std::array::from_fn(|roll| about_z(roll as f64 * STEP_RAD)),
            ranges: std::array::from_fn(|joint| range(&arm.joints()[joint])),
            branches: if let Posture::Of(branches) = path.posture { branches } else { Branches::ALL },
        }
    }

    /// Joint vectors along the whole path; rolls are chosen at the poses `at`.
    ///
    /// Rolls may wind without end along a path, a joint may not: where it would leave its range, rolls are chosen within one turn.
    pub(super) fn resolved(&self, at: &[usize]) -> Result<Resolved, OutOfReach> {
        let wound = match self.resolved_within(at, None) {
            Err(error @ OutOfReach { reason: ReachReason::Limit(_), .. }) => error,
            other => return other,
        };
        let within = TURN_ENDS.iter().map(|end| self.resolved_within(at, Some(*end)));
        within.into_iter().find_map(Result::ok).ok_or(wound)
    }

    /// The same; with `end`, no roll passes from the one before it to it or back.
    fn resolved_within(&self, at: &[usize], end: Option<usize>) -> Result<Resolved, OutOfReach> {
        let (arm, path) = (self.arm, self.path);
        let chosen = self.best_sequence(at, end)?;
        let sampled_rad = between(&chosen.roll_rad, at, path.length_mm);
        let mut roll_rad = sampled_rad.clone();
        even_out(&mut roll_rad, path.length_mm, STEP_RAD);
        let follower = Follower { arm, frame: path.frame, branch: chosen.branch };
        // sampled rolls were tested; smoothed rolls are tested again here
        follow(&follower, path, &roll_rad, arm).or_else(|_| follow(&follower, path, &sampled_rad, arm))
    }

    /// The rolls of least total cost over the poses `at`.
    fn best_sequence(&self, at: &[usize], end: Option<usize>) -> Result<ChosenRolls, OutOfReach> {
        let weights = self.weights();
        let mut from = vec![0u8; at.len() * BRANCHES * ROLLS];
        let mut before = ProgramLayer::empty();
        let mut total = vec![0f64; BRANCHES * ROLLS];
        for start in (0..at.len()).step_by(PORTION) {
            let range = start..(start + PORTION).min(at.len());
            let layers: Vec<ProgramLayer> = at[range.clone()].par_iter().map(|i| self.layer(*i)).collect();
            for (n, layer) in range.zip(layers) {
                let i = at[n];
                let moves = if n == 0 { i..i } else { at[n - 1] + 1..i + 1 };
                let length_mm: f64 = self.path.length_mm[moves].iter().map(|mm| mm.max(SHORTEST_MM)).sum();
                let came = &mut from[n * BRANCHES * ROLLS..][..BRANCHES * ROLLS];
                let next = if n == 0 {
                    first(&layer)
                } else {
                    advance((&before, &total), &layer, (length_mm, end), &weights, came)
                };
                if next.iter().all(|cost| cost.is_infinite()) {
                    return Err(OutOfReach { pose: i, reason: self.why(i, &layer) });
                }
                (before, total) = (layer, next);
            }
        }
        let best = (0..total.len()).min_by(|a, b| total[*a].total_cmp(&total[*b])).unwrap_or(0);
        Ok(traced(&from, best, at.len()))
    }

    /// 1/q̇², s²/rad², per joint.
    fn weights(&self) -> [f32; 6] {
        let mut weights = [0f32; 6];
        for (weight, joint) in weights.iter_mut().zip(self.arm.joints()) {
            *weight = (joint.velocity_limit.powi(-2)) as f32;
        }
        weights
    }

    fn layer(&self, i: usize) -> ProgramLayer {
        let mut layer = ProgramLayer::empty();
        for (roll, flange) in self.flanges(i).enumerate() {
            let found = self.geometry.inverse(&flange, 0.0);
            for (branch, q) in found.iter().filter(|(branch, _)| self.branches.contains(*branch as u8)) {
                let mut q = *q;
                self.arm.bring_into_range(&mut q);
                let posture = self.posture(&q, found.from_singular_mm[branch]);
                if posture.is_infinite() {
                    continue;
                }
                let below_mm = KEPT_ABOVE_MM - self.geometry.lowest_link_mm(&q, &flange);
                let cost = posture
                    + self.crowding(&q)
                    + if below_mm > 0.0 { BELOW + below_mm } else { 0.0 }
                    + yielding(self.arm, self.path, i, &q);
                if cost.is_finite() {
                    layer.set(branch, roll, &q, cost);
                }
            }
        }
        layer.close_rings();
        layer
    }

    /// The flange's pose for each roll at a pose of the tool.
    fn flanges(&self, i: usize) -> impl Iterator<Item = Rigid<Base, Flange>> {
        let pose: &AxisPose = &self.path.poses[i];
        let upright = pose.upright(&self.path.frame);
        let mount = self.arm.mount();
        let tool = move |roll| Rigid::new(upright * roll, pose.position.coords);
        self.rolls.iter().map(move |roll| mount.base_from_flange(&tool(roll)))
    }

    /// g: a posture's cost per mm of path ([`posture_cost`]); infinite beyond a joint's range. σ = s₃ s₅ w, with w the wrist's distance from
    /// the first axis in units of a link. σ holds the factors of the Jacobian's determinant.
    fn posture(&self, q: &[f64; 6], from_singular_mm: f64) -> f64 {
        let joints = || self.ranges.iter().zip(q);
        if joints().any(|(range, q)| !(range.lower..=range.upper).contains(q)) {
            return f64::INFINITY;
        }
        let sigma = from_singular_mm / (0.5 * (self.geometry.a2_mm + self.geometry.a3_mm));
        posture_cost(joints().map(|(range, q)| (q - range.middle).abs() * range.per_half), sigma)
    }

    /// The cost per mm of path of links near something: w (1 − d/p)², d the least distance and p that up to which more is
    /// preferred; infinite below the clearance.
    fn crowding(&self, q: &[f64; 6]) -> f64 {
        let Some(room) = self.path.room else { return 0.0 };
        let preferred_mm = room.preferred_mm();
        let Some(nearest) = room.nearest(q, [room.kept_mm(), preferred_mm]) else { return 0.0 };
        if nearest.distance_mm < room.kept_mm() {
            return f64::INFINITY;
        }
        CROWDING * (1.0 - nearest.distance_mm / preferred_mm).powi(2)
    }

    /// Why no node of a layer can be reached.
    fn why(&self, i: usize, layer: &ProgramLayer) -> ReachReason {
        if layer.cost.iter().any(|cost| cost.is_finite()) {
            return ReachReason::Jump;
        }
        let mut least_mm = f64::INFINITY;
        let mut excess = None;
        let mut is_on_another = false;
        // the posture that keeps its nearest link away most
        let mut clearest: Option<Nearest> = None;
        for flange in self.flanges(i) {
            let found = self.geometry.inverse(&flange, 0.0);
            least_mm = least_mm.min(found.short_mm);
            for (branch, q) in found.iter() {
                let mut q = *q;
                self.arm.bring_into_range(&mut q);
                let here = self.arm.excess_at(&q);
                if !self.branches.contains(branch as u8) {
                    is_on_another |= here.is_none();
                    continue;
                }
                if here.is_none()
                    && let Some(nearest) = self
                        .path
                        .room
                        .and_then(|room| room.nearest(&q, [f64::NEG_INFINITY, room.preferred_mm()]))
                    && clearest.is_none_or(|other| other.distance_mm < nearest.distance_mm)
                {
                    clearest = Some(nearest);
                }
                let is_less = |e: &bonemill_arm::JointExcess| {
                    excess.is_none_or(|other: bonemill_arm::JointExcess| e.excess < other.excess)
                };
                excess = here.filter(is_less).or(excess);
            }
        }
        if let (Some(room), Some(nearest)) = (self.path.room, clearest)
            && nearest.distance_mm < room.kept_mm()
        {
            return ReachReason::Meets(Meeting::of(room, &nearest));
        }
        match excess {
            Some(excess) => ReachReason::Limit(excess),
            None if is_on_another => ReachReason::Branch,
            None if least_mm > EXACT => ReachReason::Beyond { short_mm: least_mm },
            None => ReachReason::Jump,
        }
    }
}

fn first(layer: &ProgramLayer) -> Vec<f64> {
    layer.cost.iter().map(|cost| f64::from(*cost) * SHORTEST_MM).collect()
}

/// The least total cost at each node of a layer. Also stores from which roll it came: 0, 1, 2 for one roll less, the same,
/// one more.
fn advance(
    (before, total): (&ProgramLayer, &[f64]),
    layer: &ProgramLayer,
    (length_mm, end): (f64, Option<usize>),
    weights: &[f32; 6],
    came: &mut [u8],
) -> Vec<f64> {
    let mut next = vec![f64::INFINITY; layer.cost.len()];
    let per_motion = MOTION_MM / length_mm;
    for branch in 0..BRANCHES {
        let nodes = branch * ROLLS..(branch + 1) * ROLLS;
        let total = &total[nodes.clone()];
        if total.iter().all(|total| total.is_infinite()) {
            continue;
        }
        let motion = [0, 1, 2].map(|how| motion(before, layer, branch, how, weights));
        let nodes = next[nodes.clone()].iter_mut().zip(&layer.cost[nodes.clone()]).zip(&mut came[nodes]);
        for (roll, ((next, cost), came)) in nodes.enumerate() {
            let at = [(roll + ROLLS - 1) % ROLLS, roll, (roll + 1) % ROLLS];
            let [mut less, same, mut more] =
                [0, 1, 2].map(|how| total[at[how]] + f64::from(motion[how][roll]) * per_motion);
            if end == Some(roll) {
                less = f64::INFINITY;
            }
            if end == Some(at[2]) {
                more = f64::INFINITY;
            }
            // the same roll wins when all are equal
            let (best, how) = if less < same { (less, 0) } else { (same, 1) };
            let (best, how) = if more < best { (more, 2) } else { (best, how) };
            *next = best + f64::from(*cost) * length_mm;
            *came = how;
        }
    }
    next
}

/// Σⱼ (Δqⱼ/q̇ⱼ)² to each roll of a branch from one roll less, the same or one more (`how` 0, 1, 2), s².
fn motion(
    before: &ProgramLayer,
    layer: &ProgramLayer,
    branch: usize,
    how: usize,
    weights: &[f32; 6],
) -> [f32; ROLLS] {
    use std::f32::consts::TAU;
    let mut motion = [0f32; ROLLS];
    for (joint, weight) in weights.iter().enumerate() {
        let to = &layer.ring(branch, joint)[1..=ROLLS];
        let from = &before.ring(branch, joint)[how..how + ROLLS];
        for ((motion, to), from) in motion.iter_mut().zip(to).zip(from) {
            let one_way = (to - from).abs();
            let other_way = TAU - one_way;
            let apart = if one_way < other_way { one_way } else { other_way };
            *motion += apart * apart * weight;
        }
    }
    motion
}
