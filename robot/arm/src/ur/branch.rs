//! Names of the eight branches of a UR's inverse kinematics.
//!
//! A branch has the number 4·shoulder + 2·wrist + elbow, as in [`super::UrSolutions`]. Seen from the base toward the wrist,
//! the upper arm is on the left or right; the elbow is above or below the line from the shoulder to the wrist; and q₅ is
//! positive or negative. Which of the two elbows is up depends on the shoulder.

/// A set of branches.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Branches(u8);

/// The words of the names: for each of shoulder, elbow and wrist the word for bit 0 and the word for bit 1.
const WORDS: [[&str; 2]; 3] =
    [["shoulder-left", "shoulder-right"], ["elbow-up", "elbow-down"], ["wrist-positive", "wrist-negative"]];

/// Index of the branch's word in each of [`WORDS`].
fn traits(branch: u8) -> [usize; 3] {
    let [shoulder, wrist, elbow] = [branch >> 2 & 1, branch >> 1 & 1, branch & 1].map(usize::from);
    // elbow 0 is down for the left shoulder and up for the right one
    [shoulder, 1 - (shoulder ^ elbow), wrist]
}

impl Branches {
    /// All eight branches.
    pub const ALL: Self = Self(u8::MAX);

    /// The set of one branch, by its number from 0 to 7.
    pub fn one(branch: u8) -> Option<Self> {
        (branch < 8).then(|| Self(1 << branch))
    }

    /// The branches that match words such as `elbow-up` or `shoulder-left/elbow-up/wrist-positive`; `None` where a word is
    /// unknown or two words contradict each other.
    pub fn named(words: &str) -> Option<Self> {
        let mut left = Self::ALL;
        for word in words.split('/').map(str::trim) {
            let place = |pair: &[&str; 2]| pair.iter().position(|known| *known == word);
            let (which, value) = WORDS.iter().enumerate().find_map(|(n, pair)| Some((n, place(pair)?)))?;
            left.0 &= (0..8).filter(|b| traits(*b)[which] == value).map(|b| 1 << b).sum::<u8>();
        }
        (left.0 != 0).then_some(left)
    }

    /// Whether a branch is in the set.
    pub fn contains(self, branch: u8) -> bool {
        self.0 >> branch & 1 == 1
    }
}

/// Prints the words that the set's branches have in common. [`Branches::named`] reads them back if the set was made by it.
impl std::fmt::Display for Branches {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let all: Vec<[usize; 3]> = (0..8).filter(|b| self.contains(*b)).map(traits).collect();
        let word = |n: usize| (0..2).find(|v| all.iter().all(|traits| traits[n] == *v)).map(|v| WORDS[n][v]);
        f.write_str(&(0..3).filter_map(word).collect::<Vec<_>>().join("/"))
    }
}

/// A branch's whole name, e.g. `shoulder-left/elbow-up/wrist-positive`.
pub fn branch_name(branch: u8) -> String {
    let words: Vec<&str> = WORDS.iter().zip(traits(branch)).map(|(pair, which)| pair[which]).collect();
    words.join("/")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Arm;
    use crate::ur::UrModel;
    use bonemill_geometry::{Base, Rigid, Tool};
    use nalgebra::{Rotation3, Vector3};

    #[test]
    fn names_say_where_the_links_are() {
        for model in UrModel::ALL {
            let arm = Arm::ur(model, None).unwrap();
            let reach = model.reach_mm();
            for (n, turn) in [0.0, 1.0, 2.5, 4.0].into_iter().enumerate() {
                let place = Rotation3::from_axis_angle(&Vector3::z_axis(), turn)
                    * Vector3::new(0.5 * reach, 0.1 * reach, 0.1 * n as f64 * reach);
                let down = Rotation3::from_euler_angles(3.0, 0.2, turn);
                let pose: Rigid<Base, Tool> = Rigid::new(down, place);
                let found = arm.inverse(&pose).unwrap();
                assert_eq!(found.q.len(), 8);
                for (q, branch) in found.q.iter().zip(&found.branch) {
                    let p: Vec<Vector3<f64>> =
                        arm.joint_places(q).unwrap().iter().map(|place| place.coords).collect();
                    let (shoulder, elbow, wrist, offset) = (p[1], p[2], p[3], p[4]);
                    // the arm moves in a plane parallel to the base's axis; the wrist lies beside it
                    let left = Vector3::z().cross(&Vector3::new(offset.x, offset.y, 0.0));
                    let is_left = (wrist - offset).dot(&left) > 0.0;
                    let on_line = shoulder + (wrist - shoulder) * 0.5;
                    let is_up = elbow.z > on_line.z;
                    let name = branch_name(*branch);
                    assert_eq!(name.contains("shoulder-left"), is_left, "{model:?} {name}");
                    assert_eq!(name.contains("elbow-up"), is_up, "{model:?} {name}");
                    assert_eq!(name.contains("wrist-positive"), q[4] >= 0.0, "{model:?} {name}");
                }
            }
        }
    }

    #[test]
    fn words_leave_the_branches_that_have_them() {
        for branch in 0..8 {
            assert_eq!(Branches::named(&branch_name(branch)), Branches::one(branch));
        }
        let up = Branches::named("elbow-up").unwrap();
        assert_eq!((0..8).filter(|b| up.contains(*b)).count(), 4);
        let two = Branches::named("wrist-negative / shoulder-right").unwrap();
        assert_eq!((0..8).filter(|b| two.contains(*b)).count(), 2);
        assert_eq!(
            (up.to_string(), two.to_string()),
            ("elbow-up".into(), "shoulder-right/wrist-negative".into())
        );
        for wrong in ["", "elbow", "elbow-up/elbow-down", "elbow-up/", "0"] {
            assert_eq!(Branches::named(wrong), None, "{wrong}");
        }
        assert_eq!(Branches::one(8), None);
    }
}
