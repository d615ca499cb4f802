//! Writes a directory whole or not at all.
//!
//! Files are written into a hidden folder beside the target (`.NAME.partial-XXXXXX`) and synced to disk; then the folder is
//! renamed to the target. An existing plan is first renamed to `.NAME.replaced`, and removed when the new one is in place.
//! If anything fails before that, the old plan stays and the hidden folder is removed. A process that is killed leaves
//! either the old plan or the new one, complete: if it is killed between the two renames, the next run finds
//! `.NAME.replaced` and renames it back. A hidden partial folder of a killed process is harmless and may be deleted.

use std::ffi::{OsStr, OsString};
use std::fs::{self, File};
use std::path::{Component, Path, PathBuf};

use tempfile::TempDir;

use super::PlanFileError;
use super::record::is_plan;

/// Entries of a plan's directory. A directory with any other entry is not replaced.
const PLAN_ENTRIES: [&str; 14] = [
    "plan.toml",
    "case.toml",
    "waypoints.csv",
    "forces.csv",
    "trajectory.csv",
    "robot.urdf",
    "report.html",
    "access.csv",
    "dropped.csv",
    "plunge.csv",
    "simulation.csv",
    "verification.toml",
    "phantom",
    "inputs",
];

/// What stands in the folder of a prosthesis.
const PROSTHESIS_ENTRIES: [&str; 8] = [
    "job.toml",
    "part.stl",
    "toolpath.csv",
    "program.nc",
    "trajectory.csv",
    "report.html",
    "verification.toml",
    "phantom",
];

/// What stands in the folder of a scene for 3D Slicer.
const SCENE_ENTRIES: [&str; 11] = [
    "plan.mrml",
    "plan.seg.nrrd",
    "plan.nii.gz",
    "labels.json",
    "cavity.stl",
    "tool.stl",
    "arm_base.stl",
    "path.mrk.json",
    "approach.mrk.json",
    "holds.mrk.json",
    "forces.vtk",
];

/// How the scene's file begins that tells a folder of a scene.
pub const SCENE_HEADER: &str = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<!-- A plan by bonemill";

/// How the file begins that tells a folder of a prosthesis.
pub const PROSTHESIS_HEADER: &str = "# A prosthesis by bonemill.";

/// What the new directory may replace, besides an empty folder.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Replace {
    /// Nothing else.
    Nothing,
    /// A plan.
    Plan,
    /// The folder of a prosthesis.
    Prosthesis,
    /// The folder of a scene for 3D Slicer.
    Scene,
}

impl Replace {
    fn expected(self) -> &'static str {
        match self {
            Self::Nothing => "an empty folder",
            Self::Plan => "a plan",
            Self::Prosthesis => "the folder of a prosthesis",
            Self::Scene => "a folder that `export --format slicer` wrote",
        }
    }

    fn entries(self) -> &'static [&'static str] {
        match self {
            Self::Nothing => &[],
            Self::Plan => &PLAN_ENTRIES,
            Self::Prosthesis => &PROSTHESIS_ENTRIES,
            Self::Scene => &SCENE_ENTRIES,
        }
    }

    /// Whether `dir` is what may be replaced; `Err` says why not.
    fn judge(self, dir: &Path) -> Result<(), String> {
        match self {
            Self::Nothing => Err("it is not empty".into()),
            Self::Plan => is_plan(dir),
            Self::Prosthesis => is_prosthesis(dir),
            Self::Scene => is_scene(dir),
        }
    }
}

/// Whether `dir` holds a `job.toml` of ours; `Err` says why not.
pub fn is_prosthesis(dir: &Path) -> Result<(), String> {
    let text = fs::read_to_string(dir.join("job.toml")).map_err(|_| "it has no readable job.toml")?;
    let ours = text.starts_with(PROSTHESIS_HEADER);
    if ours { Ok(()) } else { Err("its job.toml is not one of ours".into()) }
}

/// Whether `dir` holds a scene of ours; `Err` says why not.
fn is_scene(dir: &Path) -> Result<(), String> {
    let text = fs::read_to_string(dir.join(SCENE_ENTRIES[0])).map_err(|_| "it has no readable plan.mrml")?;
    let ours = text.starts_with(SCENE_HEADER);
    if ours { Ok(()) } else { Err("its plan.mrml is not one of ours".into()) }
}

