//! Time and error of a haptic step over resolutions of voxmap and point shell: the published engines and ours (Tables I and II of
//! Faieghi et al.), drilling and reaming.
//!
//! The bone is a block of one density with a flat face: then the force while the tool enters is known, element by element, and so is
//! each engine's error. Times are those of steps of 1 ms at the feed, deep in the bone; errors are root mean squares over the entry, in
//! parts of the force with every edge in bone. Voxmaps that do not fit into free memory are left out, and the table says so.

mod morton;
mod published;
mod shell;
#[cfg(test)]
mod tests;
pub mod together;
mod voxmap;

use std::time::Instant;

use bonemill_geometry::{Grid, Point, Volume, Work};
use bonemill_planner::Progress;
use bonemill_planner::cutter::{
    Cutter, CutterError, GlenoidReamer, GlenoidReamerSpec, TwistDrill, TwistDrillSpec,
};
use bonemill_planner::edge::{CoefficientModel, EdgeLoads};
use bonemill_planner::simulate::{PlungeEngine, PlungeSpec};
use nalgebra::{Rotation3, Vector3};

pub use self::published::Overflow;
use self::published::{DrillPlace, EdgeForce, Published};
use self::shell::PointShell;
use self::voxmap::Voxmap;
use crate::engine::speed::{free_bytes, quantile};
use crate::pareto::picture::{self, Panel};
use crate::{ExperimentError, Size, Table};

/// Voxels along the bone.
const VOXMAPS: [usize; 4] = [128, 256, 512, 1024];
/// Voxels along the longest side of the tool.
const SHELLS: [u32; 5] = [128, 256, 512, 1024, 2048];
/// Table I of the source: mean step of its engine on an RTX 2080, ms; rows are shells.
const TABLE_I_MS: [[f64; 4]; 5] = [
    [0.23, 0.22, 0.22, 0.15],
    [0.22, 0.23, 0.22, 0.15],
    [0.21, 0.20, 0.19, 0.16],
    [0.20, 0.18, 0.20, 0.21],
    [0.40, 0.40, 0.43, 0.47],
];
/// Table II: the same of Zheng et al.'s.
const TABLE_II_MS: [[f64; 4]; 5] = [
    [0.27, 0.29, 0.35, 1.98],
    [0.28, 0.30, 0.71, 3.90],
    [0.41, 0.35, 0.76, 3.97],
    [0.41, 0.46, 0.95, 4.16],
    [1.18, 1.28, 1.80, 5.02],
];
/// Steps per figure of the published engines, and of ours.
const STEPS: usize = 30;
const OWN_STEPS: usize = 5000;
/// Tip positions along an entry at which errors are taken.
const ENTRY: usize = 40;
/// k_c, N/mm², and k_f: those of the reference cases.
const K: [f64; 2] = [150.0, 0.4];
/// Memory left to others, bytes.
const SPARE_BYTES: f64 = 1e9;

/// A tool at work.
struct Job {
    name: &'static str,
    cutter: Box<dyn Cutter>,
    feed_mm_rev: f64,
    spindle_rpm: f64,
    /// Side of the block, mm.
    bone_mm: f64,
    /// Height of its edges, mm.
    lip_mm: f64,
    lips: f64,
}

fn jobs() -> Result<Vec<Job>, CutterError> {
    let drill = TwistDrill::new(TwistDrillSpec::FAIEGHI)?;
    let reamer = GlenoidReamer::new(GlenoidReamerSpec::FAIEGHI)?;
    let (drill_mm, reamer_mm) = (drill.lip_height_mm(), reamer.lip_height_mm());
    Ok(vec![
        Job {
            name: "drilling",
            cutter: Box::new(drill),
            feed_mm_rev: 0.02,
            spindle_rpm: 3000.0,
            bone_mm: 20.0,
            lip_mm: drill_mm,
            lips: 2.0,
        },
        Job {
            name: "reaming",
            cutter: Box::new(reamer),
            feed_mm_rev: 0.3,
            spindle_rpm: 100.0,
            bone_mm: 50.0,
            lip_mm: reamer_mm,
            lips: 5.0,
        },
    ])
}

impl Job {
    /// How far the tool goes down in 1 ms, mm.
    fn step_mm(&self) -> f64 {
        self.feed_mm_rev * self.spindle_rpm / 60_000.0
    }

    /// Tip `depth_mm` below the block's upper face, after `n` steps.
    fn place(&self, depth_mm: f64, n: usize) -> DrillPlace {
        let turn_rad = n as f64 * self.spindle_rpm / 60_000.0 * std::f64::consts::TAU;
        DrillPlace { tip_mm: Vector3::new(0.0, 0.0, -depth_mm), turn_rad }
    }

