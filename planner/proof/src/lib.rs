//! What a program leaves.
