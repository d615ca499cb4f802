//! Programs and parts small enough to know the answer.
