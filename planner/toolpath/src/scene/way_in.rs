//! The way in: how much of a target burr and shank reach along a direction, and the direction along which they reach most.
//!
//! On a coarse map of the scan, bone outside the target and structures are solid. Places of the burr's centre are sampled at the
//! target, where the ball is clear of what is solid and keeps the structures' clearances. From each place a line leads out along
//! each of [`DIRECTIONS`] directions; it is free where the shank's profile and, since the burr comes that way, the ball fit between solid
//! voxels over the shank's whole length. Beyond the scan the voxels of its faces go on outwards.
//!
//! A direction reaches a place if some line within the tilt limit of it is free. Directions are ranked by the mean over all places of the best such line,
//! which counts less the more it is tilted and the deeper it begins: a way through soft tissue is open, but the shortest one is meant. Directions are laid
//! out in the target's own inertia axes, so that a mirrored or turned scan gives the mirrored or turned approach. Where the arm's place is known, only
//! lines count along which it holds the tool at the outermost places, if any of them is free; an arm that tilts about one axis has directions across it only.
//!
//! Cost: places × directions lines, each by sphere tracing in a distance field.

use std::f64::consts::PI;

use bonemill_geometry::{Ct, Point, Volume, basis, cancel};
use bonemill_imaging::{Region, distance_within};
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

mod coarse;
mod way;

use self::coarse::{Holds, coarse};
pub(super) use self::way::words;
pub use self::way::{ApproachSpec, ArmHolds, ChosenWay, HoldsAt, Tilts, Way, WayInTool};
use super::{SceneError, SceneSpec, SceneStructure};

/// Directions on the sphere: 10° apart.
const DIRECTIONS: usize = 420;
/// Directions in a plane: 5° apart.
const IN_PLANE: usize = 72;
/// Between rings of directions around a given one, rad.
const RINGS_RAD: f64 = 0.17;
/// Places of the burr from which lines lead out.
const PLACES: usize = 400;
/// Finest and coarsest spacing of the first map, mm; half of the burr's radius in between.
const SPACING_MM: [f64; 2] = [0.4, 1.0];
/// A line stands for those within this angle of it, half of that between directions, rad: so much less room will do per mm.
const SPREAD: f64 = 0.08;
/// Longest step along a line, mm.
const LONGEST_STEP_MM: f64 = 4.0;
/// How deep below air a place must lie for its line to count e times less, mm: assumed.
const DEEP_MM: f64 = 30.0;
/// How much less a line at the tilt limit counts than a straight one.
const TILTED_LESS: f64 = 0.5;
/// A direction is the mean of those this near to the best one that rank nearly as high.
const CONE_RAD: f64 = 0.5;
const NEARLY: f64 = 0.9;
/// How often the mean is taken anew around the last, until it moves by less than this; it must rank as high as the best but for rounding.
const MOST_SHIFTS: usize = 12;
const SHIFTED_RAD: f64 = 0.02;
const AS_HIGH: f64 = 0.99;
/// Directions this far apart are ways of their own; how many others are told.
const APART_RAD: f64 = 0.8;
const MOST_OTHERS: usize = 2;
/// A chosen direction's components are rounded to this.
const ROUNDED_TO: f64 = 1e-4;
/// A given direction is refused if it reaches less than the first share of places where another reaches at least the second; a few places
/// say nothing.
const FACES_BONE: [f64; 2] = [0.03, 0.5];
const FEW: usize = 10;

/// Lines from places at the target.
pub(super) struct WayIn {
    holds: Volume<Holds, Ct>,
    /// Distance to what is solid, mm, and to that part of it which lies at the scan's faces; `None`: nothing is.
    solid_mm: Option<Volume<f32, Ct>>,
    solid_face_mm: Option<Volume<f32, Ct>>,
    places: Vec<Point<Ct>>,
    /// Where the shank's parts begin, and the radius that must be free from there on, mm.
    profile: Vec<[f64; 2]>,
    length_mm: f64,
    tilt_limit_rad: f64,
    tilts: Tilts,
    directions: Vec<Vector3<f64>>,
    /// Those places that lie farthest along the target's inertia axes and against them.
    outermost: Vec<Point<Ct>>,
}

