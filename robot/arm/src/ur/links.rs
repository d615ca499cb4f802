//! The links of UR arms as capsules, and where each link is.
//!
//! Every link's collision mesh lies in its capsules: the program that made the numbers proves it triangle by triangle
//! (`bonemill-experiments link-capsules`), and gives by how much the capsules exceed the mesh.
//!
//! Capsules are in the DH frame of the joint that moves the link, those of the base in base. Poses are nominal: a calibrated arm
//! differs by 1 to 2 mm.
//!
//! **Source:** measured from the collision meshes and their origins of Universal Robots' ROS 2 description, version 2.4.5
//! (BSD-3-Clause; the meshes of UR20 and UR30 under Universal Robots' Terms and Conditions for Use of Graphical Documentation).

use bonemill_geometry::{Base, Capsule, Link, Rigid};
use nalgebra::{Matrix3, Rotation3, Vector3};

use super::{UrGeometry, UrModel};

/// Names of the links from base to flange.
pub const LINK_NAMES: [&str; 7] =
    ["base", "shoulder", "upper arm", "forearm", "wrist 1", "wrist 2", "wrist 3"];

/// Links of an arm with the handpiece behind them.
pub const LINKS_AND_HANDPIECE: usize = LINK_NAMES.len() + 1;

/// Pairs of links that are no neighbours and yet are not told apart, because their capsules exceed them by more than the room
/// between them: base and upper arm, forearm and wrist 2, wrist 1 and wrist 3. Nor are wrist 2 and the handpiece: how the handpiece
/// is held between shank and flange is not known.
const NOT_TOLD_APART: [(usize, usize); 4] = [(0, 2), (3, 5), (4, 6), (5, 7)];

/// The pairs of links, and of links and handpiece, that are held apart: all but neighbours and a few whose shapes are too
/// coarse to tell.
pub fn pairs_held_apart() -> impl Iterator<Item = (usize, usize)> {
    let all = (0..LINKS_AND_HANDPIECE).flat_map(|i| (i + 2..LINKS_AND_HANDPIECE).map(move |k| (i, k)));
    all.filter(|pair| !NOT_TOLD_APART.contains(pair))
}

/// The name of a link; the handpiece is the one behind them.
pub fn link_name(link: usize) -> &'static str {
    LINK_NAMES.get(link).copied().unwrap_or("handpiece")
}

const fn c(from_mm: [f64; 3], to_mm: [f64; 3], radius_mm: f64) -> Capsule<Link> {
    Capsule::new(from_mm, to_mm, radius_mm)
}

/// They exceed the meshes by at most 43.2, 23.0, 35.3, 21.8, 19.1, 21.3, 18.1 mm, base to wrist 3.
#[rustfmt::skip]
static UR3E: [&[Capsule<Link>]; 7] = [
    &[
        c([0.0, 0.0, 26.3], [0.0, 0.0, 42.1], 69.4),
    ],
    &[
        c([0.0, -2.2, 136.6], [-0.5, -6.6, 157.9], 63.0),
        c([0.8, -25.5, 155.7], [-0.2, -28.5, 150.4], 57.2),
    ],
    &[
        c([31.4, -20.2, 88.4], [-250.1, -13.7, 93.9], 43.6),
        c([7.2, -15.2, 140.8], [-250.2, -7.0, 141.2], 44.9),
        c([24.8, 22.2, 91.0], [-251.3, 12.4, 93.6], 42.6),
        c([25.8, 17.1, 142.5], [-251.2, 7.0, 143.9], 42.8),
    ],
    &[
        c([-19.6, 0.6, 32.6], [-221.3, -4.6, 7.8], 36.2),
        c([5.6, -7.9, 51.2], [-221.8, -9.6, 51.5], 37.8),
        c([-20.5, 3.9, 29.1], [-220.2, 11.2, 7.5], 32.5),
        c([6.0, 9.0, 53.6], [-228.0, 9.9, 52.4], 35.2),
    ],
    &[
        c([-0.2, -2.4, 99.8], [-0.4, 14.2, 129.1], 41.3),
        c([0.0, -26.3, 130.1], [0.2, -23.7, 124.1], 40.1),
    ],
    &[
        c([-0.2, 3.7, 69.5], [0.0, -15.6, 83.8], 40.5),
        c([-1.7, 13.4, 81.3], [-1.1, 27.8, 84.5], 41.1),
    ],
    &[
        c([0.0, 0.1, 71.0], [0.2, -1.5, 70.6], 37.8),
    ],
];

