//! Shells and small parts, from mesh to moves.
