//! Arms: kinematics of many joint vectors at once.

use bonemill_geometry::{Base, Flange, Rigid};
use bonemill_robot::{Arm as RustArm, arm::load};
use nalgebra::{Matrix3, Vector3};
use numpy::ndarray::{Array2, Array3};
use numpy::{IntoPyArray, PyArray2, PyArray3, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::errors;

/// Name, kind (prismatic or revolute), lower, upper, velocity limit, acceleration limit.
type JointRow = (String, &'static str, f64, f64, f64, f64);

/// A serial arm.
#[pyclass(frozen, module = "bonemill._native")]
pub struct Arm(pub RustArm);

#[pymethods]
impl Arm {
    /// The arm with this name, else the arm of the URDF at this path.
    #[new]
    fn new(model: &str) -> PyResult<Self> {
        Ok(Self(load(model).map_err(|e| errors::robot(&e))?))
    }

    /// The moving joints from base to tip.
    fn joints(&self) -> Vec<JointRow> {
        let row = |j: &bonemill_robot::Joint| {
            let kind = match j.kind {
                bonemill_robot::JointKind::Prismatic => "prismatic",
                bonemill_robot::JointKind::Revolute => "revolute",
            };
            (j.name.clone(), kind, j.lower, j.upper, j.velocity_limit, j.acceleration_limit)
        };
        self.0.joints().iter().map(row).collect()
    }

    /// The URDF's text.
    fn urdf(&self) -> &str {
        self.0.urdf_text()
    }

    /// Pose of the flange in base for each row of `q`, shape (n, 4, 4), mm.
    fn fk<'py>(&self, py: Python<'py>, q: PyReadonlyArray2<'py, f64>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let q = rows(&q);
        let mut poses = Array3::zeros((q.nrows(), 4, 4));
        for (n, q) in q.outer_iter().enumerate() {
            let pose = self.0.forward(&q.to_vec()).map_err(|e| errors::robot(&e))?;
            for r in 0..3 {
                for c in 0..3 {
                    poses[(n, r, c)] = pose.rotation[(r, c)];
                }
                poses[(n, r, 3)] = pose.translation_mm[r];
            }
            poses[(n, 3, 3)] = 1.0;
        }
        Ok(poses.into_pyarray(py))
    }

    /// Every joint vector that brings the flange to a pose (rotation by rows, translation in mm), shape (n, dof).
    fn ik<'py>(
        &self,
        py: Python<'py>,
        rotation: [[f64; 3]; 3],
        translation_mm: [f64; 3],
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let matrix = Matrix3::from_fn(|r, c| rotation[r][c]);
        let base_from_flange: Rigid<Base, Flange> =
            Rigid::from_matrix(&matrix, Vector3::from(translation_mm))
                .map_err(|e| errors::RobotError::new_err(format!("pose: {e}")))?;
        let work_from_tool = self.0.mount().work_from_tool(base_from_flange);
        let found = self.0.inverse(&work_from_tool).map_err(|e| errors::robot(&e))?;
        let q = Array2::from_shape_fn((found.q.len(), self.0.dof()), |(n, j)| found.q[n][j]);
        Ok(q.into_pyarray(py))
    }

    /// Geometric Jacobian at the flange for each row of `q`, shape (n, 6, dof).
    fn jacobian<'py>(
        &self,
        py: Python<'py>,
        q: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let q = rows(&q);
        let mut all = Array3::zeros((q.nrows(), 6, self.0.dof()));
        for (n, q) in q.outer_iter().enumerate() {
            let jacobian = self.0.jacobian(&q.to_vec()).map_err(|e| errors::robot(&e))?;
            for r in 0..6 {
                for c in 0..self.0.dof() {
                    all[(n, r, c)] = jacobian[(r, c)];
                }
            }
        }
        Ok(all.into_pyarray(py))
    }

    /// Compliance at the flange for each row of `q`, shape (n, 3, 3), mm/N.
    fn compliance<'py>(
        &self,
        py: Python<'py>,
        q: PyReadonlyArray2<'py, f64>,
        joint_stiffness: Vec<f64>,
    ) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let q = rows(&q);
        let mut all = Array3::zeros((q.nrows(), 3, 3));
        for (n, q) in q.outer_iter().enumerate() {
            let found = self.0.compliance(&q.to_vec(), &joint_stiffness).map_err(|e| errors::robot(&e))?;
            for r in 0..3 {
                for c in 0..3 {
                    all[(n, r, c)] = found[(r, c)];
                }
            }
        }
        Ok(all.into_pyarray(py))
    }
}

/// A copy in C order, so that rows are slices; it may have no rows.
fn rows(q: &PyReadonlyArray2<'_, f64>) -> Array2<f64> {
    let view = q.as_array();
    Array2::from_shape_vec(view.dim(), view.iter().copied().collect()).unwrap_or_default()
}
