//! The plan's figures computed again: volumes and mass on the fine lattice, what a ball can reach by morphology, times.

use bonemill_geometry::cancel;
use nalgebra::Vector3;
use rayon::prelude::*;

use super::anatomy::Anatomy;
use super::boxes::Boxes;
use super::carve::NEVER;
use super::check::{Check, Place};
use super::lattice::{Lattice, MATERIAL, MATERIAL_VOXEL, OBSTACLE, TARGET, TARGET_BONE, TARGET_BONE_VOXEL};
use super::moves::Moves;
use super::{VerifyError, edt};
use crate::plan::{StoredPlan, Value};

/// Share of the reachable volume that a plan removes, unless it says that it falls short.
const ENOUGH: f64 = 0.99;
/// Two lattices give a body volumes that differ by this share of it, and by this share of the layer of one voxel of the
/// planner's around it. Chosen from two bodies: 1.5 % of the volume on one of 217 mm³ at 0.5 mm, 0.6 % on one of 4717 mm³
/// at 0.25 mm.
const VOLUME_SHARE: f64 = 0.003;
const LAYER_SHARE: f64 = 0.05;
/// The same layer's share for what a ball can reach: an opening on a lattice that lies across the scan's voxels loses more
/// than one along them. 15 % on a bowl of 70 mm³ in an oblique scan at 0.2 mm, 10 % at 0.25 mm.
const OPENING_SHARE: f64 = 0.2;
/// The same for mass, which also ends there.
const MASS_SHARE: f64 = 0.03;
/// Runs of waypoints whose masses are compared take this share of all, and may differ by that share of theirs.
const RUN_SHARE: f64 = 0.02;
const RUN_MASS_SHARE: f64 = 0.2;

/// Volumes of the target and of what is removed of it.
///
/// What lies above a grey value has no one volume in a noisy scan: interpolated values are smoother than voxels, and fewer
/// of them lie beyond a threshold. Such a figure must lie within those of both readings.
pub fn volumes(plan: &StoredPlan, lattice: &Lattice, first: &[u32]) -> Vec<Check> {
    let m = &plan.record.metrics;
    let spacing_mm = plan.record.case.grid.spacing_mm;
    let removed = |n: usize| first[n] != NEVER;
    let removed_of = |what, said, readings: [u8; 2]| {
        let [a, b] = readings.map(|flag| move |n: usize| lattice.is(n, flag) && removed(n));
        same_volume(lattice, what, said, spacing_mm, LAYER_SHARE, [&a, &b])
    };
    let target = |n: usize| lattice.is(n, TARGET);
    vec![
        same_volume(lattice, "target_mm3", m.target_mm3, spacing_mm, LAYER_SHARE, [&target; 2]),
        removed_of("removed_mm3", m.removed_mm3, [TARGET; 2]),
        removed_of("removed_material_mm3", m.removed_material_mm3, [MATERIAL, MATERIAL_VOXEL]),
        removed_of("removed_bone_mm3", m.removed_bone_mm3, [TARGET_BONE, TARGET_BONE_VOXEL]),
    ]
}

/// Whether a volume that the plan states is that of the points for which a reading holds, or between those of two.
fn same_volume<F: Fn(usize) -> bool + Sync>(
    lattice: &Lattice,
    what: &str,
    said: f64,
    spacing_mm: f64,
    layer_share: f64,
    readings: [&F; 2],
) -> Check {
    let [holds, _] = readings;
    let [found, other] = readings.map(|holds| lattice.count(holds) as f64 * lattice.grid.voxel_mm3());
    let [nx, ny, nz] = lattice.grid.dims();
    let steps = [(1, nx), (nx, ny), (nx * ny, nz)];
    let at_surface = |n: usize| {
        let at = [n % nx, n / nx % ny, n / (nx * ny)];
        holds(n)
            && steps.iter().zip(at).any(|((step, count), at)| {
                at == 0 || at + 1 == *count || !holds(n - step) || !holds(n + step)
            })
    };
    // points at the surface make a layer as thick as the lattice's spacing
    let layer =
        lattice.count(&at_surface) as f64 * lattice.grid.voxel_mm3() * spacing_mm / lattice.spacing_mm();
    let limit = VOLUME_SHARE * found + layer_share * layer + lattice.grid.voxel_mm3();
    let off = (found.min(other) - said).max(said - found.max(other)).max(0.0);
    let found = if found == other { format!("{found:.3}") } else { format!("{found:.3} to {other:.3}") };
    Check::at_most("figures", off, limit, "mm³").of(what).noting(format!("says {said:.3}, found {found}"))
}

