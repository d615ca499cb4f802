//! What stands around the arm: `[[obstacle]]`, and how far links keep away from it and from the patient.

use bonemill_arm::ur::UrModel;
use nalgebra::Vector3;

use super::Case;
use super::error::CaseFault;
use super::keys::room as k;
use super::keys::{Number, Unit};
use super::walker::Walk;
use super::write::{float, text, vector};

/// Distance that a UR's links keep, mm. Assumed.
const DEFAULT_CLEARANCE_MM: f64 = 10.0;

/// What stands for the patient.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HeadSource {
    /// The CT.
    Scan,
    /// Nothing.
    None,
}

/// The frame in which an obstacle is given.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ObstacleFrame {
    /// The arm's base.
    Base,
    /// The scan.
    Ct,
}

/// How the arm's links keep away from what is around them: `link_clearance_mm`, `head` and `head_beyond_mm` of `[robot]`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RoomSpec {
    /// Least distance of links, mm; `None`: links are not checked.
    pub link_clearance_mm: Option<f64>,
    /// What stands for the patient.
    pub head: HeadSource,
    /// How far tissue at the scan's edge goes on beyond it, mm.
    pub head_beyond_mm: f64,
}

/// An obstacle's shape; coordinates in its frame, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ObstacleShape {
    /// Along the frame's axes.
    Box {
        /// Lower corner.
        min_mm: Vector3<f64>,
        /// Upper corner.
        max_mm: Vector3<f64>,
    },
    /// A ball.
    Ball {
        /// Centre.
        center_mm: Vector3<f64>,
        /// Radius, mm.
        radius_mm: f64,
    },
    /// With flat ends.
    Cylinder {
        /// Centre of the first end.
        from_mm: Vector3<f64>,
        /// Centre of the second end.
        to_mm: Vector3<f64>,
        /// Radius, mm.
        radius_mm: f64,
    },
    /// With half balls on the ends.
    Capsule {
        /// First end of the axis.
        from_mm: Vector3<f64>,
        /// Second end of the axis.
        to_mm: Vector3<f64>,
        /// Radius, mm.
        radius_mm: f64,
    },
}

/// `[[obstacle]]`.
#[derive(Debug, Clone, PartialEq)]
pub struct Obstacle {
    /// Its name in reports.
    pub name: String,
    /// The frame of its coordinates.
    pub frame: ObstacleFrame,
    /// Where it is.
    pub shape: ObstacleShape,
}

impl RoomSpec {
    pub(super) fn read(t: &Walk<'_, '_>, model: &str) -> Self {
        let default = UrModel::by_name(model).map(|_| DEFAULT_CLEARANCE_MM);
        Self {
            link_clearance_mm: t.optional(&k::LINK_CLEARANCE).or(default),
            head: t.choice(&k::HEAD, HeadSource::Scan),
            head_beyond_mm: t.number(&k::HEAD_BEYOND),
        }
    }

    /// Its lines in `[robot]`.
    pub(super) fn lines(&self) -> Vec<(&'static str, String)> {
        let mut lines: Vec<_> =
            self.link_clearance_mm.map(|mm| ("link_clearance_mm", float(mm))).into_iter().collect();
        lines.push(("head", text(k::HEAD.word(self.head))));
        lines.push(("head_beyond_mm", float(self.head_beyond_mm)));
        lines
    }
}

pub(super) fn read_obstacles(root: &Walk<'_, '_>) -> Vec<Obstacle> {
    let tables = root.has("obstacle").then(|| root.tables(&k::OBSTACLE)).flatten().unwrap_or_default();
    tables.into_iter().filter_map(read_obstacle).collect()
}

fn read_obstacle(t: Walk<'_, '_>) -> Option<Obstacle> {
    let name = t.required_text(&k::OBSTACLE_NAME);
    if name.contains([',', '"', '\'']) || name.chars().any(char::is_control) {
        t.note("name", CaseFault::Name { key: t.key("name"), found: name.clone() });
    }
    let frame = t.choice(&k::OBSTACLE_FRAME, ObstacleFrame::Base);
    let options = ["box", "ball", "cylinder", "capsule"];
    let found: Vec<_> = options.into_iter().filter(|option| t.has(option)).collect();
    let shape = match found.as_slice() {
        [word] => Some(read_shape(t.table(word), word)),
        _ => {
            let (table, options) = (t.path().into(), options.to_vec());
            t.note("", CaseFault::ExactlyOne { table, found, options });
            t.accept(&["box", "ball", "cylinder", "capsule"]);
            None
        }
    };
    t.finish();
    Some(Obstacle { name, frame, shape: shape? })
}

