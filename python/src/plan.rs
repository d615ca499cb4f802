//! A plan: made here or read back, the same to Python.

use std::fs::File;
use std::path::{Component, Path, PathBuf};

use bonemill_planner::Plan as RustPlan;
use bonemill_planner::case::Structure;
use bonemill_planner::plan::{
    self as files, ForceToward, PlanFileError, PlanRecord, Refused, Replace, StagedDirectory, StoredPlan,
    Waypoint,
};
use bonemill_robot::{Arm, JointKind, RobotError};
use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::case::Case;
use crate::{apart, errors, values, waypoints};

/// Where a case's own files go in a plan that keeps them.
const INPUTS_DIR: &str = "inputs";

/// Where a plan's content comes from.
enum Body {
    /// Planned by this process.
    Made(Box<RustPlan>),
    /// Read from its files.
    Read(Box<StoredPlan>),
}

/// A plan in memory.
#[pyclass(frozen, module = "bonemill._native")]
pub struct Plan {
    body: Body,
    record: PlanRecord,
    case_path: PathBuf,
}

/// Plans a case; `progress(stage, done, of)` is told how far it is.
#[pyfunction]
pub fn plan(
    py: Python<'_>,
    case: &Case,
    progress: Option<Py<PyAny>>,
    threads: Option<usize>,
) -> PyResult<Plan> {
    let (case, case_path) = (case.case.clone(), case.path.clone());
    let path = case_path.clone();
    let made = apart::run(py, progress, threads, move |progress| {
        bonemill_planner::plan(&case, &path, progress).map_err(|e| Box::new(Refused::new(e, &case, &path)))
    })?;
    let made = Box::new(made.map_err(|e| errors::refused(&e))?);
    let record = files::record(&made, case_path.clone());
    Ok(Plan { body: Body::Made(made), record, case_path })
}

impl Plan {
    fn waypoints(&self) -> &[Waypoint] {
        match &self.body {
            Body::Made(plan) => &plan.waypoints,
            Body::Read(plan) => &plan.waypoints,
        }
    }

    fn forces(&self) -> &[ForceToward] {
        match &self.body {
            Body::Made(plan) => &plan.forces,
            Body::Read(plan) => &plan.forces,
        }
    }

    fn arm(&self) -> &Arm {
        match &self.body {
            Body::Made(plan) => &plan.arm,
            Body::Read(plan) => &plan.arm,
        }
    }

    /// The folder that it was read from, and what stood there; none for a plan of this process.
    pub fn home(&self) -> Option<(PathBuf, &PlanRecord)> {
        match &self.body {
            Body::Made(_) => None,
            Body::Read(plan) => Some((plan.dir.clone(), &self.record)),
        }
    }

    fn structures(&self) -> &[Structure] {
        &self.record.case.structures
    }

    /// Rows time, q, qd, as they stand in `trajectory.csv`.
    fn rows(&self) -> Result<Array2<f64>, RobotError> {
        match &self.body {
            Body::Made(plan) => sampled(plan),
            Body::Read(plan) => {
                let t = &plan.trajectory;
                Ok(Array2::from_shape_fn((t.len(), 1 + 2 * t.dof), |(row, column)| match column {
                    0 => t.time_s[row],
                    n if n <= t.dof => t.q[row * t.dof + n - 1],
                    n => t.qd[row * t.dof + n - 1 - t.dof],
                }))
            }
        }
    }
}

/// The law at the controller's rate, to the decimals of the file.
fn sampled(plan: &RustPlan) -> Result<Array2<f64>, RobotError> {
    let rows = plan.law.rows(plan.case.robot.rate_hz)?;
    let dof = rows.dof();
    let scale: Vec<f64> = plan.arm.joints().iter().map(|j| scale(j.kind)).collect();
    let count = usize::try_from(rows.count()).unwrap_or(usize::MAX);
    let mut all = Array2::zeros((count, 1 + 2 * dof));
    rows.for_each(0..rows.count(), |row, q, qd| {
        let mut out = all.row_mut(row as usize);
        out[0] = to_decimals(rows.time_s(row), 1e9);
        for joint in 0..dof {
            out[1 + joint] = to_decimals(q[joint], scale[joint]);
            out[1 + dof + joint] = to_decimals(qd[joint], scale[joint]);
        }
    });
    Ok(all)
}

