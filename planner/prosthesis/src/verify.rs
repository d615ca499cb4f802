//! A second opinion on the folder of a prosthesis: by the program that stands in it, not by the moves that were planned.
//!
//! The program is read back and cut out of the block by [`bonemill_proof`], which shares nothing with what planned and wrote it; the part is
//! read again from its own file and laid as `job.toml` says.

use std::fmt::Write;
use std::path::Path;

use bonemill_arm::ur::UrModel;
use bonemill_case::prosthesis::MachineKind;
use bonemill_case::write::text;
use bonemill_geometry::{Block, Mesh, Progress};
use bonemill_machining::{Block as Stock, Move};
use bonemill_part::{RepairLimits, Solid, read_facets};
use bonemill_planfile::{PlanFileError, Sha256};
use bonemill_proof::gcode::{self, Facing, Program};
use bonemill_proof::{Proof, ProofJob};
use nalgebra::Vector3;

use crate::plan::shortfalls;
use crate::record::FILE_NAME;
use crate::save::{PART, PROGRAM, TOOLPATH, TRAJECTORY};
use crate::{JobRecord, ProsthesisError, robot, settings, toolpath_csv};

/// How far part.stl may be from the part in its own file, mm: rounding to single precision at 100 mm.
const SAME_MM: f64 = 1e-4;
/// How far a figure may be from the proof's.
const SAME_FIGURE: f64 = 1e-6;
/// How far a feed, mm/min, or a spindle speed, 1/min, may be from the job's: decimals of the program.
const SAME_SPEED: f64 = 0.51;
/// How far a number of trajectory.csv may be from the motion's: another processor's last digits, s and rad.
const SAME_MOTION: f64 = 1e-6;
const TRAJECTORY_FOLLOWS: &str = "trajectory.csv is the arm's motion along toolpath.csv";
/// Decimals of the program and of toolpath.csv, mm.
const ROUNDING_MM: f64 = 1e-3;

/// One thing that was checked.
#[derive(Debug, Clone, PartialEq)]
pub struct Check {
    /// What.
    pub name: &'static str,
    /// What was found wrong; empty when nothing was.
    pub faults: Vec<String>,
}

