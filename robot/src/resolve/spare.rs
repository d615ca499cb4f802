//! Arms without closed form and with joints to spare: dynamic programming over the roll, and over one joint where there are more than six.
//!
//! A point and an axis take five joints. A sixth leaves the roll free, a seventh the arm's self-motion too, which the position of one joint
//! describes: the one that takes the greatest part in it. Nodes are rolls times positions of that joint; each is solved by damped least squares
//! with that joint held, from the same node one layer before, so that all nodes of a sheet belong to one branch. Sheets grow from a few starts at
//! the first pose over neighbouring nodes. The path goes from node to neighbouring node on one sheet, at the least total cost; roll and joint are
//! then smoothed between the samples, and the whole path is solved along them.
//!
//! Cost: layers × nodes × sheets solutions of six equations, each some steps from a near start.

use std::f64::consts::{PI, TAU};

use bonemill_arm::JointKind;
use bonemill_arm::arm::{Arm, AxisPose, ToolGoal, dls};
use bonemill_geometry::cancel;
use nalgebra::Matrix6;
use rayon::prelude::*;

use super::rolls::{between, even_out};
use super::track::{self, share};
use super::{EXACT, OutOfReach, PosePath, Posture, ReachReason, Resolved, grid, into_range, yielding};

/// How finely the free coordinates are sampled: about as many nodes for six joints as for more.
struct Sampling {
    /// Rolls around the shaft.
    rolls: usize,
    /// Sheets that are followed.
    sheets: usize,
}
const SIX_JOINTS: Sampling = Sampling { rolls: 36, sheets: 8 };
const MORE_JOINTS: Sampling = Sampling { rolls: 12, sheets: 3 };
/// Sampled positions of the spare joint.
const PLACES: usize = 10;
/// Largest path length between sampled poses, mm; the second where the arm cannot follow the first, or a joint would hurry.
const EVERY_MM: [f64; 2] = [3.0, 1.0];
/// At one pose a joint moves by at most this from a node to its neighbour, rad: more than roll and place are apart, less than from branch to branch.
const BESIDE_RAD: f64 = 1.5;
/// What one radian of the tool's orientation counts, mm.
const LEVER_MM: f64 = 100.0;

/// A joint vector, empty where the arm has none.
type Node = Vec<f64>;

/// One branch at one pose: a node for every roll and place, place by place within a roll.
type Sheet = Vec<Node>;

/// The arm and its free coordinates along a path.
struct Spare<'a> {
    arm: &'a Arm,
    path: &'a PosePath<'a>,
    /// The joint that is planned, with its positions, where the arm has more than six.
    joint: Option<(usize, Vec<f64>)>,
    sampling: Sampling,
}

/// Whether an arm's joints are such that roll and one of them can be sampled: all turn, and one at least is to spare.
pub(super) fn is_for(arm: &Arm) -> bool {
    arm.dof() >= 6 && arm.joints().iter().all(|joint| joint.kind == JointKind::Revolute)
}

/// Joint vectors along a path for an arm that this [`is_for`].
pub(super) fn resolve(arm: &Arm, path: &PosePath<'_>) -> Result<Resolved, OutOfReach> {
    let first = &path.poses[0];
    let near =
        if let Posture::From(near) = path.posture { track::start_near(arm, first, near) } else { None };
    let starts = match (near, track::starts(arm, first)) {
        (None, Err(reason)) => return Err(OutOfReach { pose: 0, reason }),
        (near, found) => near.into_iter().chain(found.unwrap_or_default()).collect::<Vec<_>>(),
    };
    let joint = planned_joint(arm, &starts);
    let sampling = if joint.is_some() { MORE_JOINTS } else { SIX_JOINTS };
    let spare = Spare { arm, path, joint, sampling };
    let sheets = spare.first_sheets(&starts);
    let [some, more] = EVERY_MM.map(|every_mm| grid::poses_every(path, every_mm));
    match spare.best(&sheets, &some) {
        Ok(resolved) if !grid::hurries(&resolved.q, arm.dof()) => Ok(resolved),
        hurried => spare.best(&sheets, &more).or(hurried),
    }
}

