//! A right mastoid computed from a seed: the anatomy behind the ear, from the cortex to the labyrinth.
//!
//! The seed decides the bodies of the anatomy, which are signed distances ([`anatomy`]). They are painted one over the
//! other with partial volumes, blurred by 0.15 mm, and given noise of 40 HU. The target is a cavity that narrows from the
//! cortex to the antrum and stays half a millimetre more than the clearance away from every structure. Its edges are
//! rounded to the burr, and only its largest piece is kept. Grey values are typical of CT, not of one scanner or patient.
//!
//! The image is computed in bricks of 4 × 4 × 4 voxels, so that only the bodies near a voxel are evaluated.

mod anatomy;
mod labyrinth;
#[cfg(test)]
mod tests;

use bonemill_geometry::{Ct, Grid, Point, Volume};
use rayon::prelude::*;

use super::cells::{AirCells, LocalCells};
use super::rng::Rng;
use super::shapes::{V3, coverage, rounded_intersection};
use super::{Phantom, TARGET, ct_grid, names, with_noise};
use anatomy::Anatomy;

const FACIAL_NERVE: u8 = 1;
const LABYRINTH: u8 = 2;
const EAR_CANAL: u8 = 3;
const SIGMOID_SINUS: u8 = 4;
const DURA: u8 = 5;

// HU; air in cells is above -1000 HU, because scanners blur it
const AIR_HU: f64 = -1000.0;
const CELL_AIR_HU: f64 = -900.0;
const SOFT_HU: f64 = 40.0;
const BRAIN_HU: f64 = 35.0;
const BLOOD_HU: f64 = 60.0;
const FLUID_HU: f64 = 20.0;
const PLATE_HU: f64 = 1450.0;
const CAPSULE_HU: f64 = 1900.0;

const CANAL_WALL_MM: f64 = 1.0;
const NERVE_CANAL_WALL_MM: f64 = 0.6;
const SINUS_PLATE_MM: f64 = 0.8;
const DURA_PLATE_MM: f64 = 1.0;
const EARDRUM_MM: f64 = 0.3;
const SCALP_MM: f64 = 6.0;

/// Distance kept beyond the clearance, mm: the voxel boxes of label and target together extend 0.43 mm beyond their centres.
const SPARE_MM: f64 = 0.5;
/// Radius of the target's edges: a little more than the burr's 2 mm.
const TARGET_ROUNDING_MM: f64 = 2.2;
/// How far the target extends above the cortex, mm, so that it contains the cortex's partial-volume voxels.
const ABOVE_CORTEX_MM: f64 = 0.25;

const NOISE_HU: f64 = 40.0;
const BLUR_MM: f64 = 0.15;
const SPACING_MM: f64 = 0.25;
const DIMS: [usize; 3] = [164, 180, 160];
const ORIGIN: Point<Ct> = Point::new(-31.875, -31.875, -23.875);
const BRICK: usize = 4;
/// Half of a brick's space diagonal between voxel centres, mm.
const BRICK_RADIUS_MM: f64 = 0.5 * (BRICK - 1) as f64 * SPACING_MM * 1.733;
/// Bodies farther than this from a voxel change neither its value nor the target there, mm.
const REACH_MM: f64 = TARGET_ROUNDING_MM + 1.0 + SPARE_MM;

/// The mastoid for a seed.
pub(super) fn temporal(seed: u64) -> Phantom {
    let grid = ct_grid(DIMS, SPACING_MM, ORIGIN);
    let anatomy = Anatomy::new(seed);
    let (hu, mut labels) = painted(&anatomy, &anatomy.air_cells(seed), &grid);
    keep_largest_piece(&mut labels, TARGET);
    Phantom {
        ct: with_noise(&blurred(hu, BLUR_MM / SPACING_MM), NOISE_HU, &Rng::new(seed, 1)),
        labels,
        label_names: names(&[
            ("facial_nerve", FACIAL_NERVE),
            ("labyrinth", LABYRINTH),
            ("ear_canal", EAR_CANAL),
            ("sigmoid_sinus", SIGMOID_SINUS),
            ("dura", DURA),
            ("target", TARGET),
        ]),
        case_toml: format!("# The procedural mastoid, seed {seed}.\n{}", include_str!("temporal_case.toml")),
    }
}

