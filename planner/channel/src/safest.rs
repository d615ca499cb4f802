//! The safest straight channel to a target: the direction whose weighted margins are the largest, and the next best ones.
//!
//! Every direction is a channel that begins where the line from the target leaves the bone for good. That must lie in the entry's
//! region, in the cone about the approach, and on a way that is free for the tool and reaches the air outside the patient
//! ([`crate::outside`]): a line that ends in an air cell is no channel.
//!
//! Of two channels the one with the larger least weighted margin over all structures ([`crate::risk`]) is better; where these are
//! within [`TIE_MM`], the one with the larger next margin, and so on: a structure beside the target limits every direction alike,
//! and then the others decide. Of channels that tie in all margins the shortest is the best.
//!
//! Margins are continuous in the direction but have several local maxima, one for each gap between structures. So directions are
//! first sampled over the sphere, `SPACING_RAD` apart; the best of them that are [`APART_RAD`] from each other are then moved to the
//! local maximum of their least margin by halving steps, and the first channel, the best of these, to that of its next margins; each further one, a runner-up, is the best that stays [`APART_RAD`] from all before it, in another gap or beside the
//! first in the same.

use bonemill_geometry::basis::on_sphere;
use bonemill_geometry::{Ct, Point, Volume, basis, cancel};
use nalgebra::{Unit, Vector3};
use rayon::prelude::*;

use crate::axis::ChannelAxis;
use crate::clearance::Line;
use crate::outside::OutsideAir;
use crate::risk::{KeptClearance, RiskModel, Sides, margins_mm};
use crate::surface::leaves_bone_mm;

/// Angle between neighbouring samples, rad.
const SPACING_RAD: f64 = 0.025;
/// Least angle between two directions that are told apart, rad.
pub const APART_RAD: f64 = 0.087;
/// Sampled directions that are moved to their local maximum, for the best channel and for each runner-up.
const STARTS: [usize; 2] = [8, 3];
/// Channels that are found: the best and its runners-up.
const MOST_CHANNELS: usize = 5;
/// Steps of moving, from the first to the last, rad.
const STEPS_RAD: [f64; 2] = [0.5 * SPACING_RAD, 2e-4];
/// A step of moving that gains less than this does not count, mm, so that a plateau ends the search; the clearances' own tolerance
/// is larger.
const LEAST_GAIN_MM: f64 = 1e-3;
/// Margins that differ by less tie, mm: more than the clearances' own tolerance.
pub const TIE_MM: f64 = 0.01;
/// The same for samples, whose clearances are told less exactly.
const SAMPLED_TIE_MM: f64 = 0.1;
/// Lines beside the channel's along which the way to the entry must be free.
const AROUND: u32 = 12;
/// What clearances may be told too small while sampling and while moving, mm.
const TOLERANCES_MM: [f64; 2] = [0.05, 0.005];

/// Where a channel may leave the bone.
#[derive(Debug, Clone, Copy)]
pub enum EntryRegion<'a> {
    /// Anywhere.
    Surface,
    /// In a ball of ct, mm.
    Ball {
        /// Its centre.
        center: Point<Ct>,
        /// Its radius, mm.
        radius_mm: f64,
    },
    /// Where the nearest voxel, or one beside it, has this label.
    Label(&'a Volume<u16, Ct>, u16),
}

impl EntryRegion<'_> {
    fn holds(&self, p: Point<Ct>) -> bool {
        match *self {
            Self::Surface => true,
            Self::Ball { center, radius_mm } => p.distance_mm(&center) <= radius_mm,
            Self::Label(labels, label) => {
                let grid = labels.grid();
                let Some(voxel) = grid.nearest(p) else { return false };
                let around = |a: usize| voxel[a].saturating_sub(1)..(voxel[a] + 2).min(grid.dims()[a]);
                around(2).any(|k| around(1).any(|j| around(0).any(|i| *labels.get([i, j, k]) == label)))
            }
        }
    }
}

/// A channel to the target and what it keeps.
#[derive(Debug, Clone, PartialEq)]
pub struct SafeChannel {
    /// The channel.
    pub axis: ChannelAxis,
    /// Per structure, in the case's order; `None` for one that the map lacks.
    pub kept: Vec<Option<KeptClearance>>,
    /// Their weighted margins, mm, the least first.
    pub margins_mm: Vec<f64>,
}

impl SafeChannel {
    /// A channel and what it keeps.
    pub fn new(axis: ChannelAxis, kept: Vec<Option<KeptClearance>>) -> Self {
        Self { axis, margins_mm: margins_mm(&kept), kept }
    }

    /// The least weighted margin over the structures, mm; infinite where there is none.
    pub fn margin_mm(&self) -> f64 {
        self.of_rank_mm(0)
    }

    /// The margin of the structure that is the `rank`-th nearest to its limit, mm.
    fn of_rank_mm(&self, rank: usize) -> f64 {
        self.margins_mm.get(rank).copied().unwrap_or(f64::INFINITY)
    }
}

