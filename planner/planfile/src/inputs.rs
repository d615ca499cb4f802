//! Where a plan's inputs are now, and copies of them in the plan.
//!
//! `plan.toml` records an input's path, relative to the case file, and its SHA-256. A plan that was moved or sent finds it
//! elsewhere; only a file with the recorded digest is taken. In this order: the copy kept in the plan (`plan --pack`), the
//! recorded path, the folder that the user names (by file name, else whichever file has the digest), the plan's folder and
//! the one around it. Where the copy or the recorded path holds other bytes, the input has changed, and neither the plan's
//! folder nor the one around it is searched.

use std::fs::{self, File};
use std::io::ErrorKind;
use std::path::{Component, Path, PathBuf};

use super::error::MissingInput;
use super::{Input, PlanFileError, PlanRecord, Sha256, StagedDirectory};

/// The folder in a plan that keeps copies of its inputs.
const KEPT: &str = "inputs";
/// The copy of the case file that every plan holds.
pub const CASE_COPY: &str = "case.toml";

/// What a reader of a plan needs of its inputs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Need {
    /// All of them, unchanged.
    All,
    /// That those which are found are unchanged.
    Unchanged,
    /// Nothing: they are not looked for.
    Nothing,
}

/// Where a plan's inputs are.
#[derive(Debug, Clone, PartialEq)]
pub struct FoundInputs {
    /// Path as the case names it, and where the file is.
    found: Vec<(PathBuf, PathBuf)>,
    missing: Vec<MissingInput>,
    plan: PathBuf,
}

impl FoundInputs {
    /// Looks for the inputs of the plan in `dir`, also in `folder`.
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

    /// Where the input is that the case names `path`, if it was found.
    pub fn path(&self, path: &Path) -> Option<&Path> {
        self.found.iter().find(|(name, _)| name == path).map(|(_, place)| place.as_path())
    }

    /// The inputs that were not found.
    pub fn missing(&self) -> &[MissingInput] {
        &self.missing
    }

    /// # Errors
    /// [`PlanFileError::InputsMissing`] unless every input was found.
    pub fn require(&self) -> Result<(), PlanFileError> {
        if self.missing.is_empty() {
            return Ok(());
        }
        Err(PlanFileError::InputsMissing { plan: self.plan.clone(), missing: self.missing.clone() })
    }
}

/// Where an input of the plan in `dir` lies by its record: `path` is relative to the folder of `case_file`, that to `dir`.
pub(super) fn recorded_path(dir: &Path, case_file: &Path, path: &Path) -> PathBuf {
    let case = dir.join(case_file);
    case.parent().map_or_else(|| path.into(), |folder| folder.join(path))
}

/// One input that is looked for.
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

    /// In the folder that the user names, under its own name or any other.
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

    /// In the plan's folder or the one around it.
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

/// An input's path below the folder of copies: the recorded one without what leads out of it.
fn kept_name(path: &Path) -> PathBuf {
    path.components().filter(|c| matches!(c, Component::Normal(_))).collect()
}

/// Copies a plan's inputs, each from where it is now, into the staged plan; gives the case's copy.
///
/// # Errors
/// [`PlanFileError::Io`]; [`PlanFileError::InputChanged`] for a copy that is not what the plan was made from.
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

/// Copies an input to where there is no file yet; folders on the way are made.
pub fn copy_input(from: &Path, to: &Path, input: &Input) -> Result<(), PlanFileError> {
    if let Some(folder) = to.parent() {
        fs::create_dir_all(folder).map_err(PlanFileError::io("create", folder))?;
    }
    let mut source = File::open(from).map_err(PlanFileError::io("read", from))?;
    // never over a file: it could be the source itself
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
