//! One joint of an arm and its limits.

/// How a joint moves; this decides its units.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JointKind {
    /// It moves along its axis: mm, mm/s, mm/s².
    Prismatic,
    /// It turns about its axis: rad, rad/s, rad/s².
    Revolute,
}

impl JointKind {
    /// Unit of the joint's position: "mm" or "rad".
    pub fn unit(self) -> &'static str {
        match self {
            Self::Prismatic => "mm",
            Self::Revolute => "rad",
        }
    }
}

/// A moving joint: name and limits, in mm or rad by its kind.
#[derive(Debug, Clone, PartialEq)]
pub struct Joint {
    /// Name in the URDF.
    pub name: String,
    /// How it moves; this decides its units.
    pub kind: JointKind,
    /// Lowest position, mm or rad; −∞ for a continuous joint.
    pub lower: f64,
    /// Highest position, mm or rad; +∞ for a continuous joint.
    pub upper: f64,
    /// Greatest speed in both directions, mm/s or rad/s; above 0.
    pub velocity_limit: f64,
    /// Greatest acceleration in both directions, mm/s² or rad/s²; above 0.
    pub acceleration_limit: f64,
    /// Greatest jerk in both directions, mm/s³ or rad/s³; above 0.
    pub jerk_limit: f64,
}

impl Joint {
    /// Whether its range has both ends.
    pub fn is_bounded(&self) -> bool {
        self.lower.is_finite() && self.upper.is_finite()
    }
}

/// The acceleration limit where none is given: full speed within 0.1 s. Assumed.
pub(super) fn assumed_acceleration(velocity_limit: f64) -> f64 {
    const PER_S: f64 = 10.0;
    velocity_limit * PER_S
}

/// The jerk limit where none is given: full acceleration within 0.02 s. Assumed.
pub(super) fn assumed_jerk(acceleration_limit: f64) -> f64 {
    const PER_S: f64 = 50.0;
    acceleration_limit * PER_S
}

/// A joint position beyond its limits, and by how much.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointExcess {
    /// Index of the joint, from 0.
    pub joint: usize,
    /// The requested position, mm or rad.
    pub position: f64,
    /// The limit that it exceeds, mm or rad.
    pub limit: f64,
    /// Distance beyond the limit, mm or rad; above 0.
    pub excess: f64,
    /// How the joint moves; this decides the unit.
    pub kind: JointKind,
}

impl std::fmt::Display for JointExcess {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let unit = self.kind.unit();
        write!(
            f,
            "out of reach by {:.4} {unit}: joint {} would stand at {:.4} {unit}, its limit is {:.4} {unit}",
            self.excess, self.joint, self.position, self.limit
        )
    }
}

/// The joint furthest beyond its range; `None` if all are within. An excess below 1e-12 of the limit counts as rounding.
pub(super) fn worst_excess(joints: &[Joint], q: &[f64]) -> Option<JointExcess> {
    let excess = |(index, (joint, &position)): (usize, (&Joint, &f64))| {
        let limit = position.clamp(joint.lower, joint.upper);
        let excess = (position - limit).abs();
        let beyond = excess > 1e-12 * limit.abs();
        beyond.then_some(JointExcess { joint: index, position, limit, excess, kind: joint.kind })
    };
    let share = |e: &JointExcess| {
        let joint = &joints[e.joint];
        e.excess / (joint.upper - joint.lower)
    };
    joints.iter().zip(q).enumerate().filter_map(excess).max_by(|a, b| share(a).total_cmp(&share(b)))
}
