//! 3D Slicer's segmentation, .seg.nrrd: keys that name segments, and layers for segments that overlap.
//!
//! A segment has a layer and a value in it. The image is cropped to its segments; `space origin` is that of the cropped image, so
//! `ReferenceImageExtentOffset` and the segments' extents, which say the same in voxels of another image, are not needed. An image of a single
//! voxel is what 3D Slicer writes for a segmentation without any.
//! **Source:** slicer.readthedocs.io, "Segmentations", seg.nrrd file format.

use std::collections::HashMap;

use super::super::labels::Drawing;
use super::super::problem::FormatProblem;
use super::super::raster::Voxels;

/// A segment as the keys give it.
struct Segment {
    name: String,
    layer: usize,
    value: u16,
}

/// Number and name of each segment, the map, and how many voxels have a value without a segment.
pub(in super::super) struct Segments {
    pub names: Vec<(u16, String)>,
    pub drawing: Drawing,
    pub unnamed_voxels: u64,
}

/// The segments of an image whose keys name some; `None` where they do not.
///
/// # Errors
/// [`FormatProblem`] for keys that contradict the image, and where no voxel belongs to a segment.
pub(in super::super) fn segments(
    voxels: &Voxels<u16>,
    keys: &[(String, String)],
) -> Result<Option<Segments>, FormatProblem> {
    let layers = voxels.values.len() / voxels.grid.len();
    let found = listed(keys, layers)?;
    if found.is_empty() {
        return Ok(None);
    }
    if voxels.grid.len() == 1 {
        return Err(FormatProblem::Empty);
    }
    // values count within their layer; where they are unique they are the map's numbers too
    let mut values: Vec<u16> = found.iter().map(|s| s.value).collect();
    values.sort_unstable();
    let is_unique = values.windows(2).all(|w| w.first() != w.last());
    let number = |place: usize, s: &Segment| if is_unique { s.value } else { place as u16 + 1 };
    let numbers: HashMap<(usize, u16), u16> =
        found.iter().enumerate().map(|(place, s)| ((s.layer, s.value), number(place, s))).collect();
    if numbers.len() < found.len() {
        return Err(FormatProblem::field(
            "Segment…_LabelValue",
            "of two segments",
            "another value or another layer",
        ));
    }
    let (mut drawing, mut unnamed_voxels) = (Drawing::new(voxels.grid.len()), 0);
    for (place, of_voxel) in voxels.values.chunks_exact(layers).enumerate() {
        for (layer, value) in of_voxel.iter().enumerate().filter(|(_, value)| **value != 0) {
            match numbers.get(&(layer, *value)) {
                Some(number) => drawing.draw(place, *number),
                None => unnamed_voxels += 1,
            }
        }
    }
    if drawing.labels.iter().all(|label| *label == 0) {
        return Err(FormatProblem::Empty);
    }
    let names = found.iter().enumerate().map(|(place, s)| (number(place, s), s.name.clone())).collect();
    Ok(Some(Segments { names, drawing, unnamed_voxels }))
}

/// Segments in the order of their numbers in the keys.
fn listed(keys: &[(String, String)], layers: usize) -> Result<Vec<Segment>, FormatProblem> {
    let value = |key: &str| keys.iter().find(|(k, _)| k == key).map(|(_, value)| value.trim());
    let mut numbers: Vec<usize> = keys
        .iter()
        .filter_map(|(key, _)| key.strip_prefix("Segment")?.strip_suffix("_ID")?.parse().ok())
        .collect();
    numbers.sort_unstable();
    numbers.dedup();
    let count = numbers.len();
    if count > usize::from(u16::MAX) {
        return Err(FormatProblem::field("Segment…_ID", &count.to_string(), "at most 65535 segments"));
    }
    let segment = |n: usize| -> Result<Segment, FormatProblem> {
        let key = |name: &str| format!("Segment{n}_{name}");
        let whole = |name: &str, default: usize, most: usize| match value(&key(name)) {
            None => Ok(default),
            Some(text) => text.parse().ok().filter(|found| *found <= most).ok_or_else(|| {
                FormatProblem::field(&key(name), text, "a whole number, of a layer one that the image has")
            }),
        };
        let id = value(&key("ID")).unwrap_or_default();
        let name = value(&key("Name")).filter(|name| !name.is_empty()).unwrap_or(id);
        // before there were layers with several segments each segment had its own, with the value 1
        let layer = whole("Layer", if layers == count { n.min(layers - 1) } else { 0 }, layers - 1)?;
        Ok(Segment { name: name.into(), layer, value: whole("LabelValue", 1, usize::from(u16::MAX))? as u16 })
    };
    numbers.into_iter().map(segment).collect()
}