/// Times and lengths that the plan states.
pub fn totals(plan: &StoredPlan, moves: &Moves) -> Vec<Check> {
    let said = |what: &str, said: Option<f64>, found: f64, limit: f64, unit| {
        Check::at_most("figures", said.map_or(f64::INFINITY, |s| (s - found).abs()), limit, unit)
            .of(what)
            .noting(said.map_or("not said".to_owned(), |s| format!("says {s:.4}, found {found:.4}")))
    };
    let length = moves.arc_mm.last().copied().unwrap_or(0.0);
    let end = moves.times_s.last().copied().unwrap_or(0.0);
    let mass: f64 = plan.waypoints.iter().map(|w| w.mass_mg).sum();
    vec![
        said("total_time_s", Some(plan.record.metrics.total_time_s), end, 1e-6, "s"),
        said("path_length_mm", more(plan, "path_length_mm"), length, 1e-3, "mm"),
        said("removed_mass_mg", more(plan, "removed_mass_mg"), mass, 1e-6 * (1.0 + mass), "mg"),
    ]
}

/// A figure beyond the required ones.
fn more(plan: &StoredPlan, key: &str) -> Option<f64> {
    match plan.record.metrics.more.iter().find(|(k, _)| k == key)?.1 {
        Value::Number(v) => Some(v),
        _ => None,
    }
}

