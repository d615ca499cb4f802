//! The job's numbers as the stages take them.

use crate::catalogue::StockBlock;
use crate::machining::{Block, EndMill, HolderSegment, MachiningJob};
use crate::proof::ProofJob;
use bonemill_case::prosthesis::{BlockSpec, ProsthesisJob};
use nalgebra::Vector3;

/// Distance of the points on the part at which the program is judged, mm.
const SAMPLE_MM: f64 = 0.25;

/// The job for the toolpath.
pub(crate) fn machining(job: &ProsthesisJob, block: Block) -> MachiningJob {
    let t = &job.tool;
    let holder = t.holder_mm.iter().map(|&[length_mm, radius_mm]| HolderSegment { length_mm, radius_mm });
    MachiningJob {
        block,
        tool: EndMill {
            radius_mm: t.diameter_mm / 2.0,
            corner_radius_mm: t.corner_radius_mm,
            flutes: t.flutes,
            length_mm: t.length_mm,
            holder: holder.collect(),
        },
        process: job.process,
        machine: job.machine.clone(),
    }
}

/// The job for the proof, in plain numbers; `kept`: boxes in which stock shall stay.
pub(crate) fn proof(job: &ProsthesisJob, block: &Block, kept: &[[Vector3<f64>; 2]]) -> ProofJob {
    let (t, p) = (&job.tool, &job.process);
    let level_mm = p.depth_of_cut * t.diameter_mm;
    ProofJob {
        low_mm: block.low_mm,
        high_mm: block.high_mm,
        grip_mm: block.grip_mm,
        radius_mm: t.diameter_mm / 2.0,
        corner_radius_mm: t.corner_radius_mm,
        length_mm: t.length_mm,
        holder_mm: t.holder_mm.clone(),
        widest_mm: p.side_load * t.diameter_mm,
        entry_mm: level_mm * p.side_load.min(1.0),
        clearance_mm: p.clearance_mm,
        flutes: t.flutes,
        sample_mm: SAMPLE_MM,
        kept: kept.to_vec(),
    }
}

/// A block of the job's own list.
pub(crate) fn stock_block(block: &BlockSpec) -> StockBlock {
    StockBlock { id: block.id.clone(), size_mm: block.size_mm, count: block.count }
}
