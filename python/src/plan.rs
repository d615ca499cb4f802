//! A plan, computed in this process or read from a folder, with the same interface for Python.

use std::path::{Component, Path, PathBuf};

use bonemill_geometry::{Frame, Rigid};
use bonemill_planner::case::Structure;
use bonemill_planner::channel::{self, ChannelPlan};
use bonemill_planner::pipeline::{Refused, record};
use bonemill_planner::plan::{
    self as files, ForceToward, Input, Need, PlanFileError, PlanRecord, Replace, StagedDirectory, StoredPlan,
    Waypoint,
};
use bonemill_planner::report::CtSlices;
use bonemill_planner::{Plan as RustPlan, Setup};
use bonemill_planner::{save, stages};
use bonemill_robot::timelaw::TimeLaw;
use bonemill_robot::{Arm, JointKind, RobotError};
use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::case::Case;
use crate::{apart, errors, values, waypoints};

/// The source of a plan's content.
enum Body {
    /// Milled bone, computed by this process.
    Made(Box<RustPlan>),
    /// A channel, computed by this process.
    Channel(Box<ChannelPlan>),
    /// Read from its files.
    Read(Box<StoredPlan>),
}

/// A plan in memory.
#[pyclass(frozen, module = "bonemill._native")]
pub struct Plan {
    body: Body,
    record: PlanRecord,
    case_path: PathBuf,
    /// A further folder in which inputs are searched.
    inputs_folder: Option<PathBuf>,
}

/// Plans a case; `progress(stage, done, of)` receives the progress.
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
        let refuse = |error| Box::new(Refused::new(error, &case, &path));
        Ok(match case.job.channel() {
            Some(spec) => {
                progress.expect(stages::CHANNEL);
                let plan = channel::plan(&case, spec, &path, progress).map_err(refuse)?;
                (channel::record(&plan, path.clone()), Body::Channel(Box::new(plan)))
            }
            None => {
                progress.expect(stages::PLAN);
                let plan = bonemill_planner::plan(&case, &path, progress).map_err(refuse)?;
                (record(&plan, path.clone()), Body::Made(Box::new(plan)))
            }
        })
    })?;
    let (record, body) = made.map_err(|e: Box<Refused>| errors::refused(&e))?;
    Ok(Plan { body, record, case_path, inputs_folder: None })
}

impl Plan {
    fn waypoints(&self) -> &[Waypoint] {
        match &self.body {
            Body::Made(plan) => &plan.moves.waypoints,
            Body::Channel(plan) => &plan.waypoints,
            Body::Read(plan) => &plan.waypoints,
        }
    }

    fn forces(&self) -> &[ForceToward] {
        match &self.body {
            Body::Made(plan) => &plan.moves.forces,
            Body::Channel(plan) => &plan.forces,
            Body::Read(plan) => &plan.forces,
        }
    }

    fn arm(&self) -> &Arm {
        match &self.body {
            Body::Made(plan) => &plan.setup.arm,
            Body::Channel(plan) => &plan.setup.arm,
            Body::Read(plan) => &plan.arm,
        }
    }

    /// The folder from which it was read, and its record; `None` for a plan of this process.
    pub fn home(&self) -> Option<(PathBuf, &PlanRecord)> {
        match &self.body {
            Body::Made(_) | Body::Channel(_) => None,
            Body::Read(plan) => Some((plan.dir.clone(), &self.record)),
        }
    }

    /// A further folder in which its inputs are searched.
    pub fn inputs_folder(&self) -> Option<PathBuf> {
        self.inputs_folder.clone()
    }

    fn structures(&self) -> &[Structure] {
        &self.record.case.structures
    }