/// What was found.
#[derive(Debug, Clone, PartialEq)]
pub struct Verdict {
    /// Every check, in order.
    pub checks: Vec<Check>,
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
    let job = settings::proof(&record.job, &record.block, record.tab_mm);
    let mut checks = vec![input_unchanged(&record, dir)?];
    if checks.iter().all(|check| check.faults.is_empty()) {
        checks.push(same_part(&record, dir, &part)?);
    }
    checks.push(inside_block(&record.block, &part));
    progress.stage("prove program");
    let proof = bonemill_proof::prove(&program, &part, &job)?;
    checks.extend(proved(&record, &proof, &job));
    progress.stage("compare toolpath");
    let toolpath = read_text(&dir.join(TOOLPATH))?;
    let read = gcode::read(&program)?;
    let moves = same_moves(&toolpath, &read, &record);
    let is_same = moves.faults.is_empty();
    checks.extend([moves, speeds_of_the_job(&read, &record)]);
    let mut files = vec![FILE_NAME, PART, TOOLPATH, PROGRAM];
    if let MachineKind::Ur(model) = record.job.machine.kind {
        let path = dir.join(TRAJECTORY);
        if !path.exists() {
            let faults = vec!["there is none: the arm cannot follow the tool path".into()];
            checks.push(Check { name: TRAJECTORY_FOLLOWS, faults });
        } else {
            files.push(TRAJECTORY);
            if is_same {
                checks.push(same_trajectory(model, &read_text(&path)?, &toolpath, &record)?);
            }
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

pub(crate) fn read_text(path: &Path) -> Result<String, PlanFileError> {
    std::fs::read_to_string(path).map_err(PlanFileError::io("read", path))
}

pub(crate) fn read_part(path: &Path) -> Result<Mesh<Block>, ProsthesisError> {
    let solid = read_solid(path, Some(bonemill_part::LengthUnit::Mm))?;
    Ok(solid.mesh.transformed(&bonemill_geometry::Rigid::identity()))
}

fn read_solid(path: &Path, unit: Option<bonemill_part::LengthUnit>) -> Result<Solid, ProsthesisError> {
    let solid =
        read_facets(path).and_then(|facets| Solid::from_facets(facets, unit, &RepairLimits::default()));
    solid.map_err(|source| ProsthesisError::Part { path: path.into(), source })
}

fn input_unchanged(record: &JobRecord, dir: &Path) -> Result<Check, ProsthesisError> {
    let path = record.part_path(dir);
    let now = Sha256::of_file(&path)?;
    let fault = format!("{} has changed since the plan was made", path.display());
    let faults = if now == record.part_sha256 { Vec::new() } else { vec![fault] };
    Ok(Check { name: "input unchanged", faults })
}

/// part.stl is the part of its own file, laid as stated.
fn same_part(record: &JobRecord, dir: &Path, part: &Mesh<Block>) -> Result<Check, ProsthesisError> {
    let unit = record.job.part.unit.and_then(|word| word.parse().ok());
    let own = read_solid(&record.part_path(dir), unit)?.mesh.transformed(&record.block_from_part);
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
    Ok(Check { name: "part.stl is the part as laid", faults })
}

fn inside_block(block: &Stock, part: &Mesh<Block>) -> Check {
    let grip_top = block.low_mm + Vector3::z() * block.grip_mm;
    let outside = part.vertices.iter().find(|v| {
        let p = v.coords;
        (0..3).any(|n| p[n] < grip_top[n] || p[n] > block.high_mm[n])
    });
    let faults =
        outside.map(|v| format!("the part leaves the block above the grip at {:?} mm", v.coords.as_slice()));
    Check { name: "the part lies in the block above the grip", faults: faults.into_iter().collect() }
}

fn proved(record: &JobRecord, proof: &Proof, job: &ProofJob) -> Vec<Check> {
    let faults = shortfalls(proof, job, record.job.process.finishing_step_mm);
    vec![
        Check { name: "the program makes the part without gouges, collisions and cuts too wide", faults },
        Check { name: "job.toml has the proof's figures", faults: other_figures(record, proof) },
    ]
}

/// Figures of the record that the proof does not find.
fn other_figures(record: &JobRecord, proof: &Proof) -> Vec<String> {
    let found = [
        ("deepest_gouge_mm", proof.deepest_gouge_mm),
        ("thickest_uncut_mm", proof.thickest_uncut_mm),
        ("loose_mm3", proof.loose_mm3()),
        ("widest_cut_mm", proof.widest_mm),
        ("collisions", proof.collisions.len() as f64),
        ("cuts_too_wide", proof.too_wide.len() as f64),
    ];
    let stated = |name: &str| record.number(name);
    let other =
        found.iter().filter(|(name, is)| !stated(name).is_some_and(|s| (s - is).abs() <= SAME_FIGURE));
    let told = other.map(|(name, is)| match stated(name) {
        Some(stated) => format!("`{name}` is {stated}, but the proof finds {is}"),
        None => format!("`{name}` is missing, the proof finds {is}"),
    });
    told.collect()
}

/// Where a motion ends in the machine's axes, and whether it is G0.
type End = (Facing, Vector3<f64>, bool);

/// toolpath.csv tells the program's moves.
fn same_moves(table: &str, program: &Program, record: &JobRecord) -> Check {
    let name = "toolpath.csv tells the program's moves";
    let mut rows = table.lines();
    let header = toolpath_csv::header();
    if rows.next() != Some(header.as_str()) {
        return Check { name, faults: vec![format!("expected the header {header:?}")] };
    }
    let mut faults = Vec::new();
    let feed_of_job = settings::machining(&record.job, record.block).feed_mm_min();
    let mut ends = program.motions.iter().map(|m| (m.facing, m.to_mm, m.rapid));
    let mut count = 0;
    let mut at = None;
    for (line, row) in rows.enumerate() {
        let line = line + 2;
        let index = line - 2;
        let Some(Move { kind, tip_mm, a_rad, feed_mm_min, .. }) = toolpath_csv::read_row(row, index) else {
            faults
                .push(format!("line {line}: expected index {index}, a side, a kind of move and six numbers"));
            break;
        };
        let wanted = if kind.cuts() { feed_of_job } else { record.job.machine.rapid_mm_min };
        if is_other(feed_mm_min, wanted) {
            faults.push(format!("line {line}: {feed_mm_min} mm/min instead of {wanted:.1} mm/min"));
        }
        let facing = if a_rad.abs() < 1.0 { Facing::Front } else { Facing::Back };
        let to = (facing, facing.machine(&tip_mm), !kind.cuts());
        let near = |a: &End| a.0 == to.0 && (a.1 - to.1).amax() <= ROUNDING_MM;
        // a program says nothing where the tip stays
        if !at.as_ref().is_some_and(near) && !ends.any(|end| near(&end) && end.2 == to.2) {
            faults.push(format!(
                "line {line}: ({}, {}, {}) mm is no end of a motion of the program, in order",
                tip_mm.x, tip_mm.y, tip_mm.z
            ));
            break;
        }
        at = Some(to);
        count = index + 1;
    }
    if faults.is_empty() && record.number("moves") != Some(count as f64) {
        faults.push(format!("{count} moves instead of {}", record.number("moves").unwrap_or(f64::NAN)));
    }
    Check { name, faults }
}

/// Whether a speed is not the one that is wanted.
fn is_other(speed: f64, wanted: f64) -> bool {
    let off = (speed - wanted).abs();
    off.is_nan() || off > SAME_SPEED
}

/// The program's feeds, spindle speed and span are the job's and the machine's, and its time is what there is.
fn speeds_of_the_job(program: &Program, record: &JobRecord) -> Check {
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
            let at = || program.motions.iter().map(|m| m.to_mm[n]);
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
    let time = if machine.kind == MachineKind::FiveAxis { "total_time_s" } else { "robot_time_s" };
    let takes_min = record.number(time).map(|time_s| time_s / 60.0);
    match (machine.max_time_min, takes_min) {
        (Some(_), None) => faults.push(format!("`{time}` is missing")),
        (Some(most), Some(takes)) if takes > most => {
            faults.push(format!("it takes {takes:.1} min, but there are {most:.1} min"));
        }
        _ => {}
    }
    Check { name: "the program keeps the job's speeds and the machine's limits", faults }
}

/// trajectory.csv is the arm's motion along toolpath.csv, in the stated time.
fn same_trajectory(
    model: UrModel,
    trajectory: &str,
    toolpath: &str,
    record: &JobRecord,
) -> Result<Check, ProsthesisError> {
    let name = TRAJECTORY_FOLLOWS;
    let rows = toolpath.lines().skip(1).enumerate();
    let moves: Vec<Move> = rows.filter_map(|(n, row)| toolpath_csv::read_row(row, n)).collect();
    let failed =
        |source| ProsthesisError::Machining { block: record.block_id.clone(), source: Box::new(source) };
    let found = robot::motion(model, record.job.machine.on_flange, &record.block, &moves).map_err(failed)?;
    let motion = match found {
        Ok(motion) => motion,
        Err(reason) => return Ok(Check { name, faults: vec![reason] }),
    };
    let own = String::from_utf8_lossy(&motion.csv);
    let mut faults = Vec::new();
    let other = own.lines().zip(trajectory.lines()).position(|(a, b)| !is_same_row(a, b));
    if let Some(line) = other {
        faults.push(format!("line {} is another than the motion's", line + 1));
    } else if own.lines().count() != trajectory.lines().count() {
        faults.push(format!("{} lines instead of {}", trajectory.lines().count(), own.lines().count()));
    }
    if !record.number("robot_time_s").is_some_and(|s| (s - motion.duration_s).abs() <= SAME_MOTION * s) {
        faults.push(format!("`robot_time_s` is not the motion's {:.1} s", motion.duration_s));
    }
    Ok(Check { name, faults })
}

/// Whether two rows have the same words, numbers to [`SAME_MOTION`].
fn is_same_row(a: &str, b: &str) -> bool {
    let same = |(a, b): (&str, &str)| match (a.parse::<f64>(), b.parse::<f64>()) {
        (Ok(a), Ok(b)) => (a - b).abs() <= SAME_MOTION,
        _ => a == b,
    };
    a.split(',').count() == b.split(',').count() && a.split(',').zip(b.split(',')).all(same)
}
