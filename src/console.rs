//! Shows progress, as a bar on a terminal and as plain lines elsewhere, and measures the seconds of every stage.

use std::cell::RefCell;
use std::io::{IsTerminal, stderr};
use std::time::{Duration, Instant};

use bonemill_planner::Progress;
use indicatif::{ProgressBar, ProgressStyle};

use crate::args::Talk;

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
            Talk::People if stderr().is_terminal() => Show::Bar(bar()),
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
}

fn bar() -> ProgressBar {
    let bar = ProgressBar::new(0);
    // without a valid template the default style is used
    if let Ok(style) = ProgressStyle::with_template("{spinner} {msg:24} [{bar:32}] {percent:>3} %  {elapsed}")
    {
        bar.set_style(style.progress_chars("=> "));
    }
    bar.enable_steady_tick(Duration::from_millis(100));
    bar
}

impl Progress for Console {
    fn stage(&self, name: &str) {
        let mut stages = self.stages.borrow_mut();
        stages.end();
        stages.current = Some((name.to_owned(), Instant::now()));
        match &self.show {
            Show::Nothing => {}
            Show::Lines => eprintln!("{name}"),
            Show::Bar(bar) => {
                bar.set_length(0);
                bar.set_position(0);
                bar.set_message(name.to_owned());
            }
        }
    }

    fn memory_mb(&self, estimated: f64) {
        self.stages.borrow_mut().memory_mb = Some(estimated);
        let text = format!("takes about {estimated:.0} MB of memory");
        match &self.show {
            Show::Nothing => {}
            Show::Lines => eprintln!("{text}"),
            Show::Bar(bar) => bar.println(text),
        }
    }

    fn advance(&self, done: usize, of: usize) {
        if let Show::Bar(bar) = &self.show {
            bar.set_length(of as u64);
            bar.set_position(done as u64);
        }
    }
}
