//! What is told of a milled part: its figures, warnings, and why it falls short.
//!
//! The plan tells it of what it made, the verification of what stands in the folder; both in the same words, so that nothing that is told there can differ from
//! what follows from the files.

use crate::machining::leftover::{Leftover, Reason};
use crate::machining::strip::{LEAST_FACTOR, cutting_force_n};
use crate::machining::{Block, EndMill, Machining, MachiningJob, Warning};
use crate::orient::{Laid, OrientationRun};
use crate::proof::deviation::FARTHEST_MM;
use crate::proof::{Proof, ProofJob};
use bonemill_case::prosthesis::{MachineKind, ProsthesisJob};
use bonemill_imaging::part::Solid;
use bonemill_planfile::Value;
use nalgebra::Vector3;

use crate::plan::most_uncut_mm;
use crate::{MOST_GOUGE_MM, RobotMotion};

/// Modulus of elasticity of the cutter, N/mm²; assumed: cemented carbide.
const CARBIDE_N_MM2: f64 = 6e5;

/// What is told.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Told {
    /// Figures by name, in the order of the file; names end in units.
    pub metrics: Vec<(String, Value)>,
    /// What the user should know.
    pub warnings: Vec<String>,
    /// Why the plan falls short.
    pub shortfalls: Vec<String>,
}

/// Of what it is told.
pub(crate) struct Milled<'a> {
    pub job: &'a ProsthesisJob,
    pub solid: &'a Solid,
    /// The part as given, after each run of the published procedure, and as it is milled.
    pub given: &'a Laid,
    pub runs: &'a [OrientationRun],
    pub chosen: &'a Laid,
    pub block: &'a Block,
    pub machining_job: &'a MachiningJob,
    pub machining: &'a Machining,
    /// Line of the program above the outline's cuts, from 1.
    pub outline_line: usize,
    pub proof_job: &'a ProofJob,
    pub proof: &'a Proof,
    /// The arm's motion, or why there is none; `None` for a milling machine.
    pub robot: Option<&'a Result<RobotMotion, String>>,
}

/// Line of a program above the outline's cuts, from 1; its last line where it has none.
pub(crate) fn outline_line(program: &str) -> usize {
    let line = program.lines().position(|line| line == crate::program::OUTLINE);
    line.map_or(program.lines().count(), |n| n + 1)
}

