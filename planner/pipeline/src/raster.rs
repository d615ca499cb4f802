//! Direction and sense of the lines, chosen by the forces toward the structures.
//!
//! They decide which side of the burr meets a structure, and with one tilt how often the shaft must alternate between the two sides
//! of a line. Candidates, lines along the target's longer side and across it, each cut to and fro or away from the structures, are
//! laid as drafts: whole paths, finishing included, with coarse steps and coarse directions. Each draft is oriented by the dynamic
//! program, or as straight as is free where the case's shaft is fixed, gets speeds by the case's mode in one and the same time, links
//! included, and is compared by the forces near the structures. Where nothing is cut near a structure, the lower cost of orientation
//! wins.
//!
//! A draft is a comparison, not a plan: waypoints that no axis reaches count as much as the dearest cut, and nothing is
//! dropped or refined. Bone stands and goes by voxels, not by parts of them.

use bonemill_case::{Case, OrientationMode, Sense};
use bonemill_cutter::Ball;
use bonemill_cutting::burr::{EngagedForce, EngagedSamples, Feed, OrientationKernel};
use bonemill_cutting::metrics::Moments;
use bonemill_motion::resolve::DensePath;
use bonemill_scene::{Class, Scene};
use bonemill_setup::nearest_structures::{self, NearStructure};
use bonemill_setup::tools;
use bonemill_toolpath::access::Access;
use bonemill_toolpath::engagement::{SweptPath, mass_increments_by_voxels};
use bonemill_toolpath::orientation::FreeSets;
use bonemill_toolpath::orientation::sequence::{BestSequence, Forbidden, Problem, best_sequence};
use bonemill_toolpath::path::{self, Builder, Lines, MillPath, MoveKind, PathSpacing, RasterFrame, lay_path};
use bonemill_toolpath::space::BurrSpace;
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

use super::PlanError;
use super::choose::{scale, terms};
use super::control::StructureForces;
use super::levels;
use super::orient::{CostField, cost_rows};
use super::prepared::feeds;
use super::reach::{ReachSpec, free_directions, lengths, limited};
use super::sense::PassSense;
use super::speeds::{self, SpeedInput};

/// A draft's steps are this many times longer.
const COARSER: f64 = 4.0;
/// A later candidate must be better by this share: ties keep the first.
const CLEARLY: f64 = 0.01;
/// A candidate that leaves this share more of its length out of reach than the best is no candidate.
const MORE_UNREACHED: f64 = 0.01;

/// Lines of a path, as chosen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Raster {
    /// Their direction and order.
    pub frame: RasterFrame,
    /// In which sense they are cut.
    pub sense: Sense,
}

impl Raster {
    /// The path of a case along these lines.
    ///
    /// # Errors
    /// When the tool, the material or the cost's weights are not usable.
    pub(super) fn lay(
        &self,
        case: &Case,
        scene: &Scene,
        space: &BurrSpace,
        spacing: PathSpacing,
    ) -> Result<MillPath, PlanError> {
        let sense = PassSense::new(case, scene, self.sense)?;
        let is_reversed = |builder: &Builder, points: &[_]| sense.is_reversed(builder, points);
        Ok(lay_path(space, spacing, &Lines { frame: self.frame, sense: &is_reversed }))
    }
}

/// A draft along one candidate.
struct Draft {
    /// Cost of orientation, mm; unreached waypoints cost 1 per mm.
    cost: f64,
    /// Share of its length that no axis reaches; 1 where no sequence gets through.
    unreached: f64,
    length_mm: Vec<f64>,
    near: Vec<Vec<NearStructure>>,
    moments: Vec<Moments>,
    /// Along the chosen axes, and their cost.
    forces: Vec<Option<EngagedForce>>,
    costs: Vec<f64>,
}

/// What every draft of a case is made with.
pub struct Drafts<'a> {
    /// The case.
    pub case: &'a Case,
    /// Its scene.
    pub scene: &'a Scene,
    /// Its free space.
    pub space: &'a BurrSpace<'a>,
    /// What access depends on.
    pub spec: &'a ReachSpec<'a, 'a>,
    /// Deflection per force of each direction, mm/N, if the cost uses the deflection.
    pub compliance: Option<&'a [Matrix3<f64>]>,
}

