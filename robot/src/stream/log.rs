//! The log of a run: lines that survive a kill as far as the writer has them. Written to what it is handed, read back from text.
//!
//! The first line names the plan, then one line a logged step or event; each ends in the CRC-32 of what stands before it. A last line
//! that was cut off is left out, damage anywhere else is an error. Times are s on the PC's clock since the log began, joints rad,
//! forces N in base.

mod aside;

use std::fmt::Write as _;
use std::io::{self, Write};

use crate::stream::error::StreamError;
use crate::stream::link::Joints;
use crate::stream::session::{Decision, Seen, Session};

pub use aside::Aside;

/// First words of a log.
const HEAD: &str = "bonemill-run,1";
/// A line is written every so many steps, and whenever something happens.
const EVERY: u32 = 5;

/// The columns of a row after its tag.
pub const COLUMNS: &str = "time_s,phase,row,rate,reached_row,off_mm,axis_rad,age_s,late_s,controller_s,safety_mode,runtime_state,\
speed_fraction,fx_n,fy_n,fz_n,c1,c2,c3,c4,c5,c6,q1,q2,q3,q4,q5,q6";

/// Writes a log.
#[derive(Debug)]
pub struct LogWriter<W: Write> {
    out: W,
    began_s: Option<f64>,
    steps: u32,
    late_s: f64,
    off_mm: Option<f64>,
    wake_s: Option<f64>,
    phase: &'static str,
}

impl<W: Write> LogWriter<W> {
    /// A log of a run of the plan with this digest, rows and period.
    ///
    /// # Errors
    /// What the writer says.
    pub fn new(out: W, digest: &str, rows: usize, period_s: f64) -> io::Result<Self> {
        let mut log =
            Self { out, began_s: None, steps: 0, late_s: 0.0, off_mm: None, wake_s: None, phase: "" };
        log.line(&format!("{HEAD},{digest},{rows},{period_s:?}"))?;
        log.line(&format!("C,{COLUMNS}"))?;
        Ok(log)
    }

    /// What it writes to.
    pub fn into_inner(self) -> W {
        self.out
    }

    fn line(&mut self, text: &str) -> io::Result<()> {
        let line = format!("{text},{:08x}\n", crc32fast::hash(text.as_bytes()));
        self.out.write_all(line.as_bytes())?;
        self.out.flush()
    }

    /// Logs what a step saw and did.
    ///
    /// # Errors
    /// What the writer says.
    pub fn step(&mut self, session: &Session<'_>, seen: &Seen, step: &Decision) -> io::Result<()> {
        let time_s = seen.now_s - *self.began_s.get_or_insert(seen.now_s);
        self.late_s = self.late_s.max(self.wake_s.map_or(0.0, |wake_s| seen.now_s - wake_s));
        let off_mm = session.deviation().map(|d| d.off_mm);
        self.off_mm = self.off_mm.into_iter().chain(off_mm).reduce(f64::max);
        self.wake_s = Some(step.wake_s);
        self.steps += 1;
        let phase = session.phase();
        let changed = phase != self.phase || step.outcome.is_some() || !step.events.is_empty();
        if changed || self.steps >= EVERY {
            self.row(session, seen, time_s, phase)?;
            (self.steps, self.late_s, self.off_mm, self.phase) = (0, 0.0, None, phase);
        }
        for event in &step.events {
            self.line(&format!("E,{time_s:.6},{}", one_line(&event.to_string())))?;
        }
        if let Some(question) = &step.question {
            self.line(&format!("E,{time_s:.6},asked: {}", one_line(&question.to_string())))?;
        }
        if let Some(outcome) = &step.outcome {
            self.line(&format!("E,{time_s:.6},ended: {}", one_line(&outcome.to_string())))?;
        }
        Ok(())
    }

