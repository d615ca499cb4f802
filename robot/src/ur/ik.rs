//! The closed-form inverse of a UR arm: up to eight joint vectors for a flange pose.
//!
//! Joints 2, 3 and 4 are parallel, so z₁ = (s₁, −c₁, 0) is the axis of all three, and the pose splits:
//!
//! 1. p₅ = p − d₆ z₆ lies d₄ along z₁: s₁ p₅ₓ − c₁ p₅ᵧ = d₄, two shoulders;
//! 2. z₁·z₆ = c₅, z₁·x₆ = c₆ s₅, z₁·y₆ = −s₆ s₅: two wrists, q₆ with them;
//! 3. p₄ = p₅ + d₅ (s₆ x₆ + c₆ y₆) is reached in the plane of joints 2 and 3: two elbows;
//! 4. x₄ gives q₂ + q₃ + q₄.
//!
//! Every angle is an arc tangent of two lengths, never an arc cosine of a ratio, so that nothing is lost near the ends.
//!
//! Singular poses have a stated answer. Wrist (s₅ = 0): q₆ is free and taken from the caller, both wrists give the same.
//! Elbow stretched or folded, shoulder at its edge: the two branches coincide and both are given.
//!
//! Invariants: never NaN; every vector given reproduces the pose to 1e-9 mm and 1e-9 rad (a test with 10⁶ poses), each
//! angle in [−π, π]; turns by 2π are the caller's. Limits are not checked here.
//!
//! **Source:** geometry as in Hawkins 2013, "Analytic inverse kinematics for the Universal Robots"; derived anew here.

use std::f64::consts::PI;

use bonemill_geometry::{Base, Flange, Rigid};

/// A pose this little beyond reach is at the edge, mm: what rounding makes of a pose whose shoulder and elbow are both
/// singular, and half of what a solution may be off.
const EDGE_MM: f64 = 5e-10;

/// |s₅| at or below which q₆ is free.
const WRIST_SINGULAR: f64 = 1e-12;

/// The lengths of a UR arm's DH table, mm, with their signs (a₂ and a₃ are negative).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UrGeometry {
    /// Height of the shoulder.
    pub d1_mm: f64,
    /// Upper arm.
    pub a2_mm: f64,
    /// Forearm.
    pub a3_mm: f64,
    /// Offset of the wrist along the parallel axes.
    pub d4_mm: f64,
    /// From the first to the second wrist joint.
    pub d5_mm: f64,
    /// From the second wrist joint to the flange.
    pub d6_mm: f64,
}

/// What the inverse gives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UrSolutions {
    /// Joint vectors, rad, by branch: 4·shoulder + 2·wrist + elbow, each 0 or 1; `None` where the branch does not reach.
    pub branches: [Option<[f64; 6]>; 8],
    /// By how much the flange has to be moved, the best way that was looked at, for a branch to reach, mm; 0 where one does.
    pub short_mm: f64,
    /// Whether q₆ was free and taken from the caller.
    pub wrist_singular: bool,
}

impl UrSolutions {
    /// The joint vectors there are, with their branch.
    pub fn iter(&self) -> impl Iterator<Item = (usize, &[f64; 6])> {
        self.branches.iter().enumerate().filter_map(|(branch, q)| Some((branch, q.as_ref()?)))
    }

    /// Number of joint vectors.
    pub fn len(&self) -> usize {
        self.branches.iter().flatten().count()
    }

    /// Whether the pose is out of reach.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

impl UrGeometry {
    /// All joint vectors that bring the flange to a pose; `free_q6_rad` is q₆ where the pose leaves it free.
    pub fn inverse(&self, base_from_flange: &Rigid<Base, Flange>, free_q6_rad: f64) -> UrSolutions {
        let r = base_from_flange.rotation.matrix();
        let p = &base_from_flange.translation_mm;
        let [x6, y6, z6] = [0, 1, 2].map(|k| [r[(0, k)], r[(1, k)], r[(2, k)]]);
        let p5: [f64; 3] = std::array::from_fn(|k| p[k] - self.d6_mm * z6[k]);
        let mut found = UrSolutions { branches: [None; 8], short_mm: f64::INFINITY, wrist_singular: false };
        let across = p5[0].hypot(p5[1]);
        if !across.is_finite() || across < self.d4_mm - EDGE_MM {
            found.short_mm = self.way_out_mm(base_from_flange, &p5, across);
            return found;
        }
        let along = ((across - self.d4_mm) * (across + self.d4_mm)).max(0.0).sqrt();
        let per_square = (across * across).recip();
        for (shoulder, along) in [along, -along].into_iter().enumerate() {
            let s1 = (p5[1] * along + p5[0] * self.d4_mm) * per_square;
            let c1 = (p5[0] * along - p5[1] * self.d4_mm) * per_square;
            let on_z1 = |v: &[f64; 3]| s1 * v[0] - c1 * v[1];
            let (cx, cy, c5) = (on_z1(&x6), on_z1(&y6), on_z1(&z6));
            let s5_size = cx.hypot(cy);
            let free = s5_size <= WRIST_SINGULAR;
            found.wrist_singular |= free;
            let plane = Plane { geometry: self, s1, c1, q1: s1.atan2(c1), p5: &p5, z6: &z6 };
            for wrist in 0..2 {
                let sign = if wrist == 0 { 1.0 } else { -1.0 };
                let (s5, s6, c6, q6) = if free {
                    let (s6, c6) = free_q6_rad.sin_cos();
                    (0.0, s6, c6, free_q6_rad)
                } else {
                    let (s6, c6) = (-sign * cy / s5_size, sign * cx / s5_size);
                    (sign * s5_size, s6, c6, s6.atan2(c6))
                };
                let rolled = Rolled {
                    // x₅ and −z₄ of the wrist's frames
                    x5: std::array::from_fn(|k| c6 * x6[k] - s6 * y6[k]),
                    y5: std::array::from_fn(|k| s6 * x6[k] + c6 * y6[k]),
                    s5,
                    c5,
                    q5: s5.atan2(c5),
                    q6,
                };
                let at = 4 * shoulder + 2 * wrist;
                match plane.elbows(&rolled) {
                    Ok(both) => {
                        found.branches[at] = Some(both[0]);
                        found.branches[at + 1] = Some(both[1]);
                        found.short_mm = 0.0;
                    }
                    Err(short_mm) => found.short_mm = found.short_mm.min(short_mm),
                }
            }
        }
        found
    }

