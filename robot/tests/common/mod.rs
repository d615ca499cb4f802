//! A small plan for a UR5e: the burr goes round in a circle beside a nerve, and turns its shaft.

use bonemill_arm::arm::{ToolGoal, dls};
use bonemill_arm::ur::UrModel;
use bonemill_arm::{Arm, ToolMount};
use bonemill_geometry::Rigid;
use bonemill_robot::stream::{
    HoldPlace, Joints, Near, Settings, Standing, StreamInput, StreamPlan, StructureKept, WaypointNear,
};
use nalgebra::{Rotation3, Vector3};

pub const PERIOD_S: f64 = 0.002;

/// A UR5e with a burr 150 mm from its flange.
pub fn arm() -> Arm {
    let flange_from_burr = Rigid::new(
        Rotation3::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI),
        Vector3::new(0.0, 0.0, 150.0),
    );
    Arm::ur(UrModel::Ur5e, None).unwrap().with_mount(ToolMount { flange_from_burr })
}

pub fn settings() -> Settings {
    Settings { payload_kg: Some(1.0), run_up_s: 0.1, slow: true, ..Settings::default() }
}

/// Joints along a circle of 3 mm, at rest in the beginning and in the end.
pub fn rows(arm: &Arm, seconds: f64, most_mm_s: f64) -> Vec<Joints> {
    let count = (seconds / PERIOD_S) as usize;
    let mut q: Joints = [0.4, -1.3, 1.6, -1.8, -1.5, 0.2];
    let start = arm.tool_at(&q);
    let mut way_mm = 0.0;
    let mut rows = vec![q];
    for n in 1..=count {
        let share = n as f64 / count as f64;
        way_mm += most_mm_s * PERIOD_S * (std::f64::consts::PI * share).sin().powi(2);
        let angle = way_mm / 3.0;
        let off = Vector3::new(3.0 * angle.sin(), 3.0 * (1.0 - angle.cos()), 0.4 * angle.sin());
        let turn = Rotation3::from_axis_angle(&Vector3::x_axis(), 0.1 * (1.0 - angle.cos()));
        let pose = Rigid::new(turn * start.rotation, start.translation_mm + off);
        q = dls::solve(arm, &ToolGoal::Pose(pose), &q).q.try_into().unwrap();
        rows.push(q);
    }
    rows
}

/// What a plan is made of, to be changed by tests.
pub struct Values {
    pub arm: Arm,
    pub time_s: Vec<f64>,
    pub q: Vec<f64>,
    pub waypoints: Vec<WaypointNear>,
    pub holds: Vec<HoldPlace>,
    pub registration_assumed: bool,
    pub standing: Standing,
}

/// Values of a plan with so much room to a nerve.
pub fn values(seconds: f64, most_mm_s: f64, gap_mm: f64) -> Values {
    let arm = arm();
    let rows = rows(&arm, seconds, most_mm_s);
    let near = vec![Near { structure: 0, gap_mm, toward: Vector3::x(), force_n: 0.5 }];
    let every = (0..rows.len()).step_by(25).map(|row| row as f64 * PERIOD_S);
    Values {
        time_s: (0..rows.len()).map(|n| n as f64 * PERIOD_S).collect(),
        q: rows.concat(),
        waypoints: every.map(|time_s| WaypointNear { time_s, near: near.clone() }).collect(),
        holds: vec![],
        registration_assumed: false,
        standing: Standing::Verified,
        arm,
    }
}

impl Values {
    pub fn input(&self) -> StreamInput<'_> {
        StreamInput {
            arm: &self.arm,
            model: "ur5e".into(),
            time_s: &self.time_s,
            q: &self.q,
            structures: vec![StructureKept { name: "nerve".into(), clearance_mm: 0.3 }],
            waypoints: self.waypoints.clone(),
            holds: self.holds.clone(),
            registration_assumed: self.registration_assumed,
            standing: self.standing.clone(),
            digest: "d1".into(),
        }
    }

    pub fn plan(&self, settings: Settings) -> StreamPlan {
        StreamPlan::new(self.input(), settings).unwrap()
    }
}
