//! The result of a subcommand: a text for people, a JSON object for machines, and an exit code.

use std::io::{Write, stdout};
use std::path::Path;
use std::process::ExitCode;

use anyhow::Context;
use bonemill_planner::compare::{Comparison, Group, Pair};
use bonemill_planner::plan::{ChannelRecord, PlanRecord, Value};
use bonemill_planner::report::percent;
use bonemill_planner::report::simulation::{figures, values};
use bonemill_planner::run::RunComparison;
use bonemill_planner::simulate::Simulation;
use bonemill_planner::uncertainty::{ErrorModel, Risk};
use bonemill_planner::verify::{Check, Short, Verification};
use bonemill_prosthesis::JobRecord;
use bonemill_prosthesis::verify::Verdict;
use serde_json::{Map, json};

use crate::args::Talk;
use crate::planning::Planned;

/// The result of a subcommand that did not end with an error.
pub struct Outcome {
    /// Text for people, on stdout.
    text: String,
    /// JSON object for machines, on stdout.
    object: Map<String, serde_json::Value>,
    /// Why the result falls short; exit code 1 unless empty.
    shortfalls: Vec<String>,
}

impl Outcome {
    /// A result with only a text.
    pub fn text(command: &str, text: String) -> Self {
        let mut outcome = Self::new(command, text);
        outcome.object.insert("text".into(), outcome.text.clone().into());
        outcome
    }

    /// Appends the plan's warnings.
    pub fn warning(mut self, warnings: &[String]) -> Self {
        self.text.push_str(&told(warnings));
        self.object.insert("warnings".into(), warnings.into());
        self
    }

    /// Puts the plan's warnings before the text.
    pub fn warning_first(mut self, warnings: &[String]) -> Self {
        self.text.insert_str(0, &told(warnings));
        self.object.insert("warnings".into(), warnings.into());
        self
    }

    /// Files were written to `out`.
    pub fn written(command: &str, out: &Path, what: &str) -> Self {
        let mut outcome = Self::new(command, format!("wrote {}: {what}\n", out.display()));
        outcome.object.insert("out".into(), out.to_string_lossy().into());
        outcome
    }

    /// A case was made; `text` tells what of.
    pub fn drafted(out: &Path, text: String, figures: serde_json::Value) -> Self {
        let mut outcome = Self::values("case", text, figures);
        outcome.object.insert("out".into(), out.to_string_lossy().into());
        outcome
    }

    /// A plan was written to `out`.
    pub fn planned(out: &Path, Planned { record, images, headers }: Planned) -> Self {
        let m = &record.metrics;
        let share = |name| percent(m.number(name).unwrap_or(0.0));
        let text = format!(
            "wrote {}\nremoved {:.1} mm³ of the target's {:.1} mm³ ({}); of the {:.1} mm³ that the burr can reach {:.1} mm³ ({}); {:.0} s of \
             milling\n",
            out.display(),
            m.removed_mm3,
            m.target_mm3,
            share("removed_share"),
            m.reachable_mm3,
            m.number_at(&["removed_reachable", "all_mm3"]).unwrap_or(0.0),
            share("reached_share"),
            m.total_time_s
        );
        let text = record.channel().map_or(text, |channel| channel_text(out, &record, &channel));
        let told = (headers > 0).then(|| {
            format!(
                "--pack keeps {headers} DICOM files with their headers, which hold the patient's name, number and dates: the plan may \
                 go only where the scan itself may"
            )
        });
        let warnings: Vec<String> = told.into_iter().chain(record.warnings.iter().cloned()).collect();
        let mut outcome = Self::new("plan", text).warning(&warnings);
        outcome.shortfalls.clone_from(&record.shortfalls);
        outcome.object.insert("out".into(), out.to_string_lossy().into());
        outcome.object.insert("metrics".into(), to_json(&Value::Table(m.entries())));
        outcome.object.insert("images".into(), images);
        outcome.object.insert("shortfalls".into(), record.shortfalls.clone().into());
        outcome
    }