/// They exceed the meshes by at most 53.1, 30.8, 47.2, 42.8, 20.7, 21.5, 24.3 mm, base to wrist 3.
#[rustfmt::skip]
static UR5E: [&[Capsule<Link>]; 7] = [
    &[
        c([0.0, 0.0, 27.5], [0.0, 0.0, 43.4], 80.5),
    ],
    &[
        c([0.0, -2.2, 143.8], [0.4, -9.8, 172.4], 75.9),
        c([-0.1, -18.2, 170.4], [-0.2, -28.9, 161.7], 74.4),
    ],
    &[
        c([15.1, -25.2, 107.1], [-445.0, -34.0, 98.9], 56.4),
        c([19.2, -20.2, 163.5], [-439.0, -19.4, 164.3], 59.0),
        c([30.5, 26.2, 112.2], [-463.3, 26.2, 95.8], 59.0),
        c([6.6, 19.9, 164.4], [-437.0, 20.0, 163.4], 56.5),
    ],
    &[
        c([-1.7, -9.8, 2.6], [-399.8, -8.8, -14.2], 47.2),
        c([27.4, -28.8, 39.8], [-405.1, -14.2, 31.2], 45.8),
        c([-12.0, 9.4, -1.4], [-394.1, 11.1, -11.8], 44.1),
        c([41.5, 29.8, 35.4], [-410.2, 12.7, 29.1], 46.7),
    ],
    &[
        c([0.0, 0.2, 94.9], [-0.8, 15.6, 128.9], 51.6),
        c([0.0, -28.6, 132.5], [0.5, -20.4, 114.3], 45.4),
    ],
    &[
        c([0.1, 2.8, 80.5], [-0.3, -19.9, 97.2], 48.1),
        c([0.1, 21.6, 98.3], [0.0, 26.8, 98.4], 46.9),
    ],
    &[
        c([0.0, 0.7, 72.2], [0.4, -1.9, 72.0], 42.2),
    ],
];

/// They exceed the meshes by at most 75.8, 39.7, 47.1, 58.5, 24.7, 29.3, 30.8 mm, base to wrist 3.
#[rustfmt::skip]
static UR10E: [&[Capsule<Link>]; 7] = [
    &[
        c([0.0, 0.0, 21.8], [0.0, 0.0, 36.9], 97.6),
    ],
    &[
        c([1.1, -1.8, 157.2], [0.1, -10.4, 199.3], 97.7),
        c([0.5, -35.6, 185.4], [-0.1, -38.0, 179.4], 95.7),
    ],
    &[
        c([32.9, -40.5, 138.5], [-617.0, -11.5, 130.6], 70.2),
        c([29.8, -27.4, 217.2], [-616.6, -8.0, 195.2], 71.7),
        c([34.3, 36.2, 137.2], [-626.6, 13.7, 137.0], 72.6),
        c([23.4, 36.6, 216.4], [-612.7, 9.7, 201.5], 63.9),
    ],
    &[
        c([-45.6, -16.0, 22.1], [-569.1, -6.6, 15.1], 65.0),
        c([43.4, -26.8, 70.4], [-573.2, -24.2, 68.9], 61.2),
        c([-51.8, 14.1, 27.9], [-578.3, 7.6, 17.9], 65.5),
        c([32.6, 29.6, 69.0], [-580.2, 19.5, 73.2], 63.4),
    ],
    &[
        c([-0.1, -0.1, 138.9], [0.1, 14.0, 168.9], 57.1),
        c([1.7, -18.7, 154.8], [-0.1, -32.5, 174.1], 57.0),
    ],
    &[
        c([-0.1, 5.9, 93.6], [0.1, -15.5, 113.5], 56.2),
        c([-0.2, 32.6, 119.3], [-0.1, 27.1, 118.4], 56.9),
    ],
    &[
        c([0.0, -2.6, 86.9], [0.0, 0.6, 87.5], 49.8),
    ],
];

/// They exceed the meshes by at most 75.8, 37.6, 48.2, 36.0, 24.7, 29.3, 30.8 mm, base to wrist 3.
#[rustfmt::skip]
static UR16E: [&[Capsule<Link>]; 7] = [
    &[
        c([0.0, 0.0, 21.8], [0.0, 0.0, 36.9], 97.6),
    ],
    &[
        c([-0.1, -0.9, 162.0], [0.0, -10.7, 196.2], 99.6),
        c([0.0, -23.1, 189.8], [0.0, -34.4, 180.4], 97.3),
    ],
    &[
        c([36.4, -40.4, 134.3], [-492.0, -17.4, 133.6], 68.6),
        c([30.0, -36.8, 217.1], [-484.0, -12.0, 197.7], 71.7),
        c([37.8, 35.0, 130.9], [-486.2, 19.7, 138.8], 67.4),
        c([34.2, 37.5, 214.4], [-490.1, 5.7, 202.4], 73.8),
    ],
    &[
        c([-34.7, -13.9, 28.1], [-364.2, -10.3, 21.5], 52.7),
        c([23.3, -19.6, 72.0], [-364.0, -12.9, 70.2], 57.3),
        c([-25.2, 17.2, 18.2], [-364.3, 11.7, 18.5], 50.1),
        c([13.5, 27.1, 67.4], [-370.9, 23.5, 67.3], 55.3),
    ],
    &[
        c([-0.1, -0.1, 138.9], [0.1, 14.0, 168.9], 57.1),
        c([1.7, -18.7, 154.8], [-0.1, -32.5, 174.1], 57.0),
    ],
    &[
        c([-0.1, 5.9, 93.6], [0.1, -15.5, 113.5], 56.2),
        c([-0.2, 32.6, 119.3], [-0.1, 27.1, 118.4], 56.9),
    ],
    &[
        c([0.0, -2.6, 86.9], [0.0, 0.6, 87.5], 49.8),
    ],
];

