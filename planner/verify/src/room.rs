//! Checks the distance of the arm's links from the patient, from obstacles and from each other along the trajectory.
//!
//! Links are the capsules that the arm's data give; where they are follows from the DH table by products of matrices here. Between
//! rows each joint follows the cubic with the rows' positions and velocities, and the way is walked in steps in which no point of the
//! arm moves more than [`STEP_MM`]: between two stops a distance is lower by at most half of that, which is subtracted. The distance
//! from an obstacle or a link is convex along a capsule's axis, and its least value is searched for. The patient is sampled on a
//! lattice from the CT by code of this crate, each [`AXIS_MM`] of an axis; distances from it err by a lattice cell's diagonal, which
//! is allowed for.
//!
//! A calibrated arm's links are placed by the nominal table, and what its flange and burr deviate from that along the trajectory is
//! subtracted one and a half times. The base is held against the patient and against what reaches above its mounting plane, the
//! handpiece against all but the patient.

use bonemill_arm::ur::UrModel;
use bonemill_arm::ur::links::{LINKS_AND_HANDPIECE, link_name, pairs_held_apart};
use bonemill_case::{Case, HeadSource};
use bonemill_geometry::cancel;
use bonemill_planfile::{StoredPlan, Trajectory};
use nalgebra::{Isometry3, Rotation3, Translation3, UnitQuaternion, Vector3};
use rayon::prelude::*;

use super::VerifyError;
use super::anatomy::Anatomy;
use super::check::{Check, Place};
use super::follow::cubic;
use super::moves::Executed;
use crate::head::Tissue;
use crate::solid::{Solid, to_segment_mm};

/// Largest motion of a point of the arm from one stop to the next, mm.
const STEP_MM: f64 = 0.5;
/// Sizes of the blocks of stops that are looked at by one of them.
const BLOCKS: [usize; 4] = [64, 16, 4, 1];
/// A distance changes by at most this per mm that a link moves: 1, and more where it is looked up in a lattice.
const STEEPEST: f64 = 2.0;
/// Distance of samples on a capsule's axis from the patient, mm.
const AXIS_MM: f64 = 2.0;
/// Tolerance of a distance from obstacles and links, because the motion rounds corners, mm.
const ROUNDED_MM: f64 = 0.5;
/// Thirds that are taken off an axis on which the least distance is searched for; of 1 m 5 µm are left.
const SEARCHED: usize = 30;
/// What reaches no higher above the mounting plane is not held against the base, mm.
const MOUNTED_MM: f64 = 1.0;
/// Deviations of a calibrated arm count so many times: its elbow may deviate more than its flange.
const DEVIATIONS: f64 = 1.5;
/// Places of base and handpiece among the links.
const BASE: usize = 0;
const HANDPIECE: usize = LINKS_AND_HANDPIECE - 1;

/// A capsule: ends and radius, mm; in its link's frame, or placed in base.
type Piece = (Vector3<f64>, Vector3<f64>, f64);

/// The links of a plan's arm.
struct Links {
    /// a, d and α by joint, mm and rad.
    dh: [[f64; 3]; 6],
    pieces: Vec<Vec<Piece>>,
}

/// Joints at a place of the trajectory.
struct Stop {
    /// The row that they are at, or on the way to.
    row: usize,
    q: Vec<f64>,
}

/// A link, what it is near, by its number among links and, behind them, obstacles; and their distance, mm.
#[derive(Debug, Clone, Copy)]
struct Near {
    mm: f64,
    link: usize,
    other: usize,
}

