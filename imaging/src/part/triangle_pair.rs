//! Whether two triangles meet, by exact predicates, and how deep one reaches through the other.
//!
//! Orientations are exact (Shewchuk 1997, through `robust`), so that the answer is that of real numbers. Triangles that share a
//! corner or an edge are said to meet only where they meet elsewhere.

use nalgebra::Vector3;
use robust::{Coord, Coord3D, orient2d, orient3d};

/// Three corners.
pub(crate) type Triangle = [Vector3<f64>; 3];

/// Whether the triangles have a point in common beside shared corners and edges. Touching counts.
pub(crate) fn meet(s: &Triangle, t: &Triangle) -> bool {
    let shared = |p: &Vector3<f64>, other: &Triangle| other.contains(p);
    let own_s: Vec<usize> = (0..3).filter(|&k| !shared(&s[k], t)).collect();
    let own_t: Vec<usize> = (0..3).filter(|&k| !shared(&t[k], s)).collect();
    match (own_s.as_slice(), own_t.as_slice()) {
        // one edge in common: they meet elsewhere if they lie in one plane, on the same side of the edge
        ([a], [b]) => folded(s, *a, &t[*b]),
        // one corner in common: they meet elsewhere if one's far side does
        ([a, b], [c, d]) => edge_meets(&s[*a], &s[*b], t) || edge_meets(&t[*c], &t[*d], s),
        ([], _) | (_, []) => true,
        _ => separate(s, t).is_none() && sides_meet(s, t),
    }
}

/// How deep the triangles reach through each other's planes at most, mm: the lesser of the two, each on its shallower side.
pub(crate) fn depth(s: &Triangle, t: &Triangle) -> f64 {
    shallow_side(s, t).min(shallow_side(t, s))
}

fn shallow_side(plane: &Triangle, t: &Triangle) -> f64 {
    let normal = (plane[1] - plane[0]).cross(&(plane[2] - plane[0]));
    let Some(normal) = normal.try_normalize(0.0) else { return 0.0 };
    let heights = t.map(|p| normal.dot(&(p - plane[0])));
    let above = heights.iter().copied().fold(0.0, f64::max);
    let below = -heights.iter().copied().fold(0.0, f64::min);
    above.min(below)
}

/// A plane of one that has the other strictly on one side.
fn separate(s: &Triangle, t: &Triangle) -> Option<()> {
    let one_side = |plane: &Triangle, of: &Triangle| {
        let sides = of.map(|p| side(plane, &p));
        sides.iter().all(|o| *o > 0.0) || sides.iter().all(|o| *o < 0.0)
    };
    (one_side(s, t) || one_side(t, s)).then_some(())
}

fn sides_meet(s: &Triangle, t: &Triangle) -> bool {
    (0..3).any(|k| edge_meets(&s[k], &s[(k + 1) % 3], t) || edge_meets(&t[k], &t[(k + 1) % 3], s))
}

/// Whether the segment from `a` to `b` meets the triangle, its border included.
fn edge_meets(a: &Vector3<f64>, b: &Vector3<f64>, t: &Triangle) -> bool {
    let (from, to) = (side(t, a), side(t, b));
    if from == 0.0 && to == 0.0 {
        return edge_meets_in_plane(a, b, t);
    }
    if from * to > 0.0 {
        return false;
    }
    // the segment passes on one side of all three sides of the triangle
    let passes = [0, 1, 2].map(|k| orient(a, b, &t[k], &t[(k + 1) % 3]));
    passes.iter().all(|o| *o >= 0.0) || passes.iter().all(|o| *o <= 0.0)
}

/// The same where all five points lie in one plane.
fn edge_meets_in_plane(a: &Vector3<f64>, b: &Vector3<f64>, t: &Triangle) -> bool {
    let normal = (t[1] - t[0]).cross(&(t[2] - t[0]));
    let drop = normal.iamax();
    let flat = |p: &Vector3<f64>| Coord { x: p[(drop + 1) % 3], y: p[(drop + 2) % 3] };
    let [p, q, r] = [flat(&t[0]), flat(&t[1]), flat(&t[2])];
    let (a, b) = (flat(a), flat(b));
    let inside = |c: Coord<f64>| {
        let sides = [orient2d(p, q, c), orient2d(q, r, c), orient2d(r, p, c)];
        sides.iter().all(|o| *o >= 0.0) || sides.iter().all(|o| *o <= 0.0)
    };
    inside(a) || inside(b) || [(p, q), (q, r), (r, p)].iter().any(|&(c, d)| segments_meet(a, b, c, d))
}