    /// The way out of the cylinder of radius d₄ about the first axis, which no branch reaches, and from there into reach.
    fn way_out_mm(&self, pose: &Rigid<Base, Flange>, p5: &[f64; 3], across: f64) -> f64 {
        let out_mm = self.d4_mm - across;
        if !out_mm.is_finite() {
            return f64::INFINITY;
        }
        let way = if across > 0.0 { [p5[0] / across, p5[1] / across] } else { [1.0, 0.0] };
        let out = nalgebra::Vector3::new(way[0], way[1], 0.0) * (out_mm + 2.0 * EDGE_MM);
        // z₁ is along the way out there, and what the elbow lacks is across it
        let beyond_mm = self.inverse(&Rigid::new(pose.rotation, pose.translation_mm + out), 0.0).short_mm;
        out_mm.hypot(beyond_mm)
    }
}

/// The wrist as one branch rolls it.
struct Rolled {
    x5: [f64; 3],
    y5: [f64; 3],
    s5: f64,
    c5: f64,
    q5: f64,
    q6: f64,
}

/// The plane in which joints 2 and 3 move, for one shoulder.
struct Plane<'a> {
    geometry: &'a UrGeometry,
    s1: f64,
    c1: f64,
    q1: f64,
    p5: &'a [f64; 3],
    z6: &'a [f64; 3],
}

impl Plane<'_> {
    /// Both elbows, or how many mm the wrist is out of their reach.
    fn elbows(&self, wrist: &Rolled) -> Result<[[f64; 6]; 2], f64> {
        let g = self.geometry;
        let p4: [f64; 3] = std::array::from_fn(|k| self.p5[k] + g.d5_mm * wrist.y5[k]);
        let x4: [f64; 3] = std::array::from_fn(|k| wrist.c5 * wrist.x5[k] - wrist.s5 * self.z6[k]);
        let outward = |v: &[f64; 3]| self.c1 * v[0] + self.s1 * v[1];
        let (x, y) = (outward(&p4), p4[2] - g.d1_mm);
        let (longest, shortest) = ((g.a2_mm + g.a3_mm).abs(), (g.a2_mm - g.a3_mm).abs());
        let length = x.hypot(y);
        let short_mm = (length - longest).max(shortest - length);
        if !short_mm.is_finite() || short_mm > EDGE_MM {
            return Err(short_mm);
        }
        let half = 0.5 / (g.a2_mm * g.a3_mm);
        // 1 − c₃ and 1 + c₃ as products: exact to the last digit at both ends
        let less = ((longest - length) * (longest + length) * half).max(0.0);
        let more = ((length - shortest) * (length + shortest) * half).max(0.0);
        let q3_size = 2.0 * less.sqrt().atan2(more.sqrt());
        let (s3_size, c3) = ((less * more).sqrt(), 0.5 * (more - less));
        let q234 = x4[2].atan2(outward(&x4));
        Ok([1.0, -1.0].map(|sign| {
            let (k1, k2) = (g.a2_mm + g.a3_mm * c3, sign * g.a3_mm * s3_size);
            let q2 = (k1 * y - k2 * x).atan2(k1 * x + k2 * y);
            let q3 = sign * q3_size;
            [self.q1, q2, q3, wrapped(q234 - q2 - q3), wrist.q5, wrist.q6]
        }))
    }
}

/// The same direction in [−π, π], for angles a few turns at most away.
pub(crate) fn wrapped(angle_rad: f64) -> f64 {
    if angle_rad.abs() <= PI {
        return angle_rad;
    }
    let turned = angle_rad - 2.0 * PI * (angle_rad / (2.0 * PI)).round();
    turned.clamp(-PI, PI)
}
