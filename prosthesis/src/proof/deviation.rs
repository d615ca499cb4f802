//! How far the machined surface is from the part: at points of the part, exactly for the program's motions.
//!
//! deviation(p) = min over motions of the signed distance from p to what the cutter sweeps. Above 0 it is the thickness of the stock left on p, below 0 how deep
//! the cutter went into the part there. Nothing is rastered but the part's surface, into points at a given distance.

use bonemill_geometry::{Block, Mesh, cancel};
use nalgebra::Vector3;
use rayon::prelude::*;

use crate::proof::cutter::CutterShape;
use crate::proof::gcode::{ProgramMotion, SideUp};
use crate::proof::{ProofError, ProofJob};

/// Most points that are taken.
const MOST_POINTS: usize = 8_000_000;
/// Deviations are measured up to this, mm: beyond it stock is just thick.
pub const FARTHEST_MM: f64 = 3.0;
/// Most points are nearer than this to what was swept, mm: they need few motions.
const NEAR_MM: f64 = 0.2;

/// A point of the part's surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfaceSample {
    /// Where it is, block's frame, mm.
    pub at_mm: Vector3<f64>,
    /// Area that it stands for, mm²; 0 for vertices.
    pub area_mm2: f64,
    /// Stock left on it (above 0) or depth of the cut into the part (below 0), mm.
    pub deviation_mm: f64,
}

/// A place with stock left on the part.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UncutPlace {
    /// Its middle, block's frame, mm.
    pub at_mm: Vector3<f64>,
    /// Area, mm².
    pub area_mm2: f64,
    /// Σ area × thickness, mm³.
    pub volume_mm3: f64,
    /// Thickest, mm.
    pub thickest_mm: f64,
}

/// Points on a part's surface: the middles of pieces of its facets with edges of at most `apart_mm`, and the vertices.
///
/// # Errors
/// [`ProofError::Mesh`] for a facet without three finite vertices, [`ProofError::TooFine`] where there would be too many.
pub fn samples(part: &Mesh<Block>, apart_mm: f64) -> Result<Vec<SurfaceSample>, ProofError> {
    let corner = |n: u32| part.vertices.get(n as usize).filter(|p| p.is_finite()).map(|p| p.coords);
    let mut found = Vec::new();
    for (facet, t) in part.triangles.iter().enumerate() {
        let [Some(a), Some(b), Some(c)] = t.map(corner) else { return Err(ProofError::Mesh { facet }) };
        add_pieces([a, b, c], apart_mm, &mut found);
        if found.len() > MOST_POINTS {
            return Err(ProofError::TooFine { points: found.len(), sample_mm: apart_mm, most: MOST_POINTS });
        }
    }
    let vertices = part.vertices.iter().filter(|p| p.is_finite());
    found.extend(vertices.map(|p| SurfaceSample { at_mm: p.coords, area_mm2: 0.0, deviation_mm: 0.0 }));
    Ok(found)
}

/// Halves a triangle across its longest edge until that is short enough, and adds the middles; no more than are taken in all.
fn add_pieces(triangle: [Vector3<f64>; 3], apart_mm: f64, into: &mut Vec<SurfaceSample>) {
    let mut stack = vec![triangle];
    while let Some([a, b, c]) = stack.pop() {
        let edges = [(b - a).norm(), (c - b).norm(), (a - c).norm()];
        let longest = edges.into_iter().fold(0.0, f64::max);
        if longest <= apart_mm || into.len() > MOST_POINTS {
            let area_mm2 = 0.5 * (b - a).cross(&(c - a)).norm();
            into.push(SurfaceSample { at_mm: (a + b + c) / 3.0, area_mm2, deviation_mm: 0.0 });
        } else if edges[0] == longest {
            let middle = 0.5 * (a + b);
            stack.extend([[a, middle, c], [middle, b, c]]);
        } else if edges[1] == longest {
            let middle = 0.5 * (b + c);
            stack.extend([[a, b, middle], [a, middle, c]]);
        } else {
            let middle = 0.5 * (c + a);
            stack.extend([[a, b, middle], [middle, b, c]]);
        }
    }
}

/// Fills in every sample's deviation.
pub fn measure(samples: &mut [SurfaceSample], motions: &[ProgramMotion], job: &ProofJob) {
    let cutter = CutterShape { radius_mm: job.radius_mm, corner_mm: job.corner_radius_mm };
    let swept = |reach: f64| {
        [SideUp::Front, SideUp::Back].map(|facing| Swept::of(motions, facing, job, job.radius_mm + reach))
    };
    let (near, far) = (swept(NEAR_MM), swept(FARTHEST_MM));
    samples.par_iter_mut().for_each(|sample| {
        cancel::poll();
        // the air around the block counts as removed
        let beyond = (0..3).map(|n| (sample.at_mm[n] - job.low_mm[n]).min(job.high_mm[n] - sample.at_mm[n]));
        let nearest = beyond.fold(FARTHEST_MM, f64::min).max(0.0);
        let least = |swept: &[Swept; 2], start| {
            swept.iter().fold(start, |best: f64, swept| swept.nearest_mm(&sample.at_mm, &cutter, best))
        };
        let found = least(&near, nearest.min(NEAR_MM));
        sample.deviation_mm = if found < NEAR_MM { found } else { least(&far, nearest) };
    });
}

/// Motions of one side in square buckets over the block's X and Y, those that reach lowest first. Motions beside or above the block are in none.
struct Swept {
    facing: SideUp,
    origin: [f64; 2],
    side: f64,
    dims: [usize; 2],
    buckets: Vec<Vec<(f64, u32)>>,
    motions: Vec<[Vector3<f64>; 2]>,
}

