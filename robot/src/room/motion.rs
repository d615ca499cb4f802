//! The least distance of the links along a joint path, between its places too.

use rayon::prelude::*;

use super::links::Joints;
use super::{BASE, CAP_MM, LINKS, Nearest, Room};

/// A move is halved until its bound is this near to the least distance at a place, mm, or until it is too short to matter.
const SHORT_MM: f64 = 0.5;
/// Halvings of a move at most.
const HALVINGS: u32 = 12;

/// The least distance along a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Least {
    /// Which link, what it is near, and a distance that it nowhere falls below, mm.
    pub nearest: Nearest,
    /// The place at which the move ends on which that is.
    pub place: usize,
}

/// Distances of each link from obstacles and from the links before it, at one joint vector.
type ByLink = [Nearest; LINKS];

/// A joint path through a room.
#[derive(Debug, Clone, Copy)]
pub struct LinkMotion<'a> {
    /// Joint vectors, rad, shape (places × 6); the arm moves straight in joint space between them.
    pub q: &'a [f64],
}

impl Room {
    /// The least distance along a joint path, the base's included; `None` without a place.
    pub fn along(&self, motion: LinkMotion<'_>) -> Option<Least> {
        let places: Vec<Joints> =
            motion.q.chunks_exact(6).map(|q| std::array::from_fn(|joint| q[joint])).collect();
        let by_link: Vec<ByLink> = places.par_iter().map(|q| self.by_link(q)).collect();
        let least = |at: &ByLink| at.iter().map(|n| n.distance_mm).fold(f64::INFINITY, f64::min);
        let sampled_mm = by_link.iter().map(least).fold(f64::INFINITY, f64::min);
        let enough_mm = sampled_mm - SHORT_MM;
        let first = Least { nearest: nearest_of(by_link.first()?), place: 0 };
        let moves = (1..places.len()).into_par_iter().map(|place| {
            let (from, to) = ((&places[place - 1], &by_link[place - 1]), (&places[place], &by_link[place]));
            Least { nearest: self.between(from, to, enough_mm, HALVINGS), place }
        });
        // the first of equal ones, whatever the threads
        let moves: Vec<Least> = moves.collect();
        moves.into_iter().chain([first]).min_by(|a, b| {
            let order = a.nearest.distance_mm.total_cmp(&b.nearest.distance_mm);
            order.then(a.place.cmp(&b.place))
        })
    }

    /// A bound on the distance on the way between two joint vectors: at least `enough_mm`, or as near to the truth as it gets.
    fn between(
        &self,
        from: (&Joints, &ByLink),
        to: (&Joints, &ByLink),
        enough_mm: f64,
        halvings: u32,
    ) -> Nearest {
        let bound = |link: usize| {
            let moved_mm = self.links.most_moved_mm(link, from.0, to.0);
            let (a, b) = (from.1[link], to.1[link]);
            let nearer = if a.distance_mm <= b.distance_mm { a } else { b };
            // the bound of a link that does not move is its distance
            let distance_mm = nearer.distance_mm.min(0.5 * (a.distance_mm + b.distance_mm - moved_mm));
            (Nearest { distance_mm, ..nearer }, moved_mm)
        };
        let bounds = (BASE + 1..LINKS).map(bound);
        let worst = bounds.min_by(|a, b| a.0.distance_mm.total_cmp(&b.0.distance_mm));
        let Some((nearest, moved_mm)) = worst else { return nearest_of(to.1) };
        if nearest.distance_mm >= enough_mm || moved_mm < SHORT_MM || halvings == 0 {
            return nearest;
        }
        let middle: Joints = std::array::from_fn(|joint| 0.5 * (from.0[joint] + to.0[joint]));
        let at_middle = self.by_link(&middle);
        let halves = [(from, (&middle, &at_middle)), ((&middle, &at_middle), to)]
            .map(|(from, to)| self.between(from, to, enough_mm, halvings - 1));
        if halves[0].distance_mm <= halves[1].distance_mm { halves[0] } else { halves[1] }
    }

    fn by_link(&self, q: &Joints) -> ByLink {
        let placed = self.links.place(q);
        std::array::from_fn(|link| {
            if link == BASE {
                return *self.base();
            }
            let mut least = Nearest { distance_mm: CAP_MM, link, other: None };
            self.of_link(&placed, link, f64::NEG_INFINITY, &mut least);
            least
        })
    }
}

/// The nearest of all links.
fn nearest_of(by_link: &ByLink) -> Nearest {
    let order = |a: &&Nearest, b: &&Nearest| a.distance_mm.total_cmp(&b.distance_mm);
    by_link.iter().min_by(order).copied().unwrap_or(by_link[0])
}
