//! Prostheses that can be drawn again: shells of two curvatures with bevelled, irregular outlines.
//!
//! Radii, lengths and thicknesses follow the statistics of 25 opercula. Outer and inner side are
//! y = −s(x; Rx) − s(z; Rz) with the sagitta s(u; R) = R − √(R² − u²), the inner one a thickness below; each ends at its own outline, and
//! the rim between the two outlines is straight. The part is then inclined, as a skull's scan gives it.
//!
//! **Source:** Castelli et al. 2020, Table 1 and figure 1. Radii are log-normal with the table's mean and deviation, lengths triangular
//! between the table's least, mode and greatest, thicknesses normal; all cut off at the table's greatest. The table's row Ry_int
//! contradicts itself (25 values with a mean of 100 and one of 2848), so Rx_int's row stands for both. The outline's
//! waves and the inclination are assumed.

use std::f64::consts::{PI, TAU};

use bonemill_geometry::{Mesh, Part, Point};
use nalgebra::{Rotation3, Vector3};
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::{RngCore, SeedableRng};

/// Number of seeds whose prostheses stand for the published set, from 1.
pub const PUBLISHED_SET: u64 = 25;
/// Least thickness at the rim, as a share of that in the middle; draws with less are drawn again.
const LEAST_RIM_SHARE: f64 = 0.6;
/// Largest inclination of the scan, rad.
const LARGEST_INCLINATION_RAD: f64 = PI / 4.0;
/// Waves of the outline: from 2 to 5 around, the first of this share of the radius, the others less by their number.
const WAVE_SHARE: f64 = 0.1;

/// Measures of a prosthesis, by the paper's directions x and y, which are x and z here.
#[derive(Debug, Clone, PartialEq)]
pub struct Operculum {
    /// Radii of the outer side, mm.
    pub outer_radius_mm: [f64; 2],
    /// Radii of the inner side, mm.
    pub inner_radius_mm: [f64; 2],
    /// Lengths of the outer side, mm.
    pub outer_length_mm: [f64; 2],
    /// Lengths of the inner side, mm.
    pub inner_length_mm: [f64; 2],
    /// Thickness in the middle, mm.
    pub thickness_mm: f64,
    /// Amplitude, as a share of the radius, and phase, rad, of the outline's waves, from two around upwards.
    pub waves: Vec<[f64; 2]>,
    /// How the scan inclines it.
    pub inclination: Rotation3<f64>,
}

impl Operculum {
    /// The prosthesis of a seed; seeds 1 to [`PUBLISHED_SET`] stand for the published set.
    pub fn drawn(seed: u64) -> Self {
        let mut draw = Draw(Xoshiro256PlusPlus::seed_from_u64(seed));
        loop {
            let shape = draw.operculum();
            if shape.rim_share() >= LEAST_RIM_SHARE {
                return shape;
            }
        }
    }

    /// The prosthesis of the published experiment, R 238 to 255 mm (section 5). Its lengths and thickness are not published: the
    /// means of Table 1; its outline and inclination are those of seed 1.
    pub fn reference() -> Self {
        Self {
            outer_radius_mm: [252.0, 255.0],
            inner_radius_mm: [238.0, 244.0],
            outer_length_mm: [29.68, 27.6],
            inner_length_mm: [30.76, 28.12],
            thickness_mm: 9.9,
            ..Self::drawn(1)
        }
    }

    /// The closed surface, of about `facets` facets.
    pub fn mesh(&self, facets: usize) -> Mesh<Part> {
        // two grids of n × n squares and a rim of 4 n × n / 3
        let n = ((facets as f64 / (4.0 + 8.0 / 3.0)).sqrt().round() as usize).max(4);
        let rows = (n / 3).max(1);
        let mut surface = Surface { n, vertices: Vec::new(), triangles: Vec::new() };
        let outer = surface.sheet(false, |at| self.outer_point(at));
        let inner = surface.sheet(true, |at| self.inner_point(at));
        surface.rim(&outer, &inner, rows);
        let vertices = surface.vertices.iter().map(|v| Point::from_coords(self.inclination * v)).collect();
        Mesh { vertices, triangles: surface.triangles }
    }

    /// The least thickness at the rim over that in the middle.
    fn rim_share(&self) -> f64 {
        let thickness = |k: usize| {
            let u = 0.5 * self.outer_length_mm[k].max(self.inner_length_mm[k]);
            self.thickness_mm + sagitta(u, self.inner_radius_mm[k]) - sagitta(u, self.outer_radius_mm[k])
        };
        thickness(0).min(thickness(1)) / self.thickness_mm
    }

    fn outer_point(&self, at: [f64; 2]) -> Vector3<f64> {
        self.point(at, self.outer_length_mm, self.outer_radius_mm, 0.0)
    }

    fn inner_point(&self, at: [f64; 2]) -> Vector3<f64> {
        self.point(at, self.inner_length_mm, self.inner_radius_mm, self.thickness_mm)
    }

