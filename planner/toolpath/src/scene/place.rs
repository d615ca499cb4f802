//! Where a label map lies: beside the CT's voxels, or beyond the CT's edge.
//!
//! A map with the CT's dimensions is expected to fill the CT's box. One with nearly the CT's spacing and directions is expected to be
//! a crop of its grid: its voxels are the CT's, so that its first lies a whole number of them away. Nothing of this is expected of a
//! map with voxels of its own. Of every map the labels that a case names must lie in the scan, at least in part.

use std::collections::BTreeMap;

use bonemill_geometry::{Ct, Grid, Point, Volume};
use bonemill_imaging::{AffineChoice, displacement_mm};
use nalgebra::Vector3;
use rayon::prelude::*;

use super::SceneError;

/// Smaller displacements are rounding of header fields, voxels.
const SAME_VOXELS: f64 = 0.01;
/// A map of the CT's dimensions that is displaced by more belongs to another place, voxels.
const MOST_VOXELS: f64 = 1.0;
/// Spacings that differ by less, as a share, and directions by less, as a sine, are meant to be the same.
const NEARLY_SAME: f64 = 0.01;
/// A centre this far beyond the scan's edge still lies on it, mm: rounding.
const ON_EDGE_MM: f64 = 1e-6;

/// A label map that lies beside the CT's voxels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Displaced {
    /// The largest distance of a corner, mm.
    pub mm: f64,
    /// The same in the CT's smallest voxel spacing.
    pub voxels: f64,
    /// Whether the map has the CT's dimensions; else it has nearly its spacing.
    pub is_of_its_size: bool,
}

impl Displaced {
    /// How far the map lies beside; `None` for one that does not, and for one with voxels of its own.
    pub fn of(ct: &Grid<Ct>, labels: &Grid<Ct>) -> Option<Self> {
        let of_its_size = displacement_mm(ct, labels);
        let mm = of_its_size.or_else(|| of_its_spacing_mm(ct, labels))?;
        let voxels = mm / ct.spacing_mm().min();
        let found = Self { mm, voxels, is_of_its_size: of_its_size.is_some() };
        (voxels > SAME_VOXELS).then_some(found)
    }

    /// The refusal of a map of the CT's dimensions that lies elsewhere. `choice`: which of the map's transforms the case chooses, `None` for a
    /// format that has one only; what is chosen is not refused.
    pub fn refusal(&self, choice: Option<AffineChoice>) -> Option<SceneError> {
        let Self { mm, voxels, is_of_its_size } = *self;
        let is_chosen = choice.is_some_and(|choice| choice != AffineChoice::Auto);
        let is_elsewhere = is_of_its_size && voxels > MOST_VOXELS && !is_chosen;
        is_elsewhere.then_some(SceneError::LabelsDisplaced { mm, voxels, is_nifti: choice.is_some() })
    }

    /// A warning.
    pub fn text(&self) -> String {
        let Self { mm, voxels, is_of_its_size } = self;
        if *is_of_its_size {
            return format!(
                "the label map has the CT's dimensions, but lies up to {mm:.3} mm ({voxels:.2} voxels) beside it: were its spacing and \
                 origin taken from the CT?"
            );
        }
        format!(
            "the label map has nearly the CT's spacing and directions, but its voxels lie up to {mm:.3} mm ({voxels:.2} voxels) beside \
             the CT's, counted from its first: if it was drawn on this CT, its spacing or origin was changed; it is taken to lie \
             where its header says"
        )
    }
}

/// The largest distance of one of the map's outermost centres from the CT's centre (or the place where its grid goes on) that it has
/// if the first voxel is the CT's nearest, mm, where spacings and directions are nearly the same.
fn of_its_spacing_mm(ct: &Grid<Ct>, labels: &Grid<Ct>) -> Option<f64> {
    let turn = ct.axes().transpose() * labels.axes();
    let mut step = [Vector3::zeros(); 3];
    for (axis, step) in step.iter_mut().enumerate() {
        let direction = turn.column(axis);
        let along = direction.iamax();
        step[along] = direction[along].signum();
        let ratio = labels.spacing_mm()[axis] / ct.spacing_mm()[along];
        if (ratio - 1.0).abs() > NEARLY_SAME || (direction - *step).norm() > NEARLY_SAME {
            return None;
        }
    }
    let index = |voxel| Vector3::from(ct.continuous_index(labels.center(voxel)));
    let first = index([0; 3]).map(f64::round);
    let off_mm = |corner: usize| {
        let voxel: [usize; 3] =
            std::array::from_fn(|axis| if corner >> axis & 1 == 0 { 0 } else { labels.dims()[axis] - 1 });
        let expected = (0..3).fold(first, |at, axis| at + step[axis] * voxel[axis] as f64);
        (index(voxel) - expected).component_mul(&ct.spacing_mm()).norm()
    };
    Some((0..8).map(off_mm).fold(0.0, f64::max))
}