/// Coverage: which part of what the ball can reach is removed, and whether the plan says the truth about it.
///
/// Reachable: the opening by the ball of free space and target, less clearances, connected to the outside along the
/// approach. `lattice` is coarse and reaches above the target by more than the burr; `first` belongs to it.
pub fn coverage(
    plan: &StoredPlan,
    anatomy: &Anatomy,
    boxes: &[Option<Boxes<'_>>],
    lattice: &Lattice,
    first: &[u32],
) -> Result<Vec<Check>, VerifyError> {
    let (grid, h) = (&lattice.grid, lattice.spacing_mm());
    let radius = plan.record.case.burr.radius_mm;
    let class = &lattice.class;
    let from_bone = edt::squared_voxels(grid.dims(), |n| class[n] & OBSTACLE != 0);
    let least = ((radius / h).powi(2) - 1e-5) as f32;
    let mut clear: Vec<bool> = from_bone.iter().map(|d| *d >= least).collect();
    for (kept, boxes) in anatomy.kept.iter().zip(boxes) {
        let Some(boxes) = boxes else { continue };
        keep_away(plan, lattice, boxes, radius + kept.clearance_mm, &mut clear);
    }
    let inside = connected_to_top(grid.dims(), &clear);
    let from_centers = edt::squared_voxels(grid.dims(), |n| inside[n]);
    let reach = ((radius / h).powi(2) + 1e-5) as f32;
    let reachable = lattice.volume_mm3(TARGET, |n| from_centers[n] <= reach);
    let removed = lattice.volume_mm3(TARGET, |n| from_centers[n] <= reach && first[n] != NEVER);
    let share = if reachable > 0.0 { removed / reachable } else { 1.0 };
    let said = plan.record.metrics.reachable_mm3;
    let admitted = !plan.record.shortfalls.is_empty();
    let mut covered =
        Check::at_least("coverage", share, if admitted { 0.0 } else { ENOUGH }, "of the reachable");
    covered = covered.noting(format!(
        "removed {removed:.1} of {reachable:.1} mm³{}",
        if admitted { "; the plan says that it falls short" } else { "" }
    ));
    let held = |n: usize| lattice.is(n, TARGET) && from_centers[n] <= reach;
    Ok(vec![
        covered,
        same_volume(lattice, "reachable_mm3", said, lattice.spacing_mm(), OPENING_SHARE, [&held; 2]),
    ])
}

/// Takes out the points nearer to a structure than `least_mm`. Along a row, the distance says how far the side cannot change.
fn keep_away(plan: &StoredPlan, lattice: &Lattice, boxes: &Boxes<'_>, least_mm: f64, clear: &mut [bool]) {
    let grid = &lattice.grid;
    let ([nx, ny, _], h) = (grid.dims(), lattice.spacing_mm());
    clear.par_chunks_mut(nx).enumerate().for_each(|(row, clear)| {
        cancel::poll();
        let mut i = 0;
        while i < nx {
            let p = plan.record.ct_from_approach * grid.center([i, row % ny, row / ny]);
            let (nearer, by_mm) = boxes.side(p, least_mm);
            let same = ((by_mm - 1e-9) / h).max(0.0) as usize;
            if nearer {
                clear[i..(i + same + 1).min(nx)].fill(false);
            }
            i += same + 1;
        }
    });
}

/// The points that a walk from face to face reaches from the highest slab.
fn connected_to_top([nx, ny, nz]: [usize; 3], clear: &[bool]) -> Vec<bool> {
    let slab = nx * ny;
    let mut reached = vec![false; clear.len()];
    let mut open: Vec<usize> = (slab * (nz - 1)..slab * nz).filter(|n| clear[*n]).collect();
    open.iter().for_each(|n| reached[*n] = true);
    while let Some(n) = open.pop() {
        let (i, j, k) = (n % nx, n / nx % ny, n / slab);
        let sides = [
            (i > 0, n.wrapping_sub(1)),
            (i + 1 < nx, n + 1),
            (j > 0, n.wrapping_sub(nx)),
            (j + 1 < ny, n + nx),
            (k > 0, n.wrapping_sub(slab)),
            (k + 1 < nz, n + slab),
        ];
        for (_, m) in sides.into_iter().filter(|(is_in, _)| *is_in) {
            if clear[m] && !reached[m] {
                reached[m] = true;
                open.push(m);
            }
        }
    }
    reached
}

/// The mass column: in all, and over runs of waypoints that take a fiftieth of it each.
///
/// A point of material counts for the move that first reaches it, if it lies in the ball where that move ends.
pub fn masses(
    plan: &StoredPlan,
    anatomy: &Anatomy,
    lattice: &Lattice,
    first: &[u32],
    moves: &Moves,
) -> Vec<Check> {
    let found = mass_by_move(plan, anatomy, lattice, first, moves);
    let total: f64 = found.iter().sum();
    let said: f64 = plan.waypoints.iter().map(|w| w.mass_mg).sum();
    let note = |said: f64, found: f64| format!("says {said:.4} mg, found {found:.4} mg");
    let of = |whole: f64, said: f64, found: f64| (said - found).abs() / whole.max(1e-9);
    let mut worst = (0.0, 0, 0.0, 0.0);
    let mut run = (0.0, 0.0);
    for (n, (found, row)) in found.iter().zip(&plan.waypoints).enumerate() {
        run = (run.0 + row.mass_mg, run.1 + found);
        if run.0.max(run.1) >= RUN_SHARE * total || n + 1 == plan.waypoints.len() {
            // a single move can take more than that
            let by = of(run.1.max(RUN_SHARE * total), run.0, run.1);
            if by > worst.0 {
                worst = (by, n, run.0, run.1);
            }
            run = (0.0, 0.0);
        }
    }
    vec![
        Check::at_most("mass", of(total, said, total), MASS_SHARE, "of it")
            .of("in all")
            .noting(note(said, total)),
        Check::at_most("mass", worst.0, RUN_MASS_SHARE, "of it")
            .of("of a fiftieth")
            .at(Place::Waypoint(worst.1))
            .noting(note(worst.2, worst.3)),
    ]
}

fn mass_by_move(
    plan: &StoredPlan,
    anatomy: &Anatomy,
    lattice: &Lattice,
    first: &[u32],
    moves: &Moves,
) -> Vec<f64> {
    let grid = &lattice.grid;
    let table = &plan.record.case.density.table;
    let radius2 = plan.record.case.burr.radius_mm.powi(2);
    let [nx, ny, nz] = grid.dims();
    let slab = |k: usize| -> Vec<(u32, f64)> {
        cancel::poll();
        (k * nx * ny..(k + 1) * nx * ny)
            .filter(|n| lattice.class[*n] & MATERIAL != 0 && first[*n] != NEVER)
            .filter_map(|n| {
                let p: Vector3<f64> = grid.center(grid.voxel(n)).coords;
                let end = moves.points.get(first[n] as usize)?;
                let inside = (p - end).norm_squared() <= radius2;
                inside.then(|| (first[n], density(anatomy, table, plan, grid.center(grid.voxel(n)))))
            })
            .collect()
    };
    let mut mass = vec![0.0; moves.len()];
    let slabs: Vec<_> = (0..nz).into_par_iter().map(slab).collect();
    for (number, rho) in slabs.into_iter().flatten() {
        // g/cm³ is mg/mm³
        mass[number as usize] += rho * grid.voxel_mm3();
    }
    mass
}

/// Density of the CT's voxels around a point, interpolated, g/cm³: calibrated first, interpolated then.
fn density(
    anatomy: &Anatomy,
    table: &bonemill_imaging::DensityTable,
    plan: &StoredPlan,
    p: bonemill_geometry::Point<bonemill_geometry::Approach>,
) -> f64 {
    let ct = &anatomy.ct;
    let index = ct.grid().continuous_index(plan.record.ct_from_approach * p);
    let dims = ct.grid().dims();
    let base = index.map(f64::floor);
    let mut sum = 0.0;
    for corner in 0..8usize {
        let mut weight = 1.0;
        let mut voxel = Some([0usize; 3]);
        for a in 0..3 {
            let up = (corner >> a & 1) as f64;
            let share = index[a] - base[a];
            weight *= if up > 0.0 { share } else { 1.0 - share };
            let at = base[a] + up;
            let is_in = at >= 0.0 && at < dims[a] as f64;
            voxel = voxel.filter(|_| is_in).map(|mut v| {
                v[a] = at as usize;
                v
            });
        }
        let hu = voxel.map_or(-1000.0, |v| f64::from(*ct.get(v)));
        sum += weight * table.density_g_cm3(hu);
    }
    sum
}
