//! What a label map holds: the volume, the grey values and the middle of every label, and which labels lie beside one.
//!
//! A voxel of several labels counts for each. Grey values are those of the CT's nearest voxel; what lies beyond the CT has none.

use std::collections::{BTreeMap, BTreeSet};

use bonemill_geometry::{Ct, Point, Volume};

/// Width of the bins from which quantiles are taken, HU.
const BIN_HU: f64 = 10.0;
/// The lowest bin's lower end, HU.
const LEAST_HU: f64 = -1500.0;
/// How many bins: up to 5000 HU.
const BINS: usize = 650;

/// A label as it stands in a map.
#[derive(Debug, Clone, PartialEq)]
pub struct LabelSurvey {
    /// Its number.
    pub number: u16,
    /// Volume of its voxels, mm³.
    pub volume_mm3: f64,
    /// The mean of its voxels' centres.
    pub center: Point<Ct>,
    /// Its grey values; `None` where it lies beyond the CT.
    pub hu: Option<GreyValues>,
}

/// Grey values of a label.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GreyValues {
    /// Mean, HU.
    pub mean_hu: f64,
    /// What 5 % of the voxels do not exceed, to 10 HU.
    pub low_hu: f64,
    /// What 95 % do not exceed, to 10 HU.
    pub high_hu: f64,
}

/// The labels of a map but 0, ascending; `further` are further labels of voxels, by their places in memory.
pub fn survey_labels(
    ct: &Volume<f32, Ct>,
    labels: &Volume<u16, Ct>,
    further: &[(u32, u16)],
) -> Vec<LabelSurvey> {
    let grid = labels.grid();
    let is_same = grid == ct.grid();
    let hu_at = |place: usize| {
        let place = if is_same {
            Some(place)
        } else {
            ct.grid().nearest(grid.center(grid.voxel(place))).map(|v| ct.grid().index(v))
        };
        ct.data().get(place?).copied()
    };
    let mut sums: BTreeMap<u16, Sums> = BTreeMap::new();
    let shown =
        labels.data().iter().enumerate().filter(|(_, label)| **label != 0).map(|(n, label)| (n, *label));
    for (place, label) in shown.chain(further.iter().map(|(place, label)| (*place as usize, *label))) {
        sums.entry(label).or_default().add(grid.voxel(place), hu_at(place));
    }
    let survey = |(number, sums): (u16, Sums)| LabelSurvey {
        number,
        volume_mm3: sums.voxels as f64 * grid.voxel_mm3(),
        center: grid.at(sums.index.map(|sum| sum as f64 / sums.voxels as f64)),
        hu: sums.grey_values(),
    };
    sums.into_iter().map(survey).collect()
}

/// The labels that share a voxel with `label`, or a face, an edge or a corner of one, ascending.
pub fn labels_beside(labels: &Volume<u16, Ct>, further: &[(u32, u16)], label: u16) -> Vec<u16> {
    let grid = labels.grid();
    let dims = grid.dims();
    let mut at: BTreeMap<usize, Vec<u16>> = BTreeMap::new();
    further.iter().for_each(|(place, other)| at.entry(*place as usize).or_default().push(*other));
    let own = labels.data().iter().enumerate().filter(|(_, l)| **l == label).map(|(n, _)| n);
    let shared = further.iter().filter(|(_, l)| *l == label).map(|(place, _)| *place as usize);
    let mut found = BTreeSet::new();
    for place in own.chain(shared) {
        let voxel = grid.voxel(place);
        let around = |axis: usize| voxel[axis].saturating_sub(1)..(voxel[axis] + 2).min(dims[axis]);
        for k in around(2) {
            for j in around(1) {
                for i in around(0) {
                    let beside = grid.index([i, j, k]);
                    found.extend(labels.data().get(beside).copied().filter(|l| *l != 0 && *l != label));
                    found.extend(at.get(&beside).into_iter().flatten().copied().filter(|l| *l != label));
                }
            }
        }
    }
    found.into_iter().collect()
}

/// How far bone reaches from left to right: the x between which all but 2 % of the voxels of at least `bone_hu` lie, mm; `None`
/// without bone.
pub fn bone_extent_x_mm(ct: &Volume<f32, Ct>, bone_hu: f64) -> Option<[f64; 2]> {
    let grid = ct.grid();
    let corners = grid.corners().map(|corner| corner.coords.x);
    let [low, high] = [
        corners.iter().copied().fold(f64::INFINITY, f64::min),
        corners.iter().copied().fold(f64::NEG_INFINITY, f64::max),
    ];
    // one bin a mm
    let mut counts = vec![0u64; (high - low).ceil().max(1.0) as usize + 1];
    for (place, _) in ct.data().iter().enumerate().filter(|(_, hu)| f64::from(**hu) >= bone_hu) {
        let x_mm = grid.center(grid.voxel(place)).coords.x;
        if let Some(count) = counts.get_mut((x_mm - low) as usize) {
            *count += 1;
        }
    }
    let all: u64 = counts.iter().sum();
    let quantile = |share: f64| quantile(counts.iter().copied(), share * all as f64).map(|bin| low + bin);
    if all == 0 { None } else { Some([quantile(0.01)?, quantile(0.99)?]) }
}

