//! A target that touches a structure. A label then gives way to structures as shapes do, and a warning says what it loses, because one of
//! the two labels may be drawn wrong; what a channel's tool sweeps gives way to nothing, and is refused.

use std::borrow::Cow;

use bonemill_geometry::{Ct, Volume, cancel};
use rayon::prelude::*;

use super::inside::Inside;
use super::{SceneError, SceneSpec, SceneStructure, Target};

/// A target that loses more to structures and their clearances is not planned: one of the labels is probably wrong. Assumed.
const MOST_LOST: f64 = 0.5;

/// The structures that share a face, an edge or a corner of a voxel with a label that is the target, less what the case takes away
/// from it.
///
/// # Errors
/// [`SceneError::TargetTouches`] for a structure's voxel in what a channel's tool sweeps.
pub(super) fn touched<'a>(
    spec: &SceneSpec,
    inside: &Inside,
    structures: &'a [SceneStructure],
) -> Result<Vec<&'a SceneStructure>, SceneError> {
    let grid = spec.labels.grid();
    let label = match spec.target {
        Target::Label(label) => label,
        _ if !spec.is_swept => return Ok(vec![]),
        _ => {
            for structure in structures {
                for (n, _) in spec.labels.data().iter().enumerate().filter(|(_, l)| **l == structure.label) {
                    let voxel = grid.voxel(n);
                    if spec.target.contains(grid.center(voxel)) {
                        let [x, y, z] = grid.center(voxel).coords.into();
                        let structure = structure.name.clone();
                        return Err(SceneError::TargetTouches { structure, x, y, z, voxel });
                    }
                }
            }
            return Ok(vec![]);
        }
    };
    let drawn = left_of_label(spec, inside, label)?;
    let mut is_structure = vec![false; 1 << 16];
    structures.iter().for_each(|structure| is_structure[usize::from(structure.label)] = true);
    if !touches(&drawn, label, |l| is_structure[usize::from(l)]) {
        return Ok(vec![]);
    }
    Ok(structures.iter().filter(|structure| touches(&drawn, label, |l| l == structure.label)).collect())
}

/// What a target loses that gives way to the structures that it touches; `inside` gives way already.
///
/// # Errors
/// [`SceneError::TargetGivesWay`] where that is most of it: then one of the labels is another's.
pub(super) fn warning(
    spec: &SceneSpec,
    inside: &Inside,
    touched: &[&SceneStructure],
) -> Result<String, SceneError> {
    let Target::Label(label) = spec.target else { return Ok(String::new()) };
    let (grid, labels) = (spec.labels.grid(), spec.labels.data());
    let mm3 = |voxels: usize| voxels as f64 * grid.voxel_mm3();
    // a voxel that both have is shown as the structure's
    let is_kept = |n: &usize| spec.structures.iter().any(|(_, of)| *of == labels[*n]);
    let shared = spec.further.iter().filter(|(_, other)| *other == label).map(|(place, _)| *place as usize);
    let shared: Vec<usize> = shared.filter(is_kept).collect();
    let is_left = |n: &usize| !inside.is_taken_away(grid.center(grid.voxel(*n)), labels[*n]);
    let shown = (0..labels.len())
        .into_par_iter()
        .with_min_len(1 << 14)
        .filter(|n| labels[*n] == label)
        .filter(is_left);
    let [drawn, kept] = shown
        .map(|n| [1, usize::from(inside.bounds(grid.center(grid.voxel(n)), label))])
        .reduce(|| [0; 2], |a, b| [a[0] + b[0], a[1] + b[1]]);
    let drawn_mm3 = mm3(drawn + shared.iter().filter(|n| is_left(n)).count());
    let lost_mm3 = drawn_mm3 - mm3(kept);
    let each = touched.iter().map(|structure| {
        let voxels = shared.iter().filter(|n| labels[**n] == structure.label).count();
        let overlap = if voxels > 0 {
            format!(", which overlaps it by {:.2} mm³", mm3(voxels))
        } else {
            String::new()
        };
        format!("structure '{}'{overlap}", structure.name)
    });
    let each = each.collect::<Vec<_>>().join(" and ");
    if lost_mm3 > MOST_LOST * drawn_mm3 {
        return Err(SceneError::TargetGivesWay { structures: each, lost_mm3, drawn_mm3 });
    }
    Ok(format!(
        "the target touches {each}: what lies in a structure or within its clearance is left out of the target, {lost_mm3:.2} of \
         {drawn_mm3:.2} mm³ ({:.1} %), and shares are of the rest. Look whether both labels are right",
        100.0 * lost_mm3 / drawn_mm3
    ))
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

/// Whether a voxel of `label` is among the 26 neighbours of one that `is_other`.
fn touches(labels: &Volume<u16, Ct>, label: u16, is_other: impl Fn(u16) -> bool + Sync) -> bool {
    let [nx, ny, nz] = labels.grid().dims();
    let row = |j: usize, k: usize| &labels.data()[nx * (j + ny * k)..][..nx];
    let around = |v: usize, n: usize| v.saturating_sub(1)..(v + 2).min(n);
    (0..nz).into_par_iter().any(|k| {
        cancel::poll();
        // whether the label is in one of the nine rows around, by place in the row
        let mut near = vec![false; nx];
        (0..ny).any(|j| {
            let rows = around(k, nz).flat_map(|kk| around(j, ny).map(move |jj| row(jj, kk)));
            near.fill(false);
            for row in rows.filter(|row| row.contains(&label)) {
                near.iter_mut().zip(row).for_each(|(near, l)| *near |= *l == label);
            }
            near.contains(&true)
                && (0..nx).any(|i| is_other(row(j, k)[i]) && near[around(i, nx)].contains(&true))
        })
    })
}