fn segments_meet(a: Coord<f64>, b: Coord<f64>, c: Coord<f64>, d: Coord<f64>) -> bool {
    let (abc, abd) = (orient2d(a, b, c), orient2d(a, b, d));
    let (cda, cdb) = (orient2d(c, d, a), orient2d(c, d, b));
    let overlap = |lo: f64, hi: f64, l: f64, h: f64| lo.min(hi) <= l.max(h) && l.min(h) <= lo.max(hi);
    abc * abd <= 0.0 && cda * cdb <= 0.0 && overlap(a.x, b.x, c.x, d.x) && overlap(a.y, b.y, c.y, d.y)
}

/// Whether two triangles on one edge lie over each other: in one plane, the far corners on the same side of the edge.
fn folded(s: &Triangle, own: usize, far: &Vector3<f64>) -> bool {
    if side(s, far) != 0.0 {
        return false;
    }
    let (a, b) = (s[(own + 1) % 3], s[(own + 2) % 3]);
    let drop = (b - a).cross(&(s[own] - a)).iamax();
    let flat = |p: &Vector3<f64>| Coord { x: p[(drop + 1) % 3], y: p[(drop + 2) % 3] };
    orient2d(flat(&a), flat(&b), flat(&s[own])) * orient2d(flat(&a), flat(&b), flat(far)) > 0.0
}

/// On which side of the triangle's plane the point lies; 0: in it.
fn side(t: &Triangle, p: &Vector3<f64>) -> f64 {
    orient(&t[0], &t[1], &t[2], p)
}

fn orient(a: &Vector3<f64>, b: &Vector3<f64>, c: &Vector3<f64>, d: &Vector3<f64>) -> f64 {
    let coord = |p: &Vector3<f64>| Coord3D { x: p.x, y: p.y, z: p.z };
    orient3d(coord(a), coord(b), coord(c), coord(d)).signum_or_zero()
}

/// −1, 0 or 1, so that products of two cannot underflow.
trait SignumOrZero {
    fn signum_or_zero(self) -> f64;
}

impl SignumOrZero for f64 {
    fn signum_or_zero(self) -> f64 {
        if self == 0.0 { 0.0 } else { self.signum() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn triangle(corners: [[f64; 3]; 3]) -> Triangle {
        corners.map(Vector3::from)
    }

    const FLAT: [[f64; 3]; 3] = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]];

    /// The triangles, whether they meet, and how deep.
    const CASES: [([[f64; 3]; 3], bool, f64); 9] = [
        // through the middle
        ([[1.0, 1.0, -1.0], [1.0, 1.0, 2.0], [1.5, 0.5, 2.0]], true, 1.0),
        // beside it
        ([[5.0, 5.0, -1.0], [5.0, 5.0, 2.0], [6.0, 5.0, 2.0]], false, 0.0),
        // above it
        ([[1.0, 1.0, 1.0], [1.0, 2.0, 1.0], [2.0, 1.0, 2.0]], false, 0.0),
        // a corner touches
        ([[1.0, 1.0, 0.0], [1.0, 2.0, 1.0], [2.0, 1.0, 2.0]], true, 0.0),
        // in one plane, inside
        ([[1.0, 1.0, 0.0], [1.5, 1.0, 0.0], [1.0, 1.5, 0.0]], true, 0.0),
        // in one plane, apart
        ([[5.0, 1.0, 0.0], [6.0, 1.0, 0.0], [5.0, 2.0, 0.0]], false, 0.0),
        // on a common edge, hinged
        ([[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 1e-9]], false, 0.0),
        // on a common edge, folded over
        ([[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [2.0, 4.0, 0.0]], true, 0.0),
        // on a common corner, through the other
        ([[0.0, 0.0, 0.0], [4.0, 4.0, 1.0], [4.0, 4.0, -1.0]], true, 1.0),
    ];

    #[test]
    fn pairs_meet_as_drawn_in_any_order() {
        for (other, expected, deep_mm) in CASES {
            for (s, t) in [(triangle(FLAT), triangle(other)), (triangle(other), triangle(FLAT))] {
                for turn in 0..3 {
                    let t = [t[turn], t[(turn + 1) % 3], t[(turn + 2) % 3]];
                    assert_eq!(meet(&s, &t), expected, "{s:?} {t:?}");
                    if deep_mm > 0.0 {
                        assert!(depth(&s, &t) > 0.0 && depth(&s, &t) <= deep_mm, "{}", depth(&s, &t));
                    }
                }
            }
        }
    }

    #[test]
    fn a_gap_below_rounding_is_a_gap() {
        // the corner lies one unit in the last place above the plane of the flat triangle, far from the origin
        let base = 1e5;
        let flat = FLAT.map(|[x, y, z]| [x + base, y + base, z + base]);
        let above = [
            [base + 1.0, base + 1.0, base.next_up()],
            [base + 1.0, base + 2.0, base + 1.0],
            [base + 2.0, base + 1.0, base + 1.0],
        ];
        assert!(!meet(&triangle(flat), &triangle(above)));
    }
}
