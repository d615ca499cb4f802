//! Whether the label map belongs to the CT: it lies where the CT lies, and its labels are where such bodies can be.
//!
//! Segmenters have written label maps with the CT's voxels but another spacing or origin, and crops of another scan.

use std::collections::BTreeMap;

use bonemill_geometry::{Ct, Point};
use rayon::prelude::*;

use super::place::{Displaced, LabelExtent};
use super::{SceneError, SceneSpec, Target};

/// Voxels of a label that are looked at.
const SAMPLES: usize = 20_000;
/// Of these, voxels from which the surroundings are looked at.
const VIEWS: usize = 200;
/// A target with a smaller share of bone is none, of its voxels.
const LEAST_BONE: f64 = 0.01;
/// Steps of a view through the scan, mm.
const STEP_MM: f64 = 2.0;
/// Names of structures that hold air, in lower case, words by spaces.
const OF_AIR: [&str; 6] = ["ear canal", "external auditory", "middle ear", "tympan", "antrum", "air"];

/// A warning where the map lies beside the CT.
///
/// # Errors
/// [`SceneError::LabelsDisplaced`] by more than a voxel, unless the case says which transform of the map holds.
pub(super) fn displaced(spec: &SceneSpec) -> Result<Option<String>, SceneError> {
    let Some(found) = Displaced::of(spec.ct.grid(), spec.labels.grid()) else { return Ok(None) };
    match found.refusal(spec.labels_affine) {
        Some(refusal) => Err(refusal),
        None => Ok(Some(found.text())),
    }
}

/// Warnings of structures that lie outside the CT in part; the target has its own.
///
/// # Errors
/// [`SceneError::LabelOutside`] for a label of the case of which nothing lies in the CT.
pub(super) fn outside(
    spec: &SceneSpec,
    named: &[(String, u16)],
    extents: &BTreeMap<u16, LabelExtent>,
) -> Result<Vec<String>, SceneError> {
    let refusal = |(what, label): &(String, u16)| extents.get(label)?.refusal(what, *label);
    if let Some(refusal) = named.iter().find_map(refusal) {
        return Err(refusal);
    }
    let structures = spec.structures.iter();
    let told =
        structures.filter_map(|(name, label)| extents.get(label)?.text(&format!("structure '{name}'")));
    Ok(told.collect())
}

/// What is implausible about the labels that the case names, and the median of each structure's grey values, HU.
pub(super) fn looked_at(spec: &SceneSpec) -> (Vec<String>, Vec<Option<f64>>) {
    let (mut warnings, mut medians_hu) = (Vec::new(), Vec::new());
    if let Target::Label(label) = spec.target {
        let found = Found::of(spec, label);
        if found.bone_share < LEAST_BONE && !found.hu.is_empty() {
            warnings.push(format!(
                "the target is hardly bone: {:.1} % of it reaches density.bone_hu = {} HU, and the median of its grey values is \
                 {:.0} HU",
                100.0 * found.bone_share,
                spec.bone_hu,
                found.median_hu()
            ));
        }
        warnings.extend(found.misplaced(spec, "the target"));
    }
    for (name, label) in spec.structures {
        let found = Found::of(spec, *label);
        let what = format!("structure '{name}'");
        let words: String =
            name.to_lowercase().chars().map(|c| if c.is_alphabetic() { c } else { ' ' }).collect();
        let is_of_air = OF_AIR.iter().any(|of| words.contains(of));
        let misplaced = found.misplaced(spec, &what);
        if misplaced.is_none() && !is_of_air && !found.hu.is_empty() && found.median_hu() <= spec.air_hu {
            warnings.push(format!(
                "{what} lies in air: the median of its grey values is {:.0} HU, at or below density.air_hu = {} HU",
                found.median_hu(),
                spec.air_hu
            ));
        }
        warnings.extend(misplaced);
        medians_hu.push((!found.hu.is_empty()).then(|| found.median_hu()));
    }
    (warnings, medians_hu)
}

/// A label in the CT.
struct Found {
    /// Grey values at voxels of it that lie in the CT, ascending.
    hu: Vec<f32>,
    /// Share of these at or above `bone_hu`.
    bone_share: f64,
    /// Share of its voxels that lies in the air around the body.
    outside_share: f64,
}

impl Found {
    fn of(spec: &SceneSpec, label: u16) -> Self {
        let (ct, labels) = (spec.ct.grid(), spec.labels.grid());
        let is = |l: &u16| *l == label;
        let count = spec.labels.data().par_iter().with_min_len(1 << 16).filter(|l| is(l)).count();
        let all = spec.labels.data().iter().enumerate().filter(|(_, l)| is(l));
        let places = all.step_by(count.div_ceil(SAMPLES).max(1)).map(|(n, _)| labels.center(labels.voxel(n)));
        let places: Vec<Point<Ct>> = places.collect();
        let hu_at = |p: &Point<Ct>| ct.nearest(*p).map(|v| *spec.ct.get(v));
        let mut hu: Vec<f32> = places.iter().filter_map(hu_at).collect();
        hu.sort_unstable_by(f32::total_cmp);
        let share = |part: usize, whole: usize| part as f64 / whole.max(1) as f64;
        let bone = hu.iter().filter(|hu| f64::from(**hu) >= spec.bone_hu).count();
        let views = places.iter().step_by(places.len().div_ceil(VIEWS).max(1));
        let outside = views.clone().filter(|p| is_outside_body(spec, **p)).count();
        Self { bone_share: share(bone, hu.len()), outside_share: share(outside, views.count()), hu }
    }

    fn median_hu(&self) -> f64 {
        self.hu.get(self.hu.len() / 2).map_or(0.0, |hu| f64::from(*hu))
    }

    /// A warning where more than half of it lies outside the body.
    fn misplaced(&self, spec: &SceneSpec, what: &str) -> Option<String> {
        (self.outside_share > 0.5).then(|| {
            format!(
                "{:.0} % of {what} lies outside the body, in air (at or below density.air_hu = {} HU) that is open to half of \
                 all sides",
                100.0 * self.outside_share,
                spec.air_hu
            )
        })
    }
}

/// Whether a place is in air, and sees nothing but air in at least half of 26 directions to the scan's edge.
fn is_outside_body(spec: &SceneSpec, p: Point<Ct>) -> bool {
    let ct = spec.ct.grid();
    let is_air = |p: Point<Ct>| ct.nearest(p).map(|v| f64::from(*spec.ct.get(v)) <= spec.air_hu);
    if is_air(p) != Some(true) {
        return false;
    }
    let is_open = |n: &usize| {
        let direction =
            nalgebra::Vector3::new((n % 3) as f64, (n / 3 % 3) as f64, (n / 9) as f64).add_scalar(-1.0);
        let step = direction.normalize() * STEP_MM;
        let mut at = p;
        loop {
            at = Point::from_coords(at.coords + step);
            match is_air(at) {
                Some(true) => {}
                Some(false) => return false,
                None => return true,
            }
        }
    };
    // the middle one of 27 is no direction
    (0..27).filter(|n| *n != 13).filter(is_open).count() >= 13
}
