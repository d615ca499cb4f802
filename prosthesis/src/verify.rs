//! A second opinion on the folder of a prosthesis: by the program that stands in it, not by the moves that were planned.
//!
//! The program is read back and cut out of the block by [`crate::proof`], which shares nothing with what planned and wrote it; the part is
//! read again from its own file and laid as `job.toml` says. Everything that `job.toml` tells is told again of these files and compared; `program.nc` is written
//! again from `toolpath.csv` and compared line by line, so that no word of either can be another.

use std::fmt::Write;
use std::path::Path;

use crate::machining::{Block as Stock, Facing, MachiningError, TipMove};
use crate::orient::{Laid, SeenSurface, published};
use crate::proof::gcode::{self, Program};
use crate::proof::{Proof, ProofJob};
use bonemill_case::prosthesis::{MachineKind, OrientMode};
use bonemill_case::write::text;
use bonemill_geometry::{Block, Mesh, Progress};
use bonemill_imaging::part::{RepairLimits, Solid, read_facets};
use bonemill_planfile::{PlanFileError, Sha256, Value};
use nalgebra::Vector3;

use crate::figures::{self, Milled, Told};
use crate::plan::laid_part;
use crate::record::FILE_NAME;
use crate::save::{PART, PROGRAM, TOOLPATH, TRAJECTORY};
use crate::{JobRecord, ProsthesisError, RobotMotion, block, robot, settings, toolpath_csv};

/// How far part.stl may be from the part in its own file, mm: rounding to single precision at 100 mm.
const SAME_MM: f64 = 1e-4;
/// How far a figure may be from what follows from the files, as a share of it: another processor's last digits.
const SAME_FIGURE: f64 = 1e-6;
/// A figure below this is compared as if it were so large: rounding of lengths of 100 mm.
const SAME_NOUGHT: f64 = 1e-3;
/// How far a feed, mm/min, or a spindle speed, 1/min, may be from the job's: decimals of the program.
const SAME_SPEED: f64 = 0.51;
/// How far a number of trajectory.csv may be from the motion's: another processor's last digits, s and rad.
const SAME_MOTION: f64 = 1e-6;
const TRAJECTORY_FOLLOWS: &str = "trajectory.csv is the arm's motion along toolpath.csv";
/// How far a time of toolpath.csv may be from the moves', s: its decimals.
const SAME_TIME_S: f64 = 6e-4;

/// One thing that was checked.
#[derive(Debug, Clone, PartialEq)]
pub struct FolderCheck {
    /// What.
    pub name: &'static str,
    /// What was found wrong; empty when nothing was.
    pub faults: Vec<String>,
}

/// What was found.
#[derive(Debug, Clone, PartialEq)]
pub struct Verdict {
    /// Every check, in order.
    pub checks: Vec<FolderCheck>,
    /// Deepest cut into the part, mm.
    pub deepest_gouge_mm: f64,
    /// Thickest stock left on the part, mm.
    pub thickest_uncut_mm: f64,
    /// Widest cut, mm.
    pub widest_mm: f64,
    /// Name and digest of the files that the verdict holds for.
    pub files: Vec<(String, Sha256)>,
}

impl Verdict {
    /// Whether nothing was found wrong.
    pub fn passed(&self) -> bool {
        self.checks.iter().all(|check| check.faults.is_empty())
    }

    /// `verification.toml`.
    pub fn to_toml(&self) -> String {
        let mut out = format!(
            "passed = {}\ndeepest_gouge_mm = {:?}\nthickest_uncut_mm = {:?}\nwidest_mm = {:?}\n",
            self.passed(),
            self.deepest_gouge_mm,
            self.thickest_uncut_mm,
            self.widest_mm
        );
        for check in &self.checks {
            let faults: Vec<String> = check.faults.iter().map(|fault| text(fault)).collect();
            let _ =
                write!(out, "\n[[check]]\nname = {}\nfaults = [{}]\n", text(check.name), faults.join(", "));
        }
        out += "\n[files]\n";
        out.extend(self.files.iter().map(|(name, digest)| format!("{} = \"{digest}\"\n", text(name))));
        out
    }
}

