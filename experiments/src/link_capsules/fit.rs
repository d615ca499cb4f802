//! Capsules that enclose a link's mesh, and the proof that they do.
//!
//! The mesh is cut into pieces with edges of at most [`EDGE_MM`]. Each piece belongs to one capsule; a capsule is convex, so it
//! holds a piece if it holds its three corners, and the capsules hold the mesh if every piece lies in one of them. For given
//! axes and pieces the radii follow; axes and radii are moved by random steps, each piece going to the capsule that it exceeds
//! least, and a step is kept if the volume of the capsules' union falls.

use bonemill_geometry::capsule::point_segment_mm;
use nalgebra::Vector3;

use crate::arms::Stream;

/// Longest edge of a piece, mm.
const EDGE_MM: f64 = 12.0;
/// Random steps.
const STEPS: usize = 6000;
/// Pieces that the axes are fitted to; the radii are of all.
const FITTED_TO: usize = 800;
/// Spacing of the points by which the volume is measured, and how far they lie around the mesh, mm.
const GRID_MM: f64 = 10.0;
const MARGIN_MM: f64 = 40.0;
/// Largest step at first and at last, mm.
const STEP_MM: [f64; 2] = [8.0, 0.2];
/// Weight of the capsules' own volumes beside that of their union.
const OWN: f64 = 0.02;
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

/// The capsules with the least volume that were found, from given axes: first each alone about the pieces that are nearest to its
/// axis, then all together.
pub(super) fn fitted(pieces: &[Triangle], axes: &[[Vector3<f64>; 2]], seed: u64) -> Vec<Fitted> {
    let some: Vec<Triangle> =
        pieces.iter().step_by(pieces.len().div_ceil(FITTED_TO).max(1)).copied().collect();
    let nearest = |piece: &Triangle| {
        let away = |axis: &[Vector3<f64>; 2]| Fitted { axis: *axis, radius_mm: 0.0 }.farthest_mm(piece);
        (0..axes.len()).min_by(|m, n| away(&axes[*m]).total_cmp(&away(&axes[*n])))
    };
    let alone = axes.iter().enumerate().map(|(n, axis)| {
        let own: Vec<Triangle> = some.iter().filter(|piece| nearest(piece) == Some(n)).copied().collect();
        let first = Fitted { axis: *axis, radius_mm: 0.0 };
        searched(vec![first], seed, &own, &|capsules| own_volume_mm3(&capsules[0]))[0]
    });
    let around = around(&some);
    searched(alone.collect(), seed, &some, &|capsules| volume_mm3(capsules, &around))
}

/// The best capsules that random steps of falling size lead to.
fn searched(
    first: Vec<Fitted>,
    seed: u64,
    pieces: &[Triangle],
    measure: &dyn Fn(&[Fitted]) -> f64,
) -> Vec<Fitted> {
    let (mut random, count) = (Stream(seed), first.len());
    let mut capsules = enclosing(pieces, &first);
    let mut least = measure(&capsules);
    for step in 0..STEPS {
        let share = step as f64 / STEPS as f64;
        let size_mm = STEP_MM[0] * (STEP_MM[1] / STEP_MM[0]).powf(share);
        let mut moved = capsules.clone();
        let which = (random.next() * count as f64) as usize % count;
        let mut offset = || Vector3::from_fn(|_, _| (2.0 * random.next() - 1.0) * size_mm);
        let [first, second] = [offset(), offset()];
        let Fitted { axis, radius_mm } = &mut moved[which];
        // both ends together, or one alone, or the pieces that are held
        match step % 4 {
            0 => *axis = axis.map(|end| end + first),
            3 => *radius_mm = (*radius_mm + first.x).max(0.0),
            n => axis[n - 1] += second,
        }
        let found = enclosing(pieces, &moved);
        let measured = measure(&found);
        if measured < least {
            (least, capsules) = (measured, found);
        }
    }
    capsules
}

/// A capsule's volume, mm³.
fn own_volume_mm3(capsule: &Fitted) -> f64 {
    let length_mm = (capsule.axis[1] - capsule.axis[0]).norm();
    std::f64::consts::PI * capsule.radius_mm.powi(2) * (length_mm + 4.0 / 3.0 * capsule.radius_mm)
}

/// Points around a mesh, [`GRID_MM`] apart.
fn around(pieces: &[Triangle]) -> Vec<Vector3<f64>> {
    let first = pieces.first().map_or(Vector3::zeros(), |piece| piece[0]);
    let corners = || pieces.iter().flatten();
    let low = corners().fold(first, |low, p| low.inf(p)).map(|mm| mm - MARGIN_MM);
    let high = corners().fold(first, |high, p| high.sup(p)).map(|mm| mm + MARGIN_MM);
    let [nx, ny, nz] = [0, 1, 2].map(|k| ((high[k] - low[k]) / GRID_MM).ceil() as usize);
    let place =
        |n: usize| Vector3::new((n % nx) as f64, (n / nx % ny) as f64, (n / nx / ny) as f64) * GRID_MM + low;
    (0..nx * ny * nz).map(place).collect()
}

/// The volume of a union of capsules by the points that it holds, mm³, and a little of each capsule's own, so that none is larger
/// than it must be.
fn volume_mm3(capsules: &[Fitted], around: &[Vector3<f64>]) -> f64 {
    let holds = |p: &&Vector3<f64>| {
        capsules.iter().any(|c| point_segment_mm(p, &c.axis[0], &c.axis[1]) <= c.radius_mm)
    };
    let own: f64 = capsules.iter().map(own_volume_mm3).sum();
    around.iter().filter(holds).count() as f64 * GRID_MM.powi(3) + OWN * own
}

/// The radii about given axes that hold every piece. A piece belongs to the capsule that it exceeds least, or that
/// it lies deepest in.
fn enclosing(pieces: &[Triangle], capsules: &[Fitted]) -> Vec<Fitted> {
    let mut held: Vec<Fitted> = capsules.iter().map(|c| Fitted { radius_mm: 0.0, ..*c }).collect();
    for piece in pieces {
        let far = capsules.iter().map(|c| c.farthest_mm(piece));
        let beyond = far.zip(capsules).enumerate().map(|(n, (mm, c))| (n, mm, mm - c.radius_mm));
        if let Some((n, mm, _)) = beyond.min_by(|a, b| a.2.total_cmp(&b.2)) {
            held[n].radius_mm = held[n].radius_mm.max(mm);
        }
    }
    held
}

/// The capsules with axes to 0.1 mm and radii rounded up, such that they surely hold every piece.
pub(super) fn rounded(pieces: &[Triangle], capsules: &[Fitted]) -> Vec<Fitted> {
    let tenth = |mm: f64| (mm * 10.0).round() / 10.0;
    let rounded: Vec<_> =
        capsules.iter().map(|c| Fitted { axis: c.axis.map(|end| end.map(tenth)), ..*c }).collect();
    let mut found = enclosing(pieces, &rounded);
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
