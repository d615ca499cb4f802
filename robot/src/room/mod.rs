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
//! Everything errs to the safe side: no distance that is given exceeds the true one. Links of a calibrated arm are placed by the
//! nominal kinematics, and one and a half times their largest deviation in 500 random postures is taken off: for these arms the
//! statement is as good as that sample.
//!
//! The base does not move: its distance is found once ([`Room::base`]). It stands wholly above its mounting plane, so that what does
//! not reach above the plane, such as the table it stands on, is not held against it. The handpiece is held against everything but the
//! patient. Where an arm's shapes are not known there is no [`Room`].

mod head;
mod links;
mod motion;
mod obstacle;

pub use bonemill_arm::ur::links::link_name;
pub use head::Head;
pub use links::{ArmLinks, BASE, HANDPIECE, Handpiece, LINKS};
pub use motion::{Least, LinkMotion};
pub use obstacle::{Obstacle, Shape};

use bonemill_arm::Arm;
use bonemill_geometry::{Base, Point};
use links::{Joints, PlacedLinks};

/// Pieces of an axis are halved until the bound is off by at most this, plus a share of the distance, mm.
const PIECE_MM: f64 = 0.5;
const PIECE_SHARE: f64 = 0.05;
/// Half length of the pieces by which a whole link is tested, mm.
const COARSE_MM: f64 = 20.0;
/// Postures are chosen with so much more than the clearance, mm: what the bounds at a posture and along a move may lose.
const KEPT_BEYOND_MM: f64 = 1.5;
/// Beyond so many clearances more distance is not preferred.
const PREFERRED: f64 = 4.0;
/// Distances beyond this are not told apart, mm.
const CAP_MM: f64 = 200.0;

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
    /// What the base is nearest to.
    base: Nearest,
}

impl Room {
    /// The room of an arm; `None` for an arm whose shapes are not known.
    pub fn new(
        arm: &Arm,
        handpiece: &Handpiece,
        obstacles: Vec<Obstacle>,
        clearance_mm: f64,
    ) -> Option<Self> {
        Some(Self::with(ArmLinks::of(arm, handpiece)?, obstacles, clearance_mm))
    }

    fn with(links: ArmLinks, obstacles: Vec<Obstacle>, clearance_mm: f64) -> Self {
        let base = Nearest { distance_mm: CAP_MM, link: BASE, other: None };
        let mut room = Self { links, obstacles, clearance_mm, base };
        let mut least = base;
        room.of_link(&room.links.place(&[0.0; 6]), BASE, f64::NEG_INFINITY, &mut least);
        room.base = least;
        room
    }

    /// The same arm among other obstacles.
    pub fn among(&self, obstacles: Vec<Obstacle>) -> Self {
        Self::with(self.links.clone(), obstacles, self.clearance_mm)
    }

    /// What the base is nearest to among patient and obstacles, wherever the joints are.
    pub fn base(&self) -> &Nearest {
        &self.base
    }

    /// The distance that every link keeps, mm.
    pub fn clearance_mm(&self) -> f64 {
        self.clearance_mm
    }

    /// The distance that postures are chosen with, mm: the clearance and what bounds may lose.
    pub fn kept_mm(&self) -> f64 {
        self.clearance_mm + KEPT_BEYOND_MM
    }

    /// What stands in the room.
    pub fn obstacles(&self) -> &[Obstacle] {
        &self.obstacles
    }

    /// The distance up to which more is better, mm.
    pub fn preferred_mm(&self) -> f64 {
        PREFERRED * self.clearance_mm + KEPT_BEYOND_MM
    }

    /// The name of what a link is near.
    pub fn name(&self, other: Option<Other>) -> String {
        match other {
            Some(Other::Obstacle(n)) => self.obstacles.get(n).map_or(String::new(), |o| o.name.clone()),
            Some(Other::Link(link)) => format!("the arm's {}", link_name(link)),
            None => "nothing".into(),
        }
    }

    /// The moving link that is nearest to anything, or `cap_mm` where none is nearer; the first that is found below `enough_mm`. `None`
    /// where `q` has not six values.
    pub fn nearest(&self, q: &[f64], [enough_mm, cap_mm]: [f64; 2]) -> Option<Nearest> {
        let q: &Joints = q.try_into().ok()?;
        let placed = self.links.place(q);
        let mut least = Nearest { distance_mm: cap_mm, link: 0, other: None };
        // the outer links first: they are where the work is
        for link in (1..LINKS).rev() {
            self.of_link(&placed, link, enough_mm, &mut least);
            if least.distance_mm < enough_mm {
                break;
            }
        }
        Some(least)
    }