impl Milled<'_> {
    pub fn told(&self) -> Told {
        Told { metrics: self.metrics(), warnings: self.warnings(), shortfalls: self.shortfalls() }
    }

    /// Places where stock stays by the planner's stock; none where the proof finds none.
    pub fn left(&self) -> &[Leftover] {
        let is_made = self.proof.thickest_uncut_mm <= most_uncut_mm(self.job.process.finishing_step_mm);
        if is_made { &[] } else { &self.machining.left }
    }

    /// Greatest cutting force of the program, and of it from the outline on, N.
    fn forces_n(&self) -> [f64; 2] {
        [0, self.outline_line].map(|line| cutting_force_n(self.machining_job, self.proof.chip_mm(line)))
    }

    fn warnings(&self) -> Vec<String> {
        let mut warnings: Vec<String> =
            self.solid.changes.iter().map(|change| format!("the mesh was repaired: {change}")).collect();
        if self.solid.shallow_crossings > 0 {
            let (pairs, tolerance_mm) =
                (self.solid.shallow_crossings, bonemill_imaging::part::CROSSING_TOLERANCE_MM);
            warnings.push(format!("{pairs} pairs of facets touch or cross by at most {tolerance_mm} mm"));
        }
        let feeds = self.machining.warnings.iter().filter(|w| matches!(w, Warning::Feed { .. }));
        warnings.extend(feeds.map(ToString::to_string));
        let strip = &self.machining.strip;
        let [force_n, outline_n] = self.forces_n();
        for (what, bears_n, force_n) in
            [("strip", strip.strip_bears_n, force_n), ("tab", strip.tab_bears_n, outline_n)]
        {
            if bears_n < LEAST_FACTOR * force_n {
                warnings.push(format!(
                    "the {what} that holds the part bears {bears_n:.1} N, the cutting force is {force_n:.1} N; at least {LEAST_FACTOR} times as much is expected"
                ));
            }
        }
        let bends_mm = bent_mm(&self.machining_job.tool, force_n);
        if bends_mm > self.job.process.finishing_step_mm {
            let tool = &self.job.tool;
            warnings.push(format!(
                "the cutter bends by {bends_mm:.2} mm under {force_n:.1} N: `tool.length_mm` = {} is long for `tool.diameter_mm` = {}; \
                 `process.finishing_step_mm` is {}",
                tool.length_mm, tool.diameter_mm, self.job.process.finishing_step_mm
            ));
        }
        warnings.extend(self.left().iter().map(|place| left(place, &self.machining_job.tool)));
        warnings
    }

    fn shortfalls(&self) -> Vec<String> {
        let mut found = Vec::new();
        match self.robot {
            None => {}
            Some(Err(reason)) => found.push(reason.clone()),
            Some(Ok(robot)) => {
                let takes_min = robot.duration_s / 60.0;
                let most_min = self.job.machine.max_time_min.filter(|most_min| takes_min > *most_min);
                found.extend(most_min.map(|most_min| {
                    format!("the arm takes {takes_min:.1} min, but there are {most_min:.1} min")
                }));
            }
        }
        // an arm has its own reach and its own time
        if self.job.machine.kind == MachineKind::FiveAxis {
            let limits = self.machining.warnings.iter().filter(|w| !matches!(w, Warning::Feed { .. }));
            found.extend(limits.map(ToString::to_string));
        }
        let why = |at_mm: &Vector3<f64>| {
            let tool = &self.machining_job.tool;
            let away_mm = |left: &&Leftover| (left.at_mm - at_mm).norm();
            let nearest = self.left().iter().min_by(|a, b| away_mm(a).total_cmp(&away_mm(b)));
            let near = nearest.filter(|left| away_mm(left) <= SAME_PLACE * tool.diameter_mm());
            near.map(|left| reason(left.reason, tool))
        };
        found.extend(by_proof(self.proof, self.proof_job, self.job.process.finishing_step_mm, why));
        found
    }

    /// The figures of `[result.metrics]`.
    fn metrics(&self) -> Vec<(String, Value)> {
        let Self { solid, chosen, machining, proof, .. } = self;
        let (times, strip) = (&machining.times, &machining.strip);
        let residual = |laid: &Laid| {
            let r = laid.residual;
            Value::List([r.xy_mm2, r.xz_mm2, r.yz_mm2].map(Value::from).to_vec())
        };
        let size_mm = chosen.size_mm.iter().map(|&side| side.into()).collect();
        let mut metrics: Vec<(&str, Value)> = vec![
            ("facets", solid.mesh.triangles.len().into()),
            ("volume_mm3", solid.mesh.volume_mm3().into()),
            ("size_mm", Value::List(size_mm)),
            ("residual_given_xy_xz_yz_mm2", residual(self.given)),
        ];
        if let Some(run) = self.runs.last() {
            metrics.push(("published_runs", self.runs.len().into()));
            metrics.push(("residual_published_xy_xz_yz_mm2", residual(&run.laid)));
        }
        let block_mm3: f64 = (self.block.high_mm - self.block.low_mm).iter().product();
        let cuts = machining.moves.iter().filter(|m| m.kind.cuts()).count();
        let left_mm3 = self.left().iter().fold(0.0, |sum, left| sum + left.volume_mm3);
        let [force_n, outline_n] = self.forces_n();
        // a cutter that is too short for the outline cuts nothing there: the share stays finite
        let over = |bears_n: f64, force_n: f64| bears_n / force_n.max(1e-3);
        metrics.extend([
            ("residual_xy_xz_yz_mm2", residual(chosen)),
            ("block_mm3", block_mm3.into()),
            ("moves", machining.moves.len().into()),
            ("cuts", cuts.into()),
            ("constant_speed_time_s", times.constant_s.into()),
            ("total_time_s", times.limited_s.into()),
            ("cutting_time_s", times.cutting_s.into()),
            ("strip_mm", strip.thickness_mm.into()),
            ("cutting_force_n", force_n.into()),
            ("strip_strength_over_force", over(strip.strip_bears_n, force_n).into()),
            ("tab_mm", strip.tab_mm.into()),
            ("outline_force_n", outline_n.into()),
            ("tab_strength_over_force", over(strip.tab_bears_n, outline_n).into()),
            ("left_mm3", left_mm3.into()),
            ("deepest_gouge_mm", proof.deepest_gouge_mm.into()),
            ("thickest_uncut_mm", proof.thickest_uncut_mm.into()),
            ("uncut_mm3", proof.uncut_mm3.into()),
            ("collisions", proof.collisions.len().into()),
            ("loose_mm3", proof.loose_mm3().into()),
            ("widest_cut_mm", proof.widest_mm.into()),
            ("cuts_too_wide", proof.too_wide.len().into()),
        ]);
        if let Some(Ok(robot)) = self.robot {
            metrics.push(("robot_time_s", robot.duration_s.into()));
        }
        metrics.into_iter().map(|(name, value)| (name.to_owned(), value)).collect()
    }
}