/// The joint whose share in the self-motion is the greatest over some joint vectors, and its sampled positions. With J the Jacobian of the tool's pose,
/// n nₜ = 1 − J⁺ J for the unit vector n of the self-motion.
fn planned_joint(arm: &Arm, starts: &[Vec<f64>]) -> Option<(usize, Vec<f64>)> {
    if arm.dof() < 7 {
        return None;
    }
    let mut shares = vec![0.0; arm.dof()];
    for q in starts {
        let jacobian = arm.tool_jacobian_at(q);
        let Ok(inverse) = jacobian.clone().pseudo_inverse(1e-9) else { continue };
        let kept = inverse * jacobian;
        for (share, j) in shares.iter_mut().zip(0..) {
            *share += 1.0 - kept[(j, j)];
        }
    }
    let joint = (0..shares.len()).max_by(|a, b| shares[*a].total_cmp(&shares[*b]))?;
    let range = &arm.joints()[joint];
    let within = (range.lower.max(-PI), range.upper.min(PI));
    let (lower, upper) = if within.0 < within.1 { within } else { (range.lower, range.upper) };
    let places = (0..PLACES).map(|n| lower + (upper - lower) * (n as f64 + 0.5) / PLACES as f64);
    Some((joint, places.collect()))
}

impl Spare<'_> {
    /// The best path over the poses `at` that begins on one of some sheets.
    fn best(&self, sheets: &[Sheet], at: &[usize]) -> Result<Resolved, OutOfReach> {
        let most = sheets
            .iter()
            .flatten()
            .filter(|q| !q.is_empty())
            .map(|q| self.manipulability(q))
            .fold(f64::MIN_POSITIVE, f64::max);
        let mut best: Option<(f64, Resolved)> = None;
        let mut farthest = OutOfReach { pose: 0, reason: ReachReason::Jump };
        for (n, sheet) in sheets.iter().enumerate() {
            match self.along(sheet, (at, most), n as u8) {
                Ok(found) if best.as_ref().is_none_or(|(least, _)| found.0 < *least) => best = Some(found),
                Ok(_) => {}
                Err(failed) if failed.pose >= farthest.pose => farthest = failed,
                Err(_) => {}
            }
        }
        best.map(|(_, resolved)| resolved).ok_or(farthest)
    }

    /// √det(J W² Jᵀ), J the Jacobian of the tool's pose and W the joints' speeds: 0 at a singularity.
    ///
    /// **Source:** Yoshikawa 1985, "Manipulability of robotic mechanisms".
    fn manipulability(&self, q: &[f64]) -> f64 {
        let mut jacobian = self.arm.tool_jacobian_at(q);
        for (mut column, joint) in jacobian.column_iter_mut().zip(self.arm.joints()) {
            column *= joint.velocity_limit;
            column.fixed_rows_mut::<3>(3).scale_mut(LEVER_MM);
        }
        let square: Matrix6<f64> = &jacobian * jacobian.transpose();
        square.determinant().max(0.0).sqrt()
    }

    fn places(&self) -> usize {
        self.joint.as_ref().map_or(1, |(_, places)| places.len())
    }

    /// A joint vector for a pose at a roll and a place of the spare joint, from one nearby; empty beyond the joints' ranges, and where a joint
    /// takes longer than `within_s` at its full speed.
    fn solved(
        &self,
        pose: &AxisPose,
        (roll_rad, place): (f64, Option<f64>),
        near: &[f64],
        within_s: f64,
    ) -> Node {
        let mut start = near.to_vec();
        let held = self.joint.as_ref().map(|(joint, _)| *joint);
        if let (Some(joint), Some(place)) = (held, place) {
            start[joint] = place;
        }
        let found = dls::solve_holding(
            self.arm,
            &ToolGoal::Pose(pose.spun(&self.path.frame, roll_rad)),
            &start,
            held,
        );
        let is_node = found.is_within(EXACT)
            && self.arm.excess_at(&found.q).is_none()
            && self.hurry_s(near, &found.q) <= within_s;
        if is_node { found.q } else { Node::new() }
    }

    /// The greatest time that a joint takes from one joint vector to another at its full speed, s.
    fn hurry_s(&self, from: &[f64], to: &[f64]) -> f64 {
        self.seconds(from, to).fold(0.0, f64::max)
    }

    /// The time that the slowest joint takes for [`BESIDE_RAD`], s.
    fn beside_s(&self) -> f64 {
        let slowest =
            self.arm.joints().iter().map(|joint| joint.velocity_limit).fold(f64::INFINITY, f64::min);
        BESIDE_RAD / slowest
    }

    /// The longest that a joint may take from one pose to another, s.
    fn may_take_s(&self, from: usize, to: usize, length_mm: f64) -> f64 {
        let poses = self.path.poses;
        track::may_take_s(length_mm, poses[from].axis.angle(&poses[to].axis))
    }

    fn seconds<'b>(&'b self, from: &'b [f64], to: &'b [f64]) -> impl Iterator<Item = f64> + 'b {
        let joints = self.arm.joints().iter().zip(from.iter().zip(to));
        joints.map(|(joint, (a, b))| (b - a).abs() / joint.velocity_limit)
    }

    fn free_at(&self, node: usize) -> (f64, Option<f64>) {
        let (roll, place) = (node / self.places(), node % self.places());
        (roll as f64 * self.step_rad(), self.joint.as_ref().map(|(_, places)| places[place]))
    }

    /// The node itself and those beside it, with the code of the step: 3 (change of roll + 1) + change of place + 1.
    fn beside(&self, node: usize) -> impl Iterator<Item = (u8, usize)> {
        let (rolls, places) = (self.sampling.rolls, self.places());
        let (roll, place) = (node / places, node % places);
        // the node itself first, so that it is taken where all are equal
        [4u8, 1, 7, 3, 5, 0, 2, 6, 8].into_iter().filter_map(move |code| {
            let place = (place + usize::from(code % 3)).checked_sub(1).filter(|p| *p < places)?;
            let roll = (roll + rolls + usize::from(code / 3) - 1) % rolls;
            Some((code, roll * places + place))
        })
    }

    /// The branches of the first pose on which the starts lie, the start of least cost first.
    fn first_sheets(&self, starts: &[Vec<f64>]) -> Vec<Sheet> {
        let (pose, rolls) = (&self.path.poses[0], self.sampling.rolls);
        let mut sheets: Vec<Sheet> = Vec::new();
        for start in starts {
            let upright = pose.upright(&self.path.frame);
            let x = upright.inverse() * (self.arm.tool_at(start).rotation * nalgebra::Vector3::x());
            let roll = (x.y.atan2(x.x) / self.step_rad()).round().rem_euclid(rolls as f64) as usize % rolls;
            let place = self.joint.as_ref().map_or(0, |(joint, places)| {
                let off = |n: &usize| (places[*n] - start[*joint]).abs();
                (0..places.len()).min_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or(0)
            });
            let seed = roll * self.places() + place;
            let first = self.solved(pose, self.free_at(seed), start, self.beside_s());
            let is_known =
                |sheet: &Sheet| !sheet[seed].is_empty() && self.hurry_s(&sheet[seed], &first) < 1e-3;
            if first.is_empty() || sheets.iter().any(is_known) {
                continue;
            }
            let mut sheet = vec![Node::new(); rolls * self.places()];
            sheet[seed] = first;
            let mut queue = std::collections::VecDeque::from([seed]);
            while let Some(from) = queue.pop_front() {
                for (_, to) in self.beside(from) {
                    if sheet[to].is_empty() {
                        sheet[to] = self.solved(pose, self.free_at(to), &sheet[from], self.beside_s());
                        if !sheet[to].is_empty() {
                            queue.push_back(to);
                        }
                    }
                }
            }
            sheets.push(sheet);
            if sheets.len() == self.sampling.sheets {
                break;
            }
        }
        sheets
    }

    /// The sheet at the next sampled pose.
    fn next_sheet(&self, (i, within_s): (usize, f64), before: &Sheet) -> Sheet {
        let solved = |node: usize| {
            // from the same node, else from one beside it
            let near = self.beside(node).map(|(_, from)| &before[from]).find(|q| !q.is_empty());
            near.map_or(Node::new(), |near| {
                self.solved(&self.path.poses[i], self.free_at(node), near, within_s)
            })
        };
        (0..before.len()).into_par_iter().with_min_len(8).map(solved).collect()
    }

    /// g: a posture's cost per mm of path, as for UR arms; σ is the manipulability in units of the `most` that the first pose allows.
    fn posture(&self, i: usize, q: &[f64], most: f64) -> f64 {
        if q.is_empty() {
            return f64::INFINITY;
        }
        let shares = self.arm.joints().iter().zip(q).map(|(joint, q)| share(joint, *q).abs());
        grid::posture_cost(shares, self.manipulability(q) / most) + yielding(self.arm, self.path, i, q)
    }

    /// The path of least cost on the sheet that begins with this one, with its cost.
    fn along(
        &self,
        first: &Sheet,
        (at, most): (&[usize], f64),
        branch: u8,
    ) -> Result<(f64, Resolved), OutOfReach> {
        let nodes = first.len();
        let costs = |i: usize, sheet: &Sheet| -> Vec<f64> {
            sheet.par_iter().with_min_len(8).map(|q| self.posture(i, q, most)).collect()
        };
        let mut came = vec![0u8; nodes * at.len()];
        let mut total: Vec<f64> = costs(0, first).iter().map(|cost| cost * grid::SHORTEST_MM).collect();
        let mut before = first.clone();
        for n in 1..at.len() {
            cancel::poll();
            let moves = at[n - 1] + 1..at[n] + 1;
            let length_mm: f64 = self.path.length_mm[moves].iter().map(|mm| mm.max(grid::SHORTEST_MM)).sum();
            let within_s = self.may_take_s(at[n - 1], at[n], length_mm);
            let sheet = self.next_sheet((at[n], within_s), &before);
            let cost = costs(at[n], &sheet);
            let mut next = vec![f64::INFINITY; nodes];
            for node in (0..nodes).filter(|node| cost[*node].is_finite()) {
                for (code, from) in self.beside(node).filter(|(_, from)| total[*from].is_finite()) {
                    let seconds = || self.seconds(&before[from], &sheet[node]);
                    if seconds().fold(0.0, f64::max) > within_s {
                        continue;
                    }
                    let motion: f64 = seconds().map(|s| s * s).sum();
                    let all = total[from] + grid::MOTION_MM / length_mm * motion + cost[node] * length_mm;
                    if all < next[node] {
                        (next[node], came[n * nodes + node]) = (all, code);
                    }
                }
            }
            if next.iter().all(|cost| cost.is_infinite()) {
                let reason = self.why(&self.path.poses[at[n]], &before);
                return Err(OutOfReach { pose: at[n], reason });
            }
            (before, total) = (sheet, next);
        }
        let best = (0..nodes).min_by(|a, b| total[*a].total_cmp(&total[*b])).unwrap_or(0);
        let (start, free) = self.traced(&came, best, nodes);
        let free = free.map(|sampled| between(&sampled, at, self.path.length_mm));
        let mut smooth = free.clone();
        for (values, step) in smooth.iter_mut().zip([self.step_rad(), self.place_step()]) {
            even_out(values, self.path.length_mm, step);
        }
        let followed = self
            .follow(&first[start], &smooth, branch)
            .or_else(|_| self.follow(&first[start], &free, branch))?;
        Ok((total[best], followed))
    }

    /// Angle between neighbouring rolls, rad.
    fn step_rad(&self) -> f64 {
        TAU / self.sampling.rolls as f64
    }

    fn place_step(&self) -> f64 {
        self.joint.as_ref().map_or(0.0, |(_, places)| places.get(1).map_or(0.0, |second| second - places[0]))
    }

    /// The first node of the best path, and roll and place at each sampled pose.
    fn traced(&self, came: &[u8], best: usize, nodes: usize) -> (usize, [Vec<f64>; 2]) {
        let (mut node, mut winding) = (best, 0i64);
        let mut free = [vec![], vec![]];
        for (n, came) in came.chunks_exact(nodes).enumerate().rev() {
            let (roll_rad, place) = self.free_at(node);
            free[0].push(roll_rad + winding as f64 * TAU);
            free[1].push(place.unwrap_or(0.0));
            if n == 0 {
                break;
            }
            let code = came[node];
            let Some((_, from)) = self.beside(node).find(|(of, _)| *of == code) else { break };
            let (here, there) = (node / self.places(), from / self.places());
            winding += match code / 3 {
                0 if there > here => -1,
                2 if there < here => 1,
                _ => 0,
            };
            node = from;
        }
        free.iter_mut().for_each(|values| values.reverse());
        (node, free)
    }

    /// The joint vectors along given rolls and places.
    fn follow(
        &self,
        start: &[f64],
        [rolls, places]: &[Vec<f64>; 2],
        branch: u8,
    ) -> Result<Resolved, OutOfReach> {
        let mut q = start.to_vec();
        let mut all = Vec::with_capacity(rolls.len() * q.len());
        for (i, pose) in self.path.poses.iter().enumerate() {
            let place = self.joint.as_ref().map(|_| places[i]);
            let within_s = self.may_take_s(i.saturating_sub(1), i, self.path.length_mm[i]);
            q = self.solved(pose, (rolls[i], place), &q, within_s);
            if q.is_empty() {
                return Err(OutOfReach { pose: i, reason: ReachReason::Jump });
            }
            all.extend_from_slice(&q);
        }
        let mut resolved = Resolved { q: all, roll_rad: rolls.clone(), branch };
        into_range(self.arm, &mut resolved)?;
        Ok(resolved)
    }

    /// Why no node of a pose can be taken from those before it.
    fn why(&self, pose: &AxisPose, before: &Sheet) -> ReachReason {
        let near = before.iter().filter(|q| !q.is_empty());
        let ends = near.map(|q| dls::solve(self.arm, &ToolGoal::Axis(*pose), q));
        let nearest = ends
            .min_by(|a, b| (a.short_mm + 100.0 * a.short_rad).total_cmp(&(b.short_mm + 100.0 * b.short_rad)));
        match nearest {
            Some(end) if end.short_rad > EXACT && 100.0 * end.short_rad > end.short_mm => {
                ReachReason::Axis { short_rad: end.short_rad }
            }
            Some(end) if end.short_mm > EXACT => ReachReason::Beyond { short_mm: end.short_mm },
            Some(end) => self.arm.excess_at(&end.q).map_or(ReachReason::Jump, ReachReason::Limit),
            None => ReachReason::Jump,
        }
    }
}
