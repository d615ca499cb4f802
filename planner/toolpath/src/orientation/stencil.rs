//! Interpolates the force for every direction of a plane from its values for a few.
//!
//! At one waypoint the force is a smooth function of the tilt, because bone and feed are fixed and only the shaft turns. So
//! it is evaluated at every third angle and interpolated between by the cubic through the four nearest. A [`Stencil`] holds
//! the weights, which depend on the angles alone. The force is interpolated rather than the cost, which has a kink at
//! F_v = 0.
//!
//! A test (`tests/orientation.rs`) compares it with direct evaluation: the error is below that of the force's own lattice of
//! samples. On a cap the same method, with a least-squares quadratic over a quarter of the directions 6° apart, had errors of
//! 6 % at one direction in a hundred, so caps are evaluated directly.

use nalgebra::Vector3;

/// One in this many angles is evaluated.
const EVERY: usize = 3;
/// Number of nodes of the cubic.
const NEAREST: usize = 4;

/// The angles to evaluate, and the interpolation weights of every angle.
#[derive(Debug, Clone, PartialEq)]
pub struct Stencil {
    /// Numbers of the angles that are evaluated.
    nodes: Vec<usize>,
    /// For each angle, indices into `nodes` with their weights.
    weights: Vec<Vec<(usize, f64)>>,
}

impl Stencil {
    /// The stencil of ascending angles, rad.
    pub fn new(angles_rad: &[f64]) -> Self {
        let count = angles_rad.len();
        let nodes: Vec<usize> = (0..count).filter(|n| n % EVERY == 0 || n + 1 == count).collect();
        let weights = (0..count).map(|n| weights(angles_rad, &nodes, n)).collect();
        Self { nodes, weights }
    }

    /// Angles that are evaluated, ascending.
    pub fn nodes(&self) -> &[usize] {
        &self.nodes
    }

    /// Computes the values of the `wanted` angles into `out`; the stencil is used where it needs fewer calls of `value`.
    pub fn fill(
        &self,
        wanted: impl Iterator<Item = usize> + Clone,
        value: impl Fn(usize) -> Vector3<f64>,
        out: &mut [Option<Vector3<f64>>],
    ) {
        let mut needed = vec![false; self.nodes.len()];
        for (place, _) in wanted.clone().flat_map(|n| &self.weights[n]) {
            needed[*place] = true;
        }
        if needed.iter().filter(|n| **n).count() >= wanted.clone().count() {
            wanted.for_each(|n| out[n] = Some(value(n)));
            return;
        }
        let at_node = |(place, needed): (usize, &bool)| {
            if *needed { value(self.nodes[place]) } else { Vector3::zeros() }
        };
        let at_nodes: Vec<_> = needed.iter().enumerate().map(at_node).collect();
        wanted.for_each(|n| out[n] = Some(self.at(n, &at_nodes)));
    }

    /// The value at angle `n` from those at the nodes.
    fn at(&self, n: usize, at_nodes: &[Vector3<f64>]) -> Vector3<f64> {
        self.weights[n].iter().fold(Vector3::zeros(), |sum, (place, w)| sum + at_nodes[*place] * *w)
    }
}

/// Lagrange's weights of the nearest nodes; a node has the weight 1 for itself.
fn weights(angles_rad: &[f64], nodes: &[usize], n: usize) -> Vec<(usize, f64)> {
    if let Ok(place) = nodes.binary_search(&n) {
        return vec![(place, 1.0)];
    }
    let off = |place: usize| (angles_rad[n] - angles_rad[nodes[place]]).abs();
    let mut near: Vec<usize> = (0..nodes.len()).collect();
    near.sort_by(|a, b| off(*a).total_cmp(&off(*b)).then(a.cmp(b)));
    near.truncate(NEAREST);
    let at = |k: usize| angles_rad[nodes[near[k]]];
    let lagrange = |k: usize| {
        let others = (0..near.len()).filter(|m| *m != k);
        others.map(|m| (angles_rad[n] - at(m)) / (at(k) - at(m))).product::<f64>()
    };
    near.iter().enumerate().map(|(k, place)| (*place, lagrange(k))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sets() -> [Vec<f64>; 3] {
        let plane = |count: i32| (-count..=count).map(|n| f64::from(n) * 2f64.to_radians()).collect();
        [plane(30), plane(2), plane(0)]
    }

    #[test]
    fn nodes_are_kept_and_weights_add_up() {
        for set in sets() {
            let stencil = Stencil::new(&set);
            assert!(stencil.nodes().len() * 5 < set.len() * 2 || set.len() < 10);
            for n in 0..set.len() {
                let sum: f64 = stencil.weights[n].iter().map(|(_, w)| w).sum();
                assert!((sum - 1.0).abs() < 1e-9, "{n}: {sum}");
            }
        }
    }

    /// Smooth functions of the axis, as forces are, are reproduced.
    #[test]
    fn smooth_functions_come_back() {
        let normal = Vector3::new(0.3, -0.5, -0.8).normalize();
        let force = |angle: f64| {
            let a = Vector3::new(angle.sin(), 0.0, angle.cos());
            a.cross(&normal) * 1.4 + normal * 0.8 + a * (0.3 * a.dot(&normal))
        };
        let [set, ..] = sets();
        let stencil = Stencil::new(&set);
        let at_nodes: Vec<_> = stencil.nodes().iter().map(|n| force(set[*n])).collect();
        for (n, angle) in set.iter().enumerate() {
            let expected = force(*angle);
            let off = (stencil.at(n, &at_nodes) - expected).norm() / expected.norm();
            assert!(off < 1e-4, "{n}: {off}");
        }
    }
}
