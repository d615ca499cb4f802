//! Trade-off between the force toward the structures of the highest priority and time or removed volume.
//!
//! Every point is a complete plan of one body with one value changed: the total time, or the clearance of its structures of
//! the highest priority. The default is the plan of the body's unchanged case.

pub(crate) mod picture;

use bonemill_imaging::phantom::{PhantomKind, phantom};
use bonemill_planner::Progress;
use bonemill_planner::case::Case;
use bonemill_planner::pipeline::{Plan, plan};
use picture::{Panel, PlotPoint};

use crate::body::Body;
use crate::{ExperimentError, Size, Table};

/// Total times, as multiples of the default.
const TIMES: [f64; 7] = [0.5, 0.7, 0.85, 1.2, 1.5, 2.0, 3.0];
/// Added to the clearances, mm.
const WIDER_MM: [f64; 5] = [-0.5, 0.5, 1.0, 1.5, 2.0];
/// No clearance is made narrower than this, mm.
const NARROWEST_MM: f64 = 0.25;

/// One plan.
struct Outcome {
    changed: String,
    total_s: f64,
    removed_mm3: f64,
    target_mm3: f64,
    /// Largest mean over the structures of the highest priority, of the force toward a structure within its influence, zeros included, N.
    mean_n: f64,
    peak_n: f64,
    peak_force_n: f64,
    falls_short: bool,
}

impl Outcome {
    fn of(changed: String, plan: &Plan) -> Self {
        let case = &plan.setup.case;
        let first = plan.results.figures.structures.iter().enumerate().filter(|(n, _)| case.rank(*n) <= 1.0);
        let (mut mean_n, mut peak_n) = (0f64, 0f64);
        for (_, found) in first {
            mean_n = mean_n.max(found.force.mean_with_zeros_n);
            peak_n = peak_n.max(found.force.peak_n);
        }
        Self {
            changed,
            total_s: plan.moves.law.duration_s(),
            removed_mm3: plan.results.coverage.removed.all_mm3,
            target_mm3: plan.results.coverage.target.all_mm3 + plan.results.coverage.outside_mm3,
            mean_n,
            peak_n,
            peak_force_n: plan.results.figures.peak_force_n,
            falls_short: !plan.shortfalls.is_empty(),
        }
    }

    fn removed_share(&self) -> f64 {
        self.removed_mm3 / self.target_mm3.max(f64::MIN_POSITIVE)
    }
}

/// The default first, then the outcome of each value; `None` for a value with which planning fails.
struct Front {
    body: String,
    default: Outcome,
    times: Vec<Outcome>,
    clearances: Vec<Outcome>,
}

fn front(name: &str, body: &Body, progress: &dyn Progress) -> Result<Front, ExperimentError> {
    let case = body.case(false)?;
    progress.stage(name);
    let first = plan(&case, body.case_path(), &())?;
    let default = Outcome::of("default".into(), &first);
    let tried = |case: &Case, changed: String| {
        plan(case, body.case_path(), &()).ok().map(|plan| Outcome::of(changed, &plan))
    };
    let times = TIMES.iter().filter_map(|factor| {
        let mut case = case.clone();
        let total_s = factor * default.total_s;
        case.speed.total_time_s = Some(total_s);
        tried(&case, format!("total_time_s = {total_s:.0}"))
    });
    let times = times.collect();
    let clearances = WIDER_MM.iter().filter_map(|wider_mm| {
        let mut case = case.clone();
        let first: Vec<usize> = (0..case.structures.len()).filter(|n| case.rank(*n) <= 1.0).collect();
        for n in first {
            let structure = &mut case.structures[n];
            structure.clearance_mm += wider_mm;
            if structure.clearance_mm < NARROWEST_MM {
                return None;
            }
        }
        tried(&case, format!("clearance {wider_mm:+} mm"))
    });
    let clearances = clearances.collect();
    Ok(Front { body: name.into(), default, times, clearances })
}