    /// A plan was verified; the result is in the file `path`. Passed checks are counted, or listed with `all`; failed ones come
    /// last.
    pub fn verified(
        path: &Path,
        found: &Verification,
        drawn: Option<(&ErrorModel, &Risk)>,
        all: bool,
    ) -> Self {
        let line = |c: &Check| format!("{}  {c}\n", if c.passed() { "pass" } else { "FAIL" });
        let listed = found.checks.iter().filter(|_| all).map(line).collect();
        let checks: Vec<_> = found
            .checks
            .iter()
            .map(|c| {
                json!({
                    "name": c.name, "subject": c.subject, "passed": c.passed(), "value": c.value,
                    "limit": c.limit, "margin": c.margin(), "unit": c.unit,
                    "place": c.place.as_ref().map(ToString::to_string), "note": c.note,
                })
            })
            .collect();
        let mut outcome = Self::new("verify", listed);
        outcome.shortfalls = found.failed().map(ToString::to_string).collect();
        if let Some((model, risk)) = drawn {
            outcome.add_risk(risk, model.keep);
        }
        let (count, failed) = (found.checks.len(), found.failed().count());
        let hint = if all { "" } else { " (--all lists them)" };
        outcome.text +=
            &format!("{} of {count} checks passed{hint}; wrote {}\n", count - failed, path.display());
        outcome.text.extend(outcome.shortfalls.iter().map(|failed| format!("FAIL  {failed}\n")));
        outcome.object.insert("out".into(), path.to_string_lossy().into());
        outcome.object.insert("passed".into(), found.passed().into());
        outcome.object.insert("checks".into(), checks.into());
        outcome.object.insert("shortfalls".into(), outcome.shortfalls.clone().into());
        outcome
    }

    /// A simulation's figures; contact of the shank with bone is a shortfall.
    pub fn simulated(out: &Path, simulation: &Simulation, record: &PlanRecord) -> Self {
        let mut text = format!("wrote {}\n", out.display());
        let figures = figures(simulation, record);
        text.extend(figures.iter().map(|(name, value)| format!("{name}: {value}\n")));
        let mut outcome = Self::new("simulate", text);
        if let Some((time_s, c)) = simulation.contacts.first() {
            outcome.shortfalls.push(format!(
                "the shank touches bone: {} steps were stopped, the first at {time_s:.3} s, {:.2} mm deep in {}, {:.1} mm behind \
                 the burr's centre",
                simulation.stopped,
                c.depth_mm,
                c.kind.word(),
                c.along_mm
            ));
        }
        outcome.object.insert("out".into(), out.to_string_lossy().into());
        outcome.object.insert("figures".into(), to_json(&Value::Table(values(simulation, &record.case))));
        outcome.object.insert("shortfalls".into(), outcome.shortfalls.clone().into());
        outcome
    }

    /// Adds the risks under random errors, and a shortfall where one is too large.
    fn add_risk(&mut self, risk: &Risk, keep: f64) {
        self.text += "under random errors, the probability of touching (distances and forces: 5, 50 and 95 % quantiles):\n";
        let mut structures = Vec::new();
        for s in &risk.structures {
            let (t, [low, middle, high]) = (&s.touched, s.kept_mm);
            let line = format!(
                "{}: {:.4} (95 % interval {:.4} to {:.4}), distance {low:.2}, {middle:.2}, {high:.2} mm, a clearance of {:.2} mm would do",
                s.name, t.estimate, t.low, t.high, s.clearance_mm
            );
            self.text += &format!("  {line}\n");
            if s.falls_short(keep) {
                self.shortfalls.push(format!("probability of touching {line}: more than {:.4}", 1.0 - keep));
            }
            structures.push(json!({
                "name": s.name, "touched": t.estimate, "interval_95": [t.low, t.high], "hits": t.hits,
                "samples": t.samples, "kept_mm_05_50_95": s.kept_mm, "clearance_mm": s.clearance_mm,
            }));
        }
        let mut forces = Vec::new();
        for f in &risk.forces {
            let [low, middle, high] = f.spread_n;
            self.text += &format!(
                "  force, {}: planned {:.3} N, {low:.3}, {middle:.3}, {high:.3} N\n",
                f.name, f.planned_n
            );
            forces.push(json!({ "name": f.name, "planned_n": f.planned_n, "n_05_50_95": f.spread_n }));
        }
        self.object.insert("risk".into(), json!({ "structures": structures, "forces": forces }));
    }

