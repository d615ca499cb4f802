//! What kind of work a case asks for: bone milled layer by layer, or a straight channel along which a tool is pushed.

use nalgebra::Vector3;

use super::LabelRef;

/// The kind of work.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum Job {
    /// `[target]` is milled in layers: `path.pattern = "lawnmower"`.
    #[default]
    Bone,
    /// A tool is pushed straight along its axis: `path.pattern = "plunge"` or `"ream"`.
    Channel(ChannelSpec),
}

/// `path.pattern`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pattern {
    /// Layers of serpentine lines.
    Lawnmower,
    /// A drill along its axis.
    Plunge,
    /// A reamer along its axis.
    Ream,
}

/// A straight channel.
#[derive(Debug, Clone, PartialEq)]
pub struct ChannelSpec {
    /// [`Pattern::Plunge`] or [`Pattern::Ream`].
    pub pattern: Pattern,
    /// Where it begins.
    pub entry: Entry,
    /// Where it leads.
    pub direction: ChannelDirection,
    /// Where it ends.
    pub end: ChannelEnd,
    /// With a direction that is searched: its largest angle from `approach.direction`, where that is given, degrees.
    pub cone_deg: f64,
    /// How fast the tool is pushed.
    pub feed: FeedSpec,
    /// Depth between two retractions, mm; `None`: none.
    pub peck_mm: Option<f64>,
    /// How long the tool turns at the end before it is drawn back, s.
    pub dwell_s: f64,
    /// How far before the entry the tool begins and ends, mm.
    pub standoff_mm: f64,
    /// Distance of neighbouring waypoints while cutting, mm.
    pub step_mm: f64,
    /// Largest probability with which a structure may be touched, 0..1.
    pub touch_probability: f64,
    /// Standard deviation of the registration's error along each axis where there are no fiducials, mm.
    pub registration_sigma_mm: f64,
}

/// Where a channel begins.
#[derive(Debug, Clone, PartialEq)]
pub enum Entry {
    /// The tip is here when the depth is 0, ct, mm.
    Point(Vector3<f64>),
    /// On the bone's surface, in voxels of this label.
    Label(LabelRef),
    /// On the bone's surface, in a ball of ct.
    Ball {
        /// Its centre, mm.
        center_mm: Vector3<f64>,
        /// Its radius, mm.
        radius_mm: f64,
    },
    /// Wherever the line leaves the bone.
    Surface,
}

/// Where a channel leads.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ChannelDirection {
    /// Into the bone, ct, unit.
    Given(Vector3<f64>),
    /// From the entry to the target.
    ToTarget,
    /// The direction that keeps the largest weighted clearance.
    Safest,
}

/// Where a channel ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ChannelEnd {
    /// The tip ends here, ct, mm.
    Target(Vector3<f64>),
    /// So far from the entry along the direction, mm.
    Depth(f64),
    /// Where so much of the tool's surface is in bone, mm².
    ContactArea(f64),
}

/// How fast the tool is pushed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FeedSpec {
    /// mm per revolution of the spindle.
    PerRevolution(f64),
    /// mm/s.
    Speed(f64),
}

impl FeedSpec {
    /// Speed at a spindle speed, mm/s.
    pub fn speed_mm_s(self, spindle_rpm: f64) -> f64 {
        match self {
            Self::PerRevolution(mm) => mm * spindle_rpm / 60.0,
            Self::Speed(mm_s) => mm_s,
        }
    }

    /// Feed per revolution at a spindle speed, mm.
    pub fn per_revolution_mm(self, spindle_rpm: f64) -> f64 {
        match self {
            Self::PerRevolution(mm) => mm,
            Self::Speed(mm_s) => mm_s * 60.0 / spindle_rpm,
        }
    }
}

impl Job {
    /// The channel, where one is asked for.
    pub fn channel(&self) -> Option<&ChannelSpec> {
        match self {
            Self::Bone => None,
            Self::Channel(channel) => Some(channel),
        }
    }
}
