//! Reads a URDF's text into a checked serial chain, with `urdf-rs` and `k`.
//!
//! Only this module uses `k` and its nalgebra (0.30, older than the workspace's); it hands out plain arrays. `k` builds
//! the joints (origins, unit axes, types). But it drops velocity limits, reads floating joints as fixed ones, and reads
//! cyclic or disconnected descriptions as chains of 0 or 1 joints. So the description is checked before `k` gets it, and
//! limits come from `urdf-rs`. `k`'s chain keeps joint positions behind locks; its constants are copied into
//! [`Segment`]s, plain data that many threads can evaluate at once.
//!
//! Accelerations and jerks of `<limit>` are part of URDF since 1.2, but `urdf-rs` does not read them; they are read from
//! the XML itself.
//!
//! Metres are converted here; all results are in mm and rad. Inertias, meshes, transmissions and safety controllers are
//! not read.

mod xml;

use std::collections::HashMap;

use nalgebra::{Matrix3, Rotation3, Unit, Vector3};
use urdf_rs::JointType;

use self::xml::Further;
use super::joint::{Joint, JointKind, assumed_acceleration, assumed_jerk};
use crate::error::{RobotError, UrdfFault};

const MM_PER_M: f64 = 1000.0;
/// The median length of an arm's links is below this, m. With lengths in mm, the median of every arm is above it.
const LONGEST_LINK: f64 = 5.0;

/// One joint of the chain: the transform from its parent link to its child link.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Segment {
    /// The child's axes in the parent at joint position 0.
    pub rotation: Rotation3<f64>,
    /// The child's origin in the parent at joint position 0, mm.
    pub translation_mm: Vector3<f64>,
    /// How it moves, and its axis; `None` where it is fixed.
    pub motion: Option<(JointKind, Unit<Vector3<f64>>)>,
}

/// The chain from base to tip, checked.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Description {
    /// The link whose frame is the base.
    pub base: String,
    /// Every joint between base and tip, fixed ones included, in order.
    pub segments: Vec<Segment>,
    /// The moving joints, in the same order.
    pub joints: Vec<Joint>,
}

/// Reads, checks and converts a URDF.
pub(super) fn parse(text: &str, source_name: &str) -> Result<Description, RobotError> {
    let faulty = |fault| RobotError::Urdf { source_name: source_name.to_owned(), fault };
    xml::check(text).map_err(faulty)?;
    let robot = urdf_rs::read_from_string(text)
        .map_err(|source| RobotError::ParseUrdf { source_name: source_name.to_owned(), source })?;
    xml::further_limits(text).and_then(|further| describe(&robot, &further)).map_err(faulty)
}

fn describe(robot: &urdf_rs::Robot, further: &HashMap<String, Further>) -> Result<Description, UrdfFault> {
    let none = Further::default();
    let further = |joint: &urdf_rs::Joint| further.get(&joint.name).unwrap_or(&none);
    check_names(robot)?;
    let parents = parents(robot)?;
    check_open(robot, &parents)?;
    let base = base(robot, &parents)?;
    let tip = tip(robot)?;
    let path = path(base, tip, &parents)?;
    for joint in &robot.joints {
        check_joint(joint, further(joint))?;
        if moves(joint) && !path.iter().any(|on_path| std::ptr::eq(*on_path, joint)) {
            return Err(UrdfFault::MovesOffChain {
                joint: joint.name.clone(),
                base: base.to_owned(),
                tip: tip.to_owned(),
            });
        }
    }
    let length = median_offset(&path);
    if length > LONGEST_LINK {
        let (base, tip) = (base.to_owned(), tip.to_owned());
        return Err(UrdfFault::Millimetres { base, tip, offset: length, most: LONGEST_LINK });
    }
    let joints: Vec<Joint> =
        path.iter().filter(|joint| moves(joint)).map(|joint| limits(joint, further(joint))).collect();
    if joints.is_empty() {
        return Err(UrdfFault::NoMovingJoint { base: base.to_owned(), tip: tip.to_owned() });
    }
    let base = base.to_owned();
    Ok(Description { base, segments: path.iter().map(|joint| segment(joint)).collect(), joints })
}

fn check_names(robot: &urdf_rs::Robot) -> Result<(), UrdfFault> {
    let links = robot.links.iter().map(|link| ("link", &link.name));
    let joints = robot.joints.iter().map(|joint| ("joint", &joint.name));
    let mut seen = HashMap::new();
    for (kind, name) in links.chain(joints) {
        if seen.insert((kind, name), ()).is_some() {
            return Err(UrdfFault::DuplicateName { kind, name: name.clone() });
        }
    }
    Ok(())
}