impl Swept {
    fn of(all: &[ProgramMotion], facing: SideUp, job: &ProofJob, reach: f64) -> Self {
        let this_side = all.iter().filter(|m| m.facing == facing && !m.turns);
        let motions: Vec<[Vector3<f64>; 2]> = this_side.map(|m| [m.from_mm, m.to_mm]).collect();
        let corners = [facing.machine(&job.low_mm), facing.machine(&job.high_mm)];
        let (low, high) = (corners[0].inf(&corners[1]), corners[0].sup(&corners[1]));
        let extent = [0, 1].map(|axis| high[axis] - low[axis]);
        // at most a million buckets
        let side = (0.2 * reach).max((extent[0] * extent[1] / 1e6).sqrt());
        let dims = extent.map(|e| (e / side) as usize + 1);
        let origin = [low.x, low.y];
        let mut swept =
            Self { facing, origin, side, dims, buckets: vec![vec![]; dims[0] * dims[1]], motions };
        for n in 0..swept.motions.len() {
            if swept.motions[n].iter().any(|p| p.z < high.z + reach) {
                swept.insert(n, reach);
            }
        }
        swept
            .buckets
            .iter_mut()
            .for_each(|bucket| bucket.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1))));
        swept
    }

    fn insert(&mut self, n: usize, reach: f64) {
        let [from, to] = self.motions[n];
        let lowest = from.z.min(to.z);
        let span = |axis: usize| {
            let cell =
                |mm: f64| ((mm - self.origin[axis]) / self.side).clamp(0.0, self.dims[axis] as f64) as usize;
            cell(from[axis].min(to[axis]) - reach)
                ..(cell(from[axis].max(to[axis]) + reach) + 1).min(self.dims[axis])
        };
        let (columns, rows) = (span(0), span(1));
        let centre = |i: usize, axis: usize| self.origin[axis] + (i as f64 + 0.5) * self.side;
        for j in rows {
            for i in columns.clone() {
                // half a bucket's diagonal, rounded up
                let middle = Vector3::new(centre(i, 0), centre(j, 1), 0.0);
                if across_mm(&middle, &from, &to) <= reach + 0.71 * self.side {
                    self.buckets[i + self.dims[0] * j].push((lowest, n as u32));
                }
            }
        }
    }

    /// The least of `best` and the distances of a point to what these motions sweep, mm.
    fn nearest_mm(&self, at_mm: &Vector3<f64>, cutter: &CutterShape, mut best: f64) -> f64 {
        let p = self.facing.machine(at_mm);
        let cell = |axis: usize| {
            let n = (p[axis] - self.origin[axis]) / self.side;
            (n >= 0.0 && n < self.dims[axis] as f64).then_some(n as usize)
        };
        let Some((i, j)) = cell(0).zip(cell(1)) else { return best };
        for &(lowest, n) in &self.buckets[i + self.dims[0] * j] {
            // the tip stays above the point by more than the best
            if lowest - p.z >= best {
                break;
            }
            let [from, to] = &self.motions[n as usize];
            if across_mm(&p, from, to) - cutter.radius_mm < best {
                best = best.min(cutter.swept_mm(&p, from, to));
            }
        }
        best
    }
}

/// Distance of a point to a line's piece, seen along Z, mm.
fn across_mm(p: &Vector3<f64>, from: &Vector3<f64>, to: &Vector3<f64>) -> f64 {
    let (along, off) = (to.xy() - from.xy(), p.xy() - from.xy());
    let length2 = along.norm_squared();
    let t = if length2 > 0.0 { (off.dot(&along) / length2).clamp(0.0, 1.0) } else { 0.0 };
    (off - along * t).norm()
}

/// Groups of samples with more than `above_mm` left on them; samples nearer than about `apart_mm` are one place. The largest first.
pub fn places(samples: &[&SurfaceSample], above_mm: f64, apart_mm: f64) -> Vec<UncutPlace> {
    let cell = |p: &Vector3<f64>| [0, 1, 2].map(|n| (p[n] / apart_mm).floor() as i64);
    let mut cells = std::collections::BTreeMap::<[i64; 3], Vec<&SurfaceSample>>::new();
    for sample in samples.iter().filter(|s| s.deviation_mm > above_mm) {
        cells.entry(cell(&sample.at_mm)).or_default().push(sample);
    }
    let mut found = Vec::new();
    while let Some((&start, _)) = cells.first_key_value() {
        let (mut stack, mut group) = (vec![start], Vec::new());
        while let Some([x, y, z]) = stack.pop() {
            let Some(here) = cells.remove(&[x, y, z]) else { continue };
            group.extend(here);
            for n in 0..27 {
                stack.push([x + n % 3 - 1, y + n / 3 % 3 - 1, z + n / 9 - 1]);
            }
        }
        found.push(place(&group));
    }
    found.sort_by(|a, b| b.volume_mm3.total_cmp(&a.volume_mm3));
    found
}

fn place(group: &[&SurfaceSample]) -> UncutPlace {
    let sum = |of: &dyn Fn(&SurfaceSample) -> f64| group.iter().map(|s| of(s)).sum::<f64>();
    let middle = group.iter().fold(Vector3::zeros(), |sum, s| sum + s.at_mm) / group.len().max(1) as f64;
    UncutPlace {
        at_mm: middle,
        area_mm2: sum(&|s| s.area_mm2),
        volume_mm3: sum(&|s| s.area_mm2 * s.deviation_mm),
        thickest_mm: group.iter().map(|s| s.deviation_mm).fold(0.0, f64::max),
    }
}
