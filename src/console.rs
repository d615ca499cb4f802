//! Shows progress, as a bar on a terminal and as plain lines elsewhere, and measures the seconds of every stage.
//!
//! The bar is how many of the job's stages are done, and of the last one its share. Stages take different times, so the time left is told only within a
//! stage that counts its steps; else the time so far.

use std::cell::RefCell;
use std::io::{IsTerminal, stderr};
use std::time::{Duration, Instant};

use bonemill_geometry::JobPosition;
use bonemill_planner::Progress;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::args::Talk;

/// The bar's length for each stage.
const PER_STAGE: u64 = 1000;
/// The time left is told once a stage has run so long: the share that is done then says something.
const SETTLED: Duration = Duration::from_secs(2);

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
    memory_mb: Option<f64>,
}

impl Stages {
    fn end(&mut self) {
        if let Some((name, since)) = self.current.take() {
            self.done.push((name, since.elapsed().as_secs_f64()));
        }
    }
}

impl Console {
    pub fn new(talk: Talk) -> Self {
        let show = match talk {
            Talk::Quiet | Talk::Machine => Show::Nothing,
            Talk::People if stderr().is_terminal() => Show::Bar(bar(ProgressDrawTarget::stderr())),
            Talk::People => Show::Lines,
        };
        Self { show, stages: RefCell::default() }
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
    fn draw(&self, stages: &Stages, left: Option<Duration>) {
        let Show::Bar(bar) = &self.show else { return };
        let name = stages.current.as_ref().map_or("", |(name, _)| name);
        let left =
            left.map_or(String::new(), |left| format!(", about {} s left in this stage", left.as_secs() + 1));
        bar.set_message(match stages.position.stage() {
            Some((n, of)) => format!("stage {n} of {of}: {name}{left}"),
            None => format!("{name}{left}"),
        });
        let of = stages.position.stage().map_or(1, |(_, of)| of as u64);
        bar.set_length(PER_STAGE * of);
        bar.set_position((PER_STAGE as f64 * stages.position.stages_done()) as u64);
    }
}

fn bar(target: ProgressDrawTarget) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(PER_STAGE), target);
    // without a valid template the default style is used
    if let Ok(style) = ProgressStyle::with_template("{spinner} [{bar:30}] {elapsed} so far, {msg}") {
        bar.set_style(style.progress_chars("=> "));
    }
    bar.enable_steady_tick(Duration::from_millis(100));
    bar
}

/// The time left of a stage of which `done` of `of` steps took `so_far`; `None` while that says little.
fn time_left(so_far: Duration, done: usize, of: usize) -> Option<Duration> {
    let is_settled = so_far >= SETTLED && done > 0 && done <= of;
    is_settled.then(|| so_far.mul_f64((of - done) as f64 / done as f64))
}

impl Progress for Console {
    fn expect(&self, stages: &[&'static str]) {
        let mut told = self.stages.borrow_mut();
        told.position = JobPosition::expect(stages);
        if let Some(name) = told.current.as_ref().map(|(name, _)| name.clone()) {
            told.position.begin(&name);
            self.draw(&told, None);
        }
    }

    fn stage(&self, name: &str) {
        let mut stages = self.stages.borrow_mut();
        stages.end();
        stages.current = Some((name.to_owned(), Instant::now()));
        stages.position.begin(name);
        if matches!(self.show, Show::Lines) {
            eprintln!("{name}");
        }
        self.draw(&stages, None);
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
        let so_far = stages.current.as_ref().map_or(Duration::ZERO, |(_, since)| since.elapsed());
        self.draw(&stages, time_left(so_far, done, of));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bar_moves_from_empty_through_every_stage_and_is_never_full_before_the_end() {
        let shown = Show::Bar(bar(ProgressDrawTarget::hidden()));
        let console = Console { show: shown, stages: RefCell::default() };
        let look = || {
            let Show::Bar(bar) = &console.show else { panic!("no bar") };
            (bar.position() as f64 / bar.length().unwrap() as f64, bar.message())
        };
        console.stage("read plan");
        assert_eq!(look(), (0.0, "read plan".into()), "how many stages there are is not known yet");
        console.expect(&["read plan", "simulate", "distances", "write files"]);
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
    fn the_time_left_is_told_once_the_share_says_something() {
        let seconds = Duration::from_secs;
        assert_eq!(time_left(seconds(10), 25, 100), Some(seconds(30)));
        assert_eq!(time_left(seconds(10), 100, 100), Some(seconds(0)));
        assert_eq!(
            [time_left(seconds(1), 25, 100), time_left(seconds(10), 0, 100), time_left(seconds(10), 0, 0)],
            [None; 3]
        );
    }
}
