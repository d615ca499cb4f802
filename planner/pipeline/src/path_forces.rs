//! The force on the burr along a path as the arm drives it, for the axes that the shaft has.
//!
//! A row of a plan states the force where its move ends. Engagement changes within a move too, and a move may cut the skin that a
//! rounded corner left, so forces are also computed at places within every move, those that plan to cut nothing included. Levels and
//! caps hold at all of them. A link grazes what lies between the planning grid's voxels; a cap holds for a whole move, so such a link is
//! slow over its length.

use bonemill_case::Case;
use bonemill_cutting::burr::{BoneAround, EngagedForce, EngagedSamples, Feed, ForceKernel, Material};
use bonemill_cutting::cutter::Ball;
use bonemill_cutting::stock::removal::RemovalTime;
use bonemill_geometry::{Base, Point, Rigid, Tool};
use bonemill_setup::armpath::ArmMotion;
use bonemill_setup::nearest_structures::NearStructure;
use bonemill_setup::tools;
use bonemill_toolpath::engagement::{RoundedCorner, SweptPath};
use bonemill_toolpath::path::PathPoint;
use bonemill_toolpath::scene::Scene;
use nalgebra::{Unit, Vector3};
use rayon::prelude::*;

use super::PlanError;
use super::sampled::{self, SampledForce};
use super::speeds::JointMotion;
use super::start::Start;

/// Places within a move at which the force is computed, as shares of its way, besides its end: its middle, and one in the rounding of each
/// of its corners, where the burr moves in a direction between those of two moves. A move that goes straight on begins with the force at
/// which the one before it ends.
const MIDDLE: f64 = 0.5;
const IN_CORNERS: [f64; 2] = [0.02, 0.98];
/// Places in rounded corners, as shares of the way from one vertex to the next: the largest force may be in the middle of a turn ..
const IN_ROUNDED: &[f64] = &[0.5, 1.0];
/// .. and where edges push without a chip, since such forces jump with the direction; then also in corners that are not rounded, as
/// [`SweptPath::bone_within`] counts what the burr has turned.
const IN_ROUNDED_WITH_EDGES: &[f64] = &[0.05, 0.5];
const TURNED: [f64; 5] = [1.05, 1.25, 1.5, 1.75, 1.95];
/// Largest change of direction of a move that goes straight on, rad.
const STRAIGHT_RAD: f64 = 1e-3;
/// Between two such places it is computed in the middle where they differ by more than the case's share of the larger force and
/// this share of the path's largest, as long as they are farther apart than this share of the way.
const VARIES_LEAST: f64 = 0.01;
const APART: f64 = 0.07;
/// A push toward a structure comes and goes within a shorter way as the burr meets bone. Without edges that push without a chip it counts where it
/// differs by this share of the path's largest force.
const APART_TOWARD: f64 = 0.03;
const VARIES_TOWARD: f64 = 0.03;
/// The same distance where edges push without a chip.
const APART_WITH_EDGES: f64 = 0.01;
/// The place within a move with the largest force is looked at finely where that is larger than this share of the move's largest that is
/// known as finely.
const AS_LARGE: f64 = 0.9;
/// So many are looked at so, one after the other, and where edges push without a chip, which differ from sum to sum.
const LOOKED_AT: usize = 1;
const LOOKED_AT_WITH_EDGES: usize = 4;
/// Places around the one where a move comes back to a rounded corner and meets the skin there, as shares of its way.
const AROUND_BACK: [f64; 4] = [-0.2, -0.06, 0.0, 0.06];
/// A corner by whose rounding the burr leaves the path less than this leaves no skin that counts, mm, and the steps to the middle of the others ..
const CORNERS: (f64, usize) = (2e-3, 2);
/// .. and where edges push without a chip.
const CORNERS_WITH_EDGES: (f64, usize) = (5e-4, 4);

/// A path as forces see it; one entry per waypoint.
#[derive(Debug, Clone, Copy)]
pub(super) struct ForcedPath<'a> {
    pub scene: &'a Scene,
    pub removal: &'a RemovalTime,
    pub points: &'a [PathPoint],
    pub feeds: &'a [Option<Unit<Vector3<f64>>>],
}

/// The force at a place within a move.
#[derive(Debug, Clone, Copy)]
pub struct ForceWithin {
    pub(super) force: EngagedForce,
    /// Share of the move's way after which it is; 0 where it is that with which the move before ends.
    at: f64,
    /// Share of the move's way that it stands for in means; the force where the move ends stands for the rest.
    share: f64,
}

