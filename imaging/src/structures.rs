//! The exact distance of a point from a structure, computed on the label map's own grid.
//!
//! A structure is the union of its CLOSED voxel boxes, and the distance is 0 inside. The planning grid adds no error to
//! it. Whether a point is inside is looked up in the label map. Outside, the nearest point lies on a voxel with an
//! uncovered face; a tree over these voxels finds it in about a microsecond, from any thread. The label grid may be
//! oblique or mirrored: its axes are orthonormal, so all distances are computed in millimetres along them.
//!
//! Most queries only compare a distance with a clearance, and the two differ much. For these there is a coarse field: the
//! exact distance at every second voxel centre. Distance changes no faster than the point moves, so the field bounds the
//! distance everywhere, and the tree is searched only where the bounds do not decide.

use bonemill_geometry::{Ct, Grid, Point, Volume};
use nalgebra::Vector3;

use crate::distance::{Places, SeparableProblem, Solution};
use crate::error::ImageError;

mod mask;
mod tree;
use mask::Mask;
use tree::{Bounds, Tree};

/// Voxels from one entry of the coarse field to the next.
const COARSE_STEP: usize = 2;
/// Relative and absolute (mm) error allowed for the rounding of the coarse field: several times that of single precision.
const COARSE_ROUNDING: f64 = 1e-6;

/// The part of space in which distances to a structure are needed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Region {
    /// Corner of a box along `ct`'s axes: smallest coordinates.
    pub min: Point<Ct>,
    /// The opposite corner.
    pub max: Point<Ct>,
    /// Distances up to this are exact for points in the box, mm.
    pub reach_mm: f64,
}

/// The distance to one labelled structure.
#[derive(Debug, Clone)]
pub struct StructureField {
    label: u16,
    grid: Grid<Ct>,
    count: usize,
    reach_mm: f64,
    bounding_box: [Point<Ct>; 2],
    mask: Mask,
    /// Boxes of voxels with an uncovered face, in mm along the grid's axes from the centre of voxel (0, 0, 0).
    surface: Tree,
    coarse: Coarse,
}

/// Distances at every [`COARSE_STEP`]th voxel centre of a window, mm.
#[derive(Debug, Clone)]
struct Coarse {
    places: [Places; 3],
    distance_mm: Vec<f32>,
}

impl StructureField {
    /// The field of the voxels of `label`. With a region, only voxels within `reach_mm` of it are kept; `None` when there are
    /// none.
    ///
    /// # Errors
    /// [`ImageError::LabelAbsent`] when no voxel of the map has the label, [`ImageError::Region`] when the region is
    /// not a box, [`ImageError::TooManyVoxels`] when the map has more voxels than 32-bit numbers.
    pub fn new(
        labels: &Volume<u16, Ct>,
        label: u16,
        region: Option<&Region>,
    ) -> Result<Option<Self>, ImageError> {
        let grid = labels.grid();
        if u32::try_from(grid.len()).is_err() {
            return Err(ImageError::TooManyVoxels { voxels: grid.len() });
        }
        let (count, bounding_box) = extent(labels, label).ok_or_else(|| absent(labels, label))?;
        let (sites, places) = match region {
            None => {
                let whole = grid.dims().map(|d| [0, d - 1]);
                (whole, whole)
            }
            Some(region) => {
                region.check()?;
                let Some(sites) = region.voxels(grid, region.reach_mm) else { return Ok(None) };
                (sites, region.voxels(grid, 0.0).unwrap_or(sites))
            }
        };
        let mask = Mask::new(labels, label, sites);
        let Some(coarse) = Coarse::new(labels, label, sites, places) else { return Ok(None) };
        let surface = Tree::new(mask.surface(&grid.spacing_mm()));
        let reach_mm = region.map_or(f64::INFINITY, |region| region.reach_mm);
        Ok(Some(Self { label, grid: grid.clone(), count, reach_mm, bounding_box, mask, surface, coarse }))
    }

    /// The structure's label.
    pub fn label(&self) -> u16 {
        self.label
    }

    /// Up to where distances are exact, mm; ∞ without a region.
    pub fn reach_mm(&self) -> f64 {
        self.reach_mm
    }