/// Where a running sum reaches `count`, in bins, linear within the bin.
fn quantile(counts: impl Iterator<Item = u64>, count: f64) -> Option<f64> {
    let mut before = 0.0;
    for (bin, inside) in counts.enumerate() {
        let inside = inside as f64;
        if inside > 0.0 && before + inside >= count {
            return Some(bin as f64 + ((count - before) / inside).clamp(0.0, 1.0));
        }
        before += inside;
    }
    None
}

/// Sums over a label's voxels.
#[derive(Default)]
struct Sums {
    voxels: usize,
    index: [u64; 3],
    hu: f64,
    hu_voxels: u64,
    bins: Vec<u64>,
}

impl Sums {
    fn add(&mut self, voxel: [usize; 3], hu: Option<f32>) {
        self.voxels += 1;
        self.index.iter_mut().zip(voxel).for_each(|(sum, i)| *sum += i as u64);
        let Some(hu) = hu.map(f64::from) else { return };
        self.hu += hu;
        self.hu_voxels += 1;
        self.bins.resize(BINS, 0);
        let bin = ((hu - LEAST_HU) / BIN_HU).clamp(0.0, (BINS - 1) as f64) as usize;
        if let Some(count) = self.bins.get_mut(bin) {
            *count += 1;
        }
    }

    fn grey_values(&self) -> Option<GreyValues> {
        let of = |share: f64| {
            let bins = quantile(self.bins.iter().copied(), share * self.hu_voxels as f64)?;
            Some(((LEAST_HU + BIN_HU * bins) / BIN_HU).round() * BIN_HU)
        };
        let mean_hu = self.hu / self.hu_voxels as f64;
        if self.hu_voxels == 0 {
            None
        } else {
            Some(GreyValues { mean_hu, low_hu: of(0.05)?, high_hu: of(0.95)? })
        }
    }
}

#[cfg(test)]
mod tests {
    use bonemill_geometry::Grid;
    use nalgebra::Vector3;

    use super::*;

    fn grid() -> Grid<Ct> {
        Grid::aligned([10, 4, 3], 0.5, Point::new(-1.0, 2.0, 3.0)).unwrap()
    }

    fn fill(volume: &mut Volume<u16, Ct>, voxels: &[[usize; 3]], label: u16) {
        for voxel in voxels {
            let place = volume.grid().index(*voxel);
            volume.data_mut()[place] = label;
        }
    }

    #[test]
    fn a_label_has_its_volume_its_middle_and_its_grey_values_on_any_grid() {
        let mut labels = Volume::filled(grid(), 0u16);
        fill(&mut labels, &[[2, 1, 1], [4, 1, 1]], 7);
        let mut ct = Volume::filled(grid(), 100.0f32);
        ct.data_mut()[labels.grid().index([4, 1, 1])] = 300.0;
        let further = [(labels.grid().index([2, 1, 1]) as u32, 9)];
        let found = survey_labels(&ct, &labels, &further);
        let numbers: Vec<_> = found.iter().map(|l| (l.number, l.volume_mm3)).collect();
        assert_eq!(numbers, [(7, 0.25), (9, 0.125)]);
        assert_eq!(found[0].center.coords, Vector3::new(0.5, 2.5, 3.5));
        assert_eq!(found[0].hu.unwrap().mean_hu, 200.0);
        assert_eq!((found[0].hu.unwrap().low_hu, found[0].hu.unwrap().high_hu), (100.0, 310.0));
        // a CT that ends before the second voxel
        let half = Grid::aligned([4, 4, 3], 0.5, Point::new(-1.0, 2.0, 3.0)).unwrap();
        let found = survey_labels(&Volume::filled(half, 40.0), &labels, &[]);
        assert_eq!(found[0].hu.unwrap().mean_hu, 40.0);
        let away = Grid::aligned([4, 4, 3], 0.5, Point::new(50.0, 2.0, 3.0)).unwrap();
        assert_eq!(survey_labels(&Volume::filled(away, 40.0), &labels, &[])[0].hu, None);
    }

    #[test]
    fn labels_beside_share_a_voxel_or_a_corner() {
        let mut labels = Volume::filled(grid(), 0u16);
        fill(&mut labels, &[[2, 1, 1]], 20);
        fill(&mut labels, &[[3, 2, 2]], 1);
        fill(&mut labels, &[[4, 1, 1]], 2);
        let shared = [(labels.grid().index([2, 1, 1]) as u32, 3)];
        assert_eq!(labels_beside(&labels, &shared, 20), [1, 3]);
        assert_eq!(labels_beside(&labels, &shared, 3), [1, 20]);
        assert_eq!(labels_beside(&labels, &[], 2), [1]);
    }

    #[test]
    fn bone_reaches_from_its_first_to_its_last_per_cent() {
        let wide = Grid::aligned([200, 1, 1], 1.0, Point::new(-100.0, 0.0, 0.0)).unwrap();
        let mut ct = Volume::filled(wide, -1000.0f32);
        assert_eq!(bone_extent_x_mm(&ct, 200.0), None);
        ct.data_mut()[50..150].fill(1000.0);
        let [low, high] = bone_extent_x_mm(&ct, 200.0).unwrap();
        assert!((low + 49.0).abs() < 1.1 && (high - 49.0).abs() < 1.1, "{low} {high}");
    }
}
