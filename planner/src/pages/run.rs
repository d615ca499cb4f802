//! What was executed beside what was planned: a streamed run's log against its plan.
//!
//! The burr's path and the shaft's axis are computed from the logged joints and from the plan's rows by the arm's kinematics; what
//! the run itself said of its deviation is only repeated: `farthest_off_mm`, over every step and not only those that are logged.
//! Distances are mm in base, times s since the log began.
//!
//! Not here: whether the run may go on; what was removed ([`bonemill_simulate`] replays joints).

use bonemill_planfile::{Gap, Sha256, StoredPlan, Value, least_gaps};
use bonemill_robot::stream::StreamError;
use bonemill_robot::stream::log::{Log, LogRow};
use nalgebra::Vector3;
use rayon::prelude::*;
use thiserror::Error;

/// Phases of a run in which the arm is on the plan.
const ON_PLAN: [&str; 4] = ["run", "hold", "brake", "settle"];
/// Rows before and after the newest target in which the arm's place is looked for.
const WINDOW: [usize; 2] = [250, 50];
/// Places of the burr that count as one where axes are compared, mm.
const SAME_PLACE_MM: f64 = 0.1;

/// No comparison.
#[derive(Debug, Error)]
pub enum RunError {
    /// The log is of another plan, damaged, or none.
    #[error(transparent)]
    Log(#[from] StreamError),
    /// The log names a row that the plan lacks.
    #[error("the log names row {row:.0}: the plan has {rows}")]
    NoSuchRow {
        /// The row.
        row: f64,
        /// Rows of the plan.
        rows: usize,
    },
    /// The run ended before the first target of the plan.
    #[error("the log holds no step on the plan: the run ended before{}", said.as_ref().map_or(String::new(), |s| format!(" ({s})")))]
    NothingExecuted {
        /// Its last event.
        said: Option<String>,
    },
    /// The plan's files cannot be read again.
    #[error(transparent)]
    File(#[from] bonemill_planfile::PlanFileError),
}

/// One logged step on the plan.
#[derive(Debug, Clone, PartialEq)]
pub struct ExecutedStep {
    /// Since the log began, s.
    pub time_s: f64,
    /// The newest target's place, in rows.
    pub row: f64,
    /// Of the burr from its planned path, mm.
    pub off_mm: f64,
    /// How far the burr is behind the newest target, along the path, mm.
    pub behind_mm: f64,
    /// Of the shaft from its planned axis at the nearest place, rad.
    pub axis_rad: f64,
    /// Room between burr and the nearest structure as planned there, less `off_mm`, mm; none in a plan without structures.
    pub room_mm: Option<f64>,
    /// The latest step since the entry before, s.
    pub late_s: f64,
    /// Age of the arm's state, s.
    pub age_s: Option<f64>,
    /// Size of the measured force, N.
    pub force_n: Option<f64>,
    /// Size of the predicted force, N.
    pub predicted_n: f64,
    /// Force toward the structure that the plan names there, measured and predicted, N.
    pub toward_n: Option<(f64, f64)>,
}

/// A run beside its plan.
#[derive(Debug, Clone, PartialEq)]
pub struct RunComparison {
    /// Steps on the plan.
    pub steps: Vec<ExecutedStep>,
    /// What happened, and when, s.
    pub events: Vec<(f64, String)>,
    /// Rows of the plan.
    pub rows: usize,
    /// The last place that the arm reached, in rows.
    pub reached_row: f64,
    /// Planned time to that place, s.
    pub planned_s: f64,
    /// Time on the plan, s.
    pub executed_s: f64,
    /// Farthest of the burr from its path at any step, as the run saw it, mm; none where the log does not say.
    pub farthest_off_mm: Option<f64>,
    /// Smallest room with the structure's name, mm.
    pub least_room: Option<(f64, String)>,
}

impl RunComparison {
    /// Compares the log's text with the plan.
    ///
    /// # Errors
    /// [`RunError`]: a log of another plan, a damaged one, one without a step on the plan.
    pub fn of(plan: &StoredPlan, log: &str) -> Result<Self, RunError> {
        let digest = Sha256::of_file(&plan.dir.join("trajectory.csv"))?;
        let log = Log::read(log)?.of_plan(&digest.to_string())?;
        let rows = plan.trajectory.len();
        let on_plan = |step: &&LogRow| ON_PLAN.contains(&step.phase.as_str()) && step.actual.is_some();
        let logged: Vec<&LogRow> = log.steps.iter().filter(on_plan).collect();
        if let Some(step) = logged.iter().find(|s| !(0.0..rows as f64).contains(&s.row)) {
            return Err(RunError::NoSuchRow { row: step.row, rows });
        }
        let (Some(first), Some(last)) = (logged.first(), logged.last()) else {
            return Err(RunError::NothingExecuted { said: log.events.last().map(|(_, said)| said.clone()) });
        };
        let planned = Planned::new(plan);
        let steps: Vec<ExecutedStep> = logged.par_iter().filter_map(|step| planned.beside(step)).collect();
        let least = steps.iter().zip(&logged).filter_map(|(s, step)| Some((s.room_mm?, step.row)));
        let least = least.min_by(|a, b| a.0.total_cmp(&b.0));
        let reached_row = logged.iter().map(|s| s.reached_row).fold(0.0, f64::max);
        let at_s = |row: f64| plan.trajectory.time_s[(row.max(0.0) as usize).min(rows - 1)];
        Ok(Self {
            least_room: least.map(|(room_mm, row)| (room_mm, planned.structure_at(row))),
            planned_s: at_s(reached_row) - at_s(first.row),
            executed_s: last.time_s - first.time_s,
            farthest_off_mm: log.farthest_off_mm(),
            events: log.events,
            steps,
            rows,
            reached_row,
        })
    }

    /// Names and values of what was found; names end in units.
    pub fn figures(&self) -> Vec<(String, Value)> {
        let spread = |value: &dyn Fn(&ExecutedStep) -> Option<f64>| {
            spread(self.steps.iter().filter_map(value).collect())
        };
        let periods = self.steps.windows(2).map(|pair| 1e3 * (pair[1].time_s - pair[0].time_s)).collect();
        let mut figures = vec![
            ("rows".to_owned(), self.rows.into()),
            ("reached_row".into(), self.reached_row.into()),
            ("planned_s".into(), self.planned_s.into()),
            ("executed_s".into(), self.executed_s.into()),
            ("off_at_entries_mm".into(), spread(&|s| Some(s.off_mm))),
            ("behind_mm".into(), spread(&|s| Some(s.behind_mm))),
            ("axis_mrad".into(), spread(&|s| Some(1e3 * s.axis_rad))),
            ("late_ms".into(), spread(&|s| Some(1e3 * s.late_s))),
            ("state_age_ms".into(), spread(&|s| s.age_s.map(|age_s| 1e3 * age_s))),
            ("between_entries_ms".into(), self::spread(periods)),
        ];
        figures.extend(self.farthest_off_mm.map(|mm| ("farthest_off_mm".into(), mm.into())));
        if let Some((room_mm, structure)) = &self.least_room {
            figures.push(("least_room_mm".into(), (*room_mm).into()));
            figures.push(("least_room_structure".into(), structure.as_str().into()));
        }
        if self.steps.iter().any(|s| s.force_n.is_some()) {
            figures.push(("measured_n".into(), spread(&|s| s.force_n)));
            figures.push(("predicted_n".into(), spread(&|s| s.force_n.map(|_| s.predicted_n))));
            figures.push((
                "toward_measured_less_predicted_n".into(),
                spread(&|s| s.toward_n.map(|(m, p)| m - p)),
            ));
        }
        figures
    }
}

/// Median, 99th percentile and largest of some values.
fn spread(mut values: Vec<f64>) -> Value {
    values.sort_by(f64::total_cmp);
    let at = |share: f64| values.get(((values.len().max(1) - 1) as f64 * share).round() as usize).copied();
    let entries = [("p50", 0.5), ("p99", 0.99), ("max", 1.0)];
    Value::Table(
        entries.iter().filter_map(|(name, share)| Some(((*name).to_owned(), at(*share)?.into()))).collect(),
    )
}

/// What the plan says of every row.
struct Planned<'a> {
    plan: &'a StoredPlan,
    /// Burr's centre in base, mm, and shaft's axis.
    tool: Vec<(Vector3<f64>, Vector3<f64>)>,
    gaps: Vec<Gap>,
}

impl<'a> Planned<'a> {
    fn new(plan: &'a StoredPlan) -> Self {
        let tool =
            (0..plan.trajectory.len()).into_par_iter().map(|row| tool(plan, plan.trajectory.q_at(row)));
        Self { plan, tool: tool.collect(), gaps: least_gaps(plan) }
    }

