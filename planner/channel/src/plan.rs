//! The whole way of a channel: a case to a plan.
//!
//! images → channel (given, or the safest) → scene along it → depths → waypoints → joints → forces → rows. Where the arm cannot take
//! the safest channel, the runners-up are tried in turn.

use std::path::Path;

use bonemill_case::{Case, ChannelSpec};
use bonemill_geometry::Progress;
use bonemill_planfile::{ChannelRecord, ForceToward, PlungeRow, Waypoint};
use bonemill_robot::resolve::Posture;
use bonemill_setup::armpath::{ArmFacts, Compliance, Placed};
use bonemill_setup::inputs::{self, CaseImages};
use bonemill_setup::{
    ChannelFault, PlanError, Setup, Stopwatch, channel::scene_case, reach, registration, room, tools,
};
use bonemill_toolpath::scene::ApproachSpec;
use nalgebra::Unit;

use crate::axis::ChannelAxis;
use crate::bone::{BoneField, ToolPose};
use crate::chosen::{FoundChannels, find, through};
use crate::depths::first_contact_mm;
use crate::forces::{self, Felt};
use crate::front::ToolFront;
use crate::holder::{HolderInBone, HolderPose};
use crate::motion::{ToolMotion, motion};
use crate::rows::Gone;
use crate::safest::SafeChannel;
use crate::section::{Section, sections};
use crate::strokes::{Strokes, TipPlace};
use crate::tool::ChannelTool;
use crate::volumes::{SweptVolumes, swept};

/// A planned channel.
#[derive(Debug)]
pub struct ChannelPlan {
    /// The case and what was made of its files.
    pub setup: Setup,
    /// The channel.
    pub channel: SafeChannel,
    /// As the plan records it.
    pub record: ChannelRecord,
    /// All channels that were found, the planned one among them.
    pub found: FoundChannels,
    /// Channels before the planned one that the arm cannot take.
    pub unreachable: usize,
    /// The rows of `waypoints.csv`.
    pub waypoints: Vec<Waypoint>,
    /// The rows of `forces.csv`.
    pub forces: Vec<ForceToward>,
    /// The rows of `plunge.csv`.
    pub plunge: Vec<PlungeRow>,
    /// What each waypoint meets.
    pub felt: Vec<Felt>,
    /// The motion.
    pub motion: ToolMotion,
    /// What is told of the arm.
    pub arm: ArmFacts,
    /// What is removed.
    pub volumes: SweptVolumes,
    /// Bone in the holder at the deepest pose.
    pub holder_in_bone: Option<HolderInBone>,
    /// Clearance of the holder from each structure, mm; infinite without a holder, `None` without the structure.
    pub holder_clearance_mm: Vec<Option<f64>>,
    /// The front of the tool: [height, radius] from its tip to its largest radius, mm.
    pub front: Vec<[f64; 2]>,
    /// The images along and across the channel.
    pub sections: Vec<Section>,
    /// What the user should know.
    pub warnings: Vec<String>,
    /// Why the plan falls short of its case.
    pub shortfalls: Vec<String>,
    /// Seconds of planning by stage; never written.
    pub seconds: Vec<(&'static str, f64)>,
}

/// Plans a channel; paths in the case are relative to the folder of `case_path`.
///
/// # Errors
/// [`PlanError`] for images that cannot be read or trusted, and for channels that cannot be drilled.
pub fn plan(
    case: &Case,
    spec: &ChannelSpec,
    case_path: &Path,
    progress: &dyn Progress,
) -> Result<ChannelPlan, PlanError> {
    let mut watch = Stopwatch::new(progress);
    let folder = case_path.parent().unwrap_or(Path::new(""));
    let tool = ChannelTool::of_case(case, |file| folder.join(file))?;
    tools::arm(case, folder)?; // an arm that cannot be used is told before anything else
    let (images, files) = watch.run("read images", || inputs::read_inputs(case, case_path))?;
    registration::fiducials_in_scan(&case.robot, images.ct.volume.grid())?;
    let labels_path = folder.join(&case.images.labels);
    let found = watch.run("channel", || find(case, spec, &images, &labels_path, &tool))?;
    let job = ChannelJob { case, spec, folder, images: &images, tool: &tool };
    let mut first_error = None;
    let mut unreachable = 0;
    for channel in &found.channels {
        match job.gone_through(channel, &mut watch) {
            Err(error @ PlanError::OutOfReach { .. }) => {
                unreachable += 1;
                first_error.get_or_insert(error);
            }
            Err(error) => return Err(error),
            Ok(gone) => {
                let plan = job.finish(gone, found, files, unreachable)?;
                return Ok(ChannelPlan { seconds: watch.into_seconds(), ..plan });
            }
        }
    }
    Err(first_error.unwrap_or(ChannelFault::NoEntry.into()))
}

/// What is planned.
struct ChannelJob<'a> {
    case: &'a Case,
    spec: &'a ChannelSpec,
    folder: &'a Path,
    images: &'a CaseImages,
    tool: &'a ChannelTool,
}

