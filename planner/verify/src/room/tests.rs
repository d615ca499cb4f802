//! Links walked along coarse rows, and held against what stands around them.

use super::*;
use bonemill_case::{Obstacle, ObstacleFrame, ObstacleShape};

/// Two rows, one second apart, at rest at both: the cubic between them.
fn rows(from: [f64; 6], to: [f64; 6]) -> Trajectory {
    Trajectory { dof: 6, time_s: vec![0.0, 1.0], q: [from, to].concat(), qd: vec![0.0; 12] }
}

fn solid(shape: ObstacleShape) -> Solid {
    let obstacle = Obstacle { name: "thing".into(), frame: ObstacleFrame::Base, shape };
    Solid::new(&obstacle, &Isometry3::identity())
}

#[test]
fn coarse_rows_are_walked_in_short_steps_and_what_lies_between_them_is_met() {
    let links = Links::new(UrModel::Ur5e, vec![]);
    let q = [0.2, -1.4, 1.6, -1.7, -1.5, 0.3];
    let mut turned = q;
    turned[0] += 1.2;
    turned[4] += 0.4;
    let stops = walked(&rows(q, turned), links.longest_mm());
    assert_eq!((stops[0].q.as_slice(), stops[stops.len() - 1].q.as_slice()), (&q[..], &turned[..]));
    for pair in stops.windows(2) {
        let [a, b] = [0, 1].map(|n| links.placed(&pair[n].q));
        for (a, b) in a.iter().flatten().zip(b.iter().flatten()) {
            assert!((a.0 - b.0).norm().max((a.1 - b.1).norm()) <= STEP_MM);
        }
    }
    // a ball at the wrist half-way, clear of the arm at both rows
    let half: Vec<f64> = q.iter().zip(&turned).map(|(a, b)| 0.5 * (a + b)).collect();
    let center_mm = links.frames(&half)[5].translation.vector;
    let solids = [solid(ObstacleShape::Ball { center_mm, radius_mm: 20.0 })];
    let among = |q: &[f64]| among(&links.placed(q), &solids, &[], 0.0);
    let at_rows = [q, turned].map(|q| among(&q).unwrap().mm);
    assert!(at_rows.iter().all(|mm| *mm > 20.0), "{at_rows:?}");
    assert!(least(&stops, among).unwrap().0.mm < 0.0);
    // rows that are dense already are not all looked at
    let dense = Trajectory {
        dof: 6,
        time_s: (0..1000).map(f64::from).collect(),
        q: (0..1000).flat_map(|n| q.map(|q| q + 1e-6 * f64::from(n))).collect(),
        qd: vec![1e-6; 6000],
    };
    let few = walked(&dense, links.longest_mm());
    assert!(few.len() > 10 && few.len() < 100 && few[few.len() - 1].row == 999, "{}", few.len());
}

#[test]
fn distances_are_the_least_of_fine_samples() {
    let links = Links::new(UrModel::Ur10e, vec![]);
    let placed = links.placed(&[0.4, -1.1, 1.9, -0.6, 1.2, 0.0]);
    let shapes = [
        ObstacleShape::Box { min_mm: [-900.0, 100.0, 50.0].into(), max_mm: [-500.0, 400.0, 90.0].into() },
        ObstacleShape::Cylinder {
            from_mm: [0.0, -700.0, 300.0].into(),
            to_mm: [-200.0, -600.0, 900.0].into(),
            radius_mm: 80.0,
        },
    ];
    for shape in shapes {
        let solid = solid(shape);
        let found = among(&placed, std::slice::from_ref(&solid), &[], 0.0).unwrap().mm;
        let sampled = placed.iter().flatten().flat_map(|(from, to, radius_mm)| {
            (0..=2000)
                .map(|n| solid.distance_mm(&from.lerp(to, f64::from(n) / 2000.0)) - radius_mm)
                .collect::<Vec<_>>()
        });
        let sampled = sampled.fold(f64::INFINITY, f64::min);
        assert!(found <= sampled + 1e-2 && found > sampled - 0.3, "{found} {sampled}");
    }
}

#[test]
fn a_deviation_is_taken_off_once_for_each_link_that_moves() {
    let links = Links::new(UrModel::Ur5e, vec![]);
    let placed = links.placed(&[0.0, -1.2, 2.6, 0.0, 1.5, 0.0]);
    for (pair, times) in [((0, 4), 1.0), ((1, 4), 2.0)] {
        let [exact, less] = [0.0, 3.0].map(|off| among(&placed, &[], &[pair], off).unwrap().mm);
        assert!((exact - less - 3.0 * times).abs() < 1e-9, "{pair:?}: {exact} {less}");
    }
}

#[test]
fn the_base_is_held_against_what_reaches_above_its_plane_only() {
    let links = Links::new(UrModel::Ur5e, vec![]);
    let placed = links.placed(&[0.0, -1.57, 0.0, -1.57, 0.0, 0.0]);
    let table = |top_mm: f64| {
        let shape = ObstacleShape::Box {
            min_mm: [-300.0, -300.0, -80.0].into(),
            max_mm: [300.0, 300.0, top_mm].into(),
        };
        solid(shape)
    };
    let near = |top_mm: f64| among(&placed, &[table(top_mm)], &[], 0.0).unwrap();
    let (on, inside) = (near(0.5), near(30.0));
    assert!(on.link != BASE && on.mm > 10.0, "{on:?}");
    assert!(inside.link == BASE && inside.mm < 0.0, "{inside:?}");
}
