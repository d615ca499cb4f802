//! Finds a plan's inputs, and copies them into the plan.
//!
//! `plan.toml` records an input's path, relative to the case file, and its SHA-256. If the plan or the input was moved, the
//! input is searched; only a file with the recorded digest is accepted. The order is: the copy in the plan (`plan --pack`),
//! the recorded path, the folder that the user names (first by file name, then any file with the digest), the plan's folder
//! and its parent. If the copy or the file at the recorded path has other bytes, the input has changed, and neither the
//! plan's folder nor its parent is searched.

use std::fs::{self, File};
use std::io::ErrorKind;
use std::path::{Component, Path, PathBuf};

use super::error::MissingInput;
use super::{Input, PlanFileError, PlanRecord, Sha256, StagedDirectory};

/// The folder in a plan that keeps copies of its inputs.
pub const KEPT: &str = "inputs";
/// Name of the copy of the case file in every plan.
pub const CASE_COPY: &str = "case.toml";

/// Which inputs a reader of a plan needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Need {
    /// All inputs, unchanged.
    All,
    /// Inputs may be missing, but those that are found must be unchanged.
    Unchanged,
    /// None; they are not searched.
    Nothing,
}

/// The places of a plan's inputs.
#[derive(Debug, Clone, PartialEq)]
pub struct FoundInputs {
    /// Each input's path in the case, and the path where it was found.
    found: Vec<(PathBuf, PathBuf)>,
    missing: Vec<MissingInput>,
    plan: PathBuf,
}

impl FoundInputs {
    /// Searches the inputs of the plan in `dir`, also in `folder`.
    ///
    /// # Errors
    /// [`PlanFileError::InputChanged`] unless nothing is needed, [`PlanFileError::InputsMissing`] when all are needed,
    /// [`PlanFileError::Io`] when a file or `folder` cannot be read.
    pub fn search(
        dir: &Path,
        record: &PlanRecord,
        folder: Option<&Path>,
        need: Need,
    ) -> Result<Self, PlanFileError> {
        let mut all = Self { found: Vec::new(), missing: Vec::new(), plan: dir.into() };
        if need == Need::Nothing {
            return Ok(all);
        }
        for input in &record.inputs {
            let search = InputSearch { dir, record, folder, input };
            match search.find()? {
                Some(place) => all.found.push((input.path.clone(), place)),
                None => all.missing.push(MissingInput {
                    recorded: search.recorded(),
                    sha256: input.sha256,
                    bytes: input.bytes,
                }),
            }
        }
        if need == Need::All { all.require().map(|()| all) } else { Ok(all) }
    }

    /// The path where the input that the case names `path` was found, if it was.
    pub fn path(&self, path: &Path) -> Option<&Path> {
        self.found.iter().find(|(name, _)| name == path).map(|(_, place)| place.as_path())
    }

    /// The folder where the inputs below the folder `path` of the case were found, if they were.
    pub fn folder(&self, path: &Path) -> Option<&Path> {
        self.found.iter().find_map(|(name, place)| {
            let rest = name.strip_prefix(path).ok()?;
            place.ancestors().nth(rest.components().count()).filter(|_| place.ends_with(rest))
        })
    }

    /// The inputs that were not found.
    pub fn missing(&self) -> &[MissingInput] {
        &self.missing
    }

    /// Checks that every input was found.
    ///
    /// # Errors
    /// [`PlanFileError::InputsMissing`] unless every input was found.
    pub fn require(&self) -> Result<(), PlanFileError> {
        if self.missing.is_empty() {
            return Ok(());
        }
        Err(PlanFileError::InputsMissing { plan: self.plan.clone(), missing: self.missing.clone() })
    }
}

/// The recorded path of an input of the plan in `dir`: `path` is relative to the folder of `case_file`, and `case_file` to
/// `dir`.
pub(super) fn recorded_path(dir: &Path, case_file: &Path, path: &Path) -> PathBuf {
    let case = dir.join(case_file);
    case.parent().map_or_else(|| path.into(), |folder| folder.join(path))
}

/// The search for one input.
struct InputSearch<'a> {
    dir: &'a Path,
    record: &'a PlanRecord,
    folder: Option<&'a Path>,
    input: &'a Input,
}