    /// The waypoint whose move a row belongs to.
    fn waypoint(&self, row: f64) -> usize {
        let time_s = self.plan.trajectory.time_s[(row as usize).min(self.tool.len() - 1)];
        let waypoints = &self.plan.waypoints;
        waypoints.partition_point(|w| w.time_s < time_s).min(waypoints.len().saturating_sub(1))
    }

    fn structure_at(&self, row: f64) -> String {
        let gap = self.gaps.get(self.waypoint(row));
        let structure = gap.and_then(|gap| self.plan.record.case.structures.get(gap.structure));
        structure.map_or_else(String::new, |s| s.name.clone())
    }

    fn beside(&self, step: &LogRow) -> Option<ExecutedStep> {
        let (burr, axis) = tool(self.plan, &step.actual?);
        let newest = step.row as usize;
        let first = newest.saturating_sub(WINDOW[0]);
        let window = self.tool.get(first..(newest + WINDOW[1]).min(self.tool.len()))?;
        let (place, off_mm) = nearest(window, &burr)?;
        let near = window.get(place.round() as usize)?.0;
        // where the burr stands while the shaft turns, any axis of that turn is as planned
        let axes =
            window.iter().filter(|(p, _)| (p - near).norm() < SAME_PLACE_MM).map(|(_, planned)| planned);
        let axis_rad = axes.map(|planned| planned.cross(&axis).norm().atan2(planned.dot(&axis)));
        let waypoint = self.waypoint(step.row);
        let planned = self.plan.waypoints.get(waypoint)?;
        let measured = step.force_n.map(Vector3::from);
        let toward = self.toward(waypoint);
        Some(ExecutedStep {
            time_s: step.time_s,
            row: step.row,
            off_mm,
            behind_mm: way_mm(window, place, step.row - first as f64),
            axis_rad: axis_rad.fold(f64::INFINITY, f64::min),
            room_mm: self.gaps.get(waypoint).map(|gap| gap.gap_mm - off_mm),
            late_s: step.late_s,
            age_s: step.age_s,
            force_n: measured.map(|f| f.norm()),
            predicted_n: planned.force_n.norm(),
            toward_n: measured.zip(toward).map(|(f, (u, predicted_n))| (f.dot(&u), predicted_n)),
        })
    }

