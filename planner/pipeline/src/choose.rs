//! The choice of axes on a path that is prepared, and what it leads to: forces, costs and the arm's motion.
//!
//! What may be chosen anew on one path is [`Choices`]; everything else of the case was used to prepare the path and is the same for all
//! of them. So variants of a case can be compared on one path, as D's trials are.

use std::collections::BTreeMap;

use bonemill_case::{Accuracy, Case, CostSpec, ForceTerm, MaterialSpec, OrientationMode, SpeedSpec};
use bonemill_cutting::burr::EngagedForce;
use bonemill_cutting::cost::{Cost, CostModel, Ranked, Terms};
use bonemill_robot::resolve::{Posture, Stiffness};
use bonemill_setup::Stopwatch;
use bonemill_setup::armpath::{ArmMotion, Compliance, Placed};
use bonemill_setup::nearest_structures::NearStructure;
use bonemill_toolpath::orientation::Directions;
use bonemill_toolpath::path::{self, MoveKind, PathPoint};
use nalgebra::{Matrix3, Unit, Vector3};
use rayon::prelude::*;

use super::PlanError;
use super::axis_cost::{AxisObjective, CostField, LevelTimes};
use super::force_error::ForceError;
use super::free_axes::FreeAxes;
use super::in_time::Goal;
use super::levels;
use super::orient::{Oriented, orient};
use super::path_forces::{ForceWithin, ForcedPath, begin_as_ended, places_of_move};
use super::prepared::Prepared;
use super::sampled::SampledForce;
use super::speeds;

/// Largest number of axes that are excluded one after the other; by then every axis near them is.
const MOST_REFUSED: usize = 24;

/// What may be chosen anew on a prepared path.
#[derive(Debug, Clone, PartialEq)]
pub struct Choices {
    /// Sense of the burr's rotation: −1 forward, +1 reverse.
    pub spin: i8,
    /// Cutting coefficients.
    pub material: MaterialSpec,
    /// Weights of the orientation cost.
    pub cost: CostSpec,
    /// How axes are chosen.
    pub mode: OrientationMode,
    /// The levels of force and the time that [`OrientationMode::Optimal`] chooses axes for; without, Dillon's cost.
    pub goal: Option<Goal>,
    /// Waypoints that keep an axis unless they must leave it.
    pub kept: BTreeMap<usize, Unit<Vector3<f64>>>,
    /// Speed range and law.
    pub speed: SpeedSpec,
    /// How finely forces are computed.
    pub accuracy: Accuracy,
}

impl Choices {
    /// Those of a case.
    pub fn of(case: &Case) -> Self {
        let Case { burr, material, cost, orientation, speed, accuracy, .. } = case;
        Self {
            spin: burr.spin,
            material: *material,
            cost: *cost,
            mode: orientation.mode,
            goal: None,
            kept: BTreeMap::new(),
            speed: speed.clone(),
            accuracy: *accuracy,
        }
    }

    /// A case with these in place of its own.
    pub(super) fn applied_to(&self, case: &Case) -> Case {
        let Self { material, cost, accuracy, .. } = *self;
        let mut applied = Case { material, cost, accuracy, ..case.clone() };
        applied.burr.spin = self.spin;
        applied.orientation.mode = self.mode;
        applied.speed.clone_from(&self.speed);
        applied
    }
}

/// Axes, and what they lead to at the nominal speed.
#[derive(Debug, Clone)]
pub struct Chosen {
    /// The axes, and how they came about.
    pub oriented: Oriented,
    /// What each move is for: one that removes material is a cut.
    pub kinds: Vec<MoveKind>,
    /// Force at any speed where the move ends, if it removes something.
    pub forces: Vec<Option<EngagedForce>>,
    /// Forces at places within the move; none before `look_within`.
    pub within: Vec<Vec<ForceWithin>>,
    /// C with its parts, the force included everywhere.
    pub costs: Vec<Cost>,
    /// mm/N in work, when the stiffness is known.
    pub compliances: Option<Vec<Matrix3<f64>>>,
    /// The most by which a choice without the force is worse than one with it, in units of C.
    pub closed_form_error: f64,
    /// How exact the forces are; none before `look_finely`.
    pub force_error: ForceError,
}

impl Chosen {
    /// The forces of move i, where it ends and within it, each with the share of its way.
    pub(super) fn forces_of(&self, i: usize) -> impl Iterator<Item = (f64, &EngagedForce)> {
        places_of_move(self.forces[i].as_ref(), &self.within[i])
    }

