//! `bonemill export`: a finished plan as what a controller reads.

use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use bonemill_planner::path::MoveKind;
use bonemill_planner::plan::StoredPlan;
use bonemill_planner::space::TRAJECTORY_TOLERANCE_MM;
use bonemill_robot::arm::AxisPose;
use bonemill_robot::export::{
    Between, ExportRows, Gcode, GcodeMove, UrScript, write_gcode, write_ros_json, write_ros_yaml,
    write_urscript,
};
use bonemill_robot::resolve::{DensePath, PosePath, SpinFrame, resolve};
use bonemill_robot::{ArmKind, RobotError};
use nalgebra::Unit;

use crate::args::{ExportArgs, ExportFormat};
use crate::outcome::Outcome;

/// The fewest rows per second of a ROS trajectory; the controller interpolates with cubics.
const ROS_RATE_HZ: f64 = 50.0;
/// The fewest steps per second of a URScript program, straight in joint space: short programs load sooner.
const SCRIPT_RATE_HZ: f64 = 25.0;
/// How far the burr may be led aside of the plan's own trajectory by rows that are left out, mm: a fifth of what the
/// trajectory itself may leave the path by.
const LEFT_OUT_MM: f64 = 0.2 * TRAJECTORY_TOLERANCE_MM;

pub fn run(args: &ExportArgs) -> anyhow::Result<Outcome> {
    let plan = StoredPlan::load(&args.plan)?;
    let name =
        args.plan.canonicalize().ok().and_then(|path| Some(path.file_name()?.to_string_lossy().into_owned()));
    let name = name.unwrap_or_else(|| "plan".into());
    let at = |extension: &str| args.out.join(format!("{name}.{extension}"));
    fs::create_dir_all(&args.out).with_context(|| format!("cannot create {}", args.out.display()))?;
    let mut written = Vec::new();
    ensure!(!args.rapid || args.format == ExportFormat::Gcode, "--rapid is for G-code only");
    match args.format {
        ExportFormat::Ros => {
            let rows = rows(&plan, args.rate_hz, ROS_RATE_HZ, Between::Cubic)?;
            written.push(write_to(at("trajectory.json"), |out| write_ros_json(out, &rows))?);
            written.push(write_to(at("trajectory.yaml"), |out| write_ros_yaml(out, &rows))?);
        }
        ExportFormat::Urscript => {
            ensure!(
                plan.arm.kind() == ArmKind::Ur,
                "the plan is for robot.model = \"{}\"; URScript runs on ur3e, ur5e and ur10e only",
                plan.record.case.robot.model
            );
            let rows = rows(&plan, args.rate_hz, SCRIPT_RATE_HZ, Between::Straight)?;
            let mut options = UrScript::with_mount(plan.arm.mount());
            options.calibrated = plan.record.case.robot.calibration.is_some();
            written.push(write_to(at("script"), |out| write_urscript(out, &rows, &options))?);
        }
        ExportFormat::Gcode => {
            ensure!(args.rate_hz.is_none(), "--rate has no meaning for G-code, which has one block per move");
            written.push(gcode(&plan, at("ngc"), args.rapid)?);
        }
    }
    let names: Vec<String> = written.iter().map(|path| path.display().to_string()).collect();
    Ok(Outcome::written("export", &args.out, &names.join(", ")))
}

/// The trajectory's rows at about the rate that is asked for, or as few as lead the burr close enough to the trajectory.
fn rows(
    plan: &StoredPlan,
    asked_hz: Option<f64>,
    least_hz: f64,
    between: Between,
) -> anyhow::Result<ExportRows<'_>> {
    let sampled_hz = plan.record.case.robot.rate_hz;
    let rate_hz = asked_hz.unwrap_or(least_hz.min(sampled_hz));
    ensure!(
        rate_hz.is_finite() && rate_hz > 0.0 && rate_hz <= sampled_hz,
        "--rate {rate_hz} Hz: expected above 0 and at most the trajectory's {sampled_hz} Hz"
    );
    let t = &plan.trajectory;
    let mut stride = (sampled_hz / rate_hz).round().max(1.0) as usize;
    loop {
        let rows = ExportRows::new(plan.arm.joints(), &t.time_s, &t.q, &t.qd, stride)?;
        let (off_mm, row) = rows.deviation_mm(&plan.arm, between)?;
        if off_mm <= LEFT_OUT_MM {
            return Ok(rows);
        }
        ensure!(
            asked_hz.is_none(),
            "--rate {rate_hz} Hz: between rows {row} and {} the burr would be {off_mm:.4} mm aside of the planned \
             trajectory; expected at most {LEFT_OUT_MM:.3} mm: take a higher rate, or none to have one chosen",
            row + 1
        );
        stride = stride.div_ceil(2);
    }
}