/// Judges the folder `dir`.
///
/// # Errors
/// [`ProsthesisError`] where a file is missing or not what it should be, so that no other check would mean anything.
pub fn verify(dir: &Path, progress: &dyn Progress) -> Result<Verdict, ProsthesisError> {
    progress.stage("read files");
    let record = JobRecord::read(dir)?;
    let (part, program) = (read_part(&dir.join(PART))?, read_text(&dir.join(PROGRAM))?);
    let (toolpath, trajectory_path) = (read_text(&dir.join(TOOLPATH))?, dir.join(TRAJECTORY));
    let job = settings::proof(&record.job, &record.block, &record.tab_boxes_mm);
    let mut checks = vec![input_unchanged(&record, dir)?];
    let own = if checks[0].faults.is_empty() {
        let unit = record.job.part.unit.and_then(|word| word.parse().ok());
        let own = read_solid(&record.part_path(dir), unit)?;
        checks.push(same_part(&record, &own, &part));
        Some(own)
    } else {
        None
    };
    checks.push(inside_block(&record.block, &part));
    progress.stage("prove program");
    let proof = crate::proof::prove(&program, &part, &job)?;
    let read = gcode::read(&program)?;
    progress.stage("compare toolpath");
    let rows = toolpath_csv::read(&toolpath);
    let moves = rows.as_ref().map(Vec::as_slice).unwrap_or_default();
    let robot = match record.job.machine.kind {
        MachineKind::Ur(model) => {
            let motion = robot::motion(model, record.job.machine.on_flange, &record.block, moves);
            Some(motion.map_err(|source| failed(&record, source))?)
        }
        MachineKind::FiveAxis => None,
    };
    let told = match &own {
        Some(solid) if rows.is_ok() => Some(told(
            &record,
            solid,
            &Cut { moves, program: &program, proof: &proof, job: &job },
            robot.as_ref(),
        )?),
        _ => None,
    };
    // without the part's own file, by the program alone
    let faults = told.as_ref().map_or_else(
        || figures::by_proof(&proof, &job, record.job.process.finishing_step_mm, |_| None),
        |told| told.told.shortfalls.clone(),
    );
    checks.push(FolderCheck { name: "the program makes the part as the job asks for", faults });
    if let Some(told) = &told {
        checks.push(same_record(&record, told));
    }
    let shortfalls = told.as_ref().map_or(&record.shortfalls, |told| &told.told.shortfalls);
    let made_for = record.made_for(&toolpath);
    checks.push(same_program(rows.as_deref(), &program, &record, &made_for, shortfalls));
    checks.push(speeds_of_the_job(&read, &record));
    let mut files = vec![FILE_NAME, PART, TOOLPATH, PROGRAM];
    if let Some(robot) = &robot {
        if trajectory_path.exists() {
            files.push(TRAJECTORY);
            checks.push(same_trajectory(robot, &read_text(&trajectory_path)?));
        } else {
            let faults = vec!["there is none: the arm cannot follow the tool path".into()];
            checks.push(FolderCheck { name: TRAJECTORY_FOLLOWS, faults });
        }
    }
    let digest = |name: &str| Ok::<_, PlanFileError>((name.to_owned(), Sha256::of_file(&dir.join(name))?));
    let files = files.into_iter().map(digest);
    Ok(Verdict {
        checks,
        deepest_gouge_mm: proof.deepest_gouge_mm,
        thickest_uncut_mm: proof.thickest_uncut_mm,
        widest_mm: proof.widest_mm,
        files: files.collect::<Result<_, _>>()?,
    })
}

fn failed(record: &JobRecord, source: MachiningError) -> ProsthesisError {
    ProsthesisError::Machining { block: record.block_id.clone(), source: Box::new(source) }
}

