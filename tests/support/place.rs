//! A folder with the patient's files, in which the command is run.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::{Arc, Mutex, OnceLock};

use bonemill_planner::plan::StoredPlan;

use super::body;
use super::image::{Image, Stored};

/// Files with their bytes, and folders, by path.
pub type Files = BTreeMap<PathBuf, Option<Vec<u8>>>;

/// A temporary folder in which the command runs.
pub struct Place(tempfile::TempDir);

/// The result of a run of the command.
#[derive(Clone)]
pub struct Ran {
    /// Exit code.
    pub code: i32,
    /// Standard output.
    pub out: String,
    /// Standard error.
    pub err: String,
}

impl Place {
    /// An empty folder.
    pub fn empty() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    /// A folder with the healthy patient.
    pub fn healthy() -> Self {
        let place = Self::empty();
        place.put_ct(&body::ct());
        place.put_labels(&body::labels());
        fs::write(place.path("case.toml"), body::CASE).unwrap();
        place
    }

    /// A path in it.
    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Writes the CT as singles.
    pub fn put_ct(&self, image: &Image) {
        fs::write(self.path("ct.nii"), image.bytes(Stored::Single)).unwrap();
    }

    /// Writes the labels as 16-bit numbers.
    pub fn put_labels(&self, image: &Image) {
        fs::write(self.path("labels.nii"), image.bytes(Stored::Unsigned16)).unwrap();
    }

    /// Writes the healthy labels after a change.
    pub fn with_labels(self, change: impl FnOnce(&mut Image)) -> Self {
        let mut labels = body::labels();
        change(&mut labels);
        self.put_labels(&labels);
        self
    }

    /// Writes the healthy CT after a change.
    pub fn with_ct(self, change: impl FnOnce(&mut Image)) -> Self {
        let mut ct = body::ct();
        change(&mut ct);
        self.put_ct(&ct);
        self
    }

    /// Changes the bytes of a file.
    pub fn with_bytes(self, name: &str, change: impl FnOnce(&mut Vec<u8>)) -> Self {
        let mut bytes = fs::read(self.path(name)).unwrap();
        change(&mut bytes);
        fs::write(self.path(name), bytes).unwrap();
        self
    }

    /// Replaces `old`, which must occur exactly once, in the case.
    #[track_caller]
    pub fn with_case(self, old: &str, new: &str) -> Self {
        let text = fs::read_to_string(self.path("case.toml")).unwrap();
        assert_eq!(text.matches(old).count(), 1, "{old:?} in the case");
        fs::write(self.path("case.toml"), text.replace(old, new)).unwrap();
        self
    }

    /// `case.toml:LINE` of the first line that contains `part`.
    #[track_caller]
    pub fn line_of(&self, part: &str) -> String {
        let text = fs::read_to_string(self.path("case.toml")).unwrap();
        let line = text.lines().position(|line| line.contains(part)).unwrap();
        format!("case.toml:{}: ", line + 1)
    }

    /// Runs the command in the folder.
    pub fn run(&self, args: &[&str]) -> Ran {
        let mut command = Command::new(env!("CARGO_BIN_EXE_bonemill"));
        let Output { status, stdout, stderr } =
            command.args(args).current_dir(self.0.path()).output().unwrap();
        let text = |bytes| String::from_utf8(bytes).unwrap();
        Ran { code: status.code().unwrap(), out: text(stdout), err: text(stderr) }
    }

    /// Plans the case into `plan`. For folders with the same files the plan is made once, then copied.
    pub fn plan(&self) -> Ran {
        /// By the files of a folder, the run and the plan's files.
        type Made = BTreeMap<Files, Arc<OnceLock<(Ran, Files)>>>;
        static MADE: Mutex<Made> = Mutex::new(Made::new());
        let plan = || self.run(&["plan", "case.toml", "--out", "plan"]);
        if self.path("plan").exists() {
            return plan();
        }
        let made = MADE.lock().unwrap().entry(self.files()).or_default().clone();
        let files = || if self.path("plan").exists() { self.files_of("plan") } else { Files::new() };
        let (ran, files) = made.get_or_init(|| (plan(), files()));
        for (name, bytes) in files {
            fs::create_dir_all(self.path("plan")).unwrap();
            fs::write(self.path("plan").join(name), bytes.as_ref().unwrap()).unwrap();
        }
        ran.clone()
    }

    /// Plans the case and verifies the plan, both of which must pass.
    #[track_caller]
    pub fn verified(&self) -> StoredPlan {
        for ran in [self.plan(), self.run(&["verify", "plan"])] {
            assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
        }
        StoredPlan::load(&self.path("plan")).unwrap()
    }

    /// Checks that planning is refused as bad input with these words, and that the folder does not change.
    #[track_caller]
    pub fn refuses(&self, parts: &[&str]) {
        self.refuses_into("plan", parts);
    }

    /// The same check for a given output.
    #[track_caller]
    pub fn refuses_into(&self, out: &str, parts: &[&str]) {
        let before = self.files();
        let ran = self.run(&["plan", "case.toml", "--out", out]);
        ran.refused(parts);
        self.unchanged(&before);
    }

    /// Checks that the case is valid but cannot be fulfilled: exit code 1, the reason, and an unchanged folder.
    #[track_caller]
    pub fn falls_short_of_a_plan(&self, parts: &[&str]) {
        let before = self.files();
        self.run(&["plan", "case.toml", "--out", "plan"]).failed(1, parts);
        self.unchanged(&before);
    }

    #[track_caller]
    fn unchanged(&self, before: &Files) {
        let after = self.files();
        let names = |files: &Files| files.keys().cloned().collect::<Vec<_>>();
        assert_eq!(names(before), names(&after), "what stands in the folder");
        assert!(*before == after, "a file was changed");
    }

    /// Every file and folder with its bytes, including hidden ones.
    pub fn files(&self) -> Files {
        self.files_of(".")
    }

    /// The same of a folder in it, by their paths there.
    fn files_of(&self, name: &str) -> Files {
        let (mut found, root) = (BTreeMap::new(), self.path(name));
        collect(&root, &root, &mut found);
        found
    }
}

fn collect(root: &Path, dir: &Path, found: &mut Files) {
    for entry in fs::read_dir(dir).unwrap() {
        let path = entry.unwrap().path();
        let name = path.strip_prefix(root).unwrap().to_owned();
        if path.is_dir() {
            collect(root, &path, found);
            found.insert(name, None);
        } else {
            found.insert(name, Some(fs::read(&path).unwrap()));
        }
    }
}

impl Ran {
    /// Checks for exit code 2 and one error that contains `parts`.
    #[track_caller]
    pub fn refused(&self, parts: &[&str]) {
        self.failed(2, parts);
    }

    /// Checks for this exit code and one readable error that contains `parts`.
    #[track_caller]
    pub fn failed(&self, code: i32, parts: &[&str]) {
        assert_eq!(self.code, code, "{}{}", self.out, self.err);
        assert_eq!(self.out, "", "an error has nothing to say on stdout");
        assert_eq!(self.err.matches("error:").count(), 1, "told once: {}", self.err);
        for part in parts {
            assert!(self.err.contains(part), "{part:?} is not in {}", self.err);
        }
        for trace in ["panicked", "RUST_BACKTRACE", "Stack backtrace", "Some(", "{ ", "Error("] {
            assert!(!self.err.contains(trace), "{trace:?} in {}", self.err);
        }
    }
}
