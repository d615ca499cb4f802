//! The access test compared with a test of every eighth of every voxel, at waypoints and during whole moves.
#![allow(clippy::unwrap_used, reason = "a test's helpers are tests")]

#[path = "support/pocket.rs"]
#[allow(dead_code, reason = "each test uses a part of it")]
mod pocket;

use bonemill_geometry::Point;
use bonemill_planner::access::{
    Access, EighthTimes, STRIDE_MM, ShankCylinder, ShankObstacles, Turn, aside_mm,
};
use bonemill_planner::path::PathPoint;
use bonemill_planner::removal::NEVER;
use bonemill_planner::space::{BurrSpace, TRAJECTORY_TOLERANCE_MM};
use nalgebra::{Unit, Vector3};

use pocket::{BALL, CLEARANCE_MM, RADIUS_MM, from_segment, moves, path, scene};

/// Tests every eighth of every voxel: when it is removed, and whether it lies in the shank.
#[test]
fn the_shank_is_free_where_no_eighth_stands_in_it() {
    let scene = scene();
    let space = BurrSpace::new(&scene, BALL, &[CLEARANCE_MM]).unwrap();
    let path = path(&space);
    let (solid, moves) = (ShankObstacles::new(&scene, &[0.0]), moves(&path));
    let eighths = EighthTimes::new(&solid, &path.points, BALL);
    let mut standing: Vec<(Vector3<f64>, u32)> = Vec::new();
    for n in 0..scene.class.data().len() {
        let times = eighths.of(solid.grid().voxel(n));
        for (eighth, center) in solid.centers(n).iter().enumerate() {
            if solid.stays(n) >> eighth & 1 == 1 {
                standing.push((center.coords, NEVER));
            } else if solid.goes(n) >> eighth & 1 == 1 {
                standing.push((center.coords, times[eighth]));
                let distance = |(a, b): &(Vector3<f64>, Vector3<f64>)| from_segment(&center.coords, a, b);
                if n % 7 == 0 && !moves.iter().any(|m| (distance(m) - RADIUS_MM).abs() < 1e-9) {
                    let first = moves.iter().position(|m| distance(m) < RADIUS_MM);
                    assert_eq!(
                        times[eighth],
                        first.map_or(NEVER, |i| i as u32),
                        "voxel {n}, eighth {eighth}"
                    );
                }
            }
        }
    }
    let shank = [
        ShankCylinder { from_mm: RADIUS_MM, to_mm: 7.0, radius_mm: 0.8 },
        ShankCylinder { from_mm: 7.0, to_mm: 20.0, radius_mm: 2.5 },
    ];
    let access = |shank: &[ShankCylinder], eighths| Access::new(&scene, &solid, eighths, shank);
    let (thin, whole) = (access(&shank[..1], eighths.clone()), access(&shank, eighths));
    let (mut free, mut blocked, mut only_just) = (0, 0, 0);
    for i in (0..path.points.len()).step_by(path.points.len() / 80) {
        let center = path.points[i].position;
        for (tilt, turn) in [0.0f64, 0.15, 0.3, 0.5, 0.8].into_iter().zip([0.0f64, 0.9, 2.3, 3.9, 5.5]) {
            let axis = Vector3::new(tilt.sin() * turn.cos(), tilt.sin() * turn.sin(), tilt.cos());
            // whether something lies in cylinders that are wider by this much
            let stands = |shank: &[ShankCylinder], wider: &dyn Fn(f64) -> f64| {
                standing.iter().filter(|(_, time)| *time >= i as u32).any(|(p, _)| {
                    let off = p - center.coords;
                    let at_mm = off.dot(&axis);
                    let (across_mm, wider_mm) = ((off - axis * at_mm).norm(), wider(at_mm));
                    shank.iter().any(|c| {
                        (c.from_mm - wider_mm..=c.to_mm + wider_mm).contains(&at_mm)
                            && across_mm <= c.radius_mm + wider_mm
                    })
                })
            };
            let index = i as u32;
            if whole.is_free(index, center, &axis) {
                free += 1;
                assert!(!stands(&shank, &|_| 0.0), "waypoint {i}, tilt {tilt}");
            }
            if thin.is_free(index, center, &axis) {
                assert!(!stands(&shank[..1], &|_| 0.0), "waypoint {i}, tilt {tilt}");
            } else {
                blocked += 1;
                only_just += usize::from(!stands(&shank[..1], &|_| 0.0));
                assert!(
                    stands(&shank[..1], &|at_mm| aside_mm(shank[0].radius_mm, at_mm.max(0.0)) + 1e-9),
                    "waypoint {i}, tilt {tilt}"
                );
            }
        }
    }
    assert!(free > 100 && blocked > 20 && only_just < blocked / 4, "{free} {blocked} {only_just}");
}