    /// A prosthesis was written to `out`.
    pub fn made(out: &Path, record: &JobRecord) -> Self {
        let number = |name: &str| record.number(name).unwrap_or(0.0);
        let text = format!(
            "wrote {}\nblock {}; {:.1} min of milling; at most {:.4} mm cut into the part, {:.3} mm left on it\n",
            out.display(),
            record.block_id,
            number("total_time_s") / 60.0,
            number("deepest_gouge_mm"),
            number("thickest_uncut_mm"),
        );
        let mut outcome = Self::new("prosthesis", text).warning(&record.warnings);
        let figures: Map<_, _> = record.metrics.iter().map(|(name, v)| (name.clone(), to_json(v))).collect();
        outcome.object.insert("out".into(), out.to_string_lossy().into());
        outcome.object.insert("block".into(), record.block_id.clone().into());
        outcome.object.insert("figures".into(), figures.into());
        outcome.object.insert("shortfalls".into(), record.shortfalls.clone().into());
        outcome.shortfalls.clone_from(&record.shortfalls);
        outcome
    }

    /// A prosthesis was judged; the verdict stands in `path`.
    pub fn judged(path: &Path, verdict: &Verdict, all: bool) -> Self {
        let mut text = String::new();
        let mut shortfalls = Vec::new();
        for check in &verdict.checks {
            if all && check.faults.is_empty() {
                text += &format!("ok    {}\n", check.name);
            }
            shortfalls.extend(check.faults.iter().map(|fault| format!("{}: {fault}", check.name)));
        }
        text.extend(shortfalls.iter().map(|failed| format!("FAIL  {failed}\n")));
        let good = verdict.checks.iter().filter(|check| check.faults.is_empty()).count();
        text += &format!("{good} of {} checks passed; wrote {}\n", verdict.checks.len(), path.display());
        let mut outcome = Self::new("verify", text);
        outcome.object.insert("out".into(), path.to_string_lossy().into());
        outcome.object.insert("passed".into(), verdict.passed().into());
        outcome.object.insert("shortfalls".into(), shortfalls.clone().into());
        outcome.shortfalls = shortfalls;
        outcome
    }

    /// Two plans were compared; the page is in the file `out`. The text has the figures that matter most, or all of them.
    pub fn compared(comparison: &Comparison, names: [&str; 2], all: bool, out: Option<&Path>) -> Self {
        let mut text = if all {
            comparison.table(names)
        } else {
            comparison.summary(names) + "(--all prints every figure, of every structure)\n"
        };
        text.extend(out.map(|path| format!("wrote {}\n", path.display())));
        let mut outcome = Self::new("compare", text);
        let texts = |rows: &[(String, Pair<String>)]| -> Map<_, _> {
            rows.iter().map(|(key, values)| (key.clone(), json!(values))).collect()
        };
        let figures = |group: &Group| -> Map<_, _> {
            group.figures.iter().map(|f| (f.name.clone(), json!(f.values))).collect()
        };
        let groups: Map<_, _> =
            comparison.groups.iter().map(|g| (g.title.clone(), figures(g).into())).collect();
        let between: Map<_, _> =
            comparison.between.entries().into_iter().map(|(name, v)| (name.to_owned(), v.into())).collect();
        outcome.object.insert("plans".into(), json!(names));
        outcome.object.insert("case".into(), texts(&comparison.case).into());
        outcome.object.insert("inputs".into(), texts(&comparison.inputs).into());
        outcome.object.insert("figures".into(), groups.into());
        outcome.object.insert("between".into(), between.into());
        outcome.object.extend(out.map(|path| ("out".into(), path.to_string_lossy().into())));
        outcome
    }