/// What cuts: the moves, the program and what the proof says of it.
struct Cut<'a> {
    moves: &'a [TipMove],
    program: &'a str,
    proof: &'a Proof,
    job: &'a ProofJob,
}

/// What follows from the folder's files.
struct Follows {
    told: Told,
    /// The box around the tab, mm.
    tab_boxes_mm: Vec<[Vector3<f64>; 2]>,
    /// Where the block would lie around the part.
    block: Stock,
}

/// What `job.toml` should tell of the files.
fn told(
    record: &JobRecord,
    solid: &Solid,
    cut: &Cut<'_>,
    robot: Option<&Result<RobotMotion, String>>,
) -> Result<Follows, ProsthesisError> {
    let machining_job = settings::machining(&record.job, record.block);
    let part = laid_part(solid, &record.block_from_part);
    let machining = crate::machining::assess(&part, cut.moves.to_vec(), &machining_job)
        .map_err(|source| failed(record, source))?;
    let silhouette = SeenSurface::of(&solid.mesh);
    let runs = match record.job.orient {
        OrientMode::AsGiven => Vec::new(),
        OrientMode::LeastResidual | OrientMode::LeastTime => published(&solid.mesh, &silhouette),
    };
    let chosen = Laid::turned(&solid.mesh, &silhouette, &record.block_from_part.rotation);
    let size_mm = record.block.high_mm - record.block.low_mm;
    let mounted = crate::catalogue::Mounted { id: record.block_id.clone(), size_mm: size_mm.into() };
    let told = Milled {
        job: &record.job,
        solid,
        given: &Laid::as_given(&solid.mesh, &silhouette),
        runs: &runs,
        chosen: &chosen,
        block: &record.block,
        machining_job: &machining_job,
        machining: &machining,
        outline_line: figures::outline_line(cut.program),
        proof_job: cut.job,
        proof: cut.proof,
        robot,
    }
    .told();
    Ok(Follows {
        told,
        tab_boxes_mm: machining.tab_boxes,
        block: block::around(&record.job, &mounted, &chosen.size_mm),
    })
}

pub(crate) fn read_text(path: &Path) -> Result<String, PlanFileError> {
    std::fs::read_to_string(path).map_err(PlanFileError::io("read", path))
}

pub(crate) fn read_part(path: &Path) -> Result<Mesh<Block>, ProsthesisError> {
    let solid = read_solid(path, Some(bonemill_imaging::part::LengthUnit::Mm))?;
    Ok(solid.mesh.transformed(&bonemill_geometry::Rigid::identity()))
}

fn read_solid(
    path: &Path,
    unit: Option<bonemill_imaging::part::LengthUnit>,
) -> Result<Solid, ProsthesisError> {
    let solid =
        read_facets(path).and_then(|facets| Solid::from_facets(facets, unit, &RepairLimits::default()));
    solid.map_err(|source| ProsthesisError::Part { path: path.into(), source })
}

fn input_unchanged(record: &JobRecord, dir: &Path) -> Result<FolderCheck, ProsthesisError> {
    let path = record.part_path(dir);
    let now = Sha256::of_file(&path)?;
    let fault = format!("{} has changed since the plan was made", path.display());
    let faults = if now == record.part_sha256 { Vec::new() } else { vec![fault] };
    Ok(FolderCheck { name: "input unchanged", faults })
}

