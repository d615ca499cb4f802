//! Streaming for Python: a plan's values into the core, and the core's loop over callbacks of a link and an operator.
//!
//! The loop runs here, so that Python only answers: a link's `state()` and `order(…)`, an operator's `tell`, `ask`, `answer` and `interrupted`.
//! None of them may block. Signals are looked for at every step, so that Ctrl-C is heard within one; while the loop sleeps,
//! other Python threads run.

use std::fs::{File, OpenOptions};
use std::io::Write;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::thread;
use std::time::{Duration, Instant, SystemTime};

use bonemill_planner::plan::{Need, StoredPlan};
use bonemill_planner::stream_input;
use bonemill_robot::stream::bound::{self, Failure};
use bonemill_robot::stream::simulated::rehearse::rehearse;
use bonemill_robot::stream::{
    ArmLink, ArmState, Aside, Cause, Clock, Event, Identity, LinkFault, Log, LogWriter, Operator, Order,
    Question, RunEnd, Session, Settings, SpindleEnd, StreamPlan as CorePlan, StreamTiming, drive,
};
use nalgebra::Vector3;
use pyo3::prelude::*;

use crate::apart;
use crate::errors::{self, StreamError, words};

/// Steps of a rehearsal between two looks for signals.
const LOOK_FOR_SIGNALS: u32 = 100;

/// A plan that can be streamed.
#[pyclass(frozen)]
pub struct StreamPlan {
    plan: CorePlan,
    dir: PathBuf,
}

