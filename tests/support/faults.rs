//! Faults for a finished plan, each with the checks that must catch it (`name`, or `name/subject`).

use bonemill_geometry::{Point, Rigid};
use bonemill_planner::case::{LabelRef, SpeedMode};
use bonemill_planner::path::MoveKind;
use bonemill_planner::plan::{StoredPlan, Value};
use bonemill_planner::speed::DistanceCurve;
use bonemill_robot::Arm;
use nalgebra::{Rotation3, Vector3};

use super::relay::{relay, relay_at};

/// One kind of fault.
pub struct Fault {
    /// Its description.
    pub name: &'static str,
    /// Puts it into a plan.
    pub plant: fn(&mut StoredPlan),
    /// The checks that must find it.
    pub caught_by: &'static [&'static str],
}

/// Indices of the cuts.
fn cuts(plan: &StoredPlan) -> Vec<usize> {
    (0..plan.waypoints.len()).filter(|n| plan.waypoints[*n].kind == MoveKind::Cut).collect()
}

/// Index of the middle cut.
fn a_cut(plan: &StoredPlan) -> usize {
    let cuts = cuts(plan);
    cuts[cuts.len() / 2]
}

/// Turns the shaft of the middle third of the cuts by an angle from the approach, in the arm's plane.
fn tilt_cuts(plan: &mut StoredPlan, degrees: f64) {
    let tilt = degrees.to_radians();
    let base = Vector3::new(-tilt.sin(), 0.0, tilt.cos());
    let axis = plan.record.frames.base_from_ct.rotation.inverse() * base;
    let cuts = cuts(plan);
    for n in &cuts[cuts.len() / 3..2 * cuts.len() / 3] {
        plan.waypoints[*n].axis = axis;
    }
}

/// Changes a figure that is not one of the required ones.
pub fn scale_figure(plan: &mut StoredPlan, key: &str, by: f64) {
    let entry = plan.record.metrics.more.iter_mut().find(|(k, _)| k == key).unwrap();
    if let Value::Number(v) = &mut entry.1 {
        *v *= by;
    }
}

/// The same arm with a changed description.
fn described_as(plan: &mut StoredPlan, from: &str, to: &str) {
    let text = plan.arm.urdf_text();
    assert!(text.contains(from), "{from} in {text}");
    plan.arm = Arm::from_urdf(&text.replace(from, to), "test").unwrap().of_model("bone-attached").unwrap();
}

