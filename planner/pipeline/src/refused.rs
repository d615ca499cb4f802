//! Why a case got no plan, with the line of the case file at which to look: the words of the command and of Python.

use std::error::Error;
use std::fmt;
use std::fs;
use std::path::Path;

use bonemill_case::Case;
use bonemill_imaging::ImageError;
use bonemill_setup::tools;

use crate::PlanError;

/// A planner's error and the place in the case file that it belongs to.
#[derive(Debug)]
pub struct Refused {
    /// `CASE.toml:LINE: ` and the key, or nothing.
    place: String,
    error: PlanError,
    /// What else would help, for this case.
    advice: String,
}

impl Refused {
    /// Looks the place up in the case file.
    pub fn new(error: PlanError, case: &Case, case_path: &Path) -> Self {
        let folder = case_path.parent().unwrap_or(Path::new(""));
        let mut place = match error.key(case, folder) {
            // some errors begin with the key themselves
            Some(key) if error.to_string().starts_with(&key) => format!("{}: ", line(case_path, &key)),
            Some(key) => format!("{}: ", place(case_path, &key)),
            None => String::new(),
        };
        if let PlanError::Image(ImageError::NotHounsfield { .. }) = error {
            place += &format!("{}: ", folder.join(&case.images.ct).display());
        }
        let mut advice = match (&error, case.approach) {
            (PlanError::OutOfReach { .. } | PlanError::NoneReached { .. }, None)
                if case.job.channel().is_none() =>
            {
                ", or give approach.direction: the present one was chosen by the planner".to_owned()
            }
            _ => String::new(),
        };
        // what looks like another unit may be why
        let doubts = if error.is_infeasible() { tools::doubts(case) } else { Vec::new() };
        doubts.iter().for_each(|doubt| advice += &format!("; {doubt}"));
        Self { place, error, advice }
    }

    /// The planner's error, without its place.
    pub fn error(&self) -> &PlanError {
        &self.error
    }

    /// Whether the case is sound, but cannot be fulfilled.
    pub fn falls_short(&self) -> bool {
        self.error.is_infeasible()
    }
}

impl fmt::Display for Refused {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}{}{}", self.place, self.error, self.advice)
    }
}

impl Error for Refused {
    fn source(&self) -> Option<&(dyn Error + 'static)> {
        self.error.source()
    }
}

/// `` CASE.toml:LINE: `key` ``.
pub fn place(case_path: &Path, key: &str) -> String {
    format!("{}: `{key}`", line(case_path, key))
}

/// `CASE.toml:LINE` of a key, else of its table; without a line where neither stands in the file.
fn line(case_path: &Path, key: &str) -> String {
    let text = fs::read_to_string(case_path).unwrap_or_default();
    let line_of = |key: &str| Case::line_of(&text, key);
    let line = line_of(key).or_else(|| line_of(key.rsplit_once('.')?.0));
    let line = line.map_or(String::new(), |line| format!(":{line}"));
    format!("{}{line}", case_path.display())
}
