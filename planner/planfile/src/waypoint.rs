//! One waypoint of `waypoints.csv`. All values belong to the move that ends at it.

use bonemill_geometry::{Ct, Point};
use nalgebra::Vector3;

use bonemill_cutting::cutter::MoveKind;

/// One row of `waypoints.csv`, in ct; the waypoint's index is the row's number. `None` is an empty cell.
#[derive(Debug, Clone, PartialEq)]
pub struct Waypoint {
    /// Layer, from 0 at the outside.
    pub layer: u32,
    /// Kind of the move that ends here.
    pub kind: MoveKind,
    /// Time when the burr is here, s; never decreasing.
    pub time_s: f64,
    /// Burr's centre, mm.
    pub position: Point<Ct>,
    /// Shaft axis, unit, from the burr to the handpiece.
    pub axis: Vector3<f64>,
    /// Tilt in the work y–z plane, rad.
    pub theta_rad: f64,
    /// Tilt out of it, rad.
    pub phi_rad: f64,
    /// The move's speed cap, mm/s.
    pub speed_mm_s: f64,
    /// Greatest speed that the trajectory has within the move, mm/s, at most the cap.
    pub driven_mm_s: f64,
    /// Mass in the ball at this position, without what all earlier moves removed, mg.
    pub mass_mg: f64,
    /// I_n of that mass about the shaft (D1, D2), 0..1.
    pub inertia: Option<f64>,
    /// Force on the burr at the driven speed and this direction, ct, N; 0 in air.
    pub force_n: Vector3<f64>,
    /// Largest force within the move as the arm drives it, at the driven speed, N; at least that of `force_n`.
    pub peak_force_n: f64,
    /// Mean magnitude of the force over the time of the move, N; 0 where it is planned to remove nothing.
    pub mean_force_n: f64,
    /// Component of the force toward the nearest structure, N, not negative; 0 in air.
    pub force_toward_n: Option<f64>,
    /// Index in the case of the structure with the smallest distance less clearance.
    pub structure: Option<usize>,
    /// Distance from the burr's centre to it, mm.
    pub distance_mm: Option<f64>,
    /// Weight of the force in the cost (D8), 0..1.
    pub alpha1: Option<f64>,
    /// The cost C (D6).
    pub cost: Option<f64>,
    /// Deflection toward the structure, µm; 0 in air, `None` without a stiffness.
    pub deflection_toward_um: Option<f64>,
}
