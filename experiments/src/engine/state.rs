//! How to remember what is gone: fractions, bits, runs, capsules or depths; error and time of each on one way through
//! the bone.
//!
//! The way crosses itself: a raster of overlapping passes in two depths, then a pass across it. Each representation
//! removes every step and is asked at every node that moves forward; its force is compared with that of exact
//! capsules on the same nodes. What differs is only what is remembered.

use std::time::Instant;

use bonemill_geometry::{Grid, Point, Work};
use bonemill_planner::Progress;
use bonemill_planner::ball::BallVolumes;
use bonemill_planner::burr::Material;
use bonemill_planner::simulate::{Bone, Engine};
use bonemill_planner::sweep::segment_distance_squared;
use nalgebra::Vector3;

use super::{RADIUS_MM, block, line, model, moves, pose, spec};
use crate::{ExperimentError, Size, Table};

const R: f64 = RADIUS_MM;
const NODES: [usize; 2] = [32, 64];
/// Nodes of the reference.
const FINE: [usize; 2] = [128, 256];
/// Half the bone's side, mm.
const HALF_MM: f64 = 9.0;
/// Asked at every how manyth step for its error.
const EVERY: usize = 5;

/// A memory of what is gone.
trait Memory {
    fn name(&self) -> String;
    /// The ball goes straight from a to b.
    fn remove(&mut self, a: Vector3<f64>, b: Vector3<f64>);
    /// The part of the bone at a point of the ball's surface that is left, 0 to 1.
    fn left(&self, p: &Vector3<f64>, normal: &Vector3<f64>) -> f64;
    /// Bytes now.
    fn bytes(&self) -> usize;
}

/// The voxel grid of the representations that have one.
struct Cells {
    grid: Grid<Work>,
    h: f64,
    dims: [usize; 3],
}

impl Cells {
    fn new(h: f64) -> Result<Self, ExperimentError> {
        let n = (2.0 * HALF_MM / h).round() as usize;
        let grid = Grid::aligned([n; 3], h, Point::from_coords(Vector3::repeat(0.5 * h - HALF_MM)))?;
        Ok(Self { grid, h, dims: [n; 3] })
    }

    /// Cells of a grid `split` times finer that the box around a capsule holds.
    fn around(&self, a: &Vector3<f64>, b: &Vector3<f64>, split: usize) -> [std::ops::Range<usize>; 3] {
        let fine = self.h / split as f64;
        std::array::from_fn(|x| {
            let (lo, hi) = (a[x].min(b[x]) - R + HALF_MM, a[x].max(b[x]) + R + HALF_MM);
            let end = self.dims[x] * split;
            ((lo / fine).floor().max(0.0) as usize).min(end)..((hi / fine).ceil().max(0.0) as usize).min(end)
        })
    }
}

/// The ball's chord along x at (y, z).
fn chord(c: &Vector3<f64>, y: f64, z: f64) -> Option<[f64; 2]> {
    let half2 = R * R - (y - c.y).powi(2) - (z - c.z).powi(2);
    (half2 > 0.0).then(|| [c.x - half2.sqrt(), c.x + half2.sqrt()])
}

/// The hull of both balls' chords: a short step's sweep.
fn hull(a: &Vector3<f64>, b: &Vector3<f64>, y: f64, z: f64) -> Option<[f64; 2]> {
    let both = [chord(a, y, z), chord(b, y, z)].into_iter().flatten();
    both.reduce(|u, v| [u[0].min(v[0]), u[1].max(v[1])])
}

/// The largest part of each voxel that any ball covered, exact; asked by interpolation, at the surface or half a
/// voxel outside.
struct Fractions {
    cells: Cells,
    gone: Vec<f32>,
    offset_mm: f64,
    volumes: BallVolumes,
}