type Parents<'a> = HashMap<&'a str, &'a urdf_rs::Joint>;

/// The joint above each link.
fn parents(robot: &urdf_rs::Robot) -> Result<Parents<'_>, UrdfFault> {
    let mut parents = Parents::new();
    for joint in &robot.joints {
        for link in [&joint.parent.link, &joint.child.link] {
            if !robot.links.iter().any(|declared| declared.name == *link) {
                return Err(UrdfFault::UnknownLink { joint: joint.name.clone(), link: link.clone() });
            }
        }
        if let Some(first) = parents.insert(&joint.child.link, joint) {
            return Err(UrdfFault::TwoParents {
                link: joint.child.link.clone(),
                first: first.name.clone(),
                second: joint.name.clone(),
            });
        }
    }
    Ok(parents)
}

/// Checks that no link is its own ancestor.
fn check_open(robot: &urdf_rs::Robot, parents: &Parents<'_>) -> Result<(), UrdfFault> {
    for link in &robot.links {
        let mut above = link.name.as_str();
        // a walk with more steps than there are joints has gone round a loop
        for step in 0.. {
            match parents.get(above) {
                None => break,
                Some(_) if step >= robot.joints.len() => {
                    return Err(UrdfFault::Cycle { link: link.name.clone() });
                }
                Some(joint) => above = &joint.parent.link,
            }
        }
    }
    Ok(())
}

/// `base_link`, else the only root; a second root is a link without a parent and is refused.
fn base<'a>(robot: &'a urdf_rs::Robot, parents: &Parents<'_>) -> Result<&'a str, UrdfFault> {
    let names = robot.links.iter().map(|link| link.name.as_str());
    let roots: Vec<&str> = names.clone().filter(|name| !parents.contains_key(name)).collect();
    match roots[..] {
        [root] => Ok(names.into_iter().find(|name| *name == "base_link").unwrap_or(root)),
        _ => Err(UrdfFault::Roots { roots: roots.into_iter().map(str::to_owned).collect() }),
    }
}

/// `tool0`, else the only link without a child.
fn tip(robot: &urdf_rs::Robot) -> Result<&str, UrdfFault> {
    if let Some(tool0) = robot.links.iter().find(|link| link.name == "tool0") {
        return Ok(&tool0.name);
    }
    let has_child = |link: &str| robot.joints.iter().any(|joint| joint.parent.link == link);
    let tips: Vec<&str> =
        robot.links.iter().map(|link| link.name.as_str()).filter(|name| !has_child(name)).collect();
    match tips[..] {
        [tip] => Ok(tip),
        _ => Err(UrdfFault::Tips { tips: tips.into_iter().map(str::to_owned).collect() }),
    }
}

/// The joints from base to tip, in order.
fn path<'a>(base: &str, tip: &str, parents: &Parents<'a>) -> Result<Vec<&'a urdf_rs::Joint>, UrdfFault> {
    let mut path = Vec::new();
    let mut link = tip;
    while link != base {
        let Some(joint) = parents.get(link) else {
            return Err(UrdfFault::TipNotOnBase { tip: tip.to_owned() });
        };
        path.push(*joint);
        link = &joint.parent.link;
    }
    path.reverse();
    Ok(path)
}

/// The median of the origins' lengths that are not 0, m. The sum is no measure, because a calibration may move two
/// parallel joints far apart along their axes and back again.
fn median_offset(path: &[&urdf_rs::Joint]) -> f64 {
    let lengths = path.iter().map(|joint| Vector3::from(*joint.origin.xyz).norm());
    let mut lengths: Vec<f64> = lengths.filter(|length| *length > 0.0).collect();
    lengths.sort_by(f64::total_cmp);
    lengths.get(lengths.len() / 2).copied().unwrap_or(0.0)
}

fn moves(joint: &urdf_rs::Joint) -> bool {
    !matches!(joint.joint_type, JointType::Fixed)
}