/// What failed; the burr's largest travel along its path, mm, and the row; the same beside its path.
type WorstTravel = (&'static str, (f64, usize), (f64, usize));

/// What a run came to: why it ended (none: done), at rest, spindle off, reached row, rows, s, targets, late targets, latest s, farthest mm.
type Ended = (Option<String>, bool, bool, f64, usize, f64, u64, u64, f64, f64);

#[pymethods]
impl StreamPlan {
    /// Reads and checks the plan in a folder.
    #[staticmethod]
    #[pyo3(signature = (dir, *, slow, unverified, payload_kg, serial, run_up_s, lookahead_s, gain))]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments of a Python function")]
    fn load(
        py: Python<'_>,
        dir: PathBuf,
        slow: bool,
        unverified: bool,
        payload_kg: Option<f64>,
        serial: Option<String>,
        run_up_s: f64,
        lookahead_s: f64,
        gain: f64,
    ) -> PyResult<Self> {
        let timing = StreamTiming::of_servo(lookahead_s, gain).map_err(|e| refused(&e))?;
        let settings =
            Settings { slow, unverified, payload_kg, serial, run_up_s, timing, ..Settings::default() };
        let read = move |_: &dyn bonemill_planner::Progress| -> PyResult<Self> {
            let stored = StoredPlan::load_with(&dir, None, Need::Unchanged).map_err(|e| errors::file(&e))?;
            let plan = CorePlan::new(stream_input(&stored).map_err(|e| errors::file(&e))?, settings)
                .map_err(|e| refused(&e))?;
            Ok(Self { plan, dir })
        };
        apart::run(py, None, None, read)?
    }

    /// Refuses an arm that no controller here moves.
    fn for_a_ur(&self) -> PyResult<()> {
        self.plan.for_a_ur().map_err(|e| refused(&e))
    }

    /// Why no run of the plan is begun, whatever arm is there, in words.
    fn refusal(&self, py: Python<'_>) -> Option<String> {
        py.detach(|| self.plan.ready().err())
    }

    /// Rows of the trajectory.
    fn rows(&self) -> usize {
        self.plan.track.rows()
    }

    /// Time between rows, s.
    fn period_s(&self) -> f64 {
        self.plan.period_s
    }

    /// Time at the speed that is allowed in every row, s.
    fn duration_s(&self) -> f64 {
        let slowed = self.plan.rate.iter().map(|rate| self.plan.period_s / rate.max(1e-3));
        slowed.sum()
    }

    /// Joint positions of a row, rad or mm; 0 beyond the arm's.
    fn joints(&self, row: f64) -> [f64; 6] {
        self.plan.track.joints(row)
    }

    /// The smallest share of the planned speed at which a row may be passed, and the row.
    fn slowest(&self) -> (f64, usize) {
        let rates = self.plan.rate.iter().copied().enumerate();
        rates.fold((1.0, 0), |least, (row, rate)| if rate < least.0 { (rate, row) } else { least })
    }

    /// What the burr can travel after each kind of failure, at the allowed speeds: what failed, mm along its path and the row, mm off
    /// it and the row.
    fn bounds(&self, py: Python<'_>) -> Vec<WorstTravel> {
        py.detach(|| Failure::ALL.map(|failure| worst(&self.plan, failure)).to_vec())
    }

    /// The least room between the burr's surface and a structure, mm, and the row.
    fn least_gap(&self) -> (f64, usize) {
        let gaps = self.plan.gap_mm.iter().copied().enumerate();
        gaps.fold((f64::INFINITY, 0), |least, (row, gap)| if gap < least.0 { (gap, row) } else { least })
    }

    /// The row at which a run of this plan that has this log goes on.
    fn resume_row(&self, log: PathBuf) -> PyResult<f64> {
        let text = std::fs::read_to_string(&log)
            .map_err(|e| StreamError::new_err(format!("cannot read {}: {e}", log.display())))?;
        let row =
            Log::read(&text).and_then(|log| log.of_plan(&self.plan.digest)).and_then(|log| log.last_row());
        let row = row.map_err(|e| StreamError::new_err(format!("{}: {}", log.display(), words(&e))))?;
        Ok(self.plan.resume_row(row))
    }

    /// Runs it from a row over a link, and writes its log.
    #[expect(clippy::too_many_arguments, reason = "arguments of a Python function")]
    fn run(
        &self,
        py: Python<'_>,
        start_row: f64,
        link: Py<PyAny>,
        operator: Py<PyAny>,
        log: Option<PathBuf>,
    ) -> PyResult<Ended> {
        self.for_a_ur()?;
        let path = log;
        let mut log = path.as_ref().map(|path| self.log(path, Aside::new)).transpose()?;
        let mut clock = PcClock { py, began: Instant::now() };
        let mut link = PyLink { py, link, began: clock.began, failed: None };
        let look_s = self.plan.settings().timing.transport_s;
        let watched = FileWatch::new(&self.dir, path, Duration::from_secs_f64(look_s))?;
        let mut operator = PyOperator { py, operator, watched, stopped: false, failed: None };
        let mut session = Session::new(&self.plan, start_row, clock.now_s());
        let outcome = drive(&mut session, &mut link, &mut clock, &mut operator, log.as_mut());
        let mut ended = ended(&outcome);
        let written = py.detach(|| log.map_or(Ok(()), |log| log.into_inner().finish()));
        if let (None, Err(error)) = (&ended.0, written) {
            ended.0 = Some(format!("{outcome}\n  the log's end was not written: {error}"));
        }
        operator.failed.map_or_else(|| Ok(ended), Err)
    }

    /// The whole run on a simulated arm in simulated time.
    fn rehearse(&self, py: Python<'_>, seed: u64, log: Option<PathBuf>) -> PyResult<Ended> {
        let mut log = log.map(|path| self.log(&path, Ok)).transpose()?;
        let mut user = Rehearsing::default();
        let outcome = py.detach(|| rehearse(&self.plan, 0.0, seed, &mut user, log.as_mut()));
        user.raised.map_or_else(|| Ok(ended(&outcome)), Err)
    }
}

impl StreamPlan {
    /// A new log; one that stands there is not written over.
    fn log<W: Write>(
        &self,
        path: &Path,
        through: impl FnOnce(File) -> std::io::Result<W>,
    ) -> PyResult<LogWriter<W>> {
        let cannot = |e: std::io::Error| {
            StreamError::new_err(format!("cannot write the log {}\n  because: {e}", path.display()))
        };
        let file = OpenOptions::new().append(true).create_new(true).open(path).map_err(cannot)?;
        let out = through(file).map_err(cannot)?;
        LogWriter::new(out, &self.plan.digest, self.plan.track.rows(), self.plan.period_s).map_err(cannot)
    }
}

fn refused(error: &dyn std::error::Error) -> PyErr {
    StreamError::new_err(words(error))
}

fn worst(plan: &CorePlan, failure: Failure) -> (&'static str, (f64, usize), (f64, usize)) {
    let mut found = (failure.about(), (0.0, 0), (0.0, 0));
    for row in (0..plan.track.rows()).step_by(5) {
        let along_mm = bound::along_mm(plan, row, plan.rate[row], failure);
        if along_mm > found.1.0 {
            found.1 = (along_mm, row);
        }
        if plan.off_mm[row] > found.2.0 {
            found.2 = (plan.off_mm[row], row);
        }
    }
    found
}

fn ended(outcome: &RunEnd) -> Ended {
    let is_off = outcome.spindle == SpindleEnd::Off;
    (
        (outcome.cause.is_some() || !outcome.at_rest || !is_off).then(|| outcome.to_string()),
        outcome.at_rest,
        is_off,
        outcome.reached_row,
        outcome.rows,
        outcome.seconds,
        outcome.targets,
        outcome.late_targets,
        outcome.latest_s,
        outcome.farthest_off_mm,
    )
}

/// The PC's monotonic clock, from the moment that it was made; Python runs while it sleeps.
struct PcClock<'py> {
    py: Python<'py>,
    began: Instant,
}

