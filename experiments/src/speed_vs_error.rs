//! Speed against error of whole plans: every approximation coarser and finer alone, and some together.
//!
//! Two kinds of error. How exact the figures of a plan are is measured by the planner on the plan itself
//! ([`bonemill_planner::pipeline::ForceError`]). How far a plan is from the one that would be found with everything fine is the difference
//! of their figures. The finest plan of each body is the reference; the steps of each knob show whether it has converged.

use std::path::Path;
use std::time::Instant;

use bonemill_imaging::phantom::{PhantomKind, phantom};
use bonemill_planner::Progress;
use bonemill_planner::case::Case;
use bonemill_planner::pipeline::{Plan, plan};

use crate::body::Body;
use crate::figures::PlanFigures;
use crate::pareto::picture::{Panel, PlotPoint, svg};
use crate::{ExperimentError, Size, Table};

/// A knob's setting, from coarse to fine.
type Setting = fn(&mut Case, f64);

/// An approximation: what it is, its values, the default among them, and how a case takes one.
struct Knob {
    name: &'static str,
    values: &'static [f64],
    default: f64,
    set: Setting,
}

const KNOBS: [Knob; 6] = [
    Knob {
        name: "grid.spacing_mm",
        values: &[0.5, 0.35, 0.25, 0.18],
        default: 0.25,
        set: |case, value| case.grid.spacing_mm = value,
    },
    Knob {
        name: "path.step_mm",
        values: &[1.0, 0.5, 0.25, 0.15],
        default: 0.25,
        set: |case, value| case.path.step_mm = value,
    },
    Knob {
        name: "accuracy.force_elements",
        values: &[16.0, 32.0, 64.0, 128.0],
        default: 64.0,
        set: |case, value| case.accuracy.force_elements = value as u32,
    },
    Knob {
        name: "accuracy.force_directions",
        values: &[256.0, 512.0, 1024.0, 4096.0],
        default: 1024.0,
        set: |case, value| case.accuracy.force_directions = value as u32,
    },
    Knob {
        name: "accuracy.force_change",
        values: &[1.0, 0.2, 0.05, 0.02],
        default: 0.05,
        set: |case, value| case.accuracy.force_change = value,
    },
    Knob {
        name: "accuracy.axis_spacing_deg",
        values: &[8.0, 4.0, 2.0, 1.0],
        default: 2.0,
        set: |case, value| case.accuracy.axis_spacing_rad = value.to_radians(),
    },
];

/// Settings of all knobs together, in their order.
const TOGETHER: [(&str, [f64; KNOBS.len()]); 5] = [
    ("default", [0.25, 0.25, 64.0, 1024.0, 0.05, 2.0]),
    ("all coarsest", [0.5, 1.0, 16.0, 256.0, 1.0, 8.0]),
    ("all coarse", [0.5, 0.5, 32.0, 512.0, 0.2, 4.0]),
    ("forces fine", [0.25, 0.25, 128.0, 4096.0, 0.02, 2.0]),
    ("all fine", [0.18, 0.15, 128.0, 4096.0, 0.02, 1.0]),
];

/// What is compared.
struct Outcome {
    body: String,
    changed: String,
    processor_s: f64,
    wall_s: f64,
    figures: PlanFigures,
    /// Of the forces of cuts, of the pushes toward structures, of the largest within a cut, of the removed volume, as the plan measures them,
    /// shares; of the least distance, mm.
    own: [f64; 5],
}

/// Processor time of this process so far, s; `None` where the system does not tell it.
fn processor_s() -> Option<f64> {
    /// Clock ticks of /proc a second on Linux.
    const TICKS: f64 = 100.0;
    let text = std::fs::read_to_string("/proc/self/stat").ok()?;
    // the name in parentheses may hold spaces
    let fields: Vec<&str> = text.rsplit(')').next()?.split_whitespace().collect();
    let ticks = |n: usize| fields.get(n)?.parse::<f64>().ok();
    Some((ticks(11)? + ticks(12)?) / TICKS)
}

impl Outcome {
    fn of((body, changed): (&str, String), plan: &Plan, [processor_s, wall_s]: [f64; 2]) -> Self {
        let (error, path) = (&plan.modelled.axes.force_error, &plan.modelled.path.error);
        Self {
            body: body.into(),
            changed,
            processor_s,
            wall_s,
            figures: PlanFigures::of(plan),
            own: [
                error.of_cuts_share,
                error.toward_share,
                error.beyond_share,
                path.removed_share.abs(),
                path.distance_mm,
            ],
        }
    }

