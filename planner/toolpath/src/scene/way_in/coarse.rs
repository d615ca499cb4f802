//! The scan around a target on a coarse map.

use bonemill_geometry::{Ct, Grid, Point, TargetRegion, Volume};
use bonemill_imaging::Region;
use nalgebra::Vector3;
use rayon::prelude::*;

use crate::scene::inside::Part;
use crate::scene::{SceneError, SceneSpec};

/// Most voxels of a map.
const MOST_VOXELS: f64 = 6e6;
/// A coarse voxel is solid when this share of it is.
const SOLID_SHARE: f64 = 0.25;

/// What a coarse voxel holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Holds {
    Air,
    Tissue,
    /// Bone outside the target, or a structure.
    Solid,
    Target,
}

/// The scan around the target as far as a line goes, along the CT's own voxels; coarser than asked for where these are too many.
pub(super) fn coarse(
    spec: &SceneSpec,
    (drawn, around): (&[Point<Ct>], &Region),
    reach_mm: f64,
    mut spacing_mm: f64,
) -> Result<Volume<Holds, Ct>, SceneError> {
    let ct = spec.ct.grid();
    let (dims, spacing) = (ct.dims(), ct.spacing_mm());
    let indices = drawn.iter().map(|p| Vector3::from(ct.continuous_index(*p)));
    let (lo, hi) = indices
        .fold((Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY)), |(lo, hi), p| {
            (lo.inf(&p), hi.sup(&p))
        });
    let bound = |v: f64, a: usize| v.round().clamp(0.0, dims[a] as f64 - 1.0) as usize;
    let first: [usize; 3] = std::array::from_fn(|a| bound(lo[a] - reach_mm / spacing[a], a));
    let last: [usize; 3] = std::array::from_fn(|a| bound(hi[a] + reach_mm / spacing[a], a));
    let mut apart = [1; 3];
    let mut size = [1; 3];
    loop {
        for a in 0..3 {
            apart[a] = ((spacing_mm / spacing[a]).round() as usize).max(1);
            size[a] = (last[a] - first[a] + 1).div_ceil(apart[a]);
        }
        if size.iter().map(|n| *n as f64).product::<f64>() <= MOST_VOXELS {
            break;
        }
        spacing_mm = (1.25 * spacing_mm).max(spacing.min());
    }
    // a coarse voxel stands at the middle of its voxels
    let middle: [f64; 3] = std::array::from_fn(|a| first[a] as f64 + 0.5 * (apart[a] as f64 - 1.0));
    let coarse_mm = Vector3::from_fn(|a, _| spacing[a] * apart[a] as f64);
    let grid = Grid::<Ct>::new(size, coarse_mm, *ct.axes(), ct.at(middle).coords)?;
    let keep = |label: u16| spec.structures.iter().any(|(_, structure)| *structure == label);
    let label_at = |p| spec.labels.grid().nearest(p).map_or(0, |v| *spec.labels.get(v));
    let part = |region: &TargetRegion<u16>| Part::new(region, spec, around);
    let main = TargetRegion { of: spec.target.clone(), margin_mm: 0.0 };
    let target = std::iter::once(&main).chain(spec.also).map(part).collect::<Result<Vec<_>, _>>()?;
    let less = spec.less.iter().map(part).collect::<Result<Vec<_>, _>>()?;
    let holds = |n: usize| {
        let at = grid.voxel(n);
        let range = |a: usize| {
            let from = first[a] + at[a] * apart[a];
            from..(from + apart[a]).min(last[a] + 1)
        };
        let (mut count, mut solid, mut in_target, mut tissue) = (0usize, 0usize, 0usize, 0usize);
        for k in range(2) {
            for j in range(1) {
                for i in range(0) {
                    let hu = f64::from(*spec.ct.get([i, j, k]));
                    count += 1;
                    let p = ct.center([i, j, k]);
                    let label = label_at(p);
                    let is_held = |part: &Part| part.holds(p, label);
                    let is_target = target.iter().any(is_held) && !less.iter().any(is_held);
                    in_target += usize::from(is_target);
                    solid += usize::from(!is_target && (hu >= spec.bone_hu || keep(label)));
                    tissue += usize::from(hu > spec.air_hu);
                }
            }
        }
        let share = |n: usize| n as f64 / count.max(1) as f64;
        match () {
            () if share(solid) >= SOLID_SHARE => Holds::Solid,
            () if share(in_target) >= 0.5 => Holds::Target,
            () if share(tissue) >= 0.5 => Holds::Tissue,
            () => Holds::Air,
        }
    };
    let data = (0..grid.len()).into_par_iter().with_min_len(1 << 12).map(holds).collect();
    Volume::new(grid, data).map_err(SceneError::Values)
}
