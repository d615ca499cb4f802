//! How low a cutter may go at a place, exactly for the part's triangles.
//!
//! The cutter, axis along w, is lowered until it touches a vertex, an edge or the inside of a facet; the greatest of these heights is the lowest
//! place of its tip. Flat, ball and bull-nose cutters differ in their profile f only (height of the surface above the tip at distance r):
//!
//! - vertex p: w = p_w − f(|p − axis|);
//! - facet with unit normal n, n_w > 0: contact at axis − (R − r_c) n̂ − r_c n_uv, n̂ = n_uv/|n_uv|, and w = w_contact − r_c (1 − n_w);
//! - edge: max over its points of p_w − f(|p − axis|), concave along the edge. A flat end takes the highest point inside the circle; a rounded corner is found by
//!   bisection of the derivative.
//!
//! Lists of vertices, edges and facets stand in square buckets; an edge or facet that cannot lift the cutter is passed over.
//!
//! **Source:** Chuang, Chen & Yau 2002, "A reverse engineering approach to generating interference-free tool paths in three-axis machining from scanned data of
//! physical models", contacts of a generalized radial cutter.

use bonemill_geometry::cancel;
use nalgebra::Vector3;

use crate::machining::EndMill;
use crate::machining::envelope::Facet;
use crate::machining::raster::NONE;

/// Halvings on an edge: to the edge's length over 10⁹.
const HALVINGS: usize = 30;

/// What stands in a bucket.
#[derive(Debug, Clone)]
struct Bucket {
    /// Highest point of all, mm.
    top_mm: f64,
    vertices: Vec<Vector3<f64>>,
    edges: Vec<[Vector3<f64>; 2]>,
    facets: Vec<(Facet, Vector3<f64>)>,
}

impl Bucket {
    fn empty() -> Self {
        Self { top_mm: NONE, vertices: vec![], edges: vec![], facets: vec![] }
    }

    /// Facets share their vertices and edges.
    fn without_doubles(&mut self) {
        let order = |p: &Vector3<f64>, q: &Vector3<f64>| {
            p.x.total_cmp(&q.x).then(p.y.total_cmp(&q.y)).then(p.z.total_cmp(&q.z))
        };
        self.vertices.sort_by(order);
        self.vertices.dedup();
        self.edges.iter_mut().filter(|[p, q]| order(p, q).is_gt()).for_each(|edge| edge.reverse());
        self.edges.sort_by(|[p, q], [r, s]| order(p, r).then(order(q, s)));
        self.edges.dedup();
    }
}

/// Lowest places of a tool's tip over a part.
#[derive(Debug, Clone)]
pub struct DropCutter {
    radius_mm: f64,
    corner_mm: f64,
    origin_mm: [f64; 2],
    side_mm: f64,
    dims: [usize; 2],
    buckets: Vec<Bucket>,
}

impl DropCutter {
    /// Over facets as the tool sees them (u, v, w). Only facets that face the tool count: the others lie below them on a closed part.
    pub fn new(facets: &[Facet], tool: &EndMill) -> Self {
        let (mut low, mut high) = ([f64::INFINITY; 2], [NONE; 2]);
        for p in facets.iter().flatten() {
            for axis in 0..2 {
                (low[axis], high[axis]) = (low[axis].min(p[axis]), high[axis].max(p[axis]));
            }
        }
        let extent = |axis: usize| (high[axis] - low[axis]).max(0.0);
        // about 20 facets a bucket, no bucket larger than the tool, at most a million of them
        let area = (extent(0) * extent(1)).max(1e-6);
        let side_mm = (20.0 * area / facets.len().max(1) as f64)
            .sqrt()
            .clamp((area / 1e6).sqrt(), tool.radius_mm.max((area / 1e6).sqrt()));
        let dims = [0, 1].map(|axis| (extent(axis) / side_mm) as usize + 1);
        let mut drop = Self {
            radius_mm: tool.radius_mm,
            corner_mm: tool.corner_radius_mm,
            origin_mm: low,
            side_mm,
            dims,
            buckets: vec![Bucket::empty(); dims[0] * dims[1]],
        };
        facets.iter().for_each(|facet| drop.insert(facet));
        drop.buckets.iter_mut().for_each(Bucket::without_doubles);
        drop
    }

    fn insert(&mut self, facet: &Facet) {
        let [a, b, c] = facet;
        let normal = (b - a).cross(&(c - a));
        if normal.z <= 0.0 {
            return;
        }
        let n = normal.normalize();
        for (p, q) in [(a, b), (b, c), (c, a)] {
            self.each_bucket(&[*p], |bucket| bucket.vertices.push(*p));
            self.each_bucket(&[*p, *q], |bucket| bucket.edges.push([*p, *q]));
        }
        self.each_bucket(facet, |bucket| bucket.facets.push((*facet, n)));
    }

    fn each_bucket(&mut self, points: &[Vector3<f64>], mut add: impl FnMut(&mut Bucket)) {
        let span = |axis: usize| {
            let low = points.iter().map(|p| p[axis]).fold(f64::INFINITY, f64::min);
            let high = points.iter().map(|p| p[axis]).fold(NONE, f64::max);
            self.span(axis, low, high)
        };
        let (columns, rows) = (span(0), span(1));
        for j in rows {
            for i in columns.clone() {
                if let Some(bucket) = self.buckets.get_mut(i + self.dims[0] * j) {
                    bucket.top_mm = points.iter().fold(bucket.top_mm, |top, p| top.max(p.z));
                    add(bucket);
                }
            }
        }
    }