    /// Voxels of the structure in the whole map.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Smallest and largest coordinates in `ct` of the box of voxels that holds the whole structure, mm.
    pub fn bounding_box(&self) -> [Point<Ct>; 2] {
        self.bounding_box
    }

    /// The voxels kept, on the label map's grid, ascending in memory; all of them without a region.
    pub fn voxels(&self) -> impl Iterator<Item = [usize; 3]> {
        self.mask.voxels()
    }

    /// Distance from `p` to the union of the closed voxel boxes, mm; 0 inside.
    ///
    /// Without a region the distance is exact. With a region, for a point in its box, it is exact up to `reach_mm`; where the
    /// true distance is larger, the result is at least the true distance. A point that is not finite has distance 0, so that
    /// nothing is cut there.
    pub fn distance(&self, p: Point<Ct>) -> f64 {
        self.nearest_box(p).map_or(0.0, |(_, squared, _)| squared.sqrt())
    }

    /// [`StructureField::distance`] and the nearest point of the structure; inside, that is `p` itself.
    pub fn nearest(&self, p: Point<Ct>) -> (f64, Point<Ct>) {
        self.nearest_box(p).map_or((0.0, p), |(bounds, squared, along)| {
            let nearest = self.grid.axes() * Vector3::from(bounds.nearest(along));
            (squared.sqrt(), Point::from_coords(self.grid.origin().coords + nearest))
        })
    }

    /// A lower and an upper bound of [`StructureField::distance`], mm, without a search.
    pub fn bounds(&self, p: Point<Ct>) -> (f64, f64) {
        if !p.is_finite() {
            return (0.0, 0.0);
        }
        let (mut at, mut stride, mut off_squared) = (0, 1, 0.0);
        let (index, spacing) = (self.grid.continuous_index(p), self.grid.spacing_mm());
        let axes = index.into_iter().zip(self.coarse.places).zip(&spacing);
        for ((index, places), spacing) in axes {
            let n = (index - places.first as f64) / places.step as f64;
            // the cast rounds down and saturates
            let n = ((n + 0.5).max(0.0) as usize).min(places.count - 1);
            off_squared += ((index - places.at(n) as f64) * spacing).powi(2);
            at += stride * n;
            stride *= places.count;
        }
        let center = f64::from(self.coarse.distance_mm[at]);
        let off = off_squared.sqrt() + COARSE_ROUNDING * (1.0 + center);
        ((center - off).max(0.0), center + off)
    }

    /// Whether `p` is nearer than `distance_mm`. The answer is exact; the tree is searched only where the bounds do not decide.
    pub fn is_nearer_than(&self, p: Point<Ct>, distance_mm: f64) -> bool {
        let (lower, upper) = self.bounds(p);
        if upper < distance_mm {
            true
        } else if lower >= distance_mm {
            false
        } else {
            self.distance(p) < distance_mm
        }
    }

    /// The nearest box, its squared distance, mm², and `p` along the grid's axes, mm; `None` inside.
    fn nearest_box(&self, p: Point<Ct>) -> Option<(&Bounds, f64, [f64; 3])> {
        if !p.is_finite() || self.grid.nearest(p).is_some_and(|voxel| self.mask.holds(voxel)) {
            return None;
        }
        let along: [f64; 3] = (self.grid.axes().transpose() * (p - self.grid.origin())).into();
        let (_, upper) = self.bounds(p);
        let nearest =
            self.surface.nearest(along, upper * upper).or_else(|| self.surface.nearest(along, f64::INFINITY));
        nearest.map(|(bounds, squared)| (bounds, squared, along))
    }
}

impl Region {
    fn check(&self) -> Result<(), ImageError> {
        let ordered = (0..3).all(|a| self.min.coords[a] <= self.max.coords[a]);
        if ordered
            && self.min.is_finite()
            && self.max.is_finite()
            && self.reach_mm.is_finite()
            && self.reach_mm >= 0.0
        {
            return Ok(());
        }
        Err(ImageError::Region {
            min_mm: self.min.coords.into(),
            max_mm: self.max.coords.into(),
            reach_mm: self.reach_mm,
        })
    }

