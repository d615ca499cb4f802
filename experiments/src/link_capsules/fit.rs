//! Capsules that enclose a link's mesh, and the proof that they do.
//!
//! The mesh is cut into pieces with edges of at most [`EDGE_MM`]. Each piece belongs to one capsule; a capsule is convex, so it
//! holds a piece if it holds its three corners, and the capsules hold the mesh if every piece lies in one of them. For given
//! axes and pieces the radii follow; the axes are moved by random steps, and the pieces go to the capsule that holds them
//! with the least growth, until the sum of the capsules' volumes no longer falls.

use bonemill_geometry::capsule::point_segment_mm;
use nalgebra::Vector3;

use crate::arms::Stream;

/// Longest edge of a piece, mm.
const EDGE_MM: f64 = 12.0;
/// Random starts, and steps from each.
const STARTS: usize = 24;
const STEPS: usize = 1500;
/// Pieces that the axes are fitted to; the radii are of all.
const FITTED_TO: usize = 400;
/// Largest step at first and at last, mm.
const STEP_MM: [f64; 2] = [25.0, 0.3];
/// Radii are rounded up to this, mm.
const ROUND_MM: f64 = 0.1;
/// Steps of the sampled surface, mm.
const SAMPLE_MM: f64 = 4.0;

/// A triangle's corners, mm.
pub(super) type Triangle = [Vector3<f64>; 3];

/// An axis and a radius, mm.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fitted {
    pub axis: [Vector3<f64>; 2],
    pub radius_mm: f64,
}

impl Fitted {
    fn volume_mm3(&self) -> f64 {
        let length_mm = (self.axis[1] - self.axis[0]).norm();
        std::f64::consts::PI * self.radius_mm.powi(2) * (length_mm + 4.0 / 3.0 * self.radius_mm)
    }

    fn farthest_mm(&self, piece: &Triangle) -> f64 {
        piece.iter().map(|p| point_segment_mm(p, &self.axis[0], &self.axis[1])).fold(0.0, f64::max)
    }
}

/// The triangle, cut until no edge is longer than [`EDGE_MM`].
fn cut(triangle: Triangle, pieces: &mut Vec<Triangle>) {
    let [a, b, c] = triangle;
    let edges = [(b - a).norm(), (c - b).norm(), (a - c).norm()];
    let longest = (0..3).max_by(|m, n| edges[*m].total_cmp(&edges[*n])).unwrap_or(0);
    if edges[longest] <= EDGE_MM {
        pieces.push(triangle);
        return;
    }
    let [a, b, c] = [triangle[longest], triangle[(longest + 1) % 3], triangle[(longest + 2) % 3]];
    let middle = 0.5 * (a + b);
    cut([a, middle, c], pieces);
    cut([middle, b, c], pieces);
}

/// Pieces of a mesh.
pub(super) fn pieces(mesh: &[Triangle]) -> Vec<Triangle> {
    let mut pieces = Vec::new();
    mesh.iter().for_each(|triangle| cut(*triangle, &mut pieces));
    pieces
}

/// The capsules with the least volume that were found, so many of them.
pub(super) fn fitted(pieces: &[Triangle], count: usize, seed: u64) -> Vec<Fitted> {
    let mut random = Stream(seed);
    let some: Vec<Triangle> = pieces.iter().step_by(pieces.len().div_ceil(FITTED_TO).max(1)).copied().collect();
    let pieces = &some[..];
    let mut best: Option<(f64, Vec<Fitted>)> = None;
    let corner =
        |random: &mut Stream| pieces[(random.next() * pieces.len() as f64) as usize % pieces.len()][0];
    for _ in 0..STARTS {
        let mut axes: Vec<[Vector3<f64>; 2]> =
            (0..count).map(|_| [corner(&mut random), corner(&mut random)]).collect();
        let (mut volume, mut capsules) = enclosing(pieces, &axes);
        for step in 0..STEPS {
            let share = step as f64 / STEPS as f64;
            let size_mm = STEP_MM[0] * (STEP_MM[1] / STEP_MM[0]).powf(share);
            let mut moved = axes.clone();
            let which = (random.next() * count as f64) as usize % count;
            let mut offset = || Vector3::from_fn(|_, _| (2.0 * random.next() - 1.0) * size_mm);
            let [first, second] = [offset(), offset()];
            // both ends together, or one alone
            match step % 3 {
                0 => moved[which] = moved[which].map(|end| end + first),
                n => moved[which][n - 1] += second,
            }
            let found = enclosing(pieces, &moved);
            if found.0 < volume {
                (volume, capsules) = found;
                axes = moved;
            }
        }
        if best.as_ref().is_none_or(|(least, _)| volume < *least) {
            best = Some((volume, capsules));
        }
    }
    best.map(|(_, capsules)| capsules).unwrap_or_default()
}

