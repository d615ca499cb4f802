//! The direction of the lines, chosen by what it costs.
//!
//! With one tilt the raster decides how often the shaft must alternate between the two sides of a line, and which side of the
//! burr meets a structure. Two candidates, along the target's longer side and across it, are laid as drafts: roughing only,
//! coarse steps, coarse directions. Each draft is oriented by the dynamic program, and the lower J wins.
//!
//! A draft is a comparison, not a plan: waypoints that no axis reaches count as much as the dearest cut, and nothing is
//! dropped or refined. Bone stands and goes by voxels, not by parts of them.

use bonemill_imaging::{Class, Scene};
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

use super::PlanError;
use super::near::{self, Near};
use super::orient::{CostField, cost_rows};
use super::prepared::{feeds, terms};
use super::reach::{ReachSpec, free_directions, lengths, limited};
use super::setup;
use crate::access::Access;
use crate::burr::OrientationKernel;
use crate::case::Case;
use crate::engagement::{SweptPath, mass_increments_by_voxels};
use crate::orientation::FreeSets;
use crate::orientation::sequence::{Forbidden, Found, Problem, best_sequence};
use crate::path::{MoveKind, PathSpacing, RasterFrame, lay_rough};
use crate::space::BurrSpace;

/// A draft's steps are this many times longer.
const COARSER: f64 = 4.0;
/// The second candidate must be better by this share: ties keep the first.
const CLEARLY: f64 = 0.01;

/// The candidate of lower cost; the first where they do not differ. `compliance`: of each direction, where the cost looks at the deflection.
pub fn cheaper(
    case: &Case,
    scene: &Scene,
    space: &BurrSpace,
    spec: &ReachSpec,
    compliance: Option<&[Matrix3<f64>]>,
    candidates: [RasterFrame; 2],
) -> Result<RasterFrame, PlanError> {
    let costs: Vec<Result<f64, PlanError>> =
        candidates.par_iter().map(|frame| draft_cost(case, scene, space, spec, compliance, frame)).collect();
    let [first, second] = candidates;
    let mut costs = costs.into_iter();
    let mut next = || costs.next().unwrap_or(Ok(f64::INFINITY));
    Ok(if next()? * (1.0 - CLEARLY) > next()? { second } else { first })
}

/// J of a draft along `frame`; unreached waypoints cost 1 per mm.
fn draft_cost(
    case: &Case,
    scene: &Scene,
    space: &BurrSpace,
    spec: &ReachSpec,
    compliance: Option<&[Matrix3<f64>]>,
    frame: &RasterFrame,
) -> Result<f64, PlanError> {
    let radius = case.burr.radius_mm;
    let step_mm = (COARSER * spec.spacing.step_mm).min(radius);
    let path = lay_rough(space, PathSpacing { step_mm, ..spec.spacing }, frame);
    let points = &path.points;
    let access = Access::draft(scene, spec.solid, path.removal.time(), spec.shank);
    let limited = limited(points.len(), |i| points[i].kind == MoveKind::Cut);
    let free = free_directions(&access, points, &limited, spec, None);
    drop(access);
    let clearances: Vec<f64> = case.structures.iter().map(|s| s.clearance_mm).collect();
    let near: Vec<Vec<Near>> = near::nearest_structures(scene, &clearances, radius, points)?
        .into_iter()
        .map(|n| n.into_iter().collect())
        .collect();
    let moments = mass_increments_by_voxels(&scene.density_g_cm3, &path.removal, points, radius);
    let (terms, feeds) = (terms(case, &near)?, feeds(points));
    let tool = setup::tool(&case.burr)?;
    let (material, measure) = setup::material(&case.material)?;
    let kernel = OrientationKernel::new(&tool, &material, measure, 1024, 4);
    let swept = SweptPath::new(scene, &path.removal, points, radius);
    let field = CostField {
        swept: &swept,
        kernel: &kernel,
        material: &material,
        terms: &terms,
        moments: &moments,
        feeds: &feeds,
        nominal_mm_s: case.speed.nominal_mm_s,
        spindle_rpm: case.burr.spindle_rpm,
        compliance: compliance.map(<[_]>::to_vec),
        finer_compliance: None,
    };
    let cost = cost_rows(spec.directions, &free, &field, None);
    let length_mm = lengths(points);
    // what no axis reaches is left out of the sequence, and counted as dear
    let reached: Vec<usize> = (0..points.len()).filter(|i| free.count(*i) > 0).collect();
    let unreached_mm: f64 = (0..points.len()).filter(|i| free.count(*i) == 0).map(|i| length_mm[i]).sum();
    let count = spec.directions.len();
    let rows: Vec<f32> = reached.iter().flat_map(|i| &cost[i * count..(i + 1) * count]).copied().collect();
    let kept: Vec<f64> = reached.iter().map(|i| length_mm[*i]).collect();
    let problem = Problem {
        directions: spec.directions,
        cost: &rows,
        free: &FreeSets::fill(reached.len(), count, |i, n| free.contains(reached[i], n)),
        length_mm: &kept,
        rate: spec.rate,
        forbidden: &Forbidden::default(),
    };
    Ok(match best_sequence(&problem) {
        Found::Sequence { total, .. } => total + unreached_mm,
        // no sequence gets through without dropping waypoints: as dear as it can be, in proportion
        Found::Blocked(i) => length_mm.iter().sum::<f64>() * (2.0 - i as f64 / points.len() as f64),
    })
}

/// The centre of mass of the target's bone in the layers' plane; the target's centre where there is none.
pub fn mass_center(scene: &Scene) -> [f64; 2] {
    let grid = scene.class.grid();
    let [nx, ny, _] = grid.dims();
    let (mut mass, mut moment) = (0.0, [0.0; 2]);
    for (row, classes) in scene.class.data().chunks_exact(nx).enumerate() {
        if !classes.iter().any(|class| class.is(Class::TARGET_BONE)) {
            continue;
        }
        let start = grid.center([0, row % ny, row / ny]);
        for (i, _) in classes.iter().enumerate().filter(|(_, class)| class.is(Class::TARGET_BONE)) {
            let density = f64::from(scene.density_g_cm3.data()[row * nx + i]);
            mass += density;
            moment[0] += density * (start.x() + i as f64 * grid.spacing_mm().x);
            moment[1] += density * start.y();
        }
    }
    if mass > 0.0 { moment.map(|m| m / mass) } else { [scene.target_center.x(), scene.target_center.y()] }
}

/// Direction in the layer from the target's centre to the structure that is nearest less its clearance.
pub fn toward_structure(
    scene: &Scene,
    clearances_mm: &[f64],
    radius_mm: f64,
) -> Result<Option<[f64; 2]>, PlanError> {
    let near = near::nearest_structure(scene, clearances_mm, radius_mm, scene.target_center)?;
    let toward: Option<Vector3<f64>> = near.map(|n| n.proximity.toward.into_inner());
    Ok(toward.map(|u| [u.x, u.y]))
}
