//! The closed-form inverse of a UR arm: up to eight joint vectors for a flange pose.
//!
//! The axes of joints 2, 3 and 4 are parallel, so z₁ = (s₁, −c₁, 0) is the axis of all three, and the angles are found
//! one after the other:
//!
//! 1. p₅ = p − d₆ z₆ lies d₄ along z₁: s₁ p₅ₓ − c₁ p₅ᵧ = d₄ has two solutions, the shoulders;
//! 2. z₁·z₆ = c₅, z₁·x₆ = c₆ s₅, z₁·y₆ = −s₆ s₅ have two solutions, the wrists, which also give q₆;
//! 3. p₄ = p₅ + d₅ (s₆ x₆ + c₆ y₆) is reached in the plane of joints 2 and 3 in two ways, the elbows;
//! 4. x₄ gives q₂ + q₃ + q₄.
//!
//! Every angle is an arc tangent of two lengths, a sum or difference of such, or half a turn from one. An arc cosine of a
//! ratio is never used, because it is inaccurate near 0 and π.
//!
//! At singular poses the result is defined. Wrist (s₅ = 0): q₆ is free as far as the elbow reaches p₄, which q₆ turns on a
//! circle about p₅; it is the value nearest to the caller's, and both wrists give the same joint vector. Elbow stretched or
//! folded, or shoulder at its edge: the two branches coincide and both are given.
//!
//! Invariants: no value is NaN; every joint vector reproduces the pose to 1e-9 mm and 1e-9 rad (tested on 10⁶ poses); each
//! angle is in [−π, π], and the caller adds turns by 2π. Limits are not checked here.
//!
//! **Source:** geometry as in Hawkins 2013, "Analytic inverse kinematics for the Universal Robots"; the formulas were
//! derived independently.

use std::f64::consts::{PI, TAU};

use bonemill_geometry::{Base, Flange, Rigid};

/// A pose that is beyond reach by less than this is at the edge, mm. It is the rounding error of a pose whose shoulder and
/// elbow are both singular, and half the error that a solution may have.
const EDGE_MM: f64 = 5e-10;

/// At |s₅| up to this value q₆ is free: taken as 0 it moves the flange by at most d₆ |s₅| < 5e-10 mm. Rounding makes |s₅| of a
/// singular wrist as large where the shoulder is nearly singular, too.
const WRIST_SINGULAR: f64 = 4e-12;

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
    /// Distance from the first to the second wrist joint.
    pub d5_mm: f64,
    /// Distance from the second wrist joint to the flange.
    pub d6_mm: f64,
}

/// The solutions of the inverse kinematics.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UrSolutions {
    /// Joint vectors, rad, by branch: 4·shoulder + 2·wrist + elbow, each 0 or 1; `None` where the branch does not reach.
    pub branches: [Option<[f64; 6]>; 8],
    /// |s₃ s₅ w| by branch, mm: the factors of the Jacobian's determinant, 0 at a singularity. w is the distance of the origin
    /// of frame 5 from the first axis, in the plane of the arm.
    pub from_singular_mm: [f64; 8],
    /// How far the flange must be moved before a branch reaches it, mm: the least of the ways that were tried. 0 where a
    /// branch reaches.
    pub short_mm: f64,
    /// Whether q₆ was free, so that the value nearest to the caller's was used.
    pub wrist_singular: bool,
}

impl UrSolutions {
    fn none() -> Self {
        Self {
            branches: [None; 8],
            from_singular_mm: [0.0; 8],
            short_mm: f64::INFINITY,
            wrist_singular: false,
        }
    }