/// A directory that is being written. If it is dropped without [`StagedDirectory::commit`], it leaves nothing behind.
#[derive(Debug)]
pub struct StagedDirectory {
    /// Removed when dropped.
    _partial: TempDir,
    /// A folder in the temporary one, with the permissions of an ordinary new folder, which a temporary folder does not have.
    inside: PathBuf,
    target: PathBuf,
    replace: Replace,
}

impl StagedDirectory {
    /// Begins to write `target`, which is not changed before the commit. Missing parent folders are made at the commit.
    ///
    /// # Errors
    /// [`PlanFileError::Occupied`] when something else is there, [`PlanFileError::NoName`], [`PlanFileError::WorkingFolder`],
    /// [`PlanFileError::Io`] when the folder around it cannot be written.
    pub fn create(target: &Path, replace: Replace) -> Result<Self, PlanFileError> {
        let target = resolve(target)?;
        // the new folder takes the place of the old one, which whoever works in it would be left in
        if std::env::current_dir().is_ok_and(|here| here.starts_with(&target)) {
            return Err(PlanFileError::WorkingFolder { path: target });
        }
        put_back(&target)?;
        check_vacant(&target, replace)?;
        let home = existing_ancestor(&target);
        let partial = tempfile::Builder::new()
            .prefix(&hidden(&target, ".partial-"))
            .tempdir_in(home)
            .map_err(PlanFileError::io("write into", home))?;
        let inside = partial.path().join("new");
        fs::create_dir(&inside).map_err(PlanFileError::io("create", &inside))?;
        Ok(Self { _partial: partial, inside, target, replace })
    }

    /// The folder into which files are written now.
    pub fn path(&self) -> &Path {
        &self.inside
    }

    /// Writes a file.
    ///
    /// # Errors
    /// [`PlanFileError::Io`].
    pub fn write(&self, name: &str, content: impl AsRef<[u8]>) -> Result<(), PlanFileError> {
        let path = self.inside.join(name);
        fs::write(&path, content).map_err(PlanFileError::io("write", path))
    }

    /// The final directory, absolute.
    pub fn target(&self) -> &Path {
        &self.target
    }

    /// The relative path from the finished directory to an existing file, inside it or elsewhere.
    ///
    /// # Errors
    /// [`PlanFileError::WouldBeLost`] when the file is part of what will be replaced, [`PlanFileError::Io`] when it does
    /// not exist.
    pub fn relative(&self, file: &Path) -> Result<PathBuf, PlanFileError> {
        let file = file.canonicalize().map_err(PlanFileError::io("find", file))?;
        let partial = self.path().canonicalize().map_err(PlanFileError::io("find", self.path()))?;
        Ok(match file.strip_prefix(&partial) {
            Ok(inside) => inside.into(),
            Err(_) if file.starts_with(&self.target) => {
                return Err(PlanFileError::WouldBeLost { path: file, target: self.target.clone() });
            }
            Err(_) => relative(&self.target, &file),
        })
    }

    /// Syncs the files to disk and renames the directory to its final name.
    ///
    /// # Errors
    /// [`PlanFileError::Io`] or [`PlanFileError::Occupied`]; an existing directory is then unchanged.
    pub fn commit(self) -> Result<PathBuf, PlanFileError> {
        sync_tree(self.path())?;
        check_vacant(&self.target, self.replace)?;
        let parent = self.target.parent().unwrap_or(Path::new("/"));
        fs::create_dir_all(parent).map_err(PlanFileError::io("create", parent))?;
        let aside = self.target.with_file_name(hidden(&self.target, ".replaced"));
        let replaces = self.replace.judge(&self.target).is_ok();
        if replaces {
            fs::rename(&self.target, &aside).map_err(PlanFileError::io("set aside", &self.target))?;
        }
        // replaces nothing, or an empty folder
        if let Err(e) = fs::rename(self.path(), &self.target) {
            if replaces {
                fs::rename(&aside, &self.target).map_err(PlanFileError::io("put back", &aside))?;
            }
            return Err(PlanFileError::io("put into place", &self.target)(e));
        }
        sync(parent)?;
        if replaces {
            fs::remove_dir_all(&aside).map_err(PlanFileError::io("remove the replaced plan", &aside))?;
        }
        Ok(self.target)
    }
}