/// part.stl is the part of its own file, laid as stated.
fn same_part(record: &JobRecord, own: &Solid, part: &Mesh<Block>) -> FolderCheck {
    let own = own.mesh.transformed(&record.block_from_part);
    let mut faults = Vec::new();
    if own.triangles.len() != part.triangles.len() {
        faults.push(format!("{} facets instead of {}", part.triangles.len(), own.triangles.len()));
    }
    // rounding may change the order of vertices, not their set
    let sorted = |mesh: &Mesh<Block>| {
        let mut rows: Vec<[i64; 3]> =
            mesh.vertices.iter().map(|v| v.coords.map(|c| (c / SAME_MM).round() as i64).into()).collect();
        rows.sort_unstable();
        rows
    };
    let (a, b) = (sorted(&own), sorted(part));
    let near = |p: &[i64; 3], q: &[i64; 3]| p.iter().zip(q).all(|(a, b)| (a - b).abs() <= 1);
    let has = |q: &[i64; 3]| {
        let from = a.partition_point(|p| p[0] < q[0] - 1);
        a[from..].iter().take_while(|p| p[0] <= q[0] + 1).any(|p| near(p, q))
    };
    if let Some(off) = b.iter().find(|q| !has(q)) {
        let at = off.map(|c| c as f64 * SAME_MM);
        faults.push(format!("part.stl has a vertex at {at:?} mm that the part as laid has not"));
    }
    FolderCheck { name: "part.stl is the part as laid", faults }
}

fn inside_block(block: &Stock, part: &Mesh<Block>) -> FolderCheck {
    let grip_top = block.low_mm + Vector3::z() * block.grip_mm;
    let outside = part.vertices.iter().find(|v| {
        let p = v.coords;
        (0..3).any(|n| p[n] < grip_top[n] || p[n] > block.high_mm[n])
    });
    let faults =
        outside.map(|v| format!("the part leaves the block above the grip at {:?} mm", v.coords.as_slice()));
    FolderCheck { name: "the part lies in the block above the grip", faults: faults.into_iter().collect() }
}

/// `job.toml` tells what follows from the files, and is as it was written.
fn same_record(record: &JobRecord, found: &Follows) -> FolderCheck {
    let mut faults = Vec::new();
    let of =
        |list: &[(String, Value)], name: &str| list.iter().find(|(n, _)| n == name).map(|(_, v)| v.clone());
    for (name, is) in &found.told.metrics {
        match of(&record.metrics, name) {
            Some(stated) if is_same(&stated, is) => {}
            Some(stated) => {
                faults.push(format!("`{name}` is {}, but {} is found", shown(&stated), shown(is)))
            }
            None => faults.push(format!("`{name}` is missing, {} is found", shown(is))),
        }
    }
    let more = record.metrics.iter().filter(|(name, _)| of(&found.told.metrics, name).is_none());
    faults.extend(more.map(|(name, _)| format!("`{name}` is no figure of such a job")));
    for (what, stated, is) in [
        ("warnings", &record.warnings, &found.told.warnings),
        ("shortfalls", &record.shortfalls, &found.told.shortfalls),
    ] {
        if let Some(n) = first_other(stated, is) {
            let [stated, is] = [stated, is].map(|list| list.get(n).map_or("nothing", String::as_str));
            faults.push(format!("`{what}[{n}]` is {stated:?}, but {is:?} is found"));
        }
    }
    let block = &record.block;
    let off_mm = |a: &Vector3<f64>, b: &Vector3<f64>| (a - b).amax() > SAME_MM;
    let boxes = || record.tab_boxes_mm.iter().zip(&found.tab_boxes_mm);
    let is_same = |(a, b): (&[Vector3<f64>; 2], &[Vector3<f64>; 2])| !(0..2).any(|n| off_mm(&a[n], &b[n]));
    let same = boxes().take_while(|pair| is_same(*pair)).count();
    if same < record.tab_boxes_mm.len().max(found.tab_boxes_mm.len()) {
        let of = |list: &[[Vector3<f64>; 2]]| list.get(same).map_or("nothing".into(), |at| format!("{at:?}"));
        let [stated, is] = [of(&record.tab_boxes_mm), of(&found.tab_boxes_mm)];
        faults.push(format!("`block.tab_boxes_mm[{same}]` is {stated}, but {is} is found"));
    }
    for (key, stated, is) in
        [("low_mm", block.low_mm, found.block.low_mm), ("high_mm", block.high_mm, found.block.high_mm)]
    {
        if off_mm(&stated, &is) {
            faults.push(format!(
                "`block.{key}` is {:?}, but {:?} is found",
                stated.as_slice(),
                is.as_slice()
            ));
        }
    }
    if block.grip_mm != record.job.stock.grip_mm {
        let grip_mm = record.job.stock.grip_mm;
        faults.push(format!("`block.grip_mm` is {}, but `stock.grip_mm` is {grip_mm}", block.grip_mm));
    }
    if !record.is_as_written {
        faults.push("a line is not as it was written: the digest in the last line is another".into());
    }
    FolderCheck { name: "job.toml tells what follows from the files", faults }
}

