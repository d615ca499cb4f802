//! `bonemill simulate --stream`: reads one pose per line and prints one line of forces for each, for example for a haptic device.
//!
//! A line holds `time_s x y z axis_x axis_y axis_z`, ct, mm, separated by blanks or commas; the first one places the burr. The
//! answer holds `time_s,fx_n,fy_n,fz_n,torque_nmm,power_w,mrr_mm3_s,force_toward_n,structure,distance_mm,contact_mm`. If
//! contact_mm is given, the shank would be in bone by this depth, and the step was not made. For a line that is not a pose
//! the answer is `refused: ` and the reason, and nothing changes.

use std::io::{BufRead, Write, stdin, stdout};
use std::time::Instant;

use anyhow::Context;
use bonemill_geometry::Point;
use bonemill_planner::Progress;
use bonemill_planner::plan::StoredPlan;
use bonemill_planner::simulate::{
    Engine, EngineError, ForceModel, ModelName, Move, Pose, SimulationSetup, Step, bone_of,
};
use nalgebra::Vector3;
use serde_json::json;

use crate::args::Talk;
use crate::outcome::Outcome;
use crate::pose_line::numbers;

/// Least duration of a step, s; for shorter ones the speed would be inexact.
const LEAST_SECONDS: f64 = 1e-6;

type Milling<'a> = Engine<'a, f32, Box<dyn ForceModel>>;

pub fn run(
    plan: &StoredPlan,
    model: ModelName,
    progress: &dyn Progress,
    talk: Talk,
) -> anyhow::Result<Outcome> {
    let setup = SimulationSetup::read(plan, progress)?;
    progress.stage("stream");
    let mut hand = Hand { plan, setup: &setup, model, engine: None, time_s: 0.0 };
    let mut took_us = Vec::new();
    let mut out = stdout().lock();
    for line in stdin().lock().split(b'\n') {
        // a line of bytes that are not text is not a pose
        let line = line.context("cannot read stdin")?;
        let line = String::from_utf8_lossy(&line);
        if line.trim().is_empty() {
            continue;
        }
        let start = Instant::now();
        let answer = hand.answer(line.trim());
        took_us.push(start.elapsed().as_secs_f64() * 1e6);
        writeln!(out, "{answer}").and_then(|()| out.flush()).context("cannot write to standard output")?;
    }
    drop(out);
    Ok(summary(&mut took_us, talk))
}

/// Summary of the steps' durations; printed on stderr for people, because stdout holds the answers.
fn summary(took_us: &mut [f64], talk: Talk) -> Outcome {
    took_us.sort_by(f64::total_cmp);
    let quantile = |q: f64| took_us.get((q * (took_us.len() as f64 - 1.0)).round().max(0.0) as usize);
    let [p50, p99, max] = [0.5, 0.99, 1.0].map(|q| quantile(q).copied().unwrap_or(0.0));
    if talk == Talk::People {
        eprintln!("{} lines; time of one: p50 {p50:.1} µs, p99 {p99:.1} µs, max {max:.1} µs", took_us.len());
    }
    let values = json!({ "lines": took_us.len(), "p50_us": p50, "p99_us": p99, "max_us": max });
    Outcome::values("simulate", String::new(), values)
}

/// A tool that is moved by the poses on standard input.
struct Hand<'a> {
    plan: &'a StoredPlan,
    setup: &'a SimulationSetup,
    model: ModelName,
    engine: Option<Milling<'a>>,
    time_s: f64,
}

impl Hand<'_> {
    fn answer(&mut self, line: &str) -> String {
        self.step(line).unwrap_or_else(|refused| format!("refused: {refused}"))
    }

    fn step(&mut self, line: &str) -> anyhow::Result<String> {
        let [time_s, pose @ ..] = numbers(line)?;
        let pose = self.pose(pose)?;
        let Some(engine) = &mut self.engine else {
            let model = self.model.model(&self.plan.record.case, &self.setup.spec)?;
            let bone = bone_of(&self.setup.scene, &self.setup.density_g_cm3)?;
            self.engine = Some(Engine::new(bone, self.setup.spec.clone(), model, pose)?);
            self.time_s = time_s;
            return Ok(self.row(time_s, pose.center, None));
        };
        let seconds = time_s - self.time_s;
        anyhow::ensure!(
            seconds <= 0.0 || seconds >= LEAST_SECONDS,
            "{seconds:e} s since the last pose: expected at least {LEAST_SECONDS:e}"
        );
        let step = engine.step(Move::straight(pose, seconds))?;
        let center = engine.pose().center;
        self.time_s = time_s;
        Ok(self.row(time_s, center, Some(step)))
    }

    fn pose(&self, [x, y, z, axis @ ..]: [f64; 6]) -> Result<Pose, EngineError> {
        let work_from_ct = self.setup.scene.ct_from_work.inverse();
        Pose::new(work_from_ct * Point::new(x, y, z), work_from_ct.rotate(&Vector3::from(axis)))
    }

    fn row(&self, time_s: f64, center: Point<bonemill_geometry::Work>, step: Option<Step>) -> String {
        let (force, mrr, contact) =
            step.map_or_else(Default::default, |s| (s.force, s.mrr_mm3_s, s.contact.map(|c| c.depth_mm)));
        let f = self.setup.scene.ct_from_work.rotate(&force.force_n);
        let nearest = self.setup.toward(center, &force.force_n).into_iter().next();
        let name = nearest.and_then(|n| self.plan.record.case.structures.get(n.structure));
        let name = name.map_or("", |s| &s.name);
        let cell = |v: Option<f64>| v.map_or(String::new(), |v| format!("{v:?}"));
        format!(
            "{time_s:?},{:?},{:?},{:?},{:?},{:?},{mrr:?},{},{name},{},{}",
            f.x + 0.0,
            f.y + 0.0,
            f.z + 0.0,
            force.torque_nmm,
            force.spindle_power_mw * 1e-3,
            cell(nearest.and_then(|n| n.force_n)),
            cell(nearest.map(|n| n.distance_mm)),
            cell(contact)
        )
    }
}
