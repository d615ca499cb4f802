//! Stops the command on a signal: unfinished files are removed, existing ones are left unchanged.

use anyhow::Context;
use bonemill_geometry::cancel::Cancel;

/// Exit code of a command that a signal stopped.
pub const STOPPED: u8 = 130;

/// Makes SIGINT, SIGTERM and SIGHUP trigger `cancel`; a second signal ends the process at once.
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
