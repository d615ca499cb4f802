//! Verifies a drilled channel or a reaming.
//!
//! The line, the clearances, the probabilities of touching, the holder and the volumes are computed again: distances are exact to the
//! label boxes, probabilities come from drawn motions of the patient, the tool's swept solid from its dimensions in the case. Motion,
//! registration and provenance are checked as for any plan. Not judged: forces in newtons, and whether the guide of a reamer has
//! its pilot hole.

mod asked;
mod cover;
mod sweep;

use bonemill_case::{Case, ChannelSpec, Registration};
use bonemill_geometry::{Ct, Point, Progress, Work, cancel};
use bonemill_planfile::{ChannelRecord, StoredPlan, Value};
use nalgebra::{Matrix3, Matrix6, Vector3};

pub use self::cover::{Cover, ToolPlace};
pub use self::sweep::OwnSolid;
use super::anatomy::Anatomy;
use super::boxes::Boxes;
use super::check::{Check, Place};
use super::moves::{MoveClass, Moves};
use super::uncertainty::{ErrorModel, RigidError, UncertaintyError, simulate_errors};
use super::{Evidence, VerifyError};

/// What a written clearance may differ from the one found here, mm: both searches tell at most 1e-3 mm too little.
const CLEARANCE_TOLERANCE_MM: f64 = 2.5e-3;
/// Share of the tool's radius by which the planner may tell a clearance too small where a flat front faces a flat wall.
const FLAT_SHARE: f64 = 0.03;
/// Between two tested rows of the trajectory the tool may come nearer by this, mm.
const ROW_SLACK_MM: f64 = 0.02;
/// How far beyond the nearest row so far a row's distance is searched, mm: rows after a far one are passed over.
const LOOK_MM: f64 = 2.0;
/// Rounding of lengths in the files, mm, of directions and of speeds.
const ROUNDING: f64 = 1e-6;
/// Draws of the registration's error, and their seed.
const DRAWS: usize = 20_000;
const SEED: u64 = 1;

/// The checks that only a channel has.
///
/// # Errors
/// [`VerifyError`] when a row is no joint vector of the arm.
pub fn checks(
    evidence: &Evidence,
    spec: &ChannelSpec,
    progress: &dyn Progress,
) -> Result<Vec<Check>, VerifyError> {
    let Evidence { plan, anatomy, boxes, moves, .. } = *evidence;
    progress.stage("check the channel");
    let solid = OwnSolid::new(&plan.record.case.tool, |file| plan.input_path(file))?;
    let mut checks = vec![asked::meets(plan)];
    let Some(channel) = plan.record.channel() else {
        checks.push(Check::none_wrong("plan says its channel", 1).of("metrics.channel"));
        return Ok(checks);
    };
    let off_mm = (channel.radius_mm - solid.radius_mm()).abs();
    checks.push(Check::at_most("tool of the case", off_mm, ROUNDING, "mm").of("radius"));
    checks.extend(asked::rows(plan, spec, &channel, moves));
    checks.extend(asked::channel(plan, spec, &channel, anatomy, &solid));
    checks.extend(clearances(evidence, &channel, &solid));
    checks.extend(holder(&plan.record.case, &channel, anatomy, boxes, &solid));
    checks.extend(sweep::volumes(plan, &channel, anatomy, &solid));
    checks.extend(touched(plan, spec, progress)?);
    Ok(checks)
}

/// The tool's solid against every structure: on its way along the channel, and along the trajectory.
fn clearances(evidence: &Evidence, channel: &ChannelRecord, solid: &OwnSolid) -> Vec<Check> {
    let Evidence { plan, moves, .. } = *evidence;
    let Some(cover) = Cover::new(solid) else {
        return vec![Check::none_wrong("tool of the case", 1).of("a solid")];
    };
    let ct_from_grid = plan.record.frames.ct_from_grid();
    let depth = |p: &Vector3<f64>| {
        (ct_from_grid * Point::<Work>::from_coords(*p) - channel.entry).dot(&channel.direction)
    };
    let first_mm = moves.points.iter().map(depth).fold(f64::INFINITY, f64::min);
    let deepest =
        (0..moves.points.len()).max_by(|a, b| depth(&moves.points[*a]).total_cmp(&depth(&moves.points[*b])));
    let tool = ToolPlace { tip: channel.end(), out: -channel.direction.into_inner() };
    evidence.of_structures(|kept, boxes| {
        let limit = kept.clearance_mm - CLEARANCE_TOLERANCE_MM;
        let mut checks = Vec::new();
        if let Some(n) = deepest {
            let found = cover.exact_mm(boxes, &tool, channel.depth_mm - first_mm);
            let check = Check::at_least("clearance of moves", found, limit, "mm").of(kept.name.clone());
            checks.push(check.at(Place::Waypoint(n)));
            let said = written(plan, &kept.name, "clearance_mm").unwrap_or(f64::NAN);
            // a flat front before a flat wall is told a little nearer
            let below_mm = (found - said - FLAT_SHARE * solid.radius_mm()).max(said - found);
            let off = Check::at_most("clearance as written", below_mm, CLEARANCE_TOLERANCE_MM, "mm");
            checks.push(off.of(kept.name.clone()));
        }
        if let Some((found, row)) = along_trajectory(evidence, &cover, boxes) {
            // the trajectory may leave the line by what a plan's trajectory may
            let limit = limit - 0.05;
            let check = Check::at_least("clearance of the arm's tool", found, limit, "mm");
            checks.push(check.of(kept.name.clone()).at(evidence.instant(row)));
        }
        checks
    })
}

