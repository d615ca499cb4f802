//! `bonemill export`: writes a finished plan in a controller's format.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use bonemill_planner::case::Spindle;
use bonemill_planner::path::MoveKind;
use bonemill_planner::pipeline::Refused;
use bonemill_planner::plan::{HoldPoint, Need, StoredPlan, hold_points, is_prosthesis, least_gaps, verified};
use bonemill_planner::room::obstacles;
use bonemill_planner::slicer::export;
use bonemill_planner::space::TRAJECTORY_TOLERANCE_MM;
use bonemill_planner::{Progress, stages};
use bonemill_prosthesis::JobRecord;
use bonemill_robot::export::{
    Between, ExportRows, Gcode, GcodeMove, JointMove, ScriptHold, ScriptNotes, Tolerance, UrScript,
    is_cartesian, planning_scene, straight_blocks, write_gcode, write_ros_json, write_ros_yaml,
    write_urscript,
};
use bonemill_robot::stream::Settings;
use bonemill_robot::ur::UrModel;
use bonemill_robot::{ArmKind, JointKind};

use crate::args::{ExportArgs, ExportFormat};
use crate::outcome::Outcome;

/// Least number of rows per second of a ROS trajectory; the controller interpolates with cubics.
const ROS_RATE_HZ: f64 = 10.0;
/// Least number of steps per second of a URScript program, straight in joint space. Short programs load faster.
const SCRIPT_RATE_HZ: f64 = 25.0;
/// Largest distance of the burr from the plan's trajectory because of rows that are left out, mm: a fifth of the trajectory's
/// own tolerance.
const LEFT_OUT_MM: f64 = 0.2 * TRAJECTORY_TOLERANCE_MM;
/// Largest deviation of the shaft's axis because of G-code's straight blocks, rad: 0.03 mm at the end of a shank of 60 mm.
const LEFT_OUT_RAD: f64 = 5e-4;

pub fn run(args: &ExportArgs, progress: &dyn Progress) -> anyhow::Result<Outcome> {
    if is_prosthesis(&args.folder.plan).is_ok() {
        return prosthesis(args);
    }
    if args.format == ExportFormat::Slicer {
        return slicer(args, progress);
    }
    let plan = args.folder.load(Need::Unchanged)?;
    let name =
        plan.dir.canonicalize().ok().and_then(|path| Some(path.file_name()?.to_string_lossy().into_owned()));
    let mut name = name.unwrap_or_else(|| "plan".into());
    let why_not = not_to_be_moved(&plan);
    if let Some(why) = &why_not {
        ensure!(args.unverified, "{why}; or say --unverified: the files then say so");
        name.push_str(".unverified");
    }
    // all files are made in memory first, so that nothing is created if one fails
    let files = files(&plan, args, why_not.as_deref())?;
    fs::create_dir_all(&args.out).with_context(|| format!("cannot create {}", args.out.display()))?;
    let mut written = Vec::new();
    for (extension, bytes) in files {
        let path = args.out.join(format!("{name}.{extension}"));
        write_to(&path, &bytes)?;
        written.push(format!("{} ({:.1} MB)", path.display(), 1e-6 * bytes.len() as f64));
    }
    Ok(Outcome::written("export", &args.out, &written.join(", ")).warning(&plan.record.warnings))
}

/// Writes a scene to look at, which moves nothing: a plan that is not verified is exported too, and the scene says so.
fn slicer(args: &ExportArgs, progress: &dyn Progress) -> anyhow::Result<Outcome> {
    ensure!(
        !args.rapid && args.rate_hz.is_none(),
        "--rapid and --rate have no meaning for a scene of 3D Slicer"
    );
    progress.expect(&[&[stages::READ_PLAN], stages::SLICER, &[stages::WRITE_FILES]].concat());
    progress.stage("read plan");
    let plan = args.folder.load(Need::All)?;
    let refused = |error| Refused::new(error, &plan.record.case, &plan.case_path());
    let dir = export(&plan, &args.out, progress).map_err(refused)?;
    let what = "open plan.mrml in 3D Slicer";
    Ok(Outcome::written("export", &dir, what).warning(&plan.record.warnings))
}

/// Copies the program of a prosthesis, which is written as G-code when it is planned.
fn prosthesis(args: &ExportArgs) -> anyhow::Result<Outcome> {
    let dir = &args.folder.plan;
    ensure!(
        args.format == ExportFormat::Gcode && !args.rapid && args.rate_hz.is_none(),
        "{} holds a prosthesis: its program is G-code (--format gcode, without --rapid and --rate); joints for an arm stand in its \
         trajectory.csv",
        dir.display()
    );
    let record = JobRecord::read(dir)?;
    let from = dir.join("program.nc");
    let program = fs::read(&from).with_context(|| format!("cannot read {}", from.display()))?;
    fs::create_dir_all(&args.out).with_context(|| format!("cannot create {}", args.out.display()))?;
    let path = args.out.join("program.nc");
    write_to(&path, &program)?;
    Ok(Outcome::written("export", &args.out, &path.display().to_string()).warning(&record.warnings))
}

