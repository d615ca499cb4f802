//! UR arms: dynamic programming over sampled spin, branch by branch, then refinement between the samples.
//!
//! A layer per pose, a node per spin and branch. Nodes are computed for a portion of layers at a time, in parallel, and
//! dropped when the next portion has passed; what is kept is one byte per node, where its best path came from. Edges go
//! to the same spin and its two neighbours on the same branch and are never stored.

use std::f64::consts::TAU;

use rayon::prelude::*;

use super::{EXACT, Follower, OutOfReach, PosePath, ReachReason, Resolved, Stiffness};
use crate::arm::{Arm, AxisPose, InverseKind};
use crate::ur::UrGeometry;
use crate::ur::ik::wrapped;

/// Spins that are looked at.
const SPINS: usize = 36;
/// Angle between them, rad.
const STEP_RAD: f64 = TAU / SPINS as f64;
/// Branches of a UR.
const BRANCHES: usize = 8;
/// Layers computed at a time.
const PORTION: usize = 128;
/// w: what a mm of path is worth against a joint's motion at full speed over it, mm.
const MOTION_MM: f64 = 20.0;
/// Moves shorter than this count as long, mm: rotations in place have a length too.
const SHORTEST_MM: f64 = 0.05;
/// Sweeps that even the spins out.
const SWEEPS: usize = 64;

/// One spin of one branch: joint positions and g; g is infinite where the arm cannot be.
#[derive(Debug, Clone, Copy)]
struct Node {
    q: [f32; 6],
    cost: f32,
}

const NOWHERE: Node = Node { q: [0.0; 6], cost: f32::INFINITY };

/// Every spin and branch of one pose, shape (branch, spin).
type Layer = Vec<Node>;

pub(super) fn resolve(arm: &Arm, path: &PosePath<'_>) -> Result<Resolved, OutOfReach> {
    let InverseKind::Ur { geometry, .. } = arm.inverse_kind() else {
        return Err(OutOfReach { pose: 0, reason: ReachReason::Jump });
    };
    let nodes = Nodes { arm, geometry, path };
    let chosen = nodes.best_sequence()?;
    let frame = path.frame;
    let mut spin_rad = chosen.spin_rad;
    even_out(&mut spin_rad, path.length_mm);
    let follower = Follower { arm, frame, branch: chosen.branch };
    // on the samples each pose was found free; between them it is asked again
    follow(&follower, path, &spin_rad, arm).or_else(|_| follow(&follower, path, &chosen.sampled_rad, arm))
}

/// The joint vectors of given spins.
fn follow(
    follower: &Follower<'_>,
    path: &PosePath<'_>,
    spin_rad: &[f64],
    arm: &Arm,
) -> Result<Resolved, OutOfReach> {
    let mut q = vec![0.0; arm.dof()];
    let mut all = Vec::with_capacity(path.poses.len() * arm.dof());
    for (pose, (at, spin)) in path.poses.iter().zip(spin_rad).enumerate() {
        follower.step(at, *spin, &mut q).map_err(|reason| OutOfReach { pose, reason })?;
        all.extend_from_slice(&q);
    }
    Ok(Resolved { q: all, spin_rad: spin_rad.to_vec(), branch: follower.branch })
}

/// Spins as the dynamic program chose them.
struct Chosen {
    branch: u8,
    /// To be evened out.
    spin_rad: Vec<f64>,
    /// As sampled.
    sampled_rad: Vec<f64>,
}

/// Where nodes come from.
struct Nodes<'a> {
    arm: &'a Arm,
    geometry: UrGeometry,
    path: &'a PosePath<'a>,
}