    /// The point of a side over a point of the unit disc.
    fn point(&self, at: [f64; 2], length_mm: [f64; 2], radius_mm: [f64; 2], below_mm: f64) -> Vector3<f64> {
        let angle = at[1].atan2(at[0]);
        let waves =
            self.waves.iter().zip(2..).map(|([a, phase], k)| a * (f64::from(k) * angle + phase).cos());
        let scale = 0.5 * (1.0 + waves.sum::<f64>());
        let (x, z) = (at[0] * scale * length_mm[0], at[1] * scale * length_mm[1]);
        Vector3::new(x, -sagitta(x, radius_mm[0]) - sagitta(z, radius_mm[1]) - below_mm, z)
    }
}

/// s(u; R) = R − √(R² − u²), mm.
fn sagitta(u_mm: f64, radius_mm: f64) -> f64 {
    radius_mm - (radius_mm * radius_mm - u_mm * u_mm).max(0.0).sqrt()
}

/// A mesh being built.
struct Surface {
    n: usize,
    vertices: Vec<Vector3<f64>>,
    triangles: Vec<[u32; 3]>,
}

impl Surface {
    /// A side over the unit disc, as (n + 1)² vertices; facing +y, or −y when turned. The numbers of its border, around +y.
    fn sheet(&mut self, turned: bool, point: impl Fn([f64; 2]) -> Vector3<f64>) -> Vec<u32> {
        let (n, first) = (self.n, self.vertices.len());
        let number = |u: usize, v: usize| (first + u * (n + 1) + v) as u32;
        let grid = |k: usize| 2.0 * k as f64 / n as f64 - 1.0;
        for (u, v) in (0..=n).flat_map(|u| (0..=n).map(move |v| (u, v))) {
            self.vertices.push(point(disc([grid(u), grid(v)])));
        }
        for (u, v) in (0..n).flat_map(|u| (0..n).map(move |v| (u, v))) {
            let corners = [number(u, v), number(u, v + 1), number(u + 1, v + 1), number(u + 1, v)];
            // z toward x is around +y; the diagonal runs outwards, along the map's own lines
            let outwards = (2 * u < n) == (2 * v < n);
            let split = if outwards { [[0, 1, 2], [0, 2, 3]] } else { [[0, 1, 3], [1, 2, 3]] };
            self.push(split.map(|t| t.map(|k| corners[k])), turned);
        }
        let sides = (0..n).map(|k| number(0, k)).chain((0..n).map(|k| number(k, n)));
        sides.chain((0..n).map(|k| number(n, n - k))).chain((0..n).map(|k| number(n - k, 0))).collect()
    }

    /// The rim between two borders of equal length, in so many rows.
    fn rim(&mut self, outer: &[u32], inner: &[u32], rows: usize) {
        let mut above = outer.to_vec();
        for row in 1..=rows {
            let share = row as f64 / rows as f64;
            let first = self.vertices.len() as u32;
            let below: Vec<u32> =
                if row == rows { inner.to_vec() } else { (first..first + outer.len() as u32).collect() };
            if row < rows {
                let between = outer.iter().zip(inner).map(|(a, b)| {
                    let (a, b) = (self.vertices[*a as usize], self.vertices[*b as usize]);
                    a + (b - a) * share
                });
                let between: Vec<_> = between.collect();
                self.vertices.extend(between);
            }
            for k in 0..above.len() {
                let next = (k + 1) % above.len();
                self.push([[above[k], below[k], below[next]], [above[k], below[next], above[next]]], false);
            }
            above = below;
        }
    }

    fn push(&mut self, pair: [[u32; 3]; 2], turned: bool) {
        self.triangles.extend(pair.map(|[a, b, c]| if turned { [a, c, b] } else { [a, b, c] }));
    }
}

/// The unit square onto the unit disc, squares to circles.
///
/// **Source:** Shirley and Chiu 1997, A low distortion map between disk and square.
fn disc([u, v]: [f64; 2]) -> [f64; 2] {
    if u == 0.0 && v == 0.0 {
        return [0.0, 0.0];
    }
    let (radius, angle) =
        if u.abs() > v.abs() { (u, PI / 4.0 * (v / u)) } else { (v, PI / 2.0 - PI / 4.0 * (u / v)) };
    [radius * angle.cos(), radius * angle.sin()]
}

/// Draws from a fixed generator.
struct Draw(Xoshiro256PlusPlus);

