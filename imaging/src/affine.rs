//! Which of a NIfTI header's transforms places the voxels in the `ct` frame.

/// Which transform of an image header to use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AffineChoice {
    /// The sform, else the qform; refused when both are set and disagree.
    Auto,
    /// The sform, whatever the qform says.
    Sform,
    /// The qform, whatever the sform says.
    Qform,
}