/// How far a force at its tip bends a cutter that the holder clamps, F L³ / (3 E I), I = π d⁴ / 64, mm; its flutes are taken for solid.
fn bent_mm(tool: &EndMill, force_n: f64) -> f64 {
    let inertia_mm4 = std::f64::consts::PI * tool.diameter_mm().powi(4) / 64.0;
    force_n * tool.length_mm.powi(3) / (3.0 * CARBIDE_N_MM2 * inertia_mm4)
}

fn left(left: &Leftover, tool: &EndMill) -> String {
    let (p, why) = (left.at_mm, reason(left.reason, tool));
    format!(
        "stock of {:.2} mm³, up to {:.2} mm thick, stays at ({:.1}, {:.1}, {:.1}) mm: {why}",
        left.volume_mm3, left.deepest_mm, p.x, p.y, p.z
    )
}

fn reason(reason: Reason, tool: &EndMill) -> String {
    match reason {
        Reason::Hidden => "the part covers it on both sides".into(),
        Reason::Narrow => {
            format!("the cutter of {} mm diameter is too wide for the place", tool.diameter_mm())
        }
        Reason::Corner => {
            format!("an inner corner of the outline keeps the cutter's radius of {} mm", tool.radius_mm)
        }
        Reason::Deep => "the holder would meet the block".into(),
    }
}

/// How far a place that the proof finds may be from the stock that the planner says stays there, in diameters of the cutter.
const SAME_PLACE: f64 = 1.0;

/// Why a program falls short by what it leaves.
///
/// `why` says why stock stays near a place, where that is known.
pub(crate) fn by_proof(
    proof: &Proof,
    job: &ProofJob,
    finishing_step_mm: f64,
    why: impl Fn(&Vector3<f64>) -> Option<String>,
) -> Vec<String> {
    let mut found = Vec::new();
    if proof.deepest_gouge_mm > MOST_GOUGE_MM {
        let p = proof.gouge_at_mm;
        let (x, y, z) = (p.x, p.y, p.z);
        let deepest_mm = proof.deepest_gouge_mm;
        found.push(format!(
            "the part is cut {deepest_mm:.4} mm deep at ({x:.2}, {y:.2}, {z:.2}) mm; at most {MOST_GOUGE_MM} mm"
        ));
    }
    let most_mm = most_uncut_mm(finishing_step_mm);
    if proof.thickest_uncut_mm > most_mm {
        for place in proof.uncut(most_mm, job) {
            let p = place.at_mm;
            // the proof looks no farther
            let stock = if place.thickest_mm < FARTHEST_MM {
                format!("up to {:.3} mm", place.thickest_mm)
            } else {
                format!("{FARTHEST_MM} mm or more")
            };
            let why = why(&p).map_or_else(String::new, |why| format!(": {why}"));
            found.push(format!(
                "stock of {stock} is left on {:.2} mm² of the part at ({:.1}, {:.1}, {:.1}) mm; at most {most_mm:.3} mm{why}",
                place.area_mm2, p.x, p.y, p.z
            ));
        }
    }
    if let Some(first) = proof.collisions.first() {
        let (count, line, depth_mm) = (proof.collisions.len(), first.line, first.depth_mm);
        found.push(format!(
            "{count} motions meet the stock with what must not, the first in line {line} by {depth_mm:.3} mm ({:?})",
            first.struck
        ));
    }
    if let Some(first) = proof.loose.first() {
        let (p, volume_mm3) = (first.at_mm, proof.loose_mm3());
        found.push(format!(
            "{} pieces of {volume_mm3:.1} mm³ come loose before the end, the first in line {} with {:.1} mm³ at ({:.1}, {:.1}, {:.1}) mm",
            proof.loose.len(),
            first.line,
            first.volume_mm3,
            p.x,
            p.y,
            p.z
        ));
    }
    if let Some(first) = proof.too_wide.first() {
        found.push(format!(
            "{} cuts are wider than {:.3} mm, the first in line {} with {:.3} mm over {:.2} mm",
            proof.too_wide.len(),
            job.widest_mm,
            first.line,
            first.width_mm,
            first.length_mm
        ));
    }
    found
}