    fn span(&self, axis: usize, low_mm: f64, high_mm: f64) -> std::ops::Range<usize> {
        let most = self.dims[axis] as f64;
        let low = ((low_mm - self.origin_mm[axis]) / self.side_mm).floor().clamp(0.0, most);
        let high = (((high_mm - self.origin_mm[axis]) / self.side_mm).floor() + 1.0).clamp(0.0, most);
        low as usize..high as usize
    }

    /// The lowest place of the tip with its axis at (u, v), mm; `NONE` where the part is not under the tool.
    pub fn height_mm(&self, at: [f64; 2]) -> f64 {
        cancel::poll();
        let rows = self.span(1, at[1] - self.radius_mm, at[1] + self.radius_mm);
        let columns = self.span(0, at[0] - self.radius_mm, at[0] + self.radius_mm);
        let buckets = || {
            rows.clone().flat_map(|j| {
                self.buckets[columns.start + self.dims[0] * j..columns.end + self.dims[0] * j].iter()
            })
        };
        let mut best = NONE;
        for bucket in buckets() {
            if bucket.top_mm > best {
                best = bucket.vertices.iter().fold(best, |best, p| best.max(self.over_vertex(p, at)));
            }
        }
        for bucket in buckets() {
            // neither reaches above a bucket's highest point
            if bucket.top_mm > best {
                let facets = bucket.facets.iter().filter(|(f, _)| f[0].z.max(f[1].z).max(f[2].z) > best);
                best = facets.map(|(facet, n)| self.over_facet(facet, n, at)).fold(best, f64::max);
            }
            if bucket.top_mm > best {
                for [p, q] in &bucket.edges {
                    if p.z.max(q.z) > best {
                        best = best.max(self.over_edge(p, q, at, best));
                    }
                }
            }
        }
        best
    }

    /// f at a distance from the axis, mm.
    fn profile(&self, distance: f64) -> f64 {
        let into = distance - (self.radius_mm - self.corner_mm);
        if into <= 0.0 {
            0.0
        } else {
            self.corner_mm - (self.corner_mm * self.corner_mm - into * into).max(0.0).sqrt()
        }
    }

    fn over_vertex(&self, p: &Vector3<f64>, at: [f64; 2]) -> f64 {
        let distance2 = (p.x - at[0]).powi(2) + (p.y - at[1]).powi(2);
        if distance2 > self.radius_mm * self.radius_mm {
            return NONE;
        }
        if self.corner_mm == 0.0 { p.z } else { p.z - self.profile(distance2.sqrt()) }
    }

    fn over_facet(&self, [a, b, c]: &Facet, n: &Vector3<f64>, at: [f64; 2]) -> f64 {
        let flat = (n.x * n.x + n.y * n.y).sqrt();
        let reach =
            self.corner_mm + if flat > 1e-12 { (self.radius_mm - self.corner_mm) / flat } else { 0.0 };
        let (u, v) = (at[0] - reach * n.x, at[1] - reach * n.y);
        let left =
            |p: &Vector3<f64>, q: &Vector3<f64>| (q.x - p.x) * (v - p.y) - (q.y - p.y) * (u - p.x) >= 0.0;
        if !(left(a, b) && left(b, c) && left(c, a)) {
            return NONE;
        }
        let contact = a.z - (n.x * (u - a.x) + n.y * (v - a.y)) / n.z;
        contact - self.corner_mm * (1.0 - n.z)
    }

    fn over_edge(&self, p: &Vector3<f64>, q: &Vector3<f64>, at: [f64; 2], best: f64) -> f64 {
        let (du, dv, dw) = (q.x - p.x, q.y - p.y, q.z - p.z);
        let length = (du * du + dv * dv).sqrt();
        if length < 1e-12 {
            return NONE;
        }
        // along the edge from the foot of the axis
        let foot = ((at[0] - p.x) * du + (at[1] - p.y) * dv) / length;
        let off2 = (at[0] - p.x).powi(2) + (at[1] - p.y).powi(2) - foot * foot;
        let half2 = self.radius_mm * self.radius_mm - off2;
        if half2 <= 0.0 {
            return NONE;
        }
        let (low, high) = ((foot - half2.sqrt()).max(0.0), (foot + half2.sqrt()).min(length));
        if low > high {
            return NONE;
        }
        let slope = dw / length;
        let height = |t: f64| p.z + slope * t;
        if self.corner_mm == 0.0 {
            return height(low).max(height(high));
        }
        let distance = |t: f64| (off2.max(0.0) + (t - foot) * (t - foot)).sqrt();
        let nearest = foot.clamp(low, high);
        if height(low).max(height(high)) - self.profile(distance(nearest)) <= best {
            return NONE;
        }
        // slope − f'(r) (t − foot)/r falls with t
        let rising = |t: f64| {
            let r = distance(t);
            let into = (r - (self.radius_mm - self.corner_mm)).max(0.0);
            let root = (self.corner_mm * self.corner_mm - into * into).max(1e-18).sqrt();
            slope - into / root * (t - foot) / r.max(1e-12) > 0.0
        };
        let (mut a, mut b) = (low, high);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (a + b);
            if rising(middle) { a = middle } else { b = middle }
        }
        let t = 0.5 * (a + b);
        height(t) - self.profile(distance(t))
    }
}
