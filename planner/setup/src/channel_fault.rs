//! Why a case's straight channel cannot be planned.

use bonemill_cutting::cutter::CutterError;
use thiserror::Error;

/// Why there is no channel.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum ChannelFault {
    /// The case's tool cannot be pushed along its axis.
    #[error("tool.kind = \"{kind}\": a channel needs \"{needed}\"")]
    Tool {
        /// What the case says.
        kind: &'static str,
        /// What it may say.
        needed: &'static str,
    },
    /// Dimensions, or a feed, that the tool does not have.
    #[error(transparent)]
    Cutter(#[from] CutterError),
    /// A line that should lead out of the bone does not.
    #[error(
        "the line from target_mm against the direction meets no bone, leaves the scan in bone, leaves the bone outside the entry's region, \
         or does not reach the air outside with room for the tool: check target_mm, direction and the region"
    )]
    NoEntry,
    /// No direction leads to the target.
    #[error(
        "no straight channel leads to target_mm: of {sampled} directions {in_region} lead outside in the entry's region and within path.cone_deg of approach.direction, with room for the tool, and {too_long} of these are longer \
         than the {longest_mm:.1} mm that the tool can drill before its holder reaches the bone"
    )]
    NoDirection {
        /// Directions that were tried.
        sampled: usize,
        /// Of these: lead outside within the region and the cone.
        in_region: usize,
        /// Of these: longer than the tool.
        too_long: usize,
        /// How deep the tool goes, mm.
        longest_mm: f64,
    },
    /// The tool would cut a structure.
    #[error(
        "the channel runs through {structure}: the tool would cut {cut_mm:.2} mm into it at a depth of {depth_mm:.1} mm"
    )]
    Through {
        /// The structure.
        structure: String,
        /// How deep the tool's surface lies in it, mm, at least.
        cut_mm: f64,
        /// Where, mm from the entry.
        depth_mm: f64,
    },
    /// The tool stands in bone before it starts.
    #[error(
        "the tool would begin in bone, {before_mm:.1} mm before entry_mm: check that direction leads into the bone, and path.standoff_mm"
    )]
    BeginsInBone {
        /// How far before the entry the search began, mm.
        before_mm: f64,
    },
    /// The tool meets no bone on its way.
    #[error(
        "the tool meets no bone between {from_mm:.1} mm before the entry and a depth of {to_mm:.1} mm: check entry_mm and direction"
    )]
    NoBone {
        /// How far before the entry the search began, mm.
        from_mm: f64,
        /// Where it ended, mm.
        to_mm: f64,
    },
    /// The contact area that was asked for is not reached.
    #[error(
        "a contact area of {wanted_mm2} mm² is not reached: the most is {most_mm2:.1} mm², at a depth of {depth_mm:.1} mm"
    )]
    ContactArea {
        /// What was asked for, mm².
        wanted_mm2: f64,
        /// The most that was found, mm².
        most_mm2: f64,
        /// There, mm.
        depth_mm: f64,
    },
}

impl ChannelFault {
    /// Whether the case is sound but cannot be fulfilled.
    pub fn is_infeasible(&self) -> bool {
        matches!(self, Self::NoDirection { .. } | Self::Through { .. } | Self::ContactArea { .. })
    }

    /// The key of the case to look at.
    pub fn key(&self) -> &'static str {
        match self {
            Self::Tool { .. } => "tool.kind",
            Self::Cutter(CutterError::FeedOutrunsLip { .. }) => "path.feed_mm_rev",
            Self::Cutter(_) => "tool",
            Self::NoEntry | Self::NoDirection { .. } => "path.target_mm",
            Self::Through { .. } | Self::NoBone { .. } | Self::BeginsInBone { .. } => "path",
            Self::ContactArea { .. } => "path.contact_area_mm2",
        }
    }
}