/// The least distance of the tool's solid from a structure along the trajectory, mm, at most [`ROW_SLACK_MM`] too small, and its
/// row. Rows since which the tool has moved too little to come nearer are passed over.
fn along_trajectory(evidence: &Evidence, cover: &Cover, boxes: &Boxes<'_>) -> Option<(f64, usize)> {
    let Evidence { plan, executed, .. } = *evidence;
    let ct_from_grid = plan.record.frames.ct_from_grid();
    let balls = cover.balls(0.0);
    let reach_mm = balls.iter().map(|ball| ball.at.norm() + ball.radius_mm).fold(0.0, f64::max);
    let mut best: Option<(f64, usize)> = None;
    let (mut known_mm, mut at) = (f64::NEG_INFINITY, 0);
    for row in 0..executed.len() {
        cancel::poll();
        let moved_mm = (executed.points[row] - executed.points[at]).norm()
            + (executed.axes[row] - executed.axes[at]).norm() * reach_mm;
        let least_mm = best.map_or(f64::INFINITY, |best| best.0);
        if known_mm - moved_mm >= least_mm - ROW_SLACK_MM {
            continue;
        }
        let tip = ct_from_grid * Point::<Work>::from_coords(executed.points[row]);
        let tool = ToolPlace { tip, out: ct_from_grid.rotate(&executed.axes[row]) };
        // nothing is looked for that is farther than the nearest so far by more than this
        let farthest_mm = least_mm + LOOK_MM;
        let gap = |gap_mm: f64, ball: &cover::CoverBall| {
            let found = boxes.nearest_within(tool.place(&ball.at), (gap_mm + ball.radius_mm).max(0.0));
            found.map_or(gap_mm, |(distance_mm, _)| gap_mm.min(distance_mm - ball.radius_mm))
        };
        (known_mm, at) = (balls.iter().fold(farthest_mm, gap), row);
        if known_mm < least_mm {
            best = Some((known_mm, row));
        }
    }
    best.map(|(mm, row)| (mm - ROW_SLACK_MM, row))
}

/// A number that the plan writes of a structure.
fn written(plan: &StoredPlan, structure: &str, key: &str) -> Option<f64> {
    let table = |entries: &[(String, Value)], key: &str| {
        entries.iter().find(|(name, _)| name == key).map(|(_, value)| value.clone())
    };
    let Value::Table(kept) = table(&plan.record.metrics.more, "kept")? else { return None };
    let Value::Table(of) = table(&kept, structure)? else { return None };
    match table(&of, key)? {
        Value::Number(v) => Some(v),
        Value::Integer(v) => Some(v as f64),
        _ => None,
    }
}

/// How often the tool touches each structure under drawn errors of the registration.
fn touched(
    plan: &StoredPlan,
    spec: &ChannelSpec,
    progress: &dyn Progress,
) -> Result<Vec<Check>, VerifyError> {
    const NAME: &str = "probability of touching";
    let registration = match rigid_error(&plan.record.case, spec) {
        Ok(error) => error,
        Err(error) => return Ok(vec![Check::none_wrong(NAME, 1).noting(error.to_string())]),
    };
    let model = ErrorModel {
        registration,
        boundary_sigma_mm: 0.0,
        density_share: 0.0,
        coefficient_share: 0.0,
        samples: DRAWS,
        seed: SEED,
        keep: 1.0 - spec.touch_probability,
    };
    let risk = match simulate_errors(plan, &model, progress) {
        Ok(risk) => risk,
        Err(UncertaintyError::Verify(error)) => return Err(error),
        Err(error) => return Ok(vec![Check::none_wrong(NAME, 1).noting(error.to_string())]),
    };
    let check = |found: &super::uncertainty::StructureRisk| {
        let share = found.touched;
        let note = format!(
            "lower end of the 95 % interval; {} of {} drawn motions touch it: {:.2e}, at most {:.2e}; the plan says {:.2e}",
            share.hits,
            share.samples,
            share.estimate,
            share.high,
            written(plan, &found.name, "touch_probability").unwrap_or(f64::NAN)
        );
        Check::at_most(NAME, share.low, spec.touch_probability, "").of(found.name.clone()).noting(note)
    };
    Ok(risk.structures.iter().map(check).collect())
}