    /// The slowest that move i may be, mm/s.
    pub(super) fn slowest_mm_s(&self, case: &Case, i: usize) -> f64 {
        speeds::slowest_mm_s(&case.speed, self.kinds[i], self.forces[i].is_some())
    }
}

impl Prepared<'_> {
    /// Chooses axes.
    ///
    /// # Errors
    /// When a parameter is out of range, or the cost uses the deflection and the case gives no stiffness.
    pub fn choose(&self, choices: &Choices) -> Result<Chosen, PlanError> {
        let with_motion = self.start.case.robot.joint_stiffness.is_some();
        Ok(self.choose_timed(choices, with_motion, &mut Stopwatch::new(&()))?.0)
    }

    /// [`Self::choose`] with the motion that leads through these axes. If the arm cannot follow them, the axis that it
    /// cannot reach is excluded and the axes are chosen again.
    fn choose_with_motion(
        &mut self,
        choices: &Choices,
        watch: &mut Stopwatch,
    ) -> Result<(Chosen, ArmMotion), PlanError> {
        let mut found = self.choose_timed(choices, true, watch);
        let mut tried = 1;
        while tried <= MOST_REFUSED {
            match found {
                Err(PlanError::OutOfReach { waypoint, axis, .. }) if self.refuse(waypoint, axis) => {}
                _ => break,
            }
            found = self.choose_timed(choices, true, watch);
            tried += 1;
        }
        let with_tried = |error| match error {
            PlanError::OutOfReach { waypoint, axis, excess, meets } => PlanError::OutOfReach {
                waypoint,
                axis,
                meets,
                excess: format!("{excess} ({tried} {} tried)", if tried == 1 { "axis" } else { "axes" }),
            },
            other => other,
        };
        let (chosen, motion) = found.map_err(with_tried)?;
        // None only if the arm's motion was not computed above
        let motion = motion
            .map_or_else(|| self.motion(&choices.applied_to(self.start.case), &chosen.oriented.axes), Ok)?;
        Ok((chosen, motion))
    }

    /// [`Self::choose`] with the motion that leads through these axes, and the forces within moves along it.
    ///
    /// # Errors
    /// As [`Self::choose`], and when no axis remains that the arm can follow.
    pub(super) fn choose_driven(
        &mut self,
        choices: &Choices,
        watch: &mut Stopwatch,
    ) -> Result<(Chosen, ArmMotion), PlanError> {
        let (mut chosen, motion) = self.choose_with_motion(choices, watch)?;
        watch.run("forces", || self.look_within(choices, &mut chosen, &motion))?;
        Ok((chosen, motion))
    }

    pub(super) fn forced(&self) -> ForcedPath<'_> {
        let (removal, points) = (&self.reached.path.removal, self.points());
        ForcedPath { scene: self.start.scene, removal, points, feeds: &self.feeds }
    }

    /// Computes the forces within moves, along the path as the arm drives it.
    ///
    /// # Errors
    /// When the tool, the material or the arm's limits are not usable.
    fn look_within(
        &self,
        choices: &Choices,
        chosen: &mut Chosen,
        motion: &ArmMotion,
    ) -> Result<(), PlanError> {
        let case = &choices.applied_to(self.start.case);
        let (forced, sampled) = (self.forced(), SampledForce::within(case)?);
        let swept = forced.rounded((&self.start, case), motion)?;
        chosen.within = forced.within((&sampled, &swept, &self.near), &chosen.oriented.axes, &chosen.forces);
        Ok(())
    }

    /// Computes the forces where moves end, and the largest within them, as finely as they are stated, and the costs with them.
    ///
    /// # Errors
    /// When the tool, the material or the arm's limits are not usable.
    fn look_finely(
        &self,
        choices: &Choices,
        chosen: &mut Chosen,
        motion: &ArmMotion,
    ) -> Result<(), PlanError> {
        let case = &choices.applied_to(self.start.case);
        let axes = &chosen.oriented.axes;
        let forced = self.forced();
        let swept = forced.rounded((&self.start, case), motion)?;
        chosen.forces = forced.finely((case, &swept), axes, |i| chosen.forces[i].is_some())?;
        begin_as_ended(&mut chosen.within, &chosen.forces);
        let moves = (&chosen.forces[..], &mut chosen.within[..]);
        forced.largest_finely((case, &swept, &self.near), axes, moves)?;
        let moves = (self.length_mm(), &chosen.forces[..], &chosen.within[..]);
        chosen.force_error = forced.error((case, &swept, &self.near), axes, moves)?;
        let pushes = nominal_pushes(case, &chosen.forces, chosen.compliances.as_deref());
        chosen.costs = self.costs(&terms(case, &self.near)?, axes, &pushes);
        Ok(())
    }

    /// The same; once more with finer sums where the forces err by more than the case asks for.
    ///
    /// # Errors
    /// As before.
    pub(super) fn look_exactly(
        &self,
        choices: &mut Choices,
        chosen: &mut Chosen,
        motion: &ArmMotion,
    ) -> Result<(), PlanError> {
        self.look_finely(choices, chosen, motion)?;
        if choices.accuracy.asked.force.is_some_and(|share| chosen.force_error.exceeds(share)) {
            choices.accuracy = choices.accuracy.with_finer_forces();
            self.look_within(choices, chosen, motion)?;
            self.look_finely(choices, chosen, motion)?;
        }
        Ok(())
    }

    /// Excludes an axis that the arm cannot reach from the waypoints around it; returns whether every waypoint has another axis left.
    fn refuse(&mut self, waypoint: usize, axis: Unit<Vector3<f64>>) -> bool {
        let at = self.reached.path.points[waypoint].position;
        let within_mm = self.arm_axes.refuse(at, axis);
        let axes = self.directions.axes();
        let is_near = |point: &PathPoint| point.position.distance_mm(&at) <= within_mm;
        for (i, point) in self.reached.path.points.iter().enumerate().filter(|(_, point)| is_near(point)) {
            self.reached.free.retain(i, |n| self.arm_axes.allows(point.position, &axes[n]));
        }
        (0..self.reached.free.len()).all(|i| self.reached.free.count(i) > 0)
    }

    fn choose_timed(
        &self,
        choices: &Choices,
        with_motion: bool,
        watch: &mut Stopwatch,
    ) -> Result<(Chosen, Option<ArmMotion>), PlanError> {
        let case = &choices.applied_to(self.start.case);
        let sampled = SampledForce::new(case, SampledForce::of_case(case))?;
        let (reached, forced) = (&self.reached, self.forced());
        let swept = forced.swept(case);
        let terms = terms(case, &self.near)?;
        let weighted = levels::weighted_at_ends(case, &self.near)?;
        let objective = match choices.goal {
            None => AxisObjective::Dillon(&terms),
            Some(_) => AxisObjective::Levels(LevelTimes::new(&case.speed, &weighted)),
        };
        let compliance = Compliance::new(case, self.start.placed())?;
        let coarse = self.compliance_of(case, &compliance, &self.directions)?;
        let field = CostField {
            swept: &swept,
            sampled: &sampled,
            objective,
            moments: &self.reached.moments,
            feeds: &self.feeds,
            compliance: coarse,
            finer_compliance: match &self.finer {
                Some((finer, _)) => self.compliance_of(case, &compliance, finer)?,
                None => None,
            },
        };
        let kept: Vec<_> = (0..self.points().len()).map(|i| choices.kept.get(&i).copied()).collect();
        let room = self.free_axes(&kept);
        let oriented =
            watch.run("orientation", || orient(choices.mode, &room, &field, choices.goal.as_ref()));
        let motion = watch.run("inverse kinematics", || {
            with_motion.then(|| self.motion(case, &oriented.axes)).transpose()
        })?;
        let removes = |i: usize| reached.moments[i].mass_mg() > 0.0;
        let forces = watch.run("forces", || forced.at_ends((&sampled, &swept), &oriented.axes, removes));
        let compliances = motion.as_ref().map_or(Ok(None), |motion| compliance.along(&motion.resolved.q))?;
        let pushes = nominal_pushes(case, &forces, compliances.as_deref());
        let costs = self.costs(&terms, &oriented.axes, &pushes);
        // what was left out is never negative: no choice with the force can be better by more than it
        let closed_form: Vec<Terms> = terms.iter().map(Terms::without_force).collect();
        let without = self.costs(&closed_form, &oriented.axes, &pushes);
        let left_out = |i: usize| costs[i].cost - without[i].cost;
        let closed_form_error =
            (0..pushes.len()).filter(|i| !field.needs_force(*i)).map(left_out).fold(0.0, f64::max);
        let kinds = (0..self.points().len()).map(|i| self.kind(i, &oriented.axes)).collect();
        let within = vec![Vec::new(); self.points().len()];
        let force_error = ForceError::default();
        let chosen =
            Chosen { oriented, kinds, forces, within, costs, compliances, closed_form_error, force_error };
        Ok((chosen, motion))
    }

    /// Deflection per force of each direction of a set, mm/N in work, if the cost uses the deflection.
    fn compliance_of(
        &self,
        case: &Case,
        compliance: &Compliance,
        set: &Directions,
    ) -> Result<Option<Vec<Matrix3<f64>>>, PlanError> {
        let center = self.start.scene.target_center;
        compliance.of_cost(case, center, set.axes(), |axis| self.arm_axes.allows(center, axis))
    }

    fn free_axes<'b>(&'b self, kept: &'b [Option<Unit<Vector3<f64>>>]) -> FreeAxes<'b> {
        FreeAxes {
            reached: &self.reached,
            kept,
            directions: &self.directions,
            finer: self.finer.as_ref(),
            family: self.family.as_ref(),
            turns: self.turns,
            arm: &self.arm_axes,
        }
    }

    /// C of every waypoint under `pushes`.
    fn costs(&self, terms: &[Terms], axes: &[Unit<Vector3<f64>>], pushes: &[Vector3<f64>]) -> Vec<Cost> {
        let cost = |i: usize| {
            let moments = &self.reached.moments[i];
            terms[i].cost(&pushes[i], moments.inertia_normalised(&axes[i]), moments.mass_mg())
        };
        (0..pushes.len()).map(cost).collect()
    }

    /// Joint positions along the path with the shaft along `axes`; if the cost uses the deflection, postures that are stiff
    /// toward the structures are preferred.
    fn motion(&self, case: &Case, axes: &[Unit<Vector3<f64>>]) -> Result<ArmMotion, PlanError> {
        let positions = path::centers(self.points());
        let toward: Vec<_> = (0..positions.len()).map(|i| self.nearest(i).map(|near| near.toward)).collect();
        let stiff = case.robot.joint_stiffness.as_deref();
        let stiff = stiff.filter(|_| case.cost.force == ForceTerm::Deflection);
        let stiffness = stiff.map(|joint| Stiffness { joint, toward: &toward });
        let start = positions.first().zip(axes.first()).and_then(|(at, axis)| self.arm_axes.start(*at, axis));
        let placed = self.start.placed();
        let posture = start.map_or(placed.posture, Posture::From);
        Placed { posture, ..placed }.motion(&positions, axes, self.length_mm(), stiffness)
    }

    /// The kind of the move to waypoint i. A link that removes part of a voxel counts as a cut, and is as slow as one, unless the
    /// shaft is beyond the tilt limit at one of its ends. The first waypoint is not a move: its ball may touch a voxel's corner
    /// because of rounding.
    fn kind(&self, i: usize, axes: &[Unit<Vector3<f64>>]) -> MoveKind {
        let removes = i > 0
            && self.reached.moments[i].mass_mg() > 0.0
            && axes[i - 1..=i].iter().all(|axis| self.directions.is_within_limit(axis));
        if removes { MoveKind::Cut } else { self.points()[i].kind }
    }
}

