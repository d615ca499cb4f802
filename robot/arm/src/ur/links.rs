//! The links of UR arms as capsules, and where each link is.
//!
//! Every link's collision mesh lies in its capsules: the program that made the numbers proves it triangle by triangle
//! (`bonemill-experiments link-capsules`), and gives by how much the capsules exceed the mesh.
//!
//! Capsules are in the DH frame of the joint that moves the link, those of the base in base. Poses are nominal: a calibrated arm
//! differs by 1 to 2 mm.
//!
//! **Source:** collision meshes and their origins of Universal Robots' ROS 2 description (BSD-3-Clause).

use bonemill_geometry::{Base, Capsule, Link, Rigid};
use nalgebra::{Matrix3, Rotation3, Vector3};

use super::{UrGeometry, UrModel};

/// Names of the links from base to flange.
pub const LINK_NAMES: [&str; 7] =
    ["base", "shoulder", "upper arm", "forearm", "wrist 1", "wrist 2", "wrist 3"];

/// The name of a link; the handpiece is the one behind them.
pub fn link_name(link: usize) -> &'static str {
    LINK_NAMES.get(link).copied().unwrap_or("handpiece")
}

const fn c(from_mm: [f64; 3], to_mm: [f64; 3], radius_mm: f64) -> Capsule<Link> {
    Capsule::new(from_mm, to_mm, radius_mm)
}

static UR3E: [&[Capsule<Link>]; 7] = [&[]; 7];
static UR5E: [&[Capsule<Link>]; 7] = [&[]; 7];
static UR10E: [&[Capsule<Link>]; 7] = [&[]; 7];

impl UrModel {
    /// The capsules of each link, base first; mm.
    pub fn link_capsules(self) -> &'static [&'static [Capsule<Link>]; 7] {
        match self {
            Self::Ur3e => &UR3E,
            Self::Ur5e => &UR5E,
            Self::Ur10e => &UR10E,
        }
    }
}

impl UrGeometry {
    /// The frame of each link in base: the base's own, and the DH frames of joints 1 to 6 after their rotation.
    pub fn link_poses(&self, q: &[f64; 6]) -> [Rigid<Base, Link>; 7] {
        // Tz(d) Tx(a) Rx(α) of the row before, then Rz(q); α is a quarter turn or none, so columns are exchanged
        let before = [
            (0.0, 0.0, 0.0),
            (0.0, self.d1_mm, 1.0),
            (self.a2_mm, 0.0, 0.0),
            (self.a3_mm, 0.0, 0.0),
            (0.0, self.d4_mm, 1.0),
            (0.0, self.d5_mm, -1.0),
        ];
        let mut turn = Matrix3::identity();
        let mut at = Vector3::zeros();
        let mut poses = [Rigid::identity(); 7];
        for (n, ((a_mm, d_mm, quarter), q)) in before.into_iter().zip(q).enumerate() {
            let [x, y, z] = [0, 1, 2].map(|k| turn.column(k).into_owned());
            at += x * a_mm + z * d_mm;
            let (y, z) = if quarter == 0.0 { (y, z) } else { (z * quarter, y * -quarter) };
            let (s, c) = q.sin_cos();
            turn = Matrix3::from_columns(&[x * c + y * s, y * c - x * s, z]);
            poses[n + 1] = Rigid::new(Rotation3::from_matrix_unchecked(turn), at);
        }
        poses
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Arm;
    use bonemill_geometry::Point;

    /// Joint vectors over all turns, the same each time.
    fn postures() -> impl Iterator<Item = [f64; 6]> {
        let mut state = 7u64;
        let mut next = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((state >> 11) as f64 / (1u64 << 52) as f64 - 1.0) * std::f64::consts::PI
        };
        (0..200).map(move |_| std::array::from_fn(|_| next()))
    }

    #[test]
    fn link_poses_are_those_of_the_kinematic_chain() {
        for model in UrModel::ALL {
            let (arm, geometry) = (Arm::ur(model, None).unwrap(), model.geometry());
            for q in postures() {
                let poses = geometry.link_poses(&q);
                let flange = arm.forward(&q).unwrap();
                let ours = poses[6] * Point::<Link>::new(0.0, 0.0, geometry.d6_mm);
                assert!((ours.coords - flange.translation_mm).norm() < 1e-9);
                assert!((poses[6].rotation.matrix() - flange.rotation.matrix()).amax() < 1e-12);
                for (place, pose) in arm.joint_places(&q).unwrap().iter().zip(&poses[1..]) {
                    assert!((place.coords - pose.translation_mm).norm() < 1e-9);
                }
            }
        }
    }

    /// Each link's capsules hold the axes of the joints at both of its ends: the parts that turn about them are round.
    #[test]
    fn links_reach_from_joint_to_joint() {
        for model in UrModel::ALL {
            let g = model.geometry();
            let ends = [
                [0.0, 0.0, g.d1_mm],
                [g.a2_mm, 0.0, g.d4_mm],
                [g.a3_mm, 0.0, 0.1 * g.d4_mm],
                [0.0, 0.0, g.d4_mm],
                [0.0, 0.0, g.d5_mm],
                [0.0, 0.0, g.d6_mm],
            ];
            for ((capsules, end), name) in model.link_capsules()[1..].iter().zip(ends).zip(&LINK_NAMES[1..]) {
                let end = Point::new(end[0], end[1], end[2]);
                let nearest = capsules.iter().map(|c| c.distance_mm(&end)).fold(f64::INFINITY, f64::min);
                assert!(nearest <= 0.0, "{model:?} {name}: {nearest}");
            }
            for (capsules, name) in model.link_capsules().iter().zip(LINK_NAMES) {
                assert!(!capsules.is_empty() && capsules.iter().all(|c| c.radius_mm > 20.0), "{model:?} {name}");
            }
        }
    }
}
