//! The columns of the tables: waypoints, trajectory, simulation with its figures, access, dropped waypoints, forces.

use super::Column;

/// The columns of `waypoints.csv`.
pub const WAYPOINTS: [Column; 27] = [
    Column::new("index", "1", "", "The row's place, from 0."),
    Column::new(
        "layer",
        "1",
        "",
        "Milling layer, from 0 at the outside; finishing passes have the number after the last.",
    ),
    Column::new(
        "kind",
        "text",
        "",
        "Kind of the move: `cut` removes material; `link` and `retract` remove none.",
    ),
    Column::new(
        "time_s",
        "s",
        "",
        "Time at which the burr is here; the difference of two rows is the move's duration.",
    ),
    Column::new("x_mm", "mm", "ct", "The burr's centre."),
    Column::new("y_mm", "mm", "ct", "The burr's centre."),
    Column::new("z_mm", "mm", "ct", "The burr's centre."),
    Column::new("axis_x", "1", "ct", "The shaft: unit vector from the burr to the handpiece."),
    Column::new("axis_y", "1", "ct", "The shaft."),
    Column::new("axis_z", "1", "ct", "The shaft."),
    Column::new(
        "theta_rad",
        "rad",
        "work",
        "Tilt of the shaft in the plane of work's y and z; 0 is the approach. In work the shaft is (sin φ, −sin θ cos φ, cos θ cos φ).",
    ),
    Column::new("phi_rad", "rad", "work", "Tilt of the shaft out of that plane: φ of the same formula."),
    Column::new("speed_mm_s", "mm/s", "", "Highest feed allowed in the move."),
    Column::new(
        "driven_mm_s",
        "mm/s",
        "",
        "Greatest speed of the burr's centre within the move, as `trajectory.csv` drives it; the means over time weigh a move by its \
         own time in `time_s`.",
    ),
    Column::new(
        "mass_mg",
        "mg",
        "",
        "Mass that the move removes: the mass in the ball here without what all earlier moves swept; 0 in air.",
    ),
    Column::new(
        "inertia",
        "1",
        "",
        "Normalised inertia I_n of that mass about the shaft, 0 to 1 (Dillon's equations 1 and 2).",
    ),
    Column::new(
        "fx_n",
        "N",
        "ct",
        "Force of the bone on the burr, mean over a turn, at `driven_mm_s` and this direction.",
    ),
    Column::new("fy_n", "N", "ct", "The same force."),
    Column::new("fz_n", "N", "ct", "The same force."),
    Column::new(
        "peak_force_n",
        "N",
        "",
        "Largest force within the move as the arm drives it, at `driven_mm_s`: at places between the waypoints too, and where the move meets \
         the skin that a rounded corner left, or bone between voxels. No less than the force itself.",
    ),
    Column::new(
        "mean_force_n",
        "N",
        "",
        "Mean of the force's magnitude over the time of the move, from the places within it; 0 where it is planned to remove nothing. In a \
         channel the force of the row.",
    ),
    Column::new(
        "force_toward_n",
        "N",
        "",
        "The component of that force toward `structure`; 0 if it points away.",
    ),
    Column::new(
        "structure",
        "text",
        "",
        "The structure of the case with the smallest distance less clearance; empty where none is within its influence.",
    ),
    Column::new(
        "distance_mm",
        "mm",
        "",
        "Distance from the burr's centre to that structure's nearest voxel face; subtract the burr's radius for the gap between them.",
    ),
    Column::new("alpha1", "1", "", "Weight of the force in the cost, 0 to 1 (Dillon's equation 8)."),
    Column::new("cost", "1", "", "The cost C of the shaft's direction (Dillon's equation 5)."),
    Column::new(
        "deflection_toward_um",
        "µm",
        "",
        "Deflection of the burr toward `structure` by the force; only with `robot.joint_stiffness`.",
    ),
];

/// The columns of `trajectory.csv`.
pub const TRAJECTORY: [Column; 3] = [
    Column::new("time_s", "s", "", "Time, with the same zero as in `waypoints.csv`."),
    Column::new(
        "q1..n",
        "rad; mm for a prismatic joint",
        "",
        "Positions of the moving joints of `robot.urdf`, from the base outwards.",
    ),
    Column::new("qd1..n", "rad/s; mm/s for a prismatic joint", "", "Joint velocities."),
];

/// The columns of `simulation.csv`.
pub const SIMULATION_ROWS: [Column; 14] = [
    Column::new(
        "time_s",
        "s",
        "",
        "Time in the plan. All values of a row belong to the step that ends there.",
    ),
    Column::new(
        "x_mm",
        "mm",
        "ct",
        "The burr's centre by forward kinematics, the arm's deflection included.",
    ),
    Column::new("y_mm", "mm", "ct", "The burr's centre."),
    Column::new("z_mm", "mm", "ct", "The burr's centre."),
    Column::new("fx_n", "N", "ct", "Force of the bone on the burr, mean over a turn."),
    Column::new("fy_n", "N", "ct", "The same force."),
    Column::new("fz_n", "N", "ct", "The same force."),
    Column::new("torque_nmm", "N mm", "", "Torque that resists the spindle, mean over a turn."),
    Column::new("power_w", "W", "", "Power of the spindle."),
    Column::new("mrr_mm3_s", "mm³/s", "", "Rate at which material is removed."),
    Column::new(
        "force_toward_n",
        "N",
        "",
        "The component of the force toward `structure`; 0 if it points away.",
    ),
    Column::new("structure", "text", "", "The structure with the smallest distance less clearance."),
    Column::new("distance_mm", "mm", "", "Distance from the burr's centre to it; 0 inside."),
    Column::new(
        "deflection_um",
        "µm",
        "",
        "Distance of the burr from its position by the joints alone; only with `robot.joint_stiffness`.",
    ),
];