/// The coarse access test for a comparison of paths: its error is at most that of its balls and its march, and it seldom
/// differs from a plan's test.
#[test]
fn a_drafts_shank_is_free_where_the_voxels_along_its_axis_say_so() {
    let scene = scene();
    let space = BurrSpace::new(&scene, BALL, &[CLEARANCE_MM]).unwrap();
    let path = path(&space);
    let (solid, grid) = (ShankObstacles::new(&scene, &[0.0]), scene.class.grid());
    let shank = [ShankCylinder { from_mm: RADIUS_MM, to_mm: 12.0, radius_mm: 0.8 }];
    let draft = Access::draft(&scene, &solid, path.removal.time(), &shank);
    let exact = Access::new(&scene, &solid, EighthTimes::new(&solid, &path.points, BALL), &shank);
    let standing: Vec<(Vector3<f64>, u32)> = (0..grid.len())
        .filter(|n| solid.stays(*n).count_ones().max(solid.goes(*n).count_ones()) >= 4)
        .map(|n| {
            let time = if solid.stays(n).count_ones() >= 4 { NEVER } else { path.removal.time()[n] };
            (grid.center(grid.voxel(n)).coords, time)
        })
        .collect();
    // the distance from a place to the centre of its voxel, and half a step along the axis
    let off_mm = 0.5 * grid.diagonal_mm() + 0.5 * grid.spacing_mm().x;
    let wide_mm = shank[0].radius_mm + aside_mm(shank[0].radius_mm, shank[0].to_mm);
    let (mut free, mut blocked, mut other) = (0, 0, 0);
    for i in (0..path.points.len()).step_by(path.points.len() / 60) {
        let center = path.points[i].position;
        for (tilt, turn) in [0.0f64, 0.15, 0.3, 0.5, 0.8].into_iter().zip([0.0f64, 0.9, 2.3, 3.9, 5.5]) {
            let axis = Vector3::new(tilt.sin() * turn.cos(), tilt.sin() * turn.sin(), tilt.cos());
            let stands = |radius_mm: f64| {
                standing.iter().filter(|(_, time)| *time > i as u32).any(|(p, _)| {
                    let off = p - center.coords;
                    // the balls' centres lie on this part of the axis
                    let at_mm = off.dot(&axis).clamp(RADIUS_MM, shank[0].to_mm);
                    (off - axis * at_mm).norm() <= radius_mm
                })
            };
            let index = i as u32;
            let is_free = draft.is_free(index, center, &axis);
            if is_free {
                free += 1;
                assert!(!stands(wide_mm - off_mm), "waypoint {i}, tilt {tilt}");
            } else {
                blocked += 1;
                assert!(stands(wide_mm + off_mm), "waypoint {i}, tilt {tilt}");
            }
            other += usize::from(is_free != exact.is_free(index, center, &axis));
        }
    }
    assert!(free > 100 && blocked > 20 && other <= (free + blocked) / 20, "{free} {blocked} {other}");
}

/// All solid eighths, with their times.
fn standing(solid: &ShankObstacles, eighths: &EighthTimes) -> Vec<(Vector3<f64>, u32)> {
    let of = |n: usize| {
        let times = eighths.of(solid.grid().voxel(n));
        let time = move |eighth: usize| match (solid.stays(n) >> eighth & 1, solid.goes(n) >> eighth & 1) {
            (1, _) => Some(NEVER),
            (_, 1) => Some(times[eighth]),
            _ => None,
        };
        let centers = solid.centers(n).map(|p| p.coords);
        (0..8usize).filter_map(move |eighth| Some((centers[eighth], time(eighth)?)))
    };
    (0..solid.grid().len()).flat_map(of).collect()
}