/// The approach of a scene, and how it was chosen if it was. `target`: its points, and the region around them.
///
/// # Errors
/// [`SceneError::NoRoom`], [`SceneError::NoApproach`] and [`SceneError::FacesBone`] where the tool reaches nothing.
pub(super) fn approach(
    spec: &SceneSpec,
    target: (&[Point<Ct>], &Region),
    structures: &[SceneStructure],
) -> Result<(Vector3<f64>, Option<ChosenWay>), SceneError> {
    let (given, tool, arm) = match &spec.approach {
        ApproachSpec::Fixed(direction) => return Ok((*direction, None)),
        ApproachSpec::For { given, tool, arm } => (*given, tool, *arm),
    };
    let way_in = WayIn::new(spec, tool, target, structures)?;
    match (given, way_in) {
        (Some(direction), Some(way_in)) => way_in.check(direction).map(|()| (direction, None)),
        (Some(direction), None) => Ok((direction, None)),
        (None, Some(way_in)) => {
            let chosen = arm.and_then(|arm| way_in.best(Some(arm))).or_else(|| way_in.best(None));
            let mut chosen = chosen.ok_or(SceneError::NoApproach)?;
            // the same for a scan that is stored otherwise, whose header has single precision
            let mut rounded = chosen.best.direction.map(|c| (c / ROUNDED_TO).round() * ROUNDED_TO);
            if let Tilts::About { hinge, .. } = tool.tilts {
                rounded -= hinge * hinge.dot(&rounded);
            }
            // no minus before a zero
            chosen.best.direction = rounded.normalize().map(|c| c + 0.0);
            Ok((chosen.best.direction, Some(chosen)))
        }
        (None, None) => Err(SceneError::NoRoom { radius_mm: spec.tool.cutter_radius_mm }),
    }
}

impl WayIn {
    /// On a map as coarse as the burr allows, or on finer ones where the burr finds no place at the target; `None` where it finds none on the CT's
    /// own voxels.
    ///
    /// # Errors
    /// When a distance field cannot be computed.
    pub fn new(
        spec: &SceneSpec,
        tool: &WayInTool,
        target: (&[Point<Ct>], &Region),
        structures: &[SceneStructure],
    ) -> Result<Option<Self>, SceneError> {
        let [finest, coarsest] = SPACING_MM;
        let first_mm = (0.5 * spec.tool.cutter_radius_mm).clamp(finest, coarsest);
        for spacing_mm in [first_mm, 0.5 * first_mm, 0.0] {
            let found = Self::on_map(spec, tool, target, structures, spacing_mm)?;
            if found.is_some() {
                return Ok(found);
            }
        }
        Ok(None)
    }