    /// Rows of time, q, qd, with the values of `trajectory.csv`.
    fn rows(&self) -> Result<Array2<f64>, RobotError> {
        match &self.body {
            Body::Made(plan) => sampled(&plan.setup, &plan.moves.law),
            Body::Channel(plan) => sampled(&plan.setup, &plan.motion.law),
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

/// The law at the controller's rate, rounded to the decimals of the file.
fn sampled(setup: &Setup, law: &TimeLaw) -> Result<Array2<f64>, RobotError> {
    let rows = law.rows(setup.case.robot.rate_hz)?;
    let dof = rows.dof();
    let scale: Vec<f64> = setup.arm.joints().iter().map(|j| scale(j.kind)).collect();
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

/// The reciprocal of the file's resolution, which is 1e-7 mm or 1e-9 rad.
fn scale(kind: JointKind) -> f64 {
    match kind {
        JointKind::Prismatic => 1e7,
        JointKind::Revolute => 1e9,
    }
}

/// The value after writing with the file's decimals and reading it back; never −0.
fn to_decimals(value: f64, scale: f64) -> f64 {
    (value * scale).round_ties_even() / scale + 0.0
}

#[pymethods]
impl Plan {
    /// Reads the plan in a folder; its inputs are also searched in `inputs`, and may be missing.
    #[staticmethod]
    fn load(py: Python<'_>, dir: PathBuf, inputs: Option<PathBuf>) -> PyResult<Self> {
        let folder = inputs.clone();
        let read = move |_: &dyn bonemill_planner::Progress| {
            StoredPlan::load_with(&dir, folder.as_deref(), Need::Unchanged)
        };
        let stored = apart::run(py, None, None, read)?;
        let stored = Box::new(stored.map_err(|e| errors::file(&e))?);
        let (record, case_path) = (stored.record.clone(), stored.case_path());
        Ok(Self { body: Body::Read(stored), record, case_path, inputs_folder: inputs })
    }

    /// Writes the plan's folder, whole or not at all; returns its absolute path.
    ///
    /// `kept`: whether all inputs are copied into the plan, and whether those that lie in the case's folder are; `slices`: whether the
    /// report holds slices of the CT.
    fn save(&self, py: Python<'_>, out: PathBuf, kept: (bool, bool), slices: bool) -> PyResult<PathBuf> {
        let (pack, own) = kept;
        let ct_slices = if slices { CtSlices::Shown } else { CtSlices::LeftOut };
        py.detach(|| self.write(&out, pack, own, ct_slices)).map_err(|e| errors::file(&e))
    }

    /// The inputs that were not found, with digests.
    fn missing_inputs(&self) -> Vec<String> {
        match &self.body {
            Body::Made(_) | Body::Channel(_) => Vec::new(),
            Body::Read(plan) => plan.inputs.missing().iter().map(ToString::to_string).collect(),
        }
    }

    /// The folder from which it was read.
    #[pyo3(name = "home")]
    fn folder(&self) -> Option<PathBuf> {
        self.home().map(|(dir, _)| dir)
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

    /// Layer, kind (index in `kinds`) and structure (index in the case, −1 for none) of every waypoint.
    fn codes<'py>(&self, py: Python<'py>) -> waypoints::Codes<'py> {
        waypoints::codes(py, self.waypoints())
    }

    /// Waypoints, structures (indices in the case) and numeric columns of `forces.csv`, in order; NaN where a cell is empty.
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

    /// Rows of time_s, q1..qn, qd1..qdn, with the values of `trajectory.csv`.
    fn trajectory<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let rows = py.detach(|| self.rows()).map_err(|e| errors::robot(&e))?;
        Ok(rows.into_pyarray(py))
    }

    /// The plan's figures.
    fn metrics<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        values::dict(py, &self.record.metrics.entries())
    }

    /// What was modelled.
    fn modelled<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        values::dict(py, &self.record.modelled)
    }

    /// Shortfalls and warnings.
    fn words(&self) -> (Vec<String>, Vec<String>) {
        (self.record.shortfalls.clone(), self.record.warnings.clone())
    }

    /// Whether the case gives no registration, so that one is assumed.
    fn registration_assumed(&self) -> bool {
        self.record.frames.registration_assumed
    }

    /// Wall-clock seconds by stage; empty for a plan that was read.
    fn seconds(&self) -> Vec<(&'static str, f64)> {
        match &self.body {
            Body::Made(plan) => plan.seconds.clone(),
            Body::Channel(plan) => plan.seconds.clone(),
            Body::Read(_) => Vec::new(),
        }
    }

