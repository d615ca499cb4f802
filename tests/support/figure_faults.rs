//! Faults in the figures of a plan, in the grid on which they are counted, and in what it says it chose.

use bonemill_planner::case::Sense;
use bonemill_planner::plan::Value;
use bonemill_robot::ur::Branches;

use super::faults::{Fault, scale_figure};

/// All kinds of faults.
pub const ALL: &[Fault] = &[
    Fault {
        name: "a planning grid that leaves out a part of the target",
        plant: |p| p.record.frames.grid.dims[1] -= 12,
        caught_by: &["planning grid around the target", "figures/reachable.all_mm3"],
    },
    Fault {
        name: "a planning grid that lies otherwise",
        plant: |p| p.record.frames.grid.turn_rad += 0.05,
        caught_by: &["figures/reachable.all_mm3"],
    },
    Fault {
        name: "a shorter time claimed",
        plant: |p| p.record.metrics.total_time_s -= 1.0,
        caught_by: &["figures/total_time_s"],
    },
    Fault {
        name: "shares raised",
        plant: |p| {
            scale_figure(p, "reached_share", 1.001);
            scale_figure(p, "removed_share", 1.001);
        },
        caught_by: &["figures/reached_share", "figures/removed_share"],
    },
    Fault {
        name: "another volume of untargeted bone",
        plant: |p| {
            let found = p.record.metrics.more.iter_mut().find(|(k, _)| k == "untargeted_bone_by_voxels_mm3");
            found.unwrap().1 = Value::Number(1e3);
        },
        caught_by: &["figures/untargeted_bone_by_voxels_mm3"],
    },
    Fault {
        name: "a shorter path claimed",
        plant: |p| scale_figure(p, "path_length_mm", 0.99),
        caught_by: &["figures/path_length_mm"],
    },
    Fault {
        name: "half the speed that the arm drives stated",
        plant: |p| p.waypoints.iter_mut().for_each(|w| w.driven_mm_s *= 0.5),
        caught_by: &["driven_mm_s"],
    },
    Fault {
        name: "a smaller largest force claimed",
        plant: |p| scale_figure(p, "peak_force_n", 0.5),
        caught_by: &["figures/peak_force_n", "driven force/peak_force_n"],
    },
    Fault {
        name: "a smaller mean force claimed",
        plant: |p| scale_figure(p, "mean_force_n", 0.5),
        caught_by: &["figures/mean_force_n", "driven mean force/mean_force_n"],
    },
    Fault {
        name: "a material that is twice as hard",
        plant: |p| p.record.case.material.k_n_mm2 = p.record.case.material.k_n_mm2.map(|k| 2.0 * k),
        caught_by: &["driven force/peak_force_n", "driven mean force/mean_force_n"],
    },
    Fault {
        name: "a larger share of the target asked for than is removed",
        plant: |p| p.record.case.least_share = 1.0,
        caught_by: &["removed of the target", "case of the plan"],
    },
    Fault {
        name: "choices that the case does not leave",
        plant: |p| {
            for (key, value) in &mut p.record.modelled {
                match key.as_str() {
                    "spin" => *value = Value::Integer(1),
                    "raster_deg" => *value = Value::Number(17.0),
                    "sense" => *value = Value::Text("climb".into()),
                    _ => {}
                }
            }
            p.record.case.path.raster_rad = Some(0.0);
            p.record.case.path.sense = Sense::Both;
            p.record.case.robot.branch = Branches::one(5);
        },
        caught_by: &[
            "choices within the case/burr.spin",
            "choices within the case/path.raster_deg",
            "choices within the case/path.sense",
            "choices within the case/robot.branch",
        ],
    },
];
