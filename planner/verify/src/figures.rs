//! Computes the plan's figures again: volumes on the planner's voxels, times and lengths, masses on the fine lattice.

use bonemill_geometry::{Ct, Point, cancel};
use bonemill_imaging::DensityTable;
use bonemill_planfile::{StoredPlan, Value};
use rayon::prelude::*;

use super::anatomy::Anatomy;
use super::carve::{NEVER, Removed};
use super::check::{Check, Place};
use super::forces::took_s;
use super::lattice::{FineLattice, HAS_MASS, MATERIAL, OUTSIDE, SHEET, TARGET, TARGET_BONE};
use super::moves::Moves;
use super::requirements::COVERAGE;
use super::voxels::{Doubtful, Voxels};

/// Least share of the reachable volume that a plan must remove.
const ENOUGH: f64 = 0.99;
/// Largest share of the target that may lie outside the scan.
const MOST_OUTSIDE: f64 = 0.005;
/// Relative rounding of a volume that is summed voxel by voxel.
const SUM_SHARE: f64 = 1e-9;
/// Largest relative difference of masses on two lattices.
const MASS_SHARE: f64 = 0.03;
/// The same of the layers at its surface: flat faces along a grid are rounded to one side.
const LAYER_SHARE: f64 = 0.05;
/// Masses are compared over runs of waypoints that remove this share of all mass.
const RUN_SHARE: f64 = 0.02;
const RUN_MASS_SHARE: f64 = 0.2;
/// Such a run removes at least as much as this many of the planner's voxels of 1 g/cm³. For fewer voxels the comparison is
/// inexact, because a voxel that is cut from two sides counts later than its points.
const RUN_VOXELS: f64 = 512.0;

/// Checks the removed share of what the ball can reach, and every volume that the plan states, counted on the planner's voxels.
pub fn volumes(
    plan: &StoredPlan,
    voxels: &Voxels,
    swept: &Doubtful<Vec<bool>>,
    reachable: &Doubtful<Vec<bool>>,
) -> Vec<Check> {
    let m = &plan.record.metrics;
    let parts: [(&str, &[&Doubtful<Vec<bool>>]); 4] = [
        ("target", &[]),
        ("reachable", &[reachable]),
        ("removed", &[swept]),
        ("removed_reachable", &[swept, reachable]),
    ];
    let kinds = [("all_mm3", TARGET), ("material_mm3", MATERIAL), ("bone_mm3", TARGET_BONE)];
    let found = parts.map(|(_, sets)| kinds.map(|(_, flag)| voxels.volume_mm3(flag, sets)));
    let [[target, ..], [reached, ..], [removed, material, bone], _] = found;
    // on these voxels the flag means all bone outside the target
    let untargeted = voxels.volume_mm3(SHEET, &[swept]);
    let outside_mm3 = more(plan, "target_outside_mm3");
    let whole_mm3 =
        stated(plan, &["target", "all_mm3"]).zip(outside_mm3).map(|(target, outside)| target + outside);
    let mut checks = vec![
        counted("untargeted_bone_by_voxels_mm3", more(plan, "untargeted_bone_by_voxels_mm3"), untargeted),
        share_said(plan, "reached_share", "removed_reachable", stated(plan, &["reachable", "all_mm3"])),
        share_said(plan, "removed_share", "removed", whole_mm3),
        counted("target_mm3", Some(m.target_mm3), target),
        counted("reachable_mm3", Some(m.reachable_mm3), reached),
        counted("removed_mm3", Some(m.removed_mm3), removed),
        counted("removed_material_mm3", Some(m.removed_material_mm3), material),
        counted("removed_bone_mm3", Some(m.removed_bone_mm3), bone),
    ];
    for ((part, _), found) in parts.iter().zip(found) {
        for ((kind, _), found) in kinds.iter().zip(found) {
            checks.push(counted(&format!("{part}.{kind}"), stated(plan, &[part, kind]), found));
        }
    }
    checks.push(coverage(voxels, swept, reachable));
    checks
}