/// All kinds of faults.
pub const ALL: &[Fault] = &[
    Fault {
        name: "a waypoint moved, the arm not",
        plant: |p| {
            let n = a_cut(p);
            p.waypoints[n].position.coords.x += 0.3;
        },
        caught_by: &["arm at each waypoint's time"],
    },
    Fault {
        name: "two waypoints swapped, the arm not",
        plant: |p| {
            let cuts = cuts(p);
            let (a, b) = (cuts[10], cuts[cuts.len() - 10]);
            let (first, second) = (p.waypoints[a].position, p.waypoints[b].position);
            (p.waypoints[a].position, p.waypoints[b].position) = (second, first);
        },
        caught_by: &["arm at each waypoint's time", "trajectory's place on the path"],
    },
    Fault {
        name: "a waypoint next to the nerve, the arm too",
        plant: |p| {
            let n = a_cut(p);
            p.waypoints[n].position = Point::new(2.5, 6.0, 11.5);
            relay(p);
        },
        caught_by: &["clearance of moves/nerve", "clearance of the arm's burr/nerve"],
    },
    Fault {
        name: "the way between two waypoints past the nerve",
        plant: |p| {
            // both ends are clear, but the straight move between them is not
            let n = a_cut(p);
            p.waypoints[n].position = Point::new(4.2, 0.9, 9.2);
            p.waypoints[n + 1].position = Point::new(4.2, 12.6, 9.2);
            relay(p);
        },
        caught_by: &["clearance of moves/nerve", "clearance of the arm's burr/nerve"],
    },
    Fault {
        name: "the arm beside the path for a while",
        plant: |p| {
            let rows = p.trajectory.len();
            for row in rows / 3..rows / 2 {
                p.trajectory.q[row * p.trajectory.dof + 1] += 0.08;
            }
        },
        caught_by: &["trajectory's place on the path", "joint acceleration"],
    },
    Fault {
        name: "a shaft turned, the arm not",
        plant: |p| {
            let n = a_cut(p);
            let turn = Rotation3::from_axis_angle(&Vector3::y_axis(), 0.05);
            for w in &mut p.waypoints[n..n + 5] {
                w.axis = turn * w.axis;
            }
        },
        caught_by: &["trajectory's axis on the path", "rows/θ and φ are those of the axis"],
    },
    Fault {
        name: "shafts too oblique, the arm too",
        plant: |p| {
            tilt_cuts(p, 75.0);
            relay(p);
        },
        caught_by: &[
            "tilt of cuts/where they end",
            "tilt of cuts/where they begin",
            "tilt of cuts/on the way",
        ],
    },
    Fault {
        name: "the shaft nearly flat on the bone",
        plant: |p| {
            tilt_cuts(p, 88.0);
            relay(p);
        },
        caught_by: &[
            "shank in target bone that still stands",
            "shank in bone outside the target",
            "shank in bone far from the target",
        ],
    },
    Fault {
        name: "deep layers before high ones",
        plant: |p| {
            let deep = p.waypoints.iter().map(|w| w.layer).max().unwrap();
            let (high, mut low): (Vec<_>, Vec<_>) =
                p.waypoints[1..].iter().cloned().partition(|w| w.layer == 0 && w.layer != deep);
            p.waypoints.truncate(1);
            p.waypoints.append(&mut low);
            p.waypoints.extend(high);
            relay(p);
        },
        caught_by: &["mass/of a fiftieth", "links in bone/depth"],
    },
    Fault {
        name: "a mirrored frame",
        plant: |p| {
            for w in &mut p.waypoints {
                w.position.coords.x = -w.position.coords.x;
                w.axis.x = -w.axis.x;
            }
            relay(p);
        },
        caught_by: &["bone outside the target, by moves", "coverage"],
    },
    Fault {
        name: "joints in metres",
        plant: |p| {
            let dof = p.trajectory.dof;
            p.trajectory.q.chunks_mut(dof).for_each(|q| q[..3].iter_mut().for_each(|v| *v /= 1000.0));
        },
        caught_by: &["trajectory's place on the path", "arm at each waypoint's time"],
    },
    Fault {
        name: "half of the plan left out",
        plant: |p| {
            p.waypoints.truncate(p.waypoints.len() / 2);
            relay(p);
        },
        caught_by: &["coverage", "figures/removed_mm3", "figures/removed_mass_mg"],
    },
    Fault {
        name: "a plan that falls short by its own word",
        plant: |p| p.record.shortfalls.push("a reason".into()),
        caught_by: &["plan meets its case"],
    },
    Fault {
        name: "a time asked for and missed",
        plant: |p| p.record.case.speed.total_time_s = Some(0.5 * p.record.metrics.total_time_s),
        caught_by: &["time asked for"],
    },
    Fault {
        name: "forces beyond their caps",
        plant: |p| {
            let speed = &mut p.record.case.speed;
            speed.mode = SpeedMode::ForceLimited;
            speed.caps.force_n = Some(0.01);
            speed.caps.force_toward_n = DistanceCurve::new(&[[100.0, 0.0]]);
            speed.caps.power_w = Some(1e-3);
        },
        caught_by: &[
            "force asked for/speed.force_n",
            "force asked for/speed.force_toward_n",
            "driven force asked for/speed.force_n",
            "driven force asked for/speed.force_toward_n, nerve",
            "driven force asked for/speed.power_w",
        ],
    },
    Fault {
        name: "everything 1 mm deeper",
        plant: |p| {
            p.waypoints.iter_mut().for_each(|w| w.position.coords.z -= 1.0);
            relay(p);
        },
        caught_by: &["bone outside the target, by moves", "bone outside the target, by the arm"],
    },
    Fault {
        name: "cuts called links",
        plant: |p| {
            let n = a_cut(p);
            p.waypoints[n - 20..n].iter_mut().for_each(|w| w.kind = MoveKind::Link);
        },
        caught_by: &["links in bone/in all"],
    },
    Fault {
        name: "cuts faster than their caps",
        plant: |p| relay_at(p, 1.5, |kind| kind == MoveKind::Cut),
        caught_by: &["speed of cuts"],
    },
    Fault {
        name: "links faster than their caps",
        plant: |p| relay_at(p, 1.5, |kind| kind != MoveKind::Cut),
        caught_by: &["speed of links"],
    },
    Fault {
        name: "a clock twice as fast",
        plant: |p| {
            p.trajectory.time_s.iter_mut().for_each(|t| *t *= 0.5);
            p.waypoints.iter_mut().for_each(|w| w.time_s *= 0.5);
        },
        caught_by: &["trajectory clock/rows at k/rate", "joint acceleration"],
    },
    Fault {
        name: "a period lost",
        plant: |p| p.trajectory.time_s.iter_mut().skip(100).for_each(|t| *t += 1e-4),
        caught_by: &["trajectory clock/rows at k/rate"],
    },
    Fault {
        name: "a trajectory that ends early",
        plant: |p| {
            let keep = p.trajectory.len() - 30;
            p.trajectory.time_s.truncate(keep);
            p.trajectory.q.truncate(keep * p.trajectory.dof);
            p.trajectory.qd.truncate(keep * p.trajectory.dof);
        },
        caught_by: &["trajectory clock/ends with the last waypoint", "rest at both ends"],
    },
    Fault {
        name: "a slower arm",
        plant: |p| p.arm = p.arm.clone().with_limits(Some(&[1.0, 1.0, 1.0, 0.1]), None).unwrap(),
        caught_by: &["joint velocity"],
    },
    Fault {
        name: "a weaker arm",
        plant: |p| p.arm = p.arm.clone().with_limits(None, Some(&[2.0, 2.0, 2.0, 0.1])).unwrap(),
        caught_by: &["joint acceleration"],
    },
    Fault {
        name: "a limit of jerk that nobody kept",
        plant: |p| p.arm = p.arm.clone().with_jerk_limits(&[100.0; 4]).unwrap(),
        caught_by: &["joint jerk"],
    },
    Fault {
        name: "an arm with less reach",
        plant: |p| described_as(p, "lower=\"-0.085\" upper=\"0.085\"", "lower=\"-0.001\" upper=\"0.001\""),
        caught_by: &["joint range", "arm of the case"],
    },
    Fault {
        name: "a position that jumps for one row",
        plant: |p| {
            let at = p.trajectory.len() / 2 * p.trajectory.dof;
            p.trajectory.q[at] += 0.02;
        },
        caught_by: &["joint acceleration/x"],
    },
    Fault {
        name: "velocities that are not those of the positions",
        plant: |p| p.trajectory.qd.iter_mut().for_each(|v| *v = 0.0),
        caught_by: &["joint acceleration"],
    },
    Fault {
        name: "a plan that begins with a cut",
        plant: |p| p.waypoints[0].kind = MoveKind::Cut,
        caught_by: &["rows/the first is a link at 0 s"],
    },
    Fault {
        name: "a clock that falls back",
        plant: |p| {
            let n = a_cut(p);
            p.waypoints[n].time_s -= 5.0;
        },
        caught_by: &["rows/the clock never falls back"],
    },
    Fault {
        name: "an axis that is too long",
        plant: |p| p.waypoints[7].axis *= 1.001,
        caught_by: &["rows/axes are of length 1"],
    },
    Fault {
        name: "an angle edited",
        plant: |p| p.waypoints[7].theta_rad += 0.01,
        caught_by: &["rows/θ and φ are those of the axis"],
    },
    Fault {
        name: "a cap lowered in the file",
        plant: |p| {
            let n = a_cut(p);
            p.waypoints[n].speed_mm_s *= 0.5;
        },
        caught_by: &["rows/mean speed of moves"],
    },
    Fault {
        name: "a cap beyond the range of cuts",
        plant: |p| {
            let n = a_cut(p);
            p.waypoints[n].speed_mm_s = 9.0;
        },
        caught_by: &["rows/caps of cuts lie in the range"],
    },
    Fault {
        name: "a cap beyond that of links",
        plant: |p| p.waypoints[1].speed_mm_s = 50.0,
        caught_by: &["rows/caps of links"],
    },
    Fault {
        name: "a link called a cut",
        plant: |p| p.waypoints[1].kind = MoveKind::Cut,
        caught_by: &["rows/length of cuts"],
    },
    Fault {
        name: "the nearest structure left out",
        plant: |p| {
            let n = nearest(p);
            p.waypoints[n].structure = None;
        },
        caught_by: &["columns/alpha1"],
    },
    Fault {
        name: "a distance edited",
        plant: |p| {
            let n = nearest(p);
            p.waypoints[n].distance_mm = p.waypoints[n].distance_mm.map(|d| d + 0.01);
        },
        caught_by: &["columns/distance_mm"],
    },
    Fault {
        name: "a weight edited",
        plant: |p| {
            let n = nearest(p);
            p.waypoints[n].alpha1 = Some(0.0);
        },
        caught_by: &["columns/alpha1"],
    },
    Fault {
        name: "a force toward the nerve edited",
        plant: |p| {
            let n = nearest(p);
            p.waypoints[n].force_toward_n = p.waypoints[n].force_toward_n.map(|f| f + 0.1);
        },
        caught_by: &["columns/force_toward_n"],
    },
    Fault {
        name: "a cost edited",
        plant: |p| {
            let n = a_cut(p);
            let costly = (n..p.waypoints.len()).find(|n| p.waypoints[*n].cost.is_some()).unwrap();
            p.waypoints[costly].cost = p.waypoints[costly].cost.map(|c| c + 0.1);
        },
        caught_by: &["columns/cost"],
    },
    Fault {
        name: "masses edited",
        plant: |p| {
            let n = a_cut(p);
            p.waypoints[n..].iter_mut().for_each(|w| w.mass_mg *= 1.5);
        },
        caught_by: &["mass/in all", "mass/of a fiftieth"],
    },
    Fault {
        name: "a larger removed volume claimed",
        plant: |p| p.record.metrics.removed_mm3 *= 1.01,
        caught_by: &["figures/removed_mm3"],
    },
    Fault {
        name: "a smaller target claimed",
        plant: |p| p.record.metrics.target_mm3 *= 0.99,
        caught_by: &["figures/target_mm3"],
    },
    Fault {
        name: "less to reach claimed",
        plant: |p| p.record.metrics.reachable_mm3 *= 0.99,
        caught_by: &["figures/reachable_mm3"],
    },
    Fault {
        name: "more material claimed",
        plant: |p| p.record.metrics.removed_material_mm3 *= 1.01,
        caught_by: &["figures/removed_material_mm3"],
    },
    Fault {
        name: "more bone claimed",
        plant: |p| p.record.metrics.removed_bone_mm3 *= 1.01,
        caught_by: &["figures/removed_bone_mm3"],
    },
    Fault {
        name: "less of the reachable bone claimed",
        plant: |p| {
            let entry = p.record.metrics.more.iter_mut().find(|(k, _)| k == "reachable").unwrap();
            let Value::Table(entries) = &mut entry.1 else { unreachable!() };
            let bone = entries.iter_mut().find(|(k, _)| k == "bone_mm3").unwrap();
            if let Value::Number(v) = &mut bone.1 {
                *v *= 0.999;
            }
        },
        caught_by: &["figures/reachable.bone_mm3"],
    },
    Fault {
        name: "a target twice as large, and all of it removed",
        plant: |p| {
            p.record.metrics.target_mm3 *= 2.0;
            p.record.metrics.removed_mm3 *= 2.0;
        },
        caught_by: &["figures on a finer lattice/target_mm3", "figures on a finer lattice/removed_mm3"],
    },
    Fault {
        name: "a clearance lowered in the plan",
        plant: |p| p.record.case.structures[0].clearance_mm = 0.2,
        caught_by: &["case of the plan"],
    },
    Fault {
        name: "another burr than the plan was made for",
        plant: |p| p.record.case.burr.radius_mm = 2.6,
        caught_by: &["case of the plan", "bone outside the target, by moves"],
    },
    Fault {
        name: "a shank that keeps no distance",
        plant: |p| p.record.case.structures[0].shank_clearance_mm = 8.0,
        caught_by: &["clearance of the shank/nerve"],
    },
    Fault {
        name: "a structure that is not in the map",
        plant: |p| p.record.case.structures[0].label = LabelRef::Number(99),
        caught_by: &["structures are in the label map", "case of the plan"],
    },
    Fault {
        name: "another approach in the plan",
        plant: |p| p.record.frames.approach_direction = Vector3::new(0.0, 0.6, 0.8),
        caught_by: &["frames/approach of the case"],
    },
    Fault {
        name: "a turned work frame",
        plant: |p| {
            let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), 0.01);
            let frame = &p.record.frames.ct_from_approach;
            p.record.frames.ct_from_approach = Rigid::new(frame.rotation * turn, frame.translation_mm);
        },
        caught_by: &["frames/ct_from_work is the approach's basis"],
    },
    Fault {
        name: "a registration that the case does not give",
        plant: |p| p.record.frames.registration_assumed = false,
        caught_by: &["frames/base_from_ct of the case"],
    },
    Fault {
        name: "a patient 2 mm aside",
        plant: |p| p.record.frames.base_from_ct.translation_mm.x += 2.0,
        caught_by: &["trajectory's place on the path"],
    },
    Fault {
        name: "a tool that is mounted otherwise",
        plant: |p| p.record.frames.flange_from_burr.0[2] = 10.0,
        caught_by: &["frames/flange_from_burr of the case"],
    },
    Fault {
        name: "a faster arm than the one of the case",
        plant: |p| described_as(p, "velocity=\"", "velocity=\"1"),
        caught_by: &["arm of the case"],
    },
];

/// The waypoint with the largest α₁ and a force.
fn nearest(plan: &StoredPlan) -> usize {
    let alpha = |n: &usize| plan.waypoints[*n].alpha1.unwrap_or(0.0);
    let with_force = (0..plan.waypoints.len()).filter(|n| plan.waypoints[*n].force_toward_n.is_some());
    with_force.max_by(|a, b| alpha(a).total_cmp(&alpha(b))).unwrap()
}
