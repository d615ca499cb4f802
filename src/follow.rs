//! A streamed run's log while it grows: complete lines as they come, until the run has ended.

use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::Path;

use anyhow::Context;
use bonemill_robot::stream::log::{Log, LogRow};

/// What the log said since it was last looked at.
#[derive(Debug, Default)]
pub struct News {
    /// Logged steps.
    pub steps: Vec<LogRow>,
    /// What happened, and when, s.
    pub events: Vec<(f64, String)>,
}

impl News {
    /// Whether the run has ended.
    pub fn ended(&self) -> bool {
        self.events.iter().any(|(_, said)| said.starts_with("ended: "))
    }
}

/// A log that is being written.
#[derive(Debug)]
pub struct LogTail {
    reader: BufReader<File>,
    /// The first line, which names the plan.
    head: String,
    /// A line that is not whole yet.
    partial: String,
}

impl LogTail {
    /// Opens the log of a run of the plan whose trajectory has this digest.
    ///
    /// # Errors
    /// When it cannot be read, or is of another plan.
    pub fn open(path: &Path, digest: &str) -> anyhow::Result<Self> {
        let file = File::open(path).with_context(|| format!("cannot open {}", path.display()))?;
        let mut reader = BufReader::new(file);
        let mut head = String::new();
        reader.read_line(&mut head).with_context(|| format!("cannot read {}", path.display()))?;
        Log::read(&head)?.of_plan(digest)?;
        Ok(Self { reader, head, partial: String::new() })
    }

    /// The lines that were completed since the last call; none where nothing came.
    ///
    /// # Errors
    /// When the file cannot be read or a line is damaged.
    pub fn news(&mut self) -> anyhow::Result<News> {
        let mut text = self.head.clone();
        while self.reader.read_line(&mut self.partial)? > 0 && self.partial.ends_with('\n') {
            text += &std::mem::take(&mut self.partial);
        }
        let log = Log::read(&text)?;
        Ok(News { steps: log.steps, events: log.events })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    /// As a run writes them, each with its checksum.
    const LINES: [&str; 3] = [
        "bonemill-run,1,abc,100,0.002,8f6845e3\n",
        "E,0.000000,connect,872d2078\n",
        "E,1.500000,ended: stopped by the user,a90edeab\n",
    ];

    #[test]
    fn lines_come_when_they_are_whole_and_the_end_is_seen() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("run.log");
        let mut file = File::create(&path).unwrap();
        let mut write = |text: &str| file.write_all(text.as_bytes()).unwrap();
        write(LINES[0]);
        assert!(LogTail::open(&path, "another").unwrap_err().to_string().contains("another plan"));
        let mut tail = LogTail::open(&path, "abc").unwrap();
        assert!(tail.news().unwrap().events.is_empty());
        let (half, rest) = LINES[1].split_at(9);
        write(half);
        assert!(tail.news().unwrap().events.is_empty());
        write(rest);
        let news = tail.news().unwrap();
        assert_eq!((news.events.len(), news.steps.len()), (1, 0));
        assert_eq!(news.events[0], (0.0, "connect".to_owned()));
        assert!(!news.ended());
        write(LINES[2]);
        assert!(tail.news().unwrap().ended());
        write("E,2.0,damaged,00000000\n");
        assert!(tail.news().unwrap_err().to_string().contains("CRC-32"));
        assert!(LogTail::open(&dir.path().join("none"), "abc").unwrap_err().to_string().contains("none"));
    }
}