/// The registration's error: that of the fiducials' fit, else the case's standard deviation along each axis.
///
/// With residuals of variance σ² = FLE²/3 along each axis, FLE² = FRE²/(1 − 2/N): σ²/N of the translation and σ² K⁻¹ of the rotation about the
/// centroid, K = Σ (|qᵢ|² 1 − qᵢ qᵢᵀ).
fn rigid_error(case: &Case, spec: &ChannelSpec) -> Result<RigidError, UncertaintyError> {
    let Registration::Fiducials { ct_mm, base_mm } = &case.robot.base_from_ct else {
        let sigma = spec.registration_sigma_mm;
        return RigidError::of_sigmas([sigma; 3], [0.0; 3], Point::new(0.0, 0.0, 0.0));
    };
    let n = ct_mm.len() as f64;
    let mean = |points: &[[f64; 3]]| points.iter().map(|p| Vector3::from(*p)).sum::<Vector3<f64>>() / n;
    let (ct_middle, base_middle) = (mean(ct_mm), mean(base_mm));
    let pairs = || {
        ct_mm
            .iter()
            .zip(base_mm)
            .map(|(a, b)| (Vector3::from(*a) - ct_middle, Vector3::from(*b) - base_middle))
    };
    // the best rotation leaves Σ|a|² + Σ|b|² − 2 tr(R H), with tr(R H) the sum of the signed singular values
    let cross: Matrix3<f64> = pairs().map(|(a, b)| a * b.transpose()).sum();
    let singular = cross.singular_values();
    let trace = singular[0] + singular[1] + singular[2] * cross.determinant().signum();
    let squares: f64 = pairs().map(|(a, b)| a.norm_squared() + b.norm_squared()).sum::<f64>() - 2.0 * trace;
    let variance = squares.max(0.0) / n / (1.0 - 2.0 / n) / 3.0;
    let inertia: Matrix3<f64> =
        pairs().map(|(a, _)| Matrix3::identity() * a.norm_squared() - a * a.transpose()).sum();
    let mut covariance = Matrix6::zeros();
    covariance.fixed_view_mut::<3, 3>(0, 0).copy_from(&(Matrix3::identity() * (variance / n)));
    let rotation = inertia.try_inverse().unwrap_or_else(Matrix3::zeros) * variance;
    covariance.fixed_view_mut::<3, 3>(3, 3).copy_from(&(0.5 * (rotation + rotation.transpose())));
    RigidError::new(covariance, Point::from_coords(ct_middle))
}

/// The thick part of the shank at the deepest place: bone in it by voxel centres, and its distance to structures.
fn holder(
    case: &Case,
    channel: &ChannelRecord,
    anatomy: &Anatomy,
    boxes: &[Option<Boxes<'_>>],
    solid: &OwnSolid,
) -> Vec<Check> {
    let radius = solid.radius_mm();
    let out = -channel.direction.into_inner();
    let end = channel.end();
    let mut from_mm = solid.top_mm();
    let mut thick = Vec::new();
    for segment in &case.shank {
        let to_mm = from_mm + segment.length_mm;
        if segment.radius_mm > radius || !thick.is_empty() {
            thick.push([from_mm, to_mm, segment.radius_mm]);
        }
        from_mm = to_mm;
    }
    let grid = anatomy.ct.grid();
    let in_holder = |p: Point<Ct>| {
        let along = (p - end).dot(&out);
        let across = (p - end - out * along).norm();
        thick.iter().any(|[from, to, r]| (*from..=*to).contains(&along) && across <= *r)
    };
    let bone = anatomy.ct.data().iter().enumerate();
    let bone = bone.filter(|(_, hu)| f64::from(**hu) >= case.density.bone_hu);
    let wrong = bone.filter(|(n, _)| in_holder(grid.center(grid.voxel(*n)))).count();
    let mut checks = vec![Check::none_wrong("bone voxels in the holder", wrong)];
    for (kept, boxes) in anatomy.kept.iter().zip(boxes) {
        let Some(boxes) = boxes else { continue };
        for [from, to, r] in &thick {
            let limit = kept.shank_clearance_mm;
            let cut_mm = limit + r + 1.0;
            // a lower bound of the distance, too small by at most half a voxel's diagonal
            let found = boxes.kept_by_line(end + out * *from, end + out * *to, cut_mm) - r;
            let slack = 0.5 * anatomy.labels.grid().diagonal_mm();
            let check = Check::at_least("clearance of the holder", found, limit - slack, "mm");
            checks.push(check.of(kept.name.clone()).noting("to half a voxel's diagonal"));
        }
    }
    checks
}

/// Whether a move removes something, by its word.
fn is_cut(moves: &Moves, n: usize) -> bool {
    moves.kinds.get(n) == Some(&MoveClass::Cut)
}
