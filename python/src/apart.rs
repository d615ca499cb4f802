//! Runs long work without holding Python: progress is reported, and Ctrl-C or an exception in a callback stops the work.
//!
//! The work runs on a separate pool of threads, which never use Python. The calling thread waits without the GIL, delivers
//! progress and checks for signals every [`LOOK`]. So other Python threads run, two plans can be computed at once, and the
//! library only needs to be polled ([`bonemill_geometry::cancel`]). After a stop the caller waits at most [`PATIENCE`] for the
//! work. The work may run on until its next poll, but its result is dropped, it holds no Python object, and it writes no file,
//! because every file is written in a later stage.

use std::cell::RefCell;
use std::sync::mpsc::{self, RecvTimeoutError, Sender};
use std::thread;
use std::time::{Duration, Instant};

use bonemill_geometry::cancel::{self, Cancel, Cancelled};
use bonemill_geometry::{JobPosition, Stage};
use bonemill_planner::Progress;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;

/// Interval between checks for signals.
const LOOK: Duration = Duration::from_millis(20);
/// Longest wait for work that was told to stop.
const PATIENCE: Duration = Duration::from_millis(100);

/// A progress report of the work: the stage that runs, and how much of the whole is done, in thousandths of the job.
struct Told {
    stage: String,
    done: usize,
    of: usize,
}

/// Steps of a job.
const STEPS: usize = 1000;

/// Sends progress to the calling thread.
struct Teller {
    to: Sender<Told>,
    stage: RefCell<String>,
    position: RefCell<JobPosition>,
}

impl Progress for Teller {
    fn expect(&self, stages: &[Stage]) {
        *self.position.borrow_mut() = JobPosition::expect(stages);
    }

    fn stage(&self, name: &str) {
        name.clone_into(&mut self.stage.borrow_mut());
        self.position.borrow_mut().begin(name);
        self.advance(0, 0);
    }

    fn advance(&self, done: usize, of: usize) {
        // each progress report is also a point at which the work can stop
        cancel::poll();
        let mut position = self.position.borrow_mut();
        position.advance(done, of);
        let done = (STEPS as f64 * position.share()) as usize;
        let of = position.stage().map_or(0, |_| STEPS);
        // sending fails when the work is being stopped
        let _ = self.to.send(Told { stage: self.stage.borrow().clone(), done, of });
    }
}

/// Runs `work` on `threads` threads (default: one per core) and returns its result.
///
/// # Errors
/// The exception raised by `progress` or by a signal's handler (KeyboardInterrupt); the work is then stopped.
pub fn run<T: Send + 'static>(
    py: Python<'_>,
    progress: Option<Py<PyAny>>,
    threads: Option<usize>,
    work: impl FnOnce(&dyn Progress) -> T + Send + 'static,
) -> PyResult<T> {
    let cancel = Cancel::new();
    let watched = cancel.clone();
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads.unwrap_or(0))
        .thread_name(|n| format!("bonemill {n}"))
        .start_handler(move |_| watched.enter())
        .build()
        .map_err(|e| PyRuntimeError::new_err(format!("cannot start the worker threads: {e}")))?;
    let (to, mut told) = mpsc::channel();
    let watched = cancel.clone();
    let worker = thread::spawn(move || {
        pool.install(|| {
            let teller = Teller { to, stage: RefCell::default(), position: RefCell::default() };
            watched.run(|| work(&teller))
        })
    });
    let mut stopped: Option<(PyErr, Instant)> = None;
    loop {
        let event;
        (event, told) = py.detach(move || (told.recv_timeout(LOOK), told));
        let heard = match event {
            Ok(told) => deliver(py, progress.as_ref(), &told),
            Err(RecvTimeoutError::Timeout) => Ok(()),
            Err(RecvTimeoutError::Disconnected) => break,
        };
        if let Err(error) = heard.and_then(|()| py.check_signals()) {
            cancel.trigger();
            stopped.get_or_insert((error, Instant::now()));
        }
        match stopped {
            Some((error, since)) if since.elapsed() > PATIENCE => return Err(error),
            still => stopped = still,
        }
    }
    let result = py.detach(|| worker.join());
    match (result, stopped) {
        (_, Some((error, _))) => Err(error),
        (Ok(Ok(result)), None) => Ok(result),
        (Ok(Err(Cancelled)), None) => Err(PyRuntimeError::new_err("stopped")),
        (Err(_), None) => Err(PyRuntimeError::new_err(
            "an internal error stopped the work; its message is on stderr: please report it",
        )),
    }
}

fn deliver(py: Python<'_>, progress: Option<&Py<PyAny>>, told: &Told) -> PyResult<()> {
    match progress {
        Some(callback) => callback.call1(py, (told.stage.as_str(), told.done, told.of)).map(drop),
        None => Ok(()),
    }
}
