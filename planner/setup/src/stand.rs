//! Where a UR may stand: places of its base in a patch beside the patient from which it follows a case's target.
//!
//! The base stands upright. Turning it about its own z axis shifts the first joint's angle and changes nothing else, so its x axis
//! points at the target at every place, and three numbers remain. At each place of a grid over the patch the arm is led through
//! the target's outermost points with the shaft straight, and at its centre through the tilts that the case allows, by the
//! same search as a plan's path ([`bonemill_robot::resolve`]): one branch, joints within their ranges, base and links clear of the
//! patient and of obstacles. Distances between these poses are not looked at; a plan from the place that is found does that.
//!
//! The best place is the one with the largest tolerance: how far the base may stand from it, in any direction of the patch, and still
//! everything fits. It says in one unit how far joint limits, reach and links in the way are, at the poses that were tried, and it is what
//! a trolley that is set down needs. How near a singularity the arm comes is not judged.

use std::collections::BTreeMap;

use bonemill_arm::arm::AxisPose;
use bonemill_arm::{Arm, ArmKind};
use bonemill_case::{Case, OrientationMode};
use bonemill_geometry::{Base, Ct, Point, Rigid, cancel};
use bonemill_robot::resolve::{PosePath, Posture, ReachReason, RollFrame, resolve};
use bonemill_robot::room::{LinkMotion, Room};
use bonemill_toolpath::scene::{Class, Scene};
use nalgebra::{Matrix3, Rotation3, Unit, Vector3};
use rayon::prelude::*;

use super::setup::Setup;
use super::{PlanError, room};

/// The path begins so far above the target along the approach, mm. Assumed.
const ABOVE_MM: f64 = 20.0;
/// Largest turn of the shaft between poses, rad.
const TILT_STEP_RAD: f64 = 0.2;
/// Most places that are tried.
pub const MOST_PLACES: usize = 20_000;

/// Where the base may stand: a box along ct's axes about the target's centre, and which way is up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Patch {
    /// Up, unit in ct.
    pub up: Unit<Vector3<f64>>,
    /// The box's ends, in ct from the target's centre, mm.
    pub from_mm: Vector3<f64>,
    /// As `from_mm`, nowhere below it.
    pub to_mm: Vector3<f64>,
    /// Largest distance between places, mm, above 0.
    pub step_mm: f64,
}

impl Patch {
    /// Number of places along ct's axes.
    pub fn counts(&self) -> [usize; 3] {
        let along = |k: usize| ((self.to_mm[k] - self.from_mm[k]) / self.step_mm).ceil() as usize + 1;
        std::array::from_fn(along)
    }

    /// Distance between places along ct's axes, mm; 0 along an axis with one place.
    pub fn steps_mm(&self) -> Vector3<f64> {
        let counts = self.counts();
        Vector3::from_fn(|k, _| (self.to_mm[k] - self.from_mm[k]) / (counts[k].max(2) - 1) as f64)
    }

    /// The place with a number, the first axis fastest, from the target's centre, mm.
    pub fn place_mm(&self, n: usize) -> Vector3<f64> {
        let at = voxel(n, self.counts());
        self.from_mm + self.steps_mm().component_mul(&Vector3::from_fn(|k, _| at[k] as f64))
    }
}

/// A place of the base.
#[derive(Debug, Clone, PartialEq)]
pub struct Tried {
    /// From the target's centre, in ct, mm.
    pub at_mm: Vector3<f64>,
    /// Why the arm does not fit there; `None` where it does.
    pub fault: Option<Misfit>,
    /// Where it fits, how far from there the base may stand and it still fits, mm: up to the nearest place that does not, or that is
    /// beside the patch; nothing is known of places above and below it, and they do not count. 0 elsewhere.
    pub tolerance_mm: f64,
}

/// Why an arm does not fit at a place.
#[derive(Debug, Clone, PartialEq)]
pub struct Misfit {
    /// In words without figures, so that equal ones can be counted.
    pub why: String,
    /// How much nearer to something a link comes than it may, mm, where that is why.
    pub short_mm: Option<f64>,
}

/// How often an arm does not fit for one reason.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MisfitCount<'a> {
    /// The reason.
    pub why: &'a str,
    /// Number of places.
    pub count: usize,
    /// The least of their [`Misfit::short_mm`].
    pub least_short_mm: Option<f64>,
}

/// A patch and how the arm fits there.
#[derive(Debug, Clone, PartialEq)]
pub struct Standing {
    /// Where the arm was tried.
    pub patch: Patch,
    /// Every place, the first axis fastest.
    pub places: Vec<Tried>,
    /// Whether the shaft's tilts fit as well; without, no place holds them, and the shaft was straight.
    pub tilts: bool,
    /// The best place, if any.
    pub best: Option<BestPlace>,
}

