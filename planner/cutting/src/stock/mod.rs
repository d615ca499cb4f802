//! Computes which voxels of the stock a moving ball removes, and which move removes each of them first.
//!
//! A ball's sweep does not depend on the shaft's direction. So for a given path the number of the move that first covers a
//! voxel is one static field, the [`removal`] time T, and the stock before move i is [T >= i]. [`sweep`] is the kernel: the
//! voxels of a row inside a capsule are one interval with a closed form. [`runs`] merges moves on one line, and [`voxels`]
//! stores sets of voxels as bits.

pub mod removal;
pub mod runs;
pub mod sweep;
pub mod voxels;
