//! Sums of a burr's blade directions over the nodes that cut: all that its force depends on.
//!
//! On a ring of equal κ the directions are linear in (cos ψ, sin ψ, 1), so the three sums Σq, Σq cos ψ, Σq sin ψ of the weights
//! q carry them ([`Harmonics`]). A ring's sums are added to those of the whole burr, in the tool's frame ([`DirectionSums`]).

use nalgebra::Vector3;

use super::input::Tool;
use super::rings::Ring;

/// Σq, Σq cos ψ, Σq sin ψ over the azimuths of one ring.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Harmonics([f64; 3]);

/// Direction sums, tool frame, mm: Σ q e_v dl, Σ q n dl, Σ q e_a dl.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct DirectionSums {
    /// Sum along the blades' motion.
    pub tangential: Vector3<f64>,
    /// Sum along the outward normals.
    pub radial: Vector3<f64>,
    /// Sum along the meridians from tip to shaft.
    pub axial: Vector3<f64>,
}

impl Harmonics {
    /// Adds a node of weight `q` at the azimuth with this cosine and sine.
    #[inline]
    pub fn add(&mut self, q: f64, [c, s]: [f64; 2]) {
        self.0[0] += q;
        self.0[1] += q * c;
        self.0[2] += q * s;
    }

    /// Σq.
    pub fn sum(&self) -> f64 {
        self.0[0]
    }

    /// Σ q cos and Σ q sin of the azimuth in the tool's frame, the ring's turn included.
    fn around(&self, ring: &Ring) -> (f64, f64) {
        let ([_, qc, qs], [tc, ts]) = (self.0, ring.turn);
        (qc * tc - qs * ts, qs * tc + qc * ts)
    }

    /// Σ q n of the ring, tool frame.
    pub fn outwards(&self, ring: &Ring) -> Vector3<f64> {
        let (c, s) = self.around(ring);
        Vector3::new(ring.element.sin * c, ring.element.sin * s, -ring.element.cos * self.sum())
    }
}

impl DirectionSums {
    /// Adds a ring's sums for elements of a length, mm; `spin` as in [`Tool::spin`].
    pub fn add(&mut self, ring: &Ring, q: &Harmonics, length_mm: f64, spin: f64) {
        let ((c, s), (sin, cos)) = (q.around(ring), (ring.element.sin, ring.element.cos));
        self.tangential += Vector3::new(-s, c, 0.0) * (spin * length_mm);
        self.radial += q.outwards(ring) * length_mm;
        self.axial += Vector3::new(cos * c, cos * s, sin * q.sum()) * length_mm;
    }

    /// −(k_t Σ e_v + k_r Σ n + k_a Σ e_a).
    pub fn force(&self, [k_t, k_r, k_a]: [f64; 3]) -> Vector3<f64> {
        -(self.tangential * k_t + self.radial * k_r + self.axial * k_a)
    }

    /// Σ r n × dF: n × e_v = σ e_a and n × e_a = −σ e_v.
    pub fn moment(&self, [k_t, _, k_a]: [f64; 3], tool: &Tool) -> Vector3<f64> {
        (self.axial * -k_t + self.tangential * k_a) * (tool.radius_mm() * tool.spin())
    }

    /// Torque that resists the spin, N mm: k_t Σ q r sin κ dl.
    pub fn torque(&self, k_t: f64, tool: &Tool) -> f64 {
        self.axial.z * k_t * tool.radius_mm()
    }
}
