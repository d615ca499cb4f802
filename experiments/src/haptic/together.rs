//! The haptic loop at 1 kHz and the surface of what changed, together for a minute, as at a workstation: how many steps end too late, and how
//! many frames a second the surface gets.
//!
//! One thread steps our engine at every millisecond; after each 33 of them it hands the changed bricks to a second thread,
//! which meshes them. A step is late where it has not ended when the next begins. The drill begins a hole beside the last one when it is
//! through; the reamer goes straight on.

use std::sync::mpsc;
use std::time::{Duration, Instant};

use bonemill_geometry::{Grid, Point, Volume, Work};
use bonemill_planner::Progress;
use bonemill_planner::simulate::{BrickSamples, PlungeEngine, PlungeSpec};
use nalgebra::Rotation3;

use super::{Job, jobs, voxmap, weight};
use crate::engine::speed::quantile;
use crate::{ExperimentError, Size, Table};

/// Steps of a run: a minute.
const STEPS: usize = 60_000;
const PERIOD: Duration = Duration::from_millis(1);
/// Steps between two frames.
const STEPS_PER_FRAME: usize = 33;
/// Voxels along the bone.
const SIDE: usize = 256;
/// Elements along an edge, and angles.
const ELEMENTS: usize = 16;
const TURNS: usize = 8;
/// Waiting ends this long before a step by sleeping, then by turning.
const AWAKE: Duration = Duration::from_micros(200);

/// Measures the table. The bodies are fixed, so `_size` is not used.
///
/// # Errors
/// [`ExperimentError`] when a cutter or engine refuses its input.
pub fn run(_size: Size, progress: &dyn Progress) -> Result<Vec<Table>, ExperimentError> {
    let title = format!(
        "The haptic loop at 1 kHz and the surface of what changed, together for {} s; voxmap {SIDE}³",
        STEPS / 1000
    );
    let columns = [
        "cutter",
        "steps",
        "late steps",
        "median step [µs]",
        "p99.9 [µs]",
        "longest [µs]",
        "latest end after its tick [ms]",
        "frames per second",
        "longest mesh [ms]",
        "triangles a frame",
        "load (1 min)",
    ];
    let mut table = Table::new("haptic-loop", title, &columns);
    for job in jobs().map_err(ExperimentError::Cutter)? {
        progress.stage(job.name);
        table.push(measure(&job)?);
    }
    Ok(vec![table])
}

/// What the second thread did.
#[derive(Default)]
struct Shown {
    frames: usize,
    longest_ms: f64,
    triangles: usize,
}

fn measure(job: &Job) -> Result<Vec<String>, ExperimentError> {
    let h = job.bone_mm / SIDE as f64;
    let grid = Grid::aligned([SIDE; 3], h, Point::from_coords(job.corner_mm().add_scalar(0.5 * h)))?;
    let bone = Volume::filled(grid, voxmap::BONE);
    let loads = job.loads(ELEMENTS)?;
    let spec = PlungeSpec {
        solid: job.cutter.solid(),
        loads: &loads,
        turns: TURNS,
        ahead_mm: 0.5 * job.feed_mm_rev / job.lips,
        tool_from_work: Rotation3::identity(),
    };
    let tip = |n: usize| {
        let depth = n as f64 * job.step_mm();
        let deepest = 0.9 * job.bone_mm;
        let hole = (depth / deepest).floor();
        let aside = 2.2 * job.cutter.solid().max_radius_mm();
        Point::<Work>::new(aside * hole, 0.0, -(depth - hole * deepest))
    };
    let mut engine = PlungeEngine::new(&bone, &spec, tip(0))?;
    let (sender, receiver) = mpsc::channel();
    let mut spent_us = Vec::with_capacity(STEPS);
    let (mut late, mut latest_ms, mut kept) = (0usize, 0f64, 0.0);
    let shown = std::thread::scope(|scope| {
        let viewer = scope.spawn(|| show(receiver, &bone));
        let start = Instant::now();
        for n in 0..STEPS {
            let tick = PERIOD * n as u32;
            wait_until(start, tick);
            let begun = start.elapsed();
            kept += engine.step(tip(n + 1), weight).thrust_n();
            if n % STEPS_PER_FRAME == 0 && sender.send(engine.take_touched()).is_err() {
                break;
            }
            let ended = start.elapsed();
            spent_us.push((ended - begun).as_secs_f64() * 1e6);
            let after = ended.saturating_sub(tick);
            late += usize::from(after > PERIOD);
            latest_ms = latest_ms.max(after.as_secs_f64() * 1e3);
        }
        drop(sender);
        viewer.join().unwrap_or_default()
    });
    std::hint::black_box(kept);
    let longest = spent_us.iter().copied().fold(0.0, f64::max);
    let load = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    Ok(vec![
        job.name.into(),
        spent_us.len().to_string(),
        late.to_string(),
        format!("{:.1}", quantile(&mut spent_us, 0.5)),
        format!("{:.1}", quantile(&mut spent_us, 0.999)),
        format!("{longest:.0}"),
        format!("{latest_ms:.2}"),
        format!("{:.1}", shown.frames as f64 / (STEPS as f64 * PERIOD.as_secs_f64())),
        format!("{:.1}", shown.longest_ms),
        (shown.triangles / shown.frames.max(1)).to_string(),
        load.split(' ').next().unwrap_or("-").into(),
    ])
}

fn wait_until(start: Instant, tick: Duration) {
    let left = tick.saturating_sub(start.elapsed());
    std::thread::sleep(left.saturating_sub(AWAKE));
    while start.elapsed() < tick {
        std::hint::spin_loop();
    }
}

/// Meshes what comes until nothing comes any more; a frame that waits behind a newer one is meshed all the same.
fn show(frames: mpsc::Receiver<Vec<BrickSamples>>, bone: &Volume<u8, Work>) -> Shown {
    let mut shown = Shown::default();
    loop {
        let bricks = match frames.try_recv() {
            Ok(bricks) => bricks,
            // a thread that the haptic one wakes is put on its core, and takes it for milliseconds
            Err(mpsc::TryRecvError::Empty) => {
                std::thread::sleep(PERIOD);
                continue;
            }
            Err(mpsc::TryRecvError::Disconnected) => return shown,
        };
        let start = Instant::now();
        let level = 0.5 * f64::from(voxmap::BONE);
        let meshes = bricks.iter().map(|samples| samples.mesh(bone, level));
        shown.triangles += meshes.map(|part| part.mesh.triangles.len()).sum::<usize>();
        shown.longest_ms = shown.longest_ms.max(start.elapsed().as_secs_f64() * 1e3);
        shown.frames += 1;
    }
}