impl Clock for PcClock<'_> {
    fn now_s(&mut self) -> f64 {
        self.began.elapsed().as_secs_f64()
    }

    fn sleep_until_s(&mut self, wake_s: f64) {
        let wait_s = wake_s - self.now_s();
        if wait_s > 0.0 {
            self.py.detach(|| thread::sleep(Duration::from_secs_f64(wait_s)));
        }
    }
}

/// What `link.state()` gives: age of its receipt, s; controller's clock, s; joints, rad; tool's place, mm, and turn, rad; force, N;
/// safety mode; runtime state; speed fraction; payload, kg; robot mode, whether in freedrive, whether the spindle's output is on.
type StateTuple =
    (f64, f64, [f64; 6], ([f64; 3], [f64; 3]), Option<[f64; 3]>, i32, u32, f64, f64, (i32, bool, bool));

/// A link in Python: `state() -> tuple | None`, `fault() -> str | None`, `order(word, values)`,
/// `identity() -> (model, serial, in local control) | None`, `waiting() -> int`. What it raises is the link's fault.
struct PyLink<'py> {
    py: Python<'py>,
    link: Py<PyAny>,
    began: Instant,
    failed: Option<LinkFault>,
}

impl PyLink<'_> {
    fn raised(&mut self, error: &PyErr) {
        self.fail(error.value(self.py).to_string());
    }

    /// The first of what goes wrong is the cause.
    fn fail(&mut self, said: String) {
        let fault = match said.as_str() {
            "watchdog" => LinkFault::Watchdog,
            "target" => LinkFault::NotTaken("a target"),
            "stop" => LinkFault::NotTaken("the stop"),
            "spindle" => LinkFault::NotTaken("the spindle's output"),
            _ => match said.strip_prefix("start: ") {
                Some(why) => LinkFault::NotStarted(why.to_owned()),
                None => LinkFault::Closed(said),
            },
        };
        self.failed.get_or_insert(fault);
    }
}

impl ArmLink for PyLink<'_> {
    fn state(&mut self) -> Option<ArmState> {
        let found = self.link.call_method0(self.py, "state");
        let found = found.and_then(|state| state.extract::<Option<StateTuple>>(self.py));
        let state = found.unwrap_or_else(|error| {
            self.raised(&error);
            None
        });
        let now_s = self.began.elapsed().as_secs_f64();
        state.map(|(age_s, controller_s, q, tool_pose, force_n, safety, runtime, fraction, kg, more)| {
            ArmState {
                received_s: now_s - age_s,
                controller_s,
                q,
                tool_pose,
                force_n: force_n.map(Vector3::from),
                safety_mode: safety,
                robot_mode: more.0,
                freedrive: more.1,
                spindle_on: more.2,
                runtime_state: runtime,
                speed_fraction: fraction,
                payload_kg: kg,
            }
        })
    }

    fn fault(&mut self) -> Option<LinkFault> {
        let found = self.link.call_method0(self.py, "fault");
        match found.and_then(|said| said.extract::<Option<String>>(self.py)) {
            Ok(Some(said)) => self.fail(said),
            Ok(None) => {}
            Err(error) => self.raised(&error),
        }
        self.failed.clone()
    }

    fn order(&mut self, order: &Order) {
        let (word, values): (&str, Vec<f64>) = match order {
            Order::Start => ("start", vec![]),
            Order::Target(q) => ("target", q.to_vec()),
            Order::Stop => ("stop", vec![]),
            Order::Spindle(on) => ("spindle", vec![f64::from(u8::from(*on))]),
            Order::End => ("end", vec![]),
        };
        if let Err(error) = self.link.call_method1(self.py, "order", (word, values)) {
            self.raised(&error);
        }
    }

    fn identity(&self) -> Option<Identity> {
        let found = self.link.call_method0(self.py, "identity").ok()?;
        let (model, serial, is_local) = found.extract::<Option<(String, String, bool)>>(self.py).ok()??;
        Some(Identity { model, serial, is_local })
    }

    /// A link that does not tell has lost an answer: as many as never pass.
    fn waiting(&self) -> usize {
        let found = self.link.call_method0(self.py, "waiting").and_then(|n| n.extract(self.py));
        found.unwrap_or(usize::MAX)
    }
}

/// An operator in Python, the user's signals, and the plan's files.
struct PyOperator<'py> {
    py: Python<'py>,
    operator: Py<PyAny>,
    watched: FileWatch,
    stopped: bool,
    /// What went wrong in the operator itself, told after the arm was stopped.
    failed: Option<PyErr>,
}