/// The push that enters the cost of each waypoint, at the nominal speed as in D13: the force, N, or the deflection under it, mm.
fn nominal_pushes(
    case: &Case,
    forces: &[Option<EngagedForce>],
    compliances: Option<&[Matrix3<f64>]>,
) -> Vec<Vector3<f64>> {
    let push = |i: usize| {
        let force = forces[i].map_or(Vector3::zeros(), |f| f.force_n(case.speed.nominal_mm_s));
        match (case.cost.force, compliances) {
            (ForceTerm::Deflection, Some(c)) => c[i] * force,
            _ => force,
        }
    };
    (0..forces.len()).map(push).collect()
}

/// The structures that enter the cost of each waypoint, with their weights.
pub(super) fn terms(case: &Case, near: &[Vec<NearStructure>]) -> Result<Vec<Terms>, PlanError> {
    let model = CostModel::new(case.cost.kappa_per_mm, case.cost.alpha_max)?;
    let ranked = |n: &NearStructure| {
        let priority = case.structures.get(n.structure).map_or(u32::MAX, |s| s.priority);
        Ranked { proximity: n.proximity, priority }
    };
    let of = |near: &Vec<NearStructure>| {
        model.terms(&near.iter().map(ranked).collect::<Vec<_>>(), case.cost.structures)
    };
    Ok(near.par_iter().map(of).collect())
}
