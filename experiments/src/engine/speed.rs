//! Duration of a step as in Faieghi's Tables I and II: tool resolution × voxmap, compared with a baseline that tests every
//! voxel of the tool's box.
//!
//! The bone is 50 mm wide, the burr of 2.5 mm radius is half in its face, cuts are straight, and one thread is used. Steps of
//! 0.1 mm are those of a simulated plan, steps of 0.01 mm those of a hand at 10 mm/s and 1 kHz. Densities are bytes, so that
//! 1024³ voxels fit into a gigabyte and 2048³ into nine; the engine's own memory is that of the cut surface. A voxmap that does
//! not fit into free memory is left out, and the table says so.

use std::time::Instant;

use bonemill_geometry::{Grid, Point, Volume, Work};
use bonemill_planner::Progress;
use bonemill_planner::simulate::{Bone, Engine, Lattice, Piece};
use nalgebra::Vector3;

use super::{RADIUS_MM, line, model, moves, pose, spec};
use crate::{ExperimentError, Size, Table, alone};

/// Side of the bone, mm.
const SIDE_MM: f64 = 50.0;
/// Numbers of voxels along it.
const VOXMAPS: [usize; 5] = [128, 256, 512, 1024, 2048];
/// Memory that a voxmap needs, bytes per voxel: its densities, and the baseline's flags that are used.
const BYTES_A_VOXEL: f64 = 1.3;
/// Assumed free memory where the system does not report it, bytes.
const UNKNOWN_BYTES: f64 = 4e9;
/// Nodes along and around the burr.
const TOOLS: [[usize; 2]; 3] = [[16, 32], [32, 64], [64, 128]];
/// Number of steps per figure.
const STEPS: usize = 400;
const BASELINE_STEPS: usize = 40;

/// Measures the tables. The bodies are fixed, so `_size` is not used.
///
/// # Errors
/// [`ExperimentError`] when the engine refuses its input.
pub fn run(_size: Size, progress: &dyn Progress) -> Result<Vec<Table>, ExperimentError> {
    let title = format!(
        "Time of a step: {SIDE_MM} mm of bone, r = {RADIUS_MM} mm in a slot of depth r, one thread, {STEPS} steps. \
         Baseline: every voxel of the ball's box at every step, and the same nodes."
    );
    let columns = [
        "voxmap",
        "nodes",
        "step [mm]",
        "median [µs]",
        "p99 [µs]",
        "mean [µs]",
        "engine's memory [MB]",
        "baseline's median [µs]",
        "ratio",
    ];
    let mut table = Table::new("engine-speed", title, &columns);
    let title = "Surfaces of the bricks that changed, one thread, a frame every 1/30 s at 10 mm/s";
    let mut meshes =
        Table::new("engine-meshes", title, &["voxmap", "bricks a frame", "median [ms]", "max [ms]"]);
    for n in VOXMAPS {
        progress.stage(&format!("voxmap {n}³"));
        let needed = (n as f64).powi(3) * BYTES_A_VOXEL;
        if free_bytes().unwrap_or(UNKNOWN_BYTES) < needed {
            let why = format!("not measured: needs {:.0} GB", needed * 1e-9);
            for table in [&mut table, &mut meshes] {
                table.push_note(format!("{n}³"), why.clone());
            }
            continue;
        }
        let h = SIDE_MM / n as f64;
        let grid = Grid::aligned([n; 3], h, Point::from_coords(Vector3::repeat(0.5 * h)))?;
        let bone = Volume::filled(grid, 1u8);
        for tool in TOOLS {
            for step_mm in [0.1, 0.01] {
                let [mut own, bytes] = time_engine(&bone, tool, step_mm)?;
                let mut plain = time_baseline(&bone, tool, step_mm);
                let mean = own.iter().sum::<f64>() / own.len() as f64;
                let [median, p99, baseline] =
                    [quantile(&mut own, 0.5), quantile(&mut own, 0.99), quantile(&mut plain, 0.5)];
                table.push(vec![
                    format!("{n}³"),
                    format!("{} × {}", tool[0], tool[1]),
                    step_mm.to_string(),
                    format!("{median:.1}"),
                    format!("{p99:.1}"),
                    format!("{mean:.1}"),
                    format!("{:.1}", bytes[0] / 1e6),
                    format!("{baseline:.0}"),
                    format!("{:.0}", baseline / median),
                ]);
            }
        }
        let (bricks, mut took_ms) = time_meshes(&bone)?;
        let [median, most] = [quantile(&mut took_ms, 0.5), quantile(&mut took_ms, 1.0)];
        meshes.push(vec![
            format!("{n}³"),
            format!("{bricks:.0}"),
            format!("{median:.2}"),
            format!("{most:.2}"),
        ]);
    }
    Ok(vec![table, meshes])
}

