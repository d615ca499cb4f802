//! Pictures of a mesh and of moves, drawn into pixels: a shaded or coloured surface with hidden parts hidden, and lines.
//!
//! A view maps the block's frame to the picture's plane and keeps the depth along the line of sight; surfaces go through a
//! depth buffer. Scales are stated by a bar of 10 mm, which the page draws.

use base64::Engine;
use bonemill_geometry::{Block, Mesh};
use bonemill_planfile::page;
use nalgebra::{Matrix3, Vector3};

/// Width of a picture, pixels.
const WIDTH: usize = 720;

/// Height of the strip with the scale, pixels.
const SCALE_STRIP: usize = 40;

/// Red, green, blue.
pub(crate) type Colour = [u8; 3];

/// From where one looks: rows are the directions to the right, upwards and toward the viewer.
#[derive(Debug, Clone, Copy)]
pub(crate) struct View(pub Matrix3<f64>);

impl View {
    /// Onto side A, from +y: x to the right, −z upwards.
    pub(crate) fn side_a() -> Self {
        Self(Matrix3::new(1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.0))
    }

    /// Onto side B, from −y: x to the right, z upwards.
    pub(crate) fn side_b() -> Self {
        Self(Matrix3::new(1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, -1.0, 0.0))
    }

    /// From above and aside, z upwards.
    pub(crate) fn oblique() -> Self {
        let toward = Vector3::new(-0.45, 0.75, 0.5).normalize();
        let right = Vector3::z().cross(&toward).normalize();
        Self(Matrix3::from_rows(&[right.transpose(), toward.cross(&right).transpose(), toward.transpose()]))
    }
}

/// A picture being drawn.
pub(crate) struct Picture {
    view: View,
    /// Pixels a mm.
    scale: f64,
    low: [f64; 2],
    width: usize,
    height: usize,
    pixels: Vec<Colour>,
    depth: Vec<f64>,
}

impl Picture {
    /// An empty one that holds a box of the block's frame.
    pub(crate) fn of_box(view: View, low_mm: &Vector3<f64>, high_mm: &Vector3<f64>) -> Self {
        let corners = box_corners(low_mm, high_mm).map(|c| view.0 * c);
        let far = Vector3::repeat(f64::INFINITY);
        let (low, high) = corners.iter().fold((far, -far), |(l, h), c| (l.inf(c), h.sup(c)));
        let margin_mm = 0.03 * (high - low).max();
        let size = high - low + Vector3::repeat(2.0 * margin_mm);
        let scale = WIDTH as f64 / size.x.max(1e-6);
        let height = ((size.y * scale).ceil() as usize).clamp(1, 4 * WIDTH);
        Self {
            view,
            scale,
            low: [low.x - margin_mm, low.y - margin_mm],
            width: WIDTH,
            height,
            pixels: vec![[255; 3]; WIDTH * height],
            depth: vec![f64::NEG_INFINITY; WIDTH * height],
        }
    }

    /// Pixel and depth of a point.
    fn project(&self, p: &Vector3<f64>) -> Vector3<f64> {
        let v = self.view.0 * p;
        let (x, y) = ((v.x - self.low[0]) * self.scale, (v.y - self.low[1]) * self.scale);
        Vector3::new(x, self.height as f64 - y, v.z)
    }

    /// A surface, each vertex in its colour, shaded by its inclination to the line of sight.
    pub(crate) fn surface(&mut self, mesh: &Mesh<Block>, colour: impl Fn(usize) -> Colour) {
        let points: Vec<Vector3<f64>> = mesh.vertices.iter().map(|v| self.project(&v.coords)).collect();
        for t in &mesh.triangles {
            let [a, b, c] = t.map(|v| mesh.vertices[v as usize].coords);
            let normal = self.view.0 * (b - a).cross(&(c - a));
            let Some(normal) = normal.try_normalize(0.0).filter(|n| n.z > 0.0) else { continue };
            let light = 0.35 + 0.65 * normal.dot(&Vector3::new(-0.3, 0.5, 0.81)).max(0.0);
            let colours = t.map(|v| colour(v as usize).map(f64::from));
            self.triangle(t.map(|v| points[v as usize]), |w: [f64; 3]| {
                [0, 1, 2].map(|k| {
                    (light * (0..3).map(|n| w[n] * colours[n][k]).sum::<f64>()).clamp(0.0, 255.0) as u8
                })
            });
        }
    }

