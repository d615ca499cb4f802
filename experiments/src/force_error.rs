//! Speed against error of the burr's force: every discretisation, on random porous bone with earlier passes cut out of it.
//!
//! The reference is the sum over 512 × 1024 patches. Errors are relative to its |F|; scenes with less than a thirtieth of a
//! full slot's force are left out, because relative errors of a force near 0 have no meaning.

use std::time::Instant;

use bonemill_geometry::{Grid, Point, Volume, Work};
use bonemill_planner::Progress;
use bonemill_planner::burr::{
    AtPoints, Discretisation, ElementGrid, EngagedSamples, Feed, ForceKernel, Material, Measure,
    OrientationKernel, OverPatches, Patch, Tool,
};
use bonemill_planner::engagement::share_beyond;
use nalgebra::{Unit, Vector3};
use rayon::prelude::*;

use crate::{ExperimentError, Size, Table};

const RPM: f64 = 60_000.0;
const SPEED_MM_S: f64 = 1.5;
const RADIUS_MM: f64 = 2.5;
const FOAM_G_CM3: f64 = 0.8;
const VOXEL_MM: f64 = 0.25;
/// Scenes with a smaller force are left out, N.
const LEAST_N: f64 = 0.1;
/// Number of scenes per seed of [`Size`].
const SCENES_PER_SEED: u64 = 6;

/// A method to sum the force.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// Nodes from tip to shaft × around; each node is in bone or not.
    Points(usize, usize),
    /// The same nodes; a patch that an edge crosses counts by its share.
    Patches(usize, usize),
    /// The orientation kernel's lattice: number of directions, and how many are merged.
    Lattice(usize, usize),
}

/// A tool, a material and a measure.
#[derive(Debug, Clone)]
pub struct Model {
    /// The burr.
    pub tool: Tool,
    /// Coefficients of the bone.
    pub material: Material,
    /// The edge length of the force sum.
    pub measure: Measure,
}

/// Errors of one method, relative to |F|, sorted.
#[derive(Debug, Clone, PartialEq)]
pub struct Errors(pub Vec<f64>);

impl Errors {
    /// The quantile `q` in 0..=1.
    pub fn quantile(&self, q: f64) -> f64 {
        let last = self.0.len().saturating_sub(1) as f64;
        self.0.get((last * q).round() as usize).copied().unwrap_or(f64::NAN)
    }
}

/// Bone, an earlier straight pass with a sharp edge, and a burr that moves.
#[derive(Debug, Clone)]
pub struct Scene {
    bone: Volume<f64, Work>,
    pass: [f64; 2],
    feed: Unit<Vector3<f64>>,
    axis: Unit<Vector3<f64>>,
}

impl Scene {
    /// Foam under a surface, with air cells and noise; tilts up to 70° from +z; most feeds along x, like the pass.
    pub fn random(seed: u64) -> Result<Self, ExperimentError> {
        let mut s = Sequence(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ 20_161_201);
        let grid = Grid::aligned([26, 26, 26], VOXEL_MM, Point::new(-3.2, -3.1, -3.15))?;
        let surface = s.between(-1.5, 2.5);
        let cells: Vec<_> =
            (0..6).map(|_| (Vector3::from_fn(|_, _| s.between(-3.0, 3.0)), s.between(0.8, 2.2))).collect();
        let density = (0..grid.len()).map(|n| {
            let p = grid.center(grid.voxel(n)).coords;
            let d = cells.iter().map(|(c, r)| (p - c).norm() - r).fold(surface - p.z, f64::min);
            FOAM_G_CM3 * (0.5 + d / VOXEL_MM).clamp(0.0, 1.0) * s.between(0.9, 1.1)
        });
        let density = density.collect();
        let bone = Volume::new(grid, density)?;
        let pass = [s.between(1.2, 3.0), s.between(-0.5, 1.5)];
        let feed = if s.next() < 0.7 { Vector3::x_axis() } else { s.direction() };
        let mut axis = s.direction();
        while axis.z < 0.34 {
            axis = s.direction();
        }
        Ok(Self { bone, pass, feed, axis })
    }

    fn density(&self, offset: &Vector3<f64>) -> f64 {
        self.bone.trilinear(Point::from_coords(*offset), 0.0) / FOAM_G_CM3
    }

    /// Vector from the earlier pass' axis, which lies along x.
    fn away_from_pass(&self, offset: &Vector3<f64>) -> Vector3<f64> {
        Vector3::new(0.0, offset.y - self.pass[0], offset.z - self.pass[1])
    }

    fn weight(&self, n: &Vector3<f64>) -> f64 {
        let offset = n * RADIUS_MM;
        if self.away_from_pass(&offset).norm() < RADIUS_MM { 0.0 } else { self.density(&offset) }
    }

