//! A label map with the names that its own file gives, and with voxels that belong to several labels.
//!
//! Each voxel of the map has one label. Where segments overlap, the further labels of a voxel stand in a list beside it, so that no
//! structure loses a voxel: [`LabelMap::whole`] is the map as one label sees it.

use std::borrow::Cow;

use bonemill_geometry::{Ct, Grid, Point, Volume};
use thiserror::Error;

use super::Image;
use super::fit::{Fit, centred, index_box, moved_box, touched};
use crate::names::LabelNames;

/// Grids whose corners lie nearer than this are the same, mm.
const SAME_MM: f64 = 1e-3;
/// A map is not grown beyond this: a gigabyte.
const MOST_VOXELS: f64 = 5e8;

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

/// A label of another map as it was added.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Added {
    /// Its number.
    pub number: u16,
    /// Its volume on its own grid and here, mm³.
    pub mm3: [f64; 2],
}

/// Why a label of another map cannot be added.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum AddFault {
    /// It has no voxel.
    #[error("{}", label.map_or("has no voxel that is not 0".into(), |label| format!("has no voxel of label {label}")))]
    Empty {
        /// Its number there; `None` where every voxel that is not 0 is meant.
        label: Option<u16>,
    },
    /// The map would have to grow too large to hold it.
    #[error(
        "lies so far beyond the label map's grid that the map would have {voxels:.1e} voxels to hold both, at most {MOST_VOXELS:.1e} \
         are accepted: crop it, or name as images.labels a file whose voxels are larger"
    )]
    TooLarge {
        /// So many.
        voxels: f64,
    },
    /// Every number is a label or has a name.
    #[error("no number from 1 to 65535 is free in the label map")]
    Full,
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

    /// Every label but 0, ascending.
    pub fn labels(&self) -> Vec<u16> {
        let taken = self.taken();
        (1..=u16::MAX).filter(|label| taken[usize::from(*label)]).collect()
    }

    /// Which labels have a voxel.
    fn taken(&self) -> Vec<bool> {
        let further = self.further.iter().map(|(_, label)| label);
        let mut taken = vec![false; 1 << 16];
        self.image.volume.data().iter().chain(further).for_each(|label| taken[usize::from(*label)] = true);
        taken
    }

    /// Adds a label of another map, or all that is not 0 there, as a label of its own: the highest number that is free, with the names
    /// at hand. On the same grid its voxels are the same. Of another grid they are brought onto this one as `how` says, which first
    /// grows by whole voxels to hold them.
    ///
    /// # Errors
    /// [`AddFault`].
    pub fn add(
        &mut self,
        (from, label): (&LabelMap, Option<u16>),
        how: Fit,
        names: Option<&LabelNames>,
    ) -> Result<Added, AddFault> {
        let whole = label.map_or(Cow::Borrowed(&from.image.volume), |label| from.whole(label));
        let is_in = |value: u16| label.map_or(value != 0, |label| value == label);
        let all = whole.data().iter().enumerate();
        let mut places: Vec<usize> =
            all.filter(|(_, value)| is_in(**value)).map(|(place, _)| place).collect();
        let own_mm3 = places.len() as f64 * whole.grid().voxel_mm3();
        if !same_grid(self.image.volume.grid(), whole.grid()) {
            places = self.fitted(&whole, is_in, how)?;
        }
        if places.is_empty() {
            return Err(AddFault::Empty { label });
        }
        let taken = self.taken();
        let is_free =
            |label: &u16| !taken[usize::from(*label)] && names.is_none_or(|n| n.name(*label).is_none());
        let number = (1..=u16::MAX).rev().find(is_free).ok_or(AddFault::Full)?;
        let mm3 = [own_mm3, places.len() as f64 * self.image.volume.grid().voxel_mm3()];
        let data = self.image.volume.data_mut();
        for place in places {
            match data.get_mut(place) {
                Some(shown @ 0) => *shown = number,
                _ => self.further.push((place as u32, number)),
            }
        }
        // by places only: of labels of one rank the one that was added first is shown
        self.further.sort_by_key(|(place, _)| *place);
        Ok(Added { number, mm3 })
    }

    /// Where voxels of another grid lie in this one, ascending.
    fn fitted(
        &mut self,
        from: &Volume<u16, Ct>,
        is_in: impl Fn(u16) -> bool,
        how: Fit,
    ) -> Result<Vec<usize>, AddFault> {
        let Some(of) = index_box(from, &is_in) else { return Ok(vec![]) };
        let around = moved_box(from.grid(), of, self.image.volume.grid());
        let by = self.grow(around)?;
        let around = around.map(|end| std::array::from_fn(|a| (end[a] + by[a] as i64) as usize));
        let grid = self.image.volume.grid();
        Ok(match how {
            Fit::Centres => centred(from, &is_in, grid, around),
            Fit::Touched => touched(from, &is_in, grid, of),
        })
    }

    /// Grows the grid by whole voxels so that it holds the box of these, and tells how many come before the first along each axis.
    fn grow(&mut self, [low, high]: [[i64; 3]; 2]) -> Result<[usize; 3], AddFault> {
        let grid = self.image.volume.grid().clone();
        let old = grid.dims();
        let before: [usize; 3] = std::array::from_fn(|a| (-low[a]).max(0) as usize);
        let dims: [usize; 3] = std::array::from_fn(|a| before[a] + old[a].max((high[a] + 1).max(0) as usize));
        if dims == old {
            return Ok(before);
        }
        let voxels = dims.iter().map(|n| *n as f64).product::<f64>();
        let too_large = AddFault::TooLarge { voxels };
        if voxels > MOST_VOXELS {
            return Err(too_large);
        }
        let origin = grid.at(before.map(|n| -(n as f64))).coords;
        let Ok(wide) = Grid::new(dims, grid.spacing_mm(), *grid.axes(), origin) else {
            return Err(too_large);
        };
        let moved = |place: usize| {
            let voxel = grid.voxel(place);
            wide.index(std::array::from_fn(|a| voxel[a] + before[a]))
        };
        let mut volume = Volume::filled(wide.clone(), 0u16);
        let (from, to) = (self.image.volume.data(), volume.data_mut());
        for (row, values) in from.chunks_exact(old[0]).enumerate() {
            to[moved(row * old[0])..][..old[0]].copy_from_slice(values);
        }
        self.further.iter_mut().for_each(|(place, _)| *place = moved(*place as usize) as u32);
        self.image.volume = volume;
        Ok(before)
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

/// The largest distance of a corner of a grid's box from the nearest corner of another's, mm, where both have as many voxels along
/// their sides; the order and sense in which axes are stored do not matter.
pub fn displacement_mm(of: &Grid<Ct>, from: &Grid<Ct>) -> Option<f64> {
    let sorted = |mut dims: [usize; 3]| {
        dims.sort_unstable();
        dims
    };
    let nearest =
        |p: &Point<Ct>| from.corners().iter().map(|q| p.distance_mm(q)).fold(f64::INFINITY, f64::min);
    (sorted(of.dims()) == sorted(from.dims())).then(|| of.corners().iter().map(nearest).fold(0.0, f64::max))
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
