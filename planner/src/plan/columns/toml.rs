//! The keys of `plan.toml` and `verification.toml`.

use super::Column;

/// Above the tables of `plan.toml`, and the tables that list files.
pub const PLAN: &[Column] = &[
    Column::new("version", "text", "", "The version of bonemill that made the plan."),
    Column::new(
        "case_file",
        "text",
        "",
        "Where the case file was, from the plan's folder; its copy is `case.toml` in the plan.",
    ),
    Column::new("warnings", "text", "", "What the user should know."),
    Column::new("shortfalls", "text", "", "Why the plan falls short of its case; empty when it does not."),
    Column::new(
        "inputs.PATH",
        "SHA-256",
        "",
        "Every file that the plan was made from, by its path from the case file's folder. A file with another digest is refused.",
    ),
    Column::new("input_bytes.PATH", "bytes", "", "How large that file was."),
];

/// `[frames]`.
pub const FRAMES: &[Column] = &[
    Column::new(
        "approach_direction",
        "1",
        "ct",
        "Unit vector out of the bone: the case's, or the one that was chosen.",
    ),
    Column::new("ct_from_work", "1; mm", "ct from work", "Where work is in the scan."),
    Column::new(
        "grid.dims",
        "1",
        "",
        "Voxels of the planning grid along its x, y and z; their side is `case.grid.spacing_mm`.",
    ),
    Column::new("grid.turn_rad", "rad", "work", "How far the grid is turned about work's z."),
    Column::new("base_from_ct", "1; mm", "base from ct", "The registration."),
    Column::new(
        "registration",
        "text",
        "",
        "`case`, or `assumed`: the case gives none, and the trajectory is for no real set-up.",
    ),
    Column::new(
        "flange_from_burr",
        "mm; rad",
        "flange from burr",
        "The tool: the burr's centre and URDF's fixed-axis roll, pitch and yaw of its axes.",
    ),
];

/// `[metrics]`; `NAME` is a structure.
pub const METRICS: &[Column] = &[
    Column::new("removed_mm3", "mm³", "", "Target that is removed, air cells included."),
    Column::new(
        "reachable_mm3",
        "mm³",
        "",
        "Target that the ball can reach under the clearances, in through the approach.",
    ),
    Column::new("target_mm3", "mm³", "", "The whole target."),
    Column::new("removed_material_mm3", "mm³", "", "The part of what is removed above `density.air_hu`."),
    Column::new("removed_bone_mm3", "mm³", "", "The part of it above `density.bone_hu`."),
    Column::new("total_time_s", "s", "", "From the first waypoint to the last."),
    Column::new("reached_share", "1", "", "Share of the reachable volume that is removed."),
    Column::new("target.*", "mm³", "", "The target."),
    Column::new("reachable.*", "mm³", "", "What is reachable of it."),
    Column::new("removed.*", "mm³", "", "What is removed of it."),
    Column::new("removed_reachable.*", "mm³", "", "What is both."),
    Column::new(
        "kept_by_structure_mm3.NAME",
        "mm³",
        "",
        "Target that stays because of this structure and its clearance.",
    ),
    Column::new("kept_by_bone_mm3", "mm³", "", "Target that stays because of bone around it."),
    Column::new("thin_bone_removed_mm3", "mm³", "", "Bone outside the target that is removed."),
    Column::new(
        "deepest_in_obstacle_mm",
        "mm",
        "",
        "How deep the swept ball reaches into bone outside the target.",
    ),
    Column::new(
        "band_mm",
        "mm",
        "",
        "Up to this depth that is within the images' resolution: the largest voxel diagonal.",
    ),
    Column::new("removed_mass_mg", "mg", "", "Mass that is removed: the sum of `mass_mg` of the waypoints."),
    Column::new("path_length_mm", "mm", "", "Length of the burr's way."),
    Column::new(
        "time_at_speed_caps_s",
        "s",
        "",
        "What the plan would take if every move ran at its speed cap.",
    ),
    Column::new("joint_limit_ratios.velocity", "1", "", "Largest joint velocity over its limit."),
    Column::new("joint_limit_ratios.acceleration", "1", "", "Largest joint acceleration over its limit."),
    Column::new("joint_limit_ratios.jerk", "1", "", "Largest joint jerk over its limit."),
    Column::new(
        "smallest_singular_value_mm_s",
        "mm/s",
        "",
        "How fast the burr still moves in the arm's weakest direction along the way; near 0: close to a singular pose.",
    ),
    Column::new("peak_force_n", "N", "", "Largest force on the burr over the waypoints."),
    Column::new("mean_force_n", "N", "", "Mean over the time of the moves that remove material."),
    Column::new("seconds_by_kind.cut", "s", "", "Time spent cutting."),
    Column::new("seconds_by_kind.link", "s", "", "Time spent on links."),
    Column::new("seconds_by_kind.retract", "s", "", "Time spent on retracts."),
    Column::new(
        "structures.NAME.least_distance_mm",
        "mm",
        "",
        "Smallest distance of the burr's centre from this structure.",
    ),
    Column::new("structures.NAME.least_clearance_mm", "mm", "", "The same from the burr's surface."),
    Column::new("structures.NAME.peak_force_toward_n", "N", "", "Largest force toward this structure."),
    Column::new(
        "stiffness_n_mm.softest",
        "N/mm",
        "",
        "Smallest stiffness of the arm at the burr, in any direction, along the way.",
    ),
    Column::new("stiffness_n_mm.softest_waypoint", "1", "", "The waypoint where that is."),
    Column::new(
        "stiffness_n_mm.mean_softest",
        "N/mm",
        "",
        "Mean over the way of the stiffness in the softest direction.",
    ),
    Column::new(
        "stiffness_n_mm.least_toward_structure",
        "N/mm",
        "",
        "Smallest stiffness toward the nearest structure.",
    ),
    Column::new("fre_mm", "mm", "", "Fiducial registration error: root mean square of the residuals."),
    Column::new("fiducial_residuals_mm.N", "mm", "", "What the fit leaves at fiducial N, from 1."),
    Column::new("expected_error_mm.NAME", "mm", "", "Expected registration error (TRE) at this structure."),
];

