//! What is wrong with the inputs of the numeric models.

/// A value that a model of burr, cost or speed cannot take.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ModelError {
    /// A number is not finite or not in its range.
    #[error("{name} = {value}: expected {expected}")]
    OutOfRange {
        /// Which value, with its unit.
        name: &'static str,
        /// What was given.
        value: f64,
        /// The range.
        expected: &'static str,
    },
    /// A vector that must have a direction has none, or is not finite.
    #[error("{name} = ({}, {}, {}): expected {expected}", value[0], value[1], value[2])]
    Vector {
        /// Which vector, with its unit.
        name: &'static str,
        /// What was given.
        value: [f64; 3],
        /// What it must be.
        expected: &'static str,
    },
    /// Lists that run in parallel do not.
    #[error("{name}: {found} values for {expected} points")]
    Length {
        /// Which list.
        name: &'static str,
        /// Points.
        expected: usize,
        /// Values given.
        found: usize,
    },
    /// No speeds within the range give the requested time.
    #[error(
        "the cuts cannot take {requested_s:.3} s: within the speed range they take {shortest_s:.3} to {longest_s:.3} s"
    )]
    TimeOutOfReach {
        /// What was asked for, s.
        requested_s: f64,
        /// Everything at its fastest, s.
        shortest_s: f64,
        /// Everything at its slowest, s.
        longest_s: f64,
    },
}

/// `value`, when it is finite and `ok`.
pub fn checked(
    name: &'static str,
    value: f64,
    ok: impl FnOnce(f64) -> bool,
    expected: &'static str,
) -> Result<f64, ModelError> {
    if value.is_finite() && ok(value) {
        Ok(value)
    } else {
        Err(ModelError::OutOfRange { name, value, expected })
    }
}
