//! Thin bone outside the target: it is kept beyond the band; within the band it may be removed and gives force. Compared with the
//! images point by point, without a planning grid.

use std::fs;
use std::ops::Range;

use bonemill_geometry::{Ct, Point, Volume};
use bonemill_imaging::{AffineChoice, DensityTable, read_ct, read_labels};
use bonemill_planner::burr::{Discretisation, ElementGrid, Material, Measure, Motion, Tool, burr_force};
use bonemill_planner::path::MoveKind;
use bonemill_planner::plan::{StoredPlan, Waypoint};
use nalgebra::Vector3;

use crate::support::body::{AIR_FROM, AIR_HU, ORIGIN_MM, SPACING_MM, TARGET};
use crate::support::place::Place;

const RADIUS_MM: f64 = 1.5;
const NECK_MM: f64 = 0.6;

/// A pocket beside an air cell, separated by a wall one voxel thick that begins half a millimetre from the pocket's last layer of
/// centres, within the band.
fn with_wall() -> Place {
    Place::healthy()
        .with_ct(|ct| {
            ct.fill([27..36, 12..26, 15..AIR_FROM], AIR_HU);
            ct.fill([27..28, 12..26, 15..AIR_FROM], 1100.0);
        })
        .with_case("[grid]\nspacing_mm = 0.5\n", "[grid]\nspacing_mm = 0.25\n")
}

/// The voxels of a sheet in the air over a second, shallow target, 1 mm from its centres: beyond the band.
const SHEET: [Range<usize>; 3] = [1..10, 10..28, AIR_FROM + 1..AIR_FROM + 2];

fn with_sheet() -> Place {
    Place::healthy()
        .with_ct(|ct| ct.fill(SHEET, 1100.0))
        .with_labels(|labels| labels.fill([3..8, 12..26, AIR_FROM - 1..AIR_FROM], TARGET))
}

fn planned(place: &Place) -> (StoredPlan, toml::Table) {
    let plan = place.verified();
    let record: toml::Table = fs::read_to_string(place.path("plan/plan.toml")).unwrap().parse().unwrap();
    (plan, record)
}

fn metric(record: &toml::Table, key: &str) -> f64 {
    record["metrics"][key].as_float().unwrap()
}

fn from_segment(p: &Vector3<f64>, a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
    let along = b - a;
    let t = if along.norm() > 0.0 { (p - a).dot(&along) / along.norm_squared() } else { 0.0 };
    (p - a - along * t.clamp(0.0, 1.0)).norm()
}

/// Ends of every move; the first has no length.
fn moves(plan: &StoredPlan) -> Vec<[Vector3<f64>; 2]> {
    let at = |n: usize| plan.waypoints[n].position.coords;
    (0..plan.waypoints.len()).map(|n| [at(n.saturating_sub(1)), at(n)]).collect()
}

/// Largest depth of the sheet's voxel centres in the sweep, mm; negative outside.
fn deepest_in_sheet(plan: &StoredPlan) -> f64 {
    let moves = moves(plan);
    let [x, y, z] = SHEET;
    let voxels =
        x.flat_map(|i| y.clone().map(move |j| [i, j])).flat_map(|[i, j]| z.clone().map(move |k| [i, j, k]));
    let depth = |voxel: [usize; 3]| {
        let p = Vector3::from(ORIGIN_MM) + Vector3::from(voxel.map(|v| v as f64)) * SPACING_MM;
        RADIUS_MM - moves.iter().map(|[a, b]| from_segment(&p, a, b)).fold(f64::INFINITY, f64::min)
    };
    voxels.map(depth).fold(f64::MIN, f64::max)
}

#[test]
fn thin_bone_beyond_the_band_is_kept_or_cut_as_the_case_says_and_its_cost_is_told() {
    let (kept, keeping) = planned(&with_sheet());
    let (cut, cutting) = planned(&with_sheet().with_case("label = 20\n", "label = 20\nsheets = \"cut\"\n"));
    let depth_mm = deepest_in_sheet(&kept);
    assert!(depth_mm < 0.03, "{depth_mm} mm");
    assert!(deepest_in_sheet(&cut) > 0.5);
    assert_eq!(metric(&keeping, "thin_bone_by_voxels_mm3"), 0.0);
    assert!(metric(&cutting, "thin_bone_by_voxels_mm3") > 5.0);
    let cost_mm3 = metric(&cutting, "reachable_mm3") - metric(&keeping, "reachable_mm3");
    assert!(cost_mm3 > 5.0, "{cost_mm3} mm³");
    let kept_by_thin_bone = |record: &toml::Table| {
        let causes = record["metrics"]["not_removed_mm3"].as_table().unwrap();
        causes
            .get("thin bone outside it that is kept (target.sheets)")
            .map_or(0.0, |mm3| mm3.as_float().unwrap())
    };
    assert!((kept_by_thin_bone(&keeping) - cost_mm3).abs() < 1e-9, "{cost_mm3} mm³");
    assert_eq!(kept_by_thin_bone(&cutting), 0.0);
}

/// The images, evaluated at any point.
struct Truth {
    ct: Volume<f32, Ct>,
    labels: Volume<u16, Ct>,
    calibrated: Volume<f64, Ct>,
}

