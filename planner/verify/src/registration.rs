//! Checks that the registration is good enough for the case: where the fiducials lie, how well they fit, and the expected
//! error at each structure. The files cannot show whether the registration is correct.
//!
//! The expected error comes from the fit's normal equations, not from the planner's formula: with residuals of variance
//! σ² = FLE²/3 along each axis, offsets qᵢ of the points from their centroid and K = Σ (|qᵢ|² 1 − qᵢ qᵢᵀ), the error at offset d
//! has the mean square σ² (3/N + tr K⁻¹ (|d|² 1 − d dᵀ)), where FLE² = FRE²/(1 − 2/N).

use bonemill_case::{Registration, Target};
use bonemill_geometry::{Base, Ct, Grid, Point, Rigid};
use bonemill_planfile::PlanRecord;
use nalgebra::{Matrix3, Vector3};

use super::anatomy::{Anatomy, WantedTarget};
use super::boxes::Boxes;
use super::check::Check;

/// Largest distance of a fiducial beyond the scan's voxel boxes, voxels, because its coordinates are rounded.
const BEYOND_VOXELS: f64 = 1.0;

/// All checks of a fit to fiducials; there are none for a registration that is given or assumed.
pub fn registration(record: &PlanRecord, anatomy: &Anatomy, boxes: &[Option<Boxes<'_>>]) -> Vec<Check> {
    let Registration::Fiducials { ct_mm, base_mm } = &record.case.robot.base_from_ct else { return vec![] };
    let outside = ct_mm.iter().filter(|p| is_beyond(anatomy.ct.grid(), p)).count();
    let residuals = Residuals::new(&record.frames.base_from_ct, ct_mm, base_mm);
    let mut checks = vec![
        Check::none_wrong("fiducials are in the scan", outside),
        Check::at_most("registration's FRE", residuals.fre_mm, record.case.registration.max_fre_mm, "mm"),
    ];
    let Some(middle) = target_middle(anatomy) else { return checks };
    for (kept, boxes) in anatomy.kept.iter().zip(boxes) {
        let Some(boxes) = boxes else { continue };
        let error_mm = residuals.expected_error_mm(&boxes.nearest(middle).1);
        let check = Check::at_most("registration's expected error", error_mm, kept.clearance_mm, "mm");
        checks.push(check.of(kept.name.clone()));
    }
    checks
}

fn is_beyond(scan: &Grid<Ct>, point_mm: &[f64; 3]) -> bool {
    let along = scan.axes().transpose() * (Vector3::from(*point_mm) - scan.origin().coords);
    let (dims, spacing) = (scan.dims(), scan.spacing_mm());
    let reach = |a: usize| (0.5 + BEYOND_VOXELS) * spacing[a];
    (0..3).any(|a| along[a] < -reach(a) || along[a] > (dims[a] as f64 - 1.0) * spacing[a] + reach(a))
}

/// The middle of the target.
fn target_middle(anatomy: &Anatomy) -> Option<Point<Ct>> {
    match &anatomy.wanted {
        WantedTarget::Label(label) => {
            let grid = anatomy.labels.grid();
            let numbered = anatomy.labels.data().iter().enumerate().filter(|(_, found)| *found == label);
            let centers = numbered.map(|(n, _)| grid.center(grid.voxel(n)).coords);
            let (sum, count) = centers.fold((Vector3::zeros(), 0.0), |(sum, n), p| (sum + p, n + 1.0));
            (count > 0.0).then(|| Point::from_coords(sum / count))
        }
        WantedTarget::Shape(Target::Label(_) | Target::Swept) => None,
        WantedTarget::Shape(Target::Box { min_mm, max_mm }) => {
            Some(Point::from_coords((min_mm + max_mm) * 0.5))
        }
        WantedTarget::Shape(Target::Ball { center_mm, .. }) => Some(Point::from_coords(*center_mm)),
        WantedTarget::Shape(Target::Frustum { from_mm, to_mm, .. }) => {
            Some(Point::from_coords((from_mm + to_mm) * 0.5))
        }
    }
}

/// The residuals of a registration at its fiducials.
struct Residuals {
    fre_mm: f64,
    count: f64,
    centroid: Vector3<f64>,
    /// K, mm².
    turning: Matrix3<f64>,
}

impl Residuals {
    fn new(base_from_ct: &Rigid<Base, Ct>, ct_mm: &[[f64; 3]], base_mm: &[[f64; 3]]) -> Self {
        let count = ct_mm.len() as f64;
        let squared: f64 = ct_mm
            .iter()
            .zip(base_mm)
            .map(|(ct, base)| {
                let moved = *base_from_ct * Point::<Ct>::from_coords(Vector3::from(*ct));
                (moved.coords - Vector3::from(*base)).norm_squared()
            })
            .sum();
        let centroid = ct_mm.iter().map(|p| Vector3::from(*p)).sum::<Vector3<f64>>() / count;
        let turning = ct_mm.iter().map(|p| across(&(Vector3::from(*p) - centroid))).sum();
        Self { fre_mm: (squared / count).sqrt(), count, centroid, turning }
    }

    /// Expected error at a point, mm RMS; infinite where the points do not determine it.
    fn expected_error_mm(&self, at: &Point<Ct>) -> f64 {
        let Some(inverse) = self.turning.try_inverse() else { return f64::INFINITY };
        let variance = self.fre_mm.powi(2) / (1.0 - 2.0 / self.count) / 3.0;
        (variance * (3.0 / self.count + (inverse * across(&(at.coords - self.centroid))).trace())).sqrt()
    }
}

/// The matrix |d|² 1 − d dᵀ.
fn across(d: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::identity() * d.norm_squared() - d * d.transpose()
}

#[cfg(test)]
mod tests {
    use super::*;
    use bonemill_arm::registration::fit;
    use nalgebra::Rotation3;

    #[test]
    fn both_formulas_expect_the_same_error() {
        let ct =
            [[0.0, 0.0, 0.0], [40.0, 0.0, 5.0], [0.0, 50.0, -3.0], [20.0, 10.0, 30.0], [-30.0, 5.0, 12.0]];
        let truth: Rigid<Base, Ct> =
            Rigid::new(Rotation3::new(Vector3::new(0.3, -0.2, 0.5)), Vector3::new(4.0, 5.0, 6.0));
        let mut base = ct.map(|p| <[f64; 3]>::from((truth * Point::<Ct>::from_coords(p.into())).coords));
        (base[1][0], base[3][2]) = (base[1][0] + 0.8, base[3][2] - 0.5);
        let points = |of: &[[f64; 3]]| of.iter().map(|p| Vector3::from(*p)).collect::<Vec<_>>();
        let ct_points: Vec<Point<Ct>> = points(&ct).into_iter().map(Point::from_coords).collect();
        let base_points: Vec<Point<Base>> = points(&base).into_iter().map(Point::from_coords).collect();
        let fitted = fit(&ct_points, &base_points).unwrap();
        let residuals = Residuals::new(&fitted.base_from_ct, &ct, &base);
        assert!((residuals.fre_mm - fitted.fre_mm).abs() < 1e-9 && residuals.fre_mm > 0.2);
        for at in [[0.0, 0.0, 0.0], [90.0, -40.0, 10.0], [5.0, 300.0, -80.0]] {
            let at = Point::from_coords(Vector3::from(at));
            let (own, planned) = (residuals.expected_error_mm(&at), fitted.tre_mm(&at));
            assert!((own - planned).abs() < 1e-9 * planned, "{own} and {planned} mm");
        }
    }
}
