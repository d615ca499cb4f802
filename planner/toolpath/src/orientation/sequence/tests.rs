//! The dynamic program compared with the enumeration of every sequence, and hard cases.

use super::*;
use crate::orientation::{TiltFamily, TurnTime};
use nalgebra::Vector3;
use proptest::prelude::*;

/// `count` directions in a plane (odd), or a cap of 7.
fn sets(in_plane: bool, count: usize) -> Directions {
    if !in_plane {
        return Directions::cap(0.3, 0.3);
    }
    let half = 0.05 * (count - 1) as f64;
    let family = TiltFamily {
        hinge: Vector3::x_axis(),
        zero: Vector3::z_axis(),
        lower_rad: -half - 1e-9,
        upper_rad: half + 1e-9,
    };
    Directions::in_plane(&family, 0.1, 1.5)
}

/// Whether the axis may turn from m to n, by the slots of n's fan.
fn may_turn(p: &Problem, i: usize, m: usize, n: usize) -> bool {
    if p.directions.angle_rad(m, n) > p.reach_rad(i) + 1e-6
        || p.forbidden.at(i).contains(&[m as u16, n as u16])
    {
        return false;
    }
    // back along the fan: every direction between must be free before or after the move
    let fan = p.directions.fan(n);
    let Some(mut slot) = fan.node.iter().position(|node| usize::from(*node) == m) else { return false };
    slot = usize::from(fan.parent[slot]);
    while slot != 0 {
        let node = usize::from(fan.node[slot]);
        if !p.free.contains(i, node) && !p.free.contains(i - 1, node) {
            return false;
        }
        slot = usize::from(fan.parent[slot]);
    }
    true
}

/// J of a sequence; `None` where it breaks a constraint.
fn total_of(p: &Problem, sequence: &[usize]) -> Option<f64> {
    (0..sequence.len()).try_fold(0.0, |sum, i| {
        let n = sequence[i];
        if !p.free.contains(i, n) || (i > 0 && !may_turn(p, i, sequence[i - 1], n)) {
            return None;
        }
        let turn = if i > 0 { p.directions.angle_rad(sequence[i - 1], n) } else { 0.0 };
        let own = f64::from(p.cost[i * p.directions.len() + n]) * p.length_mm[i];
        Some(match p.turns.price {
            TurnPrice::Smoothness(weight_mm) => {
                sum + own + weight_mm.max(1e-6) * turn * turn / p.length_mm[i]
            }
            TurnPrice::Time(TurnTime { rate_rad_s, acceleration_rad_s2, factor }) => {
                let seconds = factor * (turn / rate_rad_s).max((turn / acceleration_rad_s2).sqrt());
                // before the first waypoint nothing turns
                sum + own.max(seconds) + 2.0 * factor * turn * turn / p.length_mm[i]
            }
        })
    })
}

/// The least J over every sequence.
fn brute_force(p: &Problem) -> Option<f64> {
    let (k, n) = (p.directions.len(), p.free.len());
    let at = |code: usize| (0..n).map(|i| code / k.pow(i as u32) % k).collect::<Vec<_>>();
    (0..k.pow(n as u32)).filter_map(|code| total_of(p, &at(code))).min_by(f64::total_cmp)
}