    fn row(&mut self, session: &Session<'_>, seen: &Seen, time_s: f64, phase: &str) -> io::Result<()> {
        let (row, rate) = session.place();
        let mut text = format!("R,{time_s:.6},{phase},{row:.4},{rate:.4},");
        let age_s = session.age_s(seen.now_s);
        let deviation = session.deviation();
        number(&mut text, Some(session.reached_row()), 4);
        number(&mut text, self.off_mm, 5);
        number(&mut text, deviation.map(|d| d.axis_rad), 7);
        number(&mut text, age_s.is_finite().then_some(age_s), 5);
        number(&mut text, Some(self.late_s), 5);
        let state = session.state();
        number(&mut text, state.map(|s| s.controller_s), 6);
        number(&mut text, state.map(|s| f64::from(s.safety_mode)), 0);
        number(&mut text, state.map(|s| f64::from(s.runtime_state)), 0);
        number(&mut text, state.map(|s| s.speed_fraction), 4);
        for axis in 0..3 {
            number(&mut text, state.and_then(|s| s.force_n).map(|f| f[axis]), 4);
        }
        for joint in 0..6 {
            number(&mut text, session.commanded().map(|q| q[joint]), 7);
        }
        for joint in 0..6 {
            number(&mut text, state.map(|s| s.q[joint]), 7);
        }
        text.pop();
        self.line(&text)
    }
}

/// A cell and its comma; empty where there is no value.
fn number(text: &mut String, value: Option<f64>, digits: usize) {
    if let Some(value) = value {
        // writing to a String cannot fail
        let _ = write!(text, "{value:.digits$}");
    }
    text.push(',');
}

fn one_line(text: &str) -> String {
    text.replace(['\n', '\r'], " ")
}

/// A logged step.
#[derive(Debug, Clone, PartialEq)]
pub struct LogRow {
    /// Since the log began, s.
    pub time_s: f64,
    /// What the run did, as [`Session::phase`] says.
    pub phase: String,
    /// The newest target's place, in rows; of the approach's own rows while `phase` is `approach`.
    pub row: f64,
    /// Share of the planned speed.
    pub rate: f64,
    /// The arm's place on the plan, in rows.
    pub reached_row: f64,
    /// Farthest of the burr from its path since the row before, mm.
    pub off_mm: Option<f64>,
    /// Of the shaft from its planned axis, rad.
    pub axis_rad: Option<f64>,
    /// Age of the newest state, s.
    pub age_s: Option<f64>,
    /// The latest step since the row before, s.
    pub late_s: f64,
    /// The controller's clock, s.
    pub controller_s: Option<f64>,
    /// Safety mode, runtime state and speed fraction, once there was a state.
    pub mode: Option<(i32, u32, f64)>,
    /// Force in base, N.
    pub force_n: Option<[f64; 3]>,
    /// The newest target, rad.
    pub commanded: Option<Joints>,
    /// Where the arm was, rad.
    pub actual: Option<Joints>,
}

/// A log, read back.
#[derive(Debug, Clone, PartialEq)]
pub struct Log {
    /// Digest of the plan.
    pub digest: String,
    /// Rows of the plan.
    pub rows: usize,
    /// Time between rows, s.
    pub period_s: f64,
    /// Logged steps.
    pub steps: Vec<LogRow>,
    /// What happened, and when, s.
    pub events: Vec<(f64, String)>,
}

impl Log {
    /// Reads a log; a last line that was cut off is left out.
    ///
    /// # Errors
    /// [`StreamError::Log`] naming the line: no head, a damaged line, a cell that is none.
    pub fn read(text: &str) -> Result<Self, StreamError> {
        let head = text.split_inclusive('\n').next().unwrap_or("");
        let mut log = Self::head(checked(head, 1)?)?;
        for (n, line) in text.split_inclusive('\n').enumerate().skip(1) {
            let last = !line.ends_with('\n');
            match checked(line, n + 1) {
                Ok(line) => log.take(line, n + 1)?,
                Err(_) if last => break,
                Err(error) => return Err(error),
            }
        }
        Ok(log)
    }

    /// Farthest of the burr from its path at any step of the run, mm, as [`RunEnd`](crate::stream::RunEnd) says it; none before there was a state.
    pub fn farthest_off_mm(&self) -> Option<f64> {
        self.steps.iter().filter_map(|step| step.off_mm).reduce(f64::max)
    }

