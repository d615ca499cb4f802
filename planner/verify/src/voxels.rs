//! Classifies the planner's own voxels again; every volume that a plan states is a count of their centres.
//!
//! The plan tells where the voxels lie (`frames`); their classes follow from the images by the definitions of the case file.
//! So a figure needs no tolerance for another lattice, only for rounding: a grey value at a threshold, a centre on the face
//! between two label voxels, on a shape's surface or on the burr's surface. Such a voxel is possibly, but not surely, inside. A
//! correct figure lies between the two counts, which are nearly always equal.

use bonemill_case::{Density, Sheets};
use bonemill_geometry::{Ct, Frame, Grid, Point, Rigid, Work, cancel};
use nalgebra::Vector3;
use rayon::prelude::*;

use super::lattice::{Closed, MATERIAL, OUTSIDE, SHEET, TARGET, TARGET_BONE};
use super::target::TargetRule;
use super::{VerifyError, edt};

/// Points closer than this to a surface may be on either side of it, mm.
pub const DOUBT_MM: f64 = 1e-6;
/// The same for a voxel's face, voxels.
const DOUBT_VOXELS: f64 = 1e-6;
/// Interpolated grey values closer than this to a threshold may be on either side of it, because of single precision, HU.
const DOUBT_HU: f64 = 2e-3;
/// Labels are looked up farther from the grid's middle by this share of a voxel, so that a centre on a face belongs to the
/// outer voxel.
const LABELS_OUTWARD: f64 = 1e-4;

/// A piece of bone of fewer voxels than this (a cube of 2×2×2) is a speck.
const SPECK_VOXELS: usize = 8;

/// A value without the doubtful cases, and with them. Whatever is sure is also possible.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Doubtful<T> {
    /// Only what is certain.
    pub surely: T,
    /// What is certain or doubtful.
    pub possibly: T,
}

impl Doubtful<bool> {
    /// Without doubt.
    pub fn sure(is: bool) -> Self {
        Self { surely: is, possibly: is }
    }

    /// Whether both hold.
    pub fn and(&self, other: &Self) -> Self {
        Self { surely: self.surely && other.surely, possibly: self.possibly && other.possibly }
    }

    /// Whether one of them holds.
    pub fn or(&self, other: &Self) -> Self {
        Self { surely: self.surely || other.surely, possibly: self.possibly || other.possibly }
    }

    /// Whether it does not hold.
    pub fn not(&self) -> Self {
        Self { surely: !self.possibly, possibly: !self.surely }
    }
}

/// The planner's voxels.
#[derive(Debug)]
pub struct Voxels {
    /// Their grid.
    pub grid: Grid<Work>,
    /// The grid's frame in ct.
    pub ct_from_grid: Rigid<Ct, Work>,
    /// Flags per voxel, x-fastest: [`TARGET`], [`MATERIAL`], [`TARGET_BONE`], [`OUTSIDE`], and [`SHEET`] for all bone
    /// outside the target.
    pub class: Doubtful<Vec<u8>>,
    /// The least and the largest volume that a voxel of the target stands for, mm³: the own volume of its labels and shapes,
    /// divided by the number of voxels in them.
    pub target_mm3: [f64; 2],
}

