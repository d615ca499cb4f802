//! UR arms: dynamic programming over sampled roll, branch by branch, then refinement between the samples.
//!
//! A layer per pose that is looked at, a node per roll and branch. Rolls change slowly along a path, so poses are looked at about
//! a millimetre apart ([`some_poses`]) and rolls laid evenly between them; where the arm cannot follow those, or would have to hurry,
//! every pose is looked at. Nodes are computed for a portion of layers at a time, in parallel, and
//! dropped when the next portion has passed; what is kept is one byte per node, where its best path came from. Edges go
//! to the same roll and its two neighbours on the same branch and are never stored.

use std::f64::consts::TAU;

use bonemill_arm::arm::inverse::{RollFrame, about_z};
use bonemill_arm::arm::{Arm, AxisPose, InverseKind, Joint};
use bonemill_arm::ur::ik::wrapped;
use bonemill_arm::ur::{Branches, UrGeometry};
use bonemill_geometry::{Base, Flange, Rigid};
use nalgebra::Rotation3;
use rayon::prelude::*;

use super::{EXACT, Follower, OutOfReach, PosePath, Posture, ReachReason, Resolved, into_range, yielding};

/// Rolls that are looked at.
const ROLLS: usize = 36;
/// Angle between them, rad.
const STEP_RAD: f64 = TAU / ROLLS as f64;
/// Branches of a UR.
const BRANCHES: usize = 8;
/// Layers computed at a time.
const PORTION: usize = 128;
/// w: what a mm of path is worth against a joint's motion at full speed over it, mm.
const MOTION_MM: f64 = 20.0;
/// Moves shorter than this count as long, mm: rotations in place have a length too.
const SHORTEST_MM: f64 = 0.05;
/// Lines between joints are kept this far above the mounting plane where there is a choice, mm: assumed, about the radius of a
/// UR's links; rolls are evened out within it.
const KEPT_ABOVE_MM: f64 = 50.0;
/// What a posture costs per mm for a link below that, and 1 more for each mm that it is below: more than any
/// other, so that where there is a choice none is below.
const BELOW: f64 = 1e4;
/// Sweeps that even the rolls out.
const SWEEPS: usize = 64;
/// A pose is looked at where the path has gone so far since the last one, mm.
const EVERY_MM: f64 = 1.0;
/// Or where the axis has turned so far, rad.
const EVERY_RAD: f64 = 0.1;
/// A joint that moves farther between two poses hurries, rad.
const HURRY_RAD: f64 = 0.3;

/// Rolls with the last one again before the first and the first again behind the last.
const RING: usize = ROLLS + 2;

