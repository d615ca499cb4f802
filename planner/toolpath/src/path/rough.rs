//! Roughing: serpentine lines, layer by layer.

use crate::scene::Class;
use bonemill_geometry::{Point, Work};

use super::{Builder, Lines, Pass, RasterFrame};

/// A point of a line is cut if the ball there removes at least this many voxels.
const WORTH_VOXELS: usize = 3;
/// Empty stretches of a line are crossed with the cut's speed if shorter than this, mm; longer ones become links.
const CROSS_MM: f64 = 3.0;
/// Layers may be thicker than requested by this share, so that no very thin layer is added.
const LAYER_SLACK: f64 = 0.02;

/// Cuts every layer; returns the number of layers.
pub(super) fn rough(builder: &mut Builder, lines: &Lines) -> u32 {
    let frame = &lines.frame;
    let Some(extent) = LineExtent::of(builder, frame) else { return 0 };
    let spacing = builder.spacing();
    let depth = extent.top - extent.floor + builder.space().radius_mm();
    let layers = (depth / (spacing.layer_mm * (1.0 + LAYER_SLACK))).ceil().max(1.0);
    let layer_mm = depth / layers;
    for layer in 0..layers as u32 {
        let z = extent.top - f64::from(layer + 1) * layer_mm + builder.space().radius_mm();
        let mut passes = layer_passes(builder, frame, &extent, [z, z + layer_mm], layer);
        while let Some(next) = nearest_pass(builder.position(), &passes) {
            let mut pass = passes.swap_remove(next.pass);
            if (lines.sense)(builder, &pass.points).unwrap_or(next.reversed) {
                pass.points.reverse();
            }
            builder.add(pass);
        }
    }
    layers as u32
}

/// Extent of the lines, mm: u of the target's outline, v and floor of the burr's centre, z of the highest reachable voxel.
struct LineExtent {
    u: [f64; 2],
    v: [f64; 2],
    top: f64,
    floor: f64,
}

impl LineExtent {
    fn of(builder: &Builder, frame: &RasterFrame) -> Option<Self> {
        let (space, grid) = (builder.space(), builder.space().grid());
        let scene = space.scene();
        let hull = scene.target_hull_xy.iter().map(|p| frame.uv(Point::new(p[0], p[1], 0.0)));
        let mut outline = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
        for uv in hull {
            (0..2).for_each(|a| outline[a] = [outline[a][0].min(uv[a]), outline[a][1].max(uv[a])]);
        }
        let mut found =
            Self { u: outline[0], v: [f64::INFINITY, f64::NEG_INFINITY], top: f64::MIN, floor: f64::MAX };
        for n in 0..grid.len() {
            let p = || grid.center(grid.voxel(n));
            if space.reachable()[n] {
                found.top = found.top.max(p().z() + 0.5 * grid.spacing_mm().z);
            }
            // positions beside the target, in free space, are not used: lines follow the target's outline
            if space.connected()[n] && scene.class.data()[n].is(Class::TARGET) {
                let v = frame.uv(p())[1];
                found.v = [found.v[0].min(v), found.v[1].max(v)];
                found.floor = found.floor.min(p().z());
            }
        }
        if found.top == f64::MIN {
            return None;
        }
        if found.floor == f64::MAX {
            // the target is too thin for the burr's centre to enter: one layer along its surface
            (found.v, found.floor) = (outline[1], found.top);
        }
        Some(found)
    }
}

/// The passes of one layer, in line order.
fn layer_passes(
    builder: &Builder,
    frame: &RasterFrame,
    extent: &LineExtent,
    slab: [f64; 2],
    layer: u32,
) -> Vec<Pass> {
    let spacing = builder.spacing();
    let lines = ((extent.v[1] - extent.v[0]) / spacing.stepover_mm - 1e-6).ceil().max(1.0) as usize;
    let reach = builder.space().radius_mm();
    let samples = ((extent.u[1] - extent.u[0] + 2.0 * reach) / spacing.step_mm).ceil() as usize;
    let mut passes = Vec::new();
    for line in 0..=lines {
        let v = extent.v[0] + (extent.v[1] - extent.v[0]) * line as f64 / lines as f64;
        let at = |n: f64| floor_at(builder, frame, extent.u[0] - reach + n * spacing.step_mm, v, slab);
        let row: Vec<Option<Point<Work>>> = (0..=samples).map(|n| at(n as f64)).collect();
        for run in clear_runs(builder, &row) {
            for worth in
                worth_cutting(builder, &row[run.clone()].iter().flatten().copied().collect::<Vec<_>>())
            {
                let (start, end) = (run.start + worth.start, run.start + worth.end);
                let mut points: Vec<_> = row[start..end].iter().flatten().copied().collect();
                // extended to the wall, where the line ends at one
                if start == run.start
                    && start > 0
                    && let Some(p) = last_clear(builder, points[0], |f| at(start as f64 - f))
                {
                    points.insert(0, p);
                }
                if end == run.end && end < row.len() {
                    let last = points[points.len() - 1];
                    if let Some(p) = last_clear(builder, last, |f| at((end - 1) as f64 + f)) {
                        points.push(p);
                    }
                }
                passes.push(Pass { layer, points, put_off: false, from_above: false });
            }
        }
    }
    passes
}

