//! What a way in depends on, and what is told of it.

use bonemill_geometry::{Ct, Point};
use nalgebra::Vector3;

/// The tool as far as the way in depends on it.
#[derive(Debug, Clone, PartialEq)]
pub struct WayInTool {
    /// Lengths and radii of the shank's parts, from the burr outwards, mm.
    pub shank_mm: Vec<[f64; 2]>,
    /// Largest angle between shaft and approach, rad.
    pub tilt_limit_rad: f64,
    /// How the shaft tilts.
    pub tilts: Tilts,
}

/// How the arm tilts a shaft.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Tilts {
    /// In any direction.
    Freely,
    /// About the x of the approach's basis.
    AboutBasisX,
    /// About an axis to which every shaft is perpendicular; both unit in ct.
    About {
        /// The axis.
        hinge: Vector3<f64>,
        /// The shaft at tilt 0.
        zero: Vector3<f64>,
    },
}

/// Of places of the burr's centre and a direction of the shaft, unit, both in ct.
pub type HoldsAt<'a> = &'a (dyn Fn(&[Point<Ct>], &Vector3<f64>) -> bool + Sync);

/// Whether an arm can hold the tool at each of some places.
#[derive(Clone, Copy)]
pub struct ArmHolds<'a>(pub HoldsAt<'a>);

impl std::fmt::Debug for ArmHolds<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("ArmHolds")
    }
}

/// Where a scene's approach comes from.
#[derive(Debug, Clone)]
pub enum ApproachSpec<'a> {
    /// This direction, whatever it reaches.
    Fixed(Vector3<f64>),
    /// The given direction, if it does not face bone; without one, that along which the tool reaches most.
    For {
        /// Unit, in ct.
        given: Option<Vector3<f64>>,
        /// The tool.
        tool: WayInTool,
        /// The arm, where its place is known: only lines count along which it holds the tool at the target, if there are any.
        arm: Option<ArmHolds<'a>>,
    },
}

/// A direction out of the bone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Way {
    /// Unit, in ct.
    pub direction: Vector3<f64>,
    /// Share of the burr's places at the target that burr and shank reach within the tilt limit of it.
    pub reached: f64,
}

/// An approach that was chosen, and what else there was.
#[derive(Debug, Clone, PartialEq)]
pub struct ChosenWay {
    /// The chosen direction.
    pub best: Way,
    /// The best of those far from it and from each other.
    pub others: Vec<Way>,
    /// Whether only lines count along which the arm holds the tool where it stands.
    pub by_arm: bool,
}

impl ChosenWay {
    /// That it was chosen, in words.
    pub fn text(&self) -> String {
        let percent = |way: &Way| format!("{:.0} %", 100.0 * way.reached);
        let others: Vec<String> = self
            .others
            .iter()
            .map(|way| format!("{} of them along {}", percent(way), words(&way.direction)))
            .collect();
        let others = if others.is_empty() { String::new() } else { format!("; {}", others.join(", ")) };
        format!(
            "approach.direction is not given: {} was chosen, along which burr and shank{} reach {} of the burr's places at the target{others}",
            words(&self.best.direction),
            if self.by_arm { ", held by the arm where it stands," } else { "" },
            percent(&self.best)
        )
    }
}

/// A direction in ct with two digits.
pub fn words(d: &Vector3<f64>) -> String {
    // no minus before a zero
    let [x, y, z] = [d.x, d.y, d.z].map(|c| (100.0 * c).round() / 100.0 + 0.0);
    format!("({x:.2}, {y:.2}, {z:.2})")
}
