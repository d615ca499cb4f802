//! The time law: how fast an arm may go along a polyline of joint positions.
//!
//! Input: waypoints in joint space, the burr's path length and speed cap of every move between them. Output: the
//! fastest motion (within the scheme below) that starts and ends at rest, keeps every speed cap and every joint's
//! velocity and acceleration limit **at every instant**, and stays within a tolerance of the polyline.
//!
//! 1. *Parameter* (`geometry`, `merge`): s, mm, the burr's path length; a move that hardly shifts the burr gets the length that
//!    the joints' speed limits give it. Along a move q(s) is linear, q' = d.
//! 2. *Corners* (`geometry`): a parabola of half-length l at a waypoint leads from q' = d₁ to q' = d₂, so q̇ is
//!    continuous; it leaves the polyline by at most l/4 · Σ w |d₂ − d₁|, which is the tolerance.
//! 3. *Speed* (`pass`): on σ = ṡ², one sweep back and one forth over straight pieces (exact trapezoids) and a few
//!    intervals per parabola, on which σ is linear in s. There q̈ = c σ + q' σ'/2, c = (d₂ − d₁)/(2l), and
//!    |c| max σ + max|q'| |σ'|/2 ≤ a bounds it over the whole interval, not only at its ends. A bound of this form
//!    lets the sweeps' result be the greatest σ there is, monotone in the caps, and never infeasible (σ = 0 always is).
//! 4. *Law* (`law`): the pieces in closed form, ṡ linear in time: exact to sample, to differentiate, to integrate.
//!
//! Linear in the number of waypoints. Near-duplicate waypoints, reversals and pure rotations are ordinary input.
//! Joint limits on position need no check here: the path stays in the convex hull of neighbouring waypoints.
//! Not here: limits on jerk, and the burr's bow between waypoints (the arm's nonlinearity inside one move).
//!
//! **Source:** corner parabolas and sweeps: Kunz & Stilman 2012, "Time-optimal trajectory generation for path following
//! with bounded acceleration and velocity"; reachable sets: Pham & Pham 2018 (TOPP-RA); the interval bound is ours.

mod geometry;
mod input;
mod law;
mod merge;
mod pass;
mod prepared;
mod rows;

pub use input::{JointPath, PathLimits};
pub use law::{JointState, TimeLaw};
pub use prepared::PreparedPath;
pub use rows::{JointTrajectory, RowGrid};

#[cfg(test)]
mod tests;
