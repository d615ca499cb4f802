//! Convex facet edges that turn the surface sharply, joined to polylines.

use std::collections::BTreeMap;

use bonemill_geometry::{Mesh, Tool};
use nalgebra::Vector3;

use super::topology::{FacetEdge, Topology, normal};

/// Two facet edges that turn by less than this continue each other, cos.
const STRAIGHT_ON: f64 = 0.7;

/// Polylines along the convex facet edges at which the surface turns by at least `least_rad`.
pub(super) fn convex_chains(
    mesh: &Mesh<Tool>,
    topology: &Topology,
    least_rad: f64,
) -> Vec<Vec<Vector3<f64>>> {
    let sharp: Vec<&FacetEdge> =
        topology.edges.iter().filter(|edge| is_sharp(mesh, edge, least_rad)).collect();
    let at = |v: u32| mesh.vertices[v as usize].coords;
    // the sharp edges at each vertex; two that go straight on are joined there
    let mut at_vertex: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
    for (n, edge) in sharp.iter().enumerate() {
        edge.ends.iter().for_each(|v| at_vertex.entry(*v).or_default().push(n));
    }
    let other = |edge: usize, v: u32| {
        if sharp[edge].ends[0] == v { sharp[edge].ends[1] } else { sharp[edge].ends[0] }
    };
    let next = |edge: usize, v: u32| -> Option<usize> {
        let coming = (at(v) - at(other(edge, v))).normalize();
        let goes_on =
            |n: &usize| *n != edge && (at(other(*n, v)) - at(v)).normalize().dot(&coming) > STRAIGHT_ON;
        let [one] = at_vertex.get(&v)?.iter().copied().filter(goes_on).collect::<Vec<_>>()[..] else {
            return None;
        };
        Some(one)
    };
    let mut used = vec![false; sharp.len()];
    let mut chains = Vec::new();
    // from ends first, so that open chains are whole; then what is left is closed
    for only_ends in [true, false] {
        for start in 0..sharp.len() {
            for v in sharp[start].ends {
                if used[start] || (only_ends && next(start, v).is_some()) {
                    continue;
                }
                let mut chain = vec![at(v)];
                let (mut edge, mut here) = (start, v);
                while !used[edge] {
                    used[edge] = true;
                    here = other(edge, here);
                    chain.push(at(here));
                    let Some(following) = next(edge, here) else { break };
                    edge = following;
                }
                chains.push(chain);
            }
        }
    }
    chains
}

fn is_sharp(mesh: &Mesh<Tool>, edge: &FacetEdge, least_rad: f64) -> bool {
    let [Some(a), Some(b)] = edge.facets.map(|f| normal(mesh, f)) else { return false };
    let along = mesh.vertices[edge.ends[1] as usize].coords - mesh.vertices[edge.ends[0] as usize].coords;
    // seen along the edge as the first facet has it, a convex surface turns its normal to the left: away from the facet
    let is_convex = a.cross(&b).dot(&along) > 0.0;
    is_convex && a.dot(&b).clamp(-1.0, 1.0).acos() >= least_rad
}
