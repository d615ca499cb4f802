//! Long work apart from Python: progress comes back, Ctrl-C and exceptions in a callback stop it.
//!
//! The work runs on a pool of its own threads, which never touch Python; the calling thread waits without holding Python,
//! delivers progress and looks for signals every [`LOOK`]. So other Python threads run, two plans can be made at once,
//! and the library needs no more than to be polled ([`bonemill_geometry::cancel`]). Work that is to stop is waited for no
//! longer than [`PATIENCE`]: between two polls it may take a while, but nobody waits for what comes of it. It holds
//! nothing of Python's, and writes no file, since every file comes after a stage of its own.

use std::sync::mpsc::{self, RecvTimeoutError, Sender};
use std::thread;
use std::time::{Duration, Instant};

use bonemill_geometry::cancel::{self, Cancel, Cancelled};
use bonemill_planner::Progress;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;

/// How long a signal waits at most before it is looked for.
const LOOK: Duration = Duration::from_millis(20);
/// How long work that was told to stop is waited for.
const PATIENCE: Duration = Duration::from_millis(100);

/// What the work tells.
struct Told {
    stage: String,
    done: usize,
    of: usize,
}

/// Sends progress to the calling thread.
struct Teller {
    to: Sender<Told>,
    stage: std::cell::RefCell<String>,
}

impl Progress for Teller {
    fn stage(&self, name: &str) {
        name.clone_into(&mut self.stage.borrow_mut());
        self.advance(0, 0);
    }

    fn advance(&self, done: usize, of: usize) {
        // what is told how far it is can also be told to stop
        cancel::poll();
        // nobody listens any more: the work is being stopped
        let _ = self.to.send(Told { stage: self.stage.borrow().clone(), done, of });
    }
}

/// Does `work` on `threads` threads (default: one per core) and gives its result.
///
/// # Errors
/// What `progress` raised, or a signal's handler (KeyboardInterrupt); the work has then stopped.
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
            let teller = Teller { to, stage: Default::default() };
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
