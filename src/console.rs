//! Shows progress, as a bar on a terminal and as plain lines elsewhere, and measures the seconds of every stage.
//!
//! Bar and time left follow from how long the job's stages typically take relative to each other.

use std::cell::RefCell;
use std::fmt;
use std::io::{IsTerminal, stderr};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use bonemill_geometry::{JobPosition, Stage};
use bonemill_planner::Progress;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};

use crate::args::Talk;

/// The bar's length.
const WHOLE: u64 = 1000;
/// The time left is shown once a job has run this long and this share of it is done; before, it says little.
const SETTLED: Duration = Duration::from_secs(2);
const SETTLED_SHARE: f64 = 0.05;

/// Shows progress on stderr and measures time.
pub struct Console {
    show: Show,
    stages: RefCell<Stages>,
}

enum Show {
    Nothing,
    Lines,
    Bar(ProgressBar),
}

#[derive(Default)]
struct Stages {
    done: Vec<(String, f64)>,
    current: Option<(String, Instant)>,
    position: JobPosition,
    began: Option<Instant>,
    /// The share of the job that was done when the time left was last estimated.
    share: f64,
    /// When the job will have ended by that estimate.
    ends: Arc<Mutex<Option<Instant>>>,
    memory_mb: Option<f64>,
}

impl Stages {
    /// Estimates when the job ends, each time that more of it is done.
    fn estimate(&mut self) {
        let since = |began: Option<Instant>| began.map_or(Duration::ZERO, |began| began.elapsed());
        let so_far = since(self.began);
        if self.position.share() <= self.share || so_far < SETTLED || self.position.share() < SETTLED_SHARE {
            return;
        }
        self.share = self.position.share();
        let stage = since(self.current.as_ref().map(|(_, since)| *since));
        let left_s = self.position.left_s(so_far.as_secs_f64(), stage.as_secs_f64());
        let left = left_s.and_then(|left_s| Duration::try_from_secs_f64(left_s).ok());
        let ends = left.and_then(|left| Instant::now().checked_add(left));
        *self.ends.lock().unwrap_or_else(PoisonError::into_inner) = ends;
    }

    fn end(&mut self) {
        if let Some((name, since)) = self.current.take() {
            self.done.push((name, since.elapsed().as_secs_f64()));
        }
    }
}

impl Console {
    pub fn new(talk: Talk) -> Self {
        let stages = Stages::default();
        let show = match talk {
            Talk::Quiet | Talk::Machine => Show::Nothing,
            Talk::People if stderr().is_terminal() => {
                Show::Bar(bar(ProgressDrawTarget::stderr(), Arc::clone(&stages.ends)))
            }
            Talk::People => Show::Lines,
        };
        Self { show, stages: RefCell::new(stages) }
    }

    /// Ends the last stage and clears the bar.
    pub fn finish(&self) {
        self.stages.borrow_mut().end();
        if let Show::Bar(bar) = &self.show {
            bar.finish_and_clear();
        }
    }

    /// Estimated memory of the work, MB.
    pub fn memory_mb_estimated(&self) -> Option<f64> {
        self.stages.borrow().memory_mb
    }

    /// Wall-clock seconds of every stage, in order.
    pub fn seconds(&self) -> Vec<(String, f64)> {
        self.stages.borrow().done.clone()
    }

    /// Draws the bar where the job is.
    fn draw(&self, stages: &mut Stages) {
        let Show::Bar(bar) = &self.show else { return };
        stages.estimate();
        let name = stages.current.as_ref().map_or("", |(name, _)| name);
        bar.set_message(match stages.position.stage() {
            Some((n, of)) => format!("stage {n} of {of}: {name}"),
            None => name.to_owned(),
        });
        bar.set_position((WHOLE as f64 * stages.position.share()) as u64);
    }
}