/// Checks a UR's links. None without a clearance in the case, and for arms whose links are not known.
///
/// # Errors
/// [`VerifyError::Robot`] where a row is not a joint vector of the arm.
pub fn room(plan: &StoredPlan, anatomy: &Anatomy, executed: &Executed) -> Result<Vec<Check>, VerifyError> {
    let case = &plan.record.case;
    let (Some(clearance_mm), Some(model)) =
        (case.robot.room.link_clearance_mm, UrModel::by_name(&case.robot.model))
    else {
        return Ok(vec![]);
    };
    let links = Links::new(model, handpiece(case, model.geometry().d6_mm));
    let base_from_ct = &plan.record.frames.base_from_ct;
    let base_from_ct = Isometry3::from_parts(
        Translation3::from(base_from_ct.translation_mm),
        UnitQuaternion::from_rotation_matrix(&base_from_ct.rotation),
    );
    let solids: Vec<Solid> = case.obstacles.iter().map(|o| Solid::new(o, &base_from_ct)).collect();
    let pairs: Vec<_> = pairs_held_apart().collect();
    let stops = walked(&plan.trajectory, links.longest_mm());
    let off_mm = if case.robot.calibration.is_some() { links.deviation_mm(plan, &stops)? } else { 0.0 };
    let calibrated = if off_mm > 0.0 {
        format!("; less {off_mm:.1} mm by which links of the calibrated arm may be elsewhere")
    } else {
        String::new()
    };
    let at = |row: usize| Place::Instant {
        time_s: plan.trajectory.time_s[row],
        waypoint: executed.next[row] as usize,
    };
    let mut checks = vec![];
    let among = least(&stops, |q| among(&links.placed(q), &solids, &pairs, off_mm));
    if let Some((near, row)) = among {
        let limit = clearance_mm - ROUNDED_MM;
        let name = |n: usize| match n.checked_sub(LINKS_AND_HANDPIECE) {
            Some(solid) => solids[solid].name.clone(),
            None => link_name(n).to_owned(),
        };
        let check =
            Check::at_least("links to obstacles and each other", near.mm - 0.5 * STEP_MM, limit, "mm");
        checks.push(check.at(at(row)).noting(format!(
            "{} and {}; less half of the steps of {STEP_MM} mm{calibrated}",
            name(near.link),
            name(near.other)
        )));
    }
    if case.robot.room.head == HeadSource::Scan
        && let Some(tissue) =
            Tissue::of(&anatomy.ct, case.robot.room.head_beyond_mm, &plan.record.frames.approach_direction)
    {
        let ct_from_base = base_from_ct.inverse();
        let to_tissue = least(&stops, |q| from_tissue(&links.placed(q), &tissue, &ct_from_base, off_mm));
        if let Some((near, row)) = to_tissue {
            let error_mm = tissue.error_mm();
            let limit = clearance_mm - error_mm;
            let check = Check::at_least("links to the patient", near.mm - 0.5 * STEP_MM, limit, "mm");
            checks.push(check.at(at(row)).noting(format!(
                "{}; distances from the scan err by up to {error_mm:.1} mm either way, and axes are sampled each {AXIS_MM} mm{calibrated}",
                link_name(near.link)
            )));
        }
    }
    Ok(checks)
}

/// The least distance over the stops, and its row. Blocks of stops are looked at by their middle one first: no stop of a block is nearer than that
/// less the way between them, so that a block in which nothing can be nearer than the least so far is left out.
fn least(stops: &[Stop], near: impl Fn(&[f64]) -> Option<Near> + Sync) -> Option<(Near, usize)> {
    let mut best: Option<(Near, usize)> = None;
    let mut blocks: Vec<usize> = (0..stops.len()).step_by(BLOCKS[0]).collect();
    for (level, size) in BLOCKS.into_iter().enumerate() {
        let middle = |first: usize| (first + size / 2).min(stops.len() - 1);
        let found: Vec<Option<(Near, usize)>> = blocks
            .par_iter()
            .map(|first| {
                cancel::poll();
                let stop = &stops[middle(*first)];
                Some((near(&stop.q)?, stop.row))
            })
            .collect();
        let nearest = found.iter().flatten().chain(&best).min_by(|a, b| a.0.mm.total_cmp(&b.0.mm)).copied();
        best = nearest;
        let (least, _) = nearest?;
        let Some(next) = BLOCKS.get(level + 1) else { break };
        let may_be_nearer = |found: &Option<(Near, usize)>| {
            found.is_none_or(|(near, _)| near.mm - 0.5 * STEEPEST * STEP_MM * (size as f64) < least.mm)
        };
        let kept = blocks.iter().zip(&found).filter(|(_, found)| may_be_nearer(found));
        let parts = kept.flat_map(|(first, _)| (*first..(first + size).min(stops.len())).step_by(*next));
        blocks = parts.collect();
    }
    best
}