    /// A run was set beside its plan; the page stands in `out`.
    pub fn executed(found: &RunComparison, out: Option<&Path>) -> Self {
        let figures = found.figures();
        let mut text: String =
            figures.iter().map(|(name, value)| format!("{name}: {}\n", words(value))).collect();
        text.extend(found.events.last().map(|(time_s, said)| format!("{time_s:.3} s: {said}\n")));
        text.extend(out.map(|path| format!("wrote {}\n", path.display())));
        let mut outcome = Self::new("report", text);
        let events: Vec<_> =
            found.events.iter().map(|(s, said)| json!({ "time_s": s, "said": said })).collect();
        outcome.object.insert("figures".into(), to_json(&Value::Table(figures)));
        outcome.object.insert("events".into(), events.into());
        outcome.object.extend(out.map(|path| ("out".into(), path.to_string_lossy().into())));
        outcome
    }

    /// A result with values for machines and a text for people.
    pub fn values(command: &str, text: String, values: serde_json::Value) -> Self {
        let mut outcome = Self::new(command, text);
        outcome.object.insert("figures".into(), values);
        outcome
    }

    /// Falls short for a reason.
    pub fn falling_short(mut self, reason: String) -> Self {
        self.shortfalls.push(reason);
        self.object.insert("shortfalls".into(), self.shortfalls.clone().into());
        self
    }

    fn new(command: &str, text: String) -> Self {
        let mut object = Map::new();
        object.insert("command".into(), command.into());
        Self { text, object, shortfalls: Vec::new() }
    }

    pub fn exit_code(&self) -> ExitCode {
        ExitCode::from(u8::from(!self.shortfalls.is_empty()))
    }

    /// Prints the result. Shortfalls are printed on stderr even with `--quiet`.
    ///
    /// # Errors
    /// When standard output takes not all of it: a full disk, a closed pipe.
    pub fn tell(
        &self,
        talk: Talk,
        seconds: &[(String, f64)],
        memory_mb_estimated: Option<f64>,
    ) -> anyhow::Result<()> {
        let printed = self.print(talk, seconds, memory_mb_estimated);
        let said = talk == Talk::People && self.object.get("command").is_some_and(|name| name == "verify");
        for reason in self.shortfalls.iter().filter(|_| !said) {
            eprintln!("fell short: {reason}");
        }
        printed
    }

    fn print(
        &self,
        talk: Talk,
        seconds: &[(String, f64)],
        memory_mb_estimated: Option<f64>,
    ) -> anyhow::Result<()> {
        let text = match talk {
            Talk::Quiet => return Ok(()),
            Talk::People => self.text.clone(),
            Talk::Machine => {
                let mut object = self.object.clone();
                let word = if self.shortfalls.is_empty() { "done" } else { "fell_short" };
                object.insert("outcome".into(), word.into());
                if let Some(mb) = memory_mb_estimated {
                    object.insert("memory_mb_estimated".into(), mb.round().into());
                }
                object.insert("stage_seconds".into(), by_stage(seconds).into());
                format!("{}\n", serde_json::Value::from(object))
            }
        };
        print(&text)
    }
}

/// Prints a text on standard output, all of it.
///
/// # Errors
/// When standard output does not take it.
pub fn print(text: &str) -> anyhow::Result<()> {
    let mut out = stdout().lock();
    let written = out.write_all(text.as_bytes()).and_then(|()| out.flush());
    written.context("cannot write to standard output")
}

/// Warnings, one per line.
fn told(warnings: &[String]) -> String {
    warnings.iter().map(|w| format!("warning: {w}\n")).collect()
}

/// Seconds by stage; repeated stages are added up.
fn by_stage(seconds: &[(String, f64)]) -> Map<String, serde_json::Value> {
    let mut map = Map::new();
    for (name, s) in seconds {
        let before = map.get(name).and_then(serde_json::Value::as_f64).unwrap_or(0.0);
        map.insert(name.clone(), (before + s).into());
    }
    map
}