/// One over the file's resolution: 1e-7 mm, 1e-9 rad.
fn scale(kind: JointKind) -> f64 {
    match kind {
        JointKind::Prismatic => 1e7,
        JointKind::Revolute => 1e9,
    }
}

/// The number that the file's decimals read back as; never −0.
fn to_decimals(value: f64, scale: f64) -> f64 {
    (value * scale).round_ties_even() / scale + 0.0
}

#[pymethods]
impl Plan {
    /// Reads the plan in a folder.
    #[staticmethod]
    fn load(py: Python<'_>, dir: PathBuf) -> PyResult<Self> {
        let stored = apart::run(py, None, None, move |_| StoredPlan::load(&dir))?;
        let stored = Box::new(stored.map_err(|e| errors::file(&e))?);
        let (record, case_path) = (stored.record.clone(), stored.case_path());
        Ok(Self { body: Body::Read(stored), record, case_path })
    }

    /// Writes the plan's folder, whole or not at all; gives its absolute path.
    ///
    /// `keep_inputs`: the case and its images are copied into the plan.
    fn save(&self, py: Python<'_>, out: PathBuf, keep_inputs: bool) -> PyResult<PathBuf> {
        py.detach(|| self.write(&out, keep_inputs)).map_err(|e| errors::file(&e))
    }

    /// Whether it was read from a folder, its own.
    fn has_folder(&self) -> bool {
        self.home().is_some()
    }

    /// The case's file.
    fn case_path(&self) -> &Path {
        &self.case_path
    }

    /// The resolved case as TOML.
    fn case_toml(&self) -> String {
        self.record.case.to_toml()
    }

    /// Numeric columns of `waypoints.csv` by name, in order; NaN where a cell is empty.
    fn columns<'py>(&self, py: Python<'py>) -> Vec<(&'static str, Bound<'py, PyArray1<f64>>)> {
        waypoints::numbers(py, self.waypoints())
    }

    /// Layer, kind (place in `kinds`) and structure (place in the case, −1: none) of every waypoint.
    fn codes<'py>(&self, py: Python<'py>) -> waypoints::Codes<'py> {
        waypoints::codes(py, self.waypoints())
    }

    /// Waypoints, structures (places in the case) and numeric columns of `forces.csv`, in order; NaN where a cell is empty.
    fn force_columns<'py>(&self, py: Python<'py>) -> waypoints::Forces<'py> {
        waypoints::forces(py, self.forces())
    }

    /// Words of the kinds of moves.
    #[staticmethod]
    fn kinds() -> Vec<&'static str> {
        waypoints::kinds()
    }

    /// Name, clearance (mm) and priority of the case's structures.
    fn structure_rows(&self) -> Vec<(String, f64, u32)> {
        self.structures().iter().map(|s| (s.name.clone(), s.clearance_mm, s.priority)).collect()
    }

    /// Rows time_s, q1..qn, qd1..qdn, as they stand in `trajectory.csv`.
    fn trajectory<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let rows = py.detach(|| self.rows()).map_err(|e| errors::robot(&e))?;
        Ok(rows.into_pyarray(py))
    }

    /// Figures.
    fn metrics<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        values::dict(py, &self.record.metrics.entries())
    }

    /// What was modelled where.
    fn modelled<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        values::dict(py, &self.record.modelled)
    }

    /// Why the plan falls short, and what the user should know.
    fn words(&self) -> (Vec<String>, Vec<String>) {
        (self.record.shortfalls.clone(), self.record.warnings.clone())
    }

    /// Whether the case says nothing of where the arm stands.
    fn registration_assumed(&self) -> bool {
        self.record.registration_assumed
    }

    /// Wall-clock seconds by stage; none for a plan that was read.
    fn seconds(&self) -> Vec<(&'static str, f64)> {
        match &self.body {
            Body::Made(plan) => plan.seconds.clone(),
            Body::Read(_) => Vec::new(),
        }
    }

    /// The arm.
    fn robot(&self) -> crate::arm::Arm {
        crate::arm::Arm(self.arm().clone())
    }
}