/// The absolute path with links followed, as far as it exists.
fn resolve(target: &Path) -> Result<PathBuf, PlanFileError> {
    if target.exists() {
        let full = target.canonicalize().map_err(PlanFileError::io("find", target))?;
        return if full.file_name().is_some() { Ok(full) } else { Err(PlanFileError::NoName { path: full }) };
    }
    let absolute = std::path::absolute(target).map_err(PlanFileError::io("find", target))?;
    let ancestor = existing_ancestor(&absolute);
    let rest = absolute.strip_prefix(ancestor).unwrap_or(&absolute);
    if rest.components().any(|c| c == Component::ParentDir) {
        return Err(PlanFileError::NoName { path: target.into() });
    }
    Ok(ancestor.canonicalize().map_err(PlanFileError::io("find", ancestor))?.join(rest))
}

fn existing_ancestor(target: &Path) -> &Path {
    target.ancestors().skip(1).find(|a| a.exists()).unwrap_or(Path::new("/"))
}

/// The hidden name `.NAME` with an ending.
fn hidden(target: &Path, ending: &str) -> OsString {
    let mut name = OsString::from(".");
    name.push(target.file_name().unwrap_or(OsStr::new("plan")));
    name.push(ending);
    name
}

/// Restores a plan after a process was killed while it replaced it.
fn put_back(target: &Path) -> Result<(), PlanFileError> {
    let aside = target.with_file_name(hidden(target, ".replaced"));
    let ours =
        [Replace::Plan, Replace::Prosthesis, Replace::Scene].iter().any(|kind| kind.judge(&aside).is_ok());
    if !aside.exists() || !ours {
        return Ok(());
    }
    if target.exists() {
        return fs::remove_dir_all(&aside).map_err(PlanFileError::io("remove the replaced plan", &aside));
    }
    fs::rename(&aside, target).map_err(PlanFileError::io("put back", &aside))
}

fn check_vacant(target: &Path, replace: Replace) -> Result<(), PlanFileError> {
    let occupied =
        |why: String| PlanFileError::Occupied { path: target.into(), expected: replace.expected(), why };
    if fs::symlink_metadata(target).is_err() {
        return Ok(());
    }
    if !target.is_dir() {
        return Err(occupied("it is not a folder".into()));
    }
    let entries = fs::read_dir(target).map_err(PlanFileError::io("list", target))?;
    let names: Result<Vec<_>, _> = entries.map(|e| e.map(|e| e.file_name())).collect();
    let mut names = names.map_err(PlanFileError::io("list", target))?;
    if names.is_empty() {
        return Ok(());
    }
    names.sort();
    replace.judge(target).map_err(occupied)?;
    match names
        .iter()
        .find(|name| !replace.entries().iter().any(|known| OsStr::new(known) == name.as_os_str()))
    {
        Some(own) => Err(occupied(format!("it also holds {}, which would be lost", own.display()))),
        None => Ok(()),
    }
}

/// The relative path from an existing folder to an existing file or folder. A link at the path's end is kept, since files beside it may
/// count.
///
/// # Errors
/// [`PlanFileError::Io`] when one of them does not exist.
pub fn relative_path(from: &Path, to: &Path) -> Result<PathBuf, PlanFileError> {
    let find = |path: &Path| path.canonicalize().map_err(PlanFileError::io("find", path));
    let whole = find(to)?;
    let here = Path::new(".");
    let or_here =
        |path: &'_ Path| if path.as_os_str().is_empty() { here.to_owned() } else { path.to_owned() };
    let named = match (to.parent(), to.file_name()) {
        (Some(parent), Some(name)) => find(&or_here(parent))?.join(name),
        _ => whole,
    };
    Ok(relative(&find(&or_here(from))?, &named))
}

/// The relative path from folder `from` to `to`, both absolute.
fn relative(from: &Path, to: &Path) -> PathBuf {
    let common = from.components().zip(to.components()).take_while(|(a, b)| a == b).count();
    let up = from.components().skip(common).map(|_| Component::ParentDir);
    up.chain(to.components().skip(common)).collect()
}

fn sync(path: &Path) -> Result<(), PlanFileError> {
    File::open(path).and_then(|f| f.sync_all()).map_err(PlanFileError::io("make durable", path))
}

fn sync_tree(dir: &Path) -> Result<(), PlanFileError> {
    for entry in fs::read_dir(dir).map_err(PlanFileError::io("list", dir))? {
        let path = entry.map_err(PlanFileError::io("list", dir))?.path();
        if path.is_dir() { sync_tree(&path)? } else { sync(&path)? }
    }
    sync(dir)
}

#[cfg(test)]
#[path = "directory_tests.rs"]
mod tests;