/// Why streaming would not move an arm along the plan's files as they are.
fn not_to_be_moved(plan: &StoredPlan) -> Option<String> {
    if let Err(why) = verified(&plan.dir) {
        return Some(format!("the plan is not verified: {why}; verify it"));
    }
    let assumed = plan.record.frames.registration_assumed;
    assumed.then(|| {
        "the case has no registration, so where the arm stands was assumed: give robot.base_from_ct and plan again"
            .to_owned()
    })
}

/// Lines that say what must hold for the exported motion.
fn notes(plan: &StoredPlan, why_not: Option<&str>) -> Vec<String> {
    let robot = &plan.record.case.robot;
    let kinematics = if robot.calibration.is_some() { "its own calibration" } else { "nominal kinematics" };
    let joints: Vec<String> = plan
        .arm
        .joints()
        .iter()
        .zip(plan.trajectory.q_at(0))
        .map(|(joint, q)| {
            let slides = joint.kind == JointKind::Prismatic;
            format!("{} {q:.4} {}", joint.name, if slides { "mm" } else { "rad" })
        })
        .collect();
    let mut lines: Vec<String> = why_not
        .into_iter()
        .map(|why| format!("NOT TO BE MOVED NEAR A PATIENT: {}", why.replace('\n', " ")))
        .collect();
    lines.push(format!(
        "For the arm {} with {kinematics}, its tool mounted as the plan has it, and the payload set.",
        robot.model
    ));
    lines.push(format!("It begins at rest at {}: the arm must stand there.", joints.join(", ")));
    lines
}

/// A format that cannot wait for the user does not drop a hold.
fn without_holds(plan: &StoredPlan, format: &str) -> anyhow::Result<()> {
    let case = &plan.record.case;
    let Some(hold) = hold_points(plan).into_iter().next() else { return Ok(()) };
    bail!(
        "the case holds {} mm from {} ([[hold]]), and {format} cannot go back and wait for the user there: stream the plan, export URScript for \
         a UR, or plan without the hold",
        hold.distance_mm,
        case.structures[hold.structure].name
    )
}

/// The files to write, by extension.
fn files(
    plan: &StoredPlan,
    args: &ExportArgs,
    why_not: Option<&str>,
) -> anyhow::Result<Vec<(&'static str, Vec<u8>)>> {
    let mut notes = notes(plan, why_not);
    let model = &plan.record.case.robot.model;
    ensure!(!args.rapid || args.format == ExportFormat::Gcode, "--rapid is for G-code only");
    Ok(match args.format {
        ExportFormat::Ros => {
            without_holds(plan, "a ROS trajectory")?;
            notes.push("It does not switch the spindle.".into());
            if args.rate_hz.is_none() {
                notes.push(format!(
                    "The burr stays within {LEFT_OUT_MM:.3} mm of the plan's motion, whether positions are interpolated linearly or by cubics \
                     with the velocities."
                ));
            } else {
                notes.push("How far the burr leaves the plan's motion between points at a given rate is not bounded; without --rate it is.".into());
            }
            let rows = rows(plan, args.rate_hz, ROS_RATE_HZ, &[Between::Straight, Between::Cubic])?;
            let (mut json, mut yaml) = (Vec::new(), Vec::new());
            write_ros_json(&mut json, &rows)?;
            write_ros_yaml(&mut yaml, &rows, &notes)?;
            let mut files = vec![("trajectory.json", json), ("trajectory.yaml", yaml)];
            files.extend(scene(plan).map(|text| ("scene.json", text.into_bytes())));
            files
        }
        ExportFormat::Urscript => {
            ensure!(
                plan.arm.kind() == ArmKind::Ur,
                "the plan is for robot.model = \"{model}\"; URScript runs on {} only",
                UrModel::names()
            );
            let rows = rows(plan, args.rate_hz, SCRIPT_RATE_HZ, &[Between::Straight])?;
            let mount =
                plan.arm.mount().tool().context("URScript is written for a tool on the flange only")?;
            let mut options = UrScript::with_mount(mount);
            options.calibrated = plan.record.case.robot.calibration.is_some();
            let aside_mm = aside_mm(plan, &rows)?;
            notes.push(late(plan, &rows)?);
            let (holds, start_pose) = (holds(plan, &rows)?, start_pose(plan)?);
            let notes = ScriptNotes { lines: &notes, start_pose, holds: &holds };
            let mut script = Vec::new();
            write_urscript(&mut script, &rows, &options, &aside_mm, notes)?;
            vec![("script", script)]
        }
        ExportFormat::Slicer => Vec::new(),
        ExportFormat::Gcode => {
            ensure!(
                is_cartesian(plan.arm.joints()),
                "the plan is for robot.model = \"{model}\"; G-code is for Cartesian machines: three linear axes and at most \
                 one rotary one behind them. Other formats: ros, and urscript for a UR"
            );
            ensure!(args.rate_hz.is_none(), "--rate has no meaning for G-code, which has one block per move");
            without_holds(plan, "G-code")?;
            vec![("ngc", gcode(plan, args.rapid, &notes)?)]
        }
    })
}

