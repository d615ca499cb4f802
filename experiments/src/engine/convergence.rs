//! Compares removed volume and force with closed forms, from coarse to fine cells, in cells per radius.
//!
//! Voxels and cells have the same size here, so r/h is r/s. Volumes of tube, segment and cap, and forces, are those of
//! docs/force-model.md 6. Blocks end on voxel faces, where the interpolated density falls to 0 over one voxel. Paths start off
//! the lattice points, so that no cell is a special case.

use std::f64::consts::PI;

use bonemill_planner::Progress;
use bonemill_planner::simulate::{Bone, Engine, Step};
use nalgebra::Vector3;

use super::{FEED_MM_S, RADIUS_MM, block, line, model, moves, pose, spec};
use crate::{ExperimentError, Size, Table};

/// Cells per radius.
const LEVELS: [f64; 5] = [2.5, 5.0, 10.0, 20.0, 50.0];
/// Half the block's side, mm.
const HALF_MM: f64 = 7.5;
const R: f64 = RADIUS_MM;

/// A sweep and the volume that it must remove.
struct Sweep {
    name: &'static str,
    /// The first position, and the others.
    way: Vec<Vector3<f64>>,
    volume_mm3: f64,
}

/// Area of a disc's segment of this depth.
fn segment_mm2(depth_mm: f64) -> f64 {
    let ke = (1.0 - depth_mm / R).acos();
    R * R * (ke - 0.5 * (2.0 * ke).sin())
}

/// Positions on a circle of 4 mm radius, up to an angle.
fn arc(angle_rad: f64) -> Vec<Vector3<f64>> {
    (0..=200)
        .map(|n| {
            let t = angle_rad * n as f64 / 200.0;
            Vector3::new(4.0 * t.cos() - 2.03, 4.0 * t.sin() - 2.01, 0.07)
        })
        .collect()
}

fn sweeps() -> Vec<Sweep> {
    let ball = 4.0 / 3.0 * PI * R.powi(3);
    let tube = PI * R * R;
    let from_to = |a: Vector3<f64>, b: Vector3<f64>| [vec![a], line(a, b, 60)].concat();
    let (a, b) = (Vector3::new(-3.01, -1.3, 2.07), Vector3::new(2.6, 2.2, -1.9));
    let arc = arc(0.5 * PI);
    // a polygon is shorter than its arc, so the tube's length is the polygon's
    let arc_mm: f64 = arc.windows(2).map(|p| (p[1] - p[0]).norm()).sum();
    let through = |y: f64, z: f64| from_to(Vector3::new(-11.0, y, z), Vector3::new(11.0, y, z));
    let down = from_to(Vector3::new(0.13, -0.21, 11.0), Vector3::new(0.13, -0.21, 3.0));
    vec![
        Sweep { name: "full ball", way: vec![Vector3::new(0.13, -0.21, 0.07)], volume_mm3: ball },
        Sweep { name: "straight", way: from_to(a, b), volume_mm3: ball + tube * (b - a).norm() },
        Sweep { name: "arc", way: arc, volume_mm3: ball + tube * arc_mm },
        Sweep { name: "plunge", way: down, volume_mm3: 0.5 * ball + tube * (HALF_MM - 3.0) },
        Sweep {
            name: "slot 1.5 mm",
            way: through(0.13, HALF_MM + R - 1.5),
            volume_mm3: segment_mm2(1.5) * 2.0 * HALF_MM,
        },
        Sweep { name: "side cut", way: through(-HALF_MM, 0.07), volume_mm3: 0.5 * tube * 2.0 * HALF_MM },
    ]
}

/// A cut and the force that must act in it.
struct Cut {
    name: &'static str,
    /// The first position, and the others.
    way: Vec<Vector3<f64>>,
    /// A path that is cut before it, from its first position on.
    before: Vec<Vector3<f64>>,
    /// Expected force, turned about z so that the feed, unless it is along z, is along x.
    force_n: Option<Vector3<f64>>,
    mrr_mm3_s: f64,
}

impl Cut {
    /// A cut along x at the given y and z.
    fn along_x(name: &'static str, y: f64, z: f64, force_n: Option<Vector3<f64>>, mrr_mm3_s: f64) -> Self {
        Self { name, way: pass(y, z), before: Vec::new(), force_n, mrr_mm3_s }
    }
}

