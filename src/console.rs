//! Shows progress, as a bar on a terminal and as plain lines elsewhere, and measures the seconds of every stage.
//!
//! Bar and time left follow from the time that the job's stages typically take beside each other.

use std::cell::RefCell;
use std::io::{IsTerminal, stderr};
use std::time::{Duration, Instant};

use bonemill_geometry::{JobPosition, Stage};
use bonemill_planner::Progress;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::args::Talk;

/// The bar's length.
const WHOLE: u64 = 1000;
/// The time left is told once a job has run so long and this share is done, which then says something.
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
    /// The share of the job that was done when it last grew, and when that was since it began.
    grew: (f64, Duration),
    memory_mb: Option<f64>,
}

impl Stages {
    /// How long the job still takes if it goes on as until its share last grew; `None` while that says little.
    fn left(&mut self) -> Option<Duration> {
        let so_far = self.began.map_or(Duration::ZERO, |began| began.elapsed());
        if self.position.share() > self.grew.0 {
            self.grew = (self.position.share(), so_far);
        }
        time_left(self.grew, so_far)
    }

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
    fn draw(&self, stages: &mut Stages) {
        let Show::Bar(bar) = &self.show else { return };
        let left = stages.left();
        let left = left.map_or(String::new(), |left| format!(", about {} s left", left.as_secs() + 1));
        let name = stages.current.as_ref().map_or("", |(name, _)| name);
        bar.set_message(match stages.position.stage() {
            Some((n, of)) => format!("stage {n} of {of}: {name}{left}"),
            None => format!("{name}{left}"),
        });
        bar.set_position((WHOLE as f64 * stages.position.share()) as u64);
    }
}

fn bar(target: ProgressDrawTarget) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(WHOLE), target);
    // without a valid template the default style is used
    if let Ok(style) = ProgressStyle::with_template("{spinner} [{bar:30}] {elapsed} so far, {msg}") {
        bar.set_style(style.progress_chars("=> "));
    }
    bar.enable_steady_tick(Duration::from_millis(100));
    bar
}

/// The time left of a job of which a share took some time, `so_far` after it began; `None` while that says little, and where more time
/// has passed than was left.
fn time_left((share, took): (f64, Duration), so_far: Duration) -> Option<Duration> {
    let is_settled = so_far >= SETTLED && share >= SETTLED_SHARE;
    is_settled.then(|| took.mul_f64(1.0 / share).checked_sub(so_far)).flatten()
}

impl Progress for Console {
    fn expect(&self, stages: &[Stage]) {
        let mut told = self.stages.borrow_mut();
        told.position = JobPosition::expect(stages);
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
        let shown = Show::Bar(bar(ProgressDrawTarget::hidden()));
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
    fn the_time_left_is_told_once_the_share_says_something() {
        let left = |share: f64, took: u64, so_far: u64| {
            time_left((share, Duration::from_secs(took)), Duration::from_secs(so_far))
                .map(|left| left.as_secs())
        };
        assert_eq!(
            [left(0.25, 10, 10), left(0.25, 10, 15), left(1.0, 10, 10)],
            [Some(30), Some(25), Some(0)]
        );
        assert_eq!([left(0.25, 1, 1), left(0.01, 10, 10), left(0.25, 10, 41)], [None; 3]);
    }
}