/// Checks the plan's figures about the scan's edge, and whether the scan contains the target. Doubtful voxels count in favour
/// of the plan.
pub fn beyond_scan(plan: &StoredPlan, voxels: &Voxels, edge_mm2: [f64; 2]) -> Vec<Check> {
    let (outside, [_, target]) = (voxels.volume_mm3(OUTSIDE, &[]), voxels.volume_mm3(TARGET, &[]));
    let [least, _] = outside;
    let share = if least > 0.0 { least / (least + target) } else { 0.0 };
    vec![
        counted("target_outside_mm3", more(plan, "target_outside_mm3"), outside),
        Check { unit: "mm²", ..counted("scan_edge_bone_mm2", more(plan, "scan_edge_bone_mm2"), edge_mm2) },
        Check::at_most("target outside the scan", share, MOST_OUTSIDE, "of it")
            .noting(format!("{least:.1} mm³ of it lie beyond the CT")),
    ]
}

/// Checks that a share stated by the plan is the ratio of the two stated volumes, which are themselves checked.
fn share_said(plan: &StoredPlan, share: &str, part: &str, whole_mm3: Option<f64>) -> Check {
    let part_mm3 = stated(plan, &[part, "all_mm3"]);
    let found = part_mm3.zip(whole_mm3).map(|(part, whole)| if whole > 0.0 { part / whole } else { 1.0 });
    let off = more(plan, share).zip(found).map_or(f64::INFINITY, |(said, found)| (said - found).abs());
    Check::at_most("figures", off, SUM_SHARE, "").of(share)
}

/// Checks that a volume stated by the plan lies between the least and the largest count.
pub fn counted(what: &str, said: Option<f64>, [least, most]: [f64; 2]) -> Check {
    let off = said.map_or(f64::INFINITY, |said| (least - said).max(said - most).max(0.0));
    let found = if least == most { format!("{most:.4}") } else { format!("{least:.4} to {most:.4}") };
    let said = said.map_or("nothing".into(), |said| format!("{said:.4}"));
    Check::at_most("figures", off, SUM_SHARE * (1.0 + most), "mm³")
        .of(what)
        .noting(format!("says {said}, counted {found}"))
}

/// Checks that enough of the reachable volume is removed. Doubtful voxels count in favour of the plan.
fn coverage(voxels: &Voxels, swept: &Doubtful<Vec<bool>>, reachable: &Doubtful<Vec<bool>>) -> Check {
    let [_, removed] = voxels.volume_mm3(TARGET, &[swept, reachable]);
    let missed = (0..voxels.grid.len()).filter(|n| reachable.surely[*n] && !swept.possibly[*n]).count();
    let whole = removed + missed as f64 * voxels.target_mm3[0];
    let share = if whole > 0.0 { removed / whole } else { 1.0 };
    Check::at_least(COVERAGE, share, ENOUGH, "of the reachable")
        .noting(format!("removed {removed:.1} of {whole:.1} mm³"))
}