impl Voxels {
    /// Classifies the voxels of `grid`.
    ///
    /// # Errors
    /// [`VerifyError::Grid`] if the closing's grid cannot be made.
    pub fn new(
        target: &TargetRule<'_>,
        density: &Density,
        ct_from_grid: Rigid<Ct, Work>,
        grid: Grid<Work>,
    ) -> Result<Self, VerifyError> {
        let [nx, ny, _] = grid.dims();
        let anatomy = target.anatomy();
        let closed = |bone_hu| Closed::new(anatomy, bone_hu, &ct_from_grid, &grid);
        let closed = if target.has_shape() {
            let (surely, possibly) =
                (closed(density.bone_hu + DOUBT_HU)?, closed(density.bone_hu - DOUBT_HU)?);
            Some(Doubtful { surely, possibly })
        } else {
            None
        };
        let middle = Vector3::from(grid.dims().map(|d| 0.5 * (d - 1) as f64)) * grid.spacing_mm().x;
        let class_of = |voxel: [usize; 3]| -> (u8, u8, [usize; 2]) {
            let center = grid.center(voxel);
            let outward = center + (center.coords - middle) * LABELS_OUTWARD;
            let hu = anatomy.hu(ct_from_grid * center);
            let labelled = |is: &dyn Fn(u16) -> bool| {
                held(anatomy.labels.grid(), ct_from_grid * outward, |v| {
                    is(v.map_or(0, |v| *anatomy.labels.get(v)))
                })
            };
            let p = ct_from_grid * center;
            let in_scan = held(anatomy.ct.grid(), p, |v| v.is_some());
            let filled = || filled(closed.as_ref(), center, hu, density.bone_hu);
            let own = target.own_count(p, &labelled);
            let beyond = target.drawn(p, &labelled).and(&in_scan.not());
            let target = target.holds(p, &labelled, &filled()).and(&in_scan);
            let flags = |is_target: bool, is_beyond: bool, may_be_outside: bool, doubt_hu: f64| -> u8 {
                let is_bone = hu >= density.bone_hu + doubt_hu;
                let mut flags = if may_be_outside && is_bone { SHEET } else { 0 };
                flags |= if is_beyond { OUTSIDE } else { 0 };
                if is_target {
                    flags |= TARGET;
                    flags |= if hu > density.air_hu + doubt_hu { MATERIAL } else { 0 };
                    flags |= if is_bone { TARGET_BONE } else { 0 };
                }
                flags
            };
            (
                flags(target.surely, beyond.surely, !target.possibly, DOUBT_HU),
                flags(target.possibly, beyond.possibly, !target.surely, -DOUBT_HU),
                own,
            )
        };
        let rows: Vec<(u8, u8, [usize; 2])> = (0..grid.len())
            .into_par_iter()
            .with_min_len(nx)
            .map(|n| {
                if n % (nx * ny) == 0 {
                    cancel::poll();
                }
                class_of(grid.voxel(n))
            })
            .collect();
        let count = |doubt: usize| rows.iter().map(|(_, _, own)| own[doubt]).sum::<usize>();
        let target_mm3 = match [count(1), count(0)] {
            [_, 0] => [grid.voxel_mm3(); 2],
            counts => counts.map(|count| target.own_mm3() / count as f64),
        };
        let (surely, possibly) = rows.into_iter().map(|(surely, possibly, _)| (surely, possibly)).unzip();
        Ok(Self { grid, ct_from_grid, class: Doubtful { surely, possibly }, target_mm3 })
    }

    /// Spacing, mm.
    pub fn spacing_mm(&self) -> f64 {
        self.grid.spacing_mm().x
    }

    /// The least and the largest volume of the voxels with `flag` that are in all of `sets`, mm³; each voxel of the target stands
    /// for [`Self::target_mm3`].
    pub fn volume_mm3(&self, flag: u8, sets: &[&Doubtful<Vec<bool>>]) -> [f64; 2] {
        let count = |class: &[u8], sets: Vec<&Vec<bool>>| {
            let is_in = |n: usize| class[n] & flag != 0 && sets.iter().all(|set| set[n]);
            (0..class.len()).into_par_iter().with_min_len(1 << 14).filter(|n| is_in(*n)).count()
        };
        let [least_mm3, most_mm3] = if flag == SHEET { [self.grid.voxel_mm3(); 2] } else { self.target_mm3 };
        [
            count(&self.class.surely, sets.iter().map(|set| &set.surely).collect()) as f64 * least_mm3,
            count(&self.class.possibly, sets.iter().map(|set| &set.possibly).collect()) as f64 * most_mm3,
        ]
    }