/// The mean over a move, of a length, mm, a time, s, and a greatest speed, mm/s, of what is asked of the force and the share of the move's way
/// after which it is; 0 for a move that removes nothing where it ends. `passed`: the share of the time that has passed after a share of the way. Only edge forces need it: the others
/// grow with the speed, so that what they add up to depends on the way alone.
pub(super) fn mean_of_move(
    end: Option<&EngagedForce>,
    within: &[ForceWithin],
    [length_mm, seconds, driven_mm_s]: [f64; 3],
    passed: impl Fn(f64) -> f64,
    of: impl Fn(&Vector3<f64>, f64) -> f64,
) -> f64 {
    let Some(end) = end.filter(|_| seconds > 0.0) else { return 0.0 };
    let places = within.iter().filter(|place| place.share > 0.0);
    let places = places.map(|place| (place.share, place.at, &place.force));
    let rest = 1.0 - places.clone().map(|(share, ..)| share).sum::<f64>();
    let places = places.chain([(rest, 1.0, end)]);
    let has_edges = places.clone().any(|(.., force)| force.edge_n != Vector3::zeros());
    let (mut way, mut time, mut sum) = (0.0, 0.0, 0.0);
    for (share, at, force) in places {
        way += share;
        let took = if has_edges { passed(way) - time } else { share };
        time += took;
        if took > 0.0 {
            let mean_mm_s = share * length_mm / (took * seconds);
            sum += took * of(&force.force_n(mean_mm_s.min(driven_mm_s)), at);
        }
    }
    sum
}

/// The forces of a move, each with the share of the move's way after which it is.
pub(super) fn places_of_move<'a>(
    end: Option<&'a EngagedForce>,
    within: &'a [ForceWithin],
) -> impl Iterator<Item = (f64, &'a EngagedForce)> {
    end.map(|end| (1.0, end)).into_iter().chain(within.iter().map(|place| (place.at, &place.force)))
}

/// Forces of a move between which all of its forces lie, each with the share of its way: those at its greatest speed, mm/s, and, as far as
/// edges push without a chip, those as it comes to rest. A component toward a structure may be larger there.
pub(super) fn extremes_of_move<'a>(
    end: Option<&'a EngagedForce>,
    within: &'a [ForceWithin],
    driven_mm_s: f64,
) -> impl Iterator<Item = (f64, Vector3<f64>)> + 'a {
    places_of_move(end, within)
        .flat_map(move |(at, force)| [(at, force.force_n(driven_mm_s)), (at, force.edge_n)])
}

/// Forces along a move, by the shares of its way at which they are, the last at its end: all but the last, each with the share of the way
/// that is nearest to it.
fn shared(mut places: Vec<(f64, EngagedForce)>) -> Vec<ForceWithin> {
    places.sort_by(|a, b| a.0.total_cmp(&b.0));
    let between = places.windows(2).map(|pair| 0.5 * (pair[0].0 + pair[1].0));
    let starts = std::iter::once(0.0).chain(between.clone());
    let shares = places.iter().zip(starts.zip(between));
    let within = |(place, (from, to)): (&(f64, EngagedForce), (f64, f64))| ForceWithin {
        force: place.1,
        at: place.0,
        share: to - from,
    };
    shares.map(within).collect()
}

/// Those of some places that remove something, which stand for no share of a move.
fn cutting(places: impl Iterator<Item = (f64, EngagedForce)>) -> impl Iterator<Item = ForceWithin> {
    let cuts = places.filter(|(_, force)| force.mrr_mm2 > 0.0);
    cuts.map(|(at, force)| ForceWithin { force, at, share: 0.0 })
}

/// Where a move begins with the force where the one before it ends, it is as exact as that.
pub(super) fn begin_as_ended(within: &mut [Vec<ForceWithin>], ends: &[Option<EngagedForce>]) {
    for (places, before) in within.iter_mut().skip(1).zip(ends) {
        let begins = places.iter_mut().find(|place| place.at == 0.0);
        begins.into_iter().zip(before).for_each(|(place, before)| place.force = *before);
    }
}