    /// The frames by name, 4 × 4 each.
    fn frames<'py>(&self, py: Python<'py>) -> Vec<(&'static str, Bound<'py, PyArray2<f64>>)> {
        let record = &self.record;
        let mut frames = vec![
            ("ct_from_work", homogeneous(&record.frames.ct_from_approach)),
            ("ct_from_grid", homogeneous(&record.frames.ct_from_grid())),
            ("base_from_ct", homogeneous(&record.frames.base_from_ct)),
        ];
        let mount = self.arm().mount().tool();
        frames.extend(mount.map(|mount| ("flange_from_burr", homogeneous(&mount.flange_from_burr))));
        frames.into_iter().map(|(name, frame)| (name, frame.into_pyarray(py))).collect()
    }

    /// Numbers of voxels of the planning grid along its axes, and their side, mm.
    fn grid(&self) -> ([usize; 3], f64) {
        (self.record.frames.grid.dims, self.record.case.grid.spacing_mm)
    }

    /// The arm.
    fn robot(&self) -> crate::arm::Arm {
        crate::arm::Arm(self.arm().clone())
    }
}

impl Plan {
    fn write(
        &self,
        out: &Path,
        pack: bool,
        own: bool,
        ct_slices: CtSlices,
    ) -> Result<PathBuf, PlanFileError> {
        let staged = StagedDirectory::create(out, Replace::Plan)?;
        let kept = self.kept_inputs(pack, own)?;
        let packed = (!kept.is_empty()).then(|| files::pack_inputs(&kept, &self.record.case_file, &staged));
        let packed = packed.transpose()?;
        let case_path = packed.as_deref().unwrap_or(&self.case_path);
        match &self.body {
            Body::Made(plan) => {
                save::plan(plan, case_path, &staged, ct_slices)?;
            }
            Body::Channel(plan) => {
                save::channel(plan, case_path, &staged, ct_slices)?;
            }
            Body::Read(plan) => {
                files::copy_files(plan, &staged)?;
                let mut record = self.record.clone();
                let recorded = plan.dir.join(&record.case_file);
                // the place of a case is known only if it is packed or still at its recorded path
                if let Some(case_path) = packed.or(recorded.exists().then_some(recorded)) {
                    record.case_file = staged.relative(&case_path)?;
                }
                record.write(staged.path())?;
            }
        }
        staged.commit()
    }

    /// The inputs that are copied into the saved plan, and their present paths: all, or those in the case's folder; for a plan that
    /// was read and contains its case, those that it contains.
    fn kept_inputs(&self, pack: bool, own: bool) -> Result<Vec<(Input, PathBuf)>, PlanFileError> {
        let made = |setup: &Setup| {
            let kept = |(input, _): &&(Input, PathBuf)| pack || (own && stays_inside(&input.path));
            Ok(setup.inputs.iter().filter(kept).cloned().collect())
        };
        match &self.body {
            Body::Made(plan) => made(&plan.setup),
            Body::Channel(plan) => made(&plan.setup),
            Body::Read(plan) if pack || stays_inside(&self.record.case_file) => {
                let mut kept = plan.all_inputs()?;
                kept.retain(|(_, place)| pack || place.starts_with(&plan.dir));
                Ok(kept)
            }
            Body::Read(_) => Ok(Vec::new()),
        }
    }
}

/// A rigid motion as a 4 × 4 matrix.
fn homogeneous<A: Frame, B: Frame>(a_from_b: &Rigid<A, B>) -> Array2<f64> {
    let (turn, shift) = (a_from_b.rotation.matrix(), a_from_b.translation_mm);
    Array2::from_shape_fn((4, 4), |(row, column)| match (row, column) {
        (3, 3) => 1.0,
        (3, _) => 0.0,
        (_, 3) => shift[row],
        _ => turn[(row, column)],
    })
}

/// Whether a relative path stays inside the folder to which it is relative.
fn stays_inside(path: &Path) -> bool {
    path.components().all(|c| matches!(c, Component::Normal(_)))
}