    /// First and last voxel along each axis whose box can lie within `margin_mm` of this box, if there are any.
    fn voxels(&self, grid: &Grid<Ct>, margin_mm: f64) -> Option<[[usize; 2]; 3]> {
        let corners: [[f64; 3]; 8] = std::array::from_fn(|c| {
            let corner =
                Vector3::from_fn(
                    |a, _| if c >> a & 1 == 0 { self.min.coords[a] } else { self.max.coords[a] },
                );
            grid.continuous_index(Point::from_coords(corner))
        });
        let mut voxels = [[0; 2]; 3];
        for a in 0..3 {
            let margin = margin_mm / grid.spacing_mm()[a] + 1.0;
            let lo = corners.iter().map(|c| c[a]).fold(f64::INFINITY, f64::min) - margin;
            let hi = corners.iter().map(|c| c[a]).fold(f64::NEG_INFINITY, f64::max) + margin;
            let last = grid.dims()[a] as f64 - 1.0;
            if hi < 0.0 || lo > last {
                return None;
            }
            voxels[a] = [lo.floor().max(0.0) as usize, hi.ceil().min(last) as usize];
        }
        Some(voxels)
    }
}

impl Coarse {
    fn new(
        labels: &Volume<u16, Ct>,
        label: u16,
        sites: [[usize; 2]; 3],
        places: [[usize; 2]; 3],
    ) -> Option<Self> {
        let grid = labels.grid();
        let places = places.map(|[first, last]| Places {
            first,
            step: COARSE_STEP,
            count: (last - first) / COARSE_STEP + 1,
        });
        // distance from a voxel's centre to the near face of the box t voxels away; it is convex in t, so the transform is exact
        let along = std::array::from_fn(|a| {
            let spacing = grid.spacing_mm()[a];
            (0..grid.dims()[a]).map(|t| ((t as f64 - 0.5).max(0.0) * spacing).powi(2) as f32).collect()
        });
        let problem = SeparableProblem {
            values: labels.data(),
            dims: grid.dims(),
            is_site: |v| v == label,
            sites: sites.map(|[first, last]| first..last + 1),
            out: places,
            along,
            unit_mm: 1.0,
        };
        let Solution { distance_mm, .. } = problem.solve(false)?;
        Some(Self { places, distance_mm })
    }
}

/// Number of voxels of `label` and the corners, in `ct`, of the box of voxels that holds them.
fn extent(labels: &Volume<u16, Ct>, label: u16) -> Option<(usize, [Point<Ct>; 2])> {
    let grid = labels.grid();
    let [nx, ny, _] = grid.dims();
    let (mut count, mut lo, mut hi) = (0, [usize::MAX; 3], [0; 3]);
    for (n, row) in labels.data().chunks_exact(nx).enumerate() {
        if !row.contains(&label) {
            continue;
        }
        count += row.iter().filter(|v| **v == label).count();
        let first = row.iter().position(|v| *v == label)?;
        let last = row.iter().rposition(|v| *v == label)?;
        for (a, [from, to]) in [[first, last], [n % ny; 2], [n / ny; 2]].into_iter().enumerate() {
            (lo[a], hi[a]) = (lo[a].min(from), hi[a].max(to));
        }
    }
    if count == 0 {
        return None;
    }
    let corners: [Vector3<f64>; 8] = std::array::from_fn(|c| {
        grid.at(std::array::from_fn(
            |a| if c >> a & 1 == 0 { lo[a] as f64 - 0.5 } else { hi[a] as f64 + 0.5 },
        ))
        .coords
    });
    let min = corners.iter().fold(corners[0], |m, c| m.inf(c));
    let max = corners.iter().fold(corners[0], |m, c| m.sup(c));
    Some((count, [Point::from_coords(min), Point::from_coords(max)]))
}

fn absent(labels: &Volume<u16, Ct>, label: u16) -> ImageError {
    let mut present = vec![false; 1 << 16];
    labels.data().iter().for_each(|v| present[usize::from(*v)] = true);
    let present = (1..=u16::MAX).filter(|v| present[usize::from(*v)]).take(64).collect();
    ImageError::LabelAbsent { label, present }
}

#[cfg(test)]
mod tests;