impl Drafts<'_> {
    /// The candidate with the least force toward the structures.
    ///
    /// # Errors
    /// When the tool, the material or the cost's weights are not usable.
    pub fn least_felt(&self, candidates: &[Raster]) -> Result<Raster, PlanError> {
        let case = self.case;
        let drafts: Result<Vec<Draft>, PlanError> =
            candidates.par_iter().map(|raster| self.draft(raster)).collect();
        let drafts = drafts?;
        let least_unreached = drafts.iter().map(|d| d.unreached).fold(f64::INFINITY, f64::min);
        let is_candidate = |n: &usize| drafts[*n].unreached <= least_unreached + MORE_UNREACHED;
        // one time for all of them: that of the first that can be compared
        let first = (0..drafts.len()).find(is_candidate).map_or(&drafts[0], |n| &drafts[n]);
        let total_s = first.cuts_mm() / case.speed.nominal_mm_s + first.links_s(case);
        let forces: Result<Vec<StructureForces>, PlanError> =
            drafts.par_iter().map(|d| d.structure_forces(case, total_s - d.links_s(case))).collect();
        let forces = forces?;
        let is_pushed = forces.iter().flat_map(|f| &f.structures).any(|s| s.near.peak_n > 0.0);
        let score = |n: usize| if is_pushed { forces[n].score(case) } else { drafts[n].cost.ln() };
        let mut best: Option<(f64, usize)> = None;
        for n in (0..drafts.len()).filter(is_candidate) {
            let score = score(n);
            if best.is_none_or(|(least, _)| score < least - CLEARLY) {
                best = Some((score, n));
            }
        }
        Ok(candidates[best.map_or(0, |(_, n)| n)])
    }

    /// A draft along `raster`.
    fn draft(&self, raster: &Raster) -> Result<Draft, PlanError> {
        let Self { case, scene, space, spec, compliance } = *self;
        let radius = case.burr.radius_mm;
        let step_mm = (COARSER * spec.spacing.step_mm).min(radius);
        let path = raster.lay(case, scene, space, PathSpacing { step_mm, ..spec.spacing })?;
        let points = &path.points;
        let access = Access::draft(scene, spec.solid, path.removal.time(), spec.shank);
        let limited = limited(points.len(), |i| points[i].kind == MoveKind::Cut);
        let free = free_directions(&access, points, &limited, spec);
        drop(access);
        let near = nearest_structures::along(case, scene, &path::centers(points))?;
        let moments = mass_increments_by_voxels(
            &scene.density_g_cm3,
            &path.removal,
            points,
            Ball { radius_mm: radius },
        );
        let (terms, feeds) = (terms(case, &near)?, feeds(points));
        let tool = tools::tool(&case.burr)?;
        let (material, measure) = tools::material(&case.material)?;
        let kernel = OrientationKernel::new(&tool, &material, measure, 1024, 4);
        let swept = SweptPath::new(scene, &path.removal, points, Ball { radius_mm: radius });
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
            scale: scale(case, compliance)?,
            finer_compliance: None,
        };
        let cost = cost_rows(spec.directions, &free, &field, None);
        let length_mm = lengths(points);
        // what no axis reaches is left out of the sequence, and counted as dear
        let reached: Vec<usize> = (0..points.len()).filter(|i| free.count(*i) > 0).collect();
        let unreached_mm: f64 = (0..points.len()).filter(|i| free.count(*i) == 0).map(|i| length_mm[i]).sum();
        let count = spec.directions.len();
        let rows: Vec<f32> =
            reached.iter().flat_map(|i| &cost[i * count..(i + 1) * count]).copied().collect();
        let kept: Vec<f64> = reached.iter().map(|i| length_mm[*i]).collect();
        let problem = Problem {
            directions: spec.directions,
            cost: &rows,
            free: &FreeSets::fill(reached.len(), count, |i, n| free.contains(reached[i], n)),
            length_mm: &kept,
            rate: spec.rate,
            forbidden: &Forbidden::default(),
        };
        let whole_mm: f64 = length_mm.iter().sum();
        let unreached = unreached_mm / whole_mm.max(step_mm);
        let (cost, unreached, directions) = if case.orientation.mode == OrientationMode::Fixed {
            let straightest = |i: &usize| spec.directions.straightest(|n| free.contains(*i, n)) as u16;
            let directions: Vec<u16> = reached.iter().map(straightest).collect();
            let each = directions
                .iter()
                .enumerate()
                .map(|(n, d)| kept[n] * f64::from(rows[n * count + usize::from(*d)]));
            (each.sum::<f64>() + unreached_mm, unreached, directions)
        } else {
            match best_sequence(&problem) {
                BestSequence::Sequence { total, directions, .. } => {
                    (total + unreached_mm, unreached, directions)
                }
                // no sequence gets through without dropping waypoints: as dear as it can be, in proportion
                BestSequence::Blocked(i) => {
                    (whole_mm * (2.0 - i as f64 / points.len() as f64), 1.0, Vec::new())
                }
            }
        };
        let force = |samples: &mut EngagedSamples, (i, direction): (&usize, &u16)| {
            let feed = feeds[*i].filter(|_| moments[*i].mass_mg() > 0.0)?;
            let axis = &spec.directions.axes()[usize::from(*direction)];
            let (speed, rpm) = (case.speed.nominal_mm_s, case.burr.spindle_rpm);
            let mut bone = swept.bone_at(*i as u32, radius, |density| material.weight(density));
            kernel.gather(samples, &Feed::new(&feed, speed, rpm), &mut bone);
            Some(kernel.force_for_axis(samples, axis, rpm))
        };
        let mut samples = EngagedSamples::default();
        let (mut forces, mut costs) = (vec![None; points.len()], vec![0.0; points.len()]);
        for (n, (i, direction)) in reached.iter().zip(&directions).enumerate() {
            forces[*i] = force(&mut samples, (i, direction));
            costs[*i] = f64::from(rows[n * count + usize::from(*direction)]);
        }
        Ok(Draft { cost, unreached, length_mm, near, moments, forces, costs })
    }
}

