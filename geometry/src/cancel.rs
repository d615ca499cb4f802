//! Stops a long computation from outside.
//!
//! Long loops call [`poll`]. It does nothing unless the thread works under a [`Cancel`] that was triggered. Then it
//! unwinds the stack, without printing a panic's message, up to [`Cancel::run`], which returns [`Cancelled`]. Unwinding
//! is used instead of an error in every signature: the functions between keep their return types, and a loop that
//! can be stopped needs one extra line.
//!
//! Invariant: as long as the flag is not triggered, a poll changes nothing, so results do not depend on it. A computation
//! on several threads is stopped on those threads that called [`Cancel::enter`], for example in the start handler of their
//! pool; the pool passes the unwinding on to the caller. This module has no deadlines, no signals and no resuming.

use std::any::Any;
use std::cell::RefCell;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

thread_local! {
    static WATCHED: RefCell<Option<Cancel>> = const { RefCell::new(None) };
}

/// A flag that stops the work that runs under it. Clones share one flag.
#[derive(Debug, Clone, Default)]
pub struct Cancel(Arc<AtomicBool>);

/// The work was stopped before it was done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Cancelled;

impl Cancel {
    /// A flag that is not triggered.
    pub fn new() -> Self {
        Self::default()
    }

    /// Stops the work under this flag at its next poll. A flag cannot be reset.
    pub fn trigger(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Makes this flag the one that this thread's polls check from now on.
    pub fn enter(&self) {
        WATCHED.with_borrow_mut(|watched| *watched = Some(self.clone()));
    }

    /// Runs `work` under this flag.
    ///
    /// # Errors
    /// [`Cancelled`] when a poll found the flag triggered, on this thread or on one whose panics are passed to it. Any other
    /// panic is passed on.
    pub fn run<T>(&self, work: impl FnOnce() -> T) -> Result<T, Cancelled> {
        let before = WATCHED.with_borrow_mut(|watched| watched.replace(self.clone()));
        // unwind safe: everything that the closure owns is dropped with it, so no half-finished value stays reachable
        let result = catch_unwind(AssertUnwindSafe(work));
        WATCHED.with_borrow_mut(|watched| *watched = before);
        result.map_err(|payload: Box<dyn Any + Send>| match payload.downcast::<Cancelled>() {
            Ok(cancelled) => *cancelled,
            Err(panic) => resume_unwind(panic),
        })
    }
}

/// Unwinds if this thread's work was cancelled; otherwise it costs a few nanoseconds.
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
        // a poll outside of any run, and one after a run
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
