//! The files of a prosthesis: the toolpath's columns and the figures of `job.toml`.

use super::{Column, Described};

/// The columns of `toolpath.csv`.
pub const TOOLPATH: [Column; 9] = [
    Column::new("index", "1", "", "The move's place, from 0; a row is where the move ends."),
    Column::new("side", "text", "", "`A` from the front, `B` from the back, `C` the outline."),
    Column::new(
        "kind",
        "text",
        "",
        "`rough`, `finish` and `contour` cut; `link` and `retract` reposition in free space.",
    ),
    Column::new("x_mm", "mm", "block", "The cutter's tip."),
    Column::new("y_mm", "mm", "block", "The cutter's tip."),
    Column::new("z_mm", "mm", "block", "The cutter's tip."),
    Column::new("a_rad", "rad", "", "Angle of the rotary axis: 0 for the front, π for the back."),
    Column::new(
        "feed_mm_min",
        "mm/min",
        "",
        "Feed of the move; the repositioning speed for `link` and `retract`.",
    ),
    Column::new("time_s", "s", "", "When the move ends, at constant speeds."),
];

/// The figures of `job.toml`.
const METRICS: [Column; 28] = [
    Column::new("facets", "1", "", "Facets of the part's mesh after repair."),
    Column::new("volume_mm3", "mm³", "", "Volume of the part."),
    Column::new("size_mm", "mm", "block", "The part's bounding box along x, y and z, as it is machined."),
    Column::new(
        "residual_given_xy_xz_yz_mm2",
        "mm²",
        "block",
        "Bounding rectangle of the part's projection less the projection, as the file gives the part.",
    ),
    Column::new("published_runs", "1", "", "Runs of the published procedure until nothing changed."),
    Column::new("residual_published_xy_xz_yz_mm2", "mm²", "block", "The same areas after its last run."),
    Column::new("residual_xy_xz_yz_mm2", "mm²", "block", "The same areas as the part is machined."),
    Column::new("block_mm3", "mm³", "", "Volume of the block."),
    Column::new("moves", "1", "", "Moves of the toolpath."),
    Column::new("cuts", "1", "", "Moves that cut."),
    Column::new("constant_speed_time_s", "s", "", "Machining time at constant speeds (Castelli's estimate)."),
    Column::new("total_time_s", "s", "", "Machining time with the machine's acceleration and jerk."),
    Column::new("cutting_time_s", "s", "", "What of the constant-speed time is spent at feed."),
    Column::new("strip_mm", "mm", "", "Thickness of the strip that holds the part."),
    Column::new(
        "cutting_force_n",
        "N",
        "",
        "Greatest cutting force of the program, by the proof's depth of chips.",
    ),
    Column::new(
        "strip_strength_over_force",
        "1",
        "",
        "Shear force that the strip bears over the cutting force.",
    ),
    Column::new("tab_mm", "mm", "", "Length of the tab that stays at the end."),
    Column::new(
        "outline_force_n",
        "N",
        "",
        "The same from the outline on, while the strip is cut and the tab holds.",
    ),
    Column::new(
        "tab_strength_over_force",
        "1",
        "",
        "Force that the tab bears in shear and in bending over the outline's cutting force.",
    ),
    Column::new(
        "left_mm3",
        "mm³",
        "",
        "Stock that stays thicker than the finishing step, by the planner's stock; 0 where the proof finds none.",
    ),
    Column::new("deepest_gouge_mm", "mm", "", "Deepest cut into the part, by the proof."),
    Column::new(
        "thickest_uncut_mm",
        "mm",
        "",
        "Thickest stock left on the part outside the tab, by the proof.",
    ),
    Column::new(
        "uncut_mm3",
        "mm³",
        "",
        "All stock left on the part outside the tab, by the proof: area times thickness, so that what stays in an inner corner counts for both walls.",
    ),
    Column::new(
        "collisions",
        "1",
        "",
        "Motions in which something meets the stock that must not, by the proof.",
    ),
    Column::new(
        "loose_mm3",
        "mm³",
        "",
        "Pieces larger than swarf that lose their hold before the end, by the proof.",
    ),
    Column::new("widest_cut_mm", "mm", "", "Widest cut deeper than an entry, by the proof."),
    Column::new("cuts_too_wide", "1", "", "Cuts wider than the side load allows, by the proof."),
    Column::new("robot_time_s", "s", "", "Time of the arm's trajectory; there for an arm only."),
];

/// The files of a prosthesis that no plan has.
pub const DESCRIBED: &[Described] = &[
    Described {
        title: "toolpath.csv",
        about: "Of a prosthesis: one row per move of the cutter's tip. `block`: origin in the middle of the block along x and y, on the rotary axis; x along \
                that axis, y toward the spindle at A = 0, z away from the grip. The part lies around it, along y no farther off than the cutter's length asks for.",
        columns: &TOOLPATH,
    },
    Described {
        title: "job.toml [result.metrics]",
        about: "Of a prosthesis. The keys above `[result]` are those of the [job file](prosthesis.md). `trajectory.csv`, where an arm mills, has the \
                columns of a plan's.",
        columns: &METRICS,
    },
];
