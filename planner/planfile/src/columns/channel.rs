//! Keys of `plan.toml` that only a drilled or reamed channel has.

use super::Column;

/// Keys of `[metrics]`; `NAME` is a structure. `channels` lists the channels that were found.
#[rustfmt::skip]
pub const METRICS: &[Column] = &[
    Column::new("channel.entry_mm", "mm", "ct", "Where the tool's tip is at depth 0."),
    Column::new("channel.direction", "1", "ct", "Into the bone, unit."),
    Column::new("channel.depth_mm", "mm", "", "From there to where the tip ends."),
    Column::new("channel.contact_depth_mm", "mm", "", "Depth at which the tool first meets bone; negative before the entry."),
    Column::new("channel.radius_mm", "mm", "", "Largest radius of the tool."),
    Column::new("peak_thrust_n", "N", "", "Largest force along the axis, out of the bone."),
    Column::new("peak_torque_nmm", "N mm", "", "Largest torque that resists the spindle."),
    Column::new("peak_lateral_n", "N", "", "Largest force across the axis."),
    Column::new("largest_contact_mm2", "mm²", "", "Largest area of the tool's front in bone."),
    Column::new("kept.NAME.clearance_mm", "mm", "", "Least distance of the surface of what the tool sweeps from the structure's voxel boxes."),
    Column::new("kept.NAME.at_depth_mm", "mm", "", "Depth along the channel where that is; negative before the entry."),
    Column::new("kept.NAME.sigma_mm", "mm", "", "Standard deviation of the registration's error there, toward the structure."),
    Column::new("kept.NAME.touch_probability", "1", "", "Probability that the registration's error lets the tool touch it, on any side."),
    Column::new("kept.NAME.weighted_margin_mm", "mm", "", "Clearance beyond what is needed, times √rank, the rank being the priority over the smallest of the case; a structure on several sides needs more than a wall."),
    Column::new("kept.NAME.holder_clearance_mm", "mm", "", "Distance of the holder from the structure at the deepest pose."),
    Column::new("channels.direction", "1", "ct", "Of each channel that was found, best first: into the bone, unit."),
    Column::new("channels.entry_mm", "mm", "ct", "Its entry."),
    Column::new("channels.depth_mm", "mm", "", "Its depth."),
    Column::new("channels.limited_by", "text", "", "The structure with its least weighted margin; the next keys are of that structure, as in `kept`."),
    Column::new("channels.clearance_mm", "mm", "", "As in `kept`."),
    Column::new("channels.at_depth_mm", "mm", "", "As in `kept`."),
    Column::new("channels.sigma_mm", "mm", "", "As in `kept`."),
    Column::new("channels.touch_probability", "1", "", "As in `kept`."),
    Column::new("channels.weighted_margin_mm", "mm", "", "As in `kept`."),
];

/// Keys of `[modelled]`.
#[rustfmt::skip]
pub const MODELLED: &[Column] = &[
    Column::new("unreachable_channels", "1", "", "Better channels that the arm cannot take."),
    Column::new("elements_per_edge", "1", "", "Elements along a cutting edge."),
    Column::new("sampled_directions", "1", "", "Directions that were looked at for the safest channel."),
    Column::new("directions_in_region", "1", "", "Of these: lead outside in the entry's region and the cone."),
    Column::new("directions_too_long", "1", "", "Of these: deeper than the tool can drill."),
];
