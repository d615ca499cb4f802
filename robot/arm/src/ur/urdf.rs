//! Writes a UR arm as a URDF, from its DH table or from a calibration.
//!
//! Rz(qᵢ) Tz(dᵢ) Tx(aᵢ) Rx(αᵢ) is the motion of joint i followed by the origin of joint i + 1: xyz = (aᵢ, 0, dᵢ),
//! rpy = (αᵢ, 0, 0). A calibrated zero offset δθ becomes a separate fixed joint, so that no angle is converted. Link and
//! joint names are those of the ROS driver.

use std::fmt::Write;

use super::calibration::{Calibration, JointOrigin};
use super::{DhRow, UrModel};
use crate::arm::Arm;

const LINKS: [&str; 7] = [
    "base_link",
    "shoulder_link",
    "upper_arm_link",
    "forearm_link",
    "wrist_1_link",
    "wrist_2_link",
    "wrist_3_link",
];

const JOINTS: [&str; 6] = [
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
];

/// Whether an arm's joints have the names of a UR's joints, with any prefix, as in a URDF from ROS.
pub fn has_ur_joints(arm: &Arm) -> bool {
    let names = || arm.joints().iter().map(|joint| joint.name.as_str());
    names().count() == JOINTS.len() && names().zip(JOINTS).all(|(name, ours)| name.ends_with(ours))
}

/// The URDF's text.
pub(super) fn text(model: UrModel, calibration: Option<&Calibration>) -> String {
    let mut links = String::new();
    let mut joints = String::new();
    let mut link = |name: &str| {
        let _ = writeln!(links, "  <link name=\"{name}\"/>");
    };
    LINKS.iter().for_each(|name| link(name));
    for (i, (origin, zero)) in origins(model, calibration).iter().enumerate() {
        let mut parent = LINKS[i].to_owned();
        let mut origin = *origin;
        if *zero != 0.0 {
            // first the origin, then the zero offset about the joint's own axis
            let child = format!("{}_zero", LINKS[i]);
            link(&child);
            joints += &fixed(&format!("{}_origin", JOINTS[i]), &parent, &child, &origin);
            (parent, origin) = (child, JointOrigin { xyz_m: [0.0; 3], rpy_rad: [0.0, 0.0, *zero] });
        }
        let _ = writeln!(
            joints,
            "  <joint name=\"{}\" type=\"revolute\">\n    <parent link=\"{parent}\"/><child link=\"{}\"/>\n    {}\n    \
             <axis xyz=\"0 0 1\"/>\n    <limit lower=\"-6.283185307179586\" upper=\"6.283185307179586\" velocity=\"{:?}\" \
             effort=\"150\"/>\n  </joint>",
            JOINTS[i],
            LINKS[i + 1],
            origin_tag(&origin),
            model.velocity()[i],
        );
    }
    link("tool0");
    joints += &fixed("wrist_3_link-tool0", LINKS[6], "tool0", &tool(model, calibration));
    let source = if calibration.is_some() { "a calibration file" } else { "the nominal DH table" };
    format!(
        "<?xml version=\"1.0\"?>\n<!-- {} from {source}. base_link is the controller's base frame; tool0 is DH frame 6. \
         effort is not used. -->\n<robot name=\"{}\">\n{links}{joints}</robot>\n",
        model.name(),
        model.name()
    )
}

/// Origin and zero offset of every joint.
fn origins(model: UrModel, calibration: Option<&Calibration>) -> [(JointOrigin, f64); 6] {
    match calibration {
        Some(Calibration::Origins(origins)) => origins.map(|origin| (origin, 0.0)),
        _ => {
            let dh = rows(model, calibration);
            std::array::from_fn(|i| match i.checked_sub(1) {
                None => (JointOrigin::default(), dh[0].theta),
                Some(before) => (behind(&dh[before]), dh[i].theta),
            })
        }
    }
}

fn tool(model: UrModel, calibration: Option<&Calibration>) -> JointOrigin {
    match calibration {
        Some(Calibration::Origins(_)) => JointOrigin::default(),
        _ => behind(&rows(model, calibration)[5]),
    }
}

fn rows(model: UrModel, calibration: Option<&Calibration>) -> [DhRow; 6] {
    let mut dh = model.dh();
    if let Some(Calibration::Deltas { theta, a_m, d_m, alpha }) = calibration {
        for (i, row) in dh.iter_mut().enumerate() {
            row.theta += theta[i];
            row.a_m += a_m[i];
            row.d_m += d_m[i];
            row.alpha += alpha[i];
        }
    }
    dh
}

/// The transform of a DH row after its joint's rotation.
fn behind(row: &DhRow) -> JointOrigin {
    JointOrigin { xyz_m: [row.a_m, 0.0, row.d_m], rpy_rad: [row.alpha, 0.0, 0.0] }
}

fn origin_tag(origin: &JointOrigin) -> String {
    let list = |v: &[f64; 3]| format!("{:?} {:?} {:?}", v[0], v[1], v[2]);
    format!("<origin xyz=\"{}\" rpy=\"{}\"/>", list(&origin.xyz_m), list(&origin.rpy_rad))
}

fn fixed(name: &str, parent: &str, child: &str, origin: &JointOrigin) -> String {
    format!(
        "  <joint name=\"{name}\" type=\"fixed\">\n    <parent link=\"{parent}\"/><child link=\"{child}\"/>\n    {}\n  \
         </joint>\n",
        origin_tag(origin)
    )
}
