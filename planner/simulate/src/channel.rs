//! A planned channel, replayed: joints through forward kinematics, the tool through the bone.
//!
//! A place of an edge feels bone unless it lies in the tool's solid at the deepest pose so far: that is exact for a straight way, and
//! holds for pecks and dwells. The force follows from the speed along the axis from pose to pose, so acceleration, deceleration and
//! a dwell show in it. What is removed is counted in two ways: by the front's rate from pose to pose, and by the places that the front
//! passes on its way to the deepest pose. With joint stiffnesses the deflection C·F is told; the tool itself stays where the joints bring it.

use bonemill_channel::bone::{BoneField, ToolPose};
use bonemill_channel::clearance::{Line, nearest_place};
use bonemill_channel::forces::{TURNS, loads_at};
use bonemill_channel::front::ToolFront;
use bonemill_channel::holder::HolderPose;
use bonemill_channel::tool::ChannelTool;
use bonemill_channel::{SWEPT_STEP_MM, swept};
use bonemill_cutting::edge::CutterForce;
use bonemill_geometry::{Base, Ct, Point, Progress, Rigid, Tool, Volume, Work};
use bonemill_planfile::StoredPlan;
use bonemill_planfile::toward::{StructureFigures, TowardSpan};
use bonemill_setup::channel::scene_case_of;
use bonemill_setup::inputs::{images_of, make_scene};
use bonemill_setup::{ChannelFault, PlanError};
use bonemill_toolpath::scene::Scene;
use nalgebra::{Unit, Vector3};
use rayon::prelude::*;

use super::poses::{self, PoseError, Sampling, TrajectorySample};
use super::replay::{SimulateError, Simulation, SimulationRow};
use super::{Amount, ShankContact, VoxelKind};

/// What distances may be told too small, mm.
const TOLERANCE_MM: f64 = 0.01;
/// A tool that is deeper by less than this does not cut, mm.
const LEAST_MM: f64 = 1e-7;

/// Replays a channel's trajectory.
///
/// # Errors
/// [`SimulateError`].
pub fn simulate_channel(
    plan: &StoredPlan,
    sampling: Sampling,
    progress: &dyn Progress,
) -> Result<Simulation, SimulateError> {
    progress.stage("read images");
    let case = scene_case_of(&plan.record);
    let images = images_of(plan, &case)?;
    let scene = make_scene(&case, &images, None)?;
    let tool = ChannelTool::of_case(&case, |file| plan.input_path(file))?;
    progress.stage("forward kinematics");
    let base_from_work: Rigid<Base, Work> = plan.record.frames.base_from_ct * scene.ct_from_work;
    let samples = poses::sample(&plan.trajectory, &plan.arm, &base_from_work.inverse(), sampling)?;
    progress.stage("simulate");
    let bone = BoneField { ct: &images.ct.volume, density: &case.density };
    let replay = Replay { plan, scene: &scene, tool: &tool, bone };
    let front = ToolFront::new(tool.cutter.solid(), tool.guide_radius_mm);
    let rows = replay.rows(&samples, &front)?;
    let deepest = replay.deepest(&samples).ok_or(PoseError::Empty)?;
    let channel = plan.record.channel().ok_or(ChannelFault::NoEntry).map_err(PlanError::from)?;
    let removed =
        swept(&front, &bone, &replay.pose(&samples[deepest]).0, channel.depth_mm - channel.contact_depth_mm);
    let contact = replay.holder_contact(&images.ct.volume, case.density.bone_hu, &samples[deepest]);
    let structures = replay.structures(&samples, &rows);
    let mut bone_only = Amount::default();
    bone_only.add(VoxelKind::Bone, removed.bone_mm3, removed.bone_mass_mg);
    let mut by_rate = Amount::default();
    for pair in rows.windows(2) {
        let seconds = pair[1].0.time_s - pair[0].0.time_s;
        by_rate.add(VoxelKind::Bone, pair[1].0.mrr_mm3_s * seconds, pair[1].1);
    }
    Ok(Simulation {
        rows: rows.into_iter().map(|(row, _)| row).collect(),
        structures,
        removed: bone_only,
        removed_by_rate: by_rate,
        stopped: usize::from(contact.is_some()),
        contacts: contact.map(|contact| (samples[deepest].time_s, contact)).into_iter().collect(),
        cell_mm: SWEPT_STEP_MM,
        radius_mm: tool.radius_mm,
        compliant: plan.record.case.robot.joint_stiffness.is_some(),
    })
}