/// How much of a label there is, and how much of it lies outside the CT: by the centres of its voxels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LabelExtent {
    /// Its volume, mm³.
    pub mm3: f64,
    /// What of it lies outside the CT, mm³.
    pub outside_mm3: f64,
    /// Least distance of a centre outside from the CT's edge, mm; infinite where there is none.
    pub beyond_mm: f64,
}

impl LabelExtent {
    /// The refusal of a label of which nothing lies in the CT.
    pub fn refusal(&self, what: &str, label: u16) -> Option<SceneError> {
        let is_outside = self.mm3 > 0.0 && self.outside_mm3 >= self.mm3;
        is_outside.then(|| SceneError::LabelOutside {
            what: what.into(),
            label,
            mm3: self.mm3,
            beyond_mm: self.beyond_mm,
        })
    }

    /// A warning where a part lies outside.
    pub fn text(&self, what: &str) -> Option<String> {
        (self.outside_mm3 > 0.0).then(|| {
            format!(
                "{:.1} % of {what} lies outside the CT: {:.2} of {:.2} mm³",
                100.0 * self.outside_mm3 / self.mm3,
                self.outside_mm3,
                self.mm3
            )
        })
    }
}

/// Counts of a label's voxels.
#[derive(Clone, Copy)]
struct Tally {
    voxels: u64,
    outside: u64,
    beyond_mm: f64,
}

const NONE: Tally = Tally { voxels: 0, outside: 0, beyond_mm: f64::INFINITY };

impl Tally {
    fn add(&mut self, beyond_mm: f64) {
        self.voxels += 1;
        if beyond_mm > ON_EDGE_MM {
            self.outside += 1;
            self.beyond_mm = self.beyond_mm.min(beyond_mm);
        }
    }

    fn and(self, other: &Self) -> Self {
        Self {
            voxels: self.voxels + other.voxels,
            outside: self.outside + other.outside,
            beyond_mm: self.beyond_mm.min(other.beyond_mm),
        }
    }
}

/// The extents of some labels of a map; `further` are further labels of voxels, by their places in memory.
pub fn label_extents(
    ct: &Grid<Ct>,
    labels: &Volume<u16, Ct>,
    further: &[(u32, u16)],
    wanted: impl Iterator<Item = u16>,
) -> BTreeMap<u16, LabelExtent> {
    let mut wanted: Vec<u16> = wanted.collect();
    wanted.sort_unstable();
    wanted.dedup();
    let mut place_of = vec![None; 1 << 16];
    wanted.iter().enumerate().for_each(|(n, label)| place_of[usize::from(*label)] = Some(n));
    let grid = labels.grid();
    // the scan is convex: with its corners the whole map lies in it
    let is_within = grid.corners().iter().all(|corner| beyond_mm(ct, *corner) <= ON_EDGE_MM);
    let tally = |mut all: Vec<Tally>, place: usize, label: u16| {
        if let Some(own) = place_of[usize::from(label)].and_then(|n| all.get_mut(n)) {
            own.add(if is_within { 0.0 } else { beyond_mm(ct, grid.center(grid.voxel(place))) });
        }
        all
    };
    let none = || vec![NONE; wanted.len()];
    let sum = |a: Vec<Tally>, b: Vec<Tally>| a.iter().zip(&b).map(|(a, b)| a.and(b)).collect();
    let shown = labels.data().par_iter().with_min_len(1 << 16).enumerate();
    let shown = shown.fold(none, |all, (place, label)| tally(all, place, *label)).reduce(none, sum);
    let all = further.iter().fold(shown, |all, (place, label)| tally(all, *place as usize, *label));
    let mm3 = |voxels: u64| voxels as f64 * grid.voxel_mm3();
    let extent = |tally: &Tally| LabelExtent {
        mm3: mm3(tally.voxels),
        outside_mm3: mm3(tally.outside),
        beyond_mm: tally.beyond_mm,
    };
    wanted.iter().copied().zip(all.iter().map(extent)).collect()
}