/// What is searched.
#[derive(Debug, Clone, Copy)]
pub struct SafestSearch<'a> {
    /// Grey values.
    pub ct: &'a Volume<f32, Ct>,
    /// At or above: bone, HU.
    pub bone_hu: f64,
    /// Where the tip ends.
    pub target: Point<Ct>,
    /// Where the channel leaves the bone.
    pub region: EntryRegion<'a>,
    /// The air outside the patient.
    pub outside: &'a OutsideAir,
    /// Out of the bone, and the largest angle from it, rad; `None`: any direction.
    pub cone: Option<(Vector3<f64>, f64)>,
    /// The longest channel that the tool can drill, mm.
    pub longest_mm: f64,
    /// By what channels are judged.
    pub risk: RiskModel<'a>,
}

/// What a search found.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SafestFound {
    /// Best first, at least [`APART_RAD`] from each other, at most 5.
    pub channels: Vec<SafeChannel>,
    /// Directions that were sampled.
    pub sampled: usize,
    /// Of these: lead outside within the region and the cone.
    pub in_region: usize,
    /// Of these: longer than the tool can drill.
    pub too_long: usize,
}

impl SafestSearch<'_> {
    /// The safest channels.
    pub fn run(&self) -> SafestFound {
        let count = (4.0 * std::f64::consts::PI / (SPACING_RAD * SPACING_RAD)) as usize;
        let sampled: Vec<Sampled> = (0..count)
            .into_par_iter()
            .map(|n| {
                cancel::poll();
                self.sample(&on_sphere(n, count))
            })
            .collect();
        let starts: Vec<&SafeChannel> = sampled.iter().filter_map(Sampled::channel).collect();
        let mut channels: Vec<SafeChannel> = Vec::new();
        while channels.len() < MOST_CHANNELS {
            let possible = starts.iter().copied().filter(|start| is_apart(&start.axis, &channels));
            let tried: Vec<SafeChannel> = apart(possible, STARTS[usize::from(!channels.is_empty())])
                .par_iter()
                .map(|start| self.refined(start, &channels, 0))
                .collect();
            let Some(best) = best_of(tried.iter(), TIE_MM) else { break };
            // the next margins of a runner-up are not moved: that decides little and takes as long
            let ranks = if channels.is_empty() { self.risk.structures.len() } else { 1 };
            let best = (1..ranks).fold(best.clone(), |best, rank| self.refined(&best, &channels, rank));
            channels.push(best);
        }
        let channels = best_first(channels);
        SafestFound {
            channels,
            sampled: count,
            in_region: sampled.iter().filter(|s| !matches!(s, Sampled::Elsewhere)).count(),
            too_long: sampled.iter().filter(|s| matches!(s, Sampled::TooLong)).count(),
        }
    }

    /// The channel of one direction out of the bone.
    fn sample(&self, out: &Unit<Vector3<f64>>) -> Sampled {
        let Some(axis) = self.axis_in_cone(out) else { return Sampled::Elsewhere };
        if axis.depth_mm > self.longest_mm {
            return Sampled::TooLong;
        }
        Sampled::Channel(self.judged(axis, TOLERANCES_MM[0]))
    }

    /// The channel along a direction out of the bone; `None` where its line meets no bone, leaves the scan in bone, leaves the
    /// bone outside the region, or does not lead outside.
    pub fn axis(&self, out: &Unit<Vector3<f64>>) -> Option<ChannelAxis> {
        let grid = self.ct.grid();
        let farthest = grid.corners().iter().map(|c| c.distance_mm(&self.target)).fold(0.0, f64::max);
        let line = Line { from: self.target, along: out, length_mm: farthest };
        let depth_mm = leaves_bone_mm(self.ct, self.bone_hu, &line)?;
        let axis = ChannelAxis { entry: self.target + out.as_ref() * depth_mm, out: *out, depth_mm };
        let beyond = Line { from: axis.entry, ..line };
        let fits = self.region.holds(axis.entry) && self.outside.is_reached(self.ct, &beyond);
        (fits && self.is_free_before(&axis)).then_some(axis)
    }

    /// The same in the cone.
    fn axis_in_cone(&self, out: &Unit<Vector3<f64>>) -> Option<ChannelAxis> {
        let is_inside = self.cone.is_none_or(|(about, angle_rad)| out.angle(&about) <= angle_rad);
        if is_inside { self.axis(out) } else { None }
    }

    /// Whether no bone stands beside the line where the tool waits before the entry, and beyond.
    fn is_free_before(&self, axis: &ChannelAxis) -> bool {
        let grid = self.ct.grid();
        let (radius_mm, standoff_mm) = (self.risk.tool.radius_mm(), self.risk.standoff_mm);
        // a little more than the radius: the tool's front is judged on a grid of its own
        let aside = radius_mm + 0.5 * grid.diagonal_mm();
        let turn = basis::from_z(&axis.out);
        let start = axis.at(-standoff_mm - radius_mm);
        let step = 0.5 * grid.spacing_mm().min();
        (0..AROUND).all(|n| {
            let (sin, cos) = (f64::from(n) / f64::from(AROUND) * std::f64::consts::TAU).sin_cos();
            let beside = start + turn * Vector3::new(aside * cos, aside * sin, 0.0);
            let places = (0..).map(|n| beside + axis.out.as_ref() * (f64::from(n) * step));
            places.map_while(|p| Some(f64::from(*self.ct.get(grid.nearest(p)?)))).all(|hu| hu < self.bone_hu)
        })
    }

    fn judged(&self, axis: ChannelAxis, tolerance_mm: f64) -> SafeChannel {
        SafeChannel::new(axis, self.risk.assess(&axis, tolerance_mm, Sides::Nearest))
    }

    /// The local maximum of the margin of a rank next to a channel among those that stay apart from `others` and lose nothing of
    /// the lesser margins, by steps around it that are halved where none is better.
    fn refined(&self, from: &SafeChannel, others: &[SafeChannel], rank: usize) -> SafeChannel {
        let [first, last] = STEPS_RAD;
        let mut best = self.judged(from.axis, TOLERANCES_MM[1]);
        let kept_mm: Vec<f64> = best.margins_mm.iter().take(rank).map(|mm| mm - TIE_MM).collect();
        let mut step = first;
        while step > last {
            cancel::poll();
            let turn = basis::from_z(&best.axis.out);
            let beside = |n: u32| {
                let (sin, cos) = (f64::from(n) * std::f64::consts::FRAC_PI_4).sin_cos();
                let out = Unit::new_normalize(turn * Vector3::new(step * cos, step * sin, 1.0));
                let axis = self.axis_in_cone(&out)?;
                let fits = axis.depth_mm <= self.longest_mm && is_apart(&axis, others);
                fits.then(|| self.judged(axis, TOLERANCES_MM[1]))
            };
            let margin_mm = |channel: &SafeChannel| channel.of_rank_mm(rank);
            let better = (0..8)
                .filter_map(beside)
                .filter(|channel| kept_mm.iter().zip(&channel.margins_mm).all(|(kept, mm)| mm >= kept))
                .filter(|channel| margin_mm(channel) > margin_mm(&best) + LEAST_GAIN_MM)
                .max_by(|a, b| margin_mm(a).total_cmp(&margin_mm(b)));
            match better {
                Some(better) => best = better,
                None => step *= 0.5,
            }
        }
        best
    }
}