/// What is replayed.
struct Replay<'a> {
    plan: &'a StoredPlan,
    scene: &'a Scene,
    tool: &'a ChannelTool,
    bone: BoneField<'a>,
}

impl Replay<'_> {
    fn pose(&self, sample: &TrajectorySample) -> (ToolPose, Unit<Vector3<f64>>) {
        let out = Unit::new_normalize(self.scene.ct_from_work.rotate(&sample.pose.axis));
        (ToolPose::new(self.scene.ct_from_work * sample.pose.center, &out), out)
    }

    /// How deep a sample is along the channel, mm; only differences matter.
    fn depth_mm(&self, sample: &TrajectorySample) -> f64 {
        let direction = self.plan.record.frames.approach_direction;
        -(self.scene.ct_from_work * sample.pose.center).coords.dot(&direction)
    }

    /// The deepest sample.
    fn deepest(&self, samples: &[TrajectorySample]) -> Option<usize> {
        (0..samples.len()).max_by(|a, b| self.depth_mm(&samples[*a]).total_cmp(&self.depth_mm(&samples[*b])))
    }

    /// The rows, each with the mass that the front's rate gives, mg.
    fn rows(
        &self,
        samples: &[TrajectorySample],
        front: &ToolFront,
    ) -> Result<Vec<(SimulationRow, f64)>, SimulateError> {
        let mut deepest = 0;
        let before: Vec<usize> = (0..samples.len())
            .map(|n| {
                let so_far = deepest;
                if self.depth_mm(&samples[n]) > self.depth_mm(&samples[deepest]) {
                    deepest = n;
                }
                so_far
            })
            .collect();
        let row = |n: usize| self.row(samples, n, before[n], front);
        (0..samples.len()).into_par_iter().map(row).collect()
    }

    fn row(
        &self,
        samples: &[TrajectorySample],
        n: usize,
        deepest: usize,
        front: &ToolFront,
    ) -> Result<(SimulationRow, f64), SimulateError> {
        let sample = &samples[n];
        let (pose, out) = self.pose(sample);
        let seconds = n.checked_sub(1).map_or(0.0, |before| sample.time_s - samples[before].time_s);
        let deeper_mm = self.depth_mm(sample) - self.depth_mm(&samples[deepest]);
        let (mut force, mut mrr_mm3_s, mut mass_mg) = (CutterForce::default(), 0.0, 0.0);
        if deeper_mm > LEAST_MM && seconds > 0.0 {
            let before = n.saturating_sub(1);
            let way_mm = self.depth_mm(sample) - self.depth_mm(&samples[before]);
            let cut_mm = deeper_mm.min(way_mm.max(0.0));
            let met = front
                .meets(&self.bone, &ToolPose { origin: pose.origin + out.as_ref() * (0.5 * cut_mm), ..pose });
            // in air the tool is faster than edges can cut
            if met.projected_mm2 > 0.0 {
                let loads = loads_at(self.tool, way_mm.max(0.0) / seconds)?;
                let (swept, _) = self.pose(&samples[deepest]);
                force = loads.sum(TURNS, |_, at| self.weight(pose.place(at.coords), &swept));
            }
            mrr_mm3_s = met.projected_mm2 * cut_mm / seconds;
            mass_mg = met.mass_mg_mm * cut_mm;
        }
        let force_n = pose.turn * force.force_n;
        let near = self.nearest(&pose, &out);
        let deflection_um = self.deflection_um(sample, &force_n)?;
        let omega = std::f64::consts::TAU * self.tool.spindle_rpm / 60.0;
        let row = SimulationRow {
            time_s: sample.time_s,
            position: pose.origin,
            force_n,
            peak_n: force_n.norm(),
            torque_nmm: force.torque_nmm(),
            power_w: force.torque_nmm() * omega * 1e-3,
            mrr_mm3_s,
            structure: near.map(|(structure, ..)| structure),
            force_toward_n: near.map(|(_, _, toward)| force_n.dot(&toward).max(0.0)),
            distance_mm: near.map(|(_, distance_mm, _)| distance_mm),
            deflection_um,
        };
        Ok((row, mass_mg))
    }

    /// The weight of a place of an edge: bone that the tool has not swept.
    fn weight(&self, p: Point<Ct>, swept: &ToolPose) -> f64 {
        let at = swept.turn.inverse() * (p - swept.origin);
        if self.tool.cutter.solid().contains(Point::<Tool>::from_coords(at)) {
            return 0.0;
        }
        let density = self.bone.density_g_cm3(p);
        if density > 0.0 { (density / self.tool.rho_ref_g_cm3).powf(self.tool.exponent) } else { 0.0 }
    }

    fn deflection_um(
        &self,
        sample: &TrajectorySample,
        force_n: &Vector3<f64>,
    ) -> Result<Option<f64>, SimulateError> {
        let Some(stiffness) = self.plan.record.case.robot.joint_stiffness.as_deref() else { return Ok(None) };
        let found = self.plan.arm.compliance(&sample.q, stiffness);
        let compliance =
            found.map_err(|source| SimulateError::Compliance { time_s: sample.time_s, source })?;
        let in_base: Vector3<f64> = self.plan.record.frames.base_from_ct.rotate(force_n);
        Ok(Some(1e3 * (compliance * in_base).norm()))
    }

    /// The structure with the smallest distance less clearance, its distance from the tool's axis, mm, and the direction toward it.
    fn nearest(&self, pose: &ToolPose, out: &Unit<Vector3<f64>>) -> Option<(usize, f64, Vector3<f64>)> {
        let [low_mm, high_mm] = self.tool.cutter.solid().z_range_mm();
        let line =
            Line { from: pose.origin + out.as_ref() * low_mm, along: out, length_mm: high_mm - low_mm };
        let case = &self.plan.record.case;
        let fields = self.scene.structures.iter().zip(&case.structures).enumerate();
        let found = fields.filter_map(|(n, (s, of))| {
            let place = nearest_place(s.field.as_ref()?, &line, TOLERANCE_MM);
            Some((n, place.distance_mm, place.toward, place.distance_mm - of.clearance_mm))
        });
        found.min_by(|a, b| a.3.total_cmp(&b.3)).map(|(n, distance_mm, toward, _)| (n, distance_mm, toward))
    }

    fn structures(
        &self,
        samples: &[TrajectorySample],
        rows: &[(SimulationRow, f64)],
    ) -> Vec<StructureFigures> {
        let [low_mm, high_mm] = self.tool.cutter.solid().z_range_mm();
        let of = |n: usize| {
            let field = self.scene.structures.get(n)?.field.as_ref()?;
            let distances = samples.par_iter().map(|sample| {
                let (pose, out) = self.pose(sample);
                let from = pose.origin + out.as_ref() * low_mm;
                nearest_place(field, &Line { from, along: &out, length_mm: high_mm - low_mm }, TOLERANCE_MM)
                    .distance_mm
            });
            let distances: Vec<f64> = distances.collect();
            distances.into_iter().enumerate().map(|(n, mm)| (mm, n)).min_by(|a, b| a.0.total_cmp(&b.0))
        };
        let spans = |n: usize| -> Vec<(TowardSpan, f64)> {
            let pairs = rows.windows(2).enumerate().filter(|(_, pair)| pair[1].0.structure == Some(n));
            let pairs = pairs.filter(|(_, pair)| pair[1].0.mrr_mm3_s > 0.0);
            let span = |(row, pair): (usize, &[(SimulationRow, f64)])| {
                let seconds = pair[1].0.time_s - pair[0].0.time_s;
                let force_n = pair[1].0.force_toward_n?;
                Some((TowardSpan { seconds, force_n, peak_n: force_n, row: row + 1 }, pair[1].0.distance_mm?))
            };
            pairs.filter_map(span).collect()
        };
        let figures = |n: usize| {
            let clearance_mm = self.plan.record.case.structures[n].clearance_mm;
            StructureFigures::of(of(n), &spans(n), [self.tool.radius_mm, clearance_mm])
        };
        (0..self.scene.structures.len()).map(figures).collect()
    }

    /// Bone in the holder at the deepest pose.
    fn holder_contact(
        &self,
        ct: &Volume<f32, Ct>,
        bone_hu: f64,
        sample: &TrajectorySample,
    ) -> Option<ShankContact> {
        let (pose, out) = self.pose(sample);
        let holder = HolderPose { origin: pose.origin, out: &out, cylinders: &self.tool.holder };
        let found = holder.in_bone(ct, bone_hu)?;
        let at = self.scene.ct_from_work.inverse() * (pose.origin + out.as_ref() * found.along_mm);
        let (depth_mm, along_mm) = (found.deep_mm, found.along_mm);
        Some(ShankContact { at, depth_mm, along_mm, kind: VoxelKind::Obstacle })
    }
}
