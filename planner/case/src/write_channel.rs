//! `[path]` of a straight channel as TOML.

use super::job::{ChannelDirection, ChannelEnd, ChannelSpec, Entry, FeedSpec};
use super::keys as k;
use super::write::{float, label, text, vector};

/// Keys and values, in the order of the file.
pub(super) fn lines(channel: &ChannelSpec) -> Vec<(&'static str, String)> {
    let mut lines = vec![("pattern", text(k::PATTERN.word(channel.pattern)))];
    lines.extend(match &channel.entry {
        Entry::Point(point) => Some(("entry_mm", vector(point))),
        Entry::Label(of) => Some(("entry_label", label(of))),
        Entry::Ball { center_mm, radius_mm } => {
            let ball = format!("{{ center_mm = {}, radius_mm = {} }}", vector(center_mm), float(*radius_mm));
            Some(("entry_ball", ball))
        }
        Entry::Surface => None,
    });
    lines.extend(match channel.direction {
        ChannelDirection::Given(direction) => Some(("direction", vector(&direction))),
        ChannelDirection::Safest => Some(("direction", text("safest"))),
        ChannelDirection::ToTarget => None,
    });
    lines.push(match channel.end {
        ChannelEnd::Target(target) => ("target_mm", vector(&target)),
        ChannelEnd::Depth(mm) => ("depth_mm", float(mm)),
        ChannelEnd::ContactArea(mm2) => ("contact_area_mm2", float(mm2)),
    });
    lines.push(("cone_deg", float(channel.cone_deg)));
    lines.push(match channel.feed {
        FeedSpec::PerRevolution(mm) => ("feed_mm_rev", float(mm)),
        FeedSpec::Speed(mm_s) => ("feed_mm_s", float(mm_s)),
    });
    lines.extend(channel.peck_mm.map(|mm| ("peck_mm", float(mm))));
    lines.push(("dwell_s", float(channel.dwell_s)));
    lines.push(("standoff_mm", float(channel.standoff_mm)));
    lines.push(("step_mm", float(channel.step_mm)));
    lines.push(("touch_probability", float(channel.touch_probability)));
    lines.push(("registration_sigma_mm", float(channel.registration_sigma_mm)));
    lines
}
