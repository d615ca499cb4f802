//! The plan lists the free range of the shaft at every waypoint, and every waypoint that the shank cannot reach.

use std::fs;

use crate::support::body::{AIR_FROM, NERVE, TARGET};
use crate::support::place::Place;

/// The rows of a plan's table as cells, without its header.
fn rows(place: &Place, file: &str) -> Vec<Vec<String>> {
    let text = fs::read_to_string(place.path("plan").join(file)).unwrap();
    text.lines().skip(1).map(|line| line.split(',').map(str::to_owned).collect()).collect()
}

fn number(cell: &str) -> f64 {
    cell.parse().unwrap()
}

/// The counts of `dropped_waypoints` in plan.toml.
fn counts(place: &Place) -> Vec<(String, i64)> {
    let record: toml::Table = fs::read_to_string(place.path("plan/plan.toml")).unwrap().parse().unwrap();
    let dropped = record["modelled"]["dropped_waypoints"].as_table().unwrap();
    dropped.iter().map(|(why, n)| (why.clone(), n.as_integer().unwrap())).collect()
}

#[test]
fn every_waypoint_has_its_interval_of_the_tilt_plane() {
    let place = Place::healthy();
    assert_eq!(place.plan().code, 0);
    let (access, waypoints) = (rows(&place, "access.csv"), rows(&place, "waypoints.csv"));
    assert_eq!(access.len(), waypoints.len());
    for (row, waypoint) in access.iter().zip(&waypoints) {
        let [angle, low, high] = [3, 4, 5].map(|n| number(&row[n]));
        // with the assumed registration, the arm's tilt plane is that of theta
        assert!((angle - number(&waypoint[10])).abs() < 1e-5 && low <= angle && angle <= high, "{row:?}");
        assert!(number(&row[1]) >= 1.0 && number(&row[2]) >= 1.0 && row[6].is_empty(), "{row:?}");
    }
    // the walls limit the range at some waypoints and not at others
    let widths: Vec<f64> = access.iter().map(|row| number(&row[5]) - number(&row[4])).collect();
    let (least, most) = widths.iter().fold((f64::MAX, 0f64), |(a, b), w| (a.min(*w), b.max(*w)));
    assert!(least < 1.2 && most > 2.0, "{least} to {most} rad");
    assert!(rows(&place, "dropped.csv").is_empty() && counts(&place).is_empty());
}

/// A cavity under a roof of bone, and one under a structure: the ball can enter from the side, the shank cannot.
#[test]
fn dropped_places_are_listed_with_what_stands_in_the_way() {
    for (is_structure, expected) in
        [(false, "shank would meet untargeted bone"), (true, "shank would meet lid or bone beside it")]
    {
        let mut place = Place::healthy().with_labels(|labels| {
            labels.fill([30..32, 24..36, 12..14], 0.0);
            labels.fill([2..4, 24..36, 12..14], NERVE);
            labels.fill([11..27, 12..26, 8..AIR_FROM], TARGET);
            labels.fill([11..18, 26..31, 17..AIR_FROM], TARGET);
            labels.fill([27..38, 14..24, 8..15], TARGET);
            if is_structure {
                labels.fill([30..40, 8..32, 18..AIR_FROM], 9.0);
            }
        });
        place = place.with_case("clearance_mm = 1.0", "clearance_mm = 0.5");
        if is_structure {
            let lid = "[approach]\n";
            place = place.with_case(
                lid,
                "[[structure]]\nname = \"lid\"\nlabel = 9\nclearance_mm = 0.5\n\n[approach]\n",
            );
        }
        let ran = place.plan();
        assert_eq!(ran.code, 1, "{}{}", ran.out, ran.err);
        let (dropped, counts) = (rows(&place, "dropped.csv"), counts(&place));
        assert!(!dropped.is_empty());
        for (why, count) in &counts {
            let here = dropped.iter().filter(|row| row[3..].join(",") == format!("\"{why}\"")).count();
            assert_eq!(here as i64, *count, "{why}");
        }
        assert_eq!(counts.iter().map(|(_, n)| n).sum::<i64>(), dropped.len() as i64);
        assert!(counts.iter().any(|(why, _)| why == expected), "{counts:?}");
        // nearly all are in the cavity, not in the pocket
        let roof_from_mm = -11.0 + 26.5 * 0.5;
        let inside = dropped.iter().filter(|row| number(&row[0]) > roof_from_mm - 1.5).count();
        assert!(10 * inside >= 9 * dropped.len(), "{inside} of {}", dropped.len());
    }
}