/// Joints along the trajectory, the first and the last row's included: no point of the arm moves farther than [`STEP_MM`] between
/// two of them.
///
/// On the cubic from row to row a joint is nowhere faster than the largest of |v₀|, |3 d − v₀ − v₁| and |v₁|, in units of the step:
/// these are the control points of its speed.
fn walked(rows: &Trajectory, longest_mm: f64) -> Vec<Stop> {
    let at_row = |row: usize| Stop { row, q: rows.q_at(row).to_vec() };
    let mut stops = vec![at_row(0)];
    let mut since_mm = 0.0;
    for row in 1..rows.len() {
        let span_s = rows.time_s[row] - rows.time_s[row - 1];
        let (from, to) = (rows.q_at(row - 1), rows.q_at(row));
        let speeds = |j: usize| [row - 1, row].map(|row| rows.qd_at(row)[j] * span_s);
        let fastest = |j: usize| {
            let [before, after] = speeds(j);
            before.abs().max(after.abs()).max((3.0 * (to[j] - from[j]) - before - after).abs())
        };
        let moved_mm = (0..from.len()).map(fastest).sum::<f64>() * longest_mm;
        if since_mm > 0.0 && since_mm + moved_mm > STEP_MM {
            stops.push(at_row(row - 1));
            since_mm = 0.0;
        }
        if moved_mm > STEP_MM {
            let pieces = (moved_mm / STEP_MM).ceil();
            stops.extend((1..pieces as usize).map(|n| {
                let joint = |j: usize| cubic([from[j], to[j]], speeds(j), n as f64 / pieces);
                Stop { row, q: (0..from.len()).map(joint).collect() }
            }));
            stops.push(at_row(row));
        } else {
            since_mm += moved_mm;
        }
    }
    if since_mm > 0.0 {
        stops.push(at_row(rows.len() - 1));
    }
    stops
}

impl Links {
    fn new(model: UrModel, handpiece: Vec<Piece>) -> Self {
        use std::f64::consts::FRAC_PI_2;
        let g = model.geometry();
        let dh = [
            [0.0, g.d1_mm, FRAC_PI_2],
            [g.a2_mm, 0.0, 0.0],
            [g.a3_mm, 0.0, 0.0],
            [0.0, g.d4_mm, FRAC_PI_2],
            [0.0, g.d5_mm, -FRAC_PI_2],
            [0.0, g.d6_mm, 0.0],
        ];
        let mut pieces: Vec<Vec<Piece>> = model
            .link_capsules()
            .iter()
            .map(|link| link.iter().map(|c| (c.from.coords, c.to.coords, c.radius_mm)).collect())
            .collect();
        pieces.push(handpiece);
        Self { dh, pieces }
    }

    /// No point of the arm is farther than this from any of its joints' axes, mm.
    fn longest_mm(&self) -> f64 {
        let chain: f64 = self.dh.iter().map(|[a, d, _]| a.abs() + d.abs()).sum();
        let out = |(from, to, radius_mm): &Piece| from.norm().max(to.norm()) + radius_mm;
        chain + self.pieces.iter().flatten().map(out).fold(0.0, f64::max)
    }

    /// The frames of the links, base first, and of the flange. A link's frame is that of its joint after the rotation, before the
    /// row's own offsets.
    fn frames(&self, q: &[f64]) -> Vec<Isometry3<f64>> {
        let mut frame = Isometry3::identity();
        let mut frames = vec![frame];
        for ([a, d, alpha], q) in self.dh.iter().zip(q) {
            frame *= UnitQuaternion::from_axis_angle(&Vector3::z_axis(), *q);
            frames.push(frame);
            frame *= Isometry3::from_parts(
                Translation3::new(*a, 0.0, *d),
                UnitQuaternion::from_axis_angle(&Vector3::x_axis(), *alpha),
            );
        }
        frames.push(frame);
        frames
    }

    /// Links in base; the handpiece moves with the last.
    fn placed(&self, q: &[f64]) -> Vec<Vec<Piece>> {
        let frames = self.frames(q);
        let placed = |(link, pieces): (usize, &Vec<Piece>)| {
            let frame = frames[link.min(HANDPIECE - 1)];
            let at = |p: &Vector3<f64>| frame.transform_point(&(*p).into()).coords;
            pieces.iter().map(|(from, to, radius_mm)| (at(from), at(to), *radius_mm)).collect()
        };
        self.pieces.iter().enumerate().map(placed).collect()
    }

    /// By how much links of a calibrated arm may be elsewhere than the table says, mm.
    fn deviation_mm(&self, plan: &StoredPlan, stops: &[Stop]) -> Result<f64, VerifyError> {
        let burr = plan.record.frames.flange_from_burr.0;
        let mut most_mm = 0f64;
        for Stop { q, .. } in stops {
            let Some(flange) = self.frames(q).last().copied() else { continue };
            let there = [plan.arm.forward(q)?.translation_mm, plan.arm.burr(q)?.translation_mm];
            let here =
                [Vector3::zeros(), Vector3::from(burr)].map(|p| flange.transform_point(&p.into()).coords);
            most_mm =
                there.iter().zip(here).map(|(there, here)| (there - here).norm()).fold(most_mm, f64::max);
        }
        Ok(DEVIATIONS * most_mm)
    }
}