/// The lowest open place in the column (u, v) within the slab.
fn floor_at(
    builder: &Builder,
    frame: &RasterFrame,
    u: f64,
    v: f64,
    [low, high]: [f64; 2],
) -> Option<Point<Work>> {
    let space = builder.space();
    let at = |z: f64| frame.point(u, v, z);
    if space.is_open(at(low)) {
        return Some(at(low));
    }
    let step = 0.5 * space.grid().spacing_mm().z;
    let tries = ((high - low) / step).floor() as usize;
    let first = (1..=tries).map(|n| low + n as f64 * step).find(|z| *z < high && space.is_open(at(*z)))?;
    // bisection towards the floor, to 1/16 of the step
    let (mut closed, mut open) = (first - step, first);
    for _ in 0..4 {
        let middle = 0.5 * (closed + open);
        if space.is_open(at(middle)) { open = middle } else { closed = middle }
    }
    Some(at(open))
}

/// Maximal runs of samples that are joined by straight clear moves.
fn clear_runs(builder: &Builder, row: &[Option<Point<Work>>]) -> Vec<std::ops::Range<usize>> {
    let half = 0.5 * builder.space().grid().spacing_mm().x;
    let mut runs: Vec<std::ops::Range<usize>> = Vec::new();
    for (n, sample) in row.iter().enumerate() {
        let Some(p) = sample else { continue };
        match runs.last_mut() {
            Some(run)
                if run.end == n
                    && row[n - 1].is_some_and(|before| builder.space().is_move_clear(before, *p, half)) =>
            {
                run.end = n + 1;
            }
            _ => runs.push(n..n + 1),
        }
    }
    runs
}

/// Parts of a run with something to remove, short empty stretches included.
fn worth_cutting(builder: &Builder, points: &[Point<Work>]) -> Vec<std::ops::Range<usize>> {
    let cross = (CROSS_MM / builder.spacing().step_mm).round() as usize;
    let mut parts: Vec<std::ops::Range<usize>> = Vec::new();
    for (n, p) in points.iter().enumerate() {
        if builder.gain(*p, WORTH_VOXELS) < WORTH_VOXELS {
            continue;
        }
        match parts.last_mut() {
            Some(part) if n - part.end < cross => part.end = n + 1,
            _ => parts.push(n..n + 1),
        }
    }
    parts
}

/// The last open place before a wall, within one step of `inside`; `at(f)` is the column f steps further.
fn last_clear(
    builder: &Builder,
    inside: Point<Work>,
    at: impl Fn(f64) -> Option<Point<Work>>,
) -> Option<Point<Work>> {
    let half = 0.5 * builder.space().grid().spacing_mm().x;
    let (mut open, mut closed, mut best) = (0.0, 1.0, None);
    for _ in 0..5 {
        let middle = 0.5 * (open + closed);
        match at(middle).filter(|p| builder.space().is_move_clear(inside, *p, half)) {
            Some(p) => (open, best) = (middle, Some(p)),
            None => closed = middle,
        }
    }
    best
}

struct Next {
    pass: usize,
    reversed: bool,
}

/// The pass with the nearest end; of equal ones the earlier line.
fn nearest_pass(from: Option<Point<Work>>, passes: &[Pass]) -> Option<Next> {
    let Some(from) = from else {
        // the first line comes first
        let first = (0..passes.len()).min_by_key(|n| passes[*n].layer)?;
        return Some(Next { pass: first, reversed: false });
    };
    let ends = passes.iter().enumerate().flat_map(|(pass, p)| {
        [(p.points.first(), false), (p.points.last(), true)]
            .into_iter()
            .filter_map(move |(end, reversed)| Some((end?.distance_mm(&from), pass, reversed)))
    });
    ends.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, pass, reversed)| Next { pass, reversed })
}
