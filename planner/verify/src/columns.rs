//! Checks the rows of `waypoints.csv` against each other, the case and the patient.
//!
//! Each column that follows from others is computed again: angles from the axis, the nearest structure and its distance,
//! α₁, the force toward it, the cost. Speeds and tilt are compared with the case.

use bonemill_case::{Case, ForceTerm, SeveralStructures};
use bonemill_geometry::basis;
use bonemill_planfile::{StoredPlan, Waypoint};
use nalgebra::Vector3;
use rayon::prelude::*;

use super::anatomy::Kept;
use super::boxes::Boxes;
use super::check::{Check, Place};
use super::moves::{Executed, MoveClass, Moves, angle_rad};

/// Rounding of sums and of the file, for angles (rad), ratios and α₁.
pub(super) const ROUNDING: f64 = 1e-6;
/// For smaller α₁ the planner does not evaluate the force, and the cost is that of the inertia alone.
const NO_FORCE_ALPHA: f64 = 1e-3;
/// A structure farther from the burr's surface than its clearance plus this is in no cost, unless it is the nearest, mm.
pub(super) const INFLUENCE_MM: f64 = 8.0;
/// What is to remove nothing may be slower than the slowest cut by this share where it meets a skin.
const SKIN_SHARE: f64 = 0.1;
/// Among structures with α of at least this share of the largest, the first in priority counts.
const CLOSE_SHARE: f64 = 0.5;
/// Largest distance by which the trajectory may cut a corner, mm.
const PLACE_MM: f64 = 0.05;
/// Largest deviation of the trajectory's axis from the waypoints' axis, rad.
const AXIS_RAD: f64 = 0.005;

/// The largest deviation of a column and its row.
#[derive(Debug, Clone, Copy)]
pub(super) struct Worst(pub f64, pub Option<usize>);

impl Worst {
    pub fn of(values: impl Iterator<Item = (usize, f64)>) -> Self {
        values.fold(Self(0.0, None), |worst, (n, value)| {
            // NaN is kept, so that the check fails
            if value > worst.0 || (value.is_nan() && !worst.0.is_nan()) {
                Self(value, Some(n))
            } else {
                worst
            }
        })
    }

    pub fn check(self, name: &'static str, subject: &str, limit: f64, unit: &'static str) -> Check {
        Check::at_most(name, self.0, limit, unit).of(subject).at(self.1.map(Place::Waypoint))
    }
}

/// Checks kinds, times, angles, speeds and tilt.
pub fn rows(plan: &StoredPlan, moves: &Moves, executed: &Executed) -> Vec<Check> {
    let (rows, case) = (&plan.waypoints, &plan.record.case);
    let approach_from_ct = plan.record.frames.ct_from_approach.inverse();
    let all = || rows.iter().enumerate();
    let starts_free = rows.first().is_some_and(|w| moves.kinds[0] == MoveClass::Free && w.time_s == 0.0);
    let falls = Worst::of(moves.times_s.windows(2).enumerate().map(|(n, t)| (n + 1, t[0] - t[1])));
    let unit = Worst::of(all().map(|(n, w)| (n, (w.axis.norm() - 1.0).abs())));
    let angles = Worst::of(all().map(|(n, w)| {
        let said = basis::axis_from_angles(w.theta_rad, w.phi_rad);
        (n, (said - approach_from_ct.rotate(&w.axis)).amax())
    }));
    let steps = Worst::of(all().skip(1).map(|(n, w)| {
        let span = moves.times_s[n] - moves.times_s[n - 1];
        // corners at both ends may be cut; a move that only turns may take any time
        let way = (moves.arc_mm[n] - moves.arc_mm[n - 1] - 2.0 * PLACE_MM).max(0.0);
        (n, if way > 0.0 { way / (span * w.speed_mm_s) } else { 0.0 })
    }));
    let speed = |kind, low: f64, high: f64| {
        Worst::of(all().filter(|(n, _)| moves.kinds[*n] == kind).map(|(n, w)| {
            let v = w.speed_mm_s;
            let low = if w.mass_mg > 0.0 { low } else { SKIN_SHARE * low };
            (n, if v.is_finite() { (low - v).max(v - high).max(0.0) } else { f64::INFINITY })
        }))
    };
    let cuts = (1..moves.len()).filter(|n| moves.kinds[*n] == MoveClass::Cut);
    let lengths = Worst::of(cuts.map(|n| (n, moves.arc_mm[n] - moves.arc_mm[n - 1])));
    let s = &case.speed;
    let mut checks = vec![
        Check::none_wrong("rows", usize::from(!starts_free)).of("the first is a link at 0 s"),
        falls.check("rows", "the clock never falls back", 0.0, "s"),
        unit.check("rows", "axes are of length 1", ROUNDING, ""),
        angles.check("rows", "θ and φ are those of the axis", ROUNDING, ""),
        steps.check("rows", "mean speed of moves", 1.0 + 1e-3, "of the cap"),
        speed(MoveClass::Cut, s.min_mm_s, s.max_mm_s).check(
            "rows",
            "caps of cuts lie in the range",
            ROUNDING,
            "mm/s",
        ),
        speed(MoveClass::Free, 0.0, s.link_mm_s).check("rows", "caps of links", ROUNDING, "mm/s"),
        lengths.check("rows", "length of cuts", case.path.step_mm + ROUNDING, "mm"),
    ];
    checks.extend(tilt(plan, moves, executed));
    checks
}

