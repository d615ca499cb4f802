//! Stopping the command from outside: what it has begun to write is removed, what stood there stands there still.

use anyhow::Context;
use bonemill_geometry::cancel::Cancel;

/// Exit code of a command that a signal stopped.
pub const STOPPED: u8 = 130;

/// SIGINT, SIGTERM and SIGHUP trigger `cancel`; a second one ends the process on the spot.
pub fn watch(cancel: &Cancel) -> anyhow::Result<()> {
    let (watched, mut is_second) = (cancel.clone(), false);
    ctrlc::set_handler(move || {
        if is_second {
            std::process::exit(i32::from(STOPPED));
        }
        is_second = true;
        watched.trigger();
    })
    .context("cannot listen for signals")
}