    /// The last place that was reached; [`StreamPlan::resume_row`](crate::stream::StreamPlan::resume_row) says where to go on.
    ///
    /// # Errors
    /// [`StreamError::NoStep`] of a log with its head only.
    pub fn last_row(&self) -> Result<f64, StreamError> {
        self.steps.last().map(|step| step.reached_row).ok_or(StreamError::NoStep)
    }

    /// This log if it is of the plan with this digest.
    ///
    /// # Errors
    /// [`StreamError::OtherPlan`].
    pub fn of_plan(self, digest: &str) -> Result<Self, StreamError> {
        if self.digest == digest {
            return Ok(self);
        }
        Err(StreamError::OtherPlan { found: self.digest, expected: digest.to_owned() })
    }

    fn head(text: &str) -> Result<Self, StreamError> {
        let wrong = || refuse(1, text, format!("{HEAD},DIGEST,ROWS,PERIOD"));
        let rest = text.strip_prefix(HEAD).and_then(|rest| rest.strip_prefix(',')).ok_or_else(wrong)?;
        let cells: Vec<&str> = rest.split(',').collect();
        let [digest, rows, period_s] = cells[..] else { return Err(wrong()) };
        let rows = rows.parse().map_err(|_| wrong())?;
        let period_s = period_s.parse().ok().filter(|p: &f64| *p > 0.0).ok_or_else(wrong)?;
        Ok(Self { digest: digest.to_owned(), rows, period_s, steps: vec![], events: vec![] })
    }

    fn take(&mut self, text: &str, line: usize) -> Result<(), StreamError> {
        if let Some(cells) = text.strip_prefix("R,") {
            let row = row(cells).ok_or_else(|| refuse(line, text, COLUMNS.to_owned()))?;
            self.steps.push(row);
        } else if let Some((time_s, said)) = text.strip_prefix("E,").and_then(|rest| rest.split_once(',')) {
            let time_s = time_s.parse().map_err(|_| refuse(line, text, "a time, s".to_owned()))?;
            self.events.push((time_s, said.to_owned()));
        } else if !text.starts_with("C,") {
            return Err(refuse(line, text, "a line that begins with R, E or C".to_owned()));
        }
        Ok(())
    }
}

fn refuse(line: usize, found: &str, expected: String) -> StreamError {
    let found: String = found.chars().take(60).collect();
    StreamError::Log { line, found: format!("{found:?}"), expected }
}

/// A line without its checksum, which holds.
fn checked(line: &str, n: usize) -> Result<&str, StreamError> {
    let parts = line.strip_suffix('\n').and_then(|line| line.rsplit_once(','));
    let good = parts.filter(|(text, sum)| *sum == format!("{:08x}", crc32fast::hash(text.as_bytes())));
    good.map(|(text, _)| text).ok_or_else(|| refuse(n, line, "a line that ends in its CRC-32".to_owned()))
}

fn row(text: &str) -> Option<LogRow> {
    let cells: Vec<&str> = text.split(',').collect();
    if cells.len() != COLUMNS.split(',').count() {
        return None;
    }
    let optional = |n: usize| -> Option<Option<f64>> {
        if cells[n].is_empty() { Some(None) } else { cells[n].parse().ok().map(Some) }
    };
    let number = |n: usize| optional(n)?;
    let six = |from: usize| -> Option<Joints> {
        let mut q = [0.0; 6];
        for (j, q) in q.iter_mut().enumerate() {
            *q = number(from + j)?;
        }
        Some(q)
    };
    let mode = || Some((cells[10].parse().ok()?, cells[11].parse().ok()?, number(12)?));
    Some(LogRow {
        time_s: number(0)?,
        phase: cells[1].to_owned(),
        row: number(2)?,
        rate: number(3)?,
        reached_row: number(4)?,
        off_mm: optional(5)?,
        axis_rad: optional(6)?,
        age_s: optional(7)?,
        late_s: number(8)?,
        controller_s: optional(9)?,
        mode: mode(),
        force_n: number(13).zip(number(14)).zip(number(15)).map(|((x, y), z)| [x, y, z]),
        commanded: six(16),
        actual: six(22),
    })
}