fn read_shape(t: Walk<'_, '_>, word: &str) -> ObstacleShape {
    let ends = |from: &Number, to: &Number| (t.required_vector(from), t.required_vector(to));
    let shape = match word {
        "box" => {
            let (min_mm, max_mm) = ends(&k::OBSTACLE_BOX_MIN, &k::OBSTACLE_BOX_MAX);
            ObstacleShape::Box { min_mm, max_mm }
        }
        "ball" => ObstacleShape::Ball {
            center_mm: t.required_vector(&k::OBSTACLE_BALL_CENTER),
            radius_mm: t.number(&k::OBSTACLE_BALL_RADIUS),
        },
        "cylinder" => {
            let (from_mm, to_mm) = ends(&k::OBSTACLE_CYLINDER_FROM, &k::OBSTACLE_CYLINDER_TO);
            ObstacleShape::Cylinder { from_mm, to_mm, radius_mm: t.number(&k::OBSTACLE_CYLINDER_RADIUS) }
        }
        _ => {
            let (from_mm, to_mm) = ends(&k::OBSTACLE_CAPSULE_FROM, &k::OBSTACLE_CAPSULE_TO);
            ObstacleShape::Capsule { from_mm, to_mm, radius_mm: t.number(&k::OBSTACLE_CAPSULE_RADIUS) }
        }
    };
    t.finish();
    shape
}

impl Obstacle {
    /// The keys of its table.
    pub(super) fn lines(&self) -> Vec<(&'static str, String)> {
        let round = |from: &Vector3<f64>, to: &Vector3<f64>, radius_mm: f64| {
            format!(
                "{{ from_mm = {}, to_mm = {}, radius_mm = {} }}",
                vector(from),
                vector(to),
                float(radius_mm)
            )
        };
        let shape = match &self.shape {
            ObstacleShape::Box { min_mm, max_mm } => {
                ("box", format!("{{ min_mm = {}, max_mm = {} }}", vector(min_mm), vector(max_mm)))
            }
            ObstacleShape::Ball { center_mm, radius_mm } => (
                "ball",
                format!("{{ center_mm = {}, radius_mm = {} }}", vector(center_mm), float(*radius_mm)),
            ),
            ObstacleShape::Cylinder { from_mm, to_mm, radius_mm } => {
                ("cylinder", round(from_mm, to_mm, *radius_mm))
            }
            ObstacleShape::Capsule { from_mm, to_mm, radius_mm } => {
                ("capsule", round(from_mm, to_mm, *radius_mm))
            }
        };
        vec![("name", text(&self.name)), ("frame", text(k::OBSTACLE_FRAME.word(self.frame))), shape]
    }
}