/// The obstacles of a case for a planner of ROS; none without obstacles.
fn scene(plan: &StoredPlan) -> Option<String> {
    let obstacles = obstacles(&plan.record.case, &plan.record.frames.base_from_ct);
    // ROS' descriptions of URs call the controller's base so; their base_link is turned
    let frame = if plan.arm.kind() == ArmKind::Ur { "base" } else { plan.arm.base_link() };
    let name = "bonemill: the obstacles of the case, without the patient";
    (!obstacles.is_empty()).then(|| planning_scene(&obstacles, frame, name))
}

/// How far beside its path the burr is by servoj's lag alone, in words.
fn late(plan: &StoredPlan, rows: &ExportRows<'_>) -> anyhow::Result<String> {
    let lags_s = [0.034, 0.1, 0.2];
    let late_mm = rows.late_mm(&plan.arm, lags_s)?;
    let found: Vec<_> =
        late_mm.iter().zip(lags_s).map(|(mm, lag_s)| format!("{mm:.2} mm with {lag_s} s")).collect();
    Ok(format!(
        "servoj follows late (lookahead 0.1 s, gain 300; streaming uses 0.03 s and 2000, of which 0.034 s were measured): the burr leaves its path \
         by {}.",
        found.join(", ")
    ))
}

/// Where a script goes back and waits.
fn holds(plan: &StoredPlan, rows: &ExportRows<'_>) -> anyhow::Result<Vec<ScriptHold>> {
    let name = |structure: usize| &plan.record.case.structures[structure].name;
    // as in streaming
    let retreat_mm = Settings::default().retreat_mm;
    let hold = |hold: HoldPoint| {
        let row = rows.at_or_before(hold.row).min(rows.count().saturating_sub(2));
        let back_row = rows.back_from(row, retreat_mm, &plan.arm)?;
        Ok(ScriptHold {
            row,
            back_row,
            why: format!("{} mm from {}", hold.distance_mm, name(hold.structure)),
        })
    };
    hold_points(plan).into_iter().map(hold).collect()
}

/// Where the plan has the tool at the first row, in base: m, and the rotation vector, rad.
fn start_pose(plan: &StoredPlan) -> anyhow::Result<[f64; 6]> {
    let tool = plan.arm.burr(plan.trajectory.q_at(0))?;
    let (p, turn) = (tool.translation_mm * 1e-3, tool.rotation.scaled_axis());
    Ok([p.x, p.y, p.z, turn.x, turn.y, turn.z])
}

/// The trajectory's rows at about the requested rate, or as few as keep the burr close enough to the trajectory, whichever way a
/// controller interpolates.
fn rows<'a>(
    plan: &'a StoredPlan,
    asked_hz: Option<f64>,
    least_hz: f64,
    between: &[Between],
) -> anyhow::Result<ExportRows<'a>> {
    let sampled_hz = plan.record.case.robot.rate_hz;
    let rate_hz = asked_hz.unwrap_or(least_hz.min(sampled_hz));
    ensure!(
        rate_hz.is_finite() && rate_hz > 0.0 && rate_hz <= sampled_hz,
        "--rate {rate_hz} Hz: expected above 0 and at most the trajectory's {sampled_hz} Hz"
    );
    let t = &plan.trajectory;
    let all = ExportRows::new(plan.arm.joints(), &t.time_s, &t.q, &t.qd, 1)?;
    // of every row: those that are left out are part of the motion that is exported
    all.check_speeds()?;
    if asked_hz.is_none() {
        return Ok(all.thinned(&plan.arm, between, LEFT_OUT_MM, 1.0 / rate_hz)?);
    }
    let stride = (sampled_hz / rate_hz).round().max(1.0) as usize;
    let rows = ExportRows::new(plan.arm.joints(), &t.time_s, &t.q, &t.qd, stride)?;
    let found = between.iter().map(|between| rows.deviation_mm(&plan.arm, *between));
    let found = found.collect::<Result<Vec<_>, _>>()?;
    let (off_mm, row) = found.into_iter().fold((0.0, 0), |a, b| if b.0 > a.0 { b } else { a });
    ensure!(
        off_mm <= LEFT_OUT_MM,
        "--rate {rate_hz} Hz: between rows {row} and {} the tool would be {off_mm:.4} mm aside of the planned \
         trajectory; expected at most {LEFT_OUT_MM:.3} mm: take a higher rate, or none to have as few rows as will do",
        row + 1
    );
    Ok(rows)
}