/// The radii about given axes that hold every piece, and the volume: pieces go, the farthest from all axes first, to the capsule
/// whose volume grows least.
fn enclosing(pieces: &[Triangle], axes: &[[Vector3<f64>; 2]]) -> (f64, Vec<Fitted>) {
    let mut capsules: Vec<Fitted> = axes.iter().map(|axis| Fitted { axis: *axis, radius_mm: 0.0 }).collect();
    let mut farthest: Vec<Vec<f64>> =
        pieces.iter().map(|piece| capsules.iter().map(|c| c.farthest_mm(piece)).collect()).collect();
    let least = |mm: &[f64]| mm.iter().copied().fold(f64::INFINITY, f64::min);
    farthest.sort_by(|a, b| least(b).total_cmp(&least(a)));
    for mm in &farthest {
        if capsules.iter().zip(mm).any(|(capsule, mm)| *mm <= capsule.radius_mm) {
            continue;
        }
        let growth = |n: usize| {
            let grown = Fitted { radius_mm: mm[n], ..capsules[n] };
            grown.volume_mm3() - capsules[n].volume_mm3()
        };
        let n = (0..capsules.len()).min_by(|m, n| growth(*m).total_cmp(&growth(*n))).unwrap_or(0);
        capsules[n].radius_mm = mm[n];
    }
    (capsules.iter().map(Fitted::volume_mm3).sum(), capsules)
}

/// The capsules with axes to 0.1 mm and radii rounded up, such that they surely hold every piece.
pub(super) fn rounded(pieces: &[Triangle], capsules: &[Fitted]) -> Vec<Fitted> {
    let tenth = |mm: f64| (mm * 10.0).round() / 10.0;
    let axes: Vec<_> = capsules.iter().map(|c| c.axis.map(|end| end.map(tenth))).collect();
    let (_, mut found) = enclosing(pieces, &axes);
    for capsule in &mut found {
        capsule.radius_mm = (capsule.radius_mm / ROUND_MM + 1e-6).ceil() * ROUND_MM;
    }
    found
}

/// Pieces that lie in no capsule: none if the mesh is enclosed.
pub(super) fn outside(pieces: &[Triangle], capsules: &[Fitted]) -> usize {
    let held = |piece: &Triangle| capsules.iter().any(|c| c.farthest_mm(piece) <= c.radius_mm);
    pieces.iter().filter(|piece| !held(piece)).count()
}

/// The largest distance from the union's surface to the mesh's corners, mm, by samples.
pub(super) fn excess_mm(pieces: &[Triangle], capsules: &[Fitted]) -> f64 {
    let mut most_mm = 0.0f64;
    for (n, capsule) in capsules.iter().enumerate() {
        for p in surface(capsule) {
            let is_inside = |(m, c): (usize, &Fitted)| {
                m != n && point_segment_mm(&p, &c.axis[0], &c.axis[1]) < c.radius_mm
            };
            if capsules.iter().enumerate().any(is_inside) {
                continue;
            }
            let near = pieces.iter().map(|piece| (piece[0] - p).norm_squared()).fold(f64::INFINITY, f64::min);
            most_mm = most_mm.max(near.sqrt());
        }
    }
    most_mm
}

/// Points on a capsule's surface.
fn surface(capsule: &Fitted) -> Vec<Vector3<f64>> {
    let [from, to] = capsule.axis;
    let along = to - from;
    let z = along.try_normalize(1e-9).unwrap_or_else(Vector3::z);
    let x = z.cross(&if z.x.abs() < 0.7 { Vector3::x() } else { Vector3::y() }).normalize();
    let y = z.cross(&x);
    let r = capsule.radius_mm;
    let (turns, caps) = ((6.3 * r / SAMPLE_MM).ceil() as usize, (1.6 * r / SAMPLE_MM).ceil() as usize);
    let rows = (along.norm() / SAMPLE_MM).ceil().max(1.0) as usize;
    let mut points = Vec::new();
    for turn in 0..turns {
        let (s, c) = (std::f64::consts::TAU * turn as f64 / turns as f64).sin_cos();
        let out = x * c + y * s;
        points.extend((0..=rows).map(|row| from + along * (row as f64 / rows as f64) + out * r));
        for cap in 1..=caps {
            let (up, aside) = (std::f64::consts::FRAC_PI_2 * cap as f64 / caps as f64).sin_cos();
            points.push(to + (out * aside + z * up) * r);
            points.push(from + (out * aside - z * up) * r);
        }
    }
    points
}
