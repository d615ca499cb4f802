//! Where the patient is, seen from the arm: given, fitted to fiducials or assumed, and how far that can be trusted.

use bonemill_arm::registration::{Fitted, fit};
use bonemill_case::{Case, Registration, RobotSpec};
use bonemill_geometry::{Base, Ct, Grid, Point, Rigid};
use bonemill_toolpath::scene::Scene;
use nalgebra::Vector3;

use super::{PlanError, tools};

/// A fiducial may lie this far beyond the scan's outermost voxel boxes, voxels: the rounding of its coordinates.
const BEYOND_VOXELS: f64 = 1.0;

/// Where the patient is, and how well that is known.
#[derive(Debug, Clone, PartialEq)]
pub struct Registered {
    /// p_base = R p_ct + t.
    pub base_from_ct: Rigid<Base, Ct>,
    /// The fit, where the case gives fiducials, and its expected error at each structure (at its point nearest to the
    /// target's centre), mm; `None` for a structure too far away to matter.
    pub fitted: Option<(Fitted, Vec<Option<f64>>)>,
}

impl Registered {
    /// What the user should know: a place that is assumed, and another order of the fiducials that fits far better although
    /// the given one fits well enough.
    pub fn warnings(&self, case: &Case) -> Vec<String> {
        if case.robot.base_from_ct == Registration::Assumed {
            return vec![ASSUMED.into()];
        }
        let fitted = self.fitted.as_ref().map(|(fitted, _)| fitted);
        let passed = fitted.filter(|fitted| fitted.fre_mm <= case.registration.max_fre_mm);
        let order = passed.and_then(|fitted| fitted.better_order.as_ref());
        order
            .map(|order| format!("the registration's fiducials may be in a wrong order: {order}"))
            .into_iter()
            .collect()
    }

    /// Why the registration is not good enough for the case: the FRE, and the expected error at each structure.
    pub fn shortfalls(&self, case: &Case) -> Vec<String> {
        let Some((fitted, tre_mm)) = &self.fitted else { return vec![] };
        let most_mm = case.registration.max_fre_mm;
        let mut reasons: Vec<String> =
            (fitted.fre_mm > most_mm).then(|| poor_fit(fitted, most_mm)).into_iter().collect();
        let expected = case.structures.iter().zip(tre_mm);
        reasons.extend(expected.filter_map(|(structure, tre_mm)| {
            let (tre_mm, clearance_mm) = ((*tre_mm)?, structure.clearance_mm);
            (tre_mm > clearance_mm).then(|| {
                format!(
                    "the registration's expected error at {} is {tre_mm:.2} mm (RMS), more than its clearance of {clearance_mm} mm: \
                     touch the fiducials again, use more of them or some nearer to it, or widen the clearance",
                    structure.name
                )
            })
        }));
        reasons
    }

    /// An error that leaves no plan, with what is wrong with the registration where that may be its cause.
    pub fn blame(&self, case: &Case, error: PlanError) -> PlanError {
        let reasons = self.shortfalls(case);
        if reasons.is_empty() || !error.is_infeasible() {
            return error;
        }
        PlanError::BadRegistration { reasons, source: Box::new(error) }
    }
}

/// The words for a place that no registration gives.
const ASSUMED: &str = "no registration in the case (robot.base_from_ct): the arm's place is assumed (frames.base_from_ct in \
                       plan.toml), and the trajectory is not for a real set-up";

/// What is wrong with a fit, and what to do.
fn poor_fit(fitted: &Fitted, most_mm: f64) -> String {
    let worst = fitted.residual_mm.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1));
    let hint = match (&fitted.better_order, worst) {
        (Some(order), _) => format!("{order}"),
        (None, Some((n, mm))) => {
            format!("fiducial {} is {mm:.2} mm off, the most; touch it again or leave it out", n + 1)
        }
        (None, None) => String::new(),
    };
    format!(
        "the registration's fiducials do not fit: FRE {:.2} mm, at most {most_mm} mm expected (registration.max_fre_mm); {hint}",
        fitted.fre_mm
    )
}

/// The case's registration where it gives one: `None` where the arm's place is assumed from the scene.
///
/// # Errors
/// [`PlanError::Registration`].
pub fn given(robot: &RobotSpec) -> Result<Option<Rigid<Base, Ct>>, PlanError> {
    Ok(match &robot.base_from_ct {
        Registration::Assumed => None,
        Registration::Given { rotation, translation_mm } => Some(Rigid::new(*rotation, *translation_mm)),
        Registration::Fiducials { ct_mm, base_mm } => Some(fitted(ct_mm, base_mm)?.base_from_ct),
    })
}

fn fitted(ct_mm: &[[f64; 3]], base_mm: &[[f64; 3]]) -> Result<Fitted, PlanError> {
    let ct: Vec<Point<Ct>> = ct_mm.iter().map(|p| Point::from_coords(Vector3::from(*p))).collect();
    let base: Vec<Point<Base>> = base_mm.iter().map(|p| Point::from_coords(Vector3::from(*p))).collect();
    Ok(fit(&ct, &base)?)
}

/// The case's registration, fitted where it gives fiducials, assumed where it gives none.
///
/// # Errors
/// [`PlanError::Registration`], and those of [`tools::assumed_base_from_ct`].
pub fn registration(robot: &RobotSpec, scene: &Scene) -> Result<Registered, PlanError> {
    let Registration::Fiducials { ct_mm, base_mm } = &robot.base_from_ct else {
        let base_from_ct = match given(robot)? {
            Some(base_from_ct) => base_from_ct,
            None => tools::assumed_base_from_ct(robot, scene)?,
        };
        return Ok(Registered { base_from_ct, fitted: None });
    };
    let fitted = fitted(ct_mm, base_mm)?;
    let center = scene.ct_from_work * scene.target_center;
    let fields = scene.structures.iter().map(|structure| structure.field.as_ref());
    let tre_mm = fields.map(|field| Some(fitted.tre_mm(&field?.nearest(center).1))).collect();
    Ok(Registered { base_from_ct: fitted.base_from_ct, fitted: Some((fitted, tre_mm)) })
}