/// One direction.
enum Sampled {
    /// No channel in the region.
    Elsewhere,
    /// Longer than the tool can drill.
    TooLong,
    Channel(SafeChannel),
}

impl Sampled {
    fn channel(&self) -> Option<&SafeChannel> {
        match self {
            Self::Channel(channel) => Some(channel),
            _ => None,
        }
    }
}

/// The best channel: of those whose least margin is within `tie_mm` of the largest the ones whose next margin is, and so on;
/// of those left the shortest, then the first.
fn best_of<'c>(channels: impl Iterator<Item = &'c SafeChannel>, tie_mm: f64) -> Option<&'c SafeChannel> {
    let mut left: Vec<&SafeChannel> = channels.collect();
    let ranks = left.iter().map(|channel| channel.margins_mm.len()).max().unwrap_or(0);
    for rank in 0..ranks {
        let most_mm = left.iter().map(|channel| channel.of_rank_mm(rank)).fold(f64::NEG_INFINITY, f64::max);
        left.retain(|channel| channel.of_rank_mm(rank) >= most_mm - tie_mm);
    }
    left.into_iter().min_by(|a, b| a.axis.depth_mm.total_cmp(&b.axis.depth_mm))
}

/// The channels in order, the best of those left each time.
pub fn best_first(mut channels: Vec<SafeChannel>) -> Vec<SafeChannel> {
    let mut sorted = Vec::with_capacity(channels.len());
    while let Some(best) = best_of(channels.iter(), TIE_MM).cloned() {
        channels.retain(|channel| channel.axis != best.axis);
        sorted.push(best);
    }
    sorted
}

/// Whether a channel is [`APART_RAD`] from all others.
fn is_apart(axis: &ChannelAxis, others: &[SafeChannel]) -> bool {
    others.iter().all(|other| other.axis.out.dot(&axis.out) < APART_RAD.cos())
}

/// The best of sampled channels that are apart from each other, at most so many.
fn apart<'c>(channels: impl Iterator<Item = &'c SafeChannel>, most: usize) -> Vec<SafeChannel> {
    let mut left: Vec<&SafeChannel> = channels.collect();
    let mut chosen: Vec<SafeChannel> = Vec::new();
    while chosen.len() < most {
        let Some(best) = best_of(left.iter().copied(), SAMPLED_TIE_MM) else { break };
        chosen.push(best.clone());
        left.retain(|channel| is_apart(&channel.axis, &chosen));
    }
    chosen
}

#[cfg(test)]
mod tests;