/// A channel that the arm can take.
struct Taken {
    channel: SafeChannel,
    setup: Setup,
    record: ChannelRecord,
    places: Vec<TipPlace>,
    motion: ToolMotion,
}

impl ChannelJob<'_> {
    fn bone(&self) -> BoneField<'_> {
        BoneField { ct: &self.images.ct.volume, density: &self.case.density }
    }

    fn front(&self) -> ToolFront {
        ToolFront::new(self.tool.cutter.solid(), self.tool.guide_radius_mm)
    }

    /// Scene, waypoints and joints of one channel.
    fn gone_through(&self, channel: &SafeChannel, watch: &mut Stopwatch) -> Result<Taken, PlanError> {
        let axis = &channel.axis;
        let contact_depth_mm = self.contact_mm(axis)?;
        through(self.case, channel)?;
        let record = ChannelRecord {
            entry: axis.entry,
            direction: Unit::new_unchecked(-axis.out.into_inner()),
            depth_mm: axis.depth_mm,
            contact_depth_mm,
            radius_mm: self.tool.radius_mm,
        };
        let setup = self.setup(&record, watch)?;
        let places = Strokes {
            start_mm: contact_depth_mm.min(0.0) - self.spec.standoff_mm,
            contact_mm: contact_depth_mm,
            end_mm: axis.depth_mm,
            step_mm: self.spec.step_mm,
            peck_mm: self.spec.peck_mm,
            dwell_s: self.spec.dwell_s,
            feed_mm_s: self.spec.feed.speed_mm_s(self.tool.spindle_rpm),
            link_mm_s: self.case.speed.link_mm_s,
        }
        .places();
        let base_from_work = setup.base_from_work();
        let posture = self.case.robot.branch.map_or(Posture::Any, Posture::Of);
        let room = setup.room.as_ref();
        let placed = Placed { arm: &setup.arm, base_from_work: &base_from_work, posture, room };
        let motion = watch.run("joints", || motion(&setup, &placed, axis, &places));
        let motion = motion.map_err(|error| setup.registered.blame(self.case, error))?;
        Ok(Taken { channel: channel.clone(), record, places, motion, setup })
    }

    fn contact_mm(&self, axis: &ChannelAxis) -> Result<f64, PlanError> {
        // a wide front may meet bone beside the entry before its tip is there
        let before_mm = self.spec.standoff_mm + self.tool.radius_mm;
        first_contact_mm(&self.front(), &self.bone(), axis, [-before_mm, axis.depth_mm])
    }

    /// The case with the scene of its channel.
    fn setup(&self, record: &ChannelRecord, watch: &mut Stopwatch) -> Result<Setup, PlanError> {
        let arm = tools::arm(self.case, self.folder)?;
        let mut scene_case = scene_case(self.case, record);
        let target = scene_case.target.with_label(|_| Err(PlanError::from(ChannelFault::NoEntry)))?;
        scene_case.holds.clear();
        let approach = ApproachSpec::Fixed(-record.direction.into_inner());
        let scene =
            watch.run("scene", || inputs::make_scene_of(&scene_case, (target, approach), self.images))?;
        let registered = registration::registration(&self.case.robot, &scene)?;
        reach::judge(&arm, &registered, &scene, self.tool.radius_mm)
            .map_err(|error| registered.blame(self.case, error))?;
        let room =
            room::room(self.case, &arm, (&self.images.ct.volume, &scene.approach), &registered.base_from_ct)?;
        room::judge_base(room.as_ref()).map_err(|error| registered.blame(self.case, error))?;
        let mut warnings = self.images.warnings.clone();
        warnings.extend(scene.warnings.iter().cloned());
        warnings.extend(tools::warnings(self.case, &arm));
        warnings.extend(registered.warnings(self.case));
        warnings.extend(room::warning(self.case, room.as_ref()));
        let (ct, labels) = (&self.images.ct, &self.images.labels);
        let placements = [ct.provenance.placement, labels.provenance.placement];
        let grids = [ct.volume.grid().clone(), labels.volume.grid().clone()];
        Ok(Setup {
            case: self.case.clone(),
            inputs: vec![],
            placements,
            grids,
            scene,
            arm,
            registered,
            room,
            warnings,
        })
    }

    /// Forces, rows, figures and judgement of a channel that is taken.
    fn finish(
        &self,
        taken: Taken,
        found: FoundChannels,
        files: Vec<(bonemill_planfile::Input, std::path::PathBuf)>,
        unreachable: usize,
    ) -> Result<ChannelPlan, PlanError> {
        let Taken { channel, mut setup, record, places, motion } = taken;
        setup.inputs = files;
        let axis = &channel.axis;
        let felt = forces::along(&places, axis, self.tool, &self.bone())?;
        let base_from_work = setup.base_from_work();
        let placed =
            Placed { arm: &setup.arm, base_from_work: &base_from_work, posture: Posture::Any, room: None };
        let compliances = match self.case.robot.joint_stiffness {
            Some(_) => Compliance::new(self.case, placed)?.along(&motion.motion.resolved.q)?,
            None => None,
        };
        let arm = ArmFacts::along(
            &setup.arm,
            setup.room.as_ref(),
            &motion.motion,
            compliances.as_deref(),
            places.iter().map(|_| None),
        )?;
        let turn = setup.scene.ct_from_work.rotation.into_inner();
        let in_ct: Option<Vec<_>> =
            compliances.map(|all| all.iter().map(|c| turn * c * turn.transpose()).collect());
        let gone = Gone {
            case: self.case,
            scene: &setup.scene,
            axis,
            tool: self.tool,
            places: &places,
            times_s: &motion.waypoint_times_s,
            driven_mm_s: &motion.driven_mm_s,
            felt: &felt,
            compliances: in_ct.as_deref(),
        };
        let (waypoints, forces) = gone.rows();
        let plunge = gone.plunge_rows();
        let way_mm = axis.depth_mm - record.contact_depth_mm;
        let end = ToolPose::new(axis.end(), &axis.out);
        let volumes = swept(&self.front(), &self.bone(), &end, way_mm);
        let pose = HolderPose { origin: axis.end(), out: &axis.out, cylinders: &self.tool.holder };
        let holder_in_bone = pose.in_bone(&self.images.ct.volume, self.case.density.bone_hu);
        let fields = setup.scene.structures.iter().map(|s| s.field.as_ref());
        let holder_clearance_mm = fields.map(|field| Some(pose.clearance_mm(field?))).collect();
        let warnings = setup.warnings.clone();
        let sections = sections(&channel, self.images, self.tool.radius_mm);
        let profile = self.tool.cutter.solid().profile();
        let widest = profile.iter().position(|[_, r]| *r >= self.tool.radius_mm).unwrap_or(0);
        let mut plan = ChannelPlan {
            front: profile[..=widest].to_vec(),
            setup,
            channel,
            record,
            found,
            unreachable,
            waypoints,
            forces,
            plunge,
            felt,
            motion,
            arm,
            volumes,
            holder_in_bone,
            holder_clearance_mm,
            sections,
            warnings,
            shortfalls: vec![],
            seconds: vec![],
        };
        plan.warnings.extend(plan.found.warning.clone());
        plan.warnings.extend(plan.arm.lowest_link.and_then(|lowest| lowest.warning()));
        plan.shortfalls = crate::judged::shortfalls(&plan, self.spec);
        Ok(plan)
    }
}