    /// Obstacle bone. `bone` and `target` are flags of the voxels; `bone` marks bone outside the target ([`SHEET`]).
    ///
    /// It consists of thick bone (parts with a cube of 2×2×2 voxels into which a ball of the band's diameter fits, and bone within
    /// a band of them) and, unless the case has sheets cut, of thin bone that is not a speck and is farther than the band from the
    /// target.
    pub fn obstacles(&self, bone: &[u8], target: &[u8], band_mm: f64, sheets: Sheets) -> Vec<bool> {
        let (dims, h) = (self.grid.dims(), self.spacing_mm());
        let is_bone = |n: usize| bone[n] & SHEET != 0;
        let thick = self.thick(is_bone, band_mm);
        if sheets == Sheets::Cut {
            return thick;
        }
        let from_target = edt::squared_voxels(dims, |n| target[n] & TARGET != 0);
        let beyond = ((band_mm + DOUBT_MM) / h).powi(2) as f32;
        let stays =
            |n: usize| thick[n] || is_bone(n) && from_target[n] > beyond && !is_speck(dims, &is_bone, n);
        (0..thick.len()).into_par_iter().with_min_len(1 << 12).map(stays).collect()
    }

    /// Bone that is not thinner than the band.
    fn thick(&self, is_bone: impl Fn(usize) -> bool + Sync, band_mm: f64) -> Vec<bool> {
        let (dims, h) = (self.grid.dims(), self.spacing_mm());
        let deep = edt::squared_voxels(dims, |n| !is_bone(n));
        let in_cube = in_cubes(dims, &is_bone);
        // a face lies half a voxel before the first centre beyond it
        let core = ((0.5 * (band_mm + h) - DOUBT_MM) / h).powi(2) as f32;
        let from_core = edt::squared_voxels(dims, |n| in_cube[n] && deep[n] >= core);
        let reach = (band_mm / h + 0.5).powi(2) as f32;
        from_core.iter().enumerate().map(|(n, d)| is_bone(n) && *d <= reach).collect()
    }
}

/// Whether a point is bone or enclosed by bone; always, where there is no shape.
fn filled(closed: Option<&Doubtful<Closed>>, center: Point<Work>, hu: f64, bone_hu: f64) -> Doubtful<bool> {
    let Some(closed) = closed else { return Doubtful::sure(true) };
    let enclosed = |closed: &Closed| held(&closed.grid, center, |v| v.is_some_and(|v| closed.at(v)));
    Doubtful {
        surely: hu >= bone_hu + DOUBT_HU || enclosed(&closed.surely).surely,
        possibly: hu >= bone_hu - DOUBT_HU || enclosed(&closed.possibly).possibly,
    }
}

/// Whether `holds` is true for the voxel in which a point lies; for a point on a face, surely if it is true for all voxels that
/// share the face, possibly if for any.
fn held<F: Frame>(grid: &Grid<F>, p: Point<F>, holds: impl Fn(Option<[usize; 3]>) -> bool) -> Doubtful<bool> {
    let index = grid.continuous_index(p);
    let sides = index.map(|c| [(c + 0.5 - DOUBT_VOXELS).floor(), (c + 0.5 + DOUBT_VOXELS).floor()]);
    let mut found = Doubtful { surely: true, possibly: false };
    for corner in 0..8usize {
        let upper: [usize; 3] = std::array::from_fn(|a| corner >> a & 1);
        if (0..3).any(|a| upper[a] == 1 && sides[a][0] == sides[a][1]) {
            continue;
        }
        let at: [f64; 3] = std::array::from_fn(|a| sides[a][upper[a]]);
        let is_in = (0..3).all(|a| at[a] >= 0.0 && at[a] < grid.dims()[a] as f64);
        let is = holds(is_in.then(|| at.map(|v| v as usize)));
        found.surely &= is;
        found.possibly |= is;
    }
    found
}