    /// On a map of about this spacing, mm.
    fn on_map(
        spec: &SceneSpec,
        tool: &WayInTool,
        (target, around): (&[Point<Ct>], &Region),
        structures: &[SceneStructure],
        spacing_mm: f64,
    ) -> Result<Option<Self>, SceneError> {
        let radius_mm = spec.tool.cutter_radius_mm;
        let length_mm = spec.tool.shank_length_mm;
        let reach_mm = length_mm + spec.tool.shank_radius_mm;
        let holds = coarse(spec, (target, around), reach_mm, spacing_mm)?;
        cancel::poll();
        let widest_mm = spec.tool.shank_radius_mm.max(radius_mm);
        let mut solid = holds.map(|h| *h == Holds::Solid);
        let solid_mm = distance_within(&solid, 2.0 * widest_mm)?;
        let dims = holds.grid().dims();
        for n in 0..holds.grid().len() {
            let voxel = holds.grid().voxel(n);
            let is_at_face = (0..3).any(|a| voxel[a] == 0 || voxel[a] + 1 == dims[a]);
            solid.data_mut()[n] &= is_at_face;
        }
        let solid_face_mm = distance_within(&solid, 2.0 * widest_mm)?;
        let slack_mm = 0.5 * holds.grid().spacing_mm().max();
        let from_target = distance_within(&holds.map(|h| *h == Holds::Target), radius_mm + slack_mm)?;
        let Some(from_target) = from_target else { return Ok(None) };
        let grid = holds.grid();
        let is_place = |n: &usize| {
            let clear_mm = solid_mm.as_ref().map_or(f64::INFINITY, |d| f64::from(d.data()[*n]));
            let p = grid.center(grid.voxel(*n));
            let keeps = |(structure, clearance_mm): (&SceneStructure, &f64)| {
                !structure
                    .field
                    .as_ref()
                    .is_some_and(|field| field.is_nearer_than(p, radius_mm + clearance_mm))
            };
            f64::from(from_target.data()[*n]) <= 0.5 * radius_mm
                && clear_mm >= radius_mm - slack_mm
                && structures.iter().zip(spec.clearances_mm).all(keeps)
        };
        let found: Vec<usize> = (0..grid.len()).into_par_iter().filter(is_place).collect();
        let places: Vec<_> = found
            .iter()
            .step_by(found.len().div_ceil(PLACES).max(1))
            .map(|n| grid.center(grid.voxel(*n)))
            .collect();
        if places.is_empty() {
            return Ok(None);
        }
        let mut from_mm = 0.0;
        let mut profile = vec![[0.0, radius_mm]];
        for [part_mm, part_radius_mm] in &tool.shank_mm {
            // a part's front is flat: a ball of its radius fits behind it
            profile.push([from_mm + 0.5 * part_radius_mm, part_radius_mm.max(radius_mm)]);
            from_mm += part_mm;
        }
        let axes = inertia_axes(target);
        let directions = match tool.tilts {
            Tilts::About { hinge, zero } => {
                let at = |n: usize| 2.0 * PI * n as f64 / IN_PLANE as f64;
                (0..IN_PLANE).map(|n| zero * at(n).cos() + hinge.cross(&zero) * at(n).sin()).collect()
            }
            _ => (0..DIRECTIONS).map(|n| axes * basis::on_sphere(n, DIRECTIONS).into_inner()).collect(),
        };
        let farthest = |n: usize| {
            let axis = axes.column(n / 2) * [1.0, -1.0][n % 2];
            let along = |p: &&Point<Ct>| p.coords.dot(&axis);
            places.iter().max_by(|a, b| along(a).total_cmp(&along(b))).copied()
        };
        let outermost = (0..6).filter_map(farthest).collect();
        Ok(Some(Self {
            outermost,
            holds,
            solid_mm,
            solid_face_mm,
            places,
            profile,
            length_mm,
            tilt_limit_rad: tool.tilt_limit_rad,
            tilts: tool.tilts,
            directions,
        }))
    }

    /// How far the line from a place along a direction passes through tissue and target, mm; none where the line is not free.
    fn deep_mm(&self, from: Point<Ct>, direction: &Vector3<f64>) -> Option<f64> {
        let grid = self.holds.grid();
        let dims = grid.dims();
        let least_mm = 0.5 * grid.spacing_mm().min();
        let rounding_mm = 0.5 * grid.spacing_mm().max();
        let (mut at_mm, mut deep_mm, mut part) = (0.0, 0.0, 0);
        while at_mm < self.length_mm {
            while self.profile.get(part + 1).is_some_and(|[from_mm, _]| at_mm >= *from_mm) {
                part += 1;
            }
            let needs_mm = self.profile[part][1];
            let slack_mm = rounding_mm + (SPREAD * at_mm).min(0.3 * needs_mm);
            let index = grid.continuous_index(from + direction * at_mm);
            // beyond the scan its faces go on
            let within = |a: usize| index[a].clamp(0.0, dims[a] as f64 - 1.0);
            let voxel = std::array::from_fn(|a| within(a).round() as usize);
            let is_inside = (0..3).all(|a| (-0.5..dims[a] as f64 - 0.5).contains(&index[a]));
            let holds = *self.holds.get(voxel);
            if holds == Holds::Solid || (!is_inside && holds == Holds::Target) {
                return None;
            }
            let at_voxel = |field: &Option<Volume<f32, Ct>>| {
                field.as_ref().map_or(f64::INFINITY, |mm| f64::from(*mm.get(voxel)))
            };
            let beyond_mm = Vector3::from_fn(|a, _| (index[a] - within(a)) * grid.spacing_mm()[a]).norm();
            let clear_mm = at_voxel(&self.solid_mm).hypot(beyond_mm).min(at_voxel(&self.solid_face_mm));
            if clear_mm < needs_mm - slack_mm {
                return None;
            }
            // nothing on the way is nearer than this; the next part may be thicker
            let ahead =
                self.profile[part..].iter().take_while(|[from_mm, _]| *from_mm <= at_mm + LONGEST_STEP_MM);
            let widest_mm = ahead.map(|[_, radius_mm]| *radius_mm).fold(0.0, f64::max);
            let step_mm = (clear_mm - widest_mm).clamp(least_mm, LONGEST_STEP_MM);
            if holds != Holds::Air {
                deep_mm += step_mm;
            }
            at_mm += step_mm;
        }
        Some(deep_mm)
    }

