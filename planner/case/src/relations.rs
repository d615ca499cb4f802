//! Keys that are right by themselves but contradict each other.

use super::error::CaseFault;
use super::hold::judge_holds;
use super::keys::Unit;
use super::room::judge_obstacles;
use super::suggest::nearest;
use bonemill_arm::arm::NAMES;
use bonemill_arm::ur::UrModel;

use super::{Case, ForceTerm, Job, SpeedMode, Target, ToolSpec};

/// No handpiece is thicker, mm; access grows with the cube of it.
const MOST_SHANK_RADIUS_MM: f64 = 30.0;

/// A number against a limit that another key sets.
struct Bound {
    key: &'static str,
    found: f64,
    holds: bool,
    relation: &'static str,
    limit: f64,
    of: &'static str,
    unit: Unit,
}

/// Notes every contradiction; `note` takes the fault and the key it stands at, `is_default` tells absent keys.
pub(super) fn judge(case: &Case, note: &dyn Fn(CaseFault, &str), is_default: &dyn Fn(&str) -> bool) {
    let bounds = if case.job == Job::Bone { bounds(case) } else { channel_bounds(case) };
    for Bound { key, found, holds, relation, limit, of, unit } in bounds {
        if !holds {
            let is_default = is_default(key);
            note(CaseFault::Relation { key: key.into(), found, is_default, relation, limit, of, unit }, key);
        }
    }
    judge_target(case, note);
    judge_structures(case, note);
    judge_holds(case, note);
    judge_obstacles(case, note);
    judge_arm(case, note);
    judge_joints(case, note);
    judge_choices(case, note);
    judge_tool(case, note);
}

/// A channel has no layers, and its tool is not the burr.
fn channel_bounds(case: &Case) -> Vec<Bound> {
    let shared = ["density.bone_hu", "grid.spacing_mm"];
    bounds(case).into_iter().filter(|bound| shared.contains(&bound.key)).collect()
}

/// The tool's dimensions make a tool, and the coefficients fit their model.
fn judge_tool(case: &Case, note: &dyn Fn(CaseFault, &str)) {
    if let Err((table, problem)) = case.tool.build() {
        note(CaseFault::Cutter { table, problem }, table);
    }
    let edges = &case.edge_material;
    for (key, list) in [("material.k_normal", &edges.k_normal), ("material.k_friction", &edges.k_friction)] {
        let (found, expected) = (list.len(), edges.model.coefficients());
        if found != expected {
            let expected = format!("{expected}, as material.edge_model = \"{}\" has", edges.model.word());
            note(CaseFault::Length { key: key.into(), found, expected }, key);
        }
    }
}

/// `found` against a largest value.
fn at_most(key: &'static str, found: f64, limit: f64, of: &'static str, unit: Unit) -> Bound {
    Bound { key, found, holds: found <= limit, relation: "at most", limit, of, unit }
}

/// What follows from the burr's radius.
fn burr_bounds(case: &Case) -> Vec<Bound> {
    let (r, path) = (case.burr.radius_mm, case.path);
    let mut bounds = vec![
        at_most("path.layer_mm", path.layer_mm, 2.0 * r, "twice burr.radius_mm", Unit::Mm),
        at_most("path.stepover_mm", path.stepover_mm, 2.0 * r, "twice burr.radius_mm", Unit::Mm),
        at_most("path.step_mm", path.step_mm, r, "burr.radius_mm", Unit::Mm),
        at_most("grid.spacing_mm", case.grid.spacing_mm, r / 2.0, "half of burr.radius_mm", Unit::Mm),
        Bound {
            key: "burr.neck_radius_mm",
            found: case.burr.neck_radius_mm,
            holds: case.burr.neck_radius_mm < r,
            relation: "below",
            limit: r,
            of: "burr.radius_mm: the neck is thinner than the ball",
            unit: Unit::Mm,
        },
    ];
    if let Some(first) = case.shank.first() {
        let (limit, of) = if first.radius_mm > r {
            (r, "burr.radius_mm: a shank thicker than the burr cannot follow it into the bone")
        } else {
            let room = "burr.radius_mm less half of grid.spacing_mm: a voxel hides so much bone beside the burr's slot";
            (r - 0.5 * case.grid.spacing_mm, room)
        };
        bounds.push(at_most("shank.segments", first.radius_mm, limit, of, Unit::Mm));
    }
    bounds
}