fn bar(target: ProgressDrawTarget, ends: Arc<Mutex<Option<Instant>>>) -> ProgressBar {
    let left = move |_: &ProgressState, out: &mut dyn fmt::Write| {
        let ends = *ends.lock().unwrap_or_else(PoisonError::into_inner);
        // what cannot be written is not shown
        let _ = out.write_str(&time_left(ends, Instant::now()));
    };
    let bar = ProgressBar::with_draw_target(Some(WHOLE), target);
    // without a valid template the default style is used
    if let Ok(style) = ProgressStyle::with_template("{spinner} [{bar:30}] {elapsed} so far, {msg}{left}") {
        bar.set_style(style.progress_chars("=> ").with_key("left", left));
    }
    bar.enable_steady_tick(Duration::from_millis(100));
    bar
}

/// The time left in words; nothing where it is not known, or more time has passed than was estimated.
fn time_left(ends: Option<Instant>, now: Instant) -> String {
    let left = ends.and_then(|ends| ends.checked_duration_since(now));
    left.map_or(String::new(), |left| format!(", about {} s left", left.as_secs() + 1))
}

impl Progress for Console {
    fn expect(&self, stages: &[Stage]) {
        let mut told = self.stages.borrow_mut();
        told.position = JobPosition::expect(stages);
        told.share = 0.0;
        if let Some(name) = told.current.as_ref().map(|(name, _)| name.clone()) {
            told.position.begin(&name);
            self.draw(&mut told);
        }
    }

    fn stage(&self, name: &str) {
        let mut stages = self.stages.borrow_mut();
        stages.end();
        stages.began.get_or_insert_with(Instant::now);
        stages.current = Some((name.to_owned(), Instant::now()));
        stages.position.begin(name);
        if matches!(self.show, Show::Lines) {
            eprintln!("{name}");
        }
        self.draw(&mut stages);
    }

    fn memory_mb(&self, estimated: f64) {
        self.stages.borrow_mut().memory_mb = Some(estimated);
        self.note(&format!("takes about {estimated:.0} MB of memory"));
    }

    fn note(&self, text: &str) {
        match &self.show {
            Show::Nothing => {}
            Show::Lines => eprintln!("{text}"),
            Show::Bar(bar) => bar.println(text),
        }
    }

    fn advance(&self, done: usize, of: usize) {
        let mut stages = self.stages.borrow_mut();
        stages.position.advance(done, of);
        self.draw(&mut stages);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bar_moves_from_empty_through_every_stage_and_is_never_full_before_the_end() {
        let shown = Show::Bar(bar(ProgressDrawTarget::hidden(), Arc::default()));
        let console = Console { show: shown, stages: RefCell::default() };
        let look = || {
            let Show::Bar(bar) = &console.show else { panic!("no bar") };
            (bar.position() as f64 / bar.length().unwrap() as f64, bar.message())
        };
        console.stage("read plan");
        assert_eq!(look(), (0.0, "read plan".into()), "how many stages there are is not known yet");
        console.expect(&["read plan", "simulate", "distances", "write files"].map(|name| (name, 1)));
        assert_eq!(look(), (0.0, "stage 1 of 4: read plan".into()));
        console.stage("simulate");
        assert_eq!(look(), (0.25, "stage 2 of 4: simulate".into()));
        console.advance(50, 100);
        assert_eq!(look().0, 0.375);
        console.stage("write files");
        assert_eq!(look(), (0.75, "stage 4 of 4: write files".into()));
        console.stage("simulate");
        assert_eq!(look(), (0.75, "stage 4 of 4: simulate".into()), "a later round does not bring it back");
    }

    #[test]
    fn the_time_left_is_told_while_it_says_something() {
        let now = Instant::now();
        let left = |seconds| time_left(now.checked_add(Duration::from_secs(seconds)), now);
        assert_eq!([left(29), left(0)], [", about 30 s left", ", about 1 s left"]);
        assert_eq!([time_left(None, now), time_left(now.checked_sub(Duration::from_secs(1)), now)], ["", ""]);
    }
}