/// The corners that an arm rounds along its motion, in the path's order.
fn rounded_corners(
    (start, case): (&Start, &Case),
    motion: &ArmMotion,
) -> Result<Vec<RoundedCorner>, PlanError> {
    let work_from_base = start.base_from_work.inverse();
    let place = |q: Vec<f64>| {
        let tool: Rigid<Base, Tool> = start.arm.tool_at(&q);
        work_from_base * Point::<Base>::from_coords(tool.translation_mm)
    };
    let (least_mm, half) = if sampled::has_edges(case) { CORNERS_WITH_EDGES } else { CORNERS };
    let corners = JointMotion::new(motion, start.arm)?.burr_corners(least_mm, half).into_iter();
    let of =
        |(waypoints, q): (_, Vec<_>)| RoundedCorner { waypoints, at: q.into_iter().map(place).collect() };
    Ok(corners.map(of).collect())
}

/// Places around the one where move i comes back to a rounded corner, as shares of its way.
pub(super) fn around_back(swept: &SweptPath, i: usize) -> Vec<f64> {
    let around = |back: f64| AROUND_BACK.map(|off| (back + off).clamp(0.0, 1.0));
    swept.comes_back(i).into_iter().flat_map(around).collect()
}

/// Places in the corners of move i.
pub(super) fn turning(swept: &SweptPath, i: usize, has_edges: bool) -> Vec<f64> {
    if !has_edges {
        return swept.in_corners(i, IN_ROUNDED);
    }
    let turned = TURNED.iter().filter(|_| !swept.is_rounded(i));
    swept.in_corners(i, IN_ROUNDED_WITH_EDGES).into_iter().chain(turned.copied()).collect()
}

/// The shaft's axis after a share of the way of move i: it turns during the move.
pub(super) fn axis_within(axes: &[Unit<Vector3<f64>>], i: usize, share: f64) -> Unit<Vector3<f64>> {
    Unit::new_normalize(axes[i.saturating_sub(1)].lerp(&axes[i], share.clamp(0.0, 1.0)))
}

/// A case's force as finely as it is stated.
pub(super) struct FineForce {
    pub kernel: ForceKernel,
    pub material: Material,
    nominal_mm_s: f64,
    spindle_rpm: f64,
}

impl FineForce {
    pub fn new(case: &Case) -> Result<Self, PlanError> {
        let tool = tools::tool(&case.burr)?;
        let (material, measure) = tools::material(&case.material)?;
        let fine = tools::discretisation(&tool, measure, case.accuracy.force_elements)?;
        let kernel = ForceKernel::new(&tool, &material, &fine);
        Ok(Self {
            kernel,
            material,
            nominal_mm_s: case.speed.nominal_mm_s,
            spindle_rpm: case.burr.spindle_rpm,
        })
    }

    /// In the bone around, for an axis and a direction of motion.
    pub fn of(
        &self,
        mut bone: impl BoneAround,
        axis: &Unit<Vector3<f64>>,
        direction: &Unit<Vector3<f64>>,
    ) -> EngagedForce {
        let feed = Feed::new(direction, self.nominal_mm_s, self.spindle_rpm);
        self.kernel.engaged_force(axis, &feed, &mut bone)
    }
}