impl InputSearch<'_> {
    fn find(&self) -> Result<Option<PathBuf>, PlanFileError> {
        let mut changed = None;
        for place in [self.dir.join(KEPT).join(kept_name(&self.input.path)), self.recorded()] {
            match digest(&place)? {
                Some(found) if found == self.input.sha256 => return Ok(Some(place)),
                Some(found) => changed = changed.or(Some((place, found))),
                None => {}
            }
        }
        if let Some(place) = self.in_folder()? {
            return Ok(Some(place));
        }
        if let Some((path, found)) = changed {
            let (found, expected) = (found.to_string(), self.input.sha256.to_string());
            return Err(PlanFileError::InputChanged { path, found, expected });
        }
        self.near_plan()
    }

    fn recorded(&self) -> PathBuf {
        recorded_path(self.dir, &self.record.case_file, &self.input.path)
    }

    fn is_it(&self, place: &Path) -> Result<bool, PlanFileError> {
        Ok(digest(place)? == Some(self.input.sha256))
    }

    /// Searches the folder that the user names, for the input's name and then for its digest.
    fn in_folder(&self) -> Result<Option<PathBuf>, PlanFileError> {
        let (Some(folder), Some(name)) = (self.folder, self.input.path.file_name()) else { return Ok(None) };
        let named = folder.join(name);
        if self.is_it(&named)? {
            return Ok(Some(named));
        }
        let list = || -> std::io::Result<Vec<(PathBuf, u64)>> {
            let entries: Vec<_> = fs::read_dir(folder)?.collect::<Result<_, _>>()?;
            let sized = |path: PathBuf| fs::metadata(&path).ok().map(|found| (path, found.len()));
            Ok(entries.into_iter().filter_map(|entry| sized(entry.path())).collect())
        };
        let mut files = list().map_err(PlanFileError::io("search", folder))?;
        files.sort();
        let same_size = |size: u64| self.input.bytes.is_none_or(|bytes| bytes == size);
        for (path, _) in files.into_iter().filter(|(_, size)| same_size(*size)) {
            if self.is_it(&path)? {
                return Ok(Some(path));
            }
        }
        Ok(None)
    }

    /// Searches the plan's folder and its parent.
    fn near_plan(&self) -> Result<Option<PathBuf>, PlanFileError> {
        let Some(name) = self.input.path.file_name() else { return Ok(None) };
        let is_case = self.record.case_input() == Some(&self.input.path);
        let copy = is_case.then(|| self.dir.join(CASE_COPY));
        for place in copy.into_iter().chain([self.dir.join(name), self.dir.join("..").join(name)]) {
            if self.is_it(&place)? {
                return Ok(Some(place));
            }
        }
        Ok(None)
    }
}

/// The digest of a file, if there is one at this path.
fn digest(path: &Path) -> Result<Option<Sha256>, PlanFileError> {
    match fs::metadata(path) {
        Ok(found) if found.is_file() => Sha256::of_file(path).map(Some),
        Ok(_) => Ok(None),
        Err(e) if matches!(e.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => Ok(None),
        Err(e) => Err(PlanFileError::io("open", path)(e)),
    }
}

/// An input's path below the folder of copies: the recorded path without the parts that lead out of the folder.
fn kept_name(path: &Path) -> PathBuf {
    path.components().filter(|c| matches!(c, Component::Normal(_))).collect()
}

/// Copies a plan's inputs from their present paths into the staged plan; returns the path of the case's copy.
///
/// # Errors
/// [`PlanFileError::Io`]; [`PlanFileError::InputChanged`] for an input that differs from the one that the plan was made from.
pub fn pack_inputs<'a>(
    inputs: impl IntoIterator<Item = &'a (Input, PathBuf)>,
    case_file: &Path,
    staged: &StagedDirectory,
) -> Result<PathBuf, PlanFileError> {
    let folder = staged.path().join(KEPT);
    for (input, from) in inputs {
        copy_input(from, &folder.join(kept_name(&input.path)), input)?;
    }
    Ok(folder.join(case_file.file_name().unwrap_or_default()))
}

/// Copies an input to a path where no file exists yet; missing folders are made.
pub fn copy_input(from: &Path, to: &Path, input: &Input) -> Result<(), PlanFileError> {
    if let Some(folder) = to.parent() {
        fs::create_dir_all(folder).map_err(PlanFileError::io("create", folder))?;
    }
    let mut source = File::open(from).map_err(PlanFileError::io("read", from))?;
    // an existing file is never overwritten, because it could be the source itself
    let mut target = File::create_new(to).map_err(PlanFileError::io("create", to))?;
    std::io::copy(&mut source, &mut target).map_err(PlanFileError::io("copy", from))?;
    let found = Sha256::of_file(to)?;
    if found == input.sha256 {
        return Ok(());
    }
    let (found, expected) = (found.to_string(), input.sha256.to_string());
    Err(PlanFileError::InputChanged { path: from.into(), found, expected })
}

#[cfg(test)]
#[path = "inputs_tests.rs"]
mod tests;