/// The plan's moves as blocks, with places between waypoints where the tilt needs them.
fn gcode(plan: &StoredPlan, path: PathBuf, rapid: bool) -> anyhow::Result<PathBuf> {
    let base_from_ct = plan.record.base_from_ct;
    let poses: Vec<AxisPose> = plan
        .waypoints
        .iter()
        .map(|waypoint| AxisPose {
            position: base_from_ct * waypoint.position,
            axis: Unit::new_normalize(base_from_ct.rotate(&waypoint.axis)),
        })
        .collect();
    let mut length_mm = vec![0.0; poses.len().min(1)];
    length_mm.extend(poses.windows(2).map(|pair| pair[0].position.distance_mm(&pair[1].position)));
    let about = Unit::new_normalize(base_from_ct.rotate(&plan.record.approach_direction));
    let pose_path =
        PosePath { poses: &poses, length_mm: &length_mm, frame: SpinFrame::about(&about), stiffness: None };
    let dense = match resolve(&plan.arm, &pose_path)? {
        Ok(resolved) => DensePath::lay(&plan.arm, &pose_path, &resolved),
        Err(out_of_reach) => Err(out_of_reach),
    };
    let dense = match dense {
        Ok(dense) => dense,
        Err(failed) => bail!("the arm cannot reach waypoint {}: {}", failed.pose, failed.reason),
    };
    let moves = moves(plan, &dense);
    let burr = &plan.record.case.burr;
    let options = Gcode { spindle_rpm: burr.spindle_rpm, clockwise: burr.spin < 0, rapid };
    write_to(path, |out| write_gcode(out, plan.arm.joints(), &options, moves.iter().copied()).map(drop))
        .context("G-code is for Cartesian machines: three linear axes, at most one rotary axis behind them")
}

/// Every place's move; a waypoint's time is shared out by length.
fn moves<'a>(plan: &StoredPlan, dense: &'a DensePath) -> Vec<GcodeMove<'a>> {
    let dof = plan.arm.dof();
    let mut moves = Vec::with_capacity(dense.len());
    let mut first = 0;
    let mut before_s = 0.0;
    for (waypoint, &last) in plan.waypoints.iter().zip(&dense.waypoints) {
        let places = first..=last;
        let whole_mm: f64 = dense.burr_mm[places.clone()].iter().sum();
        let count = places.clone().count() as f64;
        for place in places {
            let share = if whole_mm > 0.0 { dense.burr_mm[place] / whole_mm } else { 1.0 / count };
            moves.push(GcodeMove {
                q: &dense.q[place * dof..(place + 1) * dof],
                duration_s: (waypoint.time_s - before_s) * share,
                cuts: waypoint.kind == MoveKind::Cut,
            });
        }
        first = last + 1;
        before_s = waypoint.time_s;
    }
    moves
}

/// Writes a file whole or not at all.
fn write_to(
    path: PathBuf,
    write: impl FnOnce(&mut BufWriter<File>) -> Result<(), RobotError>,
) -> anyhow::Result<PathBuf> {
    let partial = partial(&path);
    let written = || -> anyhow::Result<()> {
        let file = File::create(&partial).with_context(|| format!("cannot create {}", partial.display()))?;
        let mut out = BufWriter::with_capacity(1 << 20, file);
        write(&mut out)?;
        out.flush().with_context(|| format!("cannot write {}", partial.display()))?;
        fs::rename(&partial, &path).with_context(|| format!("cannot put {} into place", path.display()))
    };
    written().inspect_err(|_| {
        let _ = fs::remove_file(&partial);
    })?;
    Ok(path)
}

fn partial(path: &Path) -> PathBuf {
    let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    path.with_file_name(format!(".{name}.partial"))
}