/// The figures of `bonemill simulate --json`.
pub const SIMULATION_FIGURES: &[Column] = &[
    Column::new("poses", "1", "", "Number of simulated poses."),
    Column::new(
        "simulated_peak_force_n",
        "N",
        "",
        "Largest force on the burr over the poses, mean over a turn. The plan's `peak_force_n` is that of its own model, at the greatest speed of each move.",
    ),
    Column::new(
        "simulated_mean_force_n",
        "N",
        "",
        "Mean over the time in which something is removed; the plan's is `mean_force_n`.",
    ),
    Column::new("spindle_energy_j", "J", "", "Energy that the spindle spends."),
    Column::new(
        "simulated_removed.KIND.mm3",
        "mm³",
        "",
        "What is removed, counted in parts of voxels. KIND is `material`, target below bone; `bone`, target that is bone; `sheet`, specks and sheets beside the target; \
         `obstacle`, other bone outside the target; or `structure`.",
    ),
    Column::new("simulated_removed.KIND.mg", "mg", "", "Its mass."),
    Column::new(
        "untargeted_bone_by_parts_mm3",
        "mm³",
        "",
        "Bone outside the target that is removed, counted in parts of voxels: `sheet` and `obstacle` together.",
    ),
    Column::new(
        "removed_by_rate_mg",
        "mg",
        "",
        "All removed mass, summed from the burr's surface; its difference from `simulated_removed` is a measure of the step's error.",
    ),
    Column::new(
        "simulated_structures.NAME.*",
        "mm; N; s",
        "",
        "The figures of `structures.NAME` in `plan.toml`, over the simulated poses and with the simulated force; places are rows of `simulation.csv`.",
    ),
    Column::new("stopped_steps", "1", "", "Steps that the shank stopped because it touched bone."),
    Column::new("cell_mm", "mm", "", "Side of a cell of the lattice that holds what is removed."),
    Column::new("compliant", "1", "", "Whether the arm gave way."),
];

/// The columns of `access.csv`.
pub const ACCESS: [Column; 7] = [
    Column::new("index", "1", "", "The waypoint."),
    Column::new(
        "free",
        "1",
        "",
        "Number of tested directions in which the shank is free and, for cuts, the tilt limit is kept.",
    ),
    Column::new("pieces", "1", "", "Number of connected parts of these directions."),
    Column::new("angle_rad", "rad", "work", "With one angle: the chosen tilt in the arm's tilt plane."),
    Column::new("low_rad", "rad", "work", "With one angle: start of the free interval around it."),
    Column::new("high_rad", "rad", "work", "With one angle: end of that interval."),
    Column::new(
        "cap_rad",
        "rad",
        "",
        "With two angles: the largest tilt from the chosen axis within which all directions are free.",
    ),
];

/// The columns of `dropped.csv`.
pub const DROPPED: [Column; 4] = [
    Column::new("x_mm", "mm", "ct", "Position that the burr's centre would have had."),
    Column::new("y_mm", "mm", "ct", "The same position."),
    Column::new("z_mm", "mm", "ct", "The same position."),
    Column::new("reason", "text", "", "What blocked the shank."),
];

/// The columns of `forces.csv`.
pub const FORCES_ROWS: [Column; 10] = [
    Column::new("index", "1", "", "The waypoint."),
    Column::new(
        "structure",
        "text",
        "",
        "A structure within its influence, or the one that `waypoints.csv` names.",
    ),
    Column::new("distance_mm", "mm", "", "From the burr's centre to its nearest point."),
    Column::new("toward_x", "1", "ct", "Unit vector from the burr's centre to that point."),
    Column::new("toward_y", "1", "ct", "The same vector."),
    Column::new("toward_z", "1", "ct", "The same vector."),
    Column::new(
        "force_toward_n",
        "N",
        "",
        "The force's component along it; 0 if it points away, and in air.",
    ),
    Column::new(
        "peak_toward_n",
        "N",
        "",
        "Largest component toward the structure within the move as the arm drives it, at `driven_mm_s`; no less than `force_toward_n`.",
    ),
    Column::new(
        "mean_toward_n",
        "N",
        "",
        "Mean of the component toward the structure over the time of the move, 0 while it points away; 0 where the move is planned to \
         remove nothing.",
    ),
    Column::new(
        "deflection_toward_um",
        "µm",
        "",
        "The deflection's component along it, not below 0; only with `robot.joint_stiffness`.",
    ),
];

/// The columns of `plunge.csv`.
pub const PLUNGE_ROWS: [Column; 6] = [
    Column::new("index", "1", "", "The waypoint."),
    Column::new(
        "depth_mm",
        "mm",
        "",
        "Depth of the tool's tip from the entry, along the channel; negative before it.",
    ),
    Column::new("thrust_n", "N", "", "Force of the bone on the tool along its axis, toward the handpiece."),
    Column::new("torque_nmm", "N mm", "", "Torque that resists the turn."),
    Column::new("lateral_n", "N", "", "Force across the axis, mean over a turn."),
    Column::new("contact_mm2", "mm²", "", "Area of the tool's front in bone."),
];