/// HU before blur and noise, and labels.
fn painted(anatomy: &Anatomy, cells: &AirCells, grid: &Grid<Ct>) -> (Volume<f32, Ct>, Volume<u8, Ct>) {
    let [nx, ny, _] = DIMS;
    let mut hu = Volume::filled(grid.clone(), 0f32);
    let mut labels = Volume::filled(grid.clone(), 0u8);
    let slab = nx * ny * BRICK;
    let slabs = hu.data_mut().par_chunks_mut(slab).zip(labels.data_mut().par_chunks_mut(slab));
    slabs.enumerate().for_each(|(b, (hu, labels))| {
        for (j, i) in (0..ny).step_by(BRICK).flat_map(|j| (0..nx).step_by(BRICK).map(move |i| (j, i))) {
            let middle = 0.5 * (BRICK - 1) as f64;
            let center = grid.at([i as f64 + middle, j as f64 + middle, (b * BRICK) as f64 + middle]).coords;
            let local = anatomy.near(&center, BRICK_RADIUS_MM + REACH_MM);
            let uniform = local.uniform(&center);
            let pneumatised = anatomy.is_pneumatised(&center, BRICK_RADIUS_MM);
            let cells = pneumatised.then(|| cells.near(&center, BRICK_RADIUS_MM));
            for n in 0..BRICK * BRICK * BRICK {
                let (di, dj, dk) = (n % BRICK, n / BRICK % BRICK, n / (BRICK * BRICK));
                let at = i + di + nx * (j + dj + ny * dk);
                let (value, label) = uniform.unwrap_or_else(|| {
                    let p = grid.center([i + di, j + dj, b * BRICK + dk]).coords;
                    let distances = local.distances(&p);
                    (local.hu(&p, &distances, cells.as_ref()), local.label(&p, &distances))
                });
                (hu[at], labels[at]) = (value as f32, label);
            }
        }
    });
    (hu, labels)
}

/// Signed distances of a point from the structures and the bone's surface, mm; infinite beyond [`REACH_MM`].
struct Distances {
    lateral: f64,
    bone: f64,
    nerve: f64,
    labyrinth: f64,
    canal: f64,
    sinus: f64,
    dura: f64,
}

impl anatomy::Local<'_> {
    /// HU and label of a brick that lies wholly in the air outside or in the brain, as most do; told by its centre.
    fn uniform(&self, center: &V3) -> Option<(f64, u8)> {
        const DEEP_MM: f64 = BRICK_RADIUS_MM + SPACING_MM;
        let d = self.distances(center);
        let far = REACH_MM + BRICK_RADIUS_MM;
        if d.lateral > SCALP_MM + DEEP_MM {
            return Some((AIR_HU, 0));
        }
        let alone =
            [d.nerve, d.labyrinth, d.sinus, self.inner_canal.distance(center)].iter().all(|&d| d > far);
        (d.dura < -DEEP_MM && alone).then_some((BRAIN_HU, DURA))
    }

    fn distances(&self, p: &V3) -> Distances {
        let lateral = self.anatomy.lateral_mm(p);
        Distances {
            lateral,
            bone: self.anatomy.bone_mm(p, lateral),
            nerve: self.nerve.distance(p),
            labyrinth: if self.labyrinth { self.anatomy.labyrinth.capsule_mm(p) } else { f64::INFINITY },
            canal: self.canal.distance(p),
            sinus: self.sinus.distance(p),
            dura: self.anatomy.dura_mm(p, lateral),
        }
    }

    /// HU of a voxel; each tissue is painted over those before it.
    fn hu(&self, p: &V3, d: &Distances, cells: Option<&LocalCells>) -> f64 {
        let mut hu = AIR_HU;
        let mut paint = |value: f64, distance: f64| hu += (value - hu) * coverage(distance, SPACING_MM);
        paint(SOFT_HU, d.lateral - SCALP_MM);
        if d.bone < SPACING_MM && d.dura > -SPACING_MM {
            paint(self.anatomy.bone_hu(p), d.bone);
        }
        if let Some(cells) = cells {
            let bound = self.anatomy.pneumatised_mm(p, d.bone);
            if bound < SPACING_MM {
                paint(CELL_AIR_HU, cells.distance(p, bound));
            }
        }
        paint(CELL_AIR_HU, self.antrum.distance(p));
        // plates and walls are bone, so they end where the bone ends
        paint(PLATE_HU, (d.canal - CANAL_WALL_MM).max(d.bone));
        if self.middle_ear {
            let middle_ear = self.anatomy.middle_ear.distance(p);
            paint(CELL_AIR_HU, middle_ear);
            paint(SOFT_HU, (d.canal.abs() - 0.5 * EARDRUM_MM).max(middle_ear - 0.5));
        }
        paint(AIR_HU, d.canal + 0.5 * EARDRUM_MM);
        if self.labyrinth {
            paint(CAPSULE_HU, d.labyrinth);
            paint(FLUID_HU, self.anatomy.labyrinth.fluid_mm(p));
        }
        // painted before the inner canal, in which the nerve has no wall
        paint(PLATE_HU, (d.nerve - NERVE_CANAL_WALL_MM).max(d.bone));
        paint(FLUID_HU, self.inner_canal.distance(p));
        paint(PLATE_HU, (d.sinus - SINUS_PLATE_MM).min(d.dura - DURA_PLATE_MM).max(d.bone));
        paint(BRAIN_HU, d.dura);
        paint(BLOOD_HU, d.sinus);
        paint(SOFT_HU, d.nerve);
        hu
    }

    /// Label of a voxel; where structures overlap, the thinnest one is taken.
    fn label(&self, p: &V3, d: &Distances) -> u8 {
        match () {
            () if d.nerve <= 0.0 => FACIAL_NERVE,
            () if d.labyrinth <= 0.0 => LABYRINTH,
            () if d.sinus <= 0.0 => SIGMOID_SINUS,
            () if d.dura <= 0.0 => DURA,
            () if d.canal <= CANAL_WALL_MM && d.bone <= 0.0 => EAR_CANAL,
            () if d.bone <= ABOVE_CORTEX_MM && self.target_mm(p, d) <= 0.0 => TARGET,
            () => 0,
        }
    }

    /// Signed distance of the cavity below and above the cortex, mm. It may be too large, but is never too small.
    fn target_mm(&self, p: &V3, d: &Distances) -> f64 {
        let [walls, floor] = self.anatomy.cavity_mm(p);
        if walls > 0.0 || floor > 0.0 {
            return walls.max(floor);
        }
        let bounds = [
            walls,
            floor,
            1.0 + SPARE_MM - d.nerve,
            1.0 + SPARE_MM - d.labyrinth,
            0.5 + SPARE_MM - d.sinus,
            0.5 + SPARE_MM - d.dura,
            0.5 + SPARE_MM - (d.canal - CANAL_WALL_MM),
        ];
        rounded_intersection(&bounds, TARGET_ROUNDING_MM)
    }
}