    /// What a free line counts.
    fn counts(deep_mm: Option<f64>) -> f64 {
        deep_mm.map_or(0.0, |mm| (-mm / DEEP_MM).exp())
    }

    /// How much less a line counts that is tilted by an angle; 0 beyond the limit.
    fn tilted(&self, angle_rad: f64) -> f64 {
        if angle_rad > self.tilt_limit_rad + 1e-9 {
            return 0.0;
        }
        1.0 - TILTED_LESS * angle_rad / self.tilt_limit_rad.max(1e-9)
    }

    /// How high a direction ranks and what it reaches; `lines`: per place, what the line along each of `directions` counts. The line along the direction
    /// itself counts if it `is_held`.
    fn ranked(
        &self,
        direction: Vector3<f64>,
        is_held: bool,
        (directions, lines): (&[Vector3<f64>], &[Vec<f64>]),
    ) -> (f64, Way) {
        let hinge = match self.tilts {
            Tilts::Freely => None,
            Tilts::AboutBasisX => Some(basis::from_z(&direction).matrix().column(0).into_owned()),
            Tilts::About { hinge, .. } => Some(hinge),
        };
        let is_taken =
            |line: &Vector3<f64>| hinge.is_none_or(|hinge: Vector3<f64>| line.dot(&hinge).abs() <= SPREAD);
        let near: Vec<(usize, f64)> = (0..directions.len())
            .filter(|n| is_taken(&directions[*n]))
            .map(|n| (n, self.tilted(angle(&directions[n], &direction))))
            .filter(|(_, tilted)| *tilted > 0.0)
            .collect();
        let (mut rank, mut reached) = (0.0, 0usize);
        for (place, lines) in self.places.iter().zip(lines) {
            let best = near.iter().map(|(n, tilted)| tilted * lines[*n]).fold(0.0, f64::max);
            let straight = if is_held { Self::counts(self.deep_mm(*place, &direction)) } else { 0.0 };
            rank += best.max(straight);
            reached += usize::from(best.max(straight) > 0.0);
        }
        let count = self.places.len() as f64;
        (rank / count, Way { direction, reached: reached as f64 / count })
    }

    /// What lines along these directions count, per place.
    fn lines(&self, directions: &[Vector3<f64>]) -> Vec<Vec<f64>> {
        let of_place = |place: &Point<Ct>| {
            cancel::poll();
            directions.iter().map(|d| Self::counts(self.deep_mm(*place, d))).collect()
        };
        self.places.par_iter().map(of_place).collect()
    }

