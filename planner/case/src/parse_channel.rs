//! `[path]` of a straight channel from text: `pattern = "plunge"` or `"ream"`.
//!
//! A channel is determined by an entry and a direction or target. Which of these go together is judged here, because a key
//! without effect would mislead.

use nalgebra::Vector3;
use toml::de::DeValue;

use super::error::CaseFault;
use super::job::{ChannelDirection, ChannelEnd, ChannelSpec, Entry, FeedSpec, Pattern};
use super::keys as k;
use super::parse_label::read_label;
use super::walker::{Walk, as_number};

/// Feed per revolution without a key, mm.
const DEFAULT_FEED_MM_REV: f64 = 0.02;
/// Angle from the approach within which the safest direction is sought, without a key, degrees.
const DEFAULT_CONE_DEG: f64 = 60.0;
/// Beginning before the entry without a key, mm.
const DEFAULT_STANDOFF_MM: f64 = 5.0;
/// Probability of touching without a key.
const DEFAULT_TOUCH_PROBABILITY: f64 = 0.01;
/// Standard deviation of the registration's error along each axis without a key, mm.
const DEFAULT_REGISTRATION_SIGMA_MM: f64 = 0.15;

/// The channel of a `[path]` whose pattern and step were read.
pub(super) fn read_channel(t: &Walk<'_, '_>, pattern: Pattern, step_mm: f64) -> ChannelSpec {
    let entry = read_entry(t);
    let end = read_end(t, pattern);
    let direction = read_direction(t, &entry, &end);
    let feed = match (t.optional(&k::FEED_REV), t.optional(&k::FEED_SPEED)) {
        (None, None) => FeedSpec::PerRevolution(DEFAULT_FEED_MM_REV),
        (Some(mm), None) => FeedSpec::PerRevolution(mm),
        (None, Some(mm_s)) => FeedSpec::Speed(mm_s),
        (Some(mm), Some(_)) => {
            refuse(t, "feed_mm_s", "feed_mm_rev says the same: leave one of the two out");
            FeedSpec::PerRevolution(mm)
        }
    };
    ChannelSpec {
        pattern,
        entry,
        direction,
        end,
        cone_deg: t.optional(&k::CONE).unwrap_or(DEFAULT_CONE_DEG),
        feed,
        peck_mm: t.optional(&k::PECK),
        dwell_s: t.optional(&k::DWELL).unwrap_or(0.0),
        standoff_mm: t.optional(&k::STANDOFF).unwrap_or(DEFAULT_STANDOFF_MM),
        step_mm,
        touch_probability: t.optional(&k::TOUCH_PROBABILITY).unwrap_or(DEFAULT_TOUCH_PROBABILITY),
        registration_sigma_mm: t.optional(&k::REGISTRATION_SIGMA).unwrap_or(DEFAULT_REGISTRATION_SIGMA_MM),
    }
}

fn refuse(t: &Walk<'_, '_>, name: &str, why: &'static str) {
    t.note(name, CaseFault::Contradiction { key: t.key(name), why });
}

fn read_entry(t: &Walk<'_, '_>) -> Entry {
    let ball = t.table("entry_ball");
    let point = t.vector(&k::ENTRY);
    let label = t.has("entry_label").then(|| read_label(t, &k::ENTRY_LABEL));
    let entry = match (point, label, ball.is_present()) {
        (Some(point), None, false) => Entry::Point(point),
        (None, Some(label), false) => Entry::Label(label),
        (None, None, true) => Entry::Ball {
            center_mm: ball.required_vector(&k::ENTRY_CENTER),
            radius_mm: ball.number(&k::ENTRY_RADIUS),
        },
        (None, None, false) => Entry::Surface,
        _ => {
            let why = "one of entry_mm, entry_label and entry_ball says where the channel begins";
            refuse(t, if t.has("entry_mm") { "entry_mm" } else { "entry_label" }, why);
            Entry::Surface
        }
    };
    ball.finish();
    entry
}

