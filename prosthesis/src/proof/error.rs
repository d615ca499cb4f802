//! What makes a program or a proof's input unusable.

use thiserror::Error;

/// Why there is no proof.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum ProofError {
    /// A line of the program is not understood.
    #[error("program line {line}: {what}")]
    Line {
        /// Line, from 1.
        line: usize,
        /// What is wrong and what was expected.
        what: String,
    },
    /// A number is out of range.
    #[error("{what} is {value}, expected {low} to {high} mm")]
    Value {
        /// What the number is.
        what: &'static str,
        /// The number, mm.
        value: f64,
        /// Least, mm.
        low: f64,
        /// Most, mm.
        high: f64,
    },
    /// The part's mesh is unusable.
    #[error(
        "the part's mesh is unusable at facet {facet}: three vertices with finite coordinates were expected"
    )]
    Mesh {
        /// The facet, from 0.
        facet: usize,
    },
    /// Too many points on the part.
    #[error("the part takes {points} points at {sample_mm} mm, at most {most}: take a larger distance")]
    TooFine {
        /// Points.
        points: usize,
        /// Their distance, mm.
        sample_mm: f64,
        /// Most that are taken.
        most: usize,
    },
}
