//! Several structures near the burr.

/// Which structures the cost looks at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SeveralStructures {
    /// The one with the smallest distance less clearance.
    Nearest,
    /// Of those whose α is at least half of the largest, the one with the highest priority (1 is the highest).
    Priority,
    /// All of them, each by its own α.
    Sum,
}
