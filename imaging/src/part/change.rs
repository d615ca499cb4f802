//! What a repair changed, and by how much.

use std::fmt;

/// One kind of change to a mesh.
#[derive(Debug, Clone, PartialEq)]
pub enum Change {
    /// Vertices on open edges were joined with others nearby.
    Welded {
        /// Vertices that moved.
        vertices: usize,
        /// Largest move, mm.
        largest_move_mm: f64,
    },
    /// Facets with two equal corners, or without area, were taken out.
    DegenerateDropped {
        /// Facets.
        facets: usize,
    },
    /// Facets that stood several times were taken out.
    DuplicatesDropped {
        /// Facets.
        facets: usize,
    },
    /// Small separate pieces were dropped.
    DebrisDropped {
        /// Pieces.
        pieces: usize,
        /// Facets.
        facets: usize,
        /// Area of them all, mm².
        area_mm2: f64,
    },
    /// Facets were turned so that all face outwards.
    Turned {
        /// Facets.
        facets: usize,
        /// Of so many.
        of: usize,
    },
    /// Holes were filled.
    HolesFilled {
        /// Holes.
        holes: usize,
        /// New facets.
        facets: usize,
        /// Area of the new facets, mm².
        area_mm2: f64,
        /// The longest way around one, mm.
        longest_perimeter_mm: f64,
    },
    /// Vertices at which the surface touched itself were doubled.
    PinchesOpened {
        /// Vertices.
        vertices: usize,
    },
}

impl Change {
    /// The change's name in files.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Welded { .. } => "welded",
            Self::DegenerateDropped { .. } => "degenerate_dropped",
            Self::DuplicatesDropped { .. } => "duplicates_dropped",
            Self::DebrisDropped { .. } => "debris_dropped",
            Self::Turned { .. } => "turned",
            Self::HolesFilled { .. } => "holes_filled",
            Self::PinchesOpened { .. } => "pinches_opened",
        }
    }
}

impl fmt::Display for Change {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Welded { vertices, largest_move_mm } => {
                write!(
                    f,
                    "{vertices} vertices on open edges joined with others, moved by at most {largest_move_mm:.2e} mm"
                )
            }
            Self::DegenerateDropped { facets } => write!(f, "{facets} facets without area taken out"),
            Self::DuplicatesDropped { facets } => {
                write!(f, "{facets} facets that stood several times taken out")
            }
            Self::DebrisDropped { pieces, facets, area_mm2 } => {
                write!(f, "{pieces} small separate pieces dropped: {facets} facets, {area_mm2:.4} mm²")
            }
            Self::Turned { facets, of } => write!(f, "{facets} of {of} facets turned to face outwards"),
            Self::HolesFilled { holes, facets, area_mm2, longest_perimeter_mm } => write!(
                f,
                "{holes} holes filled with {facets} facets of {area_mm2:.4} mm², the largest {longest_perimeter_mm:.3} mm around"
            ),
            Self::PinchesOpened { vertices } => {
                write!(f, "{vertices} vertices doubled where the surface touched itself in a point")
            }
        }
    }
}
