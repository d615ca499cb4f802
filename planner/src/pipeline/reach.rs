//! Waypoints that the shank cannot get to are dropped, and the rest is joined anew.
//!
//! Dropping a waypoint leaves its bone in place, which may close another's way: the loop repeats until every waypoint
//! has a free angle and a sequence of angles leads through all of them.

use std::collections::{BTreeMap, HashSet};

use bonemill_geometry::{Point, Work};
use bonemill_imaging::Scene;
use nalgebra::Vector3;
use rayon::prelude::*;

use crate::access::{Access, Blocked, ShankCylinder};
use crate::orientation::Scan;
use crate::orientation::optimal::{RateLimit, Sequence, best_sequence};
use crate::path::{MillPath, MoveKind, PathPoint, PathSpacing, join_passes, without_points};
use crate::space::BurrSpace;

use super::known::{KnownAngles, Round};

/// Rounds of dropping before the planner gives up; each drops at least one waypoint, few are usual.
const MOST_ROUNDS: usize = 30;

/// A path whose every waypoint the shank can reach.
#[derive(Debug)]
pub struct ReachedPath<'a> {
    /// The path.
    pub path: MillPath,
    /// The access test for it.
    pub access: Access<'a>,
    /// Bit n: angle n of the scan is free at the waypoint, and within the tilt limit where it cuts.
    pub free: Vec<u128>,
    /// Length of the move that ends at each waypoint, mm.
    pub length_mm: Vec<f64>,
    /// Waypoints dropped, by what stands in the way.
    pub dropped: BTreeMap<&'static str, usize>,
}

/// What access depends on.
#[derive(Debug, Clone, Copy)]
pub struct ReachSpec<'a> {
    /// The shank.
    pub shank: &'a [ShankCylinder],
    /// One per structure.
    pub shank_clearances_mm: &'a [f64],
    /// Angles to choose from.
    pub scan: &'a Scan,
    /// How fast angles may change.
    pub rate: RateLimit,
    /// For joining passes anew.
    pub spacing: PathSpacing,
}

/// Drops what cannot be reached; `None` when nothing settles or nothing is left.
pub fn reached<'a>(
    scene: &'a Scene,
    space: &BurrSpace,
    mut path: MillPath,
    spec: &ReachSpec,
) -> Option<ReachedPath<'a>> {
    let mut dropped = BTreeMap::new();
    let mut before: Option<Round> = None;
    for _ in 0..MOST_ROUNDS {
        if path.points.is_empty() {
            return None;
        }
        let access = Access::new(scene, &path.removal, spec.shank, spec.shank_clearances_mm);
        let known = before.as_ref().map(|round| round.known_of(scene, &path));
        let free = free_angles(&access, &path.points, spec, known.as_ref());
        let length_mm = lengths(&path.points);
        let blocked = blocked_waypoints(&free, &length_mm, spec);
        if blocked.is_empty() {
            return Some(ReachedPath { path, access, free, length_mm, dropped });
        }
        let mut points = HashSet::new();
        for i in blocked {
            if points.insert(path.points[i].leads_to) {
                let why = reason(&access, i as u32, path.points[i].position, free[i] == 0);
                *dropped.entry(why).or_insert(0) += 1;
            }
        }
        let next = join_passes(space, spec.spacing, without_points(&path.passes, &points), path.layers);
        before = Some(Round { path, free, dropped: points });
        path = next;
    }
    None
}

/// Lengths of the moves, the first 0, mm.
pub fn lengths(points: &[PathPoint]) -> Vec<f64> {
    let moves = points.windows(2).map(|w| w[0].position.distance_mm(&w[1].position));
    std::iter::once(0.0).chain(moves).take(points.len()).collect()
}

fn free_angles(
    access: &Access,
    points: &[PathPoint],
    spec: &ReachSpec,
    known: Option<&KnownAngles>,
) -> Vec<u128> {
    let scan = spec.scan;
    points
        .par_iter()
        .enumerate()
        .map(|(i, p)| {
            let allowed = if p.kind == MoveKind::Cut { scan.within_limit } else { u128::MAX };
            let known = known.and_then(|k| k.free[i].map(|free| (free, k)));
            let mut free = 0;
            for (n, axis) in scan.axes.iter().enumerate().filter(|(n, _)| allowed >> n & 1 == 1) {
                let is_free = match known {
                    // less is removed than before: what was blocked stays so
                    Some((before, _)) if before >> n & 1 == 0 => false,
                    Some((_, known)) if !known.may_have_changed(p.position, axis, spec.shank) => true,
                    _ => access.is_free(i as u32, p.position, axis),
                };
                if is_free {
                    free |= 1 << n;
                }
            }
            free
        })
        .collect()
}

/// Waypoints without a free angle; if there are none, the first that no sequence of angles gets to.
fn blocked_waypoints(free: &[u128], length_mm: &[f64], spec: &ReachSpec) -> Vec<usize> {
    let empty: Vec<usize> = (0..free.len()).filter(|i| free[*i] == 0).collect();
    if !empty.is_empty() {
        return empty;
    }
    let no_cost = vec![0.0; free.len() * spec.scan.len()];
    match best_sequence(spec.scan, &no_cost, free, length_mm, spec.rate) {
        Sequence::Found(_) => Vec::new(),
        Sequence::Blocked(i) => vec![i],
    }
}

fn reason(access: &Access, index: u32, center: Point<Work>, no_angle: bool) -> &'static str {
    if !no_angle {
        return "no way to turn the shaft there";
    }
    match access.blocked(index, center, &Vector3::z()) {
        Some(Blocked::NotYetRemoved { .. }) => "shank would meet bone that is not yet removed",
        Some(Blocked::Obstacle { .. }) => "shank would meet untargeted bone or a structure",
        None => "tilt limit",
    }
}