    /// The joint vectors of the branches that reach, each with its branch.
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
    /// All joint vectors that bring the flange to a pose. Where the pose leaves q₆ free, it is the value nearest to
    /// `free_q6_rad` at which the elbow reaches.
    pub fn inverse(&self, base_from_flange: &Rigid<Base, Flange>, free_q6_rad: f64) -> UrSolutions {
        let r = base_from_flange.rotation.matrix();
        let p = &base_from_flange.translation_mm;
        let [x6, y6, z6] = [0, 1, 2].map(|k| [r[(0, k)], r[(1, k)], r[(2, k)]]);
        let p5: [f64; 3] = std::array::from_fn(|k| p[k] - self.d6_mm * z6[k]);
        let mut found = UrSolutions::none();
        let across = length(p5[0], p5[1]);
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
            let in_plane = |v: &[f64; 3]| [c1 * v[0] + s1 * v[1], v[2]];
            let (cx, cy, c5) = (on_z1(&x6), on_z1(&y6), on_z1(&z6));
            let s5 = length(cx, cy);
            let free = s5 <= WRIST_SINGULAR;
            found.wrist_singular |= free;
            let (x6, y6, z6) = (in_plane(&x6), in_plane(&y6), in_plane(&z6));
            let p5 = [along, p5[2] - self.d1_mm];
            let (s6, c6, q6) = if free {
                let q6 = self.nearest_within_reach(free_q6_rad, &x6, &y6, &p5);
                (q6.sin(), q6.cos(), q6)
            } else {
                let (s6, c6) = (-cy / s5, cx / s5);
                (s6, c6, s6.atan2(c6))
            };
            let s5 = if free { 0.0 } else { s5 };
            // x₅ and y₅ = −z₄ of the wrist's frames, and then x₄
            let x5: [f64; 2] = std::array::from_fn(|k| c6 * x6[k] - s6 * y6[k]);
            let y5: [f64; 2] = std::array::from_fn(|k| s6 * x6[k] + c6 * y6[k]);
            let x4: [f64; 2] = std::array::from_fn(|k| c5 * x5[k] - s5 * z6[k]);
            let wrist = Wrist { y5, q234: x4[1].atan2(x4[0]), q5: s5.atan2(c5), q6 };
            let plane = Plane { geometry: self, q1: s1.atan2(c1), p5 };
            for (turned, wrist) in
                [&wrist, &if free { wrist } else { wrist.turned() }].into_iter().enumerate()
            {
                let at = 4 * shoulder + 2 * turned;
                match plane.elbows(wrist) {
                    Ok(elbows) => {
                        found.branches[at] = Some(elbows.q[0]);
                        found.branches[at + 1] = Some(elbows.q[1]);
                        found.from_singular_mm[at..at + 2].fill((along * s5 * elbows.s3).abs());
                        found.short_mm = 0.0;
                    }
                    Err(short_mm) => found.short_mm = found.short_mm.min(short_mm),
                }
            }
        }
        found
    }

    /// The value of a free q₆ nearest to `q6_rad` at which the elbow reaches p₄ = p₅ + d₅ y₅; where none does, the value that
    /// brings p₄ nearest to its reach. x₆, y₆ and p₅ are in the arm's plane.
    ///
    /// With y₅ at the angle ψ from p₅, |p₄|² = p₅² + d₅² + 2 p₅ d₅ cos ψ: the reach bounds |ψ| on both sides, and ψ changes by
    /// as much as q₆.
    fn nearest_within_reach(&self, q6_rad: f64, x6: &[f64; 2], y6: &[f64; 2], p5: &[f64; 2]) -> f64 {
        let (s6, c6) = q6_rad.sin_cos();
        let y5: [f64; 2] = std::array::from_fn(|k| s6 * x6[k] + c6 * y6[k]);
        let psi = (p5[0] * y5[1] - p5[1] * y5[0]).atan2(p5[0] * y5[0] + p5[1] * y5[1]);
        let squares = p5[0] * p5[0] + p5[1] * p5[1] + self.d5_mm * self.d5_mm;
        let twice = 2.0 * length(p5[0], p5[1]) * self.d5_mm;
        // |ψ| at which |p₄| is this long
        let at = |mm: f64| ((mm * mm - squares) / twice).clamp(-1.0, 1.0).acos();
        let [longest, shortest] = self.reach_mm().map(at);
        let (least, most) = (longest.min(shortest), longest.max(shortest));
        if !(least.is_finite() && most.is_finite()) {
            return q6_rad;
        }
        let turn = psi.abs().clamp(least, most).copysign(psi) - psi;
        // y₅ turns from y₆ to x₆ as q₆ grows
        wrapped(q6_rad + turn * (y6[0] * x6[1] - y6[1] * x6[0]).signum())
    }

    /// The largest and the least distance between the second joint's axis and the fourth's, mm.
    fn reach_mm(&self) -> [f64; 2] {
        [(self.a2_mm + self.a3_mm).abs(), (self.a2_mm - self.a3_mm).abs()]
    }

    /// Height of the lowest link after the shoulder above the mounting plane, mm; links are lines from joint to joint. `q` must
    /// bring the flange to the pose.
    pub fn lowest_link_mm(&self, q: &[f64; 6], base_from_flange: &Rigid<Base, Flange>) -> f64 {
        let elbow_mm = self.d1_mm + self.a2_mm * q[1].sin();
        let wrist_mm = elbow_mm + self.a3_mm * (q[1] + q[2]).sin();
        let flange_mm = base_from_flange.translation_mm.z;
        let p5_mm = flange_mm - self.d6_mm * base_from_flange.rotation.matrix()[(2, 2)];
        self.d1_mm.min(elbow_mm).min(wrist_mm).min(p5_mm).min(flange_mm)
    }

    /// The distance out of the cylinder of radius d₄ about the first axis, which no branch reaches, and from there into reach.
    fn way_out_mm(&self, pose: &Rigid<Base, Flange>, p5: &[f64; 3], across: f64) -> f64 {
        let out_mm = self.d4_mm - across;
        if !out_mm.is_finite() {
            return f64::INFINITY;
        }
        let way = if across > 0.0 { [p5[0] / across, p5[1] / across] } else { [1.0, 0.0] };
        let out = nalgebra::Vector3::new(way[0], way[1], 0.0) * (out_mm + 2.0 * EDGE_MM);
        // there z₁ points along the way out, and the distance that the elbow lacks is perpendicular to it
        let beyond_mm = self.inverse(&Rigid::new(pose.rotation, pose.translation_mm + out), 0.0).short_mm;
        out_mm.hypot(beyond_mm)
    }
}