impl PyOperator<'_> {
    fn call(&mut self, method: &str, text: String) {
        if let Err(error) = self.operator.call_method1(self.py, method, (text,)) {
            self.failed.get_or_insert(error);
        }
    }
}

impl Operator for PyOperator<'_> {
    fn tell(&mut self, event: &Event) {
        // gaps stand in the log, and are told together now and then
        if !matches!(event, Event::Gap { .. }) {
            self.call("tell", event.to_string());
        }
    }

    fn ask(&mut self, question: &Question) {
        self.call("ask", question.to_string());
    }

    fn answer(&mut self) -> Option<bool> {
        let found = self.operator.call_method0(self.py, "answer").and_then(|a| a.extract(self.py));
        found.unwrap_or_else(|error| {
            self.failed.get_or_insert(error);
            None
        })
    }

    fn stop(&mut self) -> Option<Cause> {
        if self.stopped {
            return None;
        }
        // the package's signal handlers only take a note, so that no signal ends a call of the link halfway
        let heard = self.py.check_signals();
        let heard = heard.and_then(|()| self.operator.call_method0(self.py, "interrupted")?.extract(self.py));
        let cause = match heard {
            Ok(false) if self.failed.is_none() => self.watched.changed(),
            Ok(_) => Some(Cause::Interrupted),
            Err(error) => {
                self.failed.get_or_insert(error);
                Some(Cause::Interrupted)
            }
        };
        self.stopped = cause.is_some();
        cause
    }
}

/// The plan's files as they were when the run began, and the log's name, looked at by a thread of its own: a disk may not answer.
/// It looks as often as a state takes on its way here, so that a change is seen as early as a tolerance that is left: the bound counts that time.
struct FileWatch {
    changed: Receiver<Cause>,
    /// The thread ends when it is dropped.
    _wanted: Sender<()>,
}

impl FileWatch {
    fn new(dir: &Path, log: Option<PathBuf>, every: Duration) -> PyResult<Self> {
        let names = ["plan.toml", "trajectory.csv", "waypoints.csv", "forces.csv", "robot.urdf"];
        let files = names.map(|name| dir.join(name)).map(|path| (path.clone(), stamp(&path)));
        let log = log.map(|path| (path.clone(), file_of(&path)));
        let changed_now = move || {
            if let Some((path, _)) = files.iter().find(|(path, before)| stamp(path) != *before) {
                return Some(Cause::PlanChanged(path.display().to_string()));
            }
            let (path, _) = log.as_ref().filter(|(path, before)| file_of(path) != *before)?;
            let gone =
                "its file or folder was renamed or deleted under way; without it no run goes on from here";
            Some(Cause::Log(format!("{} is gone: {gone}", path.display())))
        };
        let (found, changed) = mpsc::channel();
        let (wanted, is_wanted) = mpsc::channel::<()>();
        thread::Builder::new().name("files".to_owned()).spawn(move || {
            while is_wanted.recv_timeout(every) == Err(RecvTimeoutError::Timeout) {
                if let Some(cause) = changed_now() {
                    // nobody listens once the run is over
                    let _ = found.send(cause);
                    return;
                }
            }
        })?;
        Ok(Self { changed, _wanted: wanted })
    }

    /// The first that was seen to be another.
    fn changed(&self) -> Option<Cause> {
        self.changed.try_recv().ok()
    }
}

/// Which file a name stands for: device and number.
fn file_of(path: &Path) -> Option<(u64, u64)> {
    let found = std::fs::metadata(path).ok()?;
    Some((found.dev(), found.ino()))
}

fn stamp(path: &Path) -> Option<(u64, SystemTime)> {
    let found = std::fs::metadata(path).ok()?;
    Some((found.len(), found.modified().ok()?))
}

/// Says yes to everything, and stops for a signal.
#[derive(Default)]
struct Rehearsing {
    asked: bool,
    steps: u32,
    raised: Option<PyErr>,
}

impl Operator for Rehearsing {
    fn tell(&mut self, _: &Event) {}

    fn ask(&mut self, _: &Question) {
        self.asked = true;
    }

    fn answer(&mut self) -> Option<bool> {
        std::mem::take(&mut self.asked).then_some(true)
    }

    fn stop(&mut self) -> Option<Cause> {
        self.steps += 1;
        if self.raised.is_none() && self.steps.is_multiple_of(LOOK_FOR_SIGNALS) {
            self.raised = Python::attach(|py| py.check_signals()).err();
        }
        self.raised.as_ref().map(|_| Cause::Interrupted)
    }
}
