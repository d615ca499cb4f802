//! Closed passes of equal step: the iso-lines of a field that grows by 1 from pass to pass.
//!
//! From the domain's outer boundary inwards |∇T| = 1/s with s the step that is allowed at a place. So the lines T = 1, 2, 3 … keep the step
//! everywhere: wide apart where the surface is flat, close where it slopes, and each is one closed pass that needs no retract. Where the
//! field ends in a ridge between two lines, a line half-way is added, so that every place has a line within half a step or lies between two.
//! Each loop has the greater T on its right: going inwards, the stock is on the right, which is climb for a spindle that turns clockwise.
//!
//! **Source:** Sethian 1996, "A fast marching level set method for monotonically advancing fronts"; passes of constant scallop as iso-lines of an
//! eikonal field are after Bieterman & Sandstrom 2003, "A curvilinear tool-path method for pocket machining", who solve Laplace's equation instead.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use bonemill_geometry::cancel;

use crate::machining::raster::CellRaster;
use crate::machining::silhouette::Loop;

/// Outside the domain.
const OUTSIDE: f64 = -1.0;

/// The field T over a raster; `OUTSIDE` outside its domain.
#[derive(Debug, Clone)]
pub struct Field {
    raster: CellRaster,
    t: Vec<f64>,
}

impl Field {
    /// From a domain and the distance of its cells to its outer boundary (mm, only those near it matter), with the allowed step at each cell, mm.
    pub fn march(raster: &CellRaster, domain: &[bool], inward_mm: &[f64], step_mm: &[f64]) -> Self {
        let mut field = Self { raster: *raster, t: vec![f64::INFINITY; raster.len()] };
        let mut heap = BinaryHeap::new();
        for cell in 0..raster.len() {
            if !domain[cell] {
                field.t[cell] = OUTSIDE;
            } else if inward_mm[cell] <= 1.5 * raster.pitch_mm {
                field.t[cell] = inward_mm[cell].max(0.0) / step_mm[cell];
                heap.push(Reverse((Ordered(field.t[cell]), cell as u32)));
            }
        }
        let mut done = vec![false; raster.len()];
        while let Some(Reverse((_, cell))) = heap.pop() {
            cancel::poll();
            let cell = cell as usize;
            if std::mem::replace(&mut done[cell], true) {
                continue;
            }
            for next in raster.neighbours(cell).into_iter().flatten() {
                if field.t[next] >= 0.0 && !done[next] {
                    let t = field.arrival(next, raster.pitch_mm / step_mm[next]);
                    if t < field.t[next] {
                        field.t[next] = t;
                        heap.push(Reverse((Ordered(t), next as u32)));
                    }
                }
            }
        }
        field.t.iter_mut().filter(|t| !t.is_finite()).for_each(|t| *t = OUTSIDE);
        field
    }

    /// The T at which the front arrives, from the lesser neighbours along u and v: (T − a)² + (T − b)² = f².
    fn arrival(&self, cell: usize, f: f64) -> f64 {
        let [left, right, below, above] = self.raster.neighbours(cell);
        let lesser = |one: Option<usize>, other: Option<usize>| {
            let value = |n: Option<usize>| {
                n.map_or(f64::INFINITY, |n| if self.t[n] < 0.0 { f64::INFINITY } else { self.t[n] })
            };
            value(one).min(value(other))
        };
        let (a, b) = (lesser(left, right), lesser(below, above));
        let (a, b) = (a.min(b), a.max(b));
        if b - a >= f { a + f } else { 0.5 * (a + b + (2.0 * f * f - (a - b) * (a - b)).sqrt()) }
    }

    /// The loops T = 1, 2, 3 …, each with its T, from the outside inwards.
    pub fn loops(&self) -> Vec<(f64, Loop)> {
        let most = self.t.iter().copied().fold(0.0, f64::max);
        let mut found = Vec::new();
        for k in 0..=most.floor() as usize {
            if k > 0 {
                found.extend(iso_loops(&self.raster, &self.t, k as f64).into_iter().map(|l| (k as f64, l)));
            }
            let half = k as f64 + 0.5;
            let ridges = self.ridges(half, k as f64 + 1.0);
            if let Some(ridges) = ridges {
                found.extend(iso_loops(&self.raster, &ridges, half).into_iter().map(|l| (half, l)));
            }
        }
        found
    }

    /// The field where it is above `half` but nowhere connected reaches `next`; `None` where there is no such place.
    fn ridges(&self, half: f64, next: f64) -> Option<Vec<f64>> {
        let mut kept = vec![OUTSIDE; self.t.len()];
        let mut seen = vec![false; self.t.len()];
        let mut any = false;
        for start in 0..self.t.len() {
            if seen[start] || self.t[start] <= half || self.t[start] > next {
                continue;
            }
            let island = self.raster.connected(vec![start], &mut seen, |cell| self.t[cell] > half);
            let peak = island.iter().map(|cell| self.t[*cell]).fold(half, f64::max);
            if peak < next && island.len() > 1 {
                any = true;
                island.iter().for_each(|cell| kept[*cell] = self.t[*cell]);
            }
        }
        // the line needs the values beside the island too
        let beside = |cell: usize| if self.t[cell] <= half { self.t[cell] } else { kept[cell] };
        any.then(|| (0..self.t.len()).map(beside).collect())
    }
}

/// Closed iso-lines of a map over a raster by marching squares, the greater values on the right.
pub fn iso_loops(raster: &CellRaster, map: &[f64], level: f64) -> Vec<Loop> {
    let [nu, nv] = raster.dims;
    // an edge is named by its lower left cell and its direction; from each edge the line goes on to the next
    let mut next = std::collections::BTreeMap::new();
    for j in 0..nv.saturating_sub(1) {
        for i in 0..nu.saturating_sub(1) {
            let c = i + nu * j;
            let above = [c, c + 1, c + 1 + nu, c + nu].map(|n| map[n] > level);
            if above == [true; 4] || above == [false; 4] {
                continue;
            }
            // edges counter-clockwise from below: between corners 0-1, 1-2, 2-3, 3-0
            let edges = [(c, 0), (c + 1, 1), (c + nu, 0), (c, 1)];
            for e in 0..4 {
                // the line leaves where, counter-clockwise, the map falls below the level: the greater is then on its right
                if above[e] && !above[(e + 1) % 4] {
                    let entry = (1..4).map(|k| (e + k) % 4).find(|x| !above[*x] && above[(*x + 1) % 4]);
                    if let Some(entry) = entry {
                        next.insert(edges[entry], edges[e]);
                    }
                }
            }
        }
    }
    let point = |(cell, axis): (usize, usize)| {
        let other = if axis == 0 { cell + 1 } else { cell + nu };
        let (a, b) = (map[cell], map[other]);
        let part = if (b - a).is_finite() && b != a { ((level - a) / (b - a)).clamp(0.0, 1.0) } else { 0.5 };
        let mut p = raster.centre_of(cell);
        p[axis] += part * raster.pitch_mm;
        p
    };
    let mut loops = Vec::new();
    while let Some((&start, _)) = next.first_key_value() {
        let (mut outline, mut at) = (Vec::new(), start);
        while let Some(to) = next.remove(&at) {
            outline.push(point(at));
            at = to;
        }
        if at == start && outline.len() > 2 {
            loops.push(outline);
        }
    }
    loops
}

/// A number in the order of numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Ordered(f64);
impl Eq for Ordered {}
impl PartialOrd for Ordered {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for Ordered {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.0.total_cmp(&other.0)
    }
}