impl Memory for Fractions {
    fn name(&self) -> String {
        format!("fractions, read {} voxel outside", self.offset_mm / self.cells.h)
    }
    fn remove(&mut self, _: Vector3<f64>, b: Vector3<f64>) {
        let voxel_mm3 = self.cells.grid.voxel_mm3();
        let range = self.cells.around(&b, &b, 1);
        let [lo, hi] = [range.clone().map(|r| r.start), range.map(|r| r.end.saturating_sub(1))];
        let gone = &mut self.gone;
        let mut found = Vec::new();
        self.volumes.for_each(
            &self.cells.grid,
            Point::from_coords(b),
            R,
            [lo, hi],
            |row| row.filter(|n| gone[*n] < 1.0),
            |n, volume| found.push((n, (volume / voxel_mm3) as f32)),
        );
        found.into_iter().for_each(|(n, part)| gone[n] = gone[n].max(part));
    }
    fn left(&self, p: &Vector3<f64>, normal: &Vector3<f64>) -> f64 {
        let c = self.cells.grid.continuous_index(Point::from_coords(p + normal * self.offset_mm));
        let mut left = 0.0;
        for corner in 0..8usize {
            let (mut part, mut index, mut stride, mut inside) = (1.0, 0, 1, true);
            for (a, c) in c.iter().enumerate() {
                let base = c.floor();
                let bit = (corner >> a & 1) as f64;
                part *= if bit > 0.0 { c - base } else { 1.0 - (c - base) };
                let cell = base + bit;
                inside &= cell >= 0.0 && cell < self.cells.dims[a] as f64;
                index += stride * cell.max(0.0) as usize;
                stride *= self.cells.dims[a];
            }
            left += if inside { part * f64::from(1.0 - self.gone[index]) } else { 0.0 };
        }
        left
    }
    fn bytes(&self) -> usize {
        4 * self.gone.len()
    }
}

/// 4³ bits of each voxel, by their centres.
struct Bits {
    cells: Cells,
    begun: bool,
    gone: Vec<u64>,
    offset_mm: f64,
}

impl Bits {
    fn bit(&self, [x, y, z]: [usize; 3]) -> (usize, u32) {
        let [nx, ny, _] = self.cells.dims;
        (x / 4 + nx * (y / 4 + ny * (z / 4)), (x % 4 + 4 * (y % 4 + 4 * (z % 4))) as u32)
    }
}

impl Memory for Bits {
    fn name(&self) -> String {
        format!("bits 4^3, read {} voxel outside", self.offset_mm / self.cells.h)
    }
    fn remove(&mut self, a: Vector3<f64>, b: Vector3<f64>) {
        let fine = 0.25 * self.cells.h;
        let [xs, ys, zs] = self.cells.around(&a, &b, 4);
        let at = |n: usize| (n as f64 + 0.5) * fine - HALF_MM;
        // cells of a row within a distance of x, half-open
        let cells = |[lo, hi]: [f64; 2]| {
            let cell =
                |x: f64| (((x + HALF_MM) / fine - 0.5).ceil().max(0.0) as usize).clamp(xs.start, xs.end);
            cell(lo)..cell(hi)
        };
        for z in zs {
            for y in ys.clone() {
                let Some(hull) = hull(&a, &b, at(y), at(z)) else { continue };
                // what the last ball took is gone
                let known = if self.begun { chord(&a, at(y), at(z)).map_or(0..0, cells) } else { 0..0 };
                for x in cells(hull).filter(|x| !known.contains(x)) {
                    let (voxel, bit) = self.bit([x, y, z]);
                    self.gone[voxel] |= 1 << bit;
                }
            }
        }
        self.begun = true;
    }
    fn left(&self, p: &Vector3<f64>, normal: &Vector3<f64>) -> f64 {
        let p = p + normal * self.offset_mm;
        let cell = p.map(|v| (v + HALF_MM) / (0.25 * self.cells.h));
        if (0..3).any(|a| cell[a] < 0.0 || cell[a] >= 4.0 * self.cells.dims[a] as f64) {
            return 0.0;
        }
        let (voxel, bit) = self.bit(std::array::from_fn(|a| cell[a] as usize));
        if self.gone[voxel] >> bit & 1 == 1 { 0.0 } else { 1.0 }
    }
    fn bytes(&self) -> usize {
        8 * self.gone.len()
    }
}

/// Yang's run lengths: removed intervals along x for rows at voxel spacing, their ends exact.
struct Runs {
    cells: Cells,
    rows: Vec<Vec<[f64; 2]>>,
}