/// A figure on one line.
fn words(value: &Value) -> String {
    match value {
        Value::Number(v) => Short(*v).to_string(),
        Value::Text(v) => v.clone(),
        Value::Table(entries) => {
            let entries: Vec<_> = entries.iter().map(|(name, v)| format!("{name} {}", words(v))).collect();
            entries.join(", ")
        }
        other => to_json(other).to_string(),
    }
}

fn to_json(value: &Value) -> serde_json::Value {
    match value {
        Value::Number(v) => (*v).into(),
        Value::Integer(v) => (*v).into(),
        Value::Text(v) => v.clone().into(),
        Value::Flag(v) => (*v).into(),
        Value::List(items) => items.iter().map(to_json).collect(),
        Value::Table(entries) => entries.iter().map(|(name, v)| (name.clone(), to_json(v))).collect(),
    }
}

/// Prints an error with its causes on stderr, and as a JSON object on stdout for machines; `falls_short`: the input is valid, but
/// the case cannot be fulfilled.
pub fn tell_error(error: &anyhow::Error, falls_short: bool, talk: Talk) {
    // an error may have several lines, one per fault
    for line in error.to_string().lines() {
        eprintln!("error: {line}");
    }
    let mut said = error.to_string();
    for cause in error.chain().skip(1).map(ToString::to_string) {
        // some errors already contain their cause
        if !said.contains(&cause) {
            eprintln!("  because: {cause}");
            said = cause;
        }
    }
    if talk == Talk::Machine {
        let causes: Vec<String> = error.chain().skip(1).map(ToString::to_string).collect();
        let word = if falls_short { "fell_short" } else { "error" };
        tell_object(&json!({ "outcome": word, "error": error.to_string(), "causes": causes }), &said);
    }
}

/// Prints the object of an error; the exit code tells the error anyway. `said`: what has been told last.
fn tell_object(object: &serde_json::Value, said: &str) {
    if let Err(lost) = print(&format!("{object}\n"))
        && lost.root_cause().to_string() != said
    {
        eprintln!("error: {lost}: {}", lost.root_cause());
    }
}

/// Prints what clap has to say of arguments that are none, or the help or version that they ask for.
pub fn tell_usage(said: &clap::Error, wants_json: bool) -> ExitCode {
    if !said.use_stderr() {
        let printed = print(&said.render().to_string());
        return match printed {
            Ok(()) => ExitCode::SUCCESS,
            Err(lost) => {
                tell_error(&lost, false, Talk::People);
                ExitCode::from(2)
            }
        };
    }
    // nothing is left to do where stderr is closed
    let _ = said.print();
    if wants_json {
        let text = said.render().to_string();
        let text = text.strip_prefix("error: ").unwrap_or(&text).trim_end();
        tell_object(&json!({ "outcome": "error", "error": text, "causes": [] }), text);
    }
    ExitCode::from(2)
}

/// Refuses to write a page into a file that is none by its name, e.g. a case.
///
/// # Errors
/// What was expected.
pub fn is_page(out: &Path) -> anyhow::Result<()> {
    let is_page = out.extension().is_some_and(|end| end.eq_ignore_ascii_case("html"));
    is_page
        .then_some(())
        .with_context(|| format!("--out {}: expected a file such as page.html", out.display()))
}

/// A planned channel for people.
fn channel_text(out: &Path, record: &PlanRecord, channel: &ChannelRecord) -> String {
    let m = &record.metrics;
    let number = |name| m.number(name).unwrap_or(0.0);
    format!(
        "wrote {}\na channel of {:.2} mm from where the tool meets bone, to {:.2} mm from the entry; {:.1} mm³ of bone; at most {:.2} N of thrust and {:.1} N mm of torque; {:.0} s\n",
        out.display(),
        channel.depth_mm - channel.contact_depth_mm,
        channel.depth_mm,
        m.removed_bone_mm3,
        number("peak_thrust_n"),
        number("peak_torque_nmm"),
        m.total_time_s
    )
}