    /// The direction along which burr and shank reach most by lines along which the arm holds the tool; `None` where they reach nothing along any.
    pub fn best(&self, arm: Option<ArmHolds<'_>>) -> Option<ChosenWay> {
        let is_held = |line: &Vector3<f64>| arm.is_none_or(|arm| (arm.0)(&self.outermost, line));
        let are_held: Vec<bool> = self.directions.par_iter().map(is_held).collect();
        let along = || self.directions.iter().copied().zip(are_held.iter().copied());
        let held: Vec<_> = along().filter(|(_, is_held)| *is_held).map(|(line, _)| line).collect();
        let lines = self.lines(&held);
        let ranked_if = |(d, is_held)| self.ranked(d, is_held, (&held, &lines));
        let ranked_along = |d: &Vector3<f64>| ranked_if((*d, is_held(d)));
        let ranked: Vec<(f64, Way)> = along().collect::<Vec<_>>().into_par_iter().map(ranked_if).collect();
        let mut order: Vec<usize> = (0..ranked.len()).collect();
        order.sort_by(|a, b| ranked[*b].0.total_cmp(&ranked[*a].0));
        let mut ways: Vec<(f64, Way)> = Vec::new();
        for n in order {
            let is_apart =
                ways.iter().all(|(_, way)| angle(&way.direction, &ranked[n].1.direction) >= APART_RAD);
            if ranked[n].0 > 0.0 && is_apart && ways.len() <= MOST_OTHERS {
                ways.push(ranked[n]);
            }
        }
        let (rank, first) = *ways.first()?;
        // the middle of the directions that rank nearly as high: of many open ways the one with most room to its sides
        let mut best = first;
        for _ in 0..MOST_SHIFTS {
            let weight = |(of, way): &(f64, Way)| {
                let near = 1.0 - (angle(&way.direction, &best.direction) / CONE_RAD).powi(2);
                near.max(0.0) * (of - NEARLY * rank).max(0.0)
            };
            let mean: Vector3<f64> = ranked.iter().map(|found| found.1.direction * weight(found)).sum();
            let Some(direction) = mean.try_normalize(1e-12) else { break };
            let (shifted_rank, shifted) = ranked_along(&direction);
            if shifted_rank < AS_HIGH * rank {
                break;
            }
            let by_rad = angle(&shifted.direction, &best.direction);
            best = shifted;
            if by_rad <= SHIFTED_RAD {
                break;
            }
        }
        Some(ChosenWay {
            best,
            others: ways[1..].iter().map(|(_, way)| *way).collect(),
            by_arm: arm.is_some(),
        })
    }

    /// Directions within the tilt limit of one, on rings of its own basis, whose tilts in the plane are among them.
    fn around(&self, direction: &Vector3<f64>) -> Vec<Vector3<f64>> {
        if let Tilts::About { .. } = self.tilts {
            return self.directions.clone();
        }
        let from_z = basis::from_z(direction);
        let rings = (self.tilt_limit_rad / RINGS_RAD).ceil();
        let ring = |ring: usize| {
            let (sin, cos) = (self.tilt_limit_rad * ring as f64 / rings).sin_cos();
            let count = 4 * (0.5 * PI * sin / RINGS_RAD).ceil().max(1.0) as usize;
            (0..count).map(move |n| {
                let (s, c) = (2.0 * PI * n as f64 / count as f64).sin_cos();
                from_z * Vector3::new(sin * c, sin * s, cos)
            })
        };
        (1..=rings as usize).flat_map(ring).collect()
    }

    /// Refuses a direction along which hardly anything is reached where another reaches much.
    ///
    /// # Errors
    /// [`SceneError::FacesBone`].
    pub fn check(&self, direction: Vector3<f64>) -> Result<(), SceneError> {
        let around = self.around(&direction);
        let (_, given) = self.ranked(direction, true, (&around, &self.lines(&around)));
        let [least, most] = FACES_BONE;
        if given.reached >= least || self.places.len() < FEW {
            return Ok(());
        }
        match self.best(None) {
            Some(ChosenWay { best, .. }) if best.reached >= most => {
                Err(SceneError::FacesBone { given, best })
            }
            _ => Ok(()),
        }
    }
}

fn angle(a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
    a.dot(b).clamp(-1.0, 1.0).acos()
}

/// Principal axes as columns, each turned to where the third moment is positive: they mirror with the points.
fn inertia_axes(points: &[Point<Ct>]) -> Matrix3<f64> {
    let n = points.len().max(1) as f64;
    let mean = points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / n;
    let covariance = points
        .iter()
        .map(|p| {
            let d = p.coords - mean;
            d * d.transpose()
        })
        .sum::<Matrix3<f64>>()
        / n;
    let eigen = covariance.symmetric_eigen();
    let mut order = [0, 1, 2];
    order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
    let columns = order.map(|c| {
        let axis: Vector3<f64> = eigen.eigenvectors.column(c).into_owned();
        let skew: f64 = points.iter().map(|p| (p.coords - mean).dot(&axis).powi(3)).sum();
        if skew < 0.0 { -axis } else { axis }
    });
    Matrix3::from_columns(&columns)
}

#[cfg(test)]
mod tests;