/// The place with the largest tolerance.
#[derive(Debug, Clone, PartialEq)]
pub struct BestPlace {
    /// Its number.
    pub place: usize,
    /// The registration that the case would have there.
    pub base_from_ct: Rigid<Base, Ct>,
    /// The least distance of a link at and between the poses, mm, and what is near; `None` where links are not held against anything.
    pub links: Option<(f64, String)>,
}

impl Standing {
    /// Number of places that fit.
    pub fn fitting(&self) -> usize {
        self.places.iter().filter(|place| place.fault.is_none()).count()
    }

    /// Why places do not fit, the most frequent reason first.
    pub fn faults(&self) -> Vec<MisfitCount<'_>> {
        let mut counted: BTreeMap<&str, MisfitCount<'_>> = BTreeMap::new();
        for Misfit { why, short_mm } in self.places.iter().filter_map(|place| place.fault.as_ref()) {
            let entry =
                counted.entry(why).or_insert(MisfitCount { why, count: 0, least_short_mm: *short_mm });
            entry.count += 1;
            entry.least_short_mm = entry.least_short_mm.zip(*short_mm).map(|(a, b)| a.min(b));
        }
        let mut faults: Vec<_> = counted.into_values().collect();
        faults.sort_by_key(|fault| std::cmp::Reverse(fault.count));
        faults
    }
}

/// Tries the arm of a case at every place of a patch.
///
/// # Errors
/// [`PlanError::CannotStand`] for an arm that is no UR, for a patch that is none or has more than [`MOST_PLACES`].
pub fn search(setup: &Setup, patch: Patch) -> Result<Standing, PlanError> {
    let fault = |reason: String| Err(PlanError::CannotStand { reason });
    let Setup { case, arm, .. } = setup;
    if arm.kind() != ArmKind::Ur {
        return fault(format!("robot.model = {:?}: expected a UR, e.g. \"ur5e\"", case.robot.model));
    }
    let is_box = (0..3).all(|k| patch.from_mm[k] <= patch.to_mm[k]);
    if !(is_box && patch.step_mm.is_finite() && patch.step_mm > 0.0) {
        return fault("expected a patch whose ends ascend along x, y and z, and a step above 0 mm".into());
    }
    let extent = (patch.to_mm - patch.from_mm) / patch.step_mm;
    let count = extent.iter().map(|n| n.ceil() + 1.0).product::<f64>();
    if !(count.is_finite() && count <= MOST_PLACES as f64) {
        return fault(format!(
            "{count} places, at most {MOST_PLACES} are tried: widen the step, or narrow the patch"
        ));
    }
    let tilted = tried(setup, patch, true);
    Ok(if tilted.best.is_some() { tilted } else { tried(setup, patch, false) })
}

/// The whole patch along the poses of a case, with the shaft's tilts or without.
fn tried(setup: &Setup, patch: Patch, tilts: bool) -> Standing {
    let path = poses(&setup.case, &setup.scene, tilts);
    let count: usize = patch.counts().iter().product();
    let at = |n: usize| {
        cancel::poll();
        follow(setup, &base_from_ct(setup, &patch, patch.place_mm(n)), &path)
    };
    let found: Vec<_> = (0..count).into_par_iter().map(at).collect();
    let tolerances = tolerances_mm(&patch, &found.iter().map(Result::is_ok).collect::<Vec<_>>());
    // of the most tolerant places the one whose links are farthest from anything, the first of equal ones
    let most_mm = tolerances.iter().copied().fold(0.0, f64::max);
    let fits = found.iter().enumerate().filter_map(|(n, links)| Some((n, links.as_ref().ok()?)));
    let distance_mm = |links: &Links| links.as_ref().map_or(0.0, |(mm, _)| *mm);
    let best = fits
        .filter(|(n, _)| tolerances[*n] >= most_mm)
        .min_by(|(_, a), (_, b)| distance_mm(b).total_cmp(&distance_mm(a)));
    let best = best.map(|(place, links)| BestPlace {
        place,
        base_from_ct: base_from_ct(setup, &patch, patch.place_mm(place)),
        links: links.clone(),
    });
    let place = |(n, (links, tolerance_mm)): (usize, (Result<_, _>, f64))| Tried {
        at_mm: patch.place_mm(n),
        fault: links.err(),
        tolerance_mm,
    };
    let places = found.into_iter().zip(tolerances).enumerate().map(place).collect();
    Standing { patch, places, tilts, best }
}