    /// Lowers `least` to a link's distance from obstacles and from the links before it, or to any that is below `enough_mm`.
    fn of_link(&self, placed: &PlacedLinks<'_>, link: usize, enough_mm: f64, least: &mut Nearest) {
        // the base is where it is said to be, of a calibrated arm too
        let allowance_mm = if link == BASE { 0.0 } else { self.links.allowance_mm };
        for (other, _) in self.links.pairs.iter().filter(|(_, k)| *k == link) {
            let asked_mm = least.distance_mm + 2.0 * allowance_mm;
            let found_mm = placed.between_mm(*other, link, asked_mm);
            if found_mm < asked_mm {
                let distance_mm = found_mm - 2.0 * allowance_mm;
                *least = Nearest { distance_mm, link, other: Some(Other::Link(*other)) };
            }
        }
        for (n, obstacle) in self.obstacles.iter().enumerate() {
            if least.distance_mm < enough_mm {
                return;
            }
            let is_held = match link {
                BASE => obstacle.is_above_mount(),
                HANDPIECE => obstacle.is_for_handpiece(),
                _ => true,
            };
            if !is_held {
                continue;
            }
            let asked_mm = least.distance_mm + allowance_mm;
            let search = Search { obstacle, radius_mm: 0.0, enough_mm: enough_mm + allowance_mm };
            let found_mm = search.of(placed, link, asked_mm);
            if found_mm < asked_mm {
                *least =
                    Nearest { distance_mm: found_mm - allowance_mm, link, other: Some(Other::Obstacle(n)) };
            }
        }
    }
}

/// The search for the least distance of a capsule from an obstacle.
#[derive(Clone, Copy)]
struct Search<'a> {
    obstacle: &'a Obstacle,
    /// Of the capsule, mm.
    radius_mm: f64,
    /// Any distance below this ends the search, mm.
    enough_mm: f64,
}

impl Search<'_> {
    /// A link's distance, at most `asked_mm`.
    fn of(&self, placed: &PlacedLinks<'_>, link: usize, asked_mm: f64) -> f64 {
        let (whole, (middle, ball_mm)) = (placed.whole(link), placed.ball(link));
        if self.obstacle.at_least_mm(&middle, asked_mm + ball_mm) - ball_mm >= asked_mm {
            return asked_mm;
        }
        let of_whole = Self { radius_mm: whole.radius_mm, ..*self };
        if of_whole.is_beyond([whole.from, whole.to], asked_mm) {
            return asked_mm;
        }
        let mut least = asked_mm;
        for capsule in placed.capsules(link) {
            let of_piece = Self { radius_mm: capsule.radius_mm, ..*self };
            let ends = [capsule.from, capsule.to];
            least = if self.obstacle.is_convex() {
                of_piece.least_of_convex(ends, least)
            } else {
                of_piece.least_along(ends, least)
            };
            if least < self.enough_mm {
                break;
            }
        }
        least
    }

    /// A bound on the distance of the capsule's surface about a point of its axis, mm, or any that is at least `plenty_mm`.
    fn bound_mm(&self, p: &Point<Base>, plenty_mm: f64) -> f64 {
        self.obstacle.at_least_mm(p, plenty_mm + self.radius_mm) - self.radius_mm
    }

    /// Whether the distance is nowhere below `asked_mm` along an axis; `false` where that is not certain.
    fn is_beyond(&self, [from, to]: [Point<Base>; 2], asked_mm: f64) -> bool {
        let half_mm = 0.5 * from.distance_mm(&to);
        let middle = between(from, to, 0.5);
        let value = self.bound_mm(&middle, asked_mm + half_mm);
        if value - half_mm >= asked_mm {
            return true;
        }
        value >= asked_mm
            && half_mm > COARSE_MM
            && self.is_beyond([from, middle], asked_mm)
            && self.is_beyond([middle, to], asked_mm)
    }

    /// The least distance along an axis, at most `asked_mm`. A bound of a distance falls by at most the way.
    fn least_along(&self, [from, to]: [Point<Base>; 2], asked_mm: f64) -> f64 {
        let half_mm = 0.5 * from.distance_mm(&to);
        let middle = between(from, to, 0.5);
        let value = self.bound_mm(&middle, asked_mm + half_mm);
        if value - half_mm >= asked_mm {
            return asked_mm;
        }
        if value < self.enough_mm || half_mm <= PIECE_MM + PIECE_SHARE * value.max(0.0) {
            return value - half_mm;
        }
        let asked_mm = self.least_along([from, middle], asked_mm);
        if asked_mm < self.enough_mm { asked_mm } else { self.least_along([middle, to], asked_mm) }
    }

    /// The same for a distance that is convex along the axis: the least value lies between the neighbours of the least of three.
    fn least_of_convex(&self, [from, to]: [Point<Base>; 2], asked_mm: f64) -> f64 {
        let mut length_mm = from.distance_mm(&to);
        let (mut low, mut high, mut middle) = (from, to, between(from, to, 0.5));
        let mut value = self.bound_mm(&middle, asked_mm + length_mm);
        loop {
            if value - 0.5 * length_mm >= asked_mm {
                return asked_mm;
            }
            if value < self.enough_mm || 0.5 * length_mm <= PIECE_MM + PIECE_SHARE * value.max(0.0) {
                return value - 0.5 * length_mm;
            }
            let quarters = [between(low, middle, 0.5), between(middle, high, 0.5)];
            let [before, after] = quarters.map(|p| self.bound_mm(&p, f64::INFINITY));
            (low, middle, high, value) = if before < value {
                (low, quarters[0], middle, before)
            } else if after < value {
                (middle, quarters[1], high, after)
            } else {
                (quarters[0], middle, quarters[1], value)
            };
            length_mm *= 0.5;
        }
    }
}

/// The point at a share of the way.
fn between(from: Point<Base>, to: Point<Base>, share: f64) -> Point<Base> {
    from + (to - from) * share
}

#[cfg(test)]
mod tests;
