//! Equation (4) as it is written: every element of every blade at every increment, and every derived output.
//!
//! This is the reference for the faster kernels: nothing is factored out, so that it reads against the equations.

use std::f64::consts::PI;

use bonemill_geometry::{Frame, Point};
use nalgebra::Vector3;

use super::input::{Discretisation, Material, Motion, Tool};

/// A grazing element counts only above this fraction of the feed per tooth: the sign of less is rounding.
pub const GRAZING: f64 = 1e-12;

/// What the bone does to the burr. Vectors without "tool" are in the frame of the motion.
#[derive(Debug, Clone, PartialEq)]
pub struct BurrForce {
    /// Mean force on the burr over a turn, N.
    pub force_n: Vector3<f64>,
    /// Mean moment about the burr's centre, N mm.
    pub moment_nmm: Vector3<f64>,
    /// The force in the tool frame, N.
    pub force_tool_n: Vector3<f64>,
    /// The moment in the tool frame, N mm.
    pub moment_tool_nmm: Vector3<f64>,
    /// Resisting torque −σ M_z, N mm.
    pub torque_nmm: f64,
    /// Torque times angular velocity, mW (N mm/s).
    pub spindle_power_mw: f64,
    /// −F·v, mW (N mm/s).
    pub feed_power_mw: f64,
    /// Removal rate of everything that has weight, mm³/s.
    pub mrr_mm3_s: f64,
    /// Removal rate weighted with w: mm³/s of material at the reference density.
    pub weighted_mrr_mm3_s: f64,
    /// Area of surface that moves into bone, mm².
    pub contact_area_mm2: f64,
    /// Thickest chip that is cut, mm.
    pub t_max_mm: f64,
    /// Force in the tool frame per unit of K_t, K_r, K_a: mm².
    pub basis_cut_mm2: [Vector3<f64>; 3],
    /// Force in the tool frame per unit of K_te, K_re, K_ae: mm.
    pub basis_edge_mm: [Vector3<f64>; 3],
    /// Largest total over the blades at one increment of rotation, N.
    pub peak_force_n: f64,
}

/// The mean force on the burr: F = (1/N_γ) Σ_i Σ_j Σ_k dF_ijk, and what follows from the same nodes.
///
/// `density_g_cm3` gives the bone's density at a point; it is sampled at c + (r + δ) n, only where the surface moves forward.
/// v = 0 gives zero for everything.
///
/// **Source:** Dillon et al. 2016, equations (3) and (4); the chip, the frame and the edge term as docs/force-model.md 1–4.
pub fn burr_force<F: Frame>(
    density_g_cm3: impl Fn(Point<F>) -> f64,
    tool: &Tool,
    material: &Material,
    disc: &Discretisation,
    motion: &Motion<F>,
) -> BurrForce {
    let (r, sigma) = (tool.radius_mm(), tool.spin());
    let blades = tool.blades() as usize;
    let n_gamma = disc.n_gamma();
    let rotation = motion.rotation();
    let v_tool = rotation.inverse() * motion.velocity_mm_s();
    let f = 60.0 * v_tool / (motion.spindle_rpm() * blades as f64);
    let graze = GRAZING * f.norm();
    let pitch = 2.0 * PI / blades as f64;
    let d_psi = 2.0 * PI / (blades * n_gamma) as f64;

    let elements: Vec<_> = (0..disc.n_kappa()).map(|k| disc.element(tool, k)).collect();
    let mut cut = [Vector3::zeros(); 3];
    let mut edge = [Vector3::zeros(); 3];
    let mut cut_moment = [Vector3::zeros(); 3];
    let mut edge_moment = [Vector3::zeros(); 3];
    let (mut mrr, mut weighted_mrr, mut area, mut t_max, mut peak) = (0.0, 0.0, 0.0, 0f64, 0f64);

    for j in 0..n_gamma {
        let mut instant = Vector3::zeros();
        for i in 0..blades {
            for element in &elements {
                let psi = i as f64 * pitch + sigma * (j as f64 + 0.5) * pitch / n_gamma as f64
                    - sigma * tool.lag_rad(element.kappa_rad);
                let (sp, cp) = psi.sin_cos();
                let (sk, ck) = (element.sin, element.cos);
                let n = Vector3::new(sk * cp, sk * sp, -ck);
                let t = n.dot(&f);
                // not even for v = 0
                if t <= graze {
                    continue;
                }
                let x = motion.center() + rotation * n * (r + disc.sample_offset_mm());
                let w = material.weight(density_g_cm3(x));
                if w <= 0.0 {
                    continue;
                }
                let directions =
                    [Vector3::new(-sp, cp, 0.0) * sigma, n, Vector3::new(ck * cp, ck * sp, sk)].map(|d| -d);
                let p = n * r;
                for m in 0..3 {
                    let d_cut = directions[m] * (t * w * element.dl_mm);
                    let d_edge = directions[m] * (material.edge_factor(t) * w * element.edge_mm);
                    cut[m] += d_cut;
                    edge[m] += d_edge;
                    cut_moment[m] += p.cross(&d_cut);
                    edge_moment[m] += p.cross(&d_edge);
                    instant += d_cut * material.k_n_mm2()[m] + d_edge * material.k_edge_n_mm()[m];
                }
                let d_area = r * element.dz_mm * d_psi;
                let rate = n.dot(&v_tool) * d_area;
                mrr += rate;
                weighted_mrr += w * rate;
                area += d_area;
                t_max = t_max.max(t);
            }
        }
        peak = peak.max(instant.norm());
    }

    let mean = |sums: [Vector3<f64>; 3]| sums.map(|s| s / n_gamma as f64);
    let (basis_cut_mm2, basis_edge_mm) = (mean(cut), mean(edge));
    let total = |of_cut: &[Vector3<f64>; 3], of_edge: &[Vector3<f64>; 3]| -> Vector3<f64> {
        (0..3).map(|m| of_cut[m] * material.k_n_mm2()[m] + of_edge[m] * material.k_edge_n_mm()[m]).sum()
    };
    let force_tool_n = total(&basis_cut_mm2, &basis_edge_mm);
    let moment_tool_nmm = total(&mean(cut_moment), &mean(edge_moment));
    let force_n = rotation * force_tool_n;
    // + 0.0: no minus zero in air
    let torque_nmm = -sigma * moment_tool_nmm.z + 0.0;
    BurrForce {
        force_n,
        moment_nmm: rotation * moment_tool_nmm,
        force_tool_n,
        moment_tool_nmm,
        torque_nmm,
        spindle_power_mw: torque_nmm * 2.0 * PI * motion.spindle_rpm() / 60.0,
        feed_power_mw: -force_n.dot(&motion.velocity_mm_s()) + 0.0,
        mrr_mm3_s: mrr,
        weighted_mrr_mm3_s: weighted_mrr,
        contact_area_mm2: area,
        t_max_mm: t_max,
        basis_cut_mm2,
        basis_edge_mm,
        peak_force_n: peak,
    }
}