impl Memory for Runs {
    fn name(&self) -> String {
        "run lengths along x, exact ends".into()
    }
    fn remove(&mut self, a: Vector3<f64>, b: Vector3<f64>) {
        let [_, ys, zs] = self.cells.around(&a, &b, 1);
        let at = |n: usize| (n as f64 + 0.5) * self.cells.h - HALF_MM;
        for z in zs {
            for y in ys.clone() {
                let Some([mut lo, mut hi]) = hull(&a, &b, at(y), at(z)) else { continue };
                let row = &mut self.rows[y + self.cells.dims[1] * z];
                row.retain(|run| {
                    let apart = run[1] < lo || run[0] > hi;
                    if !apart {
                        (lo, hi) = (lo.min(run[0]), hi.max(run[1]));
                    }
                    apart
                });
                row.push([lo, hi]);
            }
        }
    }
    fn left(&self, p: &Vector3<f64>, _: &Vector3<f64>) -> f64 {
        let row = |v: f64| (v + HALF_MM) / self.cells.h;
        let (y, z) = (row(p.y), row(p.z));
        let n = self.cells.dims[1] as f64;
        if p.x.abs() > HALF_MM || !(0.0..n).contains(&y) || !(0.0..n).contains(&z) {
            return 0.0;
        }
        let gone = self.rows[y as usize + self.cells.dims[1] * z as usize]
            .iter()
            .any(|run| run[0] <= p.x && p.x <= run[1]);
        if gone { 0.0 } else { 1.0 }
    }
    fn bytes(&self) -> usize {
        self.rows.iter().map(|row| 24 + 16 * row.capacity()).sum()
    }
}

/// Capsules by brick of 2 mm; straight steps are one capsule.
struct Capsules {
    all: Vec<[Vector3<f64>; 2]>,
    bricks: Vec<Vec<u32>>,
    side: usize,
}

const BRICK_MM: f64 = 2.0;

impl Capsules {
    fn new() -> Self {
        let side = (2.0 * (HALF_MM + 2.0 * R) / BRICK_MM).ceil() as usize;
        Self { all: Vec::new(), bricks: vec![Vec::new(); side.pow(3)], side }
    }

    fn brick(&self, p: &Vector3<f64>) -> Option<usize> {
        let at = p.map(|v| (v + HALF_MM + 2.0 * R) / BRICK_MM);
        let inside = at.iter().all(|v| *v >= 0.0 && *v < self.side as f64);
        inside.then(|| at.x as usize + self.side * (at.y as usize + self.side * at.z as usize))
    }
}

impl Memory for Capsules {
    fn name(&self) -> String {
        "capsules by brick".into()
    }
    fn remove(&mut self, a: Vector3<f64>, b: Vector3<f64>) {
        if let Some(last) = self.all.last_mut()
            && last[1] == a
            && segment_distance_squared(&a, &last[0], &b) < 1e-12
        {
            last[1] = b;
        } else {
            self.all.push([a, b]);
        }
        let (Some([a, b]), number) = (self.all.last(), self.all.len() as u32 - 1) else { return };
        let reach = R + 0.5 * BRICK_MM * 3f64.sqrt();
        for (n, brick) in self.bricks.iter_mut().enumerate() {
            let at = [n % self.side, n / self.side % self.side, n / self.side.pow(2)];
            let middle = Vector3::from(at.map(|v| (v as f64 + 0.5) * BRICK_MM - HALF_MM - 2.0 * R));
            let near =
                brick.last() != Some(&number) && segment_distance_squared(&middle, a, b) < reach * reach;
            if near {
                brick.push(number);
            }
        }
    }
    fn left(&self, p: &Vector3<f64>, _: &Vector3<f64>) -> f64 {
        let Some(brick) = self.brick(p) else { return 1.0 };
        let gone = self.bricks[brick].iter().rev().any(|n| {
            let [a, b] = &self.all[*n as usize];
            segment_distance_squared(p, a, b) <= R * R * (1.0 + 1e-12)
        });
        if gone { 0.0 } else { 1.0 }
    }
    fn bytes(&self) -> usize {
        48 * self.all.capacity() + self.bricks.iter().map(|b| 24 + 4 * b.capacity()).sum::<usize>()
    }
}