/// Distance of a place from the CT's box, mm; 0 in it.
fn beyond_mm(ct: &Grid<Ct>, p: Point<Ct>) -> f64 {
    let (index, dims) = (ct.continuous_index(p), ct.dims());
    let past = |axis: usize, _: usize| {
        let voxels = (-0.5 - index[axis]).max(index[axis] + 0.5 - dims[axis] as f64).max(0.0);
        voxels * ct.spacing_mm()[axis]
    };
    Vector3::from_fn(past).norm()
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, Rotation3};

    use super::*;

    const DIMS: [usize; 3] = [40, 30, 20];

    /// A turned CT with three different spacings.
    fn ct() -> Grid<Ct> {
        let axes = Rotation3::from_euler_angles(0.1, -0.2, 0.3).into_inner();
        Grid::new(DIMS, Vector3::new(0.4, 0.5, 0.8), axes, Vector3::new(-7.0, 3.0, 11.0)).unwrap()
    }

    /// A grid whose first voxel lies at a continuous index of the CT's, with spacings changed by a factor.
    fn map(dims: [usize; 3], first: [f64; 3], factor: [f64; 3]) -> Grid<Ct> {
        let spacing = ct().spacing_mm().component_mul(&Vector3::from(factor));
        Grid::new(dims, spacing, *ct().axes(), ct().at(first).coords).unwrap()
    }

    fn off(labels: &Grid<Ct>) -> Option<(f64, f64)> {
        Displaced::of(&ct(), labels).map(|found| {
            assert!(found.refusal(Some(AffineChoice::Auto)).is_none() || found.is_of_its_size);
            (found.mm, found.voxels)
        })
    }

    #[test]
    fn a_crop_of_the_cts_grid_lies_on_its_voxels_in_any_order_and_beyond_its_edge() {
        let same = [1.0; 3];
        assert_eq!(off(&map([12, 9, 7], [5.0, 3.0, 2.0], same)), None);
        assert_eq!(off(&map([50, 50, 50], [-8.0, -1.0, -20.0], same)), None);
        // axes stored as −j, k, i
        let axes = Matrix3::from_columns(&[
            -ct().axes().column(1).into_owned(),
            ct().axes().column(2).into_owned(),
            ct().axes().column(0).into_owned(),
        ]);
        let stored =
            |first| Grid::new([9, 7, 12], Vector3::new(0.5, 0.8, 0.4), axes, ct().at(first).coords).unwrap();
        assert_eq!(off(&stored([5.0, 11.0, 2.0])), None);
        let (mm, _) = off(&stored([5.0, 11.25, 2.0])).unwrap();
        assert!((mm - 0.25 * 0.5).abs() < 1e-9, "{mm}");
    }

    #[test]
    fn a_crop_that_is_shifted_by_parts_of_voxels_or_whose_spacing_is_rounded_is_told_and_never_refused() {
        let (mm, voxels) = off(&map([12, 9, 7], [5.5, 3.0, 2.25], [1.0; 3])).unwrap();
        assert!((mm - f64::hypot(0.2, 0.2)).abs() < 1e-9 && (voxels - mm / 0.4).abs() < 1e-9, "{mm}");
        // the last of 30 voxels is 29 steps of 0.5 % away
        let (mm, _) = off(&map([30, 9, 7], [0.0; 3], [1.005, 1.0, 1.0])).unwrap();
        assert!((mm - 29.0 * 0.002).abs() < 1e-9, "{mm}");
        // resampled on purpose: halved, doubled, by 2 %; or turned
        for factor in [[0.5; 3], [2.0; 3], [1.02, 1.0, 1.0]] {
            assert_eq!(off(&map([30, 9, 7], [0.3; 3], factor)), None);
        }
        let turned = Grid::aligned([30, 9, 7], 0.4, ct().origin()).unwrap();
        assert_eq!(off(&turned), None);
    }

    #[test]
    fn a_label_has_the_volume_that_lies_outside_and_its_distance_from_the_edge() {
        let grid = map([50, 30, 20], [0.0; 3], [1.0; 3]);
        let mut labels = Volume::filled(grid.clone(), 0u16);
        let mut fill = |is: std::ops::Range<usize>, label| {
            for i in is {
                let place = grid.index([i, 4, 4]);
                labels.data_mut()[place] = label;
            }
        };
        fill(10..14, 1);
        fill(38..42, 2);
        fill(45..48, 3);
        let shared = [(grid.index([49, 4, 4]) as u32, 1)];
        let found = label_extents(&ct(), &labels, &shared, [3, 2, 1, 2, 9].into_iter());
        let voxel_mm3 = 0.4 * 0.5 * 0.8;
        let [a, b, c] = [1, 2, 3].map(|label| found[&label]);
        for (extent, voxels, outside) in [(a, 5.0, 1.0), (b, 4.0, 2.0), (c, 3.0, 3.0), (found[&9], 0.0, 0.0)]
        {
            assert!((extent.mm3 - voxels * voxel_mm3).abs() < 1e-12, "{extent:?}");
            assert!((extent.outside_mm3 - outside * voxel_mm3).abs() < 1e-12, "{extent:?}");
        }
        // from the face at 39.5 to the centre at 45
        assert!((c.beyond_mm - 5.5 * 0.4).abs() < 1e-9, "{c:?}");
        let said = c.refusal("structure 'nerve'", 3).unwrap().to_string();
        for part in ["structure 'nerve' (label 3)", "0.48 mm³", "2.20 mm beyond", "do not share a place"] {
            assert!(said.contains(part), "{part}: {said}");
        }
        assert_eq!((a.refusal("", 1).is_some(), found[&9].refusal("", 9).is_some()), (false, false));
        assert_eq!(b.text("a").unwrap(), "50.0 % of a lies outside the CT: 0.32 of 0.64 mm³");
        assert_eq!(found[&9].text(""), None);
    }
}