    /// Direction, in base, to the structure that the waypoint names, and the predicted force along it, N.
    fn toward(&self, waypoint: usize) -> Option<(Vector3<f64>, f64)> {
        let structure = self.plan.waypoints.get(waypoint)?.structure?;
        let forces = &self.plan.forces;
        let from = forces.partition_point(|f| f.waypoint < waypoint);
        let of_waypoint = forces.get(from..)?.iter().take_while(|f| f.waypoint == waypoint);
        let row = of_waypoint.into_iter().find(|f| f.structure == structure)?;
        Some((self.plan.record.frames.base_from_ct.rotation * row.toward, row.force_toward_n))
    }
}

fn tool(plan: &StoredPlan, q: &[f64]) -> (Vector3<f64>, Vector3<f64>) {
    let pose = plan.arm.tool_at(q);
    (pose.translation_mm, pose.rotation * Vector3::z())
}

/// The nearest place on a polyline, in its points, and how far it is, mm.
fn nearest(path: &[(Vector3<f64>, Vector3<f64>)], burr: &Vector3<f64>) -> Option<(f64, f64)> {
    let alone = path.first().map(|(p, _)| (0.0, (burr - p).norm()));
    let segments = path.windows(2).enumerate().map(|(n, ends)| {
        let (way, off) = (ends[1].0 - ends[0].0, burr - ends[0].0);
        let share =
            if way.norm_squared() > 0.0 { (off.dot(&way) / way.norm_squared()).clamp(0.0, 1.0) } else { 0.0 };
        (n as f64 + share, (off - way * share).norm())
    });
    segments.chain(alone).min_by(|a, b| a.1.total_cmp(&b.1))
}

/// Along a polyline from one place on it to another, mm; below 0 backwards.
fn way_mm(path: &[(Vector3<f64>, Vector3<f64>)], from: f64, to: f64) -> f64 {
    let (low, high) = (from.min(to), from.max(to));
    let pieces = path.windows(2).enumerate().map(|(n, ends)| {
        let n = n as f64;
        let share = (high.min(n + 1.0) - low.max(n)).max(0.0);
        share * (ends[1].0 - ends[0].0).norm()
    });
    pieces.sum::<f64>() * (to - from).signum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line() -> Vec<(Vector3<f64>, Vector3<f64>)> {
        (0..5).map(|n| (Vector3::new(f64::from(n) * 2.0, 0.0, 0.0), Vector3::z())).collect()
    }

    #[test]
    fn place_and_distance_are_those_of_geometry() {
        let (place, off_mm) = nearest(&line(), &Vector3::new(3.0, 0.4, -0.3)).unwrap();
        assert!((place - 1.5).abs() < 1e-12 && (off_mm - 0.5).abs() < 1e-12);
        assert!((way_mm(&line(), 1.5, 3.25) - 3.5).abs() < 1e-12);
        assert!((way_mm(&line(), 3.25, 1.5) + 3.5).abs() < 1e-12);
        assert_eq!(nearest(&line()[..1], &Vector3::new(0.0, 3.0, 4.0)), Some((0.0, 5.0)));
        assert_eq!(nearest(&[], &Vector3::zeros()), None);
    }

    #[test]
    fn quantiles_are_of_the_values_and_none_of_nothing() {
        let Value::Table(found) = spread((0..=100).map(f64::from).collect()) else { panic!("no table") };
        assert_eq!(
            found,
            [("p50", 50.0), ("p99", 99.0), ("max", 100.0)].map(|(k, v)| (k.to_owned(), v.into()))
        );
        assert_eq!(spread(vec![]), Value::Table(vec![]));
    }
}