fn read_end(t: &Walk<'_, '_>, pattern: Pattern) -> ChannelEnd {
    let ends = [
        t.vector(&k::END_TARGET).map(ChannelEnd::Target),
        t.optional(&k::END_DEPTH).map(ChannelEnd::Depth),
        t.optional(&k::END_AREA).map(ChannelEnd::ContactArea),
    ];
    let options = vec!["target_mm", "depth_mm", "contact_area_mm2"];
    let found: Vec<&'static str> = options.iter().copied().filter(|name| t.has(name)).collect();
    if found.len() != 1 {
        t.note("", CaseFault::ExactlyOne { table: t.path().into(), found, options });
    }
    if pattern == Pattern::Plunge && t.has("contact_area_mm2") {
        refuse(t, "contact_area_mm2", "only pattern = \"ream\" ends at a contact area");
    }
    ends.into_iter().flatten().next().unwrap_or(ChannelEnd::Depth(1.0))
}

fn read_direction(t: &Walk<'_, '_>, entry: &Entry, end: &ChannelEnd) -> ChannelDirection {
    let given = match t.raw(&k::CHANNEL_DIRECTION) {
        None => None,
        Some(DeValue::String(word)) if &**word == "safest" => Some(ChannelDirection::Safest),
        Some(value) => match unit(value) {
            Some(direction) => Some(ChannelDirection::Given(direction)),
            None => {
                t.refuse(&k::CHANNEL_DIRECTION, value);
                return ChannelDirection::Safest;
            }
        },
    };
    let is_target = matches!(end, ChannelEnd::Target(_));
    let is_point = matches!(entry, Entry::Point(_));
    match given {
        Some(ChannelDirection::Safest) if !is_target => {
            refuse(t, "direction", "the safest direction is sought toward target_mm: give it");
        }
        Some(ChannelDirection::Safest) if is_point => {
            refuse(
                t,
                "entry_mm",
                "an entry and target_mm leave no direction to choose: give entry_label or entry_ball",
            );
        }
        Some(ChannelDirection::Given(_)) if is_target == is_point => {
            let why = "a direction goes with entry_mm and depth_mm or contact_area_mm2, or with target_mm and no entry_mm";
            refuse(t, "direction", why);
        }
        Some(_) => {}
        None if is_target && is_point => return ChannelDirection::ToTarget,
        None => t.refuse_missing(&k::CHANNEL_DIRECTION),
    }
    given.unwrap_or(ChannelDirection::Safest)
}

/// Three finite numbers that are a direction, as a unit vector.
fn unit(value: &DeValue<'_>) -> Option<Vector3<f64>> {
    let numbers: Option<Vec<f64>> = value.as_array()?.iter().map(|v| as_number(v.get_ref())).collect();
    let d = Vector3::from(<[f64; 3]>::try_from(numbers?).ok()?);
    let norm = d.norm();
    let is_direction = norm.is_finite() && norm > 1e-9;
    // a unit vector stays as it is, so that a written case reads back bit for bit
    is_direction.then(|| if (norm - 1.0).abs() < 1e-14 { d } else { d / norm })
}

#[cfg(test)]
mod tests {
    use crate::{Case, ChannelDirection, ChannelEnd, Entry, FeedSpec, Job, Target};
    use std::path::Path;

    const HEAD: &str =
        "structure = []\n[images]\nct = \"c\"\nlabels = \"l\"\n[tool]\nkind = \"drill\"\n[path]\n";

    fn parse(path: &str) -> Result<Case, String> {
        Case::parse(&format!("{HEAD}{path}"), Path::new("c.toml")).map_err(|e| e.to_string())
    }