proptest! {
    #![proptest_config(bonemill_geometry::fixed!(192))]

    /// Tested for up to 6 waypoints and up to 8 directions, with one angle and with two, with forbidden turns.
    #[test]
    fn finds_the_optimum_of_every_sequence(
        in_plane in any::<bool>(), half in 1usize..4, n in 1usize..=6,
        cost in prop::collection::vec(0.0f32..1.0, 48),
        free in prop::collection::vec(prop::collection::vec(prop::bool::weighted(0.7), 8), 6),
        length_mm in prop::collection::vec(0.1f64..1.5, 6),
        weight_mm in 0.0f64..3.0, most_rad_per_mm in 0.05f64..1.0,
        timed in prop::option::of((0.1f64..2.0, 0.5f64..10.0, 0.3f64..3.0)),
        bans in prop::collection::vec((1usize..6, 0u16..7, 0u16..7), 0..12),
    ) {
        let directions = sets(in_plane, 2 * half + 1);
        let k = directions.len();
        // at most 7⁶ sequences
        let n = n.min(if k > 5 { 5 } else { 6 });
        let price = timed.map_or(TurnPrice::Smoothness(weight_mm), |(rate_rad_s, acceleration_rad_s2, factor)| {
            TurnPrice::Time(TurnTime { rate_rad_s, acceleration_rad_s2, factor })
        });
        let mut forbidden = Forbidden::default();
        bans.iter().for_each(|(i, a, b)| forbidden.insert(*i, *a, *b));
        let problem = Problem {
            directions: &directions,
            cost: &cost[..n * k],
            free: &FreeSets::fill(n, k, |i, d| free[i][d]),
            length_mm: &length_mm[..n],
            turns: TurnLimits { price, most_rad_per_mm },
            forbidden: &forbidden,
        };
        let blocked = blocked_waypoints(&problem);
        match (best_sequence(&problem), brute_force(&problem)) {
            // a blocked waypoint cannot be reached from the start or from the last blocked waypoint
            (BestSequence::Blocked(i), None) => {
                prop_assert_eq!(blocked[0], i);
                for pair in blocked.windows(2).filter(|pair| pair[0] + 1 < pair[1]) {
                    let from = pair[0] + 1;
                    let reaches = |to: usize| {
                        let part = Problem {
                            cost: &cost[from * k..to * k],
                            free: &FreeSets::fill(to - from, k, |i, d| free[from + i][d]),
                            length_mm: &length_mm[from..to],
                            forbidden: &forbidden.from(from),
                            ..problem
                        };
                        brute_force(&part).is_some()
                    };
                    prop_assert!(reaches(pair[1]) && !reaches(pair[1] + 1));
                }
            }
            (BestSequence::Sequence { .. }, _) if !blocked.is_empty() => prop_assert!(false, "{blocked:?}"),
            (BestSequence::Sequence { directions, total, .. }, Some(expected)) => {
                let sequence: Vec<usize> = directions.iter().map(|d| usize::from(*d)).collect();
                let own = total_of(&problem, &sequence);
                prop_assert!(own.is_some(), "breaks a constraint: {sequence:?}");
                prop_assert!((own.unwrap() - expected).abs() < 1e-9, "{own:?} {expected}");
                prop_assert!((total - expected).abs() < 1e-6);
            }
            (found, expected) => prop_assert!(false, "{found:?} {expected:?}"),
        }
    }
}

impl Forbidden {
    /// The problem from waypoint `first` on.
    fn from(&self, first: usize) -> Self {
        let later = self.0.iter().filter(|(i, _)| **i as usize > first);
        Self(later.map(|(i, turns)| (i - first as u32, turns.clone())).collect())
    }
}

/// Solves a problem of `n` waypoints over the plane's 7 directions or the cap's 7.
fn solve(in_plane: bool, n: usize, cost: &[f32], free: impl Fn(usize, usize) -> bool + Sync) -> BestSequence {
    let directions = sets(in_plane, 7);
    best_sequence(&Problem {
        directions: &directions,
        cost,
        free: &FreeSets::fill(n, 7, free),
        length_mm: &vec![0.25; n],
        turns: TurnLimits { price: TurnPrice::Smoothness(1.0), most_rad_per_mm: 0.4 },
        forbidden: &Forbidden::default(),
    })
}

fn directions_of(found: BestSequence) -> Vec<u16> {
    match found {
        BestSequence::Sequence { directions, .. } => directions,
        BestSequence::Blocked(i) => panic!("blocked at {i}"),
    }
}

#[test]
fn six_waypoints_by_seven_directions() {
    let directions = sets(false, 7);
    let cost: Vec<f32> = (0..42).map(|n| ((n * 37) % 17) as f32 / 17.0).collect();
    let problem = Problem {
        directions: &directions,
        cost: &cost,
        free: &FreeSets::fill(6, 7, |i, n| (i + n) % 4 != 3),
        length_mm: &[0.3; 6],
        turns: TurnLimits { price: TurnPrice::Smoothness(0.2), most_rad_per_mm: 0.4 },
        forbidden: &Forbidden::default(),
    };
    let BestSequence::Sequence { total, .. } = best_sequence(&problem) else { panic!("blocked") };
    assert!((total - brute_force(&problem).unwrap()).abs() < 1e-7);
}

