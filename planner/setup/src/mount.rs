//! The tool on the arm's flange: whether the case's `flange_from_burr` can be a handpiece that the arm holds.
//!
//! The burr's z axis leads from the burr along the shank. It must lead back to the flange's side: otherwise the arm is in front of the burr, where the bone
//! is. The flange of a UR has its z axis out of the arm; of another URDF's last link nothing is known, and it may be the burr itself.

use bonemill_arm::ur::{UrModel, has_ur_joints};
use bonemill_arm::{Arm, ToolMount};
use bonemill_case::{Case, ToolSpec};
use bonemill_geometry::Rigid;
use nalgebra::{Rotation3, Vector3};
use thiserror::Error;

/// Nearer than this to the flange no handpiece holds a burr, mm. Assumed.
const NEAR_MM: f64 = 20.0;
/// Radius of a UR's wrist behind its flange, mm: that of the largest, UR20 and UR30, as of their capsule.
const WRIST_RADIUS_MM: f64 = 60.6;
/// What a handpiece straight on the flange has.
const EXAMPLE: &str = "for a handpiece straight on the flange with the burr 180 mm before it: translation_mm = [0, 0, 180], \
                       rpy_rad = [3.141592653589793, 0, 0]";

/// Why no arm can hold the tool so.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum MountFault {
    /// The arm is in front of the burr.
    #[error(
        "the shank points away from the flange, which lies {in_front_mm:.1} mm in front of the burr, where the bone is: the burr's z axis leads \
         from the burr to the handpiece, and with rpy_rad must point back to the flange; {EXAMPLE}"
    )]
    PointsAway {
        /// The flange's height over the burr's centre, against the shank, mm.
        in_front_mm: f64,
    },
    /// The burr is where the arm is.
    #[error("the tool lies within the arm, {}{}; {EXAMPLE}",
        if *before_mm < 0.0 { format!("{:.2} mm behind the flange's face", -before_mm) }
        else { format!("its centre only {before_mm:.2} mm before the flange's face") },
        metres(*distance_mm))]
    WithinArm {
        /// Height of the tool's origin over the flange's face, mm.
        before_mm: f64,
        /// From the flange to the tool's origin, mm.
        distance_mm: f64,
    },
}

/// A hint at another unit.
fn metres(distance_mm: f64) -> String {
    if distance_mm > 0.0 && distance_mm < 1.0 {
        format!("; it looks like metres, which would be {:.0} mm from the flange here", 1e3 * distance_mm)
    } else {
        String::new()
    }
}

/// The tool's place on the flange that the case gives.
pub fn mount(case: &Case) -> Option<ToolMount> {
    let (translation_mm, [roll, pitch, yaw]) = case.robot.flange_from_burr?;
    let turn = Rotation3::from_euler_angles(roll, pitch, yaw);
    Some(ToolMount { flange_from_burr: Rigid::new(turn, translation_mm.into()) })
}

/// Refuses a tool that the arm cannot hold.
///
/// # Errors
/// [`MountFault`].
pub fn judge(case: &Case, arm: &Arm, mount: &ToolMount) -> Result<(), MountFault> {
    let flange_from_burr = &mount.flange_from_burr;
    let at_mm = flange_from_burr.translation_mm;
    let distance_mm = at_mm.norm();
    let radius_mm = if case.tool == ToolSpec::Burr { case.burr.radius_mm } else { 0.0 };
    let is_named = UrModel::by_name(&case.robot.model).is_some();
    let has_flange = is_named || (has_ur_joints(arm) && distance_mm > 0.0);
    if has_flange && at_mm.z < radius_mm.max(1.0) && at_mm.xy().norm() < WRIST_RADIUS_MM {
        return Err(MountFault::WithinArm { before_mm: at_mm.z, distance_mm });
    }
    let in_front_mm = at_mm.dot(&(flange_from_burr.rotation * Vector3::z()));
    if (has_flange || distance_mm >= NEAR_MM) && in_front_mm > radius_mm.max(1.0) {
        return Err(MountFault::PointsAway { in_front_mm });
    }
    Ok(())
}

