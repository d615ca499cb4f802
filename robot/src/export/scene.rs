//! `moveit_msgs/PlanningScene` with what stands in the room, as JSON, which is YAML too: `ros2 topic pub -1 --yaml-file FILE /planning_scene
//! moveit_msgs/msg/PlanningScene`.
//!
//! Each obstacle is a collision object of boxes, cylinders and balls, in m, in the frame of the arm's base; a capsule is a cylinder with a
//! ball on each end. It is a difference to the scene that a planner has. The patient, a distance field here, has no such shape and is
//! left out.

use std::fmt::Write as _;

use bonemill_geometry::{Base, Point, Rigid};
use nalgebra::{Rotation3, UnitQuaternion, Vector3};

use super::ros::{list, quoted};
use crate::room::{Obstacle, Shape};

/// Numbers of `shape_msgs/SolidPrimitive`.
const BOX: u8 = 1;
const SPHERE: u8 = 2;
const CYLINDER: u8 = 3;

/// A primitive: its kind, its dimensions in mm and where it is.
type Primitive = (u8, Vec<f64>, Rigid<Base, Base>);

/// The scene; `frame` is ROS' name for the arm's base, `name` the scene's.
pub fn planning_scene(obstacles: &[Obstacle], frame: &str, name: &str) -> String {
    let objects: Vec<String> = obstacles
        .iter()
        .map(|obstacle| {
            let parts = primitives(&obstacle.shape);
            let solids: Vec<String> = parts
                .iter()
                .map(|(kind, size_mm, _)| {
                    let metres: Vec<f64> = size_mm.iter().map(|mm| mm * 1e-3).collect();
                    format!("{{\"type\": {kind}, \"dimensions\": {}}}", list(&metres))
                })
                .collect();
            let poses: Vec<String> = parts.iter().map(|(_, _, base_from_part)| pose(base_from_part)).collect();
            format!(
                "{{\"header\": {{\"frame_id\": {}}}, \"id\": {},\n \"primitives\": [{}],\n \"primitive_poses\": [{}]}}",
                quoted(frame),
                quoted(&obstacle.name),
                solids.join(", "),
                poses.join(", ")
            )
        })
        .collect();
    format!(
        "{{\"name\": {}, \"is_diff\": true, \"world\": {{\"collision_objects\": [\n{}\n]}}}}\n",
        quoted(name),
        objects.join(",\n")
    )
}

fn pose(base_from_part: &Rigid<Base, Base>) -> String {
    let turn = UnitQuaternion::from_rotation_matrix(&base_from_part.rotation);
    let at = base_from_part.translation_mm * 1e-3;
    let object = |keys: &[&str], values: &[f64]| {
        let mut text = String::new();
        for (key, value) in keys.iter().zip(values) {
            let number = list(&[*value]);
            let _ = write!(
                text,
                "{}\"{key}\": {}",
                if text.is_empty() { "" } else { ", " },
                number.trim_matches(['[', ']'])
            );
        }
        format!("{{{text}}}")
    };
    format!(
        "{{\"position\": {}, \"orientation\": {}}}",
        object(&["x", "y", "z"], at.as_slice()),
        object(&["x", "y", "z", "w"], turn.coords.as_slice())
    )
}

fn primitives(shape: &Shape) -> Vec<Primitive> {
    let ball = |center: &Point<Base>, radius_mm: f64| {
        (SPHERE, vec![radius_mm], Rigid::new(Rotation3::identity(), center.coords))
    };
    match shape {
        Shape::Box { box_from_base, half_mm } => {
            vec![(BOX, (2.0 * half_mm).as_slice().to_vec(), box_from_base.inverse())]
        }
        Shape::Cylinder { from, to, radius_mm } => vec![rod(from, to, *radius_mm)],
        Shape::Capsule(c) if c.length_mm() < 1e-9 => vec![ball(&c.from, c.radius_mm)],
        Shape::Capsule(c) => {
            vec![rod(&c.from, &c.to, c.radius_mm), ball(&c.from, c.radius_mm), ball(&c.to, c.radius_mm)]
        }
        Shape::Head(_) => vec![],
    }
}

/// A cylinder about its own z.
fn rod(from: &Point<Base>, to: &Point<Base>, radius_mm: f64) -> Primitive {
    let along = *to - *from;
    // no single rotation turns z to its opposite: about x it is one
    let turn = Rotation3::rotation_between(&Vector3::z(), &along)
        .unwrap_or_else(|| Rotation3::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI));
    let middle = from.coords + 0.5 * along;
    (CYLINDER, vec![along.norm(), radius_mm], Rigid::new(turn, middle))
}

#[cfg(test)]
mod tests {
    use super::*;
    use bonemill_geometry::Capsule;

    #[test]
    fn every_shape_is_where_it_was() {
        let at = Rigid::<Base, Base>::new(
            Rotation3::from_euler_angles(0.3, -0.8, 1.9),
            Vector3::new(30.0, -20.0, 55.0),
        );
        let half_mm = Vector3::new(20.0, 45.0, 8.0);
        let [(kind, size_mm, base_from_part)] =
            &primitives(&Shape::Box { box_from_base: at.inverse(), half_mm })[..]
        else {
            panic!()
        };
        assert_eq!((*kind, size_mm.as_slice()), (BOX, &[40.0, 90.0, 16.0][..]));
        assert!((base_from_part.translation_mm - at.translation_mm).norm() < 1e-12);
        for to in [[40.0, -70.0, 100.0], [40.0, 30.0, -100.0]] {
            let (from, to) = (Point::new(40.0, 30.0, 20.0), Point::new(to[0], to[1], to[2]));
            let parts = primitives(&Shape::Capsule(Capsule { from, to, radius_mm: 7.0 }));
            assert_eq!(parts.iter().map(|part| part.0).collect::<Vec<_>>(), [CYLINDER, SPHERE, SPHERE]);
            // the ends of the cylinder's axis are those of the capsule's
            let (_, size_mm, base_from_part) = &parts[0];
            for (end, z) in [(from, -0.5), (to, 0.5)] {
                let p = *base_from_part * Point::<Base>::new(0.0, 0.0, z * size_mm[0]);
                assert!(p.distance_mm(&end) < 1e-9, "{p:?} {end:?}");
            }
        }
    }

    #[test]
    fn the_text_is_yaml_with_decimal_points() {
        use saphyr::{LoadableYamlNode, Yaml};
        let middle = Point::new(1000.0, 0.0, -250.0);
        let shape = Shape::Capsule(Capsule { from: middle, to: middle, radius_mm: 100.0 });
        let text = planning_scene(&[Obstacle { name: "a \"lamp\"".into(), shape }], "base", "room");
        let read = Yaml::load_from_str(&text).unwrap();
        let object = &read[0]["world"]["collision_objects"][0];
        assert_eq!(object["id"].as_str(), Some("a \"lamp\""));
        assert_eq!(object["header"]["frame_id"].as_str(), Some("base"));
        assert_eq!(object["primitives"][0]["dimensions"][0].as_floating_point(), Some(0.1));
        let pose = &object["primitive_poses"][0];
        let at = ["x", "y", "z"].map(|k| pose["position"][k].as_floating_point());
        assert_eq!(at, [Some(1.0), Some(0.0), Some(-0.25)]);
        assert_eq!(pose["orientation"]["w"].as_floating_point(), Some(1.0));
    }
}