impl Nodes<'_> {
    fn best_sequence(&self) -> Result<Chosen, OutOfReach> {
        let poses = self.path.poses;
        let mut from = vec![0u8; poses.len() * BRANCHES * SPINS];
        let mut before: Layer = vec![NOWHERE; BRANCHES * SPINS];
        let mut total = vec![0f64; BRANCHES * SPINS];
        for start in (0..poses.len()).step_by(PORTION) {
            let range = start..(start + PORTION).min(poses.len());
            let layers: Vec<Layer> = range.clone().into_par_iter().map(|i| self.layer(i)).collect();
            for (i, layer) in range.zip(layers) {
                let length_mm = if i == 0 { SHORTEST_MM } else { self.path.length_mm[i].max(SHORTEST_MM) };
                let came = &mut from[i * BRANCHES * SPINS..][..BRANCHES * SPINS];
                let next = if i == 0 {
                    first(&layer)
                } else {
                    advance(&before, &total, &layer, length_mm, &self.weights(), came)
                };
                if next.iter().all(|cost| cost.is_infinite()) {
                    return Err(OutOfReach { pose: i, reason: self.why(i, &layer) });
                }
                (before, total) = (layer, next);
            }
        }
        let best = (0..total.len()).min_by(|a, b| total[*a].total_cmp(&total[*b])).unwrap_or(0);
        Ok(traced(&from, best, poses.len()))
    }

    /// 1/q̇², s²/rad², per joint.
    fn weights(&self) -> [f32; 6] {
        let mut weights = [0f32; 6];
        for (weight, joint) in weights.iter_mut().zip(self.arm.joints()) {
            *weight = (joint.velocity_limit.powi(-2)) as f32;
        }
        weights
    }

    fn layer(&self, i: usize) -> Layer {
        let mut layer = vec![NOWHERE; BRANCHES * SPINS];
        let pose = &self.path.poses[i];
        let flange_to = self.arm.mount().flange_from_burr.inverse();
        for spin in 0..SPINS {
            let flange = pose.spun(&self.path.frame, spin as f64 * STEP_RAD) * flange_to;
            for (branch, q) in self.geometry.inverse(&flange, 0.0).iter() {
                let mut q = *q;
                self.arm.bring_into_range(&mut q);
                let node = &mut layer[branch * SPINS + spin];
                let cost = self.posture(&q) + self.yielding(i, &q);
                if cost.is_finite() {
                    *node = Node { q: q.map(|q| q as f32), cost: cost as f32 };
                }
            }
        }
        layer
    }

    /// g: what a posture costs per mm; infinite beyond a joint's range.
    ///
    /// Limits: Σ (u/0.25)² with u how far |q| is past three quarters of the half range. Singularity: 0.02/(σ² + 1e-4), σ = s₃ s₅ w
    /// with w the wrist's distance from the first axis in units of a link: the factors of the Jacobian's determinant.
    fn posture(&self, q: &[f64; 6]) -> f64 {
        let mut cost = 0.0;
        for (joint, q) in self.arm.joints().iter().zip(q) {
            if !(joint.lower..=joint.upper).contains(q) {
                return f64::INFINITY;
            }
            let share = (q - 0.5 * (joint.lower + joint.upper)).abs() / (0.5 * (joint.upper - joint.lower));
            if share > 0.75 {
                cost += ((share - 0.75) * 4.0).powi(2);
            }
        }
        let g = &self.geometry;
        let (q23, q234) = (q[1] + q[2], q[1] + q[2] + q[3]);
        let outward = g.a2_mm * q[1].cos() + g.a3_mm * q23.cos() + g.d5_mm * q234.sin();
        let sigma = q[2].sin() * q[4].sin() * outward / (0.5 * (g.a2_mm + g.a3_mm));
        cost + 0.02 / (sigma * sigma + 1e-4)
    }

    /// ûᵀ C û, mm/N, counted at 100 N/mm: as much as a posture half-way to its limits for an arm of that stiffness.
    fn yielding(&self, i: usize, q: &[f64; 6]) -> f64 {
        let Some(Stiffness { joint, toward }) = self.path.stiffness else { return 0.0 };
        let Some(toward) = toward.get(i).copied().flatten() else { return 0.0 };
        let jacobian = self.arm.tool_jacobian_at(q);
        let columns = jacobian.column_iter().zip(joint);
        let yields: f64 =
            columns.map(|(column, chi)| column.fixed_rows::<3>(0).dot(&toward).powi(2) / chi).sum();
        100.0 * yields
    }

    /// Why no node of a layer can be reached.
    fn why(&self, i: usize, layer: &Layer) -> ReachReason {
        if layer.iter().any(|node| node.cost.is_finite()) {
            return ReachReason::Jump;
        }
        let pose: &AxisPose = &self.path.poses[i];
        let flange_to = self.arm.mount().flange_from_burr.inverse();
        let mut least_mm = f64::INFINITY;
        let mut excess = None;
        for spin in 0..SPINS {
            let found = self
                .geometry
                .inverse(&(pose.spun(&self.path.frame, spin as f64 * STEP_RAD) * flange_to), 0.0);
            least_mm = least_mm.min(found.short_mm);
            for (_, q) in found.iter() {
                let mut q = *q;
                self.arm.bring_into_range(&mut q);
                let here = self.arm.excess_at(&q);
                let is_less = |e: &crate::JointExcess| {
                    excess.is_none_or(|other: crate::JointExcess| e.excess < other.excess)
                };
                excess = here.filter(is_less).or(excess);
            }
        }
        match excess {
            Some(excess) => ReachReason::Limit(excess),
            None if least_mm > EXACT => ReachReason::Beyond { short_mm: least_mm },
            None => ReachReason::Jump,
        }
    }
}

