//! Checks the distance of the arm's links from the patient, from obstacles and from each other along the trajectory.
//!
//! Links are the capsules that the arm's data give; where they are follows from the DH table by products of matrices here. The
//! trajectory is walked in steps on which no point of the arm moves more than [`STEP_MM`], and every capsule's axis is sampled
//! each [`AXIS_MM`]: a distance that is found errs by at most half of both, to the high side. The patient is sampled on a lattice
//! of [`LATTICE_MM`] from the CT by code of this module; distances from it err by a lattice cell's diagonal, which is allowed for.
//! The base is held against other links only, the handpiece against all but the patient.

use bonemill_arm::ur::UrModel;
use bonemill_arm::ur::links::{LINKS_AND_HANDPIECE, link_name, pairs_held_apart};
use bonemill_case::{Case, HeadSource, ObstacleFrame, ObstacleShape};
use bonemill_geometry::cancel;
use bonemill_planfile::StoredPlan;
use nalgebra::{Isometry3, Rotation3, Translation3, UnitQuaternion, Vector3};
use rayon::prelude::*;

use super::anatomy::Anatomy;
use super::check::{Check, Place};
use super::moves::Executed;
use crate::head::Tissue;

/// Largest motion of a point of the arm from one walked row to the next, mm.
const STEP_MM: f64 = 2.0;
/// Distance of samples on a capsule's axis, mm.
const AXIS_MM: f64 = 4.0;
/// Tolerance of a distance from obstacles and links, because the motion rounds corners, mm.
const ROUNDED_MM: f64 = 0.5;
/// The handpiece's place among the links.
const HANDPIECE: usize = LINKS_AND_HANDPIECE - 1;

/// A capsule in its link's frame: ends and radius, mm.
type Piece = (Vector3<f64>, Vector3<f64>, f64);

/// A link's capsules with points along their axes, in base.
type PlacedPiece = (Vec<Vector3<f64>>, f64);

/// The links of a plan's arm.
struct Links {
    /// a, d and α by joint, mm and rad.
    dh: [[f64; 3]; 6],
    pieces: Vec<Vec<Piece>>,
}

/// Checks a UR's links. None without a clearance in the case, and for arms whose links are not known.
pub fn room(plan: &StoredPlan, anatomy: &Anatomy, executed: &Executed) -> Vec<Check> {
    let case = &plan.record.case;
    let (Some(clearance_mm), Some(model)) =
        (case.robot.room.link_clearance_mm, UrModel::by_name(&case.robot.model))
    else {
        return vec![];
    };
    let links = Links::new(model, case);
    let base_from_ct = &plan.record.frames.base_from_ct;
    let base_from_ct = Isometry3::from_parts(
        Translation3::from(base_from_ct.translation_mm),
        UnitQuaternion::from_rotation_matrix(&base_from_ct.rotation),
    );
    let solids: Vec<Solid> = case.obstacles.iter().map(|o| Solid::new(o, &base_from_ct)).collect();
    let pairs: Vec<_> = pairs_held_apart().collect();
    let rows = walked(plan, links.longest_mm());
    let at = |row: usize| Place::Instant {
        time_s: plan.trajectory.time_s[row],
        waypoint: executed.next[row] as usize,
    };
    let least = |found: Vec<(f64, usize, String)>| found.into_iter().min_by(|a, b| a.0.total_cmp(&b.0));
    let mut checks = vec![];
    let to_solids = rows.par_iter().map(|row| {
        cancel::poll();
        let placed = links.placed(plan.trajectory.q_at(*row));
        let (mm, what) = among(&placed, &solids, &pairs);
        (mm, *row, what)
    });
    if let Some((mm, row, what)) = least(to_solids.collect()) {
        let limit = clearance_mm - ROUNDED_MM;
        let check = Check::at_least("links to obstacles and each other", mm, limit, "mm").at(at(row));
        checks.push(
            check.noting(format!("{what}; walked in steps of {STEP_MM} mm, axes sampled each {AXIS_MM} mm")),
        );
    }
    if case.robot.room.head == HeadSource::Scan
        && let Some(tissue) =
            Tissue::of(&anatomy.ct, case.robot.room.head_beyond_mm, &plan.record.frames.approach_direction)
    {
        let ct_from_base = base_from_ct.inverse();
        let to_tissue = rows.par_iter().map(|row| {
            cancel::poll();
            let placed = links.placed(plan.trajectory.q_at(*row));
            let (mm, what) = from_tissue(&placed, &tissue, &ct_from_base);
            (mm, *row, what)
        });
        if let Some((mm, row, what)) = least(to_tissue.collect()) {
            let limit = clearance_mm - tissue.error_mm();
            let check = Check::at_least("links to the patient", mm, limit, "mm").at(at(row));
            checks.push(
                check.noting(format!(
                    "{what}; distances from the scan err by up to {:.1} mm",
                    tissue.error_mm()
                )),
            );
        }
    }
    checks
}