/// In a free turn the shank has the room for the arm's tolerance everywhere; in a blocked one it lacks it somewhere, by the
/// reported amount.
#[test]
fn turns_are_free_where_the_shank_keeps_its_room_all_the_way() {
    let scene = scene();
    let space = BurrSpace::new(&scene, BALL, &[CLEARANCE_MM]).unwrap();
    let path = path(&space);
    let solid = ShankObstacles::new(&scene, &[0.0]);
    let eighths = EighthTimes::new(&solid, &path.points, BALL);
    let standing = standing(&solid, &eighths);
    let shank = ShankCylinder { from_mm: RADIUS_MM, to_mm: 12.0, radius_mm: 0.8 };
    let access = Access::new(&scene, &solid, eighths, &[shank]);
    // how far the narrowest tested shank is widened beyond the tolerance
    let between_mm = aside_mm(shank.radius_mm, 0.0) - TRAJECTORY_TOLERANCE_MM;
    let (mut free, mut blocked, mut in_doubt) = (0, 0, 0);
    for i in (1..path.points.len()).step_by(path.points.len() / 60) {
        let points: &[PathPoint] = &path.points;
        for (tilt, turn) in [0.15f64, 0.3, 0.5, 0.6, 0.8].into_iter().zip([0.9f64, 2.3, 3.9, 5.5, 0.1]) {
            let axis = |tilt: f64| {
                Unit::new_normalize(Vector3::new(
                    tilt.sin() * turn.cos(),
                    tilt.sin() * turn.sin(),
                    tilt.cos(),
                ))
            };
            let [from, to] = [axis(tilt), axis(tilt - 0.3)];
            let is_free =
                |n: usize, axis: &Unit<Vector3<f64>>| access.is_free(i as u32, points[n].position, axis);
            let ends_free = [is_free(i - 1, &from), is_free(i, &to)];
            // at least one end must be free; turns between two free ends are seldom blocked here
            if ends_free == [false; 2] {
                continue;
            }
            let turn = Turn::along(points, i, [&from, &to]);
            // eighths that no place of the turn comes near are left out
            let middle = Unit::new_normalize(from.into_inner() + to.into_inner());
            let near: Vec<_> = standing
                .iter()
                .filter(|(p, time)| {
                    let off = p - points[i].position.coords;
                    *time >= i as u32 && (off - middle.into_inner() * off.dot(&middle)).norm() < 4.0
                })
                .copied()
                .collect();
            // depth of the deepest eighth in the shank with the arm's tolerance, at places 0.02 mm apart; no eighth's depth changes
            // by more than the shank moves, here allowed twice as much: places that cannot be deepest are left out
            let places = (points[i - 1].position.distance_mm(&points[i].position) + 12.0 * 0.3) / 0.02;
            let (mut deepest_mm, mut k) = (f64::NEG_INFINITY, 0);
            while k <= places as usize {
                let t = k as f64 / places.floor();
                let axis = Unit::new_normalize(from.lerp(&to, t));
                let center = points[i - 1].position + (points[i].position - points[i - 1].position) * t;
                let here_mm = self::deepest_mm(&near, &shank, i as u32, (center, &axis), between_mm);
                deepest_mm = deepest_mm.max(here_mm);
                k += (((deepest_mm - here_mm) / (2.0 * 0.02)) as usize).max(1);
            }
            if access.is_turn_free(&turn) {
                if ends_free != [true; 2] {
                    continue; // only turns between two free ends are asserted to be free throughout
                }
                free += 1;
                assert!(deepest_mm <= 1e-9, "move {i}, tilt {tilt}: {deepest_mm}");
            } else {
                blocked += 1;
                assert!(deepest_mm > -0.125 * between_mm - 1e-3, "move {i}, tilt {tilt}: {deepest_mm}");
                in_doubt += usize::from(deepest_mm <= 0.0);
                let missing_mm = access.missing_mm(&turn);
                assert!(
                    (missing_mm - deepest_mm.max(0.0)).abs() < 0.3 * STRIDE_MM,
                    "{missing_mm} {deepest_mm}"
                );
            }
        }
    }
    assert!(free > 50 && blocked > 5 && in_doubt <= blocked / 4, "{free} {blocked} {in_doubt}");
}

/// Depth of the deepest eighth in a shank that is wider by the arm's tolerance, mm; negative if it is outside.
fn deepest_mm(
    standing: &[(Vector3<f64>, u32)],
    shank: &ShankCylinder,
    index: u32,
    (center, axis): (Point<bonemill_geometry::Work>, &Unit<Vector3<f64>>),
    between_mm: f64,
) -> f64 {
    let depth = |(p, time): &(Vector3<f64>, u32)| {
        let off = p - center.coords;
        let at_mm = off.dot(axis);
        let aside_mm = aside_mm(shank.radius_mm, at_mm.max(0.0)) - between_mm;
        let front_mm = if *time > index { aside_mm } else { 0.0 };
        let across_mm = (off - axis.into_inner() * at_mm).norm();
        (shank.radius_mm + aside_mm - across_mm)
            .min(at_mm - shank.from_mm + front_mm)
            .min(shank.to_mm + aside_mm - at_mm)
    };
    standing.iter().map(depth).fold(f64::NEG_INFINITY, f64::max)
}