/// The trajectory as straight blocks; links are rapids if `rapid`.
fn gcode(plan: &StoredPlan, rapid: bool, notes: &[String]) -> anyhow::Result<Vec<u8>> {
    let t = &plan.trajectory;
    let rows = ExportRows::new(plan.arm.joints(), &t.time_s, &t.q, &t.qd, 1)?;
    let ends_s: Vec<f64> = plan.waypoints.iter().map(|waypoint| waypoint.time_s).collect();
    let tolerance = Tolerance { burr_mm: LEFT_OUT_MM, axis_rad: LEFT_OUT_RAD };
    let blocks = straight_blocks(&plan.arm, &rows, &ends_s, tolerance)?;
    let moves = blocks.iter().map(|JointMove { q, duration_s, of }| GcodeMove {
        q,
        duration_s: *duration_s,
        cuts: plan.waypoints[*of].kind == MoveKind::Cut,
    });
    let burr = plan.record.burr();
    let milling = Spindle { rpm: burr.spindle_rpm, spin: burr.spin };
    let Spindle { rpm: spindle_rpm, spin } = plan.record.case.tool.spindle().unwrap_or(milling);
    let options = Gcode { spindle_rpm, clockwise: spin < 0, rapid };
    // no bracket or line may end a comment early
    let plain = |note: &String| format!("({})\n", note.replace(['(', ')'], "").replace('\n', " "));
    let mut text: Vec<u8> = notes.iter().map(plain).collect::<String>().into_bytes();
    write_gcode(&mut text, plan.arm.joints(), &options, moves)?;
    Ok(text)
}

/// The farthest that a script lets the burr be beside its path where no structure is near, mm; assumed.
const MOST_ASIDE_MM: f64 = 0.5;
/// The nearest that it can be held to, mm.
const LEAST_ASIDE_MM: f64 = 0.1;
/// The share of the room between burr and structure that the arm may take before it is stopped, as in streaming; the rest is
/// for what it travels between two looks and while it stops. Assumed.
const ASIDE_SHARE: f64 = 0.25;

/// How far the burr may be beside its path on the way to each exported row, mm.
fn aside_mm(plan: &StoredPlan, rows: &ExportRows<'_>) -> anyhow::Result<Vec<f64>> {
    let gaps = least_gaps(plan);
    if let Some((n, gap)) = gaps.iter().enumerate().find(|(_, gap)| gap.gap_mm * ASIDE_SHARE < LEAST_ASIDE_MM)
    {
        bail!(
            "waypoint {n}: the tool's surface passes {} at {:.3} mm; a script can hold the arm within {LEAST_ASIDE_MM} mm of its \
             path, and needs {} mm of room: give the structure a larger clearance_mm",
            plan.record.case.structures[gap.structure].name,
            gap.gap_mm,
            LEAST_ASIDE_MM / ASIDE_SHARE
        );
    }
    let allowed_mm =
        |n: usize| gaps.get(n).map_or(MOST_ASIDE_MM, |gap| MOST_ASIDE_MM.min(ASIDE_SHARE * gap.gap_mm));
    let move_at = |time_s: f64| plan.waypoints.partition_point(|w| w.time_s < time_s);
    let mut before = 0;
    let mut limits_mm = Vec::with_capacity(rows.count());
    for time_s in rows.times_s() {
        let here = move_at(time_s).min(plan.waypoints.len().saturating_sub(1));
        limits_mm.push((before..=here).map(allowed_mm).fold(MOST_ASIDE_MM, f64::min));
        before = here;
    }
    Ok(limits_mm)
}

/// Writes a file whole or not at all.
fn write_to(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    let partial = partial(path);
    let written = || -> anyhow::Result<()> {
        fs::write(&partial, bytes).with_context(|| format!("cannot write {}", partial.display()))?;
        fs::rename(&partial, path).with_context(|| format!("cannot put {} into place", path.display()))
    };
    written().inspect_err(|_| {
        let _ = fs::remove_file(&partial);
    })
}

fn partial(path: &Path) -> PathBuf {
    let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    path.with_file_name(format!(".{name}.partial"))
}