/// Rows of the trajectory between which no point of the arm moves farther than [`STEP_MM`], with the first and the last.
fn walked(plan: &StoredPlan, longest_mm: f64) -> Vec<usize> {
    let q = |row: usize| plan.trajectory.q_at(row);
    let moved =
        |a: usize, b: usize| q(a).iter().zip(q(b)).map(|(a, b)| (a - b).abs()).sum::<f64>() * longest_mm;
    let mut rows = vec![0];
    for row in 1..plan.trajectory.len() {
        let last = rows[rows.len() - 1];
        if moved(last, row) > STEP_MM && row - 1 > last {
            rows.push(row - 1);
        }
    }
    rows.push(plan.trajectory.len() - 1);
    rows
}

impl Links {
    fn new(model: UrModel, case: &Case) -> Self {
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
        pieces.push(handpiece(case, g.d6_mm));
        Self { dh, pieces }
    }

    /// No point of the arm is farther than this from any of its joints' axes, mm.
    fn longest_mm(&self) -> f64 {
        let chain: f64 = self.dh.iter().map(|[a, d, _]| a.abs() + d.abs()).sum();
        let out = |(from, to, radius_mm): &Piece| from.norm().max(to.norm()) + radius_mm;
        chain + self.pieces.iter().flatten().map(out).fold(0.0, f64::max)
    }