/// Runs block, temporal bone, and the user's case.
///
/// # Errors
/// When a body cannot be made, or its unchanged case cannot be planned.
pub fn run(size: Size, progress: &dyn Progress) -> Result<Vec<Table>, ExperimentError> {
    let mut fronts = Vec::new();
    for (name, kind) in [("block", PhantomKind::Block), ("temporal", PhantomKind::Temporal)] {
        fronts.push(front(name, &Body::phantom(&phantom(kind, 1))?, progress)?);
    }
    if let Some(path) = size.case {
        let body = Body::case_file(path).ok_or_else(|| ExperimentError::NoCase(path.into()))?;
        let folder = path.parent().and_then(|p| p.file_name()).unwrap_or(path.as_os_str());
        fronts.push(front(&folder.to_string_lossy(), &body, progress)?);
    }
    Ok(vec![table(&fronts)])
}

fn table(fronts: &[Front]) -> Table {
    let title = "Force toward structures of the highest priority wherever they are within their influence, against the total time and the \
                 volume removed. Each row is a whole plan of the case with one value changed; * falls short of its case.";
    let head = [
        "body",
        "changed",
        "total time [s]",
        "removed [mm³]",
        "removed [%]",
        "mean toward, zeros in [N]",
        "peak toward [N]",
        "peak |F| [N]",
    ];
    let mut table = Table::new("pareto", title, &head);
    for front in fronts {
        for o in std::iter::once(&front.default).chain(&front.times).chain(&front.clearances) {
            table.push(vec![
                front.body.clone(),
                format!("{}{}", o.changed, if o.falls_short { " *" } else { "" }),
                format!("{:.0}", o.total_s),
                format!("{:.1}", o.removed_mm3),
                format!("{:.1}", 100.0 * o.removed_share()),
                format!("{:.4}", o.mean_n),
                format!("{:.3}", o.peak_n),
                format!("{:.2}", o.peak_force_n),
            ]);
        }
    }
    table.picture = Some(picture::svg(&panels(fronts)));
    table
}

/// Panels of peak and mean force toward structures: over time, then over the removed share.
fn panels(fronts: &[Front]) -> Vec<Panel> {
    let series = |pick: fn(&Front) -> &[Outcome], x: fn(&Outcome) -> f64, y: fn(&Outcome) -> f64| {
        let of = |front: &Front| {
            let points = std::iter::once(&front.default).chain(pick(front)).enumerate();
            let mut points: Vec<PlotPoint> =
                points.map(|(n, o)| PlotPoint { x: x(o), y: y(o), is_default: n == 0 }).collect();
            points.sort_by(|a, b| a.x.total_cmp(&b.x));
            (front.body.clone(), points)
        };
        fronts.iter().map(of).collect::<Vec<_>>()
    };
    let peak: fn(&Outcome) -> f64 = |o| o.peak_n;
    let mean: fn(&Outcome) -> f64 = |o| o.mean_n;
    let times: fn(&Front) -> &[Outcome] = |f| &f.times;
    let clearances: fn(&Front) -> &[Outcome] = |f| &f.clearances;
    let minutes: fn(&Outcome) -> f64 = |o| o.total_s / 60.0;
    let share: fn(&Outcome) -> f64 = |o| 100.0 * o.removed_share();
    vec![
        Panel {
            x: "total time [min]",
            y: "peak toward [N]",
            is_log_x: true,
            series: series(times, minutes, peak),
        },
        Panel {
            x: "total time [min]",
            y: "mean toward [N]",
            is_log_x: true,
            series: series(times, minutes, mean),
        },
        Panel {
            x: "removed of the target [%]",
            y: "peak toward [N]",
            is_log_x: false,
            series: series(clearances, share, peak),
        },
        Panel {
            x: "removed of the target [%]",
            y: "mean toward [N]",
            is_log_x: false,
            series: series(clearances, share, mean),
        },
    ]
}
