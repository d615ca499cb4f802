//! The least distance of an arm's links from what is around them, along a plan.

use bonemill_case::{Case, HeadSource};
use bonemill_planfile::Value;
use bonemill_robot::resolve::DensePath;
use bonemill_robot::room::{LinkMotion, Room, link_name};

/// Where the links come nearest to anything, along a path and between its places.
#[derive(Debug, Clone, PartialEq)]
pub struct LinkDistance {
    /// A distance that no link falls below, mm; negative where one may run into something.
    pub least_mm: f64,
    /// The link.
    pub link: &'static str,
    /// What it is near.
    pub near: String,
    /// The waypoint, or the one that the arm is on its way to.
    pub waypoint: usize,
    /// The distance that links keep, mm.
    pub clearance_mm: f64,
}

impl LinkDistance {
    /// Along a motion; `None` without a room.
    pub fn along(room: Option<&Room>, motion: &DensePath) -> Option<Self> {
        let room = room?;
        let least = room.along(LinkMotion { q: &motion.q })?;
        Some(Self {
            least_mm: least.nearest.distance_mm,
            link: link_name(least.nearest.link),
            near: room.name(least.nearest.other),
            waypoint: motion.waypoints.partition_point(|at| *at < least.place),
            clearance_mm: room.clearance_mm(),
        })
    }

    /// In words.
    pub fn text(&self) -> String {
        let Self { least_mm, link, near, waypoint, .. } = self;
        format!("{link} at least {least_mm:.1} mm from {near}, on the way to waypoint {waypoint}")
    }

    /// The entry of `[modelled]`; `time_s` of the waypoint.
    pub fn entry(&self, case: &Case, time_s: f64) -> (String, Value) {
        let mut entries = vec![
            ("least_mm".to_owned(), self.least_mm.into()),
            ("link".into(), Value::Text(self.link.into())),
            ("near".into(), Value::Text(self.near.clone())),
            ("waypoint".into(), self.waypoint.into()),
            ("time_s".into(), time_s.into()),
            ("clearance_mm".into(), self.clearance_mm.into()),
        ];
        let room = &case.robot.room;
        if room.head == HeadSource::Scan {
            entries.push(("head_beyond_mm".into(), room.head_beyond_mm.into()));
        }
        ("link_distance".into(), Value::Table(entries))
    }

    /// What is wrong where links come too near, `time_s` into the plan.
    pub fn shortfall(&self, time_s: impl Fn(usize) -> f64) -> Option<String> {
        let Self { least_mm, link, near, waypoint, clearance_mm, .. } = self;
        (least_mm < clearance_mm).then(|| {
            let how = if *least_mm < 0.0 {
                format!("may run into {near}, by up to {:.1} mm,", -least_mm)
            } else {
                format!("comes within {least_mm:.1} mm of {near}")
            };
            format!(
                "the arm's {link} {how} on the way to waypoint {waypoint}, {:.1} s into the plan (robot.link_clearance_mm = \
                 {clearance_mm}): {WHAT_TO_CHANGE}",
                time_s(*waypoint)
            )
        })
    }
}

/// What helps where links come too near.
pub const WHAT_TO_CHANGE: &str = "move the base or the patient (robot.base_from_ct), mount the handpiece at another angle \
                                  (robot.flange_from_burr), allow more branches (robot.branch) or a larger orientation.tilt_limit_deg";
