//! How a long computation reports its progress. The library itself prints nothing.

/// Receives the progress of the planner's stages. It is called from one thread at a time.
pub trait Progress {
    /// A stage begins, and the one before has ended.
    fn stage(&self, name: &str);
    /// `done` of `of` steps of the stage are done.
    fn advance(&self, done: usize, of: usize);
    /// The estimated peak memory of the work, MB; reported before it is allocated.
    fn memory_mb(&self, _estimated: f64) {}
}

/// Ignores all reports.
impl Progress for () {
    fn stage(&self, _: &str) {}
    fn advance(&self, _: usize, _: usize) {}
}
