//! The job's numbers as the stages take them.

use crate::catalogue::StockBlock;
use crate::machining::{Block, HolderSegment, Job, Machine, Process, Tool};
use crate::program::Dialect;
use bonemill_case::prosthesis::{BlockSpec, CutSense, GCode, ProsthesisJob};
use bonemill_verify::proof::ProofJob;
use nalgebra::Vector3;

/// Distance of the points on the part at which the program is judged, mm.
const SAMPLE_MM: f64 = 0.25;

/// The job for the toolpath.
pub(crate) fn machining(job: &ProsthesisJob, block: Block) -> Job {
    let (t, p, m) = (&job.tool, &job.process, &job.machine);
    let holder = t.holder_mm.iter().map(|&[length_mm, radius_mm]| HolderSegment { length_mm, radius_mm });
    Job {
        block,
        tool: Tool {
            radius_mm: t.diameter_mm / 2.0,
            corner_radius_mm: t.corner_radius_mm,
            flutes: t.flutes,
            length_mm: t.length_mm,
            holder: holder.collect(),
        },
        process: Process {
            spindle_rpm: p.spindle_rpm,
            feed_per_tooth_mm: p.feed_per_tooth_mm,
            side_load: p.side_load,
            depth_of_cut: p.depth_of_cut,
            finishing_step_mm: p.finishing_step_mm,
            strip_mm: p.strip_mm,
            clearance_mm: p.clearance_mm,
            climb: p.sense == CutSense::Climb,
        },
        machine: Machine {
            travel_mm: m.travel_mm,
            rotary_range_rad: m.rotary_range_rad,
            max_feed_mm_min: m.max_feed_mm_min,
            rapid_mm_min: m.rapid_mm_min,
            rotary_rad_s: m.rotary_rad_s,
            acceleration_mm_s2: m.acceleration_mm_s2,
            jerk_mm_s3: m.jerk_mm_s3,
            max_time_min: m.max_time_min,
        },
    }
}

/// Whose G-code the program is written in.
pub(crate) fn dialect(job: &ProsthesisJob) -> Dialect {
    match job.machine.dialect {
        GCode::LinuxCnc => Dialect::LinuxCnc,
        GCode::Fanuc => Dialect::Fanuc,
        GCode::Haas => Dialect::Haas,
    }
}

/// The job for the proof, in plain numbers; `tab`: the box in which stock shall stay.
pub(crate) fn proof(job: &ProsthesisJob, block: &Block, tab: [Vector3<f64>; 2]) -> ProofJob {
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
        kept: vec![tab],
    }
}

/// A block of the job's own list.
pub(crate) fn stock_block(block: &BlockSpec) -> StockBlock {
    StockBlock { id: block.id.clone(), size_mm: block.size_mm, count: block.count }
}
