//! A UR's links and handpiece as capsules, where they are, and how far they can move.

use bonemill_arm::Arm;
use bonemill_arm::arm::{InverseKind, Mount};
use bonemill_arm::ur::links::{LINKS_AND_HANDPIECE, pairs_held_apart};
use bonemill_arm::ur::{UrGeometry, UrModel};
use bonemill_geometry::{Base, Capsule, Link, Point, Rigid};
use nalgebra::Vector3;
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::{RngCore, SeedableRng};

/// Links: the base, those of the six joints, and the handpiece, which moves with the last.
pub const LINKS: usize = LINKS_AND_HANDPIECE;
/// The base's place among the links.
pub const BASE: usize = 0;
/// The handpiece's place among the links.
pub const HANDPIECE: usize = LINKS - 1;

/// A joint vector of a UR.
pub(super) type Joints = [f64; 6];

/// A handpiece as capsules in the tool's frame: origin at the burr's centre, z along the shaft.
pub type Handpiece = Vec<Capsule<bonemill_geometry::Tool>>;

/// The links of an arm.
#[derive(Debug, Clone)]
pub struct ArmLinks {
    geometry: UrGeometry,
    capsules: [Vec<Capsule<Link>>; LINKS],
    /// One capsule about each link's capsules.
    whole: [Capsule<Link>; LINKS],
    /// Radius of a ball about that capsule, mm.
    ball_mm: [f64; LINKS],
    /// Bound on the distance of a link's points from a joint's axis, mm, by link and joint; 0 for joints that do not move it.
    reach_mm: [[f64; 6]; LINKS],
    /// Pairs of links that are held apart.
    pub(super) pairs: Vec<(usize, usize)>,
    /// By how much links of a calibrated arm are elsewhere, mm.
    pub(super) allowance_mm: f64,
}

/// Links where they are.
pub(super) struct PlacedLinks<'a> {
    links: &'a ArmLinks,
    /// A capsule that holds all of each link, and its middle.
    whole: [(Capsule<Base>, Point<Base>); LINKS],
    poses: [Rigid<Base, Link>; LINKS],
}

impl ArmLinks {
    /// The links of a UR; `None` for an arm whose shapes are not known, or that holds no tool.
    pub fn of(arm: &Arm, handpiece: &Handpiece) -> Option<Self> {
        let (InverseKind::Ur { geometry, calibrated }, Mount::Tool(mount)) =
            (arm.inverse_kind(), arm.mount())
        else {
            return None;
        };
        let model = UrModel::ALL.into_iter().find(|model| model.geometry() == geometry)?;
        let shapes = model.link_capsules();
        let flange_from_link =
            Rigid::<Link, Link>::new(nalgebra::Rotation3::identity(), Vector3::new(0.0, 0.0, geometry.d6_mm));
        let link_from_burr = flange_from_link
            * Rigid::<Link, bonemill_geometry::Tool>::new(
                mount.flange_from_burr.rotation,
                mount.flange_from_burr.translation_mm,
            );
        let capsules: [Vec<Capsule<Link>>; LINKS] = std::array::from_fn(|link| match shapes.get(link) {
            Some(capsules) => capsules.to_vec(),
            None => handpiece.iter().map(|capsule| capsule.moved(&link_from_burr)).collect(),
        });
        let whole: [Capsule<Link>; LINKS] = std::array::from_fn(|link| whole(&capsules[link]));
        Some(Self {
            geometry,
            reach_mm: reach_mm(&geometry, &capsules),
            capsules,
            ball_mm: whole.map(|c| 0.5 * c.length_mm() + c.radius_mm),
            whole,
            pairs: pairs_held_apart().collect(),
            allowance_mm: if calibrated { deviation_mm(arm, &geometry) } else { 0.0 },
        })
    }

    pub(super) fn place(&self, q: &Joints) -> PlacedLinks<'_> {
        let [base, a, b, c, d, e, f] = self.geometry.link_poses(q);
        let poses = [base, a, b, c, d, e, f, f];
        let whole = std::array::from_fn(|link| {
            let capsule = self.whole[link].moved(&poses[link]);
            (capsule, capsule.middle())
        });
        PlacedLinks { links: self, whole, poses }
    }

    /// The most that any point of a link moves between two joint vectors, mm: Σ |Δqⱼ| Rⱼ.
    pub(super) fn most_moved_mm(&self, link: usize, from: &Joints, to: &Joints) -> f64 {
        let turns = from.iter().zip(to).map(|(a, b)| (a - b).abs());
        turns.zip(&self.reach_mm[link]).map(|(turn, reach)| turn * reach).sum()
    }
}

