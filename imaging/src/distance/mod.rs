//! Exact Euclidean distance fields on anisotropic grids, with the nearest voxel.
//!
//! Distances are measured between voxel CENTRES, so a voxel of the mask has distance 0. The transform is separable and
//! exact (Felzenszwalb and Huttenlocher 2012, whose lower envelope is replaced by a search that suits vector units):
//! squared distances are sums of one table entry per axis. On cubic voxels they are whole numbers and exact. On other
//! voxels they are in single precision: the distance has a relative error of at most 2 × 10⁻⁷, and of two sites whose
//! distances differ by less, either may be given.
//!
//! Of several nearest voxels the one with the smallest memory index is given (on cubic voxels; on others a tie is only
//! as exact as its rounding). Nothing depends on the number of threads. A mask without voxels has no distance: `None`.

mod envelope;
mod separable;

use bonemill_geometry::{Frame, Grid, Volume};

use crate::error::ImageError;
pub(crate) use envelope::Places;
pub(crate) use separable::{SeparableProblem, Solution};

/// The distance to the nearest voxel of a mask, and which voxel that is.
#[derive(Debug, Clone)]
pub struct DistanceField<F: Frame> {
    /// Distance between voxel centres, mm; 0 in the mask.
    pub distance_mm: Volume<f32, F>,
    /// Memory index of the nearest voxel of the mask, in the order of `distance_mm`.
    pub nearest: Vec<u32>,
}

/// Distance to the nearest true voxel and its place; `None` when no voxel is true.
///
/// # Errors
/// [`ImageError::TooManyVoxels`] when a memory index does not fit 32 bits.
pub fn distance_transform<F: Frame>(mask: &Volume<bool, F>) -> Result<Option<DistanceField<F>>, ImageError> {
    let Some(Solution { distance_mm, nearest }) = solve(mask, true)? else { return Ok(None) };
    let distance_mm = Volume::new(mask.grid().clone(), distance_mm);
    Ok(distance_mm.ok().map(|distance_mm| DistanceField { distance_mm, nearest }))
}

/// Only the distances of [`distance_transform`], mm. It takes half the memory and 25 to 40 % less time.
///
/// # Errors
/// As [`distance_transform`].
pub fn distance_only<F: Frame>(mask: &Volume<bool, F>) -> Result<Option<Volume<f32, F>>, ImageError> {
    let solution = solve(mask, false)?;
    Ok(solution.and_then(|s| Volume::new(mask.grid().clone(), s.distance_mm).ok()))
}

/// min(distance to the nearest true voxel, `max_distance_mm`), mm; `None` when no voxel is true.
///
/// Only voxels around the mask are solved, so a small bound on a small mask takes very little time.
///
/// # Errors
/// As [`distance_transform`]; [`ImageError::MaxDistance`] when the bound is not finite and positive.
pub fn distance_within<F: Frame>(
    mask: &Volume<bool, F>,
    max_distance_mm: f64,
) -> Result<Option<Volume<f32, F>>, ImageError> {
    check_size(mask.grid())?;
    if !(max_distance_mm.is_finite() && max_distance_mm > 0.0) {
        return Err(ImageError::MaxDistance { max_distance_mm });
    }
    let (dims, spacing) = (mask.grid().dims(), mask.grid().spacing_mm());
    let Some(sites) = bounding_box(mask.data(), dims, |v| v) else { return Ok(None) };
    let [ox, oy, oz] = std::array::from_fn(|a| {
        // a voxel at least this many voxels away is at least the bound away; the cast saturates
        let reach = (max_distance_mm / spacing[a]).ceil() as usize;
        Places::all(sites[a].start.saturating_sub(reach)..sites[a].end.saturating_add(reach).min(dims[a]))
    });
    let (along, unit_mm) = euclidean(mask.grid());
    let out = [ox, oy, oz];
    let problem = SeparableProblem { values: mask.data(), dims, is_site: |v| v, sites, out, along, unit_mm };
    let Some(Solution { distance_mm, .. }) = problem.solve(false) else { return Ok(None) };
    let mut bounded = Volume::filled(mask.grid().clone(), max_distance_mm as f32);
    for (n, row) in distance_mm.chunks_exact(ox.count).enumerate() {
        let (y, z) = (oy.at(n % oy.count), oz.at(n / oy.count));
        let start = ox.first + dims[0] * (y + dims[1] * z);
        for (out, distance_mm) in bounded.data_mut()[start..].iter_mut().zip(row) {
            *out = distance_mm.min(*out);
        }
    }
    Ok(Some(bounded))
}

/// The whole volume's distance and, if `with_nearest`, place of the nearest true voxel.
fn solve<F: Frame>(mask: &Volume<bool, F>, with_nearest: bool) -> Result<Option<Solution>, ImageError> {
    check_size(mask.grid())?;
    let dims = mask.grid().dims();
    let (along, unit_mm) = euclidean(mask.grid());
    let sites = dims.map(|d| 0..d);
    let out = sites.clone().map(Places::all);
    let problem = SeparableProblem { values: mask.data(), dims, is_site: |v| v, sites, out, along, unit_mm };
    Ok(problem.solve(with_nearest))
}

fn check_size<F: Frame>(grid: &Grid<F>) -> Result<(), ImageError> {
    match u32::try_from(grid.len()) {
        Ok(_) => Ok(()),
        Err(_) => Err(ImageError::TooManyVoxels { voxels: grid.len() }),
    }
}

/// Squared distances along each axis, and the length of their unit, mm. The unit is a voxel for cubic voxels, else 1 mm.
fn euclidean<F: Frame>(grid: &Grid<F>) -> ([Vec<f32>; 3], f32) {
    let spacing = grid.spacing_mm();
    let cubic = spacing.y == spacing.x && spacing.z == spacing.x;
    let (scale, unit_mm) = if cubic { ([1.0; 3], spacing.x as f32) } else { (spacing.into(), 1.0) };
    let along =
        std::array::from_fn(|a| (0..grid.dims()[a]).map(|t| (t as f64 * scale[a]).powi(2) as f32).collect());
    (along, unit_mm)
}

/// The smallest box that holds every site.
fn bounding_box<T: Copy>(
    values: &[T],
    dims: [usize; 3],
    is_site: impl Fn(T) -> bool,
) -> Option<[std::ops::Range<usize>; 3]> {
    let mut found: Option<([usize; 3], [usize; 3])> = None;
    for (n, row) in values.chunks_exact(dims[0]).enumerate() {
        let Some(first) = row.iter().position(|v| is_site(*v)) else { continue };
        let last = row.iter().rposition(|v| is_site(*v)).unwrap_or(first);
        let (y, z) = (n % dims[1], n / dims[1]);
        let (lo, hi) = found.get_or_insert(([first, y, z], [last, y, z]));
        *lo = [lo[0].min(first), lo[1].min(y), lo[2].min(z)];
        *hi = [hi[0].max(last), hi[1].max(y), hi[2].max(z)];
    }
    found.map(|(lo, hi)| std::array::from_fn(|a| lo[a]..hi[a] + 1))
}

#[cfg(test)]
mod tests;
