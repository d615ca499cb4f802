//! What a moving ball removes of the stock, and which move removes it first.
//!
//! A ball's sweep does not depend on the shaft. So for a given path the move that first covers a voxel is one static field, the
//! [`removal`] time T, and the stock before move i is [T >= i]. [`sweep`] is the kernel: the voxels of a row in a capsule are one
//! interval in closed form. [`runs`] merges moves on one line, [`voxels`] keeps sets of voxels as bits.

pub mod removal;
pub mod runs;
pub mod sweep;
pub mod voxels;
