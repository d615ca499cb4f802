//! What levels of force weigh at every waypoint, and which levels a plan's speeds keep.
//!
//! A push toward a structure is weighted by the law of importance ([`Importance`]). So a newton toward the most important structure at its
//! clearance weighs 1, and the levels are newtons (or mm of deflection) there.

use bonemill_case::{Case, ForceTerm, SpeedMode};
use bonemill_cutting::burr::{EngagedForce, ModelError};
use bonemill_cutting::importance::Importance;
use bonemill_cutting::speed::{CutPushes, Levels};
use bonemill_setup::nearest_structures::NearStructure;
use nalgebra::Matrix3;

use super::axis_cost::Weighted;
use super::path_forces::{ForceWithin, places_of_move};

/// The law of importance of a case.
///
/// # Errors
/// When the case's decay is out of range.
pub(super) fn importance(case: &Case) -> Result<Importance, ModelError> {
    Importance::new(case.cost.kappa_per_mm)
}

/// Weight of a push toward a structure of a case.
pub(super) fn weight(importance: &Importance, case: &Case, n: &NearStructure) -> f64 {
    importance.weight(&n.proximity, case.rank(n.structure))
}

/// The weights of structures, with the directions to them after a share of a move's way, in the order of [`NearStructure::in_both_directions`].
pub(super) fn weighted(
    (law, case): (&Importance, &Case),
    near: &[NearStructure],
    share: f64,
) -> Vec<Weighted> {
    let of = |n: &NearStructure| (weight(law, case, n), n.proximity.toward);
    NearStructure::in_both_directions(near, share).iter().map(of).collect()
}

/// The same at every waypoint.
///
/// # Errors
/// As [`importance`].
pub(super) fn weighted_at_ends(
    case: &Case,
    near: &[Vec<NearStructure>],
) -> Result<Vec<Vec<Weighted>>, ModelError> {
    let law = importance(case)?;
    Ok(near.iter().map(|near| weighted((&law, case), near, 1.0)).collect())
}

/// What pushes the burr at every waypoint where it cuts.
///
/// # Errors
/// As [`importance`].
pub(super) fn pushes(
    case: &Case,
    near: &[Vec<NearStructure>],
    (ends, within): (&[Option<EngagedForce>], &[Vec<ForceWithin>]),
    compliances: Option<&[Matrix3<f64>]>,
) -> Result<Vec<Option<CutPushes>>, ModelError> {
    let law = importance(case)?;
    let compliances = compliances.filter(|_| case.cost.force == ForceTerm::Deflection);
    let of = |(i, near): (usize, &Vec<_>)| {
        let compliance = compliances.and_then(|c| c.get(i));
        let within = within.get(i).map_or(&[][..], Vec::as_slice);
        let places = places_of_move(ends[i].as_ref(), within);
        let mut places = places.map(|(at, force)| (force, weighted((&law, case), near, at))).peekable();
        places.peek().is_some().then(|| CutPushes::new(places, compliance))
    };
    Ok(near.iter().enumerate().map(of).collect())
}

/// The same with [`SpeedMode::LeastForce`]; empty in any other mode.
///
/// # Errors
/// As [`importance`].
pub(super) fn pushes_of_mode(
    case: &Case,
    near: &[Vec<NearStructure>],
    forces: (&[Option<EngagedForce>], &[Vec<ForceWithin>]),
    compliances: Option<&[Matrix3<f64>]>,
) -> Result<Vec<Option<CutPushes>>, ModelError> {
    if case.speed.mode != SpeedMode::LeastForce {
        return Ok(Vec::new());
    }
    pushes(case, near, forces, compliances)
}

/// The largest pushes of cuts at their speeds, mm/s.
pub(super) fn reached(pushes: &[Option<CutPushes>], speed_mm_s: &[f64]) -> Levels {
    let none = Levels { toward: 0.0, overall: 0.0, speed_mm_s: 0.0 };
    pushes.iter().zip(speed_mm_s).fold(none, |most, (pushes, speed)| {
        let Some(pushes) = pushes else { return most };
        Levels {
            toward: most.toward.max(pushes.toward(*speed).map_or(0.0, |(push, _)| push)),
            overall: most.overall.max(pushes.overall(*speed)),
            speed_mm_s: most.speed_mm_s.max(*speed),
        }
    })
}