/// Gaussian blur with a standard deviation in voxels. Beyond the image's edge its outermost values are repeated.
fn blurred(mut image: Volume<f32, Ct>, sigma_voxels: f64) -> Volume<f32, Ct> {
    let [nx, ny, nz] = image.grid().dims();
    let half = (3.0 * sigma_voxels).ceil() as usize;
    let raw: Vec<f64> =
        (0..=2 * half).map(|n| (-0.5 * ((n as f64 - half as f64) / sigma_voxels).powi(2)).exp()).collect();
    let sum: f64 = raw.iter().sum();
    let kernel: Vec<f32> = raw.iter().map(|w| (w / sum) as f32).collect();
    let shift = |at: usize, tap: usize, n: usize| (at + tap).saturating_sub(half).min(n - 1);
    for axis in 0..3 {
        let source = image.clone();
        let source = source.data();
        image.data_mut().par_chunks_mut(nx).enumerate().for_each(|(row, out)| {
            let (j, k) = (row % ny, row / ny);
            out.fill(0.0);
            for (tap, &w) in kernel.iter().enumerate() {
                match axis {
                    0 => out.iter_mut().enumerate().for_each(|(i, o)| {
                        *o += w * source[row * nx + shift(i, tap, nx)];
                    }),
                    _ => {
                        let from =
                            if axis == 1 { shift(j, tap, ny) + ny * k } else { j + ny * shift(k, tap, nz) };
                        let line = &source[from * nx..][..nx];
                        out.iter_mut().zip(line).for_each(|(o, &s)| *o += w * s);
                    }
                }
            }
        });
    }
    image
}

/// Clears all but the largest piece (connected by faces) of a label; of equally large ones the first in memory stays.
fn keep_largest_piece(labels: &mut Volume<u8, Ct>, label: u8) {
    let grid = labels.grid().clone();
    let dims = grid.dims();
    let strides = [1, dims[0], dims[0] * dims[1]];
    let mut piece_of = vec![0u32; grid.len()];
    let mut sizes = vec![0usize];
    for start in 0..grid.len() {
        if labels.data()[start] != label || piece_of[start] != 0 {
            continue;
        }
        let piece = sizes.len() as u32;
        let mut open = vec![start];
        piece_of[start] = piece;
        let mut size = 0;
        while let Some(n) = open.pop() {
            size += 1;
            let voxel = grid.voxel(n);
            for a in 0..3 {
                let before = (voxel[a] > 0).then(|| n - strides[a]);
                let after = (voxel[a] + 1 < dims[a]).then(|| n + strides[a]);
                for m in before.into_iter().chain(after) {
                    if labels.data()[m] == label && piece_of[m] == 0 {
                        piece_of[m] = piece;
                        open.push(m);
                    }
                }
            }
        }
        sizes.push(size);
    }
    let largest = (1..sizes.len()).rev().max_by_key(|&p| sizes[p]).unwrap_or(0) as u32;
    for (value, piece) in labels.data_mut().iter_mut().zip(piece_of) {
        if piece != 0 && piece != largest {
            *value = 0;
        }
    }
}