/// The places of the way.
fn way(step_mm: f64) -> Vec<Vector3<f64>> {
    let mut corners = Vec::new();
    for (layer, z) in [2.03, 0.77].into_iter().enumerate() {
        for pass in 0..6 {
            let y = -4.0 + 1.6 * pass as f64 + 0.3 * layer as f64;
            let ends = if pass % 2 == 0 { [-5.0, 5.0] } else { [5.0, -5.0] };
            corners.extend(ends.map(|x| Vector3::new(x, y, z)));
        }
        corners.push(Vector3::new(-5.0, 4.3, 2.03));
        corners.push(Vector3::new(-5.0, -4.0, 2.03));
    }
    corners.push(Vector3::new(4.2, 4.9, -0.4));
    let mut places = vec![corners[0]];
    for pair in corners.windows(2) {
        let count = ((pair[1] - pair[0]).norm() / step_mm).ceil().max(1.0) as usize;
        places.extend(line(pair[0], pair[1], count));
    }
    places
}

/// Nodes of the front, and Σ q n·v̂ n over those in bone, weighted as the db force is.
fn force(memory: &dyn Memory, nodes: [usize; 2], p: &Vector3<f64>, feed: &Vector3<f64>) -> Vector3<f64> {
    let mut sum = Vector3::zeros();
    for k in 0..nodes[0] {
        let (sk, ck) = ((k as f64 + 0.5) * std::f64::consts::PI / nodes[0] as f64).sin_cos();
        for m in 0..nodes[1] {
            let (s, c) = ((m as f64 + 0.5) * 2.0 * std::f64::consts::PI / nodes[1] as f64).sin_cos();
            let n = Vector3::new(sk * c, sk * s, -ck);
            let forward = n.dot(feed);
            if forward > 1e-12 {
                let at = p + n * R;
                let inside = at.iter().all(|v| v.abs() < HALF_MM);
                if inside {
                    let q = forward * memory.left(&at, &n);
                    // −(σ e_ψ + 0.6 n) with σ = −1, by element length
                    sum += (Vector3::new(-s, c, 0.0) - n * 0.6) * q;
                }
            }
        }
    }
    // the largest sum is that of a full slot, whatever the nodes
    sum / (nodes[0] * nodes[1]) as f64
}

/// Error quantiles against exact capsules, %, and time per step, µs.
fn judge(memory: &mut dyn Memory, places: &[Vector3<f64>], exact: &[Vector3<f64>]) -> ([f64; 3], [f64; 2]) {
    let most = exact.iter().map(|f| f.norm()).fold(0.0, f64::max);
    let (mut errors, mut removing, mut asking) = (Vec::new(), 0.0, 0.0);
    for (n, pair) in places.windows(2).enumerate() {
        if n % EVERY == 0 {
            let since = Instant::now();
            let found = force(memory, NODES, &pair[1], &(pair[1] - pair[0]).normalize());
            asking += since.elapsed().as_secs_f64() * 1e6;
            let expected = exact[n / EVERY];
            if expected.norm() > 0.05 * most {
                errors.push(100.0 * (found - expected).norm() / expected.norm());
            }
        }
        let since = Instant::now();
        memory.remove(pair[0], pair[1]);
        removing += since.elapsed().as_secs_f64() * 1e6;
    }
    errors.sort_by(f64::total_cmp);
    let quantile = |q: f64| errors.get((q * (errors.len() as f64 - 1.0)) as usize).copied().unwrap_or(0.0);
    let steps = (places.len() - 1) as f64;
    ([quantile(0.5), quantile(0.95), quantile(1.0)], [removing / steps, asking / exact.len() as f64])
}