/// Notes obstacles without extent, and two of one name.
pub(super) fn judge_obstacles(case: &Case, note: &dyn Fn(CaseFault, &str)) {
    for (n, obstacle) in case.obstacles.iter().enumerate() {
        let above = |name: &str, found: f64, limit: f64, of: &'static str| {
            let key = format!("obstacle[{n}].{name}");
            let (relation, unit, is_default) = ("above", Unit::Mm, false);
            note(
                CaseFault::Relation { key: key.clone(), found, is_default, relation, limit, of, unit },
                &key,
            );
        };
        match &obstacle.shape {
            ObstacleShape::Box { min_mm, max_mm } => {
                for (low, high) in min_mm.iter().zip(max_mm.iter()).filter(|(low, high)| high <= low) {
                    above("box.max_mm", *high, *low, "the same coordinate of min_mm");
                }
            }
            ObstacleShape::Cylinder { from_mm, to_mm, .. } => {
                let length_mm = (to_mm - from_mm).norm();
                if length_mm < 1e-3 {
                    above("cylinder.to_mm", length_mm, 0.001, "the cylinder's length from from_mm to to_mm");
                }
            }
            ObstacleShape::Ball { .. } | ObstacleShape::Capsule { .. } => {}
        }
        if let Some(first) = case.obstacles.iter().take(n).position(|earlier| earlier.name == obstacle.name) {
            let key = format!("obstacle[{n}].name");
            let (found, other) = (format!("{:?}", obstacle.name), format!("obstacle[{first}]"));
            note(CaseFault::Duplicate { key: key.clone(), found, other }, &key);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    const TEXT: &str = "structure = []\n[images]\nct = \"c\"\nlabels = \"l\"\n[target]\nlabel = 1\n";

    fn parse(more: &str) -> Result<Case, String> {
        Case::parse(&format!("{TEXT}{more}"), Path::new("c.toml")).map_err(|e| e.to_string())
    }

    #[test]
    fn obstacles_of_every_shape_are_read_and_written_back() {
        let shapes = "[[obstacle]]\nname = \"table\"\nbox = { min_mm = [-500, -500, -60], max_mm = [500, 500, -20] }\n\
            [[obstacle]]\nname = \"clamp\"\nframe = \"ct\"\nball = { center_mm = [1, 2, 3], radius_mm = 40 }\n\
            [[obstacle]]\nname = \"lamp\"\ncylinder = { from_mm = [0, 0, 900], to_mm = [0, 0, 1000], radius_mm = 200 }\n\
            [[obstacle]]\nname = \"hand\"\nframe = \"ct\"\ncapsule = { from_mm = [0, 0, 0], to_mm = [0, 80, 0], radius_mm = 30 }\n\
            [robot]\nmodel = \"ur5e\"\nhead = \"none\"\nhead_beyond_mm = 50\n";
        let case = parse(shapes).unwrap();
        assert_eq!(case.obstacles.len(), 4);
        assert_eq!(case.obstacles[1].frame, ObstacleFrame::Ct);
        let room = case.robot.room;
        assert_eq!(
            (room.link_clearance_mm, room.head, room.head_beyond_mm),
            (Some(10.0), HeadSource::None, 50.0)
        );
        assert_eq!(Case::parse(&case.to_toml(), Path::new("again.toml")).unwrap(), case);
        assert_eq!(
            parse("").unwrap().robot.room.link_clearance_mm,
            None,
            "nothing is asked of the bone-attached arm"
        );
    }

    #[test]
    fn what_is_no_obstacle_is_refused_with_key_and_line() {
        let obstacle = |rest: &str| format!("[[obstacle]]\nname = \"table\"\n{rest}");
        for (text, says) in [
            (obstacle(""), "exactly one of"),
            (obstacle("ball = { center_mm = [0, 0, 0], radius_mm = 1 }\nbox = 3"), "exactly one of"),
            (obstacle("ball = { center_mm = [0, 0], radius_mm = 1 }"), "obstacle[0].ball.center_mm"),
            (obstacle("ball = { center_mm = [0, 0, 0] }"), "`obstacle[0].ball.radius_mm` is missing"),
            (obstacle("ball = { center_mm = [0, 0, 0], radius_mm = 9000 }"), "expected 0.5 to 5000 mm"),
            (
                obstacle("box = { min_mm = [0, 0, 0], max_mm = [1, 0, 1] }"),
                "c.toml:9: `obstacle[0].box.max_mm`",
            ),
            (
                obstacle("cylinder = { from_mm = [0, 0, 0], to_mm = [0, 0, 0], radius_mm = 4 }"),
                "c.toml:9: `obstacle[0].cylinder.to_mm`",
            ),
            (obstacle("frame = \"work\"\nball = { center_mm = [0, 0, 0], radius_mm = 1 }"), "`base`"),
            (obstacle("size = 1\nball = { center_mm = [0, 0, 0], radius_mm = 1 }"), "obstacle[0].size"),
            (
                obstacle("ball = { center_mm = [0, 0, 0], radius_mm = 1 }\n").repeat(2),
                "stands already in `obstacle[0]`",
            ),
            ("[robot]\nlink_clearance_mm = -1".into(), "robot.link_clearance_mm"),
            ("[robot]\nhead = \"skin\"".into(), "robot.head"),
        ] {
            let said = parse(&text).unwrap_err();
            assert!(said.contains(says), "{text}: {said}");
        }
    }
}