fn first(layer: &Layer) -> Vec<f64> {
    layer.iter().map(|node| f64::from(node.cost) * SHORTEST_MM).collect()
}

/// The best total at each node of a layer; notes where it came from: 0, 1, 2 for one spin less, the same, one more.
fn advance(
    before: &Layer,
    total: &[f64],
    layer: &Layer,
    length_mm: f64,
    weights: &[f32; 6],
    came: &mut [u8],
) -> Vec<f64> {
    let mut next = vec![f64::INFINITY; layer.len()];
    let per_motion = MOTION_MM / length_mm;
    for (at, node) in layer.iter().enumerate() {
        if node.cost.is_infinite() {
            continue;
        }
        let (branch, spin) = (at / SPINS, at % SPINS);
        let mut best = (f64::INFINITY, 1u8);
        // the same spin first, so that it wins when all are equal
        for (how, other) in [(1, spin), (0, (spin + SPINS - 1) % SPINS), (2, (spin + 1) % SPINS)] {
            let other = branch * SPINS + other;
            if total[other].is_infinite() {
                continue;
            }
            let mut motion = 0f32;
            for ((a, b), weight) in node.q.iter().zip(&before[other].q).zip(weights) {
                let apart = a - b;
                let apart = apart - std::f32::consts::TAU * (apart / std::f32::consts::TAU).round();
                motion += apart * apart * weight;
            }
            let cost = total[other] + f64::from(motion) * per_motion;
            if cost < best.0 {
                best = (cost, how);
            }
        }
        next[at] = best.0 + f64::from(node.cost) * length_mm;
        came[at] = best.1;
    }
    next
}

/// Walks back from the best end.
fn traced(from: &[u8], best: usize, count: usize) -> Chosen {
    let (branch, mut spin) = (best / SPINS, best % SPINS);
    let mut turns = vec![0i64; count];
    let mut place = spin as i64;
    for i in (0..count).rev() {
        turns[i] = place;
        match from[i * BRANCHES * SPINS + branch * SPINS + spin] {
            0 if i > 0 => (spin, place) = ((spin + SPINS - 1) % SPINS, place - 1),
            2 if i > 0 => (spin, place) = ((spin + 1) % SPINS, place + 1),
            _ => {}
        }
    }
    let spin_rad: Vec<f64> = turns.iter().map(|turn| *turn as f64 * STEP_RAD).collect();
    Chosen { branch: branch as u8, sampled_rad: spin_rad.clone(), spin_rad }
}

/// Evens the samples' steps out, weighted by the moves' lengths; never farther than one step from the sample.
fn even_out(spin_rad: &mut [f64], length_mm: &[f64]) {
    let sampled = spin_rad.to_vec();
    for sweep in 0..SWEEPS {
        // to and fro, so that a step spreads both ways
        let inner = 1..spin_rad.len().saturating_sub(1);
        let visit = |i: usize, spins: &mut [f64]| {
            let [before, after] = [i, i + 1].map(|k| length_mm[k].max(SHORTEST_MM));
            let even = (spins[i - 1] * after + spins[i + 1] * before) / (before + after);
            spins[i] = even.clamp(sampled[i] - STEP_RAD, sampled[i] + STEP_RAD);
        };
        if sweep % 2 == 0 {
            inner.for_each(|i| visit(i, spin_rad));
        } else {
            inner.rev().for_each(|i| visit(i, spin_rad));
        }
    }
    // a spin without choice stays exactly where it is
    for (spin, sampled) in spin_rad.iter_mut().zip(&sampled) {
        if wrapped(*spin - sampled).abs() < 1e-12 {
            *spin = *sampled;
        }
    }
}