impl Draft {
    fn kinds(&self) -> Vec<MoveKind> {
        self.forces.iter().map(|f| if f.is_some() { MoveKind::Cut } else { MoveKind::Link }).collect()
    }

    fn cuts_mm(&self) -> f64 {
        self.forces.iter().zip(&self.length_mm).filter(|(f, _)| f.is_some()).map(|(_, mm)| mm).sum()
    }

    fn links_s(&self, case: &Case) -> f64 {
        (self.length_mm.iter().sum::<f64>() - self.cuts_mm()) / case.speed.link_mm_s
    }

    /// At the speeds of the case's mode, the cuts in `cutting_s` or as near to it as they can.
    fn structure_forces(&self, case: &Case, cutting_s: f64) -> Result<StructureForces, PlanError> {
        let forces = |speed: &dyn Fn(usize) -> f64| {
            StructureForces::of(case, &self.length_mm, &self.forces, &self.near, speed)
        };
        if self.forces.iter().all(Option::is_none) {
            return Ok(forces(&|_| case.speed.nominal_mm_s));
        }
        let count = self.forces.len();
        let mass_mg: Vec<f64> = self.moments.iter().map(Moments::mass_mg).collect();
        let pushes = levels::pushes(case, &self.near, &self.forces, None)?;
        let step_mm = (COARSER * case.path.step_mm).min(case.burr.radius_mm);
        let input = SpeedInput {
            kinds: &self.kinds(),
            length_mm: &self.length_mm,
            mass_mg: &mass_mg,
            cost: &self.costs,
            dense: &DensePath::default(),
            force_cap_mm_s: &vec![f64::INFINITY; count],
            pushes: &pushes,
            step_mm,
            slot_mass_mg: tools::slot_mass_mg(case, step_mm),
            spec: &case.speed,
            smoothing: speeds::smoothing(case),
        };
        let caps = speeds::caps_near(&input, cutting_s)?;
        Ok(forces(&|i| caps[i]))
    }
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
pub fn toward_structure(case: &Case, scene: &Scene) -> Result<Option<[f64; 2]>, PlanError> {
    let (clearances_mm, radius_mm) = (case.clearances_mm(), case.burr.radius_mm);
    let near = nearest_structures::nearest_structure(scene, &clearances_mm, radius_mm, scene.target_center)?;
    let toward: Option<Vector3<f64>> = near.map(|n| n.proximity.toward.into_inner());
    Ok(toward.map(|u| [u.x, u.y]))
}