impl Truth {
    fn of(place: &Place) -> Self {
        let ct = read_ct(place.path("ct.nii"), AffineChoice::Auto).unwrap().volume;
        let labels = read_labels(place.path("labels.nii"), AffineChoice::Auto).unwrap().volume;
        let table = DensityTable::new(
            &[-1000.0, -400.0, -150.0, 100.0, 300.0, 2000.0, 4927.0],
            &[0.01, 0.602, 0.924, 1.075, 1.145, 1.856, 3.379],
        );
        let table = table.unwrap();
        let calibrated = ct.map(|hu| table.density_g_cm3(f64::from(*hu)));
        Self { ct, labels, calibrated }
    }

    /// Density of bone everywhere, and of everything except air in the target, g/cm³.
    fn density_g_cm3(&self, p: Point<Ct>) -> f64 {
        let hu = self.ct.trilinear(p, -1000.0);
        let label = self.labels.grid().nearest(p).map_or(0, |v| *self.labels.get(v));
        let in_target = label == TARGET as u16;
        if hu >= 200.0 || in_target && hu > -700.0 { self.calibrated.trilinear(p, 0.01) } else { 0.0 }
    }

    /// Mass that each move removes first, mg, on a lattice of 0.125 mm.
    fn masses_mg(&self, plan: &StoredPlan) -> Vec<f64> {
        const H: f64 = 0.125;
        let dims = [160, 160, 120]; // all of the block
        let at =
            |voxel: [usize; 3]| Vector3::from(ORIGIN_MM) + Vector3::from(voxel.map(|v| (v as f64 - 1.5) * H));
        let mut is_gone = vec![false; dims.iter().product()];
        let of_move = |[a, b]: [Vector3<f64>; 2]| {
            let (lo, hi) = (a.inf(&b) - Vector3::repeat(RADIUS_MM), a.sup(&b) + Vector3::repeat(RADIUS_MM));
            let range = |axis: usize| {
                let place = |mm: f64| ((mm - ORIGIN_MM[axis]) / H + 1.5).max(0.0) as usize;
                place(lo[axis])..(place(hi[axis]) + 2).min(dims[axis])
            };
            let mut mass = 0.0;
            for (k, j) in range(2).flat_map(|k| range(1).map(move |j| (k, j))) {
                for i in range(0) {
                    let (p, n) = (at([i, j, k]), i + dims[0] * (j + dims[1] * k));
                    if !is_gone[n] && from_segment(&p, &a, &b) <= RADIUS_MM {
                        is_gone[n] = true;
                        mass += self.density_g_cm3(Point::from_coords(p)) * H * H * H;
                    }
                }
            }
            mass
        };
        moves(plan).into_iter().map(of_move).collect()
    }

    /// The force at a waypoint, computed with the whole path before it, N.
    fn force_n(&self, moves: &[[Vector3<f64>; 2]], i: usize, waypoint: &Waypoint) -> Vector3<f64> {
        let [from, to] = moves[i];
        let near: Vec<_> =
            moves[..i].iter().filter(|[a, b]| from_segment(&to, a, b) < 2.0 * RADIUS_MM).collect();
        let left = |p: Point<Ct>| {
            let is_gone =
                near.iter().any(|[a, b]| from_segment(&p.coords, a, b) <= RADIUS_MM * (1.0 + 1e-12));
            if is_gone { 0.0 } else { self.density_g_cm3(p) }
        };
        let tool = Tool::new(RADIUS_MM, 8, -1).unwrap().with_neck(NECK_MM).unwrap();
        let material = Material::new([1400.0, 840.0, 140.0], 0.8).unwrap();
        let disc = Discretisation::new(32, 128, ElementGrid::Kappa, Measure::Db).unwrap();
        let velocity = (to - from).normalize() * waypoint.speed_mm_s;
        let motion = Motion::new(waypoint.position, waypoint.axis, velocity, 60_000.0).unwrap();
        burr_force(left, &tool, &material, &disc, &motion).force_n
    }
}

/// The wall on the pocket's side lies within the band: the burr removes it, and all of it has mass and gives force.
#[test]
fn thin_bone_that_the_burr_takes_has_mass_and_gives_force() {
    let place = with_wall();
    let (plan, record) = planned(&place);
    assert!(metric(&record, "thin_bone_by_voxels_mm3") > 0.5);
    let truth = Truth::of(&place);

    let masses_mg = truth.masses_mg(&plan);
    let (said, found): (f64, f64) = (plan.waypoints.iter().map(|w| w.mass_mg).sum(), masses_mg.iter().sum());
    assert!((said / found - 1.0).abs() < 0.01, "{said} mg, {found} mg");
    let free: f64 =
        masses_mg.iter().zip(&plan.waypoints).filter(|(_, w)| w.kind != MoveKind::Cut).map(|(m, _)| m).sum();
    assert!(free < 5e-4 * found, "{free} mg by links of {found} mg");

    let moves = moves(&plan);
    let mut off: Vec<f64> = Vec::new();
    let peak_n = plan.waypoints.iter().map(|w| w.force_n.norm()).fold(0.0, f64::max);
    for (i, waypoint) in plan.waypoints.iter().enumerate().skip(1).step_by(4) {
        if (moves[i][1] - moves[i][0]).norm() < 1e-9 {
            continue;
        }
        let truth_n = truth.force_n(&moves, i, waypoint);
        if truth_n.norm() > 0.01 * peak_n {
            off.push((waypoint.force_n - truth_n).norm() / truth_n.norm());
        }
    }
    off.sort_by(f64::total_cmp);
    assert!(off.len() > 50, "{}", off.len());
    let q90 = off[off.len() * 9 / 10];
    assert!(q90 <= 0.05, "|dF|/|F| at the ninth decile is {q90}");
}
