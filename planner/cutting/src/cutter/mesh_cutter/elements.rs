//! Elements along the edges of a mesh at a feed.

use bonemill_geometry::Point;
use nalgebra::Vector3;

use super::edges::CuttingPiece;
use crate::cutter::EdgeElement;
use crate::cutter::edge::EdgePlace;

/// `count` elements along every edge, by length; every straight piece has at least one.
pub(super) fn elements(edges: &[Vec<CuttingPiece>], feed_mm_rev: f64, count: usize) -> Vec<EdgeElement> {
    let length = |p: &CuttingPiece| (p.ends[1] - p.ends[0]).norm();
    let mut all = Vec::new();
    for edge in edges {
        let total: f64 = edge.iter().map(length).sum();
        for piece in edge {
            let parts = (length(piece) / total * count as f64).round().max(1.0) as usize;
            all.extend(
                (0..parts)
                    .map(|n| element(edges, piece, (n as f64 + 0.5) / parts as f64, parts, feed_mm_rev)),
            );
        }
    }
    all
}

/// The part of a piece about the share `s` of its length, one of `parts`.
fn element(
    edges: &[Vec<CuttingPiece>],
    piece: &CuttingPiece,
    s: f64,
    parts: usize,
    feed_mm_rev: f64,
) -> EdgeElement {
    let along = piece.ends[1] - piece.ends[0];
    let half = 0.5 / parts as f64;
    let at = |s: f64| piece.ends[0] + along * s;
    let radius = |p: Vector3<f64>| p.x.hypot(p.y);
    let middle = at(s);
    let radius_mm = radius(middle);
    let radial = Vector3::new(middle.x, middle.y, 0.0) / radius_mm;
    let turn = Vector3::new(-radial.y, radial.x, 0.0);
    let edge = along.normalize();
    let in_element = Vector3::new(edge.dot(&radial), edge.dot(&turn), edge.z);
    let rake = piece.rake_normal;
    let rake = Vector3::new(rake.dot(&radial), rake.dot(&turn), rake.z);
    let passing = edges.iter().filter(|pieces| pieces.iter().any(|p| passes(p, radius_mm))).count();
    let place = EdgePlace {
        position_mm: Point::from_coords(middle),
        radius_mm,
        width_mm: radius(at(s + half)) - radius(at(s - half)),
        feed_share: 1.0 / passing.max(1) as f64,
        epsilon_rad: in_element.z.clamp(-1.0, 1.0).acos(),
        beta_rad: (-in_element.y).atan2(in_element.x),
    };
    let lip = place.lip(feed_mm_rev, |_| 0.0);
    let ((st, ct), (sm, cm)) = (lip.tau_rad.sin_cos(), lip.mu_rad.sin_cos());
    let third_axis = Vector3::new(-st, ct * sm, ct * cm);
    EdgeElement { gamma_n_rad: rake.dot(&third_axis).clamp(-1.0, 1.0).asin(), kind: piece.kind, ..lip }
}

fn passes(piece: &CuttingPiece, radius_mm: f64) -> bool {
    let [from, to] = piece.ends.map(|p| p.x.hypot(p.y));
    from <= radius_mm && radius_mm <= to
}