/// Whether the connected piece (by faces, edges and corners) of the mask that contains a voxel has fewer than eight voxels.
pub fn is_speck(dims: [usize; 3], is: &impl Fn(usize) -> bool, voxel: usize) -> bool {
    let [nx, ny, nz] = dims;
    let mut piece = vec![voxel];
    let mut next = 0;
    while let Some(&n) = piece.get(next) {
        next += 1;
        let at = [n % nx, n / nx % ny, n / (nx * ny)];
        for step in 0..27usize {
            // each coordinate one less, the same or one more
            let [i, j, k] = [step % 3, step / 3 % 3, step / 9];
            let (i, j, k) = (at[0] + i, at[1] + j, at[2] + k);
            if i == 0 || j == 0 || k == 0 || i > nx || j > ny || k > nz {
                continue;
            }
            let other = (i - 1) + nx * ((j - 1) + ny * (k - 1));
            if is(other) && !piece.contains(&other) {
                piece.push(other);
                if piece.len() >= SPECK_VOXELS {
                    return false;
                }
            }
        }
    }
    true
}

/// Which voxels belong to a cube of 2×2×2 of the mask.
fn in_cubes(dims: [usize; 3], is: impl Fn(usize) -> bool + Sync) -> Vec<bool> {
    let [nx, ny, nz] = dims;
    let corners = |n: usize| (0..8usize).map(move |c| n + (c & 1) + nx * (c >> 1 & 1) + nx * ny * (c >> 2));
    let is_full = |[i, j, k]: [usize; 3]| {
        i + 1 < nx && j + 1 < ny && k + 1 < nz && corners(i + nx * (j + ny * k)).all(&is)
    };
    (0..nx * ny * nz)
        .into_par_iter()
        .with_min_len(nx)
        .map(|n| {
            let at = [n % nx, n / nx % ny, n / (nx * ny)];
            is(n)
                && (0..8usize).any(|c| {
                    // the cube whose corner lies back by 0 or 1 along each axis
                    let low: [usize; 3] = std::array::from_fn(|a| at[a].wrapping_sub(c >> a & 1));
                    low.iter().all(|v| *v != usize::MAX) && is_full(low)
                })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_on_a_face_is_in_doubt_and_no_other_is() {
        let grid = Grid::<Ct>::aligned([4, 4, 4], 0.5, Point::new(0.0, 0.0, 0.0)).unwrap();
        let left = |v: Option<[usize; 3]>| v.is_some_and(|v| v[0] < 2);
        let at = |x: f64| held(&grid, Point::new(x, 0.3, 0.3), left);
        assert_eq!(at(0.74), Doubtful { surely: true, possibly: true });
        assert_eq!(at(0.75), Doubtful { surely: false, possibly: true });
        assert_eq!(at(0.76), Doubtful { surely: false, possibly: false });
        assert_eq!(at(-0.25), Doubtful { surely: false, possibly: true });
    }

    #[test]
    fn a_speck_has_less_than_eight_voxels_however_they_are_joined() {
        let dims = [9, 8, 7];
        let chain = |length: usize| move |n: usize| n.is_multiple_of(1 + 9 + 72) && n / (1 + 9 + 72) < length;
        for n in 0..7 {
            assert!(is_speck(dims, &chain(7), n * 82));
        }
        let wall = |n: usize| n / 72 == 6;
        assert!(!is_speck(dims, &wall, 6 * 72 + 5));
        let cube = |n: usize| [n % 9, n / 9 % 8, n / 72].iter().all(|c| (3..5).contains(c));
        assert!(!is_speck(dims, &cube, 3 + 9 * (4 + 8 * 3)));
        assert!(is_speck(dims, &|n| cube(n) && n != 3 + 9 * (3 + 8 * 3), 3 + 9 * (4 + 8 * 3)));
    }

    #[test]
    fn cubes_are_those_found_one_by_one() {
        let dims = [7, 6, 5];
        let is = |n: usize| (n * 7919) % 11 < 8;
        let found = in_cubes(dims, is);
        let mut brute = vec![false; 7 * 6 * 5];
        for k in 0..4 {
            for j in 0..5 {
                for i in 0..6 {
                    let cube: Vec<usize> =
                        (0..8).map(|c| i + (c & 1) + 7 * (j + (c >> 1 & 1) + 6 * (k + (c >> 2)))).collect();
                    if cube.iter().all(|n| is(*n)) {
                        cube.iter().for_each(|n| brute[*n] = true);
                    }
                }
            }
        }
        assert!(found == brute && found.contains(&true) && found.contains(&false));
    }
}