fn bounds(case: &Case) -> Vec<Bound> {
    let speed = &case.speed;
    let mut bounds = vec![
        at_most("speed.min_mm_s", speed.min_mm_s, speed.max_mm_s, "speed.max_mm_s", Unit::MmS),
        Bound {
            key: "density.bone_hu",
            found: case.density.bone_hu,
            holds: case.density.bone_hu > case.density.air_hu,
            relation: "above",
            limit: case.density.air_hu,
            of: "density.air_hu",
            unit: Unit::Hu,
        },
    ];
    match case.tool.radius_mm() {
        // a mesh's radius is known once it is read
        None if case.tool != ToolSpec::Burr => {}
        None => bounds.extend(burr_bounds(case)),
        Some(r) => {
            bounds.push(at_most("grid.spacing_mm", case.grid.spacing_mm, r, "the tool's radius", Unit::Mm));
            let of = "the tool's radius: a thicker shank cannot follow it into the bone";
            bounds
                .extend(case.shank.first().map(|s| at_most("shank.segments", s.radius_mm, r, of, Unit::Mm)));
        }
    }
    for cylinder in &case.shank {
        let of = "the thickest handpiece";
        bounds.push(at_most("shank.segments", cylinder.radius_mm, MOST_SHANK_RADIUS_MM, of, Unit::Mm));
    }
    let is_timed_by_nominal = speed.mode == SpeedMode::LeastForce && speed.total_time_s.is_none();
    let is_range = speed.min_mm_s <= speed.max_mm_s;
    if is_range && (speed.mode == SpeedMode::Constant || is_timed_by_nominal) {
        let key = "speed.nominal_mm_s";
        let (found, unit) = (speed.nominal_mm_s, Unit::MmS);
        bounds.push(at_most(key, found, speed.max_mm_s, "speed.max_mm_s", unit));
        let (holds, limit) = (found >= speed.min_mm_s, speed.min_mm_s);
        bounds.push(Bound { key, found, holds, relation: "at least", limit, of: "speed.min_mm_s", unit });
    }
    bounds
}

/// The shapes of the target, of `also` and of `less`.
fn judge_target(case: &Case, note: &dyn Fn(CaseFault, &str)) {
    judge_shape(&case.target, "target", note);
    for (name, regions) in [("also", &case.also), ("less", &case.less)] {
        for (n, region) in regions.iter().enumerate() {
            judge_shape(&region.of, &format!("target.{name}[{n}]"), note);
        }
    }
}

fn judge_shape(shape: &Target, table: &str, note: &dyn Fn(CaseFault, &str)) {
    let above = |name: &str, found: f64, limit: f64, of: &'static str| {
        let (key, relation, unit, is_default) = (format!("{table}.{name}"), "above", Unit::Mm, false);
        let at = key.clone();
        note(CaseFault::Relation { key, found, is_default, relation, limit, of, unit }, &at);
    };
    match shape {
        Target::Box { min_mm, max_mm } => {
            for (low, high) in min_mm.iter().zip(max_mm.iter()) {
                if high <= low {
                    above("box.max_mm", *high, *low, "the same coordinate of min_mm");
                }
            }
        }
        Target::Frustum { from_mm, to_mm, from_radius_mm, to_radius_mm } => {
            let length = (to_mm - from_mm).norm();
            if length < 1e-3 {
                above("frustum.to_mm", length, 0.001, "the frustum's length from from_mm to to_mm");
            }
            let widest = from_radius_mm.max(*to_radius_mm);
            if widest < 0.5 {
                above("frustum.from_radius_mm", widest, 0.5, "the wider of the frustum's two radii");
            }
        }
        Target::Label(_) | Target::Ball { .. } | Target::Swept => {}
    }
}

fn judge_structures(case: &Case, note: &dyn Fn(CaseFault, &str)) {
    for (n, structure) in case.structures.iter().enumerate() {
        let earlier = case.structures.iter().take(n).position(|s| s.name == structure.name);
        if let Some(first) = earlier {
            let key = format!("structure[{n}].name");
            let (found, other) = (format!("{:?}", structure.name), format!("structure[{first}].name"));
            note(CaseFault::Duplicate { key: key.clone(), found, other }, &key);
        }
        let same = case.structures.iter().take(n).find(|s| s.label == structure.label);
        if let Some(first) = same {
            let key = format!("structure[{n}].{}", structure.label.key());
            let (label, first, second) =
                (structure.label.to_string(), first.name.clone(), structure.name.clone());
            note(CaseFault::SharedLabel { key: key.clone(), label, first, second }, &key);
        }
        if matches!(&case.target, Target::Label(label) if *label == structure.label) {
            let of = structure.label.key();
            let key = format!("structure[{n}].{of}");
            let (found, other) = (structure.label.to_string(), format!("target.{of}"));
            note(CaseFault::Duplicate { key: key.clone(), found, other }, &key);
        }
    }
}

