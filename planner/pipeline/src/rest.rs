//! Why a part of the target stays: every voxel that is not removed counts for one cause, so that the causes add up.
//!
//! Of what the ball can reach, a voxel counts for the place nearest to it that the shank could not get to, else for the
//! path's spacing. Of what it cannot reach, a voxel counts for a structure when this structure's clearance alone, with the
//! bone around, keeps the ball from it; for several clearances at once when more than one does so by itself, or only all
//! together (where clearances keep less than [`FEW_SHARE`] of the target, for the structure whose required distance the voxel
//! misses most: no more free spaces are computed for so little); for thin bone when bone alone keeps the ball from it, and no longer without the thin bone outside the target:
//! what `target.sheets = "keep"` costs; for the burr's radius when a burr of [`SMALLEST_BURR_VOXELS`] would reach it
//! without any clearance; for the bone around it otherwise. What lies beyond the scan counts as that.

use bonemill_case::Case;
use bonemill_cutting::cutter::Ball;
use bonemill_cutting::stock::removal::RemovalTime;
use bonemill_imaging::{ImageError, distance_within};
use bonemill_planfile::{StoredPlan, read_dropped};
use bonemill_setup::PlanError;
use bonemill_toolpath::scene::{Class, Scene};
use bonemill_toolpath::space::BurrSpace;

use super::reach::Dropped;

/// Radius of the smallest burr that the planning grid can show, voxels: half of what a case's burr must have at least.
const SMALLEST_BURR_VOXELS: f64 = 2.0;
/// Where clearances keep less than this share of the target, a voxel is counted for the nearest structure alone.
const FEW_SHARE: f64 = 0.01;

/// What keeps a part of the target from being removed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum RestCause {
    /// The clearance of one structure, by its place in the case.
    Clearance(usize),
    /// More than one clearance, each by itself or only together.
    Clearances,
    /// The ball does not fit into a corner or a narrow place.
    BurrRadius,
    /// Thin bone outside the target leaves no way or no room.
    ThinBone,
    /// Other bone outside the target does.
    Bone,
    /// The shank or the tilt limit, in words.
    Shank(String),
    /// The lines of the path are too far apart, or passes could not be joined.
    Spacing,
    /// The scan does not hold it.
    OutsideScan,
}

impl RestCause {
    /// In words that follow "kept by".
    pub fn text(&self, case: &Case) -> String {
        match self {
            Self::Clearance(n) => {
                format!("clearance of {}", case.structures.get(*n).map_or("", |s| s.name.as_str()))
            }
            Self::Clearances => "several clearances at once".into(),
            Self::BurrRadius => "burr's radius (corners, narrow places)".into(),
            Self::ThinBone => "thin bone outside it that is kept (target.sheets)".into(),
            Self::Bone => "bone around it that must stay".into(),
            Self::Shank(why) => format!("shank or tilt ({why})"),
            Self::Spacing => "path's spacing".into(),
            Self::OutsideScan => "end of the scan".into(),
        }
    }
}

/// How much of the target each cause keeps, mm³, the largest first; together target + outside − removed.
///
/// # Errors
/// When a distance field cannot be made.
pub fn rest(
    scene: &Scene,
    space: &BurrSpace,
    removal: &RemovalTime,
    dropped: &[Dropped],
) -> Result<Vec<(RestCause, f64)>, ImageError> {
    let voxel_mm3 = scene.target_voxel_mm3;
    let found = rest_voxels(scene, space, |n| removal.is_removed(n), dropped)?;
    let mut rest: Vec<(RestCause, f64)> =
        found.into_iter().map(|(cause, voxels)| (cause, voxels.len() as f64 * voxel_mm3)).collect();
    if scene.outside.mm3.total() > 0.0 {
        rest.push((RestCause::OutsideScan, scene.outside.mm3.total()));
    }
    rest.sort_by(|a, b| b.1.total_cmp(&a.1));
    Ok(rest)
}

/// The voxels of the scene that each cause keeps in a finished plan of milling, in no order, by what `is_removed` says of a voxel. The places
/// that the shank could not get to are those of the plan's `dropped.csv`; without that file their voxels count for the path's spacing.
///
/// # Errors
/// [`PlanError::File`] for a `dropped.csv` that cannot be read, [`PlanError::Image`] when a distance field cannot be made.
pub fn rest_of(
    plan: &StoredPlan,
    scene: &Scene,
    is_removed: impl Fn(usize) -> bool,
) -> Result<Vec<(RestCause, Vec<usize>)>, PlanError> {
    let case = &plan.record.case;
    let space = BurrSpace::new(scene, Ball { radius_mm: case.burr.radius_mm }, &case.clearances_mm())?;
    let work_from_ct = scene.ct_from_work.inverse();
    let dropped: Vec<Dropped> = read_dropped(&plan.dir)?
        .into_iter()
        .map(|(place, reason)| Dropped { position: work_from_ct * place, reason })
        .collect();
    Ok(rest_voxels(scene, &space, is_removed, &dropped)?)
}

