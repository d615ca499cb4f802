//! The inner ear: a dense capsule around the vestibule, three semicircular canals and the cochlea, and the fluid in it.
//!
//! Everything is placed relative to the middle of the vestibule, in ct's directions (+x lateral, +y anterior, +z superior).

use super::super::rng::Rng;
use super::super::shapes::{Torus, Tube, V3};

/// The otic capsule.
#[derive(Debug)]
pub(super) struct Labyrinth {
    canals: [Torus; 3],
    vestibule: Tube,
    cochlea: Tube,
    cochlear_duct: Tube,
}

impl Labyrinth {
    const CANAL_CAPSULE_MM: f64 = 1.1;
    const CANAL_LUMEN_MM: f64 = 0.45;
    const VESTIBULE_WALL_MM: f64 = 1.0;

    /// The labyrinth whose vestibule has its centre at `at`.
    pub(super) fn new(at: V3, rng: &mut Rng) -> Self {
        let mut canal = |x: f64, y: f64, z: f64, normal: V3| Torus {
            center: at + V3::new(x, y, z),
            normal: normal.normalize(),
            major_mm: rng.range(2.6, 3.0),
        };
        // lateral: nearly horizontal, its front raised; posterior: along the petrous bone; superior: across it
        let canals = [
            canal(2.2, -3.3, 1.8, V3::new(0.1, -0.4, 0.9)),
            canal(-0.5, -5.8, -0.7, V3::new(0.514, 0.857, 0.0)),
            canal(-0.8, 0.7, 3.0, V3::new(0.857, -0.514, 0.0)),
        ];
        let vestibule = Tube::straight(&[
            (at + V3::new(0.2, -2.3, 0.6), 2.2), // its wall included
            (at + V3::new(-0.3, 2.2, -0.5), 2.3),
        ]);
        let center = at + V3::new(-1.8, 6.5, -2.5);
        let cochlea = Tube::straight(&[(center, 3.6), (center, 3.6)]);
        Self { canals, vestibule, cochlea, cochlear_duct: cochlear_duct(center) }
    }

    /// Signed distance of the dense capsule, mm.
    pub(super) fn capsule_mm(&self, p: &V3) -> f64 {
        let canals = self.canals.iter().map(|c| c.distance(p, Self::CANAL_CAPSULE_MM));
        canals.fold(self.vestibule.distance(p).min(self.cochlea.distance(p)), f64::min)
    }

    /// Signed distance of the fluid inside it, mm.
    pub(super) fn fluid_mm(&self, p: &V3) -> f64 {
        let canals = self.canals.iter().map(|c| c.distance(p, Self::CANAL_LUMEN_MM));
        let vestibule = self.vestibule.distance(p) + Self::VESTIBULE_WALL_MM;
        canals.fold(vestibule.min(self.cochlear_duct.distance(p)), f64::min)
    }
}

/// The cochlear duct: two and a half turns around an axis that points forwards and outwards.
fn cochlear_duct(center: V3) -> Tube {
    let axis = V3::new(0.6, 0.75, -0.28).normalize();
    let x = axis.cross(&V3::z()).normalize();
    let y = axis.cross(&x);
    let knot = |n: i32| {
        let t = f64::from(n) / 40.0;
        let (radius, angle) = (2.3 - 1.6 * t, t * 2.5 * std::f64::consts::TAU);
        let p = center + x * (radius * angle.cos()) + y * (radius * angle.sin()) + axis * (3.0 * t - 1.3);
        (p, 0.6 - 0.25 * t)
    };
    Tube::straight(&(0..=40).map(knot).collect::<Vec<_>>())
}
