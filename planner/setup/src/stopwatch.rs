//! Wall-clock seconds by stage of planning; the progress is notified when a stage begins.
//!
//! The seconds are for people: they never enter a plan's files, which must not depend on the machine.

use std::time::Instant;

use bonemill_geometry::{Progress, cancel};

/// Runs stages, notifies the progress of each, and measures how long it takes.
pub struct Stopwatch<'a> {
    progress: &'a dyn Progress,
    seconds: Vec<(&'static str, f64)>,
}

impl<'a> Stopwatch<'a> {
    /// Nothing has run yet.
    pub fn new(progress: &'a dyn Progress) -> Self {
        Self { progress, seconds: Vec::new() }
    }

    /// Runs one stage; a stage of the same name adds to the one before. Planning that was cancelled ends here.
    pub fn run<T>(&mut self, stage: &'static str, work: impl FnOnce() -> T) -> T {
        cancel::poll();
        self.progress.stage(stage);
        let start = Instant::now();
        let result = work();
        let seconds = start.elapsed().as_secs_f64();
        match self.seconds.iter_mut().find(|(name, _)| *name == stage) {
            Some((_, so_far)) => *so_far += seconds,
            None => self.seconds.push((stage, seconds)),
        }
        result
    }

    /// Reports the memory that the job is estimated to take, MB.
    pub fn tell_memory_mb(&self, mb: f64) {
        self.progress.memory_mb(mb);
    }

    /// Seconds by stage, in the order in which the stages first ran.
    pub fn into_seconds(self) -> Vec<(&'static str, f64)> {
        self.seconds
    }
}