/// Joints of the arms that come with the planner; a URDF's are counted when it is read.
fn known_joints(model: &str) -> Option<usize> {
    match model {
        "bone-attached" => Some(4),
        _ => UrModel::by_name(model).map(|_| 6),
    }
}

/// A name without an ending and without a folder is no path: it must be an arm's.
fn judge_arm(case: &Case, note: &dyn Fn(CaseFault, &str)) {
    let found = case.robot.model.clone();
    if known_joints(&found).is_some() || found.contains(['.', '/', '\\']) {
        return;
    }
    let (key, options) = ("robot.model", NAMES.to_vec());
    let nearest = nearest(&found, NAMES.into_iter()).map(str::to_owned);
    note(CaseFault::UnknownArm { key: key.into(), found, options, nearest }, key);
}

fn judge_joints(case: &Case, note: &dyn Fn(CaseFault, &str)) {
    let Some(joints) = known_joints(&case.robot.model) else { return };
    let robot = &case.robot;
    let lists = [
        ("robot.joint_stiffness", &robot.joint_stiffness),
        ("robot.velocity_limits", &robot.velocity_limits),
        ("robot.acceleration_limits", &robot.acceleration_limits),
        ("robot.jerk_limits", &robot.jerk_limits),
    ];
    for (key, list) in lists {
        let found = list.as_ref().map_or(joints, Vec::len);
        if found != joints {
            let expected = format!("{joints}, one per joint of {}", robot.model);
            note(CaseFault::Length { key: key.into(), found, expected }, key);
        }
    }
}

/// What one choice needs and another lacks.
fn judge_choices(case: &Case, note: &dyn Fn(CaseFault, &str)) {
    let is_speed = |key: &&str| key.starts_with("speed.") && *key != "speed.link_mm_s";
    if let (Job::Channel(_), Some(key)) = (&case.job, case.given.keys().find(is_speed)) {
        let why =
            "a channel's speed is path.feed_mm_rev or path.feed_mm_s, and speed.link_mm_s outside the bone";
        note(CaseFault::Contradiction { key: key.into(), why }, key);
    }
    let is_error = |key: &&str| ["accuracy.force", "accuracy.removed", "accuracy.distance_mm"].contains(key);
    if let (Job::Channel(_), Some(key)) = (&case.job, case.given.keys().find(is_error)) {
        let why = "errors are measured on bone that is milled in layers, not on channels: leave the key out";
        note(CaseFault::Contradiction { key: key.into(), why }, key);
    }
    if case.cost.force == ForceTerm::Deflection && case.robot.joint_stiffness.is_none() {
        let expected = "one value per joint, N/mm or N·mm/rad, for cost.force = \"deflection\"".into();
        note(CaseFault::Missing { key: "robot.joint_stiffness".into(), expected }, "cost.force");
    }
    let caps = &case.speed.caps;
    if caps.deflection_um.is_some() && case.robot.joint_stiffness.is_none() {
        let expected = "one value per joint, N/mm or N·mm/rad, for speed.deflection_um".into();
        note(CaseFault::Missing { key: "robot.joint_stiffness".into(), expected }, "speed.deflection_um");
    }
    if case.orientation.angles == 2 && case.robot.model == "bone-attached" {
        let why =
            "the bone-attached arm has one tilt: leave the key out, say 1, or choose another robot.model";
        note(CaseFault::Contradiction { key: "orientation.angles = 2".into(), why }, "orientation.angles");
    }
    let caps_given = [
        ("speed.force_n", caps.force_n.is_some()),
        ("speed.force_toward_n", caps.force_toward_n.is_some()),
        ("speed.deflection_um", caps.deflection_um.is_some()),
        ("speed.power_w", caps.power_w.is_some()),
    ];
    for (key, given) in caps_given {
        if given && !case.speed.mode.keeps_caps() {
            // a cap that nothing keeps would be read as a promise
            let why = "caps are kept with speed.mode = \"force_limited\" and \"least_force\" only";
            note(CaseFault::Contradiction { key: key.into(), why }, key);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::keys::MODEL;

    #[test]
    fn the_documented_arms_are_those_that_there_are() {
        let named = NAMES.map(|name| format!("`{name}`")).join(", ");
        assert_eq!(MODEL.expects, format!("{named} or the path of a .urdf file"));
        assert!(NAMES.iter().all(|name| known_joints(name).is_some()));
    }
}