    #[test]
    fn channels_read_back_as_they_were_written() {
        let plunge = "pattern = \"plunge\"\n";
        for path in [
            "entry_mm = [1, 2, 3]\ntarget_mm = [4, 5, 6.5]\nfeed_mm_s = 0.4\n",
            "entry_mm = [1, 2, 3]\ndirection = [0, 3, 4]\ndepth_mm = 12\npeck_mm = 2\ndwell_s = 1\n",
            "target_mm = [1, 2, 3]\ndirection = \"safest\"\nentry_label = \"cortex\"\n",
            "target_mm = [1, 2, 3]\ndirection = \"safest\"\nentry_ball = { center_mm = [0, 0, 9], radius_mm = 4 }\n",
            "target_mm = [1, 2, 3]\ndirection = [0, 0, -1]\ntouch_probability = 0.001\nregistration_sigma_mm = 0.2\n",
        ] {
            let case = parse(&format!("{plunge}{path}")).unwrap();
            assert_eq!(case.target, Target::Swept);
            let again = Case::parse(&case.to_toml(), Path::new("c.toml")).unwrap_or_else(|e| panic!("{e}"));
            assert_eq!(again, case);
        }
        let case =
            parse("pattern = \"plunge\"\nentry_mm = [1, 2, 3]\ndirection = [0, 3, 4]\ndepth_mm = 12\n")
                .unwrap();
        let Job::Channel(channel) = &case.job else { panic!() };
        assert_eq!(channel.entry, Entry::Point([1.0, 2.0, 3.0].into()));
        assert_eq!(channel.direction, ChannelDirection::Given([0.0, 0.6, 0.8].into()));
        assert_eq!((channel.end, channel.feed), (ChannelEnd::Depth(12.0), FeedSpec::PerRevolution(0.02)));
        assert!((channel.feed.speed_mm_s(500.0) - 0.02 * 500.0 / 60.0).abs() < 1e-15);
        assert!((FeedSpec::Speed(0.5).per_revolution_mm(600.0) - 0.05).abs() < 1e-15);
    }

    #[test]
    fn what_does_not_go_together_is_refused_with_its_key() {
        let plunge = "pattern = \"plunge\"\n";
        for (path, words) in [
            ("entry_mm = [1, 2, 3]\n", "target_mm"),
            ("entry_mm = [1, 2, 3]\ndepth_mm = 3\n", "path.direction"),
            ("entry_mm = [1, 2, 3]\ntarget_mm = [1, 2, 9]\ndepth_mm = 3\n", "depth_mm"),
            ("direction = \"safest\"\ndepth_mm = 3\n", "path.direction"),
            ("direction = \"safest\"\nentry_mm = [0, 0, 0]\ntarget_mm = [1, 2, 3]\n", "path.entry_mm"),
            ("direction = \"sideways\"\ntarget_mm = [1, 2, 3]\n", "path.direction"),
            ("direction = [0, 0, 0]\ntarget_mm = [1, 2, 3]\n", "path.direction"),
            ("direction = \"safest\"\ntarget_mm = [1, 2, 3]\nlayer_mm = 1\n", "path.layer_mm"),
            (
                "direction = \"safest\"\ntarget_mm = [1, 2, 3]\nfeed_mm_s = 1\nfeed_mm_rev = 0.1\n",
                "path.feed_mm_s",
            ),
            ("direction = \"safest\"\ntarget_mm = [1, 2, 3]\n[target]\nlabel = 1\n", "`target`"),
            ("direction = \"safest\"\ntarget_mm = [1, 2, 3]\n[speed]\nmin_mm_s = 1\n", "speed.min_mm_s"),
            ("direction = [0, 0, -1]\nentry_mm = [0, 0, 0]\ncontact_area_mm2 = 9\n", "path.contact_area_mm2"),
        ] {
            let said = parse(&format!("{plunge}{path}")).unwrap_err();
            assert!(said.contains(words), "{path}: {said}");
        }
        // a lawnmower has no depth
        let said = parse("pattern = \"lawnmower\"\ndepth_mm = 3\n").unwrap_err();
        assert!(said.contains("path.depth_mm"), "{said}");
    }
}