/// The first place at which two lists differ.
fn first_other<T: PartialEq>(a: &[T], b: &[T]) -> Option<usize> {
    (0..a.len().max(b.len())).find(|n| a.get(*n) != b.get(*n))
}

fn is_same(a: &Value, b: &Value) -> bool {
    let number = |value: &Value| match value {
        Value::Number(number) => Some(*number),
        Value::Integer(count) => Some(*count as f64),
        _ => None,
    };
    match (a, b) {
        (Value::List(a), Value::List(b)) => a.len() == b.len() && a.iter().zip(b).all(|(a, b)| is_same(a, b)),
        _ => number(a)
            .zip(number(b))
            .is_some_and(|(a, b)| (a - b).abs() <= SAME_FIGURE * b.abs().max(SAME_NOUGHT)),
    }
}

fn shown(value: &Value) -> String {
    value.to_toml("").unwrap_or_default()
}

/// program.nc is what toolpath.csv's moves are written as, line by line, and the table's own speeds and times are those of its moves.
fn same_program(
    rows: Result<&[TipMove], &String>,
    program: &str,
    record: &JobRecord,
    made_for: &str,
    shortfalls: &[String],
) -> FolderCheck {
    let name = "program.nc drives the moves of toolpath.csv, and nothing else";
    let moves = match rows {
        Ok(moves) => moves,
        Err(wrong) => return FolderCheck { name, faults: vec![format!("toolpath.csv {wrong}")] },
    };
    let job = settings::machining(&record.job, record.block);
    let mut faults = Vec::new();
    let own = crate::program::write(moves, &job, made_for, shortfalls);
    let [lines, own] = [program, &own].map(|text| text.lines().collect::<Vec<_>>());
    if let Some(n) = first_other(&lines, &own) {
        let [is, wanted] =
            [lines, own].map(|lines| lines.get(n).map_or("nothing".into(), |line| format!("{line:?}")));
        let other =
            if wanted.contains(made_for) { ": it was made for another job, block or tool path" } else { "" };
        faults.push(format!("program.nc line {}: {is} instead of {wanted}{other}", n + 1));
    }
    let mut timed = moves.to_vec();
    if crate::machining::time::times(&mut timed, &job).is_err() {
        faults.push("toolpath.csv: the machine's axes cannot be driven along the moves".into());
    }
    for (index, (row, timed)) in moves.iter().zip(&timed).enumerate() {
        let line = index + 2;
        let wanted = if row.kind.cuts() { job.feed_mm_min() } else { job.machine.rapid_mm_min };
        let a_rad = job.a_rad(Facing::of(row.a_rad));
        if row.feed_mm_min != wanted {
            faults.push(format!(
                "toolpath.csv line {line}: {} mm/min instead of {wanted} mm/min",
                row.feed_mm_min
            ));
        } else if row.a_rad != a_rad {
            faults.push(format!("toolpath.csv line {line}: {} rad instead of {a_rad} rad", row.a_rad));
        } else if (row.time_s - timed.time_s).abs() > SAME_TIME_S {
            faults
                .push(format!("toolpath.csv line {line}: {} s instead of {:.3} s", row.time_s, timed.time_s));
        } else {
            continue;
        }
        break;
    }
    FolderCheck { name, faults }
}