/// `[modelled]`.
pub const MODELLED: &[Column] = &[
    Column::new("waypoints", "1", "", "Waypoints in all."),
    Column::new("cutting_waypoints", "1", "", "Waypoints whose move removes something."),
    Column::new("cost_with_force", "1", "", "Of these, those whose direction was chosen with the force."),
    Column::new(
        "cost_closed_form",
        "1",
        "",
        "Of these, those where the force has too little weight to be evaluated for the choice.",
    ),
    Column::new(
        "closed_form_error",
        "1",
        "",
        "The most by which such a choice is worse, in units of `cost`.",
    ),
    Column::new(
        "direction_spacing_deg",
        "°",
        "",
        "Angle between neighbours of the directions to choose from.",
    ),
    Column::new(
        "low_pass_held",
        "1",
        "",
        "With `orientation.mode = \"greedy\"`: waypoints at which the low-pass was held at a free angle.",
    ),
    Column::new(
        "low_pass_leaves",
        "1",
        "",
        "Waypoints at which Dillon's low-pass would leave the free angles.",
    ),
    Column::new("blocked_turns", "1", "", "Moves on which the turning shank is not certainly free."),
    Column::new("links_beyond_limit", "1", "", "Links that graze a cusp beyond the tilt limit."),
    Column::new(
        "put_off_waypoints",
        "1",
        "",
        "Waypoints without access where they belonged, milled at the end.",
    ),
    Column::new(
        "dropped_waypoints.NAME",
        "1",
        "",
        "Waypoints that the path leaves out, by reason; their places are in `dropped.csv`.",
    ),
    Column::new("unjoined_passes", "1", "", "Passes that no link could join."),
    Column::new("branch", "1", "", "Branch of the arm's inverse kinematics that the whole path is on."),
    Column::new("raster_deg", "°", "work", "Direction of the raster's lines from work's x."),
    Column::new("layers", "1", "", "Milling layers."),
    Column::new("compliance", "1", "", "Whether the arm's deflection was computed."),
    Column::new("ct_affine", "text", "", "Which affine of the CT's file was taken."),
    Column::new("labels_affine", "text", "", "Which affine of the labels' file was taken."),
];

/// `verification.toml`.
pub const VERIFICATION: &[Column] = &[
    Column::new("version", "text", "", "The version of bonemill that verified."),
    Column::new("passed", "1", "", "Whether no check failed."),
    Column::new("checks", "1", "", "How many checks there are."),
    Column::new("failed", "1", "", "How many of them failed."),
    Column::new("files.NAME", "SHA-256", "", "The plan's files that the verdict holds for."),
    Column::new("check.name", "text", "", "What was checked."),
    Column::new(
        "check.subject",
        "text",
        "",
        "Of what, where there are several: a structure, a joint, a file.",
    ),
    Column::new("check.passed", "1", "", "Whether `value` is on the right side of the limit."),
    Column::new("check.value", "`check.unit`", "", "The worst that was found."),
    Column::new("check.at_most", "`check.unit`", "", "The limit that `value` may not exceed."),
    Column::new("check.at_least", "`check.unit`", "", "Or the limit that it may not fall below."),
    Column::new(
        "check.margin",
        "`check.unit`",
        "",
        "How far it is on the right side; below 0, by how much it misses it.",
    ),
    Column::new("check.unit", "text", "", "Unit of the numbers; missing for counts."),
    Column::new(
        "check.place",
        "text",
        "",
        "Where the worst is: a waypoint (row of `waypoints.csv`, from 0), a time, a file.",
    ),
];