/// Compares volumes on the planner's voxels with those on the fine lattice: the resolution of the stated volumes.
///
/// A flat face lies between two planes of lattice points, and counting puts it halfway between them, so the error is at most
/// half their distance. This distance is h for a face across an axis and less for every other direction; it is at most the
/// thickness of the layer of points at the face, h times the largest component of the face's normal. So a count's error is
/// at most half its surface layer, and two counts differ by at most half of both layers.
pub fn resolution(
    plan: &StoredPlan,
    lattice: &FineLattice,
    first: &[u32],
    voxels: &Voxels,
    swept: &Doubtful<Vec<bool>>,
) -> Vec<Check> {
    let m = &plan.record.metrics;
    let of = |what, said: f64, flag: u8, is_removed: bool| {
        let fine = |n: usize| lattice.is(n, flag) && (!is_removed || first[n] != NEVER);
        let planned = |n: usize| voxels.class.possibly[n] & flag != 0 && (!is_removed || swept.possibly[n]);
        let found = lattice.count(&fine) as f64 * lattice.grid.voxel_mm3();
        let layers = layer(lattice.grid.dims(), &fine) as f64 * lattice.grid.voxel_mm3()
            + layer(voxels.grid.dims(), &planned) as f64 * voxels.grid.voxel_mm3();
        Check::at_most("figures on a finer lattice", (said - found).abs(), 0.5 * layers, "mm³")
            .of(what)
            .noting(format!("says {said:.3}, found {found:.3} at {} mm", lattice.spacing_mm()))
    };
    vec![
        of("target_mm3", m.target_mm3, TARGET, false),
        of("removed_mm3", m.removed_mm3, TARGET, true),
        of("removed_material_mm3", m.removed_material_mm3, MATERIAL, true),
        of("removed_bone_mm3", m.removed_bone_mm3, TARGET_BONE, true),
    ]
}

/// Number of points of a body that have one of their six neighbours outside it.
fn layer([nx, ny, nz]: [usize; 3], holds: &(impl Fn(usize) -> bool + Sync)) -> usize {
    let steps = [(1, nx), (nx, ny), (nx * ny, nz)];
    let at_surface = |n: &usize| {
        let at = [n % nx, n / nx % ny, n / (nx * ny)];
        holds(*n)
            && steps.iter().zip(at).any(|((step, count), at)| {
                at == 0 || at + 1 == *count || !holds(n - step) || !holds(n + step)
            })
    };
    (0..nx * ny * nz).into_par_iter().with_min_len(1 << 14).filter(at_surface).count()
}

/// Checks the times, lengths and forces that the plan states as a whole.
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
        said("peak_force_n", more(plan, "peak_force_n"), peak_n(plan), 1e-6, "N"),
        said("mean_force_n", more(plan, "mean_force_n"), mean_n(plan), 1e-6, "N"),
    ]
}

/// The largest force within any move, N.
pub fn peak_n(plan: &StoredPlan) -> f64 {
    plan.waypoints.iter().map(|w| w.peak_force_n).fold(0.0, f64::max)
}

/// The mean force over the time of the moves that remove something, N.
pub fn mean_n(plan: &StoredPlan) -> f64 {
    let cuts = plan.waypoints.iter().enumerate().filter(|(_, w)| w.mass_mg > 0.0);
    let cuts: Vec<_> = cuts.map(|(n, w)| (w.mean_force_n, took_s(plan, n))).collect();
    let cutting_s: f64 = cuts.iter().map(|(_, time_s)| time_s).sum();
    let sum_ns: f64 = cuts.iter().map(|(force_n, time_s)| force_n * time_s).sum();
    if cutting_s > 0.0 { sum_ns / cutting_s } else { 0.0 }
}

/// A figure of the plan that is not one of the required ones.
pub fn more(plan: &StoredPlan, key: &str) -> Option<f64> {
    plan.record.metrics.number(key)
}

/// A figure of the plan that is not one of the required ones, by its keys, the outermost first.
pub(super) fn stated(plan: &StoredPlan, keys: &[&str]) -> Option<f64> {
    plan.record.metrics.number_at(keys)
}

/// A table of the plan's figures.
pub fn table<'a>(plan: &'a StoredPlan, key: &str) -> Option<&'a [(String, Value)]> {
    match &plan.record.metrics.more.iter().find(|(k, _)| k == key)?.1 {
        Value::Table(entries) => Some(entries),
        _ => None,
    }
}