/// The handpiece from the shank's thick end on, and from there straight to the flange, in the flange's link.
fn handpiece(case: &Case, d6_mm: f64) -> Vec<Piece> {
    let (Some((translation_mm, [roll, pitch, yaw])), Some(last)) =
        (case.robot.flange_from_burr, case.shank.last())
    else {
        return vec![];
    };
    let flange = Vector3::new(0.0, 0.0, d6_mm);
    let (burr, turn) =
        (flange + Vector3::from(translation_mm), Rotation3::from_euler_angles(roll, pitch, yaw));
    let end_mm: f64 = case.burr.radius_mm + case.shank.iter().map(|s| s.length_mm).sum::<f64>();
    let along = |mm: f64| burr + turn * Vector3::new(0.0, 0.0, mm);
    let (front, back) = (along(end_mm - last.length_mm), along(end_mm));
    vec![(front, back, last.radius_mm), (back, flange, last.radius_mm)]
}

/// What a deviation of the moving links takes off a distance of one of them, mm.
fn allowance_mm(link: usize, off_mm: f64) -> f64 {
    if link == BASE { 0.0 } else { off_mm }
}

/// The least distance along an axis, mm, or `least_mm` where it is not below that. A distance is convex along a line, and falls by at most the way.
fn lowered(
    least_mm: f64,
    (from, to): (&Vector3<f64>, &Vector3<f64>),
    distance_mm: impl Fn(&Vector3<f64>) -> f64,
) -> f64 {
    let at = |share: f64| distance_mm(&from.lerp(to, share));
    if at(0.5) - 0.5 * (to - from).norm() >= least_mm {
        return least_mm;
    }
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..SEARCHED {
        let (a, b) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
        if at(a) <= at(b) { high = b } else { low = a }
    }
    [0.0, 0.5 * (low + high), 1.0].map(at).into_iter().fold(least_mm, f64::min)
}

/// The least distance of links from obstacles and from each other.
fn among(placed: &[Vec<Piece>], solids: &[Solid], pairs: &[(usize, usize)], off_mm: f64) -> Option<Near> {
    let mut near: Option<Near> = None;
    let mut take = |link: usize, other: usize, less_mm: f64, distance_mm: &dyn Fn(&Vector3<f64>) -> f64| {
        for (from, to, radius_mm) in &placed[link] {
            let before = near.map_or(f64::INFINITY, |near| near.mm);
            let mm = lowered(before, (from, to), |p| distance_mm(p) - radius_mm - less_mm);
            if mm < before {
                near = Some(Near { mm, link, other });
            }
        }
    };
    for (i, k) in pairs {
        let less_mm = allowance_mm(*i, off_mm) + allowance_mm(*k, off_mm);
        for (from, to, radius_mm) in &placed[*i] {
            take(*k, *i, less_mm, &|p| to_segment_mm(p, from, to) - radius_mm);
        }
    }
    for link in BASE..placed.len() {
        let held =
            solids.iter().enumerate().filter(|(_, solid)| link != BASE || solid.highest_mm > MOUNTED_MM);
        for (n, solid) in held {
            take(link, LINKS_AND_HANDPIECE + n, allowance_mm(link, off_mm), &|p| solid.distance_mm(p));
        }
    }
    near
}

/// The least distance of links from the patient, mm.
fn from_tissue(
    placed: &[Vec<Piece>],
    tissue: &Tissue,
    ct_from_base: &Isometry3<f64>,
    off_mm: f64,
) -> Option<Near> {
    let of_link = |link: usize| {
        let of_piece = |(from, to, radius_mm): &Piece| {
            let steps = ((to - from).norm() / AXIS_MM).ceil().max(1.0) as usize;
            let points = (0..=steps).map(|n| from.lerp(to, n as f64 / steps as f64));
            let far = points.map(|p| tissue.distance_mm(&ct_from_base.transform_point(&p.into()).coords));
            far.fold(f64::INFINITY, f64::min) - radius_mm
        };
        let mm = placed[link].iter().map(of_piece).fold(f64::INFINITY, f64::min);
        Near { mm: mm - allowance_mm(link, off_mm), link, other: link }
    };
    (BASE..HANDPIECE).map(of_link).min_by(|a, b| a.mm.total_cmp(&b.mm))
}

#[cfg(test)]
mod tests;