    fn mean_weight(&self, n: &Vector3<f64>, patch: &Patch) -> f64 {
        let offset = n * RADIUS_MM;
        let away = self.away_from_pass(&offset);
        let share = share_beyond(away.norm() - RADIUS_MM, patch.sides_mm(&away.normalize()));
        if share > 0.0 { share * self.density(&offset) } else { 0.0 }
    }
}

/// A prepared method that computes the force in a scene.
pub struct Summed {
    kernel: Kernel,
}

enum Kernel {
    Points(ForceKernel),
    Patches(ForceKernel),
    Lattice(OrientationKernel),
}

impl Summed {
    /// Prepares the tables of a method.
    pub fn new(method: Method, model: &Model) -> Result<Self, ExperimentError> {
        let nodes = |n_kappa: usize, n_around: usize| {
            let n_gamma = n_around.div_ceil(model.tool.blades() as usize);
            let disc = Discretisation::new(n_gamma, n_kappa, ElementGrid::Kappa, model.measure)?;
            Ok::<_, ExperimentError>(ForceKernel::new(&model.tool, &model.material, &disc))
        };
        let kernel = match method {
            Method::Points(k, a) => Kernel::Points(nodes(k, a)?),
            Method::Patches(k, a) => Kernel::Patches(nodes(k, a)?),
            Method::Lattice(samples, merged) => Kernel::Lattice(OrientationKernel::new(
                &model.tool,
                &model.material,
                model.measure,
                samples,
                merged,
            )),
        };
        Ok(Self { kernel })
    }

    /// The force in a scene, N.
    pub fn force_n(&self, scene: &Scene, buffer: &mut EngagedSamples) -> Vector3<f64> {
        let (axis, feed) = (&scene.axis, &scene.feed);
        let force = match &self.kernel {
            Kernel::Points(k) => k.engaged_force(
                axis,
                &Feed::new(feed, SPEED_MM_S, RPM),
                &mut AtPoints(|n: &Vector3<f64>| scene.weight(n)),
            ),
            Kernel::Patches(k) => k.engaged_force(
                axis,
                &Feed::new(feed, SPEED_MM_S, RPM),
                &mut OverPatches(|n: &Vector3<f64>, patch: &Patch| scene.mean_weight(n, patch)),
            ),
            Kernel::Lattice(k) => {
                k.gather(
                    buffer,
                    &Feed::new(feed, SPEED_MM_S, RPM),
                    &mut OverPatches(|n: &Vector3<f64>, patch: &Patch| scene.mean_weight(n, patch)),
                );
                k.force_for_axis(buffer, axis, RPM)
            }
        };
        force.force_n(SPEED_MM_S)
    }
}

/// Scenes and the reference force in each, N; those with almost no force are left out.
///
/// # Errors
/// Those of the constructors that it calls; none for the models of this module.
pub fn scenes(count: u64, model: &Model) -> Result<Vec<(Scene, Vector3<f64>)>, ExperimentError> {
    let truth = Summed::new(Method::Patches(512, 1024), model)?;
    let all: Vec<_> = (1..=count).map(Scene::random).collect::<Result<_, _>>()?;
    let with_truth = all.into_par_iter().map(|scene| {
        let force = truth.force_n(&scene, &mut EngagedSamples::default());
        (scene, force)
    });
    let with_truth: Vec<_> = with_truth.collect();
    Ok(with_truth.into_iter().filter(|(_, force)| force.norm() > LEAST_N).collect())
}

/// A method's errors over scenes.
///
/// # Errors
/// As [`Summed::new`].
pub fn errors(
    method: Method,
    model: &Model,
    scenes: &[(Scene, Vector3<f64>)],
) -> Result<Errors, ExperimentError> {
    let summed = Summed::new(method, model)?;
    let mut errors: Vec<f64> = scenes
        .par_iter()
        .map_init(EngagedSamples::default, |buffer, (scene, truth)| {
            (summed.force_n(scene, buffer) - truth).norm() / truth.norm()
        })
        .collect();
    errors.sort_by(f64::total_cmp);
    Ok(Errors(errors))
}

/// The default foam and burr: measure db, with a neck.
///
/// # Errors
/// None for these values.
pub fn default_model() -> Result<Model, ExperimentError> {
    let tool = Tool::new(RADIUS_MM, 8, -1)?.with_neck(1.1)?;
    let material = Material::new([1400.0, 840.0, 140.0], FOAM_G_CM3)?;
    Ok(Model { tool, material, measure: Measure::Db })
}