/// The voxels that each cause keeps, by the order of their first mention.
fn rest_voxels(
    scene: &Scene,
    space: &BurrSpace,
    is_removed: impl Fn(usize) -> bool,
    dropped: &[Dropped],
) -> Result<Vec<(RestCause, Vec<usize>)>, ImageError> {
    let class = scene.class.data();
    let left: Vec<usize> =
        (0..class.len()).filter(|n| class[*n].is(Class::TARGET) && !is_removed(*n)).collect();
    let (reachable, unreachable): (Vec<usize>, Vec<usize>) =
        left.into_iter().partition(|n| space.reachable()[*n]);
    let without_structures = BurrSpace::new(scene, space.ball(), &[])?;
    let (by_structures, by_bone): (Vec<usize>, Vec<usize>) =
        unreachable.into_iter().partition(|n| without_structures.reachable()[*n]);
    let without_thin = reachable_without_thin(scene, space)?;
    let (by_thin, by_bone): (Vec<usize>, Vec<usize>) =
        by_bone.into_iter().partition(|n| without_thin.as_ref().is_some_and(|reachable| reachable[*n]));
    let mut kept = Kept(Vec::new());
    reachable.iter().for_each(|n| kept.add(left_by_path(scene, space, dropped, *n), &[*n]));
    kept.add(RestCause::ThinBone, &by_thin);
    by_clearances(scene, space, &by_structures, &mut kept)?;
    by_radius(scene, &by_bone, &mut kept)?;
    Ok(kept.0)
}

/// What the ball could reach if thin bone were no obstacle; `None` where there is none.
fn reachable_without_thin(scene: &Scene, space: &BurrSpace) -> Result<Option<Vec<bool>>, ImageError> {
    if scene.count(Class::THIN) == 0 {
        return Ok(None);
    }
    let thick = scene.class.map(|c| c.is(Class::OBSTACLE) && !c.is(Class::THIN));
    let thick_mm = distance_within(&thick, 2.0 * space.radius_mm())?;
    Ok(Some(space.among_others(thick_mm.as_ref())?.reachable().to_vec()))
}

/// Voxels by cause, in the order of their first mention.
struct Kept(Vec<(RestCause, Vec<usize>)>);

impl Kept {
    fn add(&mut self, cause: RestCause, voxels: &[usize]) {
        match self.0.iter_mut().find(|(known, _)| *known == cause) {
            Some((_, kept)) => kept.extend_from_slice(voxels),
            None if !voxels.is_empty() => self.0.push((cause, voxels.to_vec())),
            None => {}
        }
    }
}

/// Why a voxel that the ball can reach stays: the nearest dropped place from which the ball would have removed it.
fn left_by_path(scene: &Scene, space: &BurrSpace, dropped: &[Dropped], voxel: usize) -> RestCause {
    let p = scene.class.grid().center(scene.class.grid().voxel(voxel));
    let near = dropped.iter().map(|place| (place.position.distance_mm(&p), place));
    let near = near.filter(|(mm, _)| *mm <= space.radius_mm()).min_by(|a, b| a.0.total_cmp(&b.0));
    near.map_or(RestCause::Spacing, |(_, place)| RestCause::Shank(place.reason.clone()))
}

/// Which clearances keep `voxels`, which the ball would reach without any.
fn by_clearances(
    scene: &Scene,
    space: &BurrSpace,
    voxels: &[usize],
    kept: &mut Kept,
) -> Result<(), ImageError> {
    let near: Vec<usize> =
        (0..scene.structures.len()).filter(|n| scene.structures[*n].field.is_some()).collect();
    if let [only] = near[..] {
        kept.add(RestCause::Clearance(only), voxels);
        return Ok(());
    }
    if (voxels.len() as f64) < FEW_SHARE * scene.count(Class::TARGET) as f64 {
        voxels
            .iter()
            .filter_map(|n| Some((nearest_limit(scene, space, *n)?, n)))
            .for_each(|(s, n)| kept.add(RestCause::Clearance(s), &[*n]));
        return Ok(());
    }
    let mut keepers: Vec<Vec<usize>> = vec![Vec::new(); voxels.len()];
    for structure in near {
        let alone = BurrSpace::new(scene, space.ball(), &alone(space, structure))?;
        for (keepers, n) in keepers.iter_mut().zip(voxels) {
            if !alone.reachable()[*n] {
                keepers.push(structure);
            }
        }
    }
    for (keepers, n) in keepers.iter().zip(voxels) {
        kept.add(
            if let [only] = keepers[..] { RestCause::Clearance(only) } else { RestCause::Clearances },
            &[*n],
        );
    }
    Ok(())
}

/// The structure whose required distance is missed most at a voxel.
fn nearest_limit(scene: &Scene, space: &BurrSpace, voxel: usize) -> Option<usize> {
    let grid = scene.class.grid();
    let p = scene.ct_from_work * grid.center(grid.voxel(voxel));
    let margin = |(number, keep): (usize, &f64)| {
        let field = scene.structures[number].field.as_ref()?;
        Some((field.distance(p) - keep, number))
    };
    let margins = space.keep_mm().iter().enumerate().filter_map(margin);
    margins.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, number)| number)
}

/// The clearances of a space with every structure but one left out, mm.
fn alone(space: &BurrSpace, structure: usize) -> Vec<f64> {
    let clearance = |n: usize| if n == structure { space.clearance_mm(n) } else { f64::NEG_INFINITY };
    (0..space.keep_mm().len()).map(clearance).collect()
}

/// Which of `voxels`, which bone keeps from the ball, a small burr would reach.
fn by_radius(scene: &Scene, voxels: &[usize], kept: &mut Kept) -> Result<(), ImageError> {
    if voxels.is_empty() {
        return Ok(());
    }
    let smallest_mm = SMALLEST_BURR_VOXELS * scene.class.grid().spacing_mm().x;
    let small = BurrSpace::new(scene, Ball { radius_mm: smallest_mm }, &[])?;
    let (narrow, closed): (Vec<usize>, Vec<usize>) = voxels.iter().partition(|n| small.reachable()[**n]);
    kept.add(RestCause::BurrRadius, &narrow);
    kept.add(RestCause::Bone, &closed);
    Ok(())
}