/// Durations of steps, µs, and the engine's memory, bytes.
fn time_engine(
    bone: &Volume<u8, Work>,
    tool: [usize; 2],
    step_mm: f64,
) -> Result<[Vec<f64>; 2], ExperimentError> {
    let (from, way) = way(step_mm, STEPS);
    let spec = spec(tool[0], tool[1], cells())?;
    let model = model(&spec);
    let start = pose(from)?;
    let mut engine = Engine::new(Bone::new(bone)?, spec, model, start)?;
    let moves = moves(start, &way)?;
    let mut took = Vec::with_capacity(moves.len());
    alone(|| {
        for to in moves {
            let since = Instant::now();
            let step = engine.step(to);
            took.push(since.elapsed().as_secs_f64() * 1e6);
            step?;
        }
        Ok::<(), ExperimentError>(())
    })?;
    Ok([took, vec![engine.lattice().stored_bricks().1 as f64]])
}

/// Bricks per frame and times, ms.
fn time_meshes(bone: &Volume<u8, Work>) -> Result<(f64, Vec<f64>), ExperimentError> {
    let mut lattice = Lattice::new(Bone::new(bone)?, RADIUS_MM, cells())?;
    let (from, way) = way(10.0 / 30.0, 60);
    let (mut took, mut bricks) = (Vec::new(), 0);
    alone(|| {
        for pair in [&[from][..], &way].concat().windows(2) {
            let [a, b] = [pair[0], pair[1]].map(Point::from_coords);
            lattice.remove(&[Piece { from: a, to: b, continues: true }], RADIUS_MM);
            let since = Instant::now();
            bricks += lattice.touched_surface(0.5).len();
            took.push(since.elapsed().as_secs_f64() * 1e3);
        }
    });
    Ok((bricks as f64 / took.len() as f64, took))
}

/// Free memory, bytes; `None` where the system does not report it.
fn free_bytes() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<f64>().ok().map(|kb| kb * 1024.0)
}

fn cells() -> f64 {
    bonemill_planner::simulate::EngineSpec::CELLS_PER_RADIUS
}

/// A straight cut in the bone's upper face.
fn way(step_mm: f64, steps: usize) -> (Vector3<f64>, Vec<Vector3<f64>>) {
    let from = Vector3::new(4.03, 24.87, SIDE_MM - 0.02);
    (from, line(from, from + Vector3::new(step_mm * steps as f64, 0.0, 0.0), steps))
}

fn quantile(values: &mut [f64], q: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get((q * (values.len() as f64 - 1.0)).round().max(0.0) as usize).copied().unwrap_or(0.0)
}

/// The simplest implementation: tests every voxel of the ball's box at every step, and every node of the burr.
struct Baseline<'a> {
    bone: &'a Volume<u8, Work>,
    removed: Vec<bool>,
    mass: f64,
}

impl Baseline<'_> {
    fn step(&mut self, from: Vector3<f64>, to: Vector3<f64>, tool: [usize; 2]) -> Vector3<f64> {
        let grid = self.bone.grid();
        let (h, dims) = (grid.spacing_mm().x, grid.dims());
        let index = |p: Vector3<f64>| grid.nearest(Point::from_coords(p)).map(|v| grid.index(v));
        let feed = (to - from).normalize();
        let mut force = Vector3::zeros();
        for k in 0..tool[0] {
            let kappa = (k as f64 + 0.5) * std::f64::consts::PI / tool[0] as f64;
            for m in 0..tool[1] {
                let psi = (m as f64 + 0.5) * 2.0 * std::f64::consts::PI / tool[1] as f64;
                let n = Vector3::new(kappa.sin() * psi.cos(), kappa.sin() * psi.sin(), -kappa.cos());
                let forward = n.dot(&feed);
                let there =
                    index(to + n * RADIUS_MM).is_some_and(|v| !self.removed[v] && self.bone.data()[v] > 0);
                if forward > 0.0 && there {
                    force -= n * forward;
                }
            }
        }
        let c = grid.continuous_index(Point::from_coords(to));
        let reach = RADIUS_MM / h;
        let range = |a: usize| {
            let first = (c[a] - reach).floor().max(0.0) as usize;
            first..((c[a] + reach).ceil().max(0.0) as usize + 1).min(dims[a])
        };
        for k in range(2) {
            for j in range(1) {
                for i in range(0) {
                    let off = [i as f64 - c[0], j as f64 - c[1], k as f64 - c[2]];
                    let voxel = i + dims[0] * (j + dims[1] * k);
                    if off.iter().map(|v| v * v).sum::<f64>() <= reach * reach && !self.removed[voxel] {
                        self.removed[voxel] = true;
                        self.mass += f64::from(self.bone.data()[voxel]);
                    }
                }
            }
        }
        force
    }
}

fn time_baseline(bone: &Volume<u8, Work>, tool: [usize; 2], step_mm: f64) -> Vec<f64> {
    let mut baseline = Baseline { bone, removed: vec![false; bone.data().len()], mass: 0.0 };
    let (from, way) = way(step_mm, BASELINE_STEPS);
    let mut sum = Vector3::zeros();
    let took = [&[from][..], &way]
        .concat()
        .windows(2)
        .map(|pair| {
            let since = Instant::now();
            sum += baseline.step(pair[0], pair[1], tool);
            since.elapsed().as_secs_f64() * 1e6
        })
        .collect();
    std::hint::black_box((sum, baseline.mass));
    took
}
