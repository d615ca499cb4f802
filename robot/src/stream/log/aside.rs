//! A file that a thread of its own writes, so that whoever logs a run never waits for a disk.

use std::io::{self, Write};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, SyncSender, TrySendError};
use std::thread;
use std::time::Duration;

/// Lines that may wait for the disk: some 2 s of a run.
const MOST_LINES: usize = 200;
/// The disk gets so long for the last ones.
const ENDS: Duration = Duration::from_secs(1);

/// A writer that hands on what it is given; what the file says against it is told at the next write.
#[derive(Debug)]
pub struct Aside {
    /// None once it is finished.
    pieces: Option<SyncSender<Vec<u8>>>,
    /// Ends when all is written.
    error: Receiver<io::Error>,
}

impl Aside {
    /// Writes to this file from now on.
    ///
    /// # Errors
    /// What the system says against a thread.
    pub fn new(mut out: impl Write + Send + 'static) -> io::Result<Self> {
        let (pieces, to_write) = mpsc::sync_channel::<Vec<u8>>(MOST_LINES);
        let (failed, error) = mpsc::channel();
        thread::Builder::new().name("log".to_owned()).spawn(move || {
            for piece in to_write {
                if let Err(error) = out.write_all(&piece).and_then(|()| out.flush()) {
                    // nobody listens any more where the log was let go of
                    let _ = failed.send(error);
                    return;
                }
            }
        })?;
        Ok(Self { pieces: Some(pieces), error })
    }

    /// Waits until all is written, for a while.
    ///
    /// # Errors
    /// What the file says against the last lines, or that it has not taken them all.
    pub fn finish(mut self) -> io::Result<()> {
        self.pieces = None;
        match self.error.recv_timeout(ENDS) {
            Ok(error) => Err(error),
            Err(RecvTimeoutError::Disconnected) => Ok(()),
            Err(RecvTimeoutError::Timeout) => {
                Err(io::Error::new(io::ErrorKind::TimedOut, "the disk has not taken the last lines"))
            }
        }
    }
}

impl Write for Aside {
    fn write(&mut self, piece: &[u8]) -> io::Result<usize> {
        if let Ok(error) = self.error.try_recv() {
            return Err(error);
        }
        let sent = self.pieces.as_ref().map(|pieces| pieces.try_send(piece.to_vec()));
        match sent {
            Some(Ok(())) => Ok(piece.len()),
            Some(Err(TrySendError::Full(_))) => Err(io::Error::new(
                io::ErrorKind::TimedOut,
                format!("the disk takes nothing: {MOST_LINES} lines are waiting"),
            )),
            // the file failed just now
            Some(Err(TrySendError::Disconnected(_))) | None => {
                Err(self.error.try_recv().unwrap_or_else(|_| io::ErrorKind::BrokenPipe.into()))
            }
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Takes so many pieces; then it fails, or takes nothing and says nothing.
    struct Disk {
        left: usize,
        hangs: bool,
    }

    impl Write for Disk {
        fn write(&mut self, piece: &[u8]) -> io::Result<usize> {
            if self.left == 0 && self.hangs {
                thread::sleep(Duration::from_hours(1));
            }
            if self.left == 0 {
                return Err(io::Error::other("no space left"));
            }
            self.left -= 1;
            Ok(piece.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    fn first_error(disk: Disk) -> (usize, io::Error) {
        let mut log = Aside::new(disk).unwrap();
        for line in 0..10 * MOST_LINES {
            if let Err(error) = log.write_all(b"a line") {
                return (line, error);
            }
            // a disk that fails says so within some lines
            thread::sleep(Duration::from_micros(100));
        }
        panic!("no line was refused");
    }

    #[test]
    fn a_disk_that_hangs_is_told_after_some_lines_and_not_waited_for() {
        let (line, error) = first_error(Disk { left: 3, hangs: true });
        // those written, the one that hangs, those that wait
        assert!((MOST_LINES..=3 + 1 + MOST_LINES).contains(&line), "line {line}");
        assert_eq!(error.kind(), io::ErrorKind::TimedOut);
    }

    #[test]
    fn what_a_full_disk_says_is_told() {
        let (line, error) = first_error(Disk { left: 3, hangs: false });
        assert!(line > 3 && error.to_string() == "no space left", "line {line}: {error}");
    }

    #[test]
    fn all_that_was_logged_is_written_when_it_is_let_go_of() {
        let path = std::env::temp_dir().join(format!("bonemill-aside-{}", std::process::id()));
        let mut log = Aside::new(std::fs::File::create(&path).unwrap()).unwrap();
        for n in 0..100 {
            log.write_all(format!("{n}\n").as_bytes()).unwrap();
        }
        log.finish().unwrap();
        let written = std::fs::read_to_string(&path).unwrap();
        std::fs::remove_file(&path).unwrap();
        assert_eq!(written.lines().count(), 100);
    }
}
