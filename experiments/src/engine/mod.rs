//! Convergence and speed of the voxel-removal engine.

pub mod convergence;
pub mod speed;

use bonemill_geometry::{Grid, Point, Volume, Work};
use bonemill_planner::burr::{Discretisation, ElementGrid, Material, Measure, ModelError, Tool};
use bonemill_planner::simulate::{EngineSpec, FlutedBurr, Move, Pose};
use nalgebra::Vector3;

use crate::ExperimentError;

/// Burr radius of every experiment, mm.
const RADIUS_MM: f64 = 2.5;
/// Feed, mm/s.
const FEED_MM_S: f64 = 1.5;

/// The burr of docs/force-model.md 6: r 2.5 mm, 8 blades, K = (100, 60, 20) N/mm² at 0.8 g/cm³, 20 000 rpm.
fn spec(n_kappa: usize, n_around: usize, cells_per_radius: f64) -> Result<EngineSpec, ModelError> {
    Ok(EngineSpec {
        tool: Tool::new(RADIUS_MM, 8, -1)?,
        material: Material::new([100.0, 60.0, 20.0], 0.8)?,
        disc: Discretisation::new(n_around / 8, n_kappa, ElementGrid::Kappa, Measure::Db)?,
        spindle_rpm: 20_000.0,
        shank: Vec::new(),
        cells_per_radius,
    })
}

fn model(spec: &EngineSpec) -> FlutedBurr {
    FlutedBurr { tool: spec.tool.clone(), material: spec.material.clone() }
}

/// A block from `low_mm` of `dims` voxels with one density per voxel centre.
fn block<T>(
    dims: [usize; 3],
    spacing_mm: f64,
    low_mm: Vector3<f64>,
    density: impl Fn(Vector3<f64>) -> T,
) -> Result<Volume<T, Work>, ExperimentError> {
    let grid = Grid::aligned(dims, spacing_mm, Point::from_coords(low_mm.add_scalar(0.5 * spacing_mm)))?;
    let data = (0..grid.len()).map(|n| density(grid.center(grid.voxel(n)).coords)).collect();
    Ok(Volume::new(grid, data)?)
}

fn pose(p: Vector3<f64>) -> Result<Pose, ExperimentError> {
    Ok(Pose::new(Point::from_coords(p), Vector3::z())?)
}

/// Steps through positions at the common feed.
fn moves(start: Pose, places: &[Vector3<f64>]) -> Result<Vec<Move>, ExperimentError> {
    let mut from = start;
    places
        .iter()
        .map(|&p| {
            let to = pose(p)?;
            let seconds = from.center.distance_mm(&to.center) / FEED_MM_S;
            from = to;
            Ok(Move::straight(to, seconds))
        })
        .collect()
}

/// `count` positions that end at `to`.
fn line(from: Vector3<f64>, to: Vector3<f64>, count: usize) -> Vec<Vector3<f64>> {
    (1..=count).map(|n| from + (to - from) * (n as f64 / count as f64)).collect()
}
