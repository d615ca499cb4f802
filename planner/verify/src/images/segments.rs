//! Labels with the names that stand in their own file, and voxels that belong to several.

use std::collections::{HashMap, HashSet};

use bonemill_geometry::{Ct, Volume};

use super::More;
use super::moved::{self, MaskRule};
use crate::error::ReadProblem;

/// A label map as its file gives it.
#[derive(Debug)]
pub struct LabelsRead {
    /// One label for each voxel.
    pub shown: Volume<u16, Ct>,
    /// Places in memory and further labels of voxels that have several.
    pub further: Vec<(usize, u16)>,
    /// Names in the file itself.
    pub names: Vec<(u16, String)>,
    /// Whether these names count before those of a `labels.json`.
    pub is_segmentation: bool,
}

impl LabelsRead {
    /// Adds what `of` tells of another file as a label that no voxel and no name has, and tells its number. It may lie on another grid
    /// ([`moved`]).
    ///
    /// # Errors
    /// [`ReadProblem::Affine`] where it has no voxel, or lies too far away.
    pub fn add(
        &mut self,
        (file, of): (&LabelsRead, Option<u16>),
        by: MaskRule,
        named: &[u16],
    ) -> Result<u16, ReadProblem> {
        let used: HashSet<u16> = self
            .shown
            .data()
            .iter()
            .chain(named)
            .copied()
            .chain(self.further.iter().map(|(_, l)| *l))
            .collect();
        let label = (1..=u16::MAX).rev().find(|label| !used.contains(label));
        let mut is_in: Vec<bool> =
            file.shown.data().iter().map(|value| of.map_or(*value != 0, |of| *value == of)).collect();
        file.further
            .iter()
            .filter(|(_, other)| Some(*other) == of)
            .for_each(|(place, _)| is_in[*place] = true);
        let (a, b) = (self.shown.grid(), file.shown.grid());
        let off_mm =
            a.corners().into_iter().zip(b.corners()).map(|(p, q)| p.distance_mm(&q)).fold(0.0, f64::max);
        if a.dims() != b.dims() || off_mm > 1e-3 {
            let mask = Volume::new(b.clone(), is_in)?;
            is_in = moved::onto(self, &mask, by)?;
        }
        let (Some(label), true) = (label, is_in.contains(&true)) else {
            return Err(ReadProblem::Affine("no voxel that the label map could hold"));
        };
        for (place, _) in is_in.iter().enumerate().filter(|(_, is_in)| **is_in) {
            match &mut self.shown.data_mut()[place] {
                shown @ 0 => *shown = label,
                _ => self.further.push((place, label)),
            }
        }
        Ok(label)
    }

    /// Shows the label of the highest rank where a voxel has several.
    pub fn show_by(&mut self, rank: impl Fn(u16) -> u8) {
        for (place, other) in &mut self.further {
            if let Some(shown) = self.shown.data_mut().get_mut(*place)
                && rank(*other) > rank(*shown)
            {
                std::mem::swap(shown, other);
            }
        }
    }

    /// The maps as those labels see them that share voxels with others: each with all of its own.
    pub fn own_maps(&self, labels: impl Iterator<Item = u16>) -> Vec<(u16, Volume<u16, Ct>)> {
        let sharing = labels.filter(|label| self.further.iter().any(|(_, other)| other == label));
        let own = |label: u16| {
            let mut map = self.shown.clone();
            for (place, _) in self.further.iter().filter(|(_, other)| *other == label) {
                map.data_mut()[*place] = label;
            }
            (label, map)
        };
        sharing.map(own).collect()
    }
}

/// Makes labels of what a file says.
///
/// # Errors
/// [`ReadProblem::Header`] where two segments of one layer have one value, and where no voxel belongs to a segment.
pub(super) fn labels_read(shown: Volume<u16, Ct>, more: More<u16>) -> Result<LabelsRead, ReadProblem> {
    let (values, segments) = match more {
        More::Extension(bytes) => {
            let names = table(&String::from_utf8_lossy(&bytes));
            return Ok(LabelsRead { shown, further: vec![], names, is_segmentation: false });
        }
        More::Layers(_, segments) if segments.is_empty() => {
            return Ok(LabelsRead { shown, further: vec![], names: vec![], is_segmentation: false });
        }
        More::Layers(values, segments) => (values, segments),
    };
    let is_unique =
        segments.iter().enumerate().all(|(n, s)| segments[..n].iter().all(|other| other.2 != s.2));
    let number = |place: usize, value: u16| if is_unique { value } else { place as u16 + 1 };
    let of_value: HashMap<(usize, u16), u16> =
        segments.iter().enumerate().map(|(place, s)| ((s.1, s.2), number(place, s.2))).collect();
    if of_value.len() < segments.len() {
        return Err(ReadProblem::Header {
            field: "LabelValue".into(),
            expected: "one segment for each value of a layer",
        });
    }
    let (grid, _) = shown.into_parts();
    let layers = values.len() / grid.len();
    let (mut data, mut further) = (vec![0u16; grid.len()], Vec::new());
    for (place, of_voxel) in values.chunks_exact(layers).enumerate() {
        let labels = of_voxel.iter().enumerate().filter_map(|(layer, value)| of_value.get(&(layer, *value)));
        for label in labels {
            if data[place] == 0 {
                data[place] = *label;
            } else if data[place] != *label {
                further.push((place, *label));
            }
        }
    }
    further.sort_unstable();
    further.dedup();
    if data.len() == 1 || data.iter().all(|label| *label == 0) {
        return Err(ReadProblem::Header {
            field: "Segment".into(),
            expected: "voxels that belong to a segment",
        });
    }
    let names = segments.iter().enumerate().map(|(place, s)| (number(place, s.2), s.0.clone())).collect();
    Ok(LabelsRead { shown: Volume::new(grid, data)?, further, names, is_segmentation: true })
}

/// Numbers and names in a table of labels, `<Label Key="91" …><![CDATA[skull]]></Label>`.
fn table(text: &str) -> Vec<(u16, String)> {
    let entry = |after: &str| {
        let (tag, rest) = after.split_once('>')?;
        let key = tag.split_once("Key=\"")?.1.split_once('"')?.0;
        let name = rest.split_once("</Label>")?.0.trim();
        let name = name.strip_prefix("<![CDATA[").and_then(|name| name.strip_suffix("]]>")).unwrap_or(name);
        let name = name.replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&");
        Some((key.trim().parse().ok()?, name.trim().to_owned()))
    };
    text.split("<Label ").skip(1).filter_map(entry).filter(|(_, name)| !name.is_empty()).collect()
}