/// A tool so near to the flange that its place may be in another unit.
pub fn warning(case: &Case) -> Option<String> {
    let distance_mm = mount(case)?.flange_from_burr.translation_mm.norm();
    (distance_mm > 0.0 && distance_mm < NEAR_MM).then(|| {
        format!(
            "robot.flange_from_burr: the burr is only {distance_mm:.2} mm from the flange; translation_mm is in mm, and a handpiece is \
             longer than {NEAR_MM:.0} mm{}",
            metres(distance_mm)
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{FRAC_PI_2, PI};
    use std::path::Path;

    const TEXT: &str = "structure = []\n[images]\nct = \"c\"\nlabels = \"l\"\n[target]\nlabel = 1\n";

    fn case(model: &str, at_mm: [f64; 3], rpy_rad: [f64; 3]) -> Case {
        let mut case = Case::parse(TEXT, Path::new("case.toml")).unwrap();
        case.robot.model = model.into();
        case.robot.flange_from_burr = Some((at_mm, rpy_rad));
        case
    }

    fn judged(case: &Case) -> Result<(), MountFault> {
        let arm = Arm::ur(UrModel::Ur5e, None).unwrap();
        judge(case, &arm, &mount(case).unwrap())
    }

    #[test]
    fn handpieces_straight_bent_and_across_the_flange_are_taken() {
        for (at, rpy) in [
            ([0.0, 0.0, 180.0], [PI, 0.0, 0.0]),
            ([0.0, -90.0, 155.0], [2.617_993_877_991_494, 0.0, 0.0]),
            ([0.0, 0.0, 180.0], [PI, 0.5, 3.9]),
            // across the flange: the shank leads from the burr beside the arm back to before the flange
            ([80.0, 0.0, 60.0], [0.0, -FRAC_PI_2, 0.0]),
            ([0.0, 0.0, 90.0], [0.0, FRAC_PI_2, 0.0]),
        ] {
            for model in UrModel::ALL.map(UrModel::name).into_iter().chain(["own.urdf"]) {
                let case = case(model, at, rpy);
                assert_eq!(judged(&case), Ok(()), "{model} {at:?} {rpy:?}");
                assert_eq!(warning(&case), None);
            }
        }
    }

    #[test]
    fn a_shank_that_points_away_from_the_flange_is_refused() {
        for (at, rpy) in [
            ([0.0, 0.0, 180.0], [0.0; 3]),
            ([0.0, -90.0, 155.0], [0.0; 3]),
            ([80.0, 0.0, 60.0], [0.0, FRAC_PI_2, 0.0]),
            ([0.0, 0.0, 180.0], [0.0, 0.0, PI]),
        ] {
            for model in ["ur5e", "own.urdf"] {
                let found = judged(&case(model, at, rpy)).unwrap_err();
                assert!(matches!(found, MountFault::PointsAway { .. }), "{model} {at:?} {rpy:?}: {found}");
                assert!(found.to_string().contains("rpy_rad = [3.141592653589793, 0, 0]"), "{found}");
            }
        }
    }

    #[test]
    fn a_burr_within_the_arm_is_refused_with_a_hint_at_metres() {
        for rpy in [[0.0; 3], [PI, 0.0, 0.0]] {
            for at in [[0.0, 0.0, 0.18], [0.0, 0.0, 0.0], [0.0, 0.0, -180.0], [0.02, -0.09, 0.155]] {
                let found = judged(&case("ur5e", at, rpy)).unwrap_err();
                assert!(matches!(found, MountFault::WithinArm { .. }), "{at:?} {rpy:?}: {found}");
                let told = found.to_string();
                assert_eq!(
                    told.contains("looks like metres, which would be 18"),
                    at[2].abs() == 0.18 || at[0] > 0.0,
                    "{told}"
                );
            }
        }
    }

    #[test]
    fn a_burr_within_20_mm_of_the_flange_is_warned_of() {
        let near = case("ur5e", [0.0, 0.0, 19.9], [PI, 0.0, 0.0]);
        assert_eq!(judged(&near), Ok(()));
        assert!(warning(&near).unwrap().contains("only 19.90 mm from the flange"));
        assert_eq!(warning(&case("ur5e", [0.0, 0.0, 20.1], [PI, 0.0, 0.0])), None);
        // another arm may end at the burr, and then a small place corrects it
        let other = case("own.urdf", [0.0, 0.0, 0.18], [PI, 0.0, 0.0]);
        assert!(warning(&other).unwrap().contains("looks like metres, which would be 180 mm"));
        assert_eq!(warning(&case("own.urdf", [0.0; 3], [PI, 0.0, 0.0])), None);
    }
}