/// Whether a speed is not the one that is wanted.
fn is_other(speed: f64, wanted: f64) -> bool {
    let off = (speed - wanted).abs();
    off.is_nan() || off > SAME_SPEED
}

/// The program's feeds, spindle speed and span are the job's and the machine's.
fn speeds_of_the_job(program: &Program, record: &JobRecord) -> FolderCheck {
    let (job, machine) = (settings::machining(&record.job, record.block), &record.job.machine);
    let mut faults = Vec::new();
    let wanted = job.feed_mm_min();
    let cuts = || program.motions.iter().filter(|m| !m.rapid);
    if let Some(other) = cuts().find(|m| is_other(m.feed_mm_min, wanted)) {
        faults.push(format!("line {}: F{} instead of {wanted:.1} mm/min", other.line, other.feed_mm_min));
    }
    let rpm = job.process.spindle_rpm;
    if let Some(other) = cuts().find(|m| is_other(m.spindle_rpm, rpm)) {
        faults.push(format!("line {}: S{} instead of {rpm} 1/min", other.line, other.spindle_rpm));
    }
    // an arm has its own reach and its own time
    if machine.kind == MachineKind::FiveAxis {
        for (n, axis) in ["X", "Y", "Z"].into_iter().enumerate() {
            // where the machine's top is, the program does not say
            let at = || program.motions.iter().map(|m| m.to_mm[n]).filter(|mm| *mm < gcode::TOP_MM);
            let span_mm = at().fold(f64::NEG_INFINITY, f64::max) - at().fold(f64::INFINITY, f64::min);
            if span_mm > machine.travel_mm[n] {
                faults.push(format!(
                    "{axis} needs {span_mm:.1} mm of {:.1} mm of travel",
                    machine.travel_mm[n]
                ));
            }
        }
        let [low_deg, high_deg] = machine.rotary_range_rad.map(f64::to_degrees);
        let reached = |a_deg: f64| (low_deg - 1e-9..=high_deg + 1e-9).contains(&a_deg);
        if let Some(beyond) = program.motions.iter().find(|m| !reached(m.a_deg)) {
            let (line, a_deg) = (beyond.line, beyond.a_deg);
            faults.push(format!("line {line}: A{a_deg} where the machine reaches {low_deg}° to {high_deg}°"));
        }
    }
    FolderCheck { name: "the program keeps the job's speeds and the machine's limits", faults }
}

/// trajectory.csv is the arm's motion along toolpath.csv.
fn same_trajectory(robot: &Result<RobotMotion, String>, trajectory: &str) -> FolderCheck {
    let name = TRAJECTORY_FOLLOWS;
    let motion = match robot {
        Ok(motion) => motion,
        Err(reason) => return FolderCheck { name, faults: vec![reason.clone()] },
    };
    let own = String::from_utf8_lossy(&motion.csv);
    let mut faults = Vec::new();
    let other = own.lines().zip(trajectory.lines()).position(|(a, b)| !is_same_row(a, b));
    if let Some(line) = other {
        faults.push(format!("line {} is another than the motion's", line + 1));
    } else if own.lines().count() != trajectory.lines().count() {
        faults.push(format!("{} lines instead of {}", trajectory.lines().count(), own.lines().count()));
    }
    FolderCheck { name, faults }
}

/// Whether two rows have the same words, numbers to [`SAME_MOTION`].
fn is_same_row(a: &str, b: &str) -> bool {
    let same = |(a, b): (&str, &str)| match (a.parse::<f64>(), b.parse::<f64>()) {
        (Ok(a), Ok(b)) => (a - b).abs() <= SAME_MOTION,
        _ => a == b,
    };
    a.split(',').count() == b.split(',').count() && a.split(',').zip(b.split(',')).all(same)
}
