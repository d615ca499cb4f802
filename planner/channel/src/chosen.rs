//! Which channel a case asks for: given, to a target, or the safest of all.

use std::path::Path;

use bonemill_case::{Case, ChannelDirection, ChannelEnd, ChannelSpec, Entry};
use bonemill_geometry::{Ct, Point};
use bonemill_imaging::{StructureField, whole};
use bonemill_setup::inputs::{CaseImages, label_of};
use bonemill_setup::{ChannelFault, PlanError};
use nalgebra::{Unit, Vector3};

use crate::axis::ChannelAxis;
use crate::bone::BoneField;
use crate::depths::of_contact_area_mm;
use crate::front::ToolFront;
use crate::outside::OutsideAir;
use crate::registration_error::RegistrationError;
use crate::risk::{KeptClearance, KeptStructure, RiskModel, Sides};
use crate::safest::{EntryRegion, SafeChannel, SafestFound, SafestSearch, best_first};
use crate::swept::SweptTool;
use crate::tool::ChannelTool;

/// What clearances of the chosen channel may be told too small, mm.
const TOLERANCE_MM: f64 = 1e-3;

/// Where nothing says from which side a surgeon comes.
const UNKNOWN_OUTSIDE: &str = "no corner of the scan holds air, so it is not known where the patient ends: every side on which a line \
    leaves the bone counts as outside; give approach.direction, path.entry_label or path.entry_ball";

/// The channels that were found.
#[derive(Debug, Clone, PartialEq)]
pub struct FoundChannels {
    /// The one to plan first, then the runners-up; one alone where the case determines it.
    pub channels: Vec<SafeChannel>,
    /// What the search went through; `None` where there was nothing to choose.
    pub search: Option<SafestFound>,
    /// The registration's error.
    pub error: RegistrationError,
    /// What the user should know of the way out.
    pub warning: Option<String>,
}

/// Finds the channels of a case; `labels_path` is where its label map is.
///
/// # Errors
/// [`ChannelFault`] where there is none.
pub fn find(
    case: &Case,
    spec: &ChannelSpec,
    images: &CaseImages,
    labels_path: &Path,
    tool: &ChannelTool,
) -> Result<FoundChannels, PlanError> {
    let fields = images.structures.iter().map(|(_, label)| {
        let own = whole(&images.labels.volume, &images.further, *label);
        StructureField::new(&own, *label, None).map_err(PlanError::from)
    });
    let fields = fields.collect::<Result<Vec<_>, _>>()?;
    let kept: Vec<KeptStructure<'_>> = fields
        .iter()
        .zip(&case.structures)
        .enumerate()
        .map(|(n, (field, of))| KeptStructure {
            field: field.as_ref(),
            clearance_mm: of.clearance_mm,
            rank: case.rank(n),
        })
        .collect();
    let error = RegistrationError::of_case(&case.robot, spec.registration_sigma_mm)?;
    let swept = SweptTool::new(tool.cutter.solid()).map_err(ChannelFault::from)?;
    let risk = RiskModel {
        structures: &kept,
        tool: &swept,
        standoff_mm: spec.standoff_mm,
        error,
        touch_probability: spec.touch_probability,
    };
    let bone = BoneField { ct: &images.ct.volume, density: &case.density };
    let region = region(spec, images, labels_path)?;
    let target = match spec.end {
        ChannelEnd::Target(target) => Point::from_coords(target),
        _ => Point::new(0.0, 0.0, 0.0),
    };
    let outside = OutsideAir::of(&images.ct.volume, case.density.air_hu);
    let search = SafestSearch {
        ct: &images.ct.volume,
        bone_hu: case.density.bone_hu,
        target,
        region,
        outside: &outside,
        cone: case.approach.map(|out| (out, spec.cone_deg.to_radians())),
        longest_mm: tool.longest_mm(),
        risk,
    };
    let (axes, search) = match spec.direction {
        ChannelDirection::Safest => {
            let found = search.run();
            if found.channels.is_empty() {
                let SafestFound { sampled, in_region, too_long, .. } = found;
                let longest_mm = tool.longest_mm();
                return Err(ChannelFault::NoDirection { sampled, in_region, too_long, longest_mm }.into());
            }
            let channels = found.channels.iter().map(|c| c.axis).collect();
            (channels, Some(found))
        }
        ChannelDirection::Given(direction) => {
            let out = Unit::new_normalize(-direction);
            (vec![given(spec, &search, &bone, tool, out)?], None)
        }
        ChannelDirection::ToTarget => (vec![to_target(spec, target)?], None),
    };
    let judged = |axis: ChannelAxis| SafeChannel::new(axis, risk.assess(&axis, TOLERANCE_MM, Sides::All));
    // on all sides and exactly, another of them may be the best
    let channels = best_first(axes.into_iter().map(judged).collect());
    let is_open = matches!(spec.entry, Entry::Surface) && case.approach.is_none() && !outside.is_in_scan();
    let warning = (search.is_some() && is_open).then(|| UNKNOWN_OUTSIDE.into());
    Ok(FoundChannels { channels, search, error, warning })
}