/// Median time of a force on one thread, µs.
fn median_us(
    method: Method,
    model: &Model,
    scenes: &[(Scene, Vector3<f64>)],
) -> Result<f64, ExperimentError> {
    let summed = Summed::new(method, model)?;
    let mut buffer = EngagedSamples::default();
    let mut sum = Vector3::zeros();
    let mut times: Vec<f64> = scenes
        .iter()
        .map(|(scene, _)| {
            let start = Instant::now();
            sum += summed.force_n(scene, &mut buffer);
            start.elapsed().as_secs_f64() * 1e6
        })
        .collect();
    std::hint::black_box(sum);
    times.sort_by(f64::total_cmp);
    Ok(times.get(times.len() / 2).copied().unwrap_or(0.0))
}

/// Experiment `force-error`.
///
/// # Errors
/// None for the models of this module.
pub fn run(size: Size, progress: &dyn Progress) -> Result<Vec<Table>, ExperimentError> {
    let model = default_model()?;
    progress.stage("converged forces");
    let scenes = scenes(size.seeds * SCENES_PER_SEED, &model)?;
    let title = format!(
        "Force of a 2.5 mm burr (db, neck) in {} scenes of porous foam at 0.25 mm with an earlier pass: |F - F_converged| / |F|, \
         and the median time of one force on one thread. Converged: 512 x 1024 patches.",
        scenes.len()
    );
    let columns = ["method", "nodes", "q50", "q75", "q99", "max", "time [us]"];
    let mut table = Table::new("force-error", title, &columns);
    let sizes = [(16, 32), (32, 64), (48, 96), (64, 128), (96, 192), (128, 256)];
    let methods = (sizes.iter().map(|(k, a)| Method::Points(*k, *a)))
        .chain(sizes.iter().map(|(k, a)| Method::Patches(*k, *a)))
        .chain([(1024, 1), (2048, 4), (4096, 1), (4096, 8), (8192, 16)].map(|(n, m)| Method::Lattice(n, m)));
    for method in methods {
        progress.stage("errors and times");
        let errors = errors(method, &model, &scenes)?;
        let (name, nodes) = match method {
            Method::Points(k, a) => ("points", format!("{k} x {a}")),
            Method::Patches(k, a) => ("patches", format!("{k} x {a}")),
            Method::Lattice(n, m) => ("lattice, per axis after gathering", format!("{n} by {m}")),
        };
        let mut row = vec![name.to_owned(), nodes];
        row.extend([0.5, 0.75, 0.99, 1.0].map(|q| format!("{:.1e}", errors.quantile(q))));
        row.push(format!("{:.0}", median_us(method, &model, &scenes)?));
        table.push(row);
    }
    Ok(vec![table])
}

/// Numbers in [0, 1): a fixed sequence.
struct Sequence(u64);

impl Sequence {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.next()
    }

    fn direction(&mut self) -> Unit<Vector3<f64>> {
        loop {
            let v = Vector3::from_fn(|_, _| self.between(-1.0, 1.0));
            if (0.1..1.0).contains(&v.norm()) {
                return Unit::new_normalize(v);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn within(method: Method, model: &Model, limits: [f64; 4]) {
        let scenes = scenes(40, model).unwrap();
        assert!(scenes.len() > 30);
        let errors = errors(method, model, &scenes).unwrap();
        let found = [0.5, 0.75, 0.99, 1.0].map(|q| errors.quantile(q));
        eprintln!("{method:?} {:?}: q50 q75 q99 max {found:?}", model.measure);
        assert!(found.iter().zip(limits).all(|(f, limit)| *f <= limit), "{found:?} above {limits:?}");
    }

    #[test]
    fn the_planned_force_is_within_a_thousandth_in_three_quarters_of_the_scenes() {
        let model = default_model().unwrap();
        within(Method::Patches(64, 128), &model, [5e-4, 1e-3, 3e-3, 4e-3]);
        let dz = Model { measure: Measure::Dz, ..model };
        within(Method::Patches(64, 128), &dz, [5e-4, 1e-3, 3e-3, 4e-3]);
    }

    #[test]
    fn an_edge_term_with_a_helix_is_as_good() {
        let Model { tool, material, measure } = default_model().unwrap();
        let tool = tool.with_helix(0.5).unwrap();
        let material = material.with_edge([0.04, 0.06, 0.01], 2e-5).unwrap();
        within(Method::Patches(64, 128), &Model { tool, material, measure }, [5e-4, 1e-3, 3e-3, 4e-3]);
    }

    #[test]
    fn patches_are_several_times_better_than_points() {
        let model = default_model().unwrap();
        let scenes = scenes(40, &model).unwrap();
        let median = |method| errors(method, &model, &scenes).unwrap().quantile(0.5);
        assert!(4.0 * median(Method::Patches(64, 128)) < median(Method::Points(64, 128)));
    }
}