/// A pass along x through the block.
fn pass(y: f64, z: f64) -> Vec<Vector3<f64>> {
    let (from, to) = (Vector3::new(-11.0, y, z), Vector3::new(11.0, y, z));
    [vec![from], line(from, to, 220)].concat()
}

/// A force, turned about z so that the feed is along x; unchanged where the feed is along z.
fn seen_along(feed: &Vector3<f64>, force: &Vector3<f64>) -> Vector3<f64> {
    let across = feed.x.hypot(feed.y);
    if across < 1e-9 {
        return *force;
    }
    let (c, s) = (feed.x / across, feed.y / across);
    Vector3::new(c * force.x + s * force.y, c * force.y - s * force.x, force.z)
}

fn cuts() -> Vec<Cut> {
    let c = 60.0 * FEED_MM_S * R / 20_000.0;
    let [k_t, k_r, k_a] = [100.0, 60.0, 20.0];
    // σ = −1, db
    let full = Vector3::new(-PI * k_r / 8.0, 0.5 * k_t, -0.5 * k_a) * c;
    let ke = (1.0f64 - 1.5 / R).acos();
    let (s2, sin2) = (ke / 2.0 - (2.0 * ke).sin() / 4.0, ke.sin().powi(2));
    let slot = Vector3::new(
        -k_r * s2 / 4.0 - k_a * sin2 / 8.0,
        k_t * (1.0 - ke.cos()) / 4.0,
        k_r * sin2 / (2.0 * PI) - k_a * s2 / PI,
    ) * c;
    // bone at y above the centre: h = +1; I2 = 2, I3 = π/2
    let side = Vector3::new(-k_t - k_r * PI * PI / 8.0, k_t * PI / 2.0 - k_r * PI / 4.0, -k_a * PI / 2.0)
        * (c / (2.0 * PI));
    let apart = 0.5 * R;
    let overlap =
        2.0 * R * R * (apart / (2.0 * R)).acos() - 0.5 * apart * (4.0 * R * R - apart * apart).sqrt();
    let tube = PI * R * R * FEED_MM_S;
    // a plunge: n has cos κ along the feed, e_a has sin κ along the axis; tangential forces cancel
    let plunge = Vector3::z() * (c * (k_r * PI / 4.0 - 0.5 * k_a));
    let (top, bottom) = (Vector3::new(0.13, -0.21, 11.0), Vector3::new(0.13, -0.21, -5.0));
    let second = pass(apart, 0.07);
    let first =
        [pass(0.0, 0.07), line(Vector3::new(11.0, 0.0, 0.07), Vector3::new(11.0, 9.0, 0.07), 10)].concat();
    let back = [Vector3::new(-11.0, 20.0, 0.07), second[0]];
    vec![
        Cut::along_x("full slot", 0.13, 0.07, Some(full), tube),
        // the front hemisphere is in bone along the whole path, because the circle is larger than the burr
        Cut { name: "arc", way: arc(PI), before: Vec::new(), force_n: Some(full), mrr_mm3_s: tube },
        Cut {
            name: "plunge",
            way: [vec![top], line(top, bottom, 160)].concat(),
            before: Vec::new(),
            force_n: Some(plunge),
            mrr_mm3_s: tube,
        },
        Cut::along_x("slot 1.5 mm", 0.13, HALF_MM + R - 1.5, Some(slot), segment_mm2(1.5) * FEED_MM_S),
        Cut::along_x("side cut", -HALF_MM, 0.07, Some(side), 0.5 * tube),
        Cut {
            name: "second pass",
            way: second,
            before: [&first[..], &back[..]].concat(),
            force_n: None,
            mrr_mm3_s: tube - overlap * FEED_MM_S,
        },
    ]
}

/// Measures both tables. The bodies are fixed, so `_size` is not used.
///
/// # Errors
/// [`ExperimentError`] when the engine refuses its input.
pub fn run(_size: Size, progress: &dyn Progress) -> Result<Vec<Table>, ExperimentError> {
    progress.stage("volumes");
    let volumes = volumes()?;
    progress.stage("forces");
    Ok(vec![volumes, forces()?])
}

