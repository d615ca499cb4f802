//! Keys of what stands around the arm.

use super::*;
use crate::room::{HeadSource, ObstacleFrame};

table! {
    numbers {
        LINK_CLEARANCE = "robot.link_clearance_mm" Mm 0.0..500.0, Derived("10 with a UR named by robot.model; else none, and links are not checked"),
            "least distance of the arm's links from the patient, from every [[obstacle]] and from each other, and of the handpiece from obstacles and links; postures below it are not taken, and more distance is preferred up to four times as much", ASSUMED;
        HEAD_BEYOND = "robot.head_beyond_mm" Mm 0.0..500.0, Value(100.0),
            "with head = \"scan\": tissue in the outermost layer of the scan is taken to go on so far beyond it, but not beyond a face whose way out is within 60° of the approach: the tool comes in there", ASSUMED;
        OBSTACLE_BOX_MIN = "obstacle.box.min_mm" Mm -1e4..1e4, Words(REQUIRED), "lower corner; sides are along the frame's axes", "-";
        OBSTACLE_BOX_MAX = "obstacle.box.max_mm" Mm -1e4..1e4, Words(REQUIRED), "upper corner", "-";
        OBSTACLE_BALL_CENTER = "obstacle.ball.center_mm" Mm -1e4..1e4, Words(REQUIRED), "centre", "-";
        OBSTACLE_BALL_RADIUS = "obstacle.ball.radius_mm" Mm 0.5..5000.0, Words(REQUIRED), "radius", "-";
        OBSTACLE_CYLINDER_FROM = "obstacle.cylinder.from_mm" Mm -1e4..1e4, Words(REQUIRED), "centre of the first end, which is flat", "-";
        OBSTACLE_CYLINDER_TO = "obstacle.cylinder.to_mm" Mm -1e4..1e4, Words(REQUIRED), "centre of the second end", "-";
        OBSTACLE_CYLINDER_RADIUS = "obstacle.cylinder.radius_mm" Mm 0.5..5000.0, Words(REQUIRED), "radius", "-";
        OBSTACLE_CAPSULE_FROM = "obstacle.capsule.from_mm" Mm -1e4..1e4, Words(REQUIRED), "first end of the axis; the ends are half balls", "-";
        OBSTACLE_CAPSULE_TO = "obstacle.capsule.to_mm" Mm -1e4..1e4, Words(REQUIRED), "second end of the axis", "-";
        OBSTACLE_CAPSULE_RADIUS = "obstacle.capsule.radius_mm" Mm 0.5..5000.0, Words(REQUIRED), "radius", "-";
    }
    choices {
        HEAD: HeadSource = "robot.head" ["scan" => HeadSource::Scan, "none" => HeadSource::None],
            "the patient that links keep clear of: everything in the CT above -300 HU and the air that it encloses, without specks; or nothing", "-300 HU: half-way between air and fat is -550, and noise is kept out; assumed";
        OBSTACLE_FRAME: ObstacleFrame = "obstacle.frame" ["base" => ObstacleFrame::Base, "ct" => ObstacleFrame::Ct],
            "the frame of its coordinates: the arm's base or the scan", "-";
    }
    others {
        OBSTACLE = "obstacle" "tables [[obstacle]]", ABSENT, "what the arm's links and the handpiece must not touch: table, head clamp, microscope, a space for a hand", "-";
        OBSTACLE_NAME = "obstacle.name" "text without commas and quotes", REQUIRED, "name in results", "-";
        OBSTACLE_BOX = "obstacle.box" "a table { min_mm, max_mm }", "exactly one of box, ball, cylinder, capsule", "a box", "-";
        OBSTACLE_BALL = "obstacle.ball" "a table { center_mm, radius_mm }", "exactly one of box, ball, cylinder, capsule", "a ball", "-";
        OBSTACLE_CYLINDER = "obstacle.cylinder" "a table { from_mm, to_mm, radius_mm }", "exactly one of box, ball, cylinder, capsule", "a cylinder", "-";
        OBSTACLE_CAPSULE = "obstacle.capsule" "a table { from_mm, to_mm, radius_mm }", "exactly one of box, ball, cylinder, capsule", "a cylinder with half balls on its ends", "-";
    }
}
