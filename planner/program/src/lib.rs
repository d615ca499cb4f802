//! How a program is written.