/// Checks the tilt of cuts, at their ends, at their starts, and between.
fn tilt(plan: &StoredPlan, moves: &Moves, executed: &Executed) -> Vec<Check> {
    let limit = plan.record.case.orientation.tilt_limit_rad;
    let tilt = |axis: &Vector3<f64>| angle_rad(axis, &Vector3::z());
    let cuts = || (1..moves.len()).filter(|n| moves.kinds[*n] == MoveClass::Cut);
    let ends = Worst::of(cuts().map(|n| (n, tilt(&moves.axes[n]))));
    let begins = Worst::of(cuts().map(|n| (n, tilt(&moves.axes[n - 1]))));
    let way = (0..executed.len())
        .filter(|row| moves.kinds.get(executed.next[*row] as usize) == Some(&MoveClass::Cut))
        .map(|row| (row, tilt(&executed.axes[row])))
        .fold((0.0, None), |worst, (row, tilt)| if tilt > worst.0 { (tilt, Some(row)) } else { worst });
    let degrees = |worst: Worst, subject, limit: f64| {
        Worst(worst.0.to_degrees(), worst.1).check("tilt of cuts", subject, limit.to_degrees(), "°")
    };
    let instant = way.1.map(|row| Place::Instant {
        time_s: plan.trajectory.time_s[row],
        waypoint: executed.next[row] as usize,
    });
    vec![
        degrees(ends, "where they end", limit + ROUNDING),
        degrees(begins, "where they begin", limit + ROUNDING),
        Check::at_most("tilt of cuts", way.0.to_degrees(), (limit + AXIS_RAD).to_degrees(), "°")
            .of("on the way")
            .at(instant),
    ]
}

/// Deviations of one row's values about structures from the values computed again.
#[derive(Debug, Clone, Copy, Default)]
struct Again {
    /// If the row names another structure than the nearest: how much farther that structure is, mm.
    structure: f64,
    distance: f64,
    alpha: f64,
    toward: f64,
    cost: f64,
}

