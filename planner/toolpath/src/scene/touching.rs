//! A target that touches a structure: refused where it is drawn so, because one of the two labels is then wrong.

use std::borrow::Cow;

use bonemill_geometry::{Ct, Volume, cancel};
use rayon::prelude::*;

use super::inside::Inside;
use super::{SceneError, SceneSpec, SceneStructure, Target};

/// No voxel of a label that is the target shares a face, an edge or a corner with a structure, and no structure's voxel lies
/// in what a channel's tool sweeps. Other shapes give way to structures.
pub(super) fn check(
    spec: &SceneSpec,
    inside: &Inside,
    structures: &[SceneStructure],
) -> Result<(), SceneError> {
    let grid = spec.labels.grid();
    let touching = |structure: &SceneStructure, voxel: [usize; 3]| {
        let [x, y, z] = grid.center(voxel).coords.into();
        SceneError::TargetTouches { structure: structure.name.clone(), x, y, z, voxel }
    };
    let label = match spec.target {
        Target::Label(label) => label,
        _ if !spec.is_swept => return Ok(()),
        _ => {
            for structure in structures {
                for (n, _) in spec.labels.data().iter().enumerate().filter(|(_, l)| **l == structure.label) {
                    let voxel = grid.voxel(n);
                    if spec.target.contains(grid.center(voxel)) {
                        return Err(touching(structure, voxel));
                    }
                }
            }
            return Ok(());
        }
    };
    let drawn = left_of_label(spec, inside, label)?;
    let mut is_structure = vec![false; 1 << 16];
    structures.iter().for_each(|structure| is_structure[usize::from(structure.label)] = true);
    if touching_voxel(&drawn, label, |l| is_structure[usize::from(l)]).is_none() {
        return Ok(());
    }
    // the first in the case's order is named
    for structure in structures {
        if let Some(voxel) = touching_voxel(&drawn, label, |l| l == structure.label) {
            return Err(touching(structure, voxel));
        }
    }
    Ok(())
}

/// The label map without the voxels of `label` whose centres the case takes away from its target.
fn left_of_label<'a>(
    spec: &SceneSpec<'a>,
    inside: &Inside,
    label: u16,
) -> Result<Cow<'a, Volume<u16, Ct>>, SceneError> {
    if spec.less.is_empty() {
        return Ok(Cow::Borrowed(spec.labels));
    }
    let grid = spec.labels.grid();
    let is_left = |n: usize| !inside.is_taken_away(grid.center(grid.voxel(n)), label);
    let data = spec.labels.data().par_iter().enumerate().with_min_len(1 << 14);
    let data = data.map(|(n, l)| if *l != label || is_left(n) { *l } else { 0 }).collect();
    Ok(Cow::Owned(Volume::new(grid.clone(), data).map_err(SceneError::Values)?))
}

/// A voxel of `label` among the 26 neighbours of one that `is_other`: of the first in the map's order that has one.
fn touching_voxel(
    labels: &Volume<u16, Ct>,
    label: u16,
    is_other: impl Fn(u16) -> bool + Sync,
) -> Option<[usize; 3]> {
    let [nx, ny, nz] = labels.grid().dims();
    let row = |j: usize, k: usize| &labels.data()[nx * (j + ny * k)..][..nx];
    let around = |v: usize, n: usize| v.saturating_sub(1)..(v + 2).min(n);
    (0..nz).into_par_iter().find_map_first(|k| {
        cancel::poll();
        // whether the label is in one of the nine rows around, by place in the row
        let mut near = vec![false; nx];
        for j in 0..ny {
            let rows = || around(k, nz).flat_map(|kk| around(j, ny).map(move |jj| [jj, kk]));
            near.fill(false);
            for [jj, kk] in rows().filter(|[jj, kk]| row(*jj, *kk).contains(&label)) {
                near.iter_mut().zip(row(jj, kk)).for_each(|(near, l)| *near |= *l == label);
            }
            if !near.contains(&true) {
                continue;
            }
            let is_beside = |i: &usize| is_other(row(j, k)[*i]) && near[around(*i, nx)].contains(&true);
            if let Some(i) = (0..nx).find(is_beside) {
                let at = |[jj, kk]: [usize; 2]| {
                    around(i, nx).find(|ii| row(jj, kk)[*ii] == label).map(|ii| [ii, jj, kk])
                };
                return rows().find_map(at);
            }
        }
        None
    })
}
