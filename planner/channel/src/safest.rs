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

/// Point `n` of `count` that are spread evenly over the sphere (a spiral with the golden angle).
pub(crate) fn on_sphere(n: usize, count: usize) -> Unit<Vector3<f64>> {
    let golden_rad = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let z = 1.0 - (2 * n + 1) as f64 / count as f64;
    let (sin, cos) = (golden_rad * n as f64).sin_cos();
    let across = (1.0 - z * z).sqrt();
    Unit::new_normalize(Vector3::new(across * cos, across * sin, z))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::registration_error::RegistrationError;
    use crate::risk::KeptStructure;
    use crate::swept::SweptTool;
    use bonemill_cutter::SolidOfRevolution;
    use bonemill_geometry::Grid;
    use bonemill_imaging::StructureField;

    /// A block of bone with its upper face at z = 10.25 and two walls that leave a gap around x = `gap_x`.
    fn scene(gap_x: f64) -> (Volume<f32, Ct>, Volume<u16, Ct>) {
        let grid = Grid::<Ct>::aligned([41, 41, 30], 0.5, Point::new(-10.0, -10.0, -2.0)).unwrap();
        let (mut ct, mut labels) =
            (Volume::filled(grid.clone(), -1000f32), Volume::filled(grid.clone(), 0u16));
        for n in 0..grid.len() {
            let p = grid.center(grid.voxel(n));
            if p.z() < 10.2 {
                ct.data_mut()[n] = 1000.0;
            }
            let is_wall = p.z() > 4.8 && p.z() < 6.2 && (p.x() - gap_x).abs() > 1.9;
            labels.data_mut()[n] = u16::from(is_wall);
        }
        (ct, labels)
    }

    fn found(gap_x: f64, region: EntryRegion<'_>) -> SafestFound {
        found_in(gap_x, region, None)
    }

    fn found_in(gap_x: f64, region: EntryRegion<'_>, cone: Option<(Vector3<f64>, f64)>) -> SafestFound {
        searched(gap_x, region, cone, |search| search.run())
    }

    fn searched<R>(
        gap_x: f64,
        region: EntryRegion<'_>,
        cone: Option<(Vector3<f64>, f64)>,
        of: impl Fn(&SafestSearch<'_>) -> R,
    ) -> R {
        let (ct, labels) = scene(gap_x);
        let field = StructureField::new(&labels, 1, None).unwrap().unwrap();
        let structures = [KeptStructure { field: Some(&field), clearance_mm: 0.2, priority: 1 }];
        let tool = SolidOfRevolution::new(&[[0.0, 0.0], [0.5, 0.8], [9.0, 0.8]]).unwrap();
        let tool = SweptTool::new(&tool).unwrap();
        let risk = RiskModel {
            structures: &structures,
            tool: &tool,
            standoff_mm: 3.0,
            error: RegistrationError::uniform(0.1),
            touch_probability: 0.01,
        };
        let target = Point::new(0.0, 0.0, 0.0);
        let outside = OutsideAir::of(&ct, -700.0);
        of(&SafestSearch {
            ct: &ct,
            bone_hu: 0.0,
            target,
            region,
            outside: &outside,
            cone,
            longest_mm: 20.0,
            risk,
        })
    }

    #[test]
    fn the_safest_channel_goes_through_the_middle_of_the_gap() {
        for gap_x in [0.0, 2.0, -3.0] {
            let found = found(gap_x, EntryRegion::Surface);
            let best = &found.channels[0];
            // voxels' faces end the gap at gap_x ± 1.75; the line crosses z 4.75 to 6.25, widest in the middle at 5.5
            let x = best.axis.out.x / best.axis.out.z * 5.5;
            assert!((x - gap_x).abs() < 0.12, "gap at {gap_x}: {x}");
            assert!(found.channels.windows(2).all(|w| w[0].margin_mm() >= w[1].margin_mm() - TIE_MM));
            // the gap's own margin: of a fine fan, the direction that stays farthest from the walls' edges
            let fan = (0..400).map(|n| f64::from(n) * 0.01 - 2.0 + gap_x);
            let distance = |x: f64| {
                let (dx, dz) = (x / 5.5, 1.0);
                let norm = f64::hypot(dx, dz);
                let edge = |ex: f64, ez: f64| (ex * dz - ez * dx).abs() / norm;
                [4.75, 6.25]
                    .into_iter()
                    .flat_map(|z| [edge(gap_x - 1.75, z), edge(gap_x + 1.75, z)])
                    .fold(9.0, f64::min)
            };
            let most = fan.map(distance).fold(0.0, f64::max) - 0.8 - 0.1 * 2.326;
            assert!((best.margin_mm() - most).abs() < 0.03, "{} {most}", best.margin_mm());
        }
    }

    /// A brute-force twin: of a fine fan of directions, none that stays apart from the channels before a runner-up keeps more than it.
    #[test]
    fn every_runner_up_is_the_best_of_what_stays_apart() {
        let cone = Some((Vector3::new(0.1, 0.0, 1.0), 0.3));
        searched(0.0, EntryRegion::Surface, cone, |search| {
            let channels = search.run().channels;
            assert!(channels.len() > 3, "{}", channels.len());
            let fan =
                (0..61u8).flat_map(|i| (0..61u8).map(move |j| [i, j].map(|n| f64::from(n) * 0.012 - 0.36)));
            let fan = fan.filter_map(|[x, y]| {
                let axis = search.axis_in_cone(&Unit::new_normalize(Vector3::new(x + 0.1, y, 1.0)))?;
                Some(search.judged(axis, TOLERANCES_MM[1]))
            });
            let fan: Vec<SafeChannel> = fan.collect();
            assert!(fan.len() > 1500, "{}", fan.len());
            for (n, channel) in channels.iter().enumerate() {
                assert!(is_apart(&channel.axis, &channels[..n]));
                let others = fan.iter().filter(|other| is_apart(&other.axis, &channels[..n]));
                let most = others.map(|other| other.margin_mm()).fold(f64::NEG_INFINITY, f64::max);
                let margin_mm = channel.margin_mm();
                assert!(margin_mm > most - 0.03, "channel {n} keeps {margin_mm} of {most}");
            }
        });
    }

    #[test]
    fn a_cone_binds_and_the_block_s_underside_leads_nowhere() {
        let about = Vector3::new(1.0, 0.0, 1.0);
        let found = found_in(0.0, EntryRegion::Surface, Some((about, 0.4)));
        assert!(!found.channels.is_empty());
        for channel in &found.channels {
            assert!(channel.axis.out.angle(&about) <= 0.4 + 1e-12);
        }
        // half of all directions lead down, to the scan's lower face: in bone, or without outside air
        let all = self::found(0.0, EntryRegion::Surface);
        assert!(all.in_region < all.sampled / 2 && all.channels.iter().all(|c| c.axis.out.z > 0.0));
        let none = found_in(0.0, EntryRegion::Surface, Some((-Vector3::z(), 0.5)));
        assert!(none.channels.is_empty() && none.in_region == 0);
    }

    /// A structure below the target limits every direction alike; a wall on one side then decides.
    #[test]
    fn where_the_worst_margin_ties_the_next_one_decides() {
        let (ct, mut labels) = scene(0.0);
        for n in 0..labels.data().len() {
            let p = labels.grid().center(labels.grid().voxel(n));
            labels.data_mut()[n] = match p {
                _ if p.z() < -0.9 => 1,
                _ if p.x() > 1.9 && p.z() > 3.0 && p.z() < 7.0 => 2,
                _ => 0,
            };
        }
        let fields = [1, 2].map(|label| StructureField::new(&labels, label, None).unwrap().unwrap());
        let structures = fields.each_ref().map(|field| KeptStructure {
            field: Some(field),
            clearance_mm: 0.2,
            priority: 1,
        });
        let tool = SolidOfRevolution::new(&[[0.0, 0.0], [1.6, 0.8], [9.0, 0.8]]).unwrap();
        let outside = OutsideAir::of(&ct, -700.0);
        let search = SafestSearch {
            ct: &ct,
            bone_hu: 0.0,
            target: Point::new(0.0, 0.0, 0.0),
            region: EntryRegion::Surface,
            outside: &outside,
            cone: Some((Vector3::z(), 0.35)),
            longest_mm: 20.0,
            risk: RiskModel {
                structures: &structures,
                tool: &SweptTool::new(&tool).unwrap(),
                standoff_mm: 3.0,
                error: RegistrationError::uniform(0.1),
                touch_probability: 0.05,
            },
        };
        let best = &search.run().channels[0];
        // the floor is 0.75 below the tip of a sharp drill, however it leans within the cone: the shortest way, along z, comes to
        // 0.95 of the wall, and the cone's edge away from it to 1.8 or more
        let [floor, wall] = [0, 1].map(|n| best.kept[n].unwrap().clearance_mm);
        assert!((floor - 0.75).abs() < 0.01, "{floor}");
        let straight = search.judged(search.axis(&Vector3::z_axis()).unwrap(), TOLERANCES_MM[1]);
        assert!((straight.margin_mm() - best.margin_mm()).abs() < TIE_MM);
        assert!(straight.axis.depth_mm < best.axis.depth_mm);
        assert!(wall > straight.kept[1].unwrap().clearance_mm + 0.8, "{wall}");
    }

    #[test]
    fn an_entry_region_binds_and_what_it_leaves_out_is_counted() {
        let region = EntryRegion::Ball { center: Point::new(4.0, 0.0, 10.25), radius_mm: 2.0 };
        let found = found(0.0, region);
        assert!(found.in_region > 10 && found.in_region < found.sampled / 10);
        for channel in &found.channels {
            assert!(channel.axis.entry.distance_mm(&Point::new(4.0, 0.0, 10.25)) <= 2.0);
            assert!((channel.axis.entry.z() - 10.25).abs() < 0.3);
        }
    }
}
