//! Why a run ended, what it reports on the way, and what it asks: in the words that the user reads.
//!
//! One cause ends a run: the first that was seen, or, where the arm stopped itself, that. What follows from it is told after it.

use std::fmt;

use crate::stream::link::{Identity, LinkFault};

/// Why an arm was not moved, or was stopped.
#[derive(Debug, Clone, PartialEq)]
pub enum Cause {
    /// What must hold before the first motion does not.
    NotReady(String),
    /// The user declined.
    Declined,
    /// The user stopped it (Ctrl-C, or a signal).
    Interrupted,
    /// The controller is not in its normal safety mode.
    SafetyMode(i32),
    /// The program on the controller no longer runs.
    ProgramStopped,
    /// The controller's clock started again.
    Restarted,
    /// The link failed.
    Link(LinkFault),
    /// The newest state is too old, s.
    Stale {
        /// Its age, s.
        age_s: f64,
    },
    /// The state holds something that no arm says.
    Nonsense(&'static str),
    /// The force sensor no longer says anything.
    SensorLost,
    /// The burr is beside its path, mm.
    OffPath {
        /// By how much, mm.
        off_mm: f64,
        /// What is allowed there, mm.
        most_mm: f64,
    },
    /// The shaft is turned, rad.
    AxisOff {
        /// By how much, rad.
        off_rad: f64,
        /// What is allowed there, rad.
        most_rad: f64,
    },
    /// A joint is too far from what it was told for a stop that does not pass the target.
    JointOff {
        /// The joint, from 1.
        joint: usize,
        /// By how much.
        off: f64,
        /// What is allowed.
        most: f64,
        /// Of both: mrad, or mm where it slides.
        unit: &'static str,
    },
    /// No answer in time.
    NoAnswer {
        /// What was waited for.
        what: &'static str,
        /// How long, s.
        waited_s: f64,
    },
    /// The spindle's output is not as it was ordered.
    Spindle(&'static str),
    /// The log cannot be written.
    Log(String),
    /// The plan's files changed under way.
    PlanChanged(String),
}

/// What safety modes of a UR controller are called.
fn safety_mode_name(mode: i32) -> &'static str {
    match mode {
        1 => "normal",
        2 => "reduced",
        3 => "protective stop",
        4 => "recovery",
        5 => "safeguard stop",
        6 => "system emergency stop",
        7 => "robot emergency stop",
        8 => "violation",
        9 => "fault",
        _ => "unknown",
    }
}

impl fmt::Display for Cause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotReady(why) => f.write_str(why),
            Self::Declined => f.write_str("not confirmed by the user"),
            Self::Interrupted => f.write_str("stopped by the user"),
            Self::SafetyMode(mode) => write!(
                f,
                "the arm's safety mode is {mode} ({}): expected 1 (normal)",
                safety_mode_name(*mode)
            ),
            Self::ProgramStopped => f.write_str(
                "the program on the controller has stopped: by the pendant, its watchdog or another client",
            ),
            Self::Restarted => f.write_str("the controller was restarted: its clock started again"),
            Self::Link(fault) => fault.fmt(f),
            Self::Stale { age_s } => {
                write!(f, "the arm's state is {:.0} ms old: connection or controller lost", 1e3 * age_s)
            }
            Self::Nonsense(what) => write!(f, "the arm's state makes no sense: {what}"),
            Self::SensorLost => {
                f.write_str("the force sensor has fallen silent: it says zeros, as an arm without one does")
            }
            Self::OffPath { off_mm, most_mm } => {
                write!(
                    f,
                    "the tool is {off_mm:.3} mm off its path, at most {most_mm:.3} mm with the clearance left here"
                )
            }
            Self::AxisOff { off_rad, most_rad } => {
                write!(
                    f,
                    "the shaft is turned by {:.2} mrad, at most {:.2} mrad",
                    1e3 * off_rad,
                    1e3 * most_rad
                )
            }
            Self::JointOff { joint, off, most, unit } => {
                write!(f, "joint {joint} is {off:.2} {unit} from what it was told, at most {most:.2} {unit}")
            }
            Self::NoAnswer { what, waited_s } => write!(f, "no answer within {waited_s:.1} s: {what}"),
            Self::Spindle(what) => f.write_str(what),
            Self::Log(why) => write!(f, "the log cannot be written: {why}"),
            Self::PlanChanged(why) => write!(f, "the plan was changed under way: {why}"),
        }
    }
}