/// Measures the table. The way is given: `_size` changes nothing.
///
/// # Errors
/// [`ExperimentError`] when the engine refuses its own experiment.
pub fn run(_size: Size, progress: &dyn Progress) -> Result<Vec<Table>, ExperimentError> {
    let title = format!(
        "What is remembered of the bone that is gone: r/h = 10, {} × {} nodes, one thread. Error of the force \
         against exact capsules and {} × {} nodes, where the force is above 5 % of its largest. The last rows are whole steps \
         of the engine: depths by brick, the newest stretch exact, patches counted by their share.",
        NODES[0], NODES[1], FINE[0], FINE[1]
    );
    let columns = [
        "memory",
        "step [mm]",
        "error q50 [%]",
        "q95 [%]",
        "max [%]",
        "remove [µs]",
        "ask [µs]",
        "memory [MB]",
    ];
    let mut table = Table::new("engine-state", title, &columns);
    let h = 0.1 * R;
    for step_mm in [0.1, 0.02] {
        progress.stage(&format!("steps of {step_mm} mm"));
        let places = way(step_mm);
        let exact = exact(&places);
        let count = Cells::new(h)?.grid.len();
        let mut memories: Vec<Box<dyn Memory>> = Vec::new();
        for offset_mm in [0.0, 0.5 * h] {
            let volumes = BallVolumes::new();
            memories.push(Box::new(Fractions {
                cells: Cells::new(h)?,
                gone: vec![0.0; count],
                offset_mm,
                volumes,
            }));
        }
        for offset_mm in [0.0, 0.25 * h] {
            memories.push(Box::new(Bits {
                cells: Cells::new(h)?,
                begun: false,
                gone: vec![0; count],
                offset_mm,
            }));
        }
        let cells = Cells::new(h)?;
        let rows = vec![Vec::new(); cells.dims[1] * cells.dims[2]];
        memories.push(Box::new(Runs { cells, rows }));
        memories.push(Box::new(Capsules::new()));
        for mut memory in memories {
            let (errors, times) = judge(&mut *memory, &places, &exact);
            table.push(row(memory.name(), step_mm, errors, times, memory.bytes()));
        }
        for cells in [5.0, 10.0, 20.0] {
            table.push(engine(cells, step_mm, &places, &exact)?);
        }
    }
    Ok(vec![table])
}

/// Forces with every capsule remembered.
fn exact(places: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    let mut memory = Capsules::new();
    let mut out = Vec::new();
    for (n, pair) in places.windows(2).enumerate() {
        if n % EVERY == 0 {
            out.push(force(&memory, FINE, &pair[1], &(pair[1] - pair[0]).normalize()));
        }
        memory.remove(pair[0], pair[1]);
    }
    out
}

fn row(name: String, step_mm: f64, errors: [f64; 3], times: [f64; 2], bytes: usize) -> Vec<String> {
    let mut row = vec![name, step_mm.to_string()];
    row.extend(errors.map(|e| format!("{e:.2}")));
    row.extend(times.map(|t| format!("{t:.1}")));
    row.push(format!("{:.2}", bytes as f64 / 1e6));
    row
}

/// The engine at so many cells per radius. Its force has the same two directions: K_t = 1, K_r = 0.6 by element length.
fn engine(
    cells: f64,
    step_mm: f64,
    places: &[Vector3<f64>],
    exact: &[Vector3<f64>],
) -> Result<Vec<String>, ExperimentError> {
    let n = (2.0 * HALF_MM / (0.1 * R)).round() as usize;
    // a margin beyond the asked places, so that the density's fading is out of sight
    let bone = block([n + 8; 3], 0.1 * R, Vector3::repeat(-HALF_MM - 0.4 * R), |_| 0.8f32)?;
    let start = pose(places[0])?;
    let moves = moves(start, &places[1..])?;
    let mut spec = spec(NODES[0], NODES[1], cells)?;
    spec.material = Material::new([1.0, 0.6, 0.0], 0.8)?;
    let model = model(&spec);
    let mut engine = Engine::new(Bone::new(&bone)?, spec, model, start)?;
    let mut forces = Vec::with_capacity(moves.len());
    let since = Instant::now();
    for to in &moves {
        forces.push(engine.step(*to)?.force.force_n);
    }
    let took_us = since.elapsed().as_secs_f64() * 1e6 / moves.len() as f64;
    let asked: Vec<Vector3<f64>> = forces.iter().step_by(EVERY).copied().collect();
    let scale = asked.iter().map(|f| f.norm()).sum::<f64>() / exact.iter().map(|f| f.norm()).sum::<f64>();
    let most = exact.iter().map(|f| f.norm()).fold(0.0, f64::max);
    let mut errors: Vec<f64> = asked
        .iter()
        .zip(exact)
        .filter(|(_, e)| e.norm() > 0.05 * most)
        .map(|(f, e)| 100.0 * (f / scale - e).norm() / e.norm())
        .collect();
    errors.sort_by(f64::total_cmp);
    let quantile = |q: f64| errors.get((q * (errors.len() as f64 - 1.0)) as usize).copied().unwrap_or(0.0);
    let name = format!("depths by brick, {cells} cells per radius");
    let bytes = engine.lattice().stored_bricks().1;
    Ok(row(name, step_mm, [quantile(0.5), quantile(0.95), quantile(1.0)], [0.0, took_us], bytes))
}
