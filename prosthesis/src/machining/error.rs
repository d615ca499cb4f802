//! What makes machining impossible to plan: input out of range, or a part that does not lie in its block.

use thiserror::Error;

/// Why there are no moves.
#[derive(Debug, Error)]
pub enum MachiningError {
    /// A number is out of range.
    #[error("{what} is {value} {unit}, expected {expected}")]
    Value {
        /// What the number is.
        what: &'static str,
        /// The number.
        value: f64,
        /// Its unit.
        unit: &'static str,
        /// What was expected.
        expected: &'static str,
    },
    /// The mesh has no triangle or a triangle names a vertex that is not there.
    #[error("the part's mesh is unusable at facet {facet}: {expected}")]
    Mesh {
        /// The facet, from 0.
        facet: usize,
        /// What was expected.
        expected: &'static str,
    },
    /// The part, or the channel around it, leaves the block or meets the grip.
    #[error("{what} reaches {axis} = {at_mm:.2} mm, but {of} ends at {limit_mm:.2} mm")]
    Outside {
        /// What is too large.
        what: &'static str,
        /// x, y or z in the block's frame.
        axis: char,
        /// How far it reaches, mm.
        at_mm: f64,
        /// What it leaves.
        of: &'static str,
        /// Where that ends, mm.
        limit_mm: f64,
    },
    /// The axes or the arm cannot be driven so.
    #[error(transparent)]
    Motion(#[from] bonemill_arm::RobotError),
    /// It would take hours to plan.
    #[error(
        "the cutter would go about {:.0} m with `tool.diameter_mm` = {diameter_mm} and `process.finishing_step_mm` = {finishing_step_mm}, at most {:.0} m \
         can be planned for this part: take a wider cutter, a coarser step or a thinner block",
        .length_mm / 1e3, .most_mm / 1e3
    )]
    TooMuch {
        /// Length of the cuts, mm.
        length_mm: f64,
        /// What is possible, mm.
        most_mm: f64,
        /// Of the cutter, mm.
        diameter_mm: f64,
        /// Of finishing, mm.
        finishing_step_mm: f64,
    },
    /// The raster would take too much memory.
    #[error("the block is {size_mm:.0} mm wide, at most {most_mm:.0} mm can be planned")]
    TooLarge {
        /// Its size, mm.
        size_mm: f64,
        /// What is possible, mm.
        most_mm: f64,
    },
}