/// What a run tells while it goes on.
#[derive(Debug, Clone, PartialEq)]
pub enum Event {
    /// It now does this.
    Stage(&'static str),
    /// The slider is at zero: the arm waits for it.
    Paused,
    /// It goes on at a share of the planned speed, as the slider says.
    SpeedFraction(f64),
    /// No target was sent for a while; the plan's clock stood still meanwhile.
    Gap {
        /// How long, s.
        gap_s: f64,
    },
    /// How far it is, told now and then.
    Progress {
        /// The newest target's place, in rows.
        row: f64,
        /// The plan's last row.
        last_row: f64,
        /// Gaps since it was told last, and the longest, s.
        gaps: (u32, f64),
    },
    /// It goes back a little and waits.
    Hold(String),
    /// It is being stopped for this cause.
    Stopping(Cause),
}

impl fmt::Display for Event {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Stage(stage) => f.write_str(stage),
            Self::Paused => f.write_str("the speed slider is at 0 %: waiting for it"),
            Self::SpeedFraction(share) => {
                write!(f, "the controller runs at {:.0} %: the plan is followed at that speed", 100.0 * share)
            }
            Self::Gap { gap_s } => {
                write!(f, "no target was sent for {:.0} ms: timed anew from there", 1e3 * gap_s)
            }
            Self::Progress { row, last_row, gaps: (count, longest_s) } => {
                write!(f, "row {row:.0} of {last_row:.0}")?;
                if *count > 0 {
                    let ms = 1e3 * longest_s;
                    write!(
                        f,
                        "; {count} times no target was sent for up to {ms:.0} ms (this PC is busy: docs/realtime.md)"
                    )?;
                }
                Ok(())
            }
            Self::Hold(why) => write!(f, "hold: {why}"),
            Self::Stopping(cause) => write!(f, "stopping: {cause}"),
        }
    }
}

/// What the user is asked.
#[derive(Debug, Clone, PartialEq)]
pub enum Question {
    /// Whether the way to the first place is free.
    Approach {
        /// Which arm moves.
        arm: Identity,
        /// Where the burr is, in base, mm.
        from_mm: [f64; 3],
        /// Where it goes, straight, mm.
        to_mm: [f64; 3],
        /// How far, mm.
        length_mm: f64,
        /// How long it takes, s.
        duration_s: f64,
    },
    /// Whether to go on after a hold.
    GoOn(String),
}

impl fmt::Display for Question {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Approach { arm: Identity { model, serial, .. }, from_mm, to_mm, length_mm, duration_s } => {
                write!(
                    f,
                    "The tool of the {model} {serial} moves straight by {length_mm:.1} mm in {duration_s:.1} s, spindle off as its output says, from ({:.1}, {:.1}, {:.1}) to \
                 ({:.1}, {:.1}, {:.1}) mm in the arm's base. Is the way free?",
                    from_mm[0], from_mm[1], from_mm[2], to_mm[0], to_mm[1], to_mm[2]
                )
            }
            Self::GoOn(why) => write!(f, "Held, the spindle's output is seen off: {why}. Go on?"),
        }
    }
}

/// What was seen of the spindle's output at the end of a run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SpindleEnd {
    /// Off by a state that was made after the order; or it was never switched on.
    Off,
    /// On by the newest state.
    On,
    /// It was switched on, and no state says that it is off.
    Unseen {
        /// Age of the newest state, s.
        age_s: f64,
    },
}

impl fmt::Display for SpindleEnd {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Off => f.write_str("the spindle's output is seen off"),
            Self::On => {
                f.write_str("the spindle's output is seen ON: it turns; switch it off by its own switch")
            }
            Self::Unseen { age_s } => write!(
                f,
                "the spindle's output was not seen off: the controller's last state is {age_s:.1} s old; it may still turn: switch it off by its \
                 own switch"
            ),
        }
    }
}

/// How a run ended.
#[derive(Debug, Clone, PartialEq)]
pub struct RunEnd {
    /// Why it was stopped; none where it came to the end.
    pub cause: Option<Cause>,
    /// Whether the arm was seen at rest; if not, it may still move.
    pub at_rest: bool,
    /// What was seen of the spindle's output.
    pub spindle: SpindleEnd,
    /// The place reached by the arm, in rows.
    pub reached_row: f64,
    /// Rows of the plan, the last of which is row `rows` − 1.
    pub rows: usize,
    /// Time since the first target of the plan, s.
    pub seconds: f64,
    /// Targets of the plan that were sent.
    pub targets: u64,
    /// Targets that were more than a period late.
    pub late_targets: u64,
    /// The latest, s.
    pub latest_s: f64,
    /// Farthest of the burr from its path at any step, on the way to its start too, mm.
    pub farthest_off_mm: f64,
}

impl fmt::Display for RunEnd {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.cause {
            None => write!(f, "done: {} rows in {:.1} s", self.rows, self.seconds)?,
            Some(cause) => {
                write!(f, "row {:.0} of {}: {cause}", self.reached_row, self.rows.saturating_sub(1))?
            }
        }
        if !self.at_rest {
            f.write_str("\n  the arm was not seen at rest: it may still move")?;
        }
        if self.spindle != SpindleEnd::Off {
            write!(f, "\n  {}", self.spindle)?;
        }
        Ok(())
    }
}
