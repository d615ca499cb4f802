//! The pieces of polylines on a mesh that cut: those with a rake face on one side and a flank on the other.

use bonemill_geometry::{Mesh, Tool};
use nalgebra::Vector3;

use super::topology::{corners, normal};
use crate::cutter::{CutterError, EdgeKind};

/// A straight piece of a cutting edge, outwards, with the outward normal of its rake face.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct CuttingPiece {
    pub ends: [Vector3<f64>; 2],
    pub rake_normal: Vector3<f64>,
    pub kind: EdgeKind,
}

/// A rake face whose normal points this much down the shaft or more is another edge's flank: the edge is a chisel edge.
const FLANK_DOWN: f64 = 0.25;

/// Facets within this part of the mesh's size of a piece's middle are beside it.
const BESIDE: f64 = 1e-6;
/// A piece that gains less radius than this part of its length stands along the shaft or along the turn.
const STANDS: f64 = 1e-3;
/// A rake face faces the turn by at least this, sin: facets of a round surface of 32 facets or more do not.
const FACES_TURN: f64 = 0.1;
/// A flank may face the turn by rounding only.
const GRAZING: f64 = 1e-6;
/// Pieces that cross the radius of their own nearest point are cut there; others are cut this many times, so that a long piece of
/// which a part cuts is not judged as one.
const PARTS: usize = 16;

/// Straight pieces that cut, edge by edge; an edge with none is left out.
pub(super) fn pieces_of(mesh: &Mesh<Tool>, polylines: &[Vec<Vector3<f64>>]) -> Vec<Vec<CuttingPiece>> {
    let nearby = Nearby::new(mesh);
    let mut edges = Vec::new();
    for line in polylines {
        let mut pieces: Vec<CuttingPiece> = Vec::new();
        for ends in line.windows(2).flat_map(|w| split([w[0], w[1]])) {
            match cutting(mesh, &nearby, ends) {
                Some(piece) => pieces.push(piece),
                // what cuts again after a gap is another edge
                None if pieces.is_empty() => {}
                None => edges.push(std::mem::take(&mut pieces)),
            }
        }
        if !pieces.is_empty() {
            edges.push(pieces);
        }
    }
    edges
}

/// Parts of a piece, cut where it is nearest to the axis.
fn split([a, b]: [Vector3<f64>; 2]) -> Vec<[Vector3<f64>; 2]> {
    let along = b - a;
    let across2 = along.x * along.x + along.y * along.y;
    let nearest = if across2 > 0.0 { -(a.x * along.x + a.y * along.y) / across2 } else { 0.0 };
    let mut cuts: Vec<f64> = (0..=PARTS).map(|n| n as f64 / PARTS as f64).collect();
    if nearest > 1e-9 && nearest < 1.0 - 1e-9 {
        cuts.push(nearest);
        cuts.sort_by(f64::total_cmp);
        cuts.dedup_by(|x, y| (*x - *y).abs() < 1e-9);
    }
    cuts.windows(2).map(|w| [a + along * w[0], a + along * w[1]]).collect()
}

/// The piece, outwards, where it cuts.
fn cutting(mesh: &Mesh<Tool>, nearby: &Nearby, [a, b]: [Vector3<f64>; 2]) -> Option<CuttingPiece> {
    let radius = |p: &Vector3<f64>| p.x.hypot(p.y);
    let (ra, rb) = (radius(&a), radius(&b));
    let ends = if ra <= rb { [a, b] } else { [b, a] };
    let middle = (a + b) / 2.0;
    if (rb - ra).abs() <= STANDS * (b - a).norm() || radius(&middle) <= 0.0 {
        return None;
    }
    let turn = Vector3::new(-middle.y, middle.x, 0.0) / radius(&middle);
    let normals: Vec<Vector3<f64>> = nearby.facets(&middle).filter_map(|f| normal(mesh, f)).collect();
    let facing = |n: &Vector3<f64>| n.dot(&turn);
    let rake = normals.iter().copied().max_by(|x, y| facing(x).total_cmp(&facing(y)))?;
    let flank = normals.iter().copied().min_by(|x, y| facing(x).total_cmp(&facing(y)))?;
    let cuts = facing(&rake) > FACES_TURN && facing(&flank) <= GRAZING && flank.z < -GRAZING;
    let kind = if rake.z <= -FLANK_DOWN { EdgeKind::Chisel } else { EdgeKind::Lip };
    cuts.then_some(CuttingPiece { ends, rake_normal: rake, kind })
}