/// They exceed the meshes by at most 102.5, 44.9, 82.0, 69.4, 32.4, 32.7, 27.1 mm, base to wrist 3.
#[rustfmt::skip]
static UR20: [&[Capsule<Link>]; 7] = [
    &[
        c([0.0, 0.0, 22.4], [-0.1, 0.0, 22.6], 124.6),
    ],
    &[
        c([-0.7, -2.7, 184.9], [0.0, -23.5, 221.7], 121.1),
        c([0.0, -58.8, 236.3], [0.6, -38.3, 216.1], 117.8),
    ],
    &[
        c([38.7, -42.3, 194.5], [-882.5, -21.7, 205.7], 97.2),
        c([18.9, -20.4, 276.4], [-872.4, 0.9, 255.6], 78.1),
        c([34.6, 49.4, 186.2], [-880.6, 25.9, 197.8], 88.8),
        c([29.8, 19.3, 276.1], [-868.4, -2.9, 258.1], 81.1),
    ],
    &[
        c([-4.2, -25.7, 14.5], [-709.0, 11.2, 60.8], 60.6),
        c([31.3, -32.9, 95.2], [-720.9, 8.7, 61.1], 79.1),
        c([31.9, 17.2, 22.9], [-743.2, -8.9, 57.6], 70.2),
        c([39.5, 47.2, 96.2], [-726.5, -1.5, 88.5], 73.8),
    ],
    &[
        c([0.4, -6.2, 157.1], [-0.1, -8.6, 190.3], 65.9),
        c([0.3, -46.4, 188.5], [0.0, -53.3, 200.9], 60.0),
    ],
    &[
        c([-0.2, 5.8, 119.0], [-0.3, 6.1, 146.2], 66.8),
        c([0.1, 42.0, 154.7], [0.0, 43.5, 158.6], 65.5),
    ],
    &[
        c([0.0, 0.0, 118.7], [0.0, 0.0, 118.2], 60.6),
    ],
];

/// They exceed the meshes by at most 102.5, 44.9, 85.3, 65.5, 32.4, 32.7, 27.1 mm, base to wrist 3.
#[rustfmt::skip]
static UR30: [&[Capsule<Link>]; 7] = [
    &[
        c([0.0, 0.0, 22.4], [-0.1, 0.0, 22.6], 124.6),
    ],
    &[
        c([-0.7, -2.7, 184.9], [0.0, -23.5, 221.7], 121.1),
        c([0.0, -58.8, 236.3], [0.6, -38.3, 216.1], 117.8),
    ],
    &[
        c([50.4, -44.3, 192.5], [-649.3, -9.8, 187.8], 87.2),
        c([27.8, -4.7, 268.9], [-632.5, -1.1, 248.9], 88.4),
        c([39.3, 38.9, 186.7], [-651.0, 8.5, 190.9], 86.0),
        c([46.4, 35.6, 275.4], [-640.0, 8.3, 257.5], 67.2),
    ],
    &[
        c([11.1, -7.7, 32.0], [-498.4, 3.0, 62.5], 75.6),
        c([31.0, -33.3, 102.5], [-504.4, 12.1, 73.3], 71.6),
        c([9.4, 15.8, 27.5], [-497.0, -5.1, 62.0], 69.0),
        c([32.8, 38.3, 102.6], [-514.3, -11.9, 77.3], 72.8),
    ],
    &[
        c([0.4, -6.2, 157.1], [-0.1, -8.6, 190.3], 65.9),
        c([0.3, -46.4, 188.5], [0.0, -53.3, 200.9], 60.0),
    ],
    &[
        c([-0.2, 5.8, 119.0], [-0.3, 6.1, 146.2], 66.8),
        c([0.1, 42.0, 154.7], [0.0, 43.5, 158.6], 65.5),
    ],
    &[
        c([0.0, 0.0, 118.7], [0.0, 0.0, 118.2], 60.6),
    ],
];

impl UrModel {
    /// The capsules of each link, base first; mm.
    pub fn link_capsules(self) -> &'static [&'static [Capsule<Link>]; 7] {
        match self {
            Self::Ur3e => &UR3E,
            Self::Ur5e => &UR5E,
            Self::Ur10e => &UR10E,
            Self::Ur16e => &UR16E,
            Self::Ur20 => &UR20,
            Self::Ur30 => &UR30,
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
                assert!(
                    !capsules.is_empty() && capsules.iter().all(|c| c.radius_mm > 20.0),
                    "{model:?} {name}"
                );
            }
        }
    }
}
