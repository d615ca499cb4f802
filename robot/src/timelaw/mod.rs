//! The time law: the motion in time along a polyline of joint positions.
//!
//! Input: waypoints in joint space with the burr's place at each, and the burr's path length and speed cap for every move
//! between them. Output: a motion that starts and ends at rest, keeps every speed cap and every joint's velocity,
//! acceleration and jerk limit **at every instant**, and stays within a tolerance of the polyline. It is the fastest motion
//! of the following scheme.
//!
//! 1. *Parameter* (`geometry`, `merge`): s, mm, the burr's path length; a move in which the burr hardly moves gets a length
//!    from the joints' speed limits. Along a move q(s) is linear, q' = d.
//! 2. *Corners* (`geometry`): around a waypoint q' goes from d₁ to d₂ by d₁ + (d₂ − d₁)(3u² − 2u³) over a length 2l, so q'' is
//!    continuous; burr and axis leave the polyline by 3l/16 of the change of their directions, which is the tolerance.
//! 3. *Boxes* (`stretch`): with P, c, e the greatest |q'|, |q''|, |q'''| of a stretch, ṡ ≤ v and |s̈| ≤ A with
//!    P v ≤ q̇, c v² + P A ≤ q̈ and e v³ + 3 c v A + P 2A/T ≤ q⃛ for every joint.
//! 4. *Base* (`pass`): the fastest s₀(t) with ṡ₀ ≤ v and |s̈₀| ≤ A: trapezoids in one sweep back and one forth.
//! 5. *Law* (`smooth`, `law`): s(t) = the mean of s₀ over a window of length T. It stays on the same path; ṡ and s̈ are means
//!    of ṡ₀ and s̈₀, and s⃛ = (s̈₀ at the window's end − at its start)/T ≤ 2A/T, which gives the bound of the jerk.
//!    A stop is a rest of s₀ of length T. Several T are tried, and the fastest law is taken.
//!
//! The window averages motion from places before and after the arm's present place, and the average must keep the limits
//! there. So a box also applies around its stretch, up to v T away: within T, a motion that is no faster than v comes from
//! no farther. Therefore the bounds hold at every instant, not only at grid points.
//!
//! The time is linear in the number of waypoints. Near-duplicate waypoints, reversals and pure rotations are valid input.
//! Joint limits on position need no check, because the path stays in the convex hull of neighbouring waypoints.
//! The arm's nonlinearity within a move is not treated here; `resolve::dense` lays places so close that it is negligible.
//!
//! **Source:** sweeps on a path with rounded corners: Kunz & Stilman 2012, "Time-optimal trajectory generation for path
//! following with bounded acceleration and velocity"; jerk limits by moving averages: Biagiotti & Melchiorri 2012, "FIR
//! filters for online trajectory planning with time- and frequency-domain specifications"; extending the boxes by v T is
//! this project's own.

mod geometry;
mod input;
mod law;
mod merge;
mod pass;
mod prepared;
mod rows;
mod smooth;
mod stretch;

pub use input::{CornerTolerance, JointPath, PathLimits, TRAJECTORY_TOLERANCE_MM};
pub use law::{JointState, LimitRatios, TimeLaw};
pub use prepared::PreparedPath;
pub use rows::{JointTrajectory, RowGrid};

#[cfg(test)]
mod tests;