/// Checks the mass column: the total, and runs of waypoints that remove a fiftieth of it each.
///
/// The mass is that of the planner's voxels, each with its density. A lattice point has the mass of its share of its voxel;
/// it counts for the move that first reaches it, and only if it lies in the ball at that move's end.
pub fn masses(
    plan: &StoredPlan,
    anatomy: &Anatomy,
    voxels: &Voxels,
    removed: &Removed,
    moves: &Moves,
) -> Vec<Check> {
    let Removed { lattice, first, .. } = *removed;
    let found = mass_by_move(plan, anatomy, voxels, removed, moves);
    let total: f64 = found.iter().sum();
    let said: f64 = plan.waypoints.iter().map(|w| w.mass_mg).sum();
    let note = |said: f64, found: f64| format!("says {said:.4} mg, found {found:.4} mg");
    let of = |whole: f64, said: f64, found: f64| (said - found).abs() / whole.max(1e-9);
    // the mass of a run of a few voxels cannot be measured with points
    let few = RUN_VOXELS * voxels.grid.voxel_mm3();
    let least = (RUN_SHARE * total).max(few);
    let mut worst = (0.0, 0, 0.0, 0.0);
    let mut run = (0.0, 0.0);
    for (n, (found, row)) in found.iter().zip(&plan.waypoints).enumerate() {
        run = (run.0 + row.mass_mg, run.1 + found);
        if run.0.max(run.1) >= least || n + 1 == plan.waypoints.len() {
            // a single move can remove more than that
            let by = of(run.1.max(least), run.0, run.1);
            if by > worst.0 {
                worst = (by, n, run.0, run.1);
            }
            run = (0.0, 0.0);
        }
    }
    // points of the surface are counted or not as a whole: by this lattice, and by the planner's, whose layer is twice as thick
    let taken = |n: usize| lattice.is(n, HAS_MASS) && first[n] != NEVER;
    let layers = 3.0 * layer(lattice.grid.dims(), &taken) as f64 / lattice.count(&taken).max(1) as f64;
    // half of both for a very small volume, in which they do not average out; at most half of the volume
    let small = if total < few { (0.5 * layers).min(0.5) * total / few } else { 0.0 };
    let share = small.max(LAYER_SHARE * layers).max(MASS_SHARE);
    vec![
        Check::at_most("mass", of(total.max(least), said, total), share, "of it")
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
    voxels: &Voxels,
    removed: &Removed,
    moves: &Moves,
) -> Vec<f64> {
    let Removed { lattice, first, .. } = *removed;
    let grid = &lattice.grid;
    let radius2 = plan.record.case.burr.radius_mm.powi(2);
    let [nx, ny, nz] = grid.dims();
    let density = densities(plan, anatomy, voxels);
    let slab = |k: usize| -> Vec<(u32, f64)> {
        cancel::poll();
        (k * nx * ny..(k + 1) * nx * ny)
            .filter(|n| first[*n] != NEVER)
            .filter_map(|n| {
                let p = grid.center(grid.voxel(n));
                let end = moves.points.get(first[n] as usize)?;
                let rho = density[voxels.grid.index(voxels.grid.nearest(p)?)];
                let inside = rho > 0.0 && (p.coords - end).norm_squared() <= radius2;
                inside.then_some((first[n], f64::from(rho)))
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

/// Density of the planner's voxels, g/cm³; 0 where there is neither material of the target nor bone outside it.
fn densities(plan: &StoredPlan, anatomy: &Anatomy, voxels: &Voxels) -> Vec<f32> {
    let table = &plan.record.case.density.table;
    let of = |(n, class): (usize, &u8)| {
        if class & HAS_MASS == 0 {
            return 0.0;
        }
        let p = voxels.ct_from_grid * voxels.grid.center(voxels.grid.voxel(n));
        density(anatomy, table, p) as f32
    };
    voxels.class.possibly.par_iter().enumerate().with_min_len(1 << 12).map(of).collect()
}

/// Density at a point, g/cm³: HU are converted at the CT's voxels first, then interpolated.
fn density(anatomy: &Anatomy, table: &DensityTable, p: Point<Ct>) -> f64 {
    let ct = &anatomy.ct;
    let index = ct.grid().continuous_index(p);
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