fn volumes() -> Result<Table, ExperimentError> {
    let title = format!(
        "Removed volume against the analytic sweep: r = {R} mm, cells as large as voxels, steps of about 0.1 mm. \
         Order: from the level before."
    );
    let columns = ["sweep", "r/h", "removed [mm³]", "exact [mm³]", "error [%]", "order"];
    let mut table = Table::new("engine-volume", title, &columns);
    for sweep in sweeps() {
        let mut last: Option<(f64, f64)> = None;
        for level in LEVELS {
            let bone = solid(level)?;
            let spec = spec(4, 8, level)?;
            let model = model(&spec);
            let start = pose(sweep.way[0])?;
            let mut engine = Engine::new(Bone::new(&bone)?, spec, model, start)?;
            engine.steps(&moves(start, &sweep.way[1..])?)?;
            engine.settle();
            let found = engine.removed().total_mm3();
            let error = found / sweep.volume_mm3 - 1.0;
            table.push(vec![
                sweep.name.into(),
                level.to_string(),
                format!("{found:.4}"),
                format!("{:.4}", sweep.volume_mm3),
                format!("{:+.4}", 100.0 * error),
                order(last, level, error),
            ]);
            last = Some((level, error));
        }
    }
    Ok(table)
}

fn forces() -> Result<Table, ExperimentError> {
    let title = "Force and removal rate along a cut, 64 × 128 nodes: error of the mean over its middle \
                 third; ripple: half the range of |F| over its mean there.";
    let columns = ["cut", "r/h", "force error [%]", "order", "removal rate error [%]", "force ripple [%]"];
    let mut table = Table::new("engine-force", title, &columns);
    for cut in cuts() {
        let mut last: Option<(f64, f64)> = None;
        for level in LEVELS {
            let bone = solid(level)?;
            let steps = along(&bone, level, &cut)?;
            let middle = &steps[steps.len() / 3..2 * steps.len() / 3];
            let count = middle.len() as f64;
            let mean = middle.iter().map(|(_, force)| force).sum::<Vector3<f64>>() / count;
            let sizes = || middle.iter().map(|(_, force)| force.norm());
            let ripple =
                0.5 * (sizes().fold(0.0, f64::max) - sizes().fold(f64::INFINITY, f64::min)) / mean.norm();
            let rate =
                middle.iter().map(|(step, _)| step.mrr_mm3_s).sum::<f64>() / count / cut.mrr_mm3_s - 1.0;
            let error = cut.force_n.map(|f| (mean - f).norm() / f.norm());
            let shown = error.map_or("-".into(), |e| format!("{:.3}", 100.0 * e));
            table.push(vec![
                cut.name.into(),
                level.to_string(),
                shown,
                order(last, level, error.unwrap_or(rate)),
                format!("{:+.3}", 100.0 * rate),
                format!("{:.3}", 100.0 * ripple),
            ]);
            last = Some((level, error.unwrap_or(rate)));
        }
    }
    Ok(table)
}

/// The steps of a cut, and their forces relative to the feed.
fn along(
    bone: &bonemill_geometry::Volume<f32, bonemill_geometry::Work>,
    level: f64,
    cut: &Cut,
) -> Result<Vec<(Step, Vector3<f64>)>, ExperimentError> {
    let spec = spec(64, 128, level)?;
    let model = model(&spec);
    let start = pose(*cut.before.first().unwrap_or(&cut.way[0]))?;
    let mut engine = Engine::new(Bone::new(bone)?, spec, model, start)?;
    if cut.before.len() > 1 {
        engine.steps(&moves(start, &cut.before[1..])?)?;
    }
    let from = engine.pose();
    let steps = engine.steps(&moves(from, &cut.way[1..])?)?;
    let feeds = cut.way.windows(2).map(|pair| pair[1] - pair[0]);
    let seen = |(step, feed): (Step, Vector3<f64>)| {
        let force = seen_along(&feed, &step.force.force_n);
        (step, force)
    };
    Ok(steps.into_iter().zip(feeds).map(seen).collect())
}

fn solid(level: f64) -> Result<bonemill_geometry::Volume<f32, bonemill_geometry::Work>, ExperimentError> {
    let h = R / level;
    let n = (2.0 * HALF_MM / h).round() as usize;
    block([n; 3], h, Vector3::repeat(-HALF_MM), |_| 0.8)
}

/// Observed order of convergence between two levels.
fn order(last: Option<(f64, f64)>, level: f64, error: f64) -> String {
    last.map_or("-".into(), |(before, e)| {
        format!("{:.1}", (e.abs() / error.abs().max(1e-16)).ln() / (level / before).ln())
    })
}