impl ForcedPath<'_> {
    /// Forces where moves end, of those that are planned to remove something: `removes(i)`.
    pub fn at_ends(
        &self,
        (sampled, swept): (&SampledForce, &SweptPath),
        axes: &[Unit<Vector3<f64>>],
        removes: impl Fn(usize) -> bool + Sync,
    ) -> Vec<Option<EngagedForce>> {
        let force = |samples: &mut EngagedSamples, i: usize| {
            let feed = self.feeds[i].filter(|_| removes(i))?;
            let weight = |density| sampled.weight(density);
            let bone = swept.bone_at(i as u32, sampled.radius_mm(), weight);
            sampled.gather(samples, &sampled.nominal(&feed), bone);
            Some(sampled.of(samples, &axes[i]))
        };
        (0..self.points.len()).into_par_iter().map_init(EngagedSamples::default, force).collect()
    }

    /// Forces where moves end, as finely as they are stated, of those that are asked for: `is_asked(i)`.
    ///
    /// # Errors
    /// When the tool or the material is not usable.
    pub fn finely(
        &self,
        (case, swept): (&Case, &SweptPath),
        axes: &[Unit<Vector3<f64>>],
        is_asked: impl Fn(usize) -> bool + Sync,
    ) -> Result<Vec<Option<EngagedForce>>, PlanError> {
        let fine = FineForce::new(case)?;
        let force = |i: usize| {
            let feed = self.feeds[i].filter(|_| is_asked(i))?;
            let weight = |density| fine.material.weight(density);
            Some(fine.of(swept.bone_at(i as u32, fine.kernel.sample_radius_mm(), weight), &axes[i], &feed))
        };
        Ok((0..self.points.len()).into_par_iter().map(force).collect())
    }

    /// Computes the force as finely as where moves end at the place within each move where it seems largest: the whole force, and that toward
    /// each of the structures that are `near`.
    ///
    /// # Errors
    /// When the tool, the material or the arm's limits are not usable.
    pub fn largest_finely(
        &self,
        (case, swept, near): (&Case, &SweptPath, &[Vec<NearStructure>]),
        axes: &[Unit<Vector3<f64>>],
        (ends, within): (&[Option<EngagedForce>], &mut [Vec<ForceWithin>]),
    ) -> Result<(), PlanError> {
        let fine = FineForce::new(case)?;
        let looks = if sampled::has_edges(case) { LOOKED_AT_WITH_EDGES } else { LOOKED_AT };
        let of_move = |(i, places): (usize, &mut Vec<ForceWithin>)| {
            let pushes = |force: &EngagedForce| force.force_n(case.speed.nominal_mm_s);
            let mut is_fine: Vec<bool> = places.iter().map(|place| place.at == 0.0).collect();
            let each = near[i].iter().map(Some).chain([None]);
            for near in each.flat_map(|near| std::iter::repeat_n(near, looks)) {
                let along = |n: &Vector3<f64>, at| near.map_or_else(|| n.norm(), |near| near.most(n, at));
                let size =
                    |at: f64, force: &EngagedForce| along(&pushes(force), at).max(along(&force.edge_n, at));
                let size_of = |place: &ForceWithin| size(place.at, &place.force);
                let known = places.iter().zip(&is_fine).filter(|(_, fine)| **fine);
                let known = known.map(|(place, _)| size_of(place));
                let largest = known.chain(ends[i].as_ref().map(|end| size(1.0, end))).fold(0.0, f64::max);
                let coarse = (0..places.len()).filter(|n| !is_fine[*n]);
                let next = coarse.max_by(|a, b| size_of(&places[*a]).total_cmp(&size_of(&places[*b])));
                if let Some(n) = next.filter(|n| size_of(&places[*n]) > AS_LARGE * largest) {
                    is_fine[n] = true;
                    let (weight, at) = (|density| fine.material.weight(density), places[n].at);
                    let found = swept.bone_within((i as u32, at), fine.kernel.sample_radius_mm(), weight);
                    if let Some((feed, bone)) = found {
                        places[n].force = fine.of(bone, &axis_within(axes, i, at), &feed);
                    }
                }
            }
        };
        within.par_iter_mut().enumerate().for_each(of_move);
        Ok(())
    }

    /// The path as it is planned, with what is gone when each move comes.
    pub fn swept(&self, case: &Case) -> SweptPath<'_> {
        let ball = Ball { radius_mm: case.burr.radius_mm };
        SweptPath::new(self.scene, self.removal, self.points, ball)
    }

    /// The path as the arm drives it.
    ///
    /// # Errors
    /// When the arm's limits are not usable.
    pub fn rounded(
        &self,
        (start, case): (&Start, &Case),
        motion: &ArmMotion,
    ) -> Result<SweptPath<'_>, PlanError> {
        let (corners, ball) =
            (rounded_corners((start, case), motion)?, Ball { radius_mm: case.burr.radius_mm });
        Ok(SweptPath::driven(self.scene, self.removal, self.points, ball, &corners))
    }

    /// Forces at places within every move of the driven path, given those at the ends of moves that are planned to remove something. They are
    /// computed where the force varies, and where its part toward one of the structures that are `near` does.
    pub fn within(
        &self,
        (sampled, swept, near): (&SampledForce, &SweptPath, &[Vec<NearStructure>]),
        axes: &[Unit<Vector3<f64>>],
        ends: &[Option<EngagedForce>],
    ) -> Vec<Vec<ForceWithin>> {
        let pushes = |force: &EngagedForce| force.force_n(sampled.nominal_mm_s);
        let largest_n = ends.iter().flatten().map(|force| pushes(force).norm()).fold(0.0, f64::max);
        let [toward_apart, toward_least] =
            if sampled.has_edges { [APART_WITH_EDGES, VARIES_LEAST] } else { [APART_TOWARD, VARIES_TOWARD] };
        let of_move = |i: usize| {
            let at = |share: f64| {
                let weight = |density| sampled.weight(density);
                let (feed, bone) = swept.bone_within((i as u32, share), sampled.radius_mm(), weight)?;
                let axis = axis_within(axes, i, share);
                let mut samples = EngagedSamples::default();
                sampled.gather(&mut samples, &sampled.nominal(&feed), bone);
                Some(sampled.of(&samples, &axis))
            };
            let found_at = |share: f64| Some((share, at(share)?));
            // at 0 is what the move before ends with
            let skins = around_back(swept, i).into_iter().map(|share| share.max(f64::MIN_POSITIVE));
            let begins = self.goes_straight_on(i).filter(|_| !swept.is_rounded(i - 1));
            let begins = begins.and_then(|before| Some((0.0, ends[before]?)));
            let begins = begins.or_else(|| found_at(IN_CORNERS[0]));
            let turns = Some(IN_CORNERS[1]).filter(|_| swept.is_rounded(i)).and_then(found_at);
            let end = ends[i].map(|end| (1.0, end)).or_else(|| found_at(1.0));
            let mut places: Vec<_> =
                begins.into_iter().chain(found_at(MIDDLE)).chain(turns).chain(end).collect();
            // pairs whose forces may differ too much
            let mut pairs: Vec<_> = places.windows(2).map(|pair| [pair[0], pair[1]]).collect();
            while let Some([from, to]) = pairs.pop() {
                let [a, b] = [pushes(&from.1), pushes(&to.1)];
                let varies = |change_n: f64, largest_here_n: f64, least: f64| {
                    change_n > sampled.force_change * largest_here_n + least * largest_n
                };
                let varies_toward = |n: &NearStructure| {
                    let [a, b] = [n.most(&a, from.0), n.most(&b, to.0)];
                    varies((a - b).abs(), a.max(b).max(0.0), toward_least)
                };
                let apart = to.0 - from.0;
                let varies = apart > APART && varies((a - b).norm(), a.norm().max(b.norm()), VARIES_LEAST)
                    || apart > toward_apart && near[i].iter().any(varies_toward);
                if !varies {
                    continue;
                }
                let middle = 0.5 * (from.0 + to.0);
                if let Some(force) = at(middle) {
                    places.push((middle, force));
                    pairs.extend([[from, (middle, force)], [(middle, force), to]]);
                }
            }
            let mut found =
                if ends[i].is_some() { shared(places) } else { cutting(places.into_iter()).collect() };
            found.extend(cutting(skins.chain(turning(swept, i, sampled.has_edges)).filter_map(found_at)));
            found
        };
        (0..self.points.len()).into_par_iter().map(of_move).collect()
    }

    /// The move before move i, if i goes on in its direction.
    fn goes_straight_on(&self, i: usize) -> Option<usize> {
        let before = i.checked_sub(1)?;
        let (from, to) = (self.feeds[before]?, self.feeds[i]?);
        (from.angle(&to) < STRAIGHT_RAD).then_some(before)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_over_a_move_is_that_of_a_force_that_grows_along_it() {
        // per mm/s along x, and an edge force along y
        let at = |share: f64| EngagedForce {
            cut_n_per_mm_s: Vector3::x() * (0.2 + share),
            edge_n: Vector3::y() * share,
            mrr_mm2: 1.0,
            ..EngagedForce::ZERO
        };
        let within = shared([0.5, 0.1, 0.9, 1.0].map(|share| (share, at(share))).into());
        assert_eq!(within.len(), 3);
        let mean = |of: fn(&Vector3<f64>) -> f64| {
            mean_of_move(Some(&at(1.0)), &within, [2.0, 1.0, 1e3], |way| way * way, |force, _| of(force))
        };
        // exact but for the first tenth, which counts as its end
        assert!((mean(|force| force.x) - 2.0 * (0.7 + 0.005)).abs() < 1e-12);
        // each place until the middle to the next one, by the time that has passed there
        let until = [0.3f64, 0.7, 0.95, 1.0].map(|way| way * way);
        let took = [until[0], until[1] - until[0], until[2] - until[1], until[3] - until[2]];
        let edges = took[0] * 0.1 + took[1] * 0.5 + took[2] * 0.9 + took[3];
        assert!((mean(|force| force.y) - edges).abs() < 1e-12);
        assert_eq!(mean_of_move(Some(&at(1.0)), &[], [2.0, 1.0, 2.0], |way| way, |force, _| force.x), 2.4);
    }
}
