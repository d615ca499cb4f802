//! What a viewer draws of a finished prosthesis: the part coloured by what the program leaves, the block, the moves, the cutter.
//!
//! Read from the folder's files: the moves from `toolpath.csv`, the deviation from the program that stands there. Lengths are mm in the
//! block's frame.

use std::path::Path;

use crate::machining::{Facing, TipMove};
use bonemill_cutting::cutter::{ShankCylinder, SolidOfRevolution};
use bonemill_geometry::{Block, Mesh, Progress};
use nalgebra::{Matrix3, Rotation3, Vector3};

use crate::picture::Colour;
use crate::record::FILE_NAME;
use crate::report::pictures::scale;
use crate::save::{PART, PROGRAM, TOOLPATH};
use crate::verify::{read_part, read_text};
use crate::{JobRecord, ProsthesisError, settings, toolpath_csv};

/// From a frame with z along the cutter, out of the part, to the block's, at a move's end.
pub fn turn(at: &TipMove) -> Rotation3<f64> {
    let axes = [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| Facing::of(at.a_rad).to_block(&axis));
    Rotation3::from_matrix_unchecked(Matrix3::from_columns(&axes))
}

/// A prosthesis to draw.
#[derive(Debug)]
pub struct ShownProsthesis {
    /// Job, block and figures.
    pub record: JobRecord,
    /// The part.
    pub part: Mesh<Block>,
    /// By vertex of the part: blue where the program cuts into it, grey as asked for, through yellow to red where stock stays.
    pub colours: Vec<Colour>,
    /// Every move, in order.
    pub moves: Vec<TipMove>,
    /// What the cutter sweeps as it spins; z from its tip to the spindle.
    pub cutter: SolidOfRevolution,
    /// The holder behind it.
    pub holder: Vec<ShankCylinder>,
}

impl ShownProsthesis {
    /// Reads a folder.
    ///
    /// # Errors
    /// [`ProsthesisError`] for a file that is missing or not what it should be, with its line.
    pub fn read(dir: &Path, progress: &dyn Progress) -> Result<Self, ProsthesisError> {
        progress.stage("read files");
        let record = JobRecord::read(dir)?;
        let part = read_part(&dir.join(PART))?;
        let path = dir.join(TOOLPATH);
        let moves = toolpath_csv::read(&read_text(&path)?)
            .map_err(|problem| ProsthesisError::Folder { path, problem })?;
        progress.stage("prove program");
        let job = settings::proof(&record.job, &record.block, &record.tab_boxes_mm);
        let proof = crate::proof::prove(&read_text(&dir.join(PROGRAM))?, &part, &job)?;
        // the proof's last samples are the mesh's vertices
        let first = proof.samples.len().saturating_sub(part.vertices.len());
        let colours = proof.samples[first..].iter().map(|sample| scale(sample.deviation_mm)).collect();
        let (cutter, holder) = tool(&record)
            .map_err(|problem| ProsthesisError::Folder { path: dir.join(FILE_NAME), problem })?;
        Ok(Self { colours, moves, cutter, holder, part, record })
    }
}

/// The cutter's solid, tip at z = 0, and the holder.
fn tool(record: &JobRecord) -> Result<(SolidOfRevolution, Vec<ShankCylinder>), String> {
    const ROUND: usize = 16;
    let tool = &record.job.tool;
    let (radius, corner) = (tool.diameter_mm / 2.0, tool.corner_radius_mm);
    let round = (0..=ROUND).map(|n| {
        let (sin, cos) = (n as f64 / ROUND as f64 * std::f64::consts::FRAC_PI_2).sin_cos();
        [corner * (1.0 - cos), radius - corner * (1.0 - sin)]
    });
    let mut profile = vec![[0.0, 0.0]];
    profile.extend(if corner > 0.0 { round.collect() } else { vec![[0.0, radius]] });
    profile.push([tool.length_mm, radius]);
    profile.dedup();
    let holder = ShankCylinder::stacked(tool.length_mm, tool.holder_mm.iter().copied());
    Ok((SolidOfRevolution::new(&profile).map_err(|e| e.to_string())?, holder))
}