impl PlacedLinks<'_> {
    /// The capsules of a link.
    pub fn capsules(&self, link: usize) -> impl Iterator<Item = Capsule<Base>> {
        let pose = self.poses[link];
        self.links.capsules[link].iter().map(move |capsule| capsule.moved(&pose))
    }

    /// One capsule that holds a link.
    pub fn whole(&self, link: usize) -> &Capsule<Base> {
        &self.whole[link].0
    }

    /// A ball that holds a link: its centre and its radius, mm.
    pub fn ball(&self, link: usize) -> (Point<Base>, f64) {
        (self.whole[link].1, self.links.ball_mm[link])
    }

    /// The distance between two links, mm, or `cap_mm` where they are surely farther apart.
    pub fn between_mm(&self, a: usize, b: usize, cap_mm: f64) -> f64 {
        let ((at, ball_mm), (other_at, other_mm)) = (self.ball(a), self.ball(b));
        let reach_mm = ball_mm + other_mm + cap_mm;
        if reach_mm <= 0.0 || (at - other_at).norm_squared() >= reach_mm * reach_mm {
            return cap_mm;
        }
        let (whole, other) = (self.whole(a), self.whole(b));
        if whole.to_capsule_mm(other) >= cap_mm {
            return cap_mm;
        }
        let near = |capsule: &Capsule<Base>| capsule.to_capsule_mm(other) < cap_mm;
        let ones = self.capsules(a).filter(near);
        ones.flat_map(|one| self.capsules(b).map(move |two| one.to_capsule_mm(&two))).fold(cap_mm, f64::min)
    }
}

/// One capsule about capsules: its axis runs between the means of their ends, sorted by the longest capsule's direction.
fn whole(capsules: &[Capsule<Link>]) -> Capsule<Link> {
    let longest = capsules.iter().max_by(|a, b| a.length_mm().total_cmp(&b.length_mm()));
    let Some(along) = longest.map(|c| c.to - c.from) else { return Capsule::new([0.0; 3], [0.0; 3], 0.0) };
    let sorted = |c: &Capsule<Link>| {
        if (c.to - c.from).dot(&along) >= 0.0 {
            [c.from.coords, c.to.coords]
        } else {
            [c.to.coords, c.from.coords]
        }
    };
    let mean =
        |end: usize| capsules.iter().map(|c| sorted(c)[end]).sum::<Vector3<f64>>() / capsules.len() as f64;
    let axis = Capsule { from: Point::from_coords(mean(0)), to: Point::from_coords(mean(1)), radius_mm: 0.0 };
    // a capsule that holds the balls at both ends of another holds all of it
    let out = |c: &Capsule<Link>| axis.distance_mm(&c.from).max(axis.distance_mm(&c.to)) + c.radius_mm;
    Capsule { radius_mm: capsules.iter().map(out).fold(0.0, f64::max), ..axis }
}

/// Bounds on the distance of each link's points from each joint's axis, mm.
///
/// R of a joint's own link is the largest distance of a point from the link's z axis. For a link further out, with oⱼ the origins
/// of the frames: the part of oⱼ₊₁ − oⱼ that is perpendicular to the joint's axis, plus the lengths |oᵢ₊₁ − oᵢ| up to the link's
/// frame, plus the largest distance of the link's points from its frame's origin.
fn reach_mm(geometry: &UrGeometry, capsules: &[Vec<Capsule<Link>>; LINKS]) -> [[f64; 6]; LINKS] {
    let g = geometry;
    // from the frame of joint j to the next one: perpendicular to the axis of joint j, and in all
    let steps = [
        (0.0, g.d1_mm.abs()),
        (g.a2_mm.abs(), g.a2_mm.abs()),
        (g.a3_mm.abs(), g.a3_mm.abs()),
        (0.0, g.d4_mm.abs()),
        (0.0, g.d5_mm.abs()),
        (0.0, 0.0),
    ];
    std::array::from_fn(|link| {
        let ends = || capsules[link].iter().flat_map(|c| [(c.from, c.radius_mm), (c.to, c.radius_mm)]);
        let about_z = ends().map(|(p, r)| p.x().hypot(p.y()) + r).fold(0.0, f64::max);
        let about_origin = ends().map(|(p, r)| p.coords.norm() + r).fold(0.0, f64::max);
        let last = link.min(6);
        std::array::from_fn(|joint| match (joint + 1).cmp(&last) {
            std::cmp::Ordering::Greater => 0.0,
            std::cmp::Ordering::Equal => about_z,
            std::cmp::Ordering::Less => {
                steps[joint].0 + steps[joint + 1..last - 1].iter().map(|s| s.1).sum::<f64>() + about_origin
            }
        })
    })
}

/// One and a half times the largest distance of a calibrated arm's joints and flange from the nominal ones, mm, in 500 random postures.
fn deviation_mm(arm: &Arm, geometry: &UrGeometry) -> f64 {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(50);
    let mut angle = || (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64 * std::f64::consts::TAU;
    let off = |q: Joints| {
        let flange = geometry.link_poses(&q)[6] * Point::<Link>::new(0.0, 0.0, geometry.d6_mm);
        let burr = arm.mount().tool().map_or(Vector3::zeros(), |mount| mount.flange_from_burr.translation_mm);
        let nominal = geometry.link_poses(&q)[6] * (Point::<Link>::new(0.0, 0.0, geometry.d6_mm) + burr);
        let real =
            arm.forward(&q).map(|pose| [pose.translation_mm, pose.rotation * burr + pose.translation_mm]);
        real.map_or(0.0, |[a, b]| (a - flange.coords).norm().max((b - nominal.coords).norm()))
    };
    1.5 * (0..500).map(|_| off(std::array::from_fn(|_| angle()))).fold(0.0, f64::max)
}