    /// The block's corner: its upper face is z = 0, the tool's axis is off the voxels' faces.
    fn corner_mm(&self) -> Vector3<f64> {
        Vector3::new(-0.5 * self.bone_mm + 0.0137, -0.5 * self.bone_mm + 0.0071, -self.bone_mm)
    }

    fn loads(&self, elements: usize) -> Result<EdgeLoads, ExperimentError> {
        let edges = self.cutter.edges(self.feed_mm_rev, elements).map_err(ExperimentError::Cutter)?;
        let model = CoefficientModel::constant(K[0], K[1])?;
        Ok(EdgeLoads::new(&edges, self.feed_mm_rev, self.spindle_rpm, &model))
    }

    /// Where tool positions of an entry are, mm below the face.
    fn entry(&self) -> impl Iterator<Item = f64> {
        let most = 1.3 * self.lip_mm;
        (1..=ENTRY).map(move |n| most * n as f64 / ENTRY as f64)
    }
}

/// Thrust and torque at each depth of an entry, exact, and with every edge in bone.
fn exact(job: &Job) -> Result<(Vec<[f64; 2]>, [f64; 2]), ExperimentError> {
    let loads = job.loads(20_000)?;
    let at = |depth: f64| {
        let [thrust, moment, _] = loads.axial(|_, load| f64::from(u8::from(load.position_mm.z() < depth)));
        [thrust, -moment]
    };
    Ok((job.entry().map(at).collect(), at(f64::INFINITY)))
}

/// Root mean square of the differences, in parts of the whole force: the larger of thrust and torque.
fn error(found: &[[f64; 2]], expected: &[[f64; 2]], whole: [f64; 2]) -> f64 {
    let rms = |part: usize| {
        let squares = found.iter().zip(expected).map(|(a, b)| ((a[part] - b[part]) / whole[part]).powi(2));
        (squares.sum::<f64>() / expected.len() as f64).sqrt()
    };
    rms(0).max(rms(1))
}

/// Measures the tables. The bodies are fixed, so `_size` is not used.
///
/// # Errors
/// [`ExperimentError`] when a cutter or engine refuses its input.
pub fn run(_size: Size, progress: &dyn Progress) -> Result<Vec<Table>, ExperimentError> {
    let mut tables = Vec::new();
    for job in jobs().map_err(ExperimentError::Cutter)? {
        tables.extend(measure(&job, progress)?);
    }
    Ok(tables)
}

fn measure(job: &Job, progress: &dyn Progress) -> Result<Vec<Table>, ExperimentError> {
    let threads = rayon::current_num_threads();
    let title = format!(
        "A haptic step, {}: mean (standard deviation) of {STEPS} steps in bone on {threads} threads, and the rms error over an entry in parts of the whole force",
        job.name
    );
    let columns = [
        "shell",
        "points",
        "voxmap",
        "published [ms]",
        "Zheng's [ms]",
        "published's error",
        "source, GPU [ms]",
        "Zheng's, GPU [ms]",
    ];
    let mut table = Table::new(&format!("haptic-steps-{}", job.name), title, &columns);
    let (expected, whole) = exact(job)?;
    let mut curve = Vec::new();
    let shells = SHELLS.map(|resolution| PointShell::new(job.cutter.as_ref(), resolution, job.feed_mm_rev));
    for (column, side) in VOXMAPS.into_iter().enumerate() {
        for (row, shell) in shells.iter().enumerate() {
            let shell = shell.as_ref().map_err(|e| ExperimentError::Cutter(e.clone()))?;
            progress.stage(&format!("{}: shell {}³, voxmap {side}³", job.name, SHELLS[row]));
            let free = free_bytes().unwrap_or(4e9) - SPARE_BYTES;
            let made = Voxmap::new(side, job.bone_mm, job.corner_mm(), free);
            let voxmap = match made {
                Ok(voxmap) => voxmap,
                Err(e) => {
                    table.push_note(format!("{}³", SHELLS[row]), format!("not measured: {e}"));
                    continue;
                }
            };
            let force = EdgeForce { feed_mm_rev: job.feed_mm_rev, k: K };
            let engine = Published::new(shell, &voxmap, force).map_err(ExperimentError::Overflow)?;
            let found: Vec<[f64; 2]> =
                job.entry().enumerate().map(|(n, d)| engine.step(&job.place(d, n))).collect();
            let off = error(&found, &expected, whole);
            let start = 1.3 * job.lip_mm;
            voxmap.take(job.cutter.solid(), &job.place(start, 0).tip_mm);
            let own = times(STEPS, |n| engine.step(&job.place(start + n as f64 * job.step_mm(), n)));
            let (mut stored, mut hits) = (Vec::new(), Vec::new());
            let stored_times = times(STEPS, |n| {
                let depth = start + (STEPS + n) as f64 * job.step_mm();
                engine.step_stored(&job.place(depth, n), &mut stored, &mut hits)
            });
            curve.push(picture::PlotPoint { x: mean(&own), y: off, is_default: false });
            table.push(vec![
                format!("{}³", SHELLS[row]),
                shell.codes.len().to_string(),
                format!("{side}³"),
                spread(&own),
                spread(&stored_times),
                format!("{off:.4}"),
                TABLE_I_MS[row][column].to_string(),
                TABLE_II_MS[row][column].to_string(),
            ]);
        }
    }
    curve.sort_by(|a, b| a.x.total_cmp(&b.x));
    let (ours, own_curve) = ours(job, &expected, whole, progress)?;
    let series = vec![("published".to_owned(), curve), ("ours".to_owned(), own_curve)];
    let (x, y) = ("time of a step [ms]", "rms error [part of the whole force]");
    table.picture = Some(picture::svg(&[Panel { x, y, is_log_x: true, series }]));
    Ok(vec![table, ours])
}