/// A channel along a given direction: from the entry, or to the target.
fn given(
    spec: &ChannelSpec,
    search: &SafestSearch<'_>,
    bone: &BoneField<'_>,
    tool: &ChannelTool,
    out: Unit<Vector3<f64>>,
) -> Result<ChannelAxis, PlanError> {
    let entry = match spec.entry {
        Entry::Point(entry) => Point::from_coords(entry),
        _ => return Ok(search.axis(&out).ok_or(ChannelFault::NoEntry)?),
    };
    let mut axis = ChannelAxis { entry, out, depth_mm: 0.0 };
    axis.depth_mm = match spec.end {
        ChannelEnd::Depth(mm) => mm,
        ChannelEnd::ContactArea(mm2) => {
            let front = ToolFront::new(tool.cutter.solid(), tool.guide_radius_mm);
            of_contact_area_mm(&front, bone, &axis, -spec.standoff_mm, mm2)?
        }
        ChannelEnd::Target(target) => (Point::from_coords(target) - entry).norm(),
    };
    Ok(axis)
}

/// From a given entry to the target.
fn to_target(spec: &ChannelSpec, target: Point<Ct>) -> Result<ChannelAxis, PlanError> {
    let Entry::Point(entry) = spec.entry else { return Err(ChannelFault::NoEntry.into()) };
    let entry = Point::from_coords(entry);
    let out = Unit::try_new(entry - target, 1e-6).ok_or(ChannelFault::NoEntry)?;
    Ok(ChannelAxis { entry, out, depth_mm: entry.distance_mm(&target) })
}

fn region<'a>(
    spec: &ChannelSpec,
    images: &'a CaseImages,
    labels_path: &Path,
) -> Result<EntryRegion<'a>, PlanError> {
    Ok(match &spec.entry {
        Entry::Label(label) => EntryRegion::Label(
            &images.labels.volume,
            label_of("path.entry_label", label, images, labels_path)?,
        ),
        Entry::Ball { center_mm, radius_mm } => {
            EntryRegion::Ball { center: Point::from_coords(*center_mm), radius_mm: *radius_mm }
        }
        Entry::Point(_) | Entry::Surface => EntryRegion::Surface,
    })
}

/// Refuses a channel that cuts a structure.
pub(super) fn through(case: &Case, channel: &SafeChannel) -> Result<(), PlanError> {
    let kept = channel.kept.iter().zip(&case.structures);
    let cut = kept.filter_map(|(kept, structure)| Some((kept.as_ref()?, structure)));
    let cut = cut.filter(|(kept, _): &(&KeptClearance, _)| kept.clearance_mm < 0.0);
    match cut.min_by(|a, b| a.0.clearance_mm.total_cmp(&b.0.clearance_mm)) {
        None => Ok(()),
        Some((kept, structure)) => Err(ChannelFault::Through {
            structure: structure.name.clone(),
            cut_mm: -kept.clearance_mm,
            depth_mm: kept.depth_mm,
        }
        .into()),
    }
}
