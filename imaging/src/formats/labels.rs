//! A label map with the names that its own file gives, and with voxels that belong to several labels.
//!
//! Each voxel of the map has one label. Where segments overlap, the further labels of a voxel stand in a list beside it, so that no
//! structure loses a voxel: [`LabelMap::whole`] is the map as one label sees it.

use std::borrow::Cow;

use bonemill_geometry::{Ct, Grid, Volume};

use super::Image;
use crate::names::LabelNames;

/// Grids whose corners lie nearer than this are the same, mm.
const SAME_MM: f64 = 1e-3;

/// A label map as a file or a folder gives it.
#[derive(Debug, Clone)]
pub struct LabelMap {
    /// The map; a voxel of several labels has one of them.
    pub image: Image<u16>,
    /// Names that stand in the file itself.
    pub names: Option<LabelNames>,
    /// Further labels of voxels: the voxel's place in memory and the label, ascending.
    pub further: Vec<(u32, u16)>,
}

/// Two labels that share voxels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shared {
    /// The label that the map shows.
    pub shown: u16,
    /// The other one.
    pub other: u16,
    /// How many voxels.
    pub voxels: usize,
}

impl LabelMap {
    /// Shows in every voxel of several labels that of the highest rank, and forgets labels of rank 0. Tells which labels share voxels,
    /// ascending.
    pub fn settle(&mut self, rank: impl Fn(u16) -> u8) -> Vec<Shared> {
        let mut shared: Vec<Shared> = Vec::new();
        let mut kept = Vec::new();
        let data = self.image.volume.data_mut();
        for of_voxel in self.further.chunk_by(|a, b| a.0 == b.0) {
            let Some((place, shown)) =
                of_voxel.first().and_then(|(place, _)| Some((*place, data.get_mut(*place as usize)?)))
            else {
                continue;
            };
            let mut labels: Vec<u16> =
                [*shown].into_iter().chain(of_voxel.iter().map(|(_, label)| *label)).collect();
            labels.sort_by_key(|label| std::cmp::Reverse(rank(*label)));
            labels.dedup();
            let mut labels = labels.into_iter();
            *shown = labels.next().unwrap_or(*shown);
            for other in labels.filter(|label| rank(*label) > 0) {
                kept.push((place, other));
                match shared.iter_mut().find(|s| (s.shown, s.other) == (*shown, other)) {
                    Some(pair) => pair.voxels += 1,
                    None => shared.push(Shared { shown: *shown, other, voxels: 1 }),
                }
            }
        }
        self.further = kept;
        shared.sort_by_key(|s| (s.shown, s.other));
        shared
    }

    /// Adds a mask on the same grid as a label of its own, the highest that is free, with the names at hand; `None` where the mask lies
    /// on another grid.
    pub fn add_mask(&mut self, mask: &Volume<u16, Ct>, names: Option<&LabelNames>) -> Option<u16> {
        if !same_grid(self.image.volume.grid(), mask.grid()) {
            return None;
        }
        let further = self.further.iter().map(|(_, label)| label);
        let mut taken = vec![false; 1 << 16];
        self.image.volume.data().iter().chain(further).for_each(|label| taken[usize::from(*label)] = true);
        let is_free =
            |label: &u16| !taken[usize::from(*label)] && names.is_none_or(|n| n.name(*label).is_none());
        let label = (1..=u16::MAX).rev().find(is_free)?;
        let data = self.image.volume.data_mut();
        for (place, (shown, value)) in data.iter_mut().zip(mask.data()).enumerate() {
            match (*value, *shown) {
                (0, _) => {}
                (_, 0) => *shown = label,
                _ => self.further.push((place as u32, label)),
            }
        }
        self.further.sort_unstable();
        Some(label)
    }

    /// The map with every voxel of `label`, also those that it shares.
    pub fn whole(&self, label: u16) -> Cow<'_, Volume<u16, Ct>> {
        whole(&self.image.volume, &self.further, label)
    }
}

/// As [`LabelMap::whole`], of a map and the further labels of its voxels.
pub fn whole<'a>(map: &'a Volume<u16, Ct>, further: &[(u32, u16)], label: u16) -> Cow<'a, Volume<u16, Ct>> {
    let mut places = further.iter().filter(|(_, other)| *other == label).map(|(place, _)| *place).peekable();
    if places.peek().is_none() {
        return Cow::Borrowed(map);
    }
    let mut own = map.clone();
    let data = own.data_mut();
    for place in places {
        if let Some(shown) = data.get_mut(place as usize) {
            *shown = label;
        }
    }
    Cow::Owned(own)
}

/// Whether grids are the same: no corner lies farther away than [`SAME_MM`].
pub(super) fn same_grid(a: &Grid<Ct>, b: &Grid<Ct>) -> bool {
    a.dims() == b.dims() && a.corners().iter().zip(b.corners()).all(|(p, q)| p.distance_mm(&q) <= SAME_MM)
}

/// A map that segments are drawn into, one after the other.
pub(super) struct Drawing {
    pub labels: Vec<u16>,
    pub further: Vec<(u32, u16)>,
}

impl Drawing {
    pub fn new(voxels: usize) -> Self {
        Self { labels: vec![0; voxels], further: Vec::new() }
    }

    /// Gives a voxel a label, or a further one.
    pub fn draw(&mut self, place: usize, label: u16) {
        match self.labels.get_mut(place) {
            Some(shown @ 0) => *shown = label,
            Some(shown) if *shown != label => self.further.push((place as u32, label)),
            _ => {}
        }
    }

    /// The map's values and the further labels, in order.
    pub fn finish(mut self) -> (Vec<u16>, Vec<(u32, u16)>) {
        self.further.sort_unstable();
        self.further.dedup();
        (self.labels, self.further)
    }
}
