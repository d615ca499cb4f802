//! A force on every direction of a set from its values on a few.
//!
//! At one waypoint the force is a smooth function of the axis: bone and feed stay, only the shaft turns. So it is evaluated at
//! every third direction of a plane, or at a quarter of a cap's (every second ring and place), and interpolated between:
//! by the cubic through the four nearest, or the least-squares quadratic through the nine nearest. A [`Stencil`] holds the
//! weights, which depend on the set alone. What is interpolated is the force, not the cost, whose kink at F_v = 0 stays sharp.
//!
//! The error is measured against direct evaluation by a test (`tests/orientation.rs`), and lies below the lattice's own.

use nalgebra::{SMatrix, SVector, Unit, Vector3};

use super::Directions;
use super::directions::angle_between;

/// Every how many directions of a plane one is evaluated.
const EVERY: usize = 3;
/// Nodes of the cubic in a plane.
const IN_PLANE: usize = 4;
/// Nodes of the quadratic on a cap, which has six coefficients.
const ON_CAP: usize = 9;

/// Directions to evaluate, and what each direction is made of.
#[derive(Debug, Clone, PartialEq)]
pub struct Stencil {
    /// Directions that are evaluated.
    nodes: Vec<usize>,
    /// Per direction: places in `nodes` with their weights.
    weights: Vec<Vec<(usize, f64)>>,
}

impl Stencil {
    /// The stencil of a set.
    pub fn new(directions: &Directions) -> Self {
        let count = directions.len();
        let nodes: Vec<usize> = match directions.angles_rad() {
            Some(_) => (0..count).filter(|n| n % EVERY == 0 || n + 1 == count).collect(),
            None => cap_nodes(count),
        };
        let weights = (0..count).map(|n| weights(directions, &nodes, n)).collect();
        Self { nodes, weights }
    }

    /// Directions that are evaluated, ascending.
    pub fn nodes(&self) -> &[usize] {
        &self.nodes
    }

    /// Which places of [`Self::nodes`] direction `n` needs.
    pub fn needs(&self, n: usize) -> impl Iterator<Item = usize> + '_ {
        self.weights[n].iter().map(|(place, _)| *place)
    }

    /// The value at direction `n` from those at the nodes.
    pub fn at(&self, n: usize, at_nodes: &[Vector3<f64>]) -> Vector3<f64> {
        self.weights[n].iter().fold(Vector3::zeros(), |sum, (place, w)| sum + at_nodes[*place] * *w)
    }
}

/// Of a cap's rings the even ones and the outermost, of those every second place.
fn cap_nodes(count: usize) -> Vec<usize> {
    let mut nodes = vec![0];
    let (mut first, mut ring) = (1, 1);
    while first < count {
        let is_last = first + 6 * ring >= count;
        if ring % 2 == 0 || is_last {
            nodes.extend((0..6 * ring).step_by(2).map(|place| first + place).filter(|n| *n < count));
        }
        first += 6 * ring;
        ring += 1;
    }
    nodes
}

fn weights(directions: &Directions, nodes: &[usize], n: usize) -> Vec<(usize, f64)> {
    if let Ok(place) = nodes.binary_search(&n) {
        return vec![(place, 1.0)];
    }
    let axes = directions.axes();
    let mut near: Vec<(f64, usize)> =
        nodes.iter().enumerate().map(|(place, m)| (angle_between(&axes[n], &axes[*m]), place)).collect();
    near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    match directions.angles_rad() {
        Some(angles) => {
            near.truncate(IN_PLANE);
            let q: Vec<f64> = near.iter().map(|(_, place)| angles[nodes[*place]]).collect();
            let lagrange = |k: usize| {
                let others = (0..q.len()).filter(|m| *m != k);
                others.map(|m| (angles[n] - q[m]) / (q[k] - q[m])).product::<f64>()
            };
            near.iter().enumerate().map(|(k, (_, place))| (*place, lagrange(k))).collect()
        }
        None => {
            near.truncate(ON_CAP);
            quadratic(&axes[n], near.iter().map(|(_, place)| (*place, axes[nodes[*place]])).collect())
        }
    }
}

/// Weights of the least-squares quadratic's value at `at`, nearer nodes counting more; the nearest node alone where there are
/// too few for one.
fn quadratic(at: &Unit<Vector3<f64>>, near: Vec<(usize, Unit<Vector3<f64>>)>) -> Vec<(usize, f64)> {
    let turn = bonemill_geometry::basis::from_z(at).inverse();
    let row = |axis: &Unit<Vector3<f64>>| {
        let p = turn * axis.into_inner();
        let weight = 1.0 / (p.x * p.x + p.y * p.y);
        (SVector::<f64, 6>::from([1.0, p.x, p.y, p.x * p.x, p.x * p.y, p.y * p.y]), weight)
    };
    let mut normal = SMatrix::<f64, 6, 6>::zeros();
    for (_, axis) in &near {
        let (r, weight) = row(axis);
        normal += r * r.transpose() * weight;
    }
    // the quadratic's value at 0 is its first coefficient
    let first = normal.cholesky().map(|c| c.solve(&SVector::<f64, 6>::from([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])));
    match first {
        Some(first) => {
            let weight = |axis: &Unit<Vector3<f64>>| {
                let (r, weight) = row(axis);
                weight * first.dot(&r)
            };
            near.iter().map(|(place, axis)| (*place, weight(axis))).collect()
        }
        None => near.first().map(|(place, _)| (*place, 1.0)).into_iter().collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::orientation::TiltFamily;

    fn sets() -> [Directions; 4] {
        let family =
            TiltFamily { hinge: Vector3::x_axis(), zero: Vector3::z_axis(), lower_rad: -1.2, upper_rad: 1.2 };
        let (fine, limit) = (6f64.to_radians(), 60f64.to_radians());
        let plane = Directions::in_plane(&family, 2f64.to_radians(), limit);
        // an odd number of rings, too
        [plane, Directions::cap(fine, limit), Directions::cap(fine, 0.9 * limit), Directions::cap(0.3, 0.3)]
    }

    #[test]
    fn nodes_are_kept_and_weights_add_up() {
        for set in sets() {
            let stencil = Stencil::new(&set);
            assert!(stencil.nodes().len() * 5 < set.len() * 2 || set.len() < 10);
            for n in 0..set.len() {
                let sum: f64 = stencil.weights[n].iter().map(|(_, w)| w).sum();
                assert!((sum - 1.0).abs() < 1e-9, "{n}: {sum}");
                assert!(stencil.weights[n].iter().all(|(_, w)| w.abs() < 1.6));
            }
        }
    }

    /// Smooth functions of the axis: what a force is made of.
    #[test]
    fn smooth_functions_come_back() {
        let normal = Vector3::new(0.3, -0.5, -0.8).normalize();
        let force = |a: &Vector3<f64>| a.cross(&normal) * 1.4 + normal * 0.8 + a * (0.3 * a.dot(&normal));
        for set in sets().into_iter().filter(|set| set.len() > 10) {
            let stencil = Stencil::new(&set);
            let at_nodes: Vec<_> = stencil.nodes().iter().map(|n| force(&set.axes()[*n])).collect();
            for n in 0..set.len() {
                let expected = force(&set.axes()[n]);
                let off = (stencil.at(n, &at_nodes) - expected).norm() / expected.norm();
                assert!(off < 3e-3, "{n}: {off}");
            }
        }
    }
}
