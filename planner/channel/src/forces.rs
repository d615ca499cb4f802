//! Force on the tool along a channel: thrust, torque and lateral force at every waypoint, by the bone in front of each edge
//! element.
//!
//! An element feels bone where its place on the tool's front is in bone now: places where it was before lie behind. So a move that
//! goes deeper than any before has the force of its elements, weighted by (ρ/ρ_ref)^p; every other move is in air. Elements that have
//! not entered the bone yet, or have left it, feel nothing: entry and breakthrough show element by element.

use bonemill_cutting::cutter::MoveKind;
use bonemill_cutting::edge::{CutterForce, EdgeLoads};
use bonemill_setup::{ChannelFault, PlanError};
use nalgebra::Vector3;
use rayon::prelude::*;

use crate::axis::ChannelAxis;
use crate::bone::{BoneField, ToolPose};
use crate::front::{Met, ToolFront};
use crate::strokes::TipPlace;
use crate::tool::ChannelTool;

/// Elements along an edge.
pub const ELEMENTS: usize = 32;
/// Angles of the tool between one copy of its edges and the next.
pub const TURNS: usize = 12;

/// What the tool meets and feels at a waypoint; nothing where it does not go deeper.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Felt {
    /// On the tool, in its frame.
    pub force: CutterForce,
    /// By the front, at the waypoint.
    pub met: Met,
    /// Mass removed since the waypoint before, mg.
    pub mass_mg: f64,
    /// How much deeper than ever before it goes, mm; 0 where it does not.
    pub deeper_mm: f64,
}

/// Force at a pose, tool frame: the loads of the edges, weighted by bone.
pub fn force_at(loads: &EdgeLoads, tool: &ChannelTool, bone: &BoneField<'_>, pose: &ToolPose) -> CutterForce {
    loads.sum(TURNS, |_, at| {
        let density = bone.density_g_cm3(pose.place(at.coords));
        if density > 0.0 { (density / tool.rho_ref_g_cm3).powf(tool.exponent) } else { 0.0 }
    })
}

/// The loads of the edges at a speed, mm/s.
///
/// # Errors
/// [`ChannelFault::Cutter`] for a feed that outruns the lips.
pub fn loads_at(tool: &ChannelTool, speed_mm_s: f64) -> Result<EdgeLoads, PlanError> {
    let feed_mm_rev = speed_mm_s * 60.0 / tool.spindle_rpm;
    let edges = tool.cutter.edges(feed_mm_rev, ELEMENTS).map_err(ChannelFault::from)?;
    Ok(EdgeLoads::new(&edges, feed_mm_rev, tool.spindle_rpm, &tool.coefficients))
}

/// What is felt at every waypoint.
///
/// # Errors
/// As [`loads_at`].
pub fn along(
    places: &[TipPlace],
    axis: &ChannelAxis,
    tool: &ChannelTool,
    bone: &BoneField<'_>,
) -> Result<Vec<Felt>, PlanError> {
    let front = ToolFront::new(tool.cutter.solid(), tool.guide_radius_mm);
    let deepest = deepest_before(places);
    let feel = |(place, before): (&TipPlace, &f64)| -> Result<Felt, PlanError> {
        let deeper_mm = (place.depth_mm - before).max(0.0);
        // links run before the bone, and faster than edges can cut
        if deeper_mm <= 0.0 || place.kind != MoveKind::Cut {
            return Ok(Felt::default());
        }
        let pose = ToolPose::new(axis.at(place.depth_mm), &axis.out);
        let halfway = ToolPose::new(axis.at(place.depth_mm - 0.5 * deeper_mm), &axis.out);
        Ok(Felt {
            force: force_at(&loads_at(tool, place.speed_mm_s)?, tool, bone, &pose),
            met: front.meets(bone, &pose),
            mass_mg: front.meets(bone, &halfway).mass_mg_mm * deeper_mm,
            deeper_mm,
        })
    };
    places.par_iter().zip(&deepest).map(feel).collect()
}

/// How deep the tip was before each waypoint, mm.
fn deepest_before(places: &[TipPlace]) -> Vec<f64> {
    let mut deepest = places.first().map_or(0.0, |place| place.depth_mm);
    let step = |place: &TipPlace| {
        let before = deepest;
        deepest = deepest.max(place.depth_mm);
        before
    };
    places.iter().map(step).collect()
}

/// A force of the tool's frame in ct.
pub fn in_ct(axis: &ChannelAxis, force_n: &Vector3<f64>) -> Vector3<f64> {
    bonemill_geometry::basis::from_z(&axis.out) * force_n
}