impl Draw {
    fn operculum(&mut self) -> Operculum {
        let outer_length_mm = [self.triangular(19.0, 30.0, 45.0), self.triangular(19.0, 25.0, 38.0)];
        let inner_length_mm = [self.triangular(20.0, 31.0, 47.0), self.triangular(17.0, 32.0, 50.0)];
        // outer and inner side belong to one bone: the inner lengths follow the outer ones' place in their ranges
        let inner_length_mm = [0, 1].map(|k| {
            let within = inner_length_mm[k] - outer_length_mm[k];
            outer_length_mm[k] + within.clamp(-3.0, 3.0)
        });
        let least = [0, 1].map(|k| outer_length_mm[k].max(inner_length_mm[k]));
        let outer_radius_mm =
            [self.radius(82.4, 38.78, [least[0], 196.0]), self.radius(78.8, 45.038, [least[1], 214.0])];
        let inner_radius_mm =
            [self.radius(85.08, 93.532, [least[0], 500.0]), self.radius(85.08, 93.532, [least[1], 500.0])];
        let thickness_mm =
            0.5 * (self.normal_within(9.8, 1.5, [6.0, 12.0]) + self.normal_within(10.0, 1.5, [6.0, 12.0]));
        let waves = (2..6).map(|k| [WAVE_SHARE / f64::from(k) * self.unit(), TAU * self.unit()]).collect();
        let axis = Vector3::new(self.normal(), self.normal(), self.normal());
        let axis = axis.try_normalize(1e-9).unwrap_or_else(Vector3::x);
        let inclination = Rotation3::new(axis * (LARGEST_INCLINATION_RAD * self.unit()));
        Operculum {
            outer_radius_mm,
            inner_radius_mm,
            outer_length_mm,
            inner_length_mm,
            thickness_mm,
            waves,
            inclination,
        }
    }

    /// Uniform in [0, 1).
    fn unit(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 * (1.0 / (1_u64 << 53) as f64)
    }

    /// Standard normal (Box and Muller 1958).
    fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.unit()).ln()).sqrt();
        radius * (TAU * self.unit()).cos()
    }

    fn normal_within(&mut self, mean: f64, deviation: f64, [low, high]: [f64; 2]) -> f64 {
        within([low, high], || mean + deviation * self.normal())
    }

    /// Log-normal with this mean and deviation, cut off.
    fn radius(&mut self, mean_mm: f64, deviation_mm: f64, range_mm: [f64; 2]) -> f64 {
        let variance = (1.0 + (deviation_mm / mean_mm).powi(2)).ln();
        let location = mean_mm.ln() - 0.5 * variance;
        within(range_mm, || (location + variance.sqrt() * self.normal()).exp())
    }

    /// Triangular: its distribution function inverted.
    fn triangular(&mut self, least: f64, mode: f64, greatest: f64) -> f64 {
        let (u, width) = (self.unit(), greatest - least);
        let share = (mode - least) / width;
        if u < share {
            least + (u * width * (mode - least)).sqrt()
        } else {
            greatest - ((1.0 - u) * width * (greatest - mode)).sqrt()
        }
    }
}

/// The first draw within the range; at its nearer end after many in vain.
fn within([low, high]: [f64; 2], mut draw: impl FnMut() -> f64) -> f64 {
    let mut last = low;
    for _ in 0..1000 {
        last = draw();
        if (low..=high).contains(&last) {
            return last;
        }
    }
    last.clamp(low, high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::part::{Facets, RepairLimits, Solid};

    fn facets(mesh: &Mesh<Part>) -> Facets {
        Facets::new(mesh.vertices.iter().map(|v| v.coords.into()).collect(), mesh.triangles.clone())
    }

    #[test]
    fn every_prosthesis_is_a_sound_solid_within_the_table() {
        for seed in 1..=PUBLISHED_SET {
            let shape = Operculum::drawn(seed);
            assert_eq!(shape, Operculum::drawn(seed));
            let solid =
                Solid::from_facets(facets(&shape.mesh(2000)), None, &RepairLimits::default()).unwrap();
            assert_eq!((solid.changes.len(), solid.shallow_crossings), (0, 0), "seed {seed}");
            let [lx, lz] = shape.outer_length_mm;
            assert!((19.0..=45.0).contains(&lx) && (19.0..=38.0).contains(&lz), "{shape:?}");
            let (area, volume) = (PI / 4.0 * lx * lz, solid.mesh.volume_mm3());
            assert!(
                (0.6..1.4).contains(&(volume / (area * shape.thickness_mm))),
                "seed {seed}: {volume} mm³"
            );
        }
    }

    #[test]
    fn the_set_has_the_tables_means() {
        let set: Vec<Operculum> = (1..=PUBLISHED_SET).map(Operculum::drawn).collect();
        let mean = |of: &dyn Fn(&Operculum) -> f64| set.iter().map(of).sum::<f64>() / set.len() as f64;
        // three standard errors of a mean of 25
        assert!((mean(&|s| s.outer_length_mm[0]) - 31.3).abs() < 4.0);
        assert!((mean(&|s| s.outer_length_mm[1]) - 27.3).abs() < 3.0);
        assert!((mean(&|s| s.thickness_mm) - 9.9).abs() < 0.8);
        assert!((mean(&|s| s.outer_radius_mm[0]) - 82.4).abs() < 25.0);
    }

    #[test]
    fn the_number_of_facets_is_about_what_is_asked_for() {
        for asked in [500, 5000, 200_000] {
            let found = Operculum::reference().mesh(asked).triangles.len();
            assert!((0.9..1.1).contains(&(found as f64 / asked as f64)), "{found} of {asked}");
        }
    }
}