    /// Fills a triangle; `shade` takes the three corners' weights.
    fn triangle(&mut self, [a, b, c]: [Vector3<f64>; 3], shade: impl Fn([f64; 3]) -> Colour) {
        let area = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
        if area == 0.0 {
            return;
        }
        let (low, high) = (a.inf(&b).inf(&c), a.sup(&b).sup(&c));
        let clamp = |v: f64, most: usize| v.clamp(0.0, most as f64) as usize;
        for y in clamp(low.y.floor(), self.height)..clamp(high.y.ceil() + 1.0, self.height) {
            for x in clamp(low.x.floor(), self.width)..clamp(high.x.ceil() + 1.0, self.width) {
                let (px, py) = (x as f64 + 0.5, y as f64 + 0.5);
                let weight = |p: &Vector3<f64>, q: &Vector3<f64>| {
                    ((q.x - p.x) * (py - p.y) - (q.y - p.y) * (px - p.x)) / area
                };
                let w = [weight(&b, &c), weight(&c, &a), weight(&a, &b)];
                if w.iter().all(|w| *w >= -1e-9) {
                    let depth = w[0] * a.z + w[1] * b.z + w[2] * c.z;
                    self.put(x, y, depth, shade(w));
                }
            }
        }
    }

    fn put(&mut self, x: usize, y: usize, depth: f64, colour: Colour) {
        if x >= self.width || y >= self.height {
            return;
        }
        let at = y * self.width + x;
        if depth >= self.depth[at] {
            self.depth[at] = depth;
            self.pixels[at] = colour;
        }
    }

    /// A line two pixels wide, hidden where something lies before it.
    pub(crate) fn line(&mut self, from: &Vector3<f64>, to: &Vector3<f64>, colour: Colour) {
        let (a, b) = (self.project(from), self.project(to));
        let steps = (b - a).xy().amax().ceil().clamp(1.0, 8.0 * WIDTH as f64);
        for n in 0..=steps as usize {
            let p = a + (b - a) * (n as f64 / steps);
            if p.x >= 0.0 && p.y >= 0.0 {
                for (x, y) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                    self.put(p.x as usize + x, p.y as usize + y, p.z, colour);
                }
            }
        }
    }

    /// The edges of a box.
    pub(crate) fn frame(&mut self, low_mm: &Vector3<f64>, high_mm: &Vector3<f64>, colour: Colour) {
        let corners = box_corners(low_mm, high_mm);
        for (a, b) in (0..8).flat_map(|a| [1, 2, 4].map(|bit| (a, a | bit))).filter(|(a, b)| a != b) {
            self.line(&corners[a], &corners[b], colour);
        }
    }

    /// As an SVG figure with a bar of 10 mm; `caption` is plain text.
    pub(crate) fn figure(&self, caption: &str) -> String {
        let (w, h) = (self.width, self.height);
        // below the picture, so that it lies on none of its lines
        let (whole, y, bar) = (h + SCALE_STRIP, h as f64 + 28.0, 10.0 * self.scale);
        format!(
            "<figure><figcaption>{caption}</figcaption><svg class=\"drawn\" viewBox=\"0 0 {w} {whole}\" role=\"img\" aria-label=\"{caption}\">\
             <image width=\"{w}\" height=\"{h}\" href=\"data:image/png;base64,{}\"/>\
             <rect x=\"14\" y=\"{:.1}\" width=\"{bar:.1}\" height=\"5\" fill=\"#222\"/>\
             <text x=\"{:.1}\" y=\"{:.1}\" font-size=\"20\" fill=\"#222\">10 mm</text></svg></figure>",
            base64::engine::general_purpose::STANDARD.encode(page::png(w, h, self.pixels.as_flattened())),
            y - 12.0,
            bar + 24.0,
            y - 2.0
        )
    }
}

fn box_corners(low: &Vector3<f64>, high: &Vector3<f64>) -> [Vector3<f64>; 8] {
    std::array::from_fn(|n| {
        let at = |axis: usize| if n >> axis & 1 == 1 { high[axis] } else { low[axis] };
        Vector3::new(at(0), at(1), at(2))
    })
}