/// The registration with the base at a place.
fn base_from_ct(setup: &Setup, patch: &Patch, at_mm: Vector3<f64>) -> Rigid<Base, Ct> {
    let target = (setup.scene.ct_from_work * setup.scene.target_center).coords;
    let z = patch.up.into_inner();
    let level = |v: Vector3<f64>| Unit::try_new(v - z * z.dot(&v), 1e-6);
    // a base right below the target faces anything
    let x = level(-at_mm).or_else(|| level(Vector3::x())).or_else(|| level(Vector3::y()));
    let x = x.unwrap_or_else(Vector3::x_axis).into_inner();
    let ct_from_base = Matrix3::from_columns(&[x, z.cross(&x), z]);
    let rotation = Rotation3::from_matrix_unchecked(ct_from_base.transpose());
    Rigid::new(rotation, -(rotation * (target + at_mm)))
}

/// The least distance of the links, mm, and what is near; none where they are held against nothing.
type Links = Option<(f64, String)>;
/// A pose of the burr in ct.
type CtPose = (Point<Ct>, Unit<Vector3<f64>>);

/// Poses that stand for a plan's path: from above to the target's outermost points with the shaft straight, then its tilts at the centre.
fn poses(case: &Case, scene: &Scene, tilts: bool) -> Vec<CtPose> {
    let grid = scene.class.grid();
    let target = || {
        let voxels = scene.class.data().iter().enumerate().filter(|(_, class)| class.is(Class::TARGET));
        voxels.map(|(n, _)| grid.center(grid.voxel(n)))
    };
    let farthest = |way: Vector3<f64>| {
        target()
            .max_by(|a, b| way.dot(&a.coords).total_cmp(&way.dot(&b.coords)))
            .unwrap_or(scene.target_center)
    };
    let (x, y, z) = (Vector3::x(), Vector3::y(), Vector3::z());
    let top = farthest(z);
    let outermost = [x, y, -x, -y, -z].map(farthest);
    let straight = Unit::new_normalize(scene.ct_from_work.rotate(&z));
    let places = [top + z * ABOVE_MM, top].into_iter().chain(outermost).chain([scene.target_center]);
    let mut path: Vec<CtPose> = places.map(|place| (scene.ct_from_work * place, straight)).collect();
    let limit_rad = case.orientation.tilt_limit_rad;
    if !tilts || case.orientation.mode == OrientationMode::Fixed || limit_rad <= 0.0 {
        return path;
    }
    let center = scene.ct_from_work * scene.target_center;
    let basis = scene.ct_from_approach().rotation;
    let hinges = [Vector3::x_axis(), Vector3::y_axis()].map(|axis| basis * axis);
    let steps = (limit_rad / TILT_STEP_RAD).ceil().max(1.0) as i32;
    for hinge in hinges.iter().take(case.orientation.angles as usize) {
        let there = (-steps..=steps).map(|n| f64::from(n) / f64::from(steps) * limit_rad);
        let first = (1..steps).map(|n| -f64::from(n) / f64::from(steps) * limit_rad);
        let last = (0..steps).rev().map(|n| f64::from(n) / f64::from(steps) * limit_rad);
        let turned = |rad: f64| (center, Rotation3::from_axis_angle(hinge, rad) * straight);
        path.extend(first.chain(there).chain(last).map(turned));
    }
    path
}

/// The least distance of the links along the poses, mm, and what is near, with the base at a place; or why the arm cannot follow them.
fn follow(setup: &Setup, base_from_ct: &Rigid<Base, Ct>, path: &[CtPose]) -> Result<Links, Misfit> {
    let Setup { case, arm, .. } = setup;
    let room: Option<Room> = setup.room.as_ref().map(|room| room::seen_from(case, room, base_from_ct));
    if let Some(meeting) = room.as_ref().and_then(room::base_meets) {
        return Err(why(arm, &ReachReason::Meets(meeting)));
    }
    let in_base = |axis: &Unit<Vector3<f64>>| Unit::new_normalize(base_from_ct.rotate(axis));
    let pose = |(place, axis): &CtPose| AxisPose { position: *base_from_ct * *place, axis: in_base(axis) };
    let poses: Vec<AxisPose> = path.iter().map(pose).collect();
    let length_mm: Vec<f64> =
        std::iter::once(0.0).chain(path.windows(2).map(|pair| (pair[1].0 - pair[0].0).norm())).collect();
    let Some((_, straight)) = path.first() else { return Ok(None) };
    let path = PosePath {
        poses: &poses,
        length_mm: &length_mm,
        frame: RollFrame::about(&in_base(straight)),
        stiffness: None,
        posture: case.robot.branch.map_or(Posture::Any, Posture::Of),
        room: room.as_ref(),
    };
    let resolved = resolve(arm, &path).map_err(|error| Misfit { why: error.to_string(), short_mm: None })?;
    let resolved = resolved.map_err(|failed| why(arm, &failed.reason))?;
    let least = room.and_then(|room| {
        let least = room.along(LinkMotion { q: &resolved.q })?;
        Some((least.nearest.distance_mm, room.name(least.nearest.other)))
    });
    Ok(least)
}