    fn row(&self, reference: &Self) -> Vec<String> {
        let per_cent = |share: f64| format!("{:.2}", 100.0 * share);
        [
            self.body.clone(),
            self.changed.clone(),
            format!("{:.1}", self.processor_s),
            format!("{:.1}", self.wall_s),
            per_cent(self.own[0]),
            per_cent(self.own[1]),
            per_cent(self.own[2]),
            per_cent(self.own[3]),
            format!("{:.4}", self.own[4]),
        ]
        .into_iter()
        .chain(self.figures.changes(&reference.figures).map(|(change, digits)| format!("{change:+.digits$}")))
        .collect()
    }
}

/// All settings of one body, the reference last.
fn swept(name: &str, body: &Body, progress: &dyn Progress) -> Result<Vec<Outcome>, ExperimentError> {
    let default = body.case(false)?;
    let mut settings: Vec<(String, Case)> = Vec::new();
    for knob in &KNOBS {
        for value in knob.values.iter().filter(|value| **value != knob.default) {
            let mut case = default.clone();
            (knob.set)(&mut case, *value);
            settings.push((format!("{} = {value}", knob.name), case));
        }
    }
    for (name, values) in TOGETHER {
        let mut case = default.clone();
        for (knob, value) in KNOBS.iter().zip(values) {
            (knob.set)(&mut case, value);
        }
        settings.push((name.into(), case));
    }
    let planned = |(changed, case): (String, Case)| {
        progress.stage(&format!("{name}: {changed}"));
        let (before, start) = (processor_s(), Instant::now());
        let found = plan(&case, body.case_path(), &())?;
        let taken = before.and_then(|before| Some(processor_s()? - before)).unwrap_or(f64::NAN);
        Ok(Outcome::of((name, changed), &found, [taken, start.elapsed().as_secs_f64()]))
    };
    settings.into_iter().map(planned).collect()
}

/// The name of the folder that holds a case.
fn folder_of(case: &Path) -> String {
    let folder = case.parent().and_then(|folder| folder.file_name());
    folder.unwrap_or(case.as_os_str()).to_string_lossy().into_owned()
}

/// The user's case; without one block and temporal bone, and the scan where it is.
///
/// # Errors
/// When a body cannot be made or planned.
pub fn run(size: Size, progress: &dyn Progress) -> Result<Vec<Table>, ExperimentError> {
    let title = "Speed against error of whole plans. \"Of cuts\", \"toward\", \"beyond\", \"volume\", \"nearer\": a plan's errors as it measures them on \
                 itself (mean |F| of single cuts, push toward structures, largest force within a cut, %; removed volume, % of the target; least \
                 distance, mm). The rest: change against the plan with \
                 everything fine, the last of each body: removed, points of %; least distance, mm; forces toward priority 1 and |F|, %; total time, %.";
    let own =
        ["body", "changed", "processor [s]", "wall [s]", "of cuts", "toward", "beyond", "volume", "nearer"];
    let head = [&own[..], &PlanFigures::HEADS].concat();
    let mut table = Table::new("speed-vs-error", title, &head);
    let (mut series, mut absent) = (Vec::new(), None);
    let mut add = |outcomes: Vec<Outcome>| {
        let Some(reference) = outcomes.last() else { return };
        outcomes.iter().for_each(|outcome| table.push(outcome.row(reference)));
        let point = |o: &Outcome| PlotPoint {
            x: o.processor_s,
            y: 100.0 * o.own[0],
            is_default: o.changed == "default",
        };
        let mut points: Vec<_> = outcomes.iter().map(point).collect();
        points.sort_by(|a, b| a.x.total_cmp(&b.x));
        series.push((reference.body.clone(), points));
    };
    if let Some(path) = size.case {
        let body = Body::case_file(path).ok_or_else(|| ExperimentError::NoCase(path.into()))?;
        add(swept(&folder_of(path), &body, progress)?);
    } else {
        for (name, kind) in [("block", PhantomKind::Block), ("temporal", PhantomKind::Temporal)] {
            add(swept(name, &Body::phantom(&phantom(kind, 1))?, progress)?);
        }
        let scan = crate::body::data().join("tbone_RT143/case.toml");
        if let Some(body) = Body::case_file(&scan) {
            add(swept(&folder_of(&scan), &body, progress)?);
        } else {
            absent = Some(scan);
        }
    }
    if let Some(scan) = absent {
        table.push_note("tbone_RT143".into(), format!("not here: {}", scan.display()));
    }
    let panel = Panel { x: "processor time [s]", y: "error of |F| of cuts [%]", is_log_x: true, series };
    table.picture = Some(svg(&[panel]));
    Ok(vec![table])
}