/// Every roll and branch of one pose; roll k of branch b is node b·ROLLS + k. A joint's positions lie side by side, so that moves are
/// computed several at a time.
#[derive(Debug, Clone)]
struct ProgramLayer {
    /// rad within half a turn around the middle of the joint's range, or around 0 where it has none, shape (branch, joint, ring of rolls); 0 where the arm cannot be.
    q: Vec<f32>,
    /// g; infinite where the arm cannot be.
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

/// The first pose, the last, and between them some that are [`EVERY_MM`] of path or [`EVERY_RAD`] of turning apart, or nearer.
pub(super) fn some_poses(path: &PosePath<'_>) -> Vec<usize> {
    let poses = path.poses;
    let (mut some, mut along_mm) = (vec![0], 0.0);
    for i in 1..poses.len() {
        // the pose before is looked at where this one is too far from the last
        along_mm += path.length_mm[i];
        let last = some[some.len() - 1];
        let is_far = along_mm > EVERY_MM || poses[last].axis.angle(&poses[i].axis) > EVERY_RAD;
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
    Ok(resolved)
}

/// Rolls as the dynamic program chose them.
struct ChosenRolls {
    branch: u8,
    roll_rad: Vec<f64>,
}

/// One roll of so many is tested before there is a path.
const ASKED_EVERY: usize = 3;

/// The branches on which an arm can take a pose at some roll, a bit each.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Branch {
    /// Within the joints' ranges.
    pub any: u8,
    /// And with every link [`KEPT_ABOVE_MM`] above the mounting plane.
    pub above: u8,
}

/// On which branches an arm can take a pose.
pub(super) fn branches(arm: &Arm, pose: &AxisPose, frame: &RollFrame) -> Branch {
    let mut taken = Branch::default();
    let InverseKind::Ur { geometry, .. } = arm.inverse_kind() else { return taken };
    let upright = pose.upright(frame);
    let flange_to = arm.mount().flange_from_burr.inverse();
    for roll in (0..ROLLS).step_by(ASKED_EVERY) {
        let tool = Rigid::new(upright * about_z(roll as f64 * STEP_RAD), pose.position.coords);
        let flange = tool * flange_to;
        for (branch, q) in geometry.inverse(&flange, 0.0).iter() {
            let mut q = *q;
            arm.bring_into_range(&mut q);
            if arm.excess_at(&q).is_none() {
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

/// Where nodes come from.
pub(super) struct Nodes<'a> {
    arm: &'a Arm,
    geometry: UrGeometry,
    path: &'a PosePath<'a>,
    rolls: [Rotation3<f64>; ROLLS],
    ranges: [Range; 6],
    /// Those that may be taken.
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
            // a range without ends has no middle, and nothing is far from it
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

    /// Joint vectors along the whole path, chosen at some of its poses.
    pub(super) fn resolved(&self, at: &[usize]) -> Result<Resolved, OutOfReach> {
        let (arm, path) = (self.arm, self.path);
        let chosen = self.best_sequence(at)?;
        let sampled_rad = between(&chosen.roll_rad, at, path.length_mm);
        let mut roll_rad = sampled_rad.clone();
        even_out(&mut roll_rad, path.length_mm);
        let follower = Follower { arm, frame: path.frame, branch: chosen.branch };
        // on the samples each pose was found free; between them it is tested again
        follow(&follower, path, &roll_rad, arm).or_else(|_| follow(&follower, path, &sampled_rad, arm))
    }

    /// Over the poses `at`.
    fn best_sequence(&self, at: &[usize]) -> Result<ChosenRolls, OutOfReach> {
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
                    advance(&before, &total, &layer, length_mm, &weights, came)
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
                let below_mm = KEPT_ABOVE_MM - self.geometry.lowest_link_mm(&q, &flange);
                let cost = self.posture(&q, found.from_singular_mm[branch])
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

    /// Where the flange is at a pose, by roll.
    fn flanges(&self, i: usize) -> impl Iterator<Item = Rigid<Base, Flange>> {
        let pose: &AxisPose = &self.path.poses[i];
        let upright = pose.upright(&self.path.frame);
        let flange_to = self.arm.mount().flange_from_burr.inverse();
        self.rolls.iter().map(move |roll| Rigid::new(upright * roll, pose.position.coords) * flange_to)
    }

    /// g: what a posture costs per mm; infinite beyond a joint's range.
    ///
    /// Limits: Σ (u/0.25)² with u how far |q| is past three quarters of the half range. Singularity: 0.02/(σ² + 1e-4), σ = s₃ s₅ w
    /// with w the wrist's distance from the first axis in units of a link: the factors of the Jacobian's determinant.
    fn posture(&self, q: &[f64; 6], from_singular_mm: f64) -> f64 {
        let mut cost = 0.0;
        for (range, q) in self.ranges.iter().zip(q) {
            if !(range.lower..=range.upper).contains(q) {
                return f64::INFINITY;
            }
            let share = (q - range.middle).abs() * range.per_half;
            if share > 0.75 {
                cost += ((share - 0.75) * 4.0).powi(2);
            }
        }
        let sigma = from_singular_mm / (0.5 * (self.geometry.a2_mm + self.geometry.a3_mm));
        cost + 0.02 / (sigma * sigma + 1e-4)
    }

    /// Why no node of a layer can be reached.
    fn why(&self, i: usize, layer: &ProgramLayer) -> ReachReason {
        if layer.cost.iter().any(|cost| cost.is_finite()) {
            return ReachReason::Jump;
        }
        let mut least_mm = f64::INFINITY;
        let mut excess = None;
        let mut is_on_another = false;
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
                let is_less = |e: &bonemill_arm::JointExcess| {
                    excess.is_none_or(|other: bonemill_arm::JointExcess| e.excess < other.excess)
                };
                excess = here.filter(is_less).or(excess);
            }
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

/// The best total at each node of a layer; notes where it came from: 0, 1, 2 for one roll less, the same, one more.
fn advance(
    before: &ProgramLayer,
    total: &[f64],
    layer: &ProgramLayer,
    length_mm: f64,
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
            let [less, same, more] =
                [0, 1, 2].map(|how| total[at[how]] + f64::from(motion[how][roll]) * per_motion);
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

/// Walks back from the best end.
fn traced(from: &[u8], best: usize, count: usize) -> ChosenRolls {
    let (branch, mut roll) = (best / ROLLS, best % ROLLS);
    let mut turns = vec![0i64; count];
    let mut place = roll as i64;
    for i in (0..count).rev() {
        turns[i] = place;
        match from[i * BRANCHES * ROLLS + branch * ROLLS + roll] {
            0 if i > 0 => (roll, place) = ((roll + ROLLS - 1) % ROLLS, place - 1),
            2 if i > 0 => (roll, place) = ((roll + 1) % ROLLS, place + 1),
            _ => {}
        }
    }
    let roll_rad = turns.iter().map(|turn| *turn as f64 * STEP_RAD).collect();
    ChosenRolls { branch: branch as u8, roll_rad }
}

/// Rolls of every pose from those of the poses `at`, even along the path between them.
fn between(roll_rad: &[f64], at: &[usize], length_mm: &[f64]) -> Vec<f64> {
    let mut all = roll_rad[..roll_rad.len().min(1)].to_vec();
    for (rolls, ends) in roll_rad.windows(2).zip(at.windows(2)) {
        let lengths = length_mm[ends[0] + 1..=ends[1]].iter().map(|mm| mm.max(SHORTEST_MM));
        let whole_mm: f64 = lengths.clone().sum();
        let mut along_mm = 0.0;
        for (i, length_mm) in (ends[0] + 1..).zip(lengths) {
            along_mm += length_mm;
            // at a pose that was looked at exactly what was chosen
            let share = if i == ends[1] { 1.0 } else { along_mm / whole_mm };
            all.push(rolls[0] + (rolls[1] - rolls[0]) * share);
        }
    }
    all
}

/// Evens the samples' steps out, weighted by the moves' lengths; never farther than one step from the sample.
fn even_out(roll_rad: &mut [f64], length_mm: &[f64]) {
    let sampled = roll_rad.to_vec();
    for sweep in 0..SWEEPS {
        // to and fro, so that a step spreads both ways
        let inner = 1..roll_rad.len().saturating_sub(1);
        let visit = |i: usize, rolls: &mut [f64]| {
            let [before, after] = [i, i + 1].map(|k| length_mm[k].max(SHORTEST_MM));
            let even = (rolls[i - 1] * after + rolls[i + 1] * before) / (before + after);
            rolls[i] = even.clamp(sampled[i] - STEP_RAD, sampled[i] + STEP_RAD);
        };
        if sweep % 2 == 0 {
            inner.for_each(|i| visit(i, roll_rad));
        } else {
            inner.rev().for_each(|i| visit(i, roll_rad));
        }
    }
    // a roll without choice stays exactly where it is
    for (roll, sampled) in roll_rad.iter_mut().zip(&sampled) {
        if wrapped(*roll - sampled).abs() < 1e-12 {
            *roll = *sampled;
        }
    }
}