/// Refuses fiducials outside the scan that they must have been localised in.
///
/// # Errors
/// [`PlanError::FiducialsOutside`].
pub fn fiducials_in_scan(robot: &RobotSpec, scan: &Grid<Ct>) -> Result<(), PlanError> {
    let Registration::Fiducials { ct_mm, .. } = &robot.base_from_ct else { return Ok(()) };
    let beyond_mm: Vec<f64> = ct_mm.iter().map(|p| beyond_scan_mm(scan, *p)).collect();
    let outside: Vec<usize> = (0..ct_mm.len()).filter(|n| beyond_mm[*n] > 0.0).map(|n| n + 1).collect();
    if outside.is_empty() {
        return Ok(());
    }
    Err(PlanError::FiducialsOutside {
        farthest_mm: beyond_mm.iter().copied().fold(0.0, f64::max),
        outside,
        count: ct_mm.len(),
        fit_as_lps: ct_mm.iter().all(|[x, y, z]| beyond_scan_mm(scan, [-x, -y, *z]) == 0.0),
    })
}

/// How far a point lies beyond the scan's voxel boxes, mm; 0 inside and up to [`BEYOND_VOXELS`] of them.
fn beyond_scan_mm(scan: &Grid<Ct>, point_mm: [f64; 3]) -> f64 {
    let index = scan.continuous_index(Point::from_coords(point_mm.into()));
    let (dims, spacing_mm) = (scan.dims(), scan.spacing_mm());
    let voxels = Vector3::from_fn(|a, _| (-0.5 - index[a]).max(index[a] - (dims[a] as f64 - 0.5)).max(0.0));
    if voxels.max() <= BEYOND_VOXELS { 0.0 } else { voxels.component_mul(&spacing_mm).norm() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;
    use proptest::prelude::*;

    /// A head scan: 200 × 200 × 160 mm about (0, −20, 900).
    fn scan(turn: [f64; 3]) -> Grid<Ct> {
        let axes = Rotation3::new(Vector3::from(turn)).into_inner();
        let spacing = Vector3::new(0.5, 0.5, 1.0);
        let half = Vector3::new(100.0, 100.0, 80.0);
        Grid::new([400, 400, 160], spacing, axes, Vector3::new(0.0, -20.0, 900.0) - axes * half).unwrap()
    }

    fn with_points(ct_mm: Vec<[f64; 3]>) -> RobotSpec {
        let text = "structure = []\n[images]\nct = \"c\"\nlabels = \"l\"\n[target]\nlabel = 1\n";
        let case = Case::parse(text, std::path::Path::new("case.toml")).unwrap();
        RobotSpec { base_from_ct: Registration::Fiducials { base_mm: ct_mm.clone(), ct_mm }, ..case.robot }
    }

    #[test]
    fn the_outermost_voxels_and_one_more_are_inside() {
        let scan = scan([0.0; 3]);
        let at = |i: f64| <[f64; 3]>::from(scan.at([i, 10.0, 10.0]).coords);
        for (i, beyond_mm) in [(0.0, 0.0), (-0.5, 0.0), (-1.5, 0.0), (400.5, 0.0), (-2.5, 1.0), (403.5, 2.0)]
        {
            let found = beyond_scan_mm(&scan, at(i));
            assert!((found - beyond_mm).abs() < 1e-9, "{i}: {found} mm");
        }
    }

    proptest! {
        #[test]
        fn points_in_the_scan_are_taken_whatever_its_turn(
            turn in prop::array::uniform3(-0.5f64..0.5),
            points in prop::collection::vec(prop::array::uniform3(0.0f64..1.0), 3..9),
        ) {
            let scan = scan(turn);
            let at = |[x, y, z]: &[f64; 3]| scan.at([399.0 * x, 399.0 * y, 159.0 * z]).coords.into();
            prop_assert!(fiducials_in_scan(&with_points(points.iter().map(at).collect()), &scan).is_ok());
        }

        #[test]
        fn points_in_lps_are_recognised_where_they_leave_the_scan(
            turn in prop::array::uniform3(-0.2f64..0.2),
            points in prop::collection::vec(prop::array::uniform3(0.0f64..1.0), 3..9),
        ) {
            let scan = scan(turn);
            // on one side of the face, so that a point's mirror place lies beyond the scan
            let at = |[x, y, z]: &[f64; 3]| {
                let p = scan.at([399.0 * x, 20.0 * y, 159.0 * z]).coords;
                [-p.x, -p.y, p.z]
            };
            let given: Vec<_> = points.iter().map(at).collect();
            let expected = given.iter().any(|p| beyond_scan_mm(&scan, *p) > 0.0);
            match fiducials_in_scan(&with_points(given), &scan) {
                Ok(()) => prop_assert!(!expected),
                Err(error) => {
                    let said = error.to_string();
                    prop_assert!(said.contains("as LPS they would all lie inside"), "{said}");
                }
            }
        }
    }

    #[test]
    fn points_of_another_scan_are_not_taken_for_lps() {
        let error = fiducials_in_scan(&with_points(vec![[0.0, 0.0, 0.0]; 4]), &scan([0.0; 3])).unwrap_err();
        let said = error.to_string();
        assert!(
            said.contains("fiducials 1, 2, 3, 4 of 4 lie outside the scan") && !said.contains("LPS they"),
            "{said}"
        );
        assert!(said.contains("820") || said.contains("819"), "{said}");
    }
}