#[test]
fn constant_cost_stands_still_and_upright() {
    assert_eq!(directions_of(solve(true, 10, &[0.3; 70], |_, _| true)), [3; 10]);
    assert_eq!(directions_of(solve(false, 10, &[0.3; 70], |_, _| true)), [0; 10]);
    // the approach is blocked at one waypoint: the axis leaves it once and does not come back
    let found = directions_of(solve(true, 10, &[0.3; 70], |i, n| i != 5 || n != 3));
    assert_eq!(found[0], found[9]);
    assert!(found.windows(2).all(|w| w[0] == w[1]) && found[0].abs_diff(3) == 1);
}

#[test]
fn without_a_rate_weight_ties_still_go_to_the_smaller_turn() {
    let directions = sets(true, 7);
    let problem = Problem {
        directions: &directions,
        cost: &[0.0; 70],
        free: &FreeSets::fill(10, 7, |_, _| true),
        length_mm: &[0.25; 10],
        turns: TurnLimits { price: TurnPrice::Smoothness(0.0), most_rad_per_mm: 0.4 },
        forbidden: &Forbidden::default(),
    };
    assert_eq!(directions_of(best_sequence(&problem)), [3; 10]);
}

#[test]
fn an_empty_waypoint_is_named() {
    assert_eq!(solve(true, 6, &[0.0; 42], |i, _| i != 4), BestSequence::Blocked(4));
    assert_eq!(solve(false, 6, &[0.0; 42], |i, _| i != 0), BestSequence::Blocked(0));
}

#[test]
fn no_waypoint_and_one() {
    assert!(directions_of(solve(true, 0, &[], |_, _| true)).is_empty());
    let mut cost = [1.0; 7];
    cost[5] = 0.0;
    assert_eq!(directions_of(solve(false, 1, &cost, |_, _| true)), [5]);
}

/// Two parts with a gap that is never free: no sequence jumps over it, whatever the costs.
#[test]
fn a_free_set_in_two_pieces_is_not_jumped() {
    let cost: Vec<f32> =
        (0..20).flat_map(|i| (0..7).map(move |n| if (n < 3) == (i < 10) { 0.0 } else { 1.0 })).collect();
    let found = directions_of(solve(true, 20, &cost, |_, n| n != 3));
    assert!(found.iter().all(|n| *n < 3) || found.iter().all(|n| *n > 3), "{found:?}");
    // where the gap is open, it is crossed step by step
    let found = directions_of(solve(true, 20, &cost, |i, n| n != 3 || (8..12).contains(&i)));
    assert!(found[0] < 3 && found[19] > 3 && found.contains(&3), "{found:?}");
}

#[test]
fn a_million_waypoints() {
    let (n, directions) = (1_000_000, sets(true, 5));
    let cost: Vec<f32> = (0..5 * n).map(|k| ((k * 31) % 101) as f32 / 101.0).collect();
    let problem = Problem {
        directions: &directions,
        cost: &cost,
        free: &FreeSets::fill(n, 5, |i, d| (i / 7 + d) % 6 != 0),
        length_mm: &vec![0.25; n],
        turns: TurnLimits { price: TurnPrice::Smoothness(1.0), most_rad_per_mm: 0.4 },
        forbidden: &Forbidden::default(),
    };
    let BestSequence::Sequence { directions: found, total, edges } = best_sequence(&problem) else {
        panic!("blocked")
    };
    let sequence: Vec<usize> = found.iter().map(|d| usize::from(*d)).collect();
    // the total of a million terms agrees with the sequence's own J
    let own = total_of(&problem, &sequence).unwrap();
    assert!((own - total).abs() < 1e-6 * own && edges > 5_000_000, "{own} {total} {edges}");
}
