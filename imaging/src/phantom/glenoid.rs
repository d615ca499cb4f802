//! A glenoid to be reamed: the head of a scapula with its pear-shaped, hollow face, a cortical shell over cancellous bone.
//!
//! ct: +z points out of the face (lateral), +y superior, +x anterior; the face's middle is (0, 0, 0). The head is about 50 mm
//! high, 37 mm wide and 32 mm deep. Published faces are about 39 mm high and 29 mm wide (Iannotti et al. 1992), rim and neck
//! around them come on top; the hollow's radius, the shell's thickness and the nerve's place are assumed. Grey values
//! are typical of CT.

use bonemill_geometry::{Ct, Point, Volume};
use rayon::prelude::*;

use super::rng::Rng;
use super::shapes::{V3, coverage};
use super::tibia::place;
use super::variation::Variation;
use super::{Phantom, ct_grid, names, with_noise};

const HALF_HEIGHT_MM: f64 = 25.0;
const HALF_WIDTH_MM: f64 = 18.5;
const DEPTH_MM: f64 = 32.0;
/// The seed makes a head this much larger or smaller.
const SIZE_VARIES: f64 = 0.04;
/// How much narrower the pear is at its upper end than in the middle, as a share.
const PEAR: f64 = 0.25;
/// How much narrower the neck is than the rim, as a share.
const NECK: f64 = 0.35;
/// Radius of the hollow face, mm; assumed.
const HOLLOW_RADIUS_MM: [f64; 2] = [32.0, 40.0];
/// Thickness of the shell, mm; assumed.
const SHELL_MM: [f64; 2] = [1.2, 1.8];
const SHELL_HU: f64 = 1300.0;
const SHELL_VARIES_HU: f64 = 150.0;
const CANCELLOUS_HU: f64 = 400.0;
const CANCELLOUS_VARIES_HU: f64 = 300.0;
const SOFT_HU: f64 = 40.0;
const AIR_HU: f64 = -1000.0;
/// The joint is open: air from this height on, mm; assumed, just above the highest rim.
const OPEN_FROM_MM: f64 = 7.0;
const NERVE: u8 = 1;
const NERVE_RADIUS_MM: f64 = 1.5; // assumed: the suprascapular nerve in its notch
/// From the rim inwards to the nerve, and from the neck's wall to it, mm; assumed.
const NERVE_DEPTH_MM: f64 = 18.0;
const NERVE_GAP_MM: f64 = 1.5;
const NOISE_HU: f64 = 30.0;

const SPACING_MM: f64 = 0.5;
const DIMS: [usize; 3] = [88, 116, 96];
const ORIGIN: Point<Ct> = Point::new(-21.75, -28.75, -34.75);

/// The head of a scapula as signed distances.
struct Head {
    size: f64,
    hollow_radius_mm: f64,
}

impl Head {
    /// Distance to its surface, negative inside, mm; to first order near it.
    fn distance_mm(&self, p: &V3) -> f64 {
        let q = p / self.size;
        let from_axis2 = p.x * p.x + p.y * p.y;
        // the face is a part of a sphere that touches z = 0
        let face = self.hollow_radius_mm - (from_axis2 + (self.hollow_radius_mm - p.z).powi(2)).sqrt();
        let rim = 1.0 - NECK * (-q.z / DEPTH_MM).clamp(0.0, 1.0);
        let half_width = HALF_WIDTH_MM * rim * (1.0 - PEAR * (q.y / HALF_HEIGHT_MM).clamp(-0.2, 1.0));
        let half_height = HALF_HEIGHT_MM * rim;
        let level = (q.x / half_width).hypot(q.y / half_height);
        let side = (level - 1.0) * half_width.min(half_height) * self.size;
        let bottom = -DEPTH_MM * self.size - p.z;
        // the face is hollow: bone is what lies beyond the sphere
        face.max(side).max(bottom)
    }

    /// Where the nerve crosses the back of the neck, mm.
    fn nerve(&self) -> V3 {
        let depth = NERVE_DEPTH_MM / DEPTH_MM;
        let wall_mm = HALF_WIDTH_MM * self.size * (1.0 - NECK * depth) * (1.0 + 0.2 * PEAR);
        V3::new(-(wall_mm + NERVE_GAP_MM + NERVE_RADIUS_MM), 0.0, -NERVE_DEPTH_MM * self.size)
    }
}

/// The glenoid of a seed.
pub(super) fn glenoid(seed: u64) -> Phantom {
    let mut rng = Rng::new(seed, 0);
    let head = Head {
        size: rng.range(1.0 - SIZE_VARIES, 1.0 + SIZE_VARIES),
        hollow_radius_mm: rng.range(HOLLOW_RADIUS_MM[0], HOLLOW_RADIUS_MM[1]),
    };
    let shell_mm = rng.range(SHELL_MM[0], SHELL_MM[1]);
    let fields =
        [(2, 4.0), (3, 1.2)].map(|(stream, spacing_mm)| Variation::new(Rng::new(seed, stream), spacing_mm));
    let nerve = head.nerve();
    let grid = ct_grid(DIMS, SPACING_MM, ORIGIN);
    let mut hu = Volume::filled(grid.clone(), 0f32);
    let mut labels = Volume::filled(grid.clone(), 0u8);
    hu.data_mut().par_iter_mut().zip(labels.data_mut()).enumerate().for_each(|(n, (hu, label))| {
        let p = grid.center(grid.voxel(n)).coords;
        let [shell, cancellous] = fields.each_ref().map(|field| field.at(&p));
        let bone_mm = head.distance_mm(&p);
        let mut value = AIR_HU;
        let mut paint = |distance_mm: f64, with_hu: f64| {
            let share = coverage(distance_mm, SPACING_MM);
            value += share * (with_hu - value);
        };
        paint(p.z - OPEN_FROM_MM, SOFT_HU);
        paint(bone_mm, SHELL_HU + SHELL_VARIES_HU * shell);
        paint(bone_mm + shell_mm, CANCELLOUS_HU + CANCELLOUS_VARIES_HU * cancellous);
        *hu = value as f32;
        let nerve_mm = (p.x - nerve.x).hypot(p.z - nerve.z) - NERVE_RADIUS_MM;
        *label = if nerve_mm < 0.0 { NERVE } else { 0 };
    });
    Phantom {
        ct: with_noise(&hu, NOISE_HU, &Rng::new(seed, 1)),
        labels,
        label_names: names(&[("suprascapular_nerve", NERVE)]),
        case_toml: format!("# A glenoid, seed {seed}.\n{}", include_str!("glenoid_case.toml"))
            .replace("ENTRY", &place(&V3::zeros())),
    }
}
