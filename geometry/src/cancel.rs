//! Stopping a long computation from outside, wherever it is.
//!
//! Long loops call [`poll`]. It does nothing unless the thread works under a [`Cancel`] that was triggered; then it
//! unwinds, without a panic's message, to [`Cancel::run`], which gives [`Cancelled`]. Unwinding instead of errors through
//! every signature: the computation's own results stay what they are, and a loop that is polled costs one line.
//!
//! Invariant: without a trigger a poll changes nothing, so results do not depend on being watched. A computation that
//! spreads over threads is stopped on those that entered ([`Cancel::enter`]), e.g. by the start handler of its pool; a
//! panic there travels to the caller, as pools do. Not here: deadlines, signals, resuming.

use std::any::Any;
use std::cell::RefCell;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

thread_local! {
    static WATCHED: RefCell<Option<Cancel>> = const { RefCell::new(None) };
}

/// A flag that stops the work done under it; clones share it.
#[derive(Debug, Clone, Default)]
pub struct Cancel(Arc<AtomicBool>);

/// The work was stopped before it was done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Cancelled;

impl Cancel {
    /// Not triggered.
    pub fn new() -> Self {
        Self::default()
    }

    /// Stops the work under this flag at its next poll, for good.
    pub fn trigger(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// From now on, this thread's polls look at this flag.
    pub fn enter(&self) {
        WATCHED.with_borrow_mut(|watched| *watched = Some(self.clone()));
    }

    /// Does `work` under this flag.
    ///
    /// # Errors
    /// [`Cancelled`] when a poll found the flag triggered, here or on a thread whose panics travel here. Other panics go on.
    pub fn run<T>(&self, work: impl FnOnce() -> T) -> Result<T, Cancelled> {
        let before = WATCHED.with_borrow_mut(|watched| watched.replace(self.clone()));
        // what the work touched is dropped with it: nothing half done is seen again
        let result = catch_unwind(AssertUnwindSafe(work));
        WATCHED.with_borrow_mut(|watched| *watched = before);
        result.map_err(|payload: Box<dyn Any + Send>| match payload.downcast::<Cancelled>() {
            Ok(cancelled) => *cancelled,
            Err(panic) => resume_unwind(panic),
        })
    }
}

/// Stops here if this thread's work was cancelled; a few nanoseconds otherwise.
pub fn poll() {
    let stop = WATCHED
        .with_borrow(|watched| watched.as_ref().is_some_and(|Cancel(flag)| flag.load(Ordering::Relaxed)));
    if stop {
        resume_unwind(Box::new(Cancelled));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_trigger_stops_the_work_at_the_next_poll() {
        let cancel = Cancel::new();
        assert_eq!(cancel.run(|| (0..10).inspect(|_| poll()).sum::<i32>()), Ok(45));
        let mut seen = Vec::new();
        let stopped = cancel.run(|| {
            for n in 0..10 {
                poll();
                seen.push(n);
                if n == 3 {
                    cancel.trigger();
                }
            }
        });
        assert_eq!((stopped, seen), (Err(Cancelled), vec![0, 1, 2, 3]));
    }

    #[test]
    fn other_work_goes_on() {
        let (stopped, other) = (Cancel::new(), Cancel::new());
        stopped.trigger();
        assert_eq!(other.run(|| stopped.run(poll)), Ok(Err(Cancelled)));
        // outside of any run, and after one
        poll();
        std::thread::spawn(poll).join().unwrap();
    }

    #[test]
    fn threads_that_entered_stop_too() {
        let cancel = Cancel::new();
        cancel.trigger();
        let work = || {
            let watched = cancel.clone();
            let inner = std::thread::spawn(move || {
                watched.enter();
                poll();
            });
            inner.join().map_err(resume_unwind)
        };
        assert!(matches!(cancel.run(work), Err(Cancelled)));
    }

    #[test]
    #[should_panic(expected = "a bug")]
    fn a_bug_stays_a_panic() {
        let _ = Cancel::new().run(|| panic!("a bug"));
    }
}