impl Plan {
    fn write(&self, out: &Path, keep_inputs: bool) -> Result<PathBuf, PlanFileError> {
        let staged = StagedDirectory::create(out, Replace::Plan)?;
        let kept = match (&self.body, keep_inputs) {
            (_, true) => Some(self.copy_inputs(&staged.path().join(INPUTS_DIR))?),
            (Body::Read(plan), false) => self.copy_own_inputs(plan, staged.path())?,
            (Body::Made(_), false) => None,
        };
        let case_path = kept.as_deref().unwrap_or(&self.case_path);
        match &self.body {
            Body::Made(plan) => {
                files::save(plan, case_path, &staged)?;
            }
            Body::Read(plan) => {
                for name in files::FILES {
                    copy(&plan.dir.join(name), &staged.path().join(name))?;
                }
                for name in files::NOTES.into_iter().filter(|name| plan.dir.join(name).exists()) {
                    copy(&plan.dir.join(name), &staged.path().join(name))?;
                }
                let mut record = self.record.clone();
                record.case_file = staged.relative(case_path)?;
                record.write(staged.path())?;
            }
        }
        staged.commit()
    }

    /// Copies the case and everything that it names into `to`; gives the case's copy.
    fn copy_inputs(&self, to: &Path) -> Result<PathBuf, PlanFileError> {
        let mut case_file = to.to_owned();
        for input in self.record.inputs.iter().filter(|input| stays_inside(&input.path)) {
            let from = files::input_path(Path::new(""), &self.case_path, &input.path);
            let copied = to.join(&input.path);
            copy(&from, &copied)?;
            if Some(input.path.as_os_str()) == self.case_path.file_name() {
                case_file = copied;
            }
        }
        Ok(case_file)
    }

    /// A plan that was read may hold its own inputs: they move with it.
    fn copy_own_inputs(&self, plan: &StoredPlan, to: &Path) -> Result<Option<PathBuf>, PlanFileError> {
        if !stays_inside(&self.record.case_file) {
            return Ok(None);
        }
        let case_file = to.join(&self.record.case_file);
        for input in self.record.inputs.iter().filter(|input| stays_inside(&input.path)) {
            let from = files::input_path(&plan.dir, &self.record.case_file, &input.path);
            copy(&from, &files::input_path(to, &self.record.case_file, &input.path))?;
        }
        Ok(Some(case_file))
    }
}

/// Whether a path leads nowhere but into the folder that it is relative to.
fn stays_inside(path: &Path) -> bool {
    path.components().all(|c| matches!(c, Component::Normal(_)))
}

/// Copies a file to where there is none; folders on the way are made.
fn copy(from: &Path, to: &Path) -> Result<(), PlanFileError> {
    let failed = |doing, path: &Path| {
        let path = path.to_owned();
        move |source| PlanFileError::Io { doing, path, source }
    };
    if let Some(folder) = to.parent() {
        std::fs::create_dir_all(folder).map_err(failed("create", folder))?;
    }
    let mut source = File::open(from).map_err(failed("read", from))?;
    // never over a file: it could be the source itself
    let mut target = File::create_new(to).map_err(failed("create", to))?;
    std::io::copy(&mut source, &mut target).map(drop).map_err(failed("copy", from))
}
