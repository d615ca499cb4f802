//! How a long computation tells how far it is; the library itself prints nothing.

/// Told by the planner's stages; called from one thread at a time.
pub trait Progress {
    /// A stage begins, and the one before has ended.
    fn stage(&self, name: &str);
    /// `done` of `of` steps of the stage are done.
    fn advance(&self, done: usize, of: usize);
    /// What the work takes at its peak, MB, about; told before it is taken.
    fn memory_mb(&self, _estimated: f64) {}
}

/// Nobody listens.
impl Progress for () {
    fn stage(&self, _: &str) {}
    fn advance(&self, _: usize, _: usize) {}
}