/// A reason, its figures apart.
fn why(arm: &Arm, reason: &ReachReason) -> Misfit {
    let short_mm = match reason {
        ReachReason::Meets(meeting) => Some((meeting.clearance_mm - meeting.distance_mm).max(0.0)),
        _ => None,
    };
    let why = match reason {
        ReachReason::Beyond { .. } => "out of reach".into(),
        ReachReason::Axis { .. } => "the arm cannot tilt so".into(),
        ReachReason::Limit(excess) => {
            let name = arm.joints().get(excess.joint).map_or("", |joint| &joint.name);
            format!("joint {} ({name}) would leave its range", excess.joint + 1)
        }
        ReachReason::Meets(meeting) => format!("the arm's {} meets {}", meeting.link, meeting.other),
        ReachReason::Branch => "not on the branch that robot.branch asks for".into(),
        ReachReason::Jump => "the joints would have to jump".into(),
    };
    Misfit { why, short_mm }
}

/// For each place that fits, the distance to the nearest that does not, or that is outside the patch, mm.
fn tolerances_mm(patch: &Patch, fits: &[bool]) -> Vec<f64> {
    let (counts, steps) = (patch.counts(), patch.steps_mm());
    let upright = patch.up.iamax();
    let misfits: Vec<[usize; 3]> = (0..fits.len()).filter(|n| !fits[*n]).map(|n| voxel(n, counts)).collect();
    let of = |n: usize| {
        if !fits[n] {
            return 0.0;
        }
        let at = voxel(n, counts);
        let to_edge = (0..3).filter(|k| counts[*k] > 1 && *k != upright).map(|k| {
            let places = at[k].min(counts[k] - 1 - at[k]) + 1;
            places as f64 * steps[k]
        });
        let to_misfit = misfits
            .iter()
            .map(|other| Vector3::from_fn(|k, _| at[k].abs_diff(other[k]) as f64 * steps[k]).norm());
        to_edge.chain(to_misfit).fold(f64::INFINITY, f64::min)
    };
    (0..fits.len()).into_par_iter().map(of).collect()
}

/// The place of an entry, the first axis fastest.
fn voxel(n: usize, counts: [usize; 3]) -> [usize; 3] {
    [n % counts[0], n / counts[0] % counts[1], n / (counts[0] * counts[1])]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn patch(from: [f64; 3], to: [f64; 3], step_mm: f64) -> Patch {
        Patch { up: Vector3::z_axis(), from_mm: from.into(), to_mm: to.into(), step_mm }
    }

    #[test]
    fn places_span_the_patch_in_equal_steps_no_longer_than_asked() {
        let patch = patch([-100.0, 0.0, 5.0], [100.0, 30.0, 5.0], 60.0);
        assert_eq!(patch.counts(), [5, 2, 1]);
        assert_eq!(patch.steps_mm(), Vector3::new(50.0, 30.0, 0.0));
        assert_eq!(patch.place_mm(0), Vector3::new(-100.0, 0.0, 5.0));
        assert_eq!(patch.place_mm(9), Vector3::new(100.0, 30.0, 5.0));
    }

    #[test]
    fn a_tolerance_is_the_distance_to_the_next_place_that_does_not_fit_or_lies_beside_the_patch() {
        // 5 x 5 x 2 places 10 mm apart; one of the lower layer does not fit
        let patch = patch([0.0; 3], [40.0, 40.0, 10.0], 10.0);
        let mut fits = vec![true; 50];
        fits[2 + 5 * 3] = false;
        let found = tolerances_mm(&patch, &fits);
        assert_eq!(found[2 + 5 * 3], 0.0);
        assert_eq!(found[2 + 5 * 2], 10.0);
        // the upper layer's middle: diagonally above what does not fit
        assert!((found[2 + 5 * 2 + 25] - 200.0f64.sqrt()).abs() < 1e-12);
        // a corner: the patch ends one step beside it
        assert_eq!(found[0], 10.0);
        // with one layer less nothing changes beside the patch
        let flat = Patch { to_mm: Vector3::new(40.0, 40.0, 0.0), ..patch };
        assert_eq!(tolerances_mm(&flat, &[true; 25])[12], 30.0);
    }
}