/// Polylines lie on the mesh within `share` of its size.
///
/// # Errors
/// [`CutterError::EdgeOffMesh`] with the first point that does not, [`CutterError::EdgePoints`] for one with fewer than two points.
pub(super) fn check_on_mesh(
    mesh: &Mesh<Tool>,
    lines: &[Vec<Vector3<f64>>],
    share: f64,
) -> Result<(), CutterError> {
    let most_mm = share * size(mesh);
    for (edge, line) in lines.iter().enumerate() {
        if line.len() < 2 {
            return Err(CutterError::EdgePoints { edge, points: line.len() });
        }
        for (point, p) in line.iter().enumerate() {
            let facets = 0..mesh.triangles.len() as u32;
            let distance_mm =
                facets.map(|f| triangle_distance2(p, &corners(mesh, f))).fold(f64::INFINITY, f64::min).sqrt();
            if distance_mm.is_nan() || distance_mm > most_mm {
                return Err(CutterError::EdgeOffMesh { edge, point, distance_mm, most_mm });
            }
        }
    }
    Ok(())
}

/// Diagonal of the bounding box.
fn size(mesh: &Mesh<Tool>) -> f64 {
    let [lo, hi] = bounds(mesh);
    (hi - lo).norm()
}

fn bounds(mesh: &Mesh<Tool>) -> [Vector3<f64>; 2] {
    let coords = || mesh.vertices.iter().map(|v| v.coords);
    [
        coords().fold(Vector3::repeat(f64::INFINITY), |m, c| m.inf(&c)),
        coords().fold(Vector3::repeat(f64::NEG_INFINITY), |m, c| m.sup(&c)),
    ]
}

/// Facets by the slab of height that they reach into.
struct Nearby<'m> {
    mesh: &'m Mesh<Tool>,
    slabs: Vec<Vec<u32>>,
    bottom: f64,
    height: f64,
    reach: f64,
}

impl<'m> Nearby<'m> {
    const SLABS: usize = 512;

    fn new(mesh: &'m Mesh<Tool>) -> Self {
        let [lo, hi] = bounds(mesh);
        let height = (hi.z - lo.z).max(1e-9) / Self::SLABS as f64;
        let mut nearby = Self {
            mesh,
            slabs: vec![Vec::new(); Self::SLABS],
            bottom: lo.z,
            height,
            reach: BESIDE * (hi - lo).norm(),
        };
        for facet in 0..mesh.triangles.len() as u32 {
            let z = corners(mesh, facet).map(|c| c.z);
            let (from, to) = (
                z.iter().copied().fold(f64::INFINITY, f64::min),
                z.iter().copied().fold(f64::NEG_INFINITY, f64::max),
            );
            for slab in nearby.slab(from - nearby.reach)..=nearby.slab(to + nearby.reach) {
                nearby.slabs[slab].push(facet);
            }
        }
        nearby
    }

    fn slab(&self, z: f64) -> usize {
        (((z - self.bottom) / self.height).max(0.0) as usize).min(Self::SLABS - 1)
    }

    /// Facets beside a point.
    fn facets(&self, p: &Vector3<f64>) -> impl Iterator<Item = u32> + '_ {
        let (p, reach2) = (*p, self.reach * self.reach);
        let near = move |f: &u32| triangle_distance2(&p, &corners(self.mesh, *f)) <= reach2;
        self.slabs[self.slab(p.z)].iter().copied().filter(near)
    }
}

/// Squared distance of a point from a triangle.
///
/// **Source:** Ericson, Real-Time Collision Detection, 5.1.5.
fn triangle_distance2(p: &Vector3<f64>, [a, b, c]: &[Vector3<f64>; 3]) -> f64 {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(&ap), ac.dot(&ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return ap.norm_squared();
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(&bp), ac.dot(&bp));
    if d3 >= 0.0 && d4 <= d3 {
        return bp.norm_squared();
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(&cp), ac.dot(&cp));
    if d6 >= 0.0 && d5 <= d6 {
        return cp.norm_squared();
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return (ap - ab * (d1 / (d1 - d3))).norm_squared();
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return (ap - ac * (d2 / (d2 - d6))).norm_squared();
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        return (bp - (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6)))).norm_squared();
    }
    let denominator = 1.0 / (va + vb + vc);
    (ap - ab * (vb * denominator) - ac * (vc * denominator)).norm_squared()
}
