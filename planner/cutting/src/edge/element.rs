//! One element: from its angles to the force per chip area, in the tool's frame.

use crate::cutter::EdgeElement;
use nalgebra::Vector3;

/// A_u = f δ cos μ/N_c, mm²: what an element cuts, perpendicular to its velocity. δ is its radial width.
///
/// **Source:** Faieghi et al., II-D; that δ is radial follows from the area swept by an edge, docs/force-model.md 9.
pub fn uncut_area_mm2(element: &EdgeElement, feed_mm_rev: f64) -> f64 {
    feed_mm_rev * element.width_mm * element.mu_rad.cos() * element.feed_share
}

/// Unit forces ON the cutter by df_n and by df_t, in the element's frame (x radial, z along the shaft): the columns of R T,
///
/// ```text
/// T = [ −cos γ sin λ    sin η cos λ − cos η sin γ sin λ ]      R = [ cos τ        0       −sin τ       ]
///     [ −cos γ cos λ  −(cos η sin γ cos λ + sin η sin λ)]          [ sin τ sin μ  cos μ    cos τ sin μ ]
///     [ −sin γ          cos η cos γ                     ]          [ sin τ cos μ  −sin μ   cos τ cos μ ]
/// ```
///
/// with the chip's direction η = λ. The two columns are orthogonal unit vectors.
///
/// **Source:** Faieghi et al., (2) to (5); the sign of T's second row and the order of the columns after docs/force-model.md 9;
/// η = λ is Stabler's rule.
pub fn force_directions(element: &EdgeElement) -> [Vector3<f64>; 2] {
    let ((sl, cl), (sg, cg)) = (element.lambda_rad.sin_cos(), element.gamma_n_rad.sin_cos());
    let (se, ce) = (sl, cl);
    let ((st, ct), (sm, cm)) = (element.tau_rad.sin_cos(), element.mu_rad.sin_cos());
    let normal = Vector3::new(-cg * sl, -cg * cl, -sg);
    let friction = Vector3::new(se * cl - ce * sg * sl, -(ce * sg * cl + se * sl), ce * cg);
    [normal, friction].map(|e| {
        Vector3::new(
            ct * e.x - st * e.z,
            st * sm * e.x + cm * e.y + ct * sm * e.z,
            st * cm * e.x - sm * e.y + ct * cm * e.z,
        )
    })
}

/// The force ON an element in bone of the reference density, N, in its frame; k_c in N/mm².
pub fn element_force(element: &EdgeElement, feed_mm_rev: f64, [k_c, k_f]: [f64; 2]) -> Vector3<f64> {
    let normal_n = k_c * uncut_area_mm2(element, feed_mm_rev);
    let [normal, friction] = force_directions(element);
    normal * normal_n + friction * (k_f * normal_n)
}
