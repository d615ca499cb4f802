//! The moves of the cutter's tip, in the block's frame, and the frames of the sides.

use nalgebra::Vector3;

/// From where the cutter comes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// From +y.
    A,
    /// From −y, after half a turn about x.
    B,
    /// The outline, and what the strip had covered of the rim.
    C,
}

/// What a move does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Takes stock away in levels.
    Rough,
    /// Makes the surface.
    Finish,
    /// Cuts the holding strip.
    Contour,
    /// Repositioning at rapid speed, across or down to the next cut.
    Link,
    /// Repositioning at rapid speed, up.
    Retract,
}

/// A straight move of the tip from where the move before ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TipMove {
    /// Side.
    pub side: Side,
    /// Kind.
    pub kind: Kind,
    /// Where the tip ends, block's frame, mm, a whole number of micrometres.
    pub tip_mm: Vector3<f64>,
    /// Angle of the rotary axis: 0 or π.
    pub a_rad: f64,
    /// Speed, mm/min.
    pub feed_mm_min: f64,
    /// When it ends by constant speeds, s.
    pub time_s: f64,
}

impl Side {
    /// All.
    pub const ALL: [Self; 3] = [Self::A, Self::B, Self::C];

    /// The name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::A => "A",
            Self::B => "B",
            Self::C => "C",
        }
    }
}

impl Kind {
    /// All.
    pub const ALL: [Self; 5] = [Self::Rough, Self::Finish, Self::Contour, Self::Link, Self::Retract];

    /// The name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Rough => "rough",
            Self::Finish => "finish",
            Self::Contour => "contour",
            Self::Link => "link",
            Self::Retract => "retract",
        }
    }

    /// Whether it is driven with G1.
    pub fn cuts(self) -> bool {
        matches!(self, Self::Rough | Self::Finish | Self::Contour)
    }
}

/// One of the two ways in which the part faces the cutter: u, v, w with w along the cutter's axis, away from the part.
///
/// At A = 0: u = x, v = −z, w = y; at A = π: u = x, v = z, w = −y. These are the machine's X, Y and Z.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Facing {
    /// A = 0.
    Front,
    /// A = π.
    Back,
}

impl Facing {
    fn sign(self) -> f64 {
        if self == Self::Front { 1.0 } else { -1.0 }
    }

    /// The way of a rotary angle that is 0 or π.
    pub fn of(a_rad: f64) -> Self {
        if a_rad.abs() < 1.0 { Self::Front } else { Self::Back }
    }

    /// (u, v, w) of a point of the block's frame, mm.
    pub fn from_block(self, p: &Vector3<f64>) -> Vector3<f64> {
        let s = self.sign();
        Vector3::new(p.x, -s * p.z, s * p.y)
    }

    /// The point of the block's frame at (u, v, w), mm.
    pub fn to_block(self, p: &Vector3<f64>) -> Vector3<f64> {
        let s = self.sign();
        Vector3::new(p.x, s * p.z, -s * p.y)
    }
}
