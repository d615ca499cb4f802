//! The part's silhouette along the cutter, exactly, its offsets, and the distance to it over a raster.
//!
//! The silhouette is the union of the projected facets that face the cutter, by i_overlay; offsets have round corners whose chords stay within
//! R (0.01 π)²/8, 0.2 µm for a cutter of 3 mm. Loops are counter-clockwise, those around holes clockwise.
//!
//! **Source:** Castelli et al. 2020, section 4.2, offset the outline of an alpha shape; the union needs no such radius.

use i_overlay::core::fill_rule::FillRule;
use i_overlay::float::simplify::SimplifyShape;
use i_overlay::mesh::outline::offset::OutlineOffset;
use i_overlay::mesh::style::{LineJoin, OutlineStyle};

use crate::machining::envelope::Facet;
use crate::machining::raster::CellRaster;

/// Loops below this area are specks between facets, mm².
const LEAST_AREA_MM2: f64 = 1e-3;

/// A closed polygon, mm.
pub type Loop = Vec<[f64; 2]>;

/// The outlines of a part, seen from the front.
#[derive(Debug, Clone)]
pub struct Silhouette {
    shapes: Vec<Vec<Loop>>,
}

impl Silhouette {
    /// Of the facets of a closed mesh.
    pub fn of(facets: &[Facet]) -> Self {
        let flat = |facet: &Facet| facet.map(|p| [p.x, p.y]).to_vec();
        let upward = facets.iter().filter(|[a, b, c]| (b - a).cross(&(c - a)).z > 0.0);
        let triangles: Vec<Loop> = upward.map(flat).collect();
        let mut shapes: Vec<Vec<Loop>> = triangles.simplify_shape(FillRule::NonZero);
        for shape in &mut shapes {
            shape.retain(|outline| area_mm2(outline).abs() > LEAST_AREA_MM2);
        }
        shapes.retain(|shape| !shape.is_empty());
        Self { shapes }
    }

    /// All outlines, outer ones first in each piece.
    pub fn loops(&self) -> impl Iterator<Item = &Loop> {
        self.shapes.iter().flatten()
    }

    /// The outlines of all points within `radius_mm`.
    pub fn offset(&self, radius_mm: f64) -> Vec<Loop> {
        let style = OutlineStyle::new(radius_mm).line_join(LineJoin::Round(0.01 * std::f64::consts::PI));
        let grown: Vec<Vec<Loop>> = self.shapes.outline(&style);
        grown.into_iter().flatten().filter(|outline| area_mm2(outline).abs() > LEAST_AREA_MM2).collect()
    }
}

/// Signed area, mm²: above 0 counter-clockwise.
pub fn area_mm2(outline: &[[f64; 2]]) -> f64 {
    let next = outline.iter().cycle().skip(1);
    outline.iter().zip(next).map(|(a, b)| 0.5 * (a[0] * b[1] - b[0] * a[1])).sum()
}

/// Length of a closed polygon, mm.
pub fn length_mm(outline: &[[f64; 2]]) -> f64 {
    let next = outline.iter().cycle().skip(1);
    outline.iter().zip(next).map(|(a, b)| (b[0] - a[0]).hypot(b[1] - a[1])).sum()
}

/// Points along closed polygons, at most `step_mm` apart, corners included.
pub fn sampled(outline: &[[f64; 2]], step_mm: f64) -> Loop {
    let mut points = Vec::new();
    let next = outline.iter().cycle().skip(1);
    for (a, b) in outline.iter().zip(next) {
        let length = (b[0] - a[0]).hypot(b[1] - a[1]);
        let pieces = (length / step_mm).ceil().max(1.0) as usize;
        let part = |n: usize| n as f64 / pieces as f64;
        points.extend((0..pieces).map(|n| [a[0] + part(n) * (b[0] - a[0]), a[1] + part(n) * (b[1] - a[1])]));
    }
    points
}

/// The nearest of some points for every cell, to within a fraction of a cell.
#[derive(Debug, Clone)]
pub struct NearestPoints {
    /// Number of the nearest point.
    pub point: Vec<u32>,
    /// Distance to it, mm.
    pub distance_mm: Vec<f64>,
}

impl NearestPoints {
    /// Two sweeps over the raster; every cell tries the points of its neighbours.
    ///
    /// **Source:** Danielsson 1980, "Euclidean distance mapping".
    pub fn of(raster: &CellRaster, points: &[[f64; 2]]) -> Self {
        let mut found = Self { point: vec![0; raster.len()], distance_mm: raster.filled(f64::INFINITY) };
        // every point is tried by the 5 × 5 cells around it
        let reach = 2.5 * raster.pitch_mm;
        for (n, p) in points.iter().enumerate() {
            for j in raster.span(1, p[1] - reach, p[1] + reach) {
                for i in raster.span(0, p[0] - reach, p[0] + reach) {
                    found.offer(raster, points, i + raster.dims[0] * j, n as u32);
                }
            }
        }
        let [nu, nv] = raster.dims;
        for pass in 0..4 {
            for step in 0..nu * nv {
                let cell = if pass % 2 == 0 { step } else { nu * nv - 1 - step };
                found.relax(raster, points, cell);
            }
        }
        found
    }

    fn offer(&mut self, raster: &CellRaster, points: &[[f64; 2]], cell: usize, n: u32) {
        let (c, p) = (raster.centre_of(cell), points[n as usize]);
        let distance = (c[0] - p[0]).hypot(c[1] - p[1]);
        if distance < self.distance_mm[cell] {
            (self.distance_mm[cell], self.point[cell]) = (distance, n);
        }
    }

    fn relax(&mut self, raster: &CellRaster, points: &[[f64; 2]], cell: usize) {
        let [nu, nv] = raster.dims;
        let (i, j) = (cell % nu, cell / nu);
        for j in j.saturating_sub(1)..(j + 2).min(nv) {
            for i in i.saturating_sub(1)..(i + 2).min(nu) {
                let neighbour = i + nu * j;
                if self.distance_mm[neighbour].is_finite() {
                    self.offer(raster, points, cell, self.point[neighbour]);
                }
            }
        }
    }
}
