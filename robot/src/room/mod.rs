//! The arm's links among what stands in the room: distances that are certain, at a posture and on the way between two.
//!
//! Links are capsules that enclose the link's mesh ([`ArmLinks`]); obstacles give a bound on the distance of any point
//! ([`Obstacle`]). The least distance of a capsule's axis from an obstacle is found by halving the axis: a piece of half length h
//! with the bound d at its middle is nowhere nearer than d − h. Links and handpiece are held apart in closed form.
//!
//! Between two joint vectors the arm moves straight in joint space, and no point of link k moves more than Mₖ = Σⱼ |Δqⱼ| Rⱼₖ. A
//! distance d₀ before and d₁ after then means that it is nowhere below (d₀ + d₁ − Mₖ)/2 on the way; where that does not suffice
//! the move is halved ([`Room::along`]). So no posture between two is missed.
//!
//! Everything errs to the safe side: no distance that is given exceeds the true one. The base is held against other links only,
//! the handpiece against everything but the patient. Where an arm's shapes are not known there is no [`Room`].

mod head;
mod links;
mod motion;
mod obstacle;

pub use bonemill_arm::ur::links::link_name;
pub use head::Head;
pub use links::{ArmLinks, HANDPIECE, Handpiece, LINKS};
pub use motion::{Least, LinkMotion};
pub use obstacle::{Obstacle, Shape};

use bonemill_arm::Arm;
use bonemill_geometry::{Base, Point};
use links::{Joints, PlacedLinks};

/// Pieces of an axis are halved until the bound is off by at most this, plus a share of the distance, mm.
const PIECE_MM: f64 = 0.5;
const PIECE_SHARE: f64 = 0.1;
/// Beyond so many clearances more distance is not preferred.
const PREFERRED: f64 = 4.0;

/// What a link is nearest to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Other {
    /// An obstacle, by its place in the list.
    Obstacle(usize),
    /// Another link.
    Link(usize),
}

/// A link and what it is nearest to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nearest {
    /// At most their true distance, mm.
    pub distance_mm: f64,
    /// The link.
    pub link: usize,
    /// What is near; `None` where nothing is nearer than was asked for.
    pub other: Option<Other>,
}

/// An arm's links and what stands around them.
#[derive(Debug, Clone)]
pub struct Room {
    links: ArmLinks,
    obstacles: Vec<Obstacle>,
    clearance_mm: f64,
}

impl Room {
    /// The room of an arm; `None` for an arm whose shapes are not known.
    pub fn new(
        arm: &Arm,
        handpiece: &Handpiece,
        obstacles: Vec<Obstacle>,
        clearance_mm: f64,
    ) -> Option<Self> {
        let links = ArmLinks::of(arm, handpiece)?;
        Some(Self { links, obstacles, clearance_mm })
    }

    /// The distance that every link keeps, mm.
    pub fn clearance_mm(&self) -> f64 {
        self.clearance_mm
    }

    /// What stands in the room.
    pub fn obstacles(&self) -> &[Obstacle] {
        &self.obstacles
    }

    /// The distance up to which more is better, mm.
    pub fn preferred_mm(&self) -> f64 {
        PREFERRED * self.clearance_mm
    }

    /// The name of what a link is near.
    pub fn name(&self, other: Option<Other>) -> String {
        match other {
            Some(Other::Obstacle(n)) => self.obstacles.get(n).map_or(String::new(), |o| o.name.clone()),
            Some(Other::Link(link)) => format!("the arm's {}", link_name(link)),
            None => "nothing".into(),
        }
    }

    /// The link that is nearest to anything, or `cap_mm` where none is nearer. `None` where `q` has not six values.
    pub fn nearest(&self, q: &[f64], cap_mm: f64) -> Option<Nearest> {
        let q: &Joints = q.try_into().ok()?;
        let placed = self.links.place(q);
        let mut least = Nearest { distance_mm: cap_mm, link: 0, other: None };
        for link in 1..LINKS {
            self.of_link(&placed, link, &mut least);
        }
        Some(least)
    }

    /// Lowers `least` to a link's distance from obstacles and from the links before it.
    fn of_link(&self, placed: &PlacedLinks<'_>, link: usize, least: &mut Nearest) {
        let (at, radius_mm) = placed.ball(link);
        let allowance_mm = self.links.allowance_mm;
        for (n, obstacle) in self.obstacles.iter().enumerate() {
            if link == HANDPIECE && !obstacle.is_for_handpiece() {
                continue;
            }
            let asked_mm = least.distance_mm + allowance_mm;
            if obstacle.at_least_mm(&at) - radius_mm >= asked_mm {
                continue;
            }
            let found_mm = placed.capsules(link).fold(asked_mm, |asked_mm, capsule| {
                let ends = [capsule.from, capsule.to];
                let bound = |p: &Point<Base>| obstacle.at_least_mm(p) - capsule.radius_mm;
                least_along(&bound, ends, asked_mm)
            });
            if found_mm < asked_mm {
                *least =
                    Nearest { distance_mm: found_mm - allowance_mm, link, other: Some(Other::Obstacle(n)) };
            }
        }
        for (other, _) in self.links.pairs.iter().filter(|(_, k)| *k == link) {
            let asked_mm = least.distance_mm + 2.0 * allowance_mm;
            let found_mm = placed.between_mm(*other, link, asked_mm);
            if found_mm < asked_mm {
                let distance_mm = found_mm - 2.0 * allowance_mm;
                *least = Nearest { distance_mm, link, other: Some(Other::Link(*other)) };
            }
        }
    }
}

/// The least value of a bound along a segment, at most `asked_mm`. The bound is of a distance, so it falls by at most the way.
fn least_along(bound: &impl Fn(&Point<Base>) -> f64, [from, to]: [Point<Base>; 2], asked_mm: f64) -> f64 {
    let half_mm = 0.5 * from.distance_mm(&to);
    let middle = Point::from_coords(0.5 * (from.coords + to.coords));
    let value = bound(&middle);
    if value - half_mm >= asked_mm {
        return asked_mm;
    }
    if half_mm <= PIECE_MM + PIECE_SHARE * value.max(0.0) {
        return value - half_mm;
    }
    let asked_mm = least_along(bound, [from, middle], asked_mm);
    least_along(bound, [middle, to], asked_mm)
}

#[cfg(test)]
mod tests;