    /// Links in base with samples on their axes. A link's frame is that of its joint after the rotation, before the row's own
    /// offsets.
    fn placed(&self, q: &[f64]) -> Vec<Vec<PlacedPiece>> {
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
        let placed = |(link, pieces): (usize, &Vec<Piece>)| {
            let frame = frames[link.min(frames.len() - 1)];
            let sampled = |(from, to, radius_mm): &Piece| {
                let steps = ((to - from).norm() / AXIS_MM).ceil().max(1.0) as usize;
                let point = |n: usize| {
                    let p = from + (to - from) * (n as f64 / steps as f64);
                    frame.transform_point(&p.into()).coords
                };
                ((0..=steps).map(point).collect(), *radius_mm)
            };
            pieces.iter().map(sampled).collect()
        };
        self.pieces.iter().enumerate().map(placed).collect()
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

/// The least distance of samples of one link from the sampled axes of another, mm.
fn apart_mm(a: &[PlacedPiece], b: &[PlacedPiece]) -> f64 {
    let mut least = f64::INFINITY;
    for (points, radius_mm) in a {
        for (others, other_mm) in b {
            let (Some(from), Some(to)) = (others.first(), others.last()) else { continue };
            let along = to - from;
            for p in points {
                let share = ((p - from).dot(&along) / along.norm_squared().max(1e-12)).clamp(0.0, 1.0);
                least = least.min((p - from - along * share).norm() - radius_mm - other_mm);
            }
        }
    }
    least
}

/// The least distance of links from obstacles and from each other, mm, and of what.
fn among(placed: &[Vec<PlacedPiece>], solids: &[Solid], pairs: &[(usize, usize)]) -> (f64, String) {
    let name = link_name;
    let mut least = (f64::INFINITY, None);
    for (link, pieces) in placed.iter().enumerate().skip(1) {
        for (n, solid) in solids.iter().enumerate() {
            for (points, radius_mm) in pieces {
                let mm =
                    points.iter().map(|p| solid.distance_mm(p)).fold(f64::INFINITY, f64::min) - radius_mm;
                if mm < least.0 {
                    least = (mm, Some((link, Err(n))));
                }
            }
        }
    }
    for (i, k) in pairs {
        let mm = apart_mm(&placed[*k], &placed[*i]);
        if mm < least.0 {
            least = (mm, Some((*k, Ok(*i))));
        }
    }
    let what = match least.1 {
        None => "nothing to keep away from".into(),
        Some((link, Ok(other))) => format!("{} and {}", name(link), name(other)),
        Some((link, Err(n))) => format!("{} and {}", name(link), solids[n].name),
    };
    (least.0, what)
}

/// The least distance of links from the patient, mm, and which.
fn from_tissue(placed: &[Vec<PlacedPiece>], tissue: &Tissue, ct_from_base: &Isometry3<f64>) -> (f64, String) {
    let mut least = (f64::INFINITY, 0);
    for (link, pieces) in placed.iter().enumerate().take(HANDPIECE).skip(1) {
        for (points, radius_mm) in pieces {
            let far =
                points.iter().map(|p| tissue.distance_mm(&ct_from_base.transform_point(&(*p).into()).coords));
            let mm = far.fold(f64::INFINITY, f64::min) - radius_mm;
            if mm < least.0 {
                least = (mm, link);
            }
        }
    }
    (least.0, link_name(least.1).to_owned())
}

/// An obstacle of the case.
struct Solid {
    name: String,
    own_from_base: Isometry3<f64>,
    shape: ObstacleShape,
}

impl Solid {
    fn new(obstacle: &bonemill_case::Obstacle, base_from_ct: &Isometry3<f64>) -> Self {
        let own_from_base = match obstacle.frame {
            ObstacleFrame::Base => Isometry3::identity(),
            ObstacleFrame::Ct => base_from_ct.inverse(),
        };
        Self { name: obstacle.name.clone(), own_from_base, shape: obstacle.shape }
    }

    /// Distance of a point in base from the surface, mm; negative inside.
    fn distance_mm(&self, p: &Vector3<f64>) -> f64 {
        let p = self.own_from_base.transform_point(&(*p).into()).coords;
        match &self.shape {
            ObstacleShape::Box { min_mm, max_mm } => {
                let past = (min_mm - p).sup(&(p - max_mm));
                let outside = past.map(|mm| mm.max(0.0)).norm();
                if outside > 0.0 { outside } else { past.max() }
            }
            ObstacleShape::Ball { center_mm, radius_mm } => (p - center_mm).norm() - radius_mm,
            ObstacleShape::Capsule { from_mm, to_mm, radius_mm } => {
                let along = to_mm - from_mm;
                let share = ((p - from_mm).dot(&along) / along.norm_squared().max(1e-12)).clamp(0.0, 1.0);
                (p - from_mm - along * share).norm() - radius_mm
            }
            ObstacleShape::Cylinder { from_mm, to_mm, radius_mm } => {
                let axis = (to_mm - from_mm).normalize();
                let (up, length) = ((p - from_mm).dot(&axis), (to_mm - from_mm).norm());
                let across = (p - from_mm - axis * up).norm() - radius_mm;
                let over = (-up).max(up - length);
                if across > 0.0 && over > 0.0 { across.hypot(over) } else { across.max(over) }
            }
        }
    }
}
