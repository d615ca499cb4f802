//! Yang and Chen's lumped force: the whole cut summed up in its material removal rate.
//!
//! ```text
//! F_t = K_t MRR/f        F_r = K_r F_t        MRR = VR/T
//! ```
//!
//! with VR the volume removed in the time T and f the feed rate. MRR/f is the engaged cross-section, so K_t, N/mm², is a force
//! per cross-section; it depends on feed and spindle speed through the tooth speed: F_t = K MRR/V_c with the specific cutting
//! energy K of the burr model, whose db form this lumps.

use bonemill_cutter::ball::BallVolumes;
use bonemill_geometry::{Frame, Grid, Point};
use nalgebra::{Unit, Vector3};

use crate::burr::ModelError;
use crate::burr::checked;

/// Tangential and radial coefficient of the lumped force.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LumpedCoefficients {
    /// K_t, N per mm² of engaged cross-section.
    pub k_t_n_mm2: f64,
    /// K_r = F_r/F_t.
    pub k_r: f64,
}

/// Tangential and radial part of a lumped force, N.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LumpedForce {
    /// F_t, N.
    pub tangential_n: f64,
    /// F_r, N.
    pub radial_n: f64,
}

/// A removal: volume, time and feed rate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Removal {
    volume_mm3: f64,
    time_s: f64,
    feed_mm_s: f64,
}

impl Removal {
    /// Volume VR removed in the time T at the feed rate f.
    ///
    /// # Errors
    /// [`ModelError::OutOfRange`] unless the volume is ≥ 0, and time and feed are positive.
    pub fn new(volume_mm3: f64, time_s: f64, feed_mm_s: f64) -> Result<Self, ModelError> {
        checked("removed volume, mm³", volume_mm3, |v| v >= 0.0, "0 or more")?;
        checked("time of removal, s", time_s, |t| t > 0.0, "positive")?;
        checked("feed rate, mm/s", feed_mm_s, |f| f > 0.0, "positive")?;
        Ok(Self { volume_mm3, time_s, feed_mm_s })
    }

    /// MRR = VR/T, mm³/s.
    ///
    /// **Source:** Yang & Chen, equation (5).
    pub fn rate_mm3_s(&self) -> f64 {
        self.volume_mm3 / self.time_s
    }
}

impl LumpedCoefficients {
    /// From the specific cutting energy K of the material and the tooth speed V_c: K_t = K f/V_c.
    ///
    /// # Errors
    /// [`ModelError::OutOfRange`] unless the tooth speed is positive.
    pub fn from_cutting_energy(
        k_n_mm2: f64,
        k_r: f64,
        feed_mm_s: f64,
        tooth_speed_mm_s: f64,
    ) -> Result<Self, ModelError> {
        checked("tooth speed, mm/s", tooth_speed_mm_s, |v| v > 0.0, "positive")?;
        Ok(Self { k_t_n_mm2: k_n_mm2 * feed_mm_s / tooth_speed_mm_s, k_r })
    }

    /// From a measured mean force and the direction of the radial part: K_t = F_t f T/VR, K_r = F_r/F_t, with F_r = F·d and
    /// F_t = |F − F_r d|.
    ///
    /// # Errors
    /// [`ModelError::OutOfRange`] when nothing was removed or there is no tangential force.
    ///
    /// **Source:** Yang & Chen, equations (13)–(16); (15) is printed inverted (docs/force-model.md 9).
    pub fn calibrate(
        force_n: &Vector3<f64>,
        radial: &Unit<Vector3<f64>>,
        removal: &Removal,
    ) -> Result<Self, ModelError> {
        let LumpedForce { tangential_n, radial_n } = split(force_n, radial);
        checked("removed volume of a calibration, mm³", removal.volume_mm3, |v| v > 0.0, "positive")?;
        checked("tangential force of a calibration, N", tangential_n, |f| f > 0.0, "positive")?;
        Ok(Self {
            k_t_n_mm2: tangential_n * removal.feed_mm_s / removal.rate_mm3_s(),
            k_r: radial_n / tangential_n,
        })
    }

    /// F_t = K_t MRR/f, F_r = K_r F_t.
    ///
    /// **Source:** Yang & Chen, equations (3), (4).
    pub fn force(&self, removal: &Removal) -> LumpedForce {
        let tangential_n = self.k_t_n_mm2 * removal.rate_mm3_s() / removal.feed_mm_s;
        LumpedForce { tangential_n, radial_n: self.k_r * tangential_n }
    }
}

/// F_r = F·d and F_t = |F − F_r d|.
pub fn split(force_n: &Vector3<f64>, radial: &Unit<Vector3<f64>>) -> LumpedForce {
    let radial_n = force_n.dot(radial);
    LumpedForce { tangential_n: (force_n - radial.into_inner() * radial_n).norm(), radial_n }
}

