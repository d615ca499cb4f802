//! Faults in `forces.csv` and in the figures of the structures.

use bonemill_planner::plan::{ForceToward, StoredPlan, Value};
use nalgebra::{Rotation3, Vector3};

use super::faults::Fault;

/// A figure of a structure, by its keys.
fn structure_figure<'a>(plan: &'a mut StoredPlan, keys: &[&str]) -> &'a mut Value {
    let entries = &mut plan.record.metrics.more;
    let mut value = &mut entries.iter_mut().find(|(key, _)| key == "structures").unwrap().1;
    for key in keys {
        let Value::Table(entries) = value else { panic!("{key} in no table") };
        value = &mut entries.iter_mut().find(|(name, _)| name == key).unwrap().1;
    }
    value
}

/// The row with the largest force toward a structure.
fn largest_force(plan: &mut StoredPlan) -> &mut ForceToward {
    plan.forces.iter_mut().max_by(|a, b| a.force_toward_n.total_cmp(&b.force_toward_n)).unwrap()
}

/// All kinds of faults.
pub const ALL: &[Fault] = &[
    Fault {
        name: "a structure's row of forces left out",
        plant: |p| {
            p.forces.remove(p.forces.len() / 2);
        },
        caught_by: &["forces.csv/a row for each structure within its influence"],
    },
    Fault {
        name: "a distance in the forces edited",
        plant: |p| largest_force(p).distance_mm -= 0.01,
        caught_by: &["forces.csv/distance_mm"],
    },
    Fault {
        name: "a direction toward the nerve turned",
        plant: |p| {
            let row = largest_force(p);
            row.toward = Rotation3::new(Vector3::new(0.1, 0.2, 0.3)) * row.toward;
        },
        caught_by: &["forces.csv/toward", "forces.csv/force_toward_n"],
    },
    Fault {
        name: "the largest force toward the nerve halved",
        plant: |p| largest_force(p).force_toward_n *= 0.5,
        caught_by: &["forces.csv/force_toward_n"],
    },
    Fault {
        name: "a mean within a move halved",
        plant: |p| largest_force(p).mean_toward_n *= 0.5,
        caught_by: &["figures/structures.nerve.mean_force_toward_n"],
    },
    Fault {
        name: "the peak of the force toward the nerve halved",
        plant: |p| {
            let peak = p.forces.iter_mut().max_by(|a, b| a.peak_toward_n.total_cmp(&b.peak_toward_n));
            peak.unwrap().peak_toward_n *= 0.5;
        },
        caught_by: &["figures/structures.nerve.peak_force_toward_n"],
    },
    Fault {
        name: "a mean force toward the nerve understated",
        plant: |p| *structure_figure(p, &["nerve", "mean_force_toward_n"]) = 0.001.into(),
        caught_by: &["figures/structures.nerve.mean_force_toward_n"],
    },
    Fault {
        name: "a 75th percentile near the nerve understated",
        plant: |p| *structure_figure(p, &["nerve", "near", "p75_force_toward_with_zeros_n"]) = (-1.0).into(),
        caught_by: &["figures/structures.nerve.near.p75_force_toward_with_zeros_n"],
    },
    Fault {
        name: "a least distance overstated",
        plant: |p| *structure_figure(p, &["nerve", "least_surface_distance_mm"]) = 1.5.into(),
        caught_by: &["figures/structures.nerve.least_surface_distance_mm"],
    },
    Fault {
        name: "a cut that is said to remove nothing and is slower than a skin may ask for",
        plant: |p| {
            let row = largest_force(p).waypoint;
            p.waypoints[row].mass_mg = 0.0;
            p.waypoints[row].speed_mm_s = 0.09 * p.record.case.speed.min_mm_s;
        },
        caught_by: &["rows/caps of cuts lie in the range"],
    },
    Fault {
        name: "a mean within a move above its peak",
        plant: |p| {
            let row = largest_force(p);
            row.mean_toward_n = row.peak_toward_n + 0.01;
        },
        caught_by: &["forces.csv/mean_toward_n", "figures/structures.nerve.mean_force_toward_n"],
    },
    Fault {
        name: "the peak placed at another waypoint",
        plant: |p| *structure_figure(p, &["nerve", "peak_force_toward_waypoint"]) = 1usize.into(),
        caught_by: &["figures/structures.nerve.peak_force_toward_n at its waypoint"],
    },
];