/// Our engine: over voxmaps, and over elements along an edge.
fn ours(
    job: &Job,
    expected: &[[f64; 2]],
    whole: [f64; 2],
    progress: &dyn Progress,
) -> Result<(Table, Vec<picture::PlotPoint>), ExperimentError> {
    let title = format!("Our engine, {}: {OWN_STEPS} steps in bone, one thread; error as above", job.name);
    let columns =
        ["elements × angles", "voxmap", "median [µs]", "mean [µs]", "p99.9 [µs]", "holes [MB]", "error"];
    let mut table = Table::new(&format!("haptic-steps-{}-ours", job.name), title, &columns);
    let mut curve = Vec::new();
    for side in VOXMAPS {
        progress.stage(&format!("{}: ours, voxmap {side}³", job.name));
        let needed = (side as f64).powi(3);
        if needed > free_bytes().unwrap_or(4e9) - SPARE_BYTES {
            table.push_note("-".into(), format!("not measured: {side}³ needs {:.1} GB", needed * 1e-9));
            continue;
        }
        let h = job.bone_mm / side as f64;
        let grid = Grid::aligned([side; 3], h, Point::from_coords(job.corner_mm().add_scalar(0.5 * h)))?;
        let bone = Volume::filled(grid, voxmap::BONE);
        for (elements, turns) in [(8, 4), (16, 8), (32, 12)] {
            let loads = job.loads(elements)?;
            let spec = PlungeSpec {
                solid: job.cutter.solid(),
                loads: &loads,
                turns,
                ahead_mm: 0.5 * job.feed_mm_rev / job.lips,
                tool_from_work: Rotation3::identity(),
            };
            let tip = |depth: f64| Point::<Work>::new(0.0, 0.0, -depth);
            let felt = |force: bonemill_planner::edge::CutterForce| [force.thrust_n(), force.torque_nmm()];
            let mut engine = PlungeEngine::new(&bone, &spec, tip(-job.lip_mm))?;
            let found: Vec<[f64; 2]> = job.entry().map(|d| felt(engine.step(tip(d), weight))).collect();
            let off = error(&found, expected, whole);
            let start = 1.3 * job.lip_mm;
            let mut each =
                times(OWN_STEPS, |n| felt(engine.step(tip(start + (n + 1) as f64 * job.step_mm()), weight)));
            let mean_us = 1e3 * mean(&each);
            curve.push(picture::PlotPoint { x: mean(&each), y: off, is_default: false });
            table.push(vec![
                format!("{} × {turns}", loads.loads().len()),
                format!("{side}³"),
                format!("{:.1}", 1e3 * quantile(&mut each, 0.5)),
                format!("{mean_us:.1}"),
                format!("{:.1}", 1e3 * quantile(&mut each, 0.999)),
                format!("{:.2}", engine.holes().memory().1 as f64 * 1e-6),
                format!("{off:.4}"),
            ]);
        }
    }
    curve.sort_by(|a, b| a.x.total_cmp(&b.x));
    Ok((table, curve))
}

/// Bone is bone: what a voxel between bone and void holds of it.
fn weight(density: f64) -> f64 {
    density / f64::from(voxmap::BONE)
}

/// Times of steps, ms. Their results are kept, so that no step is left out.
fn times(steps: usize, mut step: impl FnMut(usize) -> [f64; 2]) -> Vec<f64> {
    let mut kept = 0.0;
    let each = (0..steps)
        .map(|n| {
            let start = Instant::now();
            kept += step(n)[0];
            start.elapsed().as_secs_f64() * 1e3
        })
        .collect();
    std::hint::black_box(kept);
    each
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

fn spread(values: &[f64]) -> String {
    let mean = mean(values);
    let squares: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
    format!("{mean:.2} ({:.2})", (squares / (values.len().max(2) - 1) as f64).sqrt())
}