fn check_joint(joint: &urdf_rs::Joint, further: &Further) -> Result<(), UrdfFault> {
    let name = || joint.name.clone();
    let finite = |field: &'static str, values: &[f64]| match values.iter().find(|value| !value.is_finite()) {
        Some(&value) => Err(UrdfFault::NotFinite { joint: name(), field, value }),
        None => Ok(()),
    };
    finite("origin xyz [m]", &*joint.origin.xyz)?;
    finite("origin rpy [rad]", &*joint.origin.rpy)?;
    // units of range, velocity, acceleration and jerk
    let [unit, velocity_unit, acceleration_unit, jerk_unit] = match joint.joint_type {
        JointType::Fixed => return Ok(()),
        JointType::Prismatic => ["m", "m/s", "m/s²", "m/s³"],
        JointType::Revolute | JointType::Continuous => ["rad", "rad/s", "rad/s²", "rad/s³"],
        ref other => {
            return Err(UrdfFault::JointType {
                joint: name(),
                joint_type: format!("{other:?}").to_lowercase(),
            });
        }
    };
    if let Some(mimic) = &joint.mimic {
        return Err(UrdfFault::Mimic { joint: name(), leader: mimic.joint.clone() });
    }
    finite("axis", &*joint.axis.xyz)?;
    if Vector3::from(*joint.axis.xyz).norm() < 1e-6 {
        return Err(UrdfFault::Axis { joint: name(), axis: *joint.axis.xyz });
    }
    let limit = &joint.limit;
    finite("limit lower", &[limit.lower])?;
    finite("limit upper", &[limit.upper])?;
    finite("limit velocity", &[limit.velocity])?;
    if joint.joint_type != JointType::Continuous && limit.lower >= limit.upper {
        return Err(UrdfFault::Range { joint: name(), lower: limit.lower, upper: limit.upper, unit });
    }
    if limit.velocity <= 0.0 {
        return Err(UrdfFault::Velocity { joint: name(), velocity: limit.velocity, unit: velocity_unit });
    }
    // no real arm has limits beyond these; a limit beyond them is most often in another unit
    let (farthest, slowest) =
        if joint.joint_type == JointType::Prismatic { (100.0, 1e-6) } else { (30.0, 1e-4) };
    // a continuous joint has no range
    let ends = (joint.joint_type != JointType::Continuous).then_some((limit.lower, limit.upper));
    for (field, value, unit, least, most) in [
        ("lower", ends.map(|(lower, _)| lower), unit, -farthest, farthest),
        ("upper", ends.map(|(_, upper)| upper), unit, -farthest, farthest),
        ("velocity", Some(limit.velocity), velocity_unit, slowest, 100.0),
        ("acceleration", further.acceleration, acceleration_unit, slowest, 1e6),
        ("jerk", further.jerk, jerk_unit, slowest, 1e9),
    ] {
        if let Some(value) = value.filter(|value| !(least..=most).contains(value)) {
            return Err(UrdfFault::Limit { joint: name(), field, value, unit, least, most });
        }
    }
    Ok(())
}

/// A moving joint's limits, in mm and rad.
fn limits(joint: &urdf_rs::Joint, further: &Further) -> Joint {
    let (kind, per_urdf_unit) = match joint.joint_type {
        JointType::Prismatic => (JointKind::Prismatic, MM_PER_M),
        _ => (JointKind::Revolute, 1.0),
    };
    let (lower, upper) = match joint.joint_type {
        JointType::Continuous => (f64::NEG_INFINITY, f64::INFINITY),
        _ => (joint.limit.lower * per_urdf_unit, joint.limit.upper * per_urdf_unit),
    };
    let velocity_limit = joint.limit.velocity * per_urdf_unit;
    let stated = |limit: Option<f64>| limit.map(|limit| limit * per_urdf_unit);
    let acceleration_limit =
        stated(further.acceleration).unwrap_or_else(|| assumed_acceleration(velocity_limit));
    let jerk_limit = stated(further.jerk).unwrap_or_else(|| assumed_jerk(acceleration_limit));
    Joint { name: joint.name.clone(), kind, lower, upper, velocity_limit, acceleration_limit, jerk_limit }
}

/// The joint's constants as `k` reads them.
fn segment(joint: &urdf_rs::Joint) -> Segment {
    let joint = k::Joint::<f64>::from(joint);
    let origin = joint.origin();
    let rotation = Matrix3::from_column_slice(origin.rotation.to_rotation_matrix().into_inner().as_slice());
    let unit = |axis: &[f64]| Unit::new_normalize(Vector3::from_column_slice(axis));
    Segment {
        rotation: Rotation3::from_matrix_unchecked(rotation),
        translation_mm: Vector3::from_column_slice(origin.translation.vector.as_slice()) * MM_PER_M,
        motion: match joint.joint_type {
            k::JointType::Fixed => None,
            k::JointType::Linear { ref axis } => Some((JointKind::Prismatic, unit(axis.as_slice()))),
            k::JointType::Rotational { ref axis } => Some((JointKind::Revolute, unit(axis.as_slice()))),
        },
    }
}

#[cfg(test)]
mod tests;