/// Volume that a ball newly covers on its way from `from` to `to`, mm³, on the voxels of `grid`, all solid.
///
/// The move is cut into equal steps of at most `max_step_mm`; a voxel counts with the largest part that any step covers, less
/// the part covered at the start. A little below π r² L: two steps that each cover another part of a voxel count once.
///
/// # Errors
/// [`ModelError`] unless radius and step are positive and the ends finite.
///
/// **Source:** Yang & Chen, equations (8)–(12).
pub fn swept_volume_mm3<F: Frame>(
    grid: &Grid<F>,
    from: Point<F>,
    to: Point<F>,
    radius_mm: f64,
    max_step_mm: f64,
) -> Result<f64, ModelError> {
    checked("burr radius, mm", radius_mm, |r| r > 0.0, "positive")?;
    checked("step, mm", max_step_mm, |s| s > 0.0, "positive")?;
    let steps = checked(
        "steps of a move",
        (from.distance_mm(&to) / max_step_mm).ceil(),
        |n| n <= 1e6,
        "at most 10⁶",
    )?;
    let (mut start, mut most) = (vec![0.0; grid.len()], vec![0f64; grid.len()]);
    let block = [[0; 3], grid.dims()];
    let mut volumes = BallVolumes::new();
    volumes.for_each(grid, from, radius_mm, block, |row| row, |n, v| start[n] = v);
    for step in 1..=steps as usize {
        let center = from + (to - from) * (step as f64 / steps);
        volumes.for_each(grid, center, radius_mm, block, |row| row, |n, v| most[n] = most[n].max(v));
    }
    Ok(start.iter().zip(&most).map(|(s, m)| (m - s).max(0.0)).sum())
}

#[cfg(test)]
mod tests {
    use super::*;
    use bonemill_geometry::Work;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(bonemill_testkit::fixed(256))]

        #[test]
        fn calibration_inverts_the_force(
            k_t in 0.01f64..500.0, k_r in 0.0f64..3.0, v in 1e-4f64..10.0, t in 1e-3f64..10.0, f in 0.01f64..10.0,
        ) {
            let (removal, k) = (Removal::new(v, t, f).unwrap(), LumpedCoefficients { k_t_n_mm2: k_t, k_r });
            let LumpedForce { tangential_n, radial_n } = k.force(&removal);
            let force = Vector3::new(0.6 * tangential_n, 0.8 * tangential_n, radial_n);
            let found = LumpedCoefficients::calibrate(&force, &Vector3::z_axis(), &removal).unwrap();
            prop_assert!((found.k_t_n_mm2 - k_t).abs() < 1e-12 * k_t && (found.k_r - k_r).abs() < 1e-12 * k_r.max(1.0));
        }
    }

    #[test]
    fn a_straight_sweep_is_a_tube_to_the_voxel_s_error() {
        let grid = Grid::<Work>::aligned([60, 44, 44], 0.05, Point::new(-1.48, -1.08, -1.08)).unwrap();
        let (a, b) = (Point::new(-0.4, 0.0, 0.0), Point::new(0.4, 0.0, 0.0));
        let found = swept_volume_mm3(&grid, a, b, 1.0, 0.01).unwrap();
        let tube = std::f64::consts::PI * 0.8;
        assert!(found < tube && found > 0.995 * tube, "{found} of {tube}");
        assert_eq!(swept_volume_mm3(&grid, a, a, 1.0, 0.01).unwrap(), 0.0);
        assert!(swept_volume_mm3(&grid, a, b, 1.0, 0.0).is_err());
    }

    #[test]
    fn bad_removals_are_refused() {
        assert!(Removal::new(-1.0, 1.0, 1.0).is_err() && Removal::new(1.0, 0.0, 1.0).is_err());
        assert!(Removal::new(1.0, 1.0, f64::NAN).is_err());
        let nothing = Removal::new(0.0, 1.0, 1.0).unwrap();
        let force = Vector3::new(1.0, 0.0, 0.0);
        assert!(LumpedCoefficients::calibrate(&force, &Vector3::z_axis(), &nothing).is_err());
        let something = Removal::new(1.0, 1.0, 1.0).unwrap();
        assert!(LumpedCoefficients::calibrate(&force, &Vector3::x_axis(), &something).is_err());
    }

    /// The burr model's db form, lumped: torque over radius is K_t MRR over the tooth speed at the equator.
    #[test]
    fn the_cutting_energy_form_is_the_burr_s_power() {
        let k = LumpedCoefficients::from_cutting_energy(100.0, 0.6, 1.5, 5000.0).unwrap();
        let f = k.force(&Removal::new(3.0, 1.0, 1.5).unwrap());
        assert!((f.tangential_n * 5000.0 - 100.0 * 3.0).abs() < 1e-12);
    }
}
