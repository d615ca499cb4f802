//! A stretch of a tibia's shaft to be drilled through both cortices: a cortical tube around cancellous bone, with density
//! that varies from place to place, soft tissue around it, and a vessel behind the far cortex.
//!
//! ct: x runs along the bone, +z points out of the skin, the bone's middle is (0, 0, 0). The channel of the case goes along −z
//! through the middle. The dimensions are assumed, of the order of an adult's mid-shaft, since Faieghi et al. drill bovine
//! tibiae without giving them. Grey values are typical of CT.

use bonemill_geometry::{Ct, Point, Volume};
use rayon::prelude::*;

use super::rng::Rng;
use super::shapes::{V3, coverage};
use super::variation::Variation;
use super::{Phantom, ct_grid, names, with_noise};

const OUTER_RADIUS_MM: [f64; 2] = [11.5, 12.5]; // assumed, by the seed
const CORTEX_MM: [f64; 2] = [3.5, 4.5]; // assumed, by the seed
/// The cortex is this much thicker or thinner from place to place, mm; assumed.
const CORTEX_VARIES_MM: f64 = 0.4;
const CORTICAL_HU: f64 = 1600.0;
const CORTICAL_VARIES_HU: f64 = 150.0;
/// Cancellous bone between its marrow spaces and its trabeculae.
const CANCELLOUS_HU: f64 = 350.0;
const CANCELLOUS_VARIES_HU: f64 = 350.0;
const SOFT_HU: f64 = 40.0;
const VESSEL_HU: f64 = 60.0;
const AIR_HU: f64 = -1000.0;
/// Soft tissue over the bone, mm; assumed.
const SKIN_MM: f64 = 4.0;
const VESSEL: u8 = 1;
const VESSEL_RADIUS_MM: f64 = 2.0; // assumed: the posterior tibial vessels
/// From the far cortex to the vessel's wall, mm; assumed.
const VESSEL_GAP_MM: f64 = 4.0;
const NOISE_HU: f64 = 30.0;

const SPACING_MM: f64 = 0.25;
const DIMS: [usize; 3] = [96, 112, 160];
const ORIGIN: Point<Ct> = Point::new(-11.875, -13.875, -21.875);

/// The tibia of a seed.
pub(super) fn tibia(seed: u64) -> Phantom {
    let mut rng = Rng::new(seed, 0);
    let outer_mm = rng.range(OUTER_RADIUS_MM[0], OUTER_RADIUS_MM[1]);
    let cortex_mm = rng.range(CORTEX_MM[0], CORTEX_MM[1]);
    let fields = [(2, 6.0), (3, 3.0), (4, 0.8)]
        .map(|(stream, spacing_mm)| Variation::new(Rng::new(seed, stream), spacing_mm));
    let vessel_z_mm = -(outer_mm + VESSEL_GAP_MM + VESSEL_RADIUS_MM);
    let grid = ct_grid(DIMS, SPACING_MM, ORIGIN);
    let mut hu = Volume::filled(grid.clone(), 0f32);
    let mut labels = Volume::filled(grid.clone(), 0u8);
    hu.data_mut().par_iter_mut().zip(labels.data_mut()).enumerate().for_each(|(n, (hu, label))| {
        let p = grid.center(grid.voxel(n)).coords;
        let radius_mm = p.y.hypot(p.z);
        let [thickness, cortical, cancellous] = fields.each_ref().map(|field| field.at(&p));
        let inner_mm = outer_mm - cortex_mm - CORTEX_VARIES_MM * thickness;
        let vessel_mm = p.y.hypot(p.z - vessel_z_mm) - VESSEL_RADIUS_MM;
        let mut value = AIR_HU;
        let mut paint = |distance_mm: f64, with_hu: f64| {
            let share = coverage(distance_mm, SPACING_MM);
            value += share * (with_hu - value);
        };
        paint(p.z - outer_mm - SKIN_MM, SOFT_HU);
        paint(vessel_mm, VESSEL_HU);
        paint(radius_mm - outer_mm, CORTICAL_HU + CORTICAL_VARIES_HU * cortical);
        paint(radius_mm - inner_mm, CANCELLOUS_HU + CANCELLOUS_VARIES_HU * cancellous);
        *hu = value as f32;
        *label = if vessel_mm < 0.0 { VESSEL } else { 0 };
    });
    let (entry, end) = (V3::new(0.0, 0.0, outer_mm), V3::new(0.0, 0.0, -outer_mm - 1.0));
    Phantom {
        ct: with_noise(&hu, NOISE_HU, &Rng::new(seed, 1)),
        labels,
        label_names: names(&[("vessel", VESSEL)]),
        case_toml: format!("# A tibia's shaft, seed {seed}.\n{}", include_str!("tibia_case.toml"))
            .replace("ENTRY", &place(&entry))
            .replace("END", &place(&end)),
    }
}

/// A point as a TOML array.
pub(super) fn place(p: &V3) -> String {
    format!("[{:.3}, {:.3}, {:.3}]", p.x, p.y, p.z)
}