/// The wrist of one branch.
#[derive(Debug, Clone, Copy)]
struct Wrist {
    /// Outward and up.
    y5: [f64; 2],
    q234: f64,
    q5: f64,
    q6: f64,
}

impl Wrist {
    /// The other wrist: s₅, s₆, c₆, x₄ and y₅ change their signs.
    fn turned(self) -> Self {
        let opposite = |angle: f64| angle - PI.copysign(angle);
        Self { y5: self.y5.map(|y| -y), q234: opposite(self.q234), q5: -self.q5, q6: opposite(self.q6) }
    }
}

/// The plane in which joints 2 and 3 move, for one shoulder.
struct Plane<'a> {
    geometry: &'a UrGeometry,
    q1: f64,
    /// Outward and up from the shoulder, mm.
    p5: [f64; 2],
}

/// The two solutions of the elbow.
struct Elbows {
    q: [[f64; 6]; 2],
    /// |s₃|, the same for both.
    s3: f64,
}

impl Plane<'_> {
    /// Both elbows, or how far the wrist is out of reach, mm.
    fn elbows(&self, wrist: &Wrist) -> Result<Elbows, f64> {
        let g = self.geometry;
        let [x, y]: [f64; 2] = std::array::from_fn(|k| self.p5[k] + g.d5_mm * wrist.y5[k]);
        let [longest, shortest] = g.reach_mm();
        let length = length(x, y);
        let short_mm = (length - longest).max(shortest - length);
        if !short_mm.is_finite() || short_mm > EDGE_MM {
            return Err(short_mm);
        }
        let half = 0.5 / (g.a2_mm * g.a3_mm);
        // 1 − c₃ and 1 + c₃ as products, which are accurate at both ends
        let less = ((longest - length) * (longest + length) * half).max(0.0);
        let more = ((length - shortest) * (length + shortest) * half).max(0.0);
        let (less_root, more_root) = (less.sqrt(), more.sqrt());
        let q3 = 2.0 * less_root.atan2(more_root);
        let (s3, c3) = (less_root * more_root, 0.5 * (more - less));
        // the angle that the elbow adds to the upper arm's angle; its sign depends on the elbow
        let aside = (g.a3_mm * s3).atan2(g.a2_mm + g.a3_mm * c3);
        let direct = y.atan2(x);
        let q = [1.0, -1.0].map(|sign| {
            let (q2, q3) = (wrapped(direct - sign * aside), sign * q3);
            [self.q1, q2, q3, wrapped(wrist.q234 - q2 - q3), wrist.q5, wrist.q6]
        });
        Ok(Elbows { q, s3 })
    }
}

/// √(x² + y²) without protection from overflow, which lengths of metres do not need.
fn length(x: f64, y: f64) -> f64 {
    (x * x + y * y).sqrt()
}

/// The same angle in [−π, π]; for angles of at most a few turns.
pub fn wrapped(angle_rad: f64) -> f64 {
    if angle_rad.abs() <= PI {
        return angle_rad;
    }
    let turns = if angle_rad.abs() < 3.0 * PI { 1f64.copysign(angle_rad) } else { (angle_rad / TAU).round() };
    (angle_rad - TAU * turns).clamp(-PI, PI)
}
