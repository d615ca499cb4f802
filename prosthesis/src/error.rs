//! What leaves nothing to plan, or no folder to judge.

use std::path::PathBuf;

use crate::catalogue::CatalogueError;
use crate::machining::MachiningError;
use crate::proof::ProofError;
use bonemill_case::CaseError;
use bonemill_imaging::part::PartError;
use bonemill_planfile::PlanFileError;
use thiserror::Error;

/// Planning or judging a prosthesis failed.
#[derive(Debug, Error)]
pub enum ProsthesisError {
    /// The part's file is no part.
    #[error("{}: the part cannot be machined", path.display())]
    Part {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: PartError,
    },
    /// The catalogue refused.
    #[error("{}: no block", path.display())]
    Catalogue {
        /// The catalogue.
        path: PathBuf,
        /// Why.
        source: CatalogueError,
    },
    /// No block is large enough.
    #[error(
        "no block in stock holds {:.1} × {:.1} × {:.1} mm (part, gaps and grip along x, y and z); there {}", needed_mm[0], needed_mm[1],
        needed_mm[2], blocks_text(.there)
    )]
    NoBlock {
        /// What is needed along x, y and z, mm.
        needed_mm: [f64; 3],
        /// Number and sides of what is there, mm.
        there: Vec<(String, [f64; 3])>,
    },
    /// No toolpath.
    #[error("the part cannot be milled from block {block}")]
    Machining {
        /// The block.
        block: String,
        /// Why.
        source: Box<MachiningError>,
    },
    /// The program cannot be judged.
    #[error("the program cannot be judged")]
    Proof(#[from] ProofError),
    /// The job in `job.toml` is not valid.
    #[error("the job is not valid")]
    Job(#[from] CaseError),
    /// A file could not be read or written.
    #[error(transparent)]
    Files(#[from] PlanFileError),
    /// A finished folder lacks something or holds something else.
    #[error("{}: {problem}", path.display())]
    Folder {
        /// The file.
        path: PathBuf,
        /// What is wrong, and what was expected.
        problem: String,
    },
}

fn blocks_text(there: &[(String, [f64; 3])]) -> String {
    if there.is_empty() {
        return "is none".into();
    }
    let block = |(id, [a, b, c]): &(String, [f64; 3])| format!("{id} ({a} × {b} × {c} mm)");
    format!("are {}", there.iter().map(block).collect::<Vec<_>>().join(", "))
}