/// Checks nearest structure, distance, α₁, force toward it and cost.
pub fn structures(plan: &StoredPlan, kept: &[Kept], boxes: &[Option<Boxes<'_>>]) -> Vec<Check> {
    let case = &plan.record.case;
    let again: Vec<Again> = plan.waypoints.par_iter().map(|row| row_again(row, case, kept, boxes)).collect();
    let worst = |of: fn(&Again) -> f64| Worst::of(again.iter().map(of).enumerate());
    vec![
        worst(|a| a.structure).check("columns", "structure", ROUNDING, "mm"),
        worst(|a| a.distance).check("columns", "distance_mm", ROUNDING, "mm"),
        worst(|a| a.alpha).check("columns", "alpha1", ROUNDING, ""),
        worst(|a| a.toward).check("columns", "force_toward_n", ROUNDING, "N"),
        worst(|a| a.cost).check("columns", "cost", 2.0 * NO_FORCE_ALPHA, ""),
    ]
}

fn row_again(row: &Waypoint, case: &Case, kept: &[Kept], boxes: &[Option<Boxes<'_>>]) -> Again {
    let slack = |n: usize| {
        let boxes = boxes.get(n)?.as_ref()?;
        Some(boxes.distance_mm(row.position) - kept.get(n)?.clearance_mm)
    };
    let radius = case.burr.radius_mm;
    let alpha_of =
        |slack: f64| case.cost.alpha_max * (-case.cost.kappa_per_mm * (slack - radius).max(0.0)).exp();
    let nearest = (0..kept.len()).filter_map(slack).min_by(f64::total_cmp);
    let Some(own) = row.structure else {
        // the row names no structure, so none must be near
        let alpha = nearest.map_or(0.0, alpha_of);
        return Again { alpha: if alpha < NO_FORCE_ALPHA { 0.0 } else { alpha }, ..Again::default() };
    };
    let (Some(own_slack), Some(nearest)) = (slack(own), nearest) else {
        return Again { structure: f64::INFINITY, ..Again::default() };
    };
    let said = |cell: Option<f64>| cell.unwrap_or(f64::NAN);
    let in_reach = |n: &usize| slack(*n).is_some_and(|slack| *n == own || slack - radius <= INFLUENCE_MM);
    let near: Vec<Weighted> = (0..kept.len())
        .filter(in_reach)
        .filter_map(|n| Some(Weighted { structure: n, slack_mm: slack(n)?, alpha: alpha_of(slack(n)?) }))
        .collect();
    let looked_at = looked_at(near, own, case);
    let alpha: f64 = looked_at.iter().map(|w| w.alpha).sum();
    Again {
        structure: own_slack - nearest,
        distance: (said(row.distance_mm) - own_slack - kept[own].clearance_mm).abs(),
        alpha: (said(row.alpha1) - alpha).abs(),
        toward: toward_again(row, boxes.get(own).and_then(Option::as_ref)),
        cost: cost_again(row, case, &looked_at, boxes),
    }
}

/// A structure in a row's cost.
#[derive(Debug, Clone, Copy)]
struct Weighted {
    structure: usize,
    slack_mm: f64,
    alpha: f64,
}

/// The structures in the cost (D II-D): the nearest, `own`; or the first in priority among those of similar α; or all, with
/// their α scaled to a sum of at most 1.
fn looked_at(near: Vec<Weighted>, own: usize, case: &Case) -> Vec<Weighted> {
    match case.cost.structures {
        SeveralStructures::Nearest => near.into_iter().filter(|w| w.structure == own).collect(),
        SeveralStructures::Priority => {
            let most = near.iter().map(|w| w.alpha).fold(0.0, f64::max);
            let rank = |w: &Weighted| case.structures.get(w.structure).map_or(u32::MAX, |s| s.priority);
            let order =
                |a: &Weighted, b: &Weighted| rank(a).cmp(&rank(b)).then(a.slack_mm.total_cmp(&b.slack_mm));
            near.into_iter().filter(|w| w.alpha >= CLOSE_SHARE * most).min_by(order).into_iter().collect()
        }
        SeveralStructures::Sum => {
            let scale = near.iter().map(|w| w.alpha).sum::<f64>().max(1.0).recip();
            near.into_iter().map(|w| Weighted { alpha: scale * w.alpha, ..w }).collect()
        }
    }
}

/// Deviation of the force toward the structure from max(0, F·u), N. Where several points are equally near, u may be the
/// direction to any of them: the nearest point is computed again from positions very close to the burr's centre.
fn toward_again(row: &Waypoint, boxes: Option<&Boxes<'_>>) -> f64 {
    let (Some(said), Some(boxes)) = (row.force_toward_n, boxes) else { return f64::INFINITY };
    towards(row, boxes, &row.force_n).map(|toward| (toward - said).abs()).fold(f64::INFINITY, f64::min)
}

/// The components of a force toward the nearest points of a structure, not negative, N.
fn towards<'a>(
    row: &Waypoint,
    boxes: &'a Boxes<'_>,
    force: &Vector3<f64>,
) -> impl Iterator<Item = f64> + use<'a> {
    const HAIR_MM: f64 = 1e-6;
    let (position, force) = (row.position, *force);
    let axes = [Vector3::x(), Vector3::y(), Vector3::z()].map(|v: Vector3<f64>| v * HAIR_MM);
    let beside = axes.into_iter().flat_map(|s| [s, -s]);
    std::iter::once(Vector3::zeros()).chain(beside).map(move |shift| {
        let (_, q) = boxes.nearest(position + shift);
        (q - position).try_normalize(1e-9).map_or(0.0, |u| force.dot(&u).max(0.0))
    })
}

/// Deviation of C from Σ α F_v/|F| + (1 − Σ α)(1 − I_n) (D5 to D7), where the row holds C and determines it: for the cutting
/// force without edge terms, whose direction does not depend on the speed.
fn cost_again(row: &Waypoint, case: &Case, looked_at: &[Weighted], boxes: &[Option<Boxes<'_>>]) -> f64 {
    let follows = case.cost.force == ForceTerm::Cutting && case.material.k_edge_n_mm == [0.0; 3];
    let (Some(said), Some(inertia), true) = (row.cost, row.inertia, follows) else { return 0.0 };
    let force = Some(row.force_n).filter(|f| f.norm() > 0.0);
    let alpha: f64 = looked_at.iter().map(|w| w.alpha).sum();
    // a range from least to most, because several points of a structure may be equally near
    let mut least = (1.0 - alpha) * (1.0 - inertia);
    let mut most = least;
    for w in looked_at {
        let (Some(force), Some(boxes)) = (&force, boxes.get(w.structure).and_then(Option::as_ref)) else {
            continue;
        };
        let (low, high) = towards(row, boxes, force)
            .fold((f64::INFINITY, 0f64), |(low, high), v| (low.min(v), high.max(v)));
        least += w.alpha * low / force.norm();
        most += w.alpha * high / force.norm();
    }
    (least - said).max(said - most).max(0.0)
}
