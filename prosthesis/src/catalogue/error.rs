//! What can go wrong with a catalogue of blocks.

use std::io;
use std::path::{Path, PathBuf};

use bonemill_planfile::PlanFileError;
use thiserror::Error;

/// Reading or changing the stock failed.
#[derive(Debug, Error)]
pub enum CatalogueError {
    /// No such file.
    #[error("there is no catalogue {}: `bonemill stock add` makes one", path.display())]
    Missing {
        /// The file.
        path: PathBuf,
    },
    /// A file, but no catalogue.
    #[error("{} is no catalogue of blocks ({why}); expected a TOML file made by `bonemill stock add`", path.display())]
    Foreign {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        why: String,
    },
    /// A number that cannot be one.
    #[error("{id:?} is no block's number; expected text without commas, quotes and control characters")]
    Id {
        /// As given.
        id: String,
    },
    /// A side that no block has.
    #[error("block {id}: a side of {side_mm} mm; expected 1 to 1000 mm")]
    Size {
        /// The block.
        id: String,
        /// Its side, mm.
        side_mm: f64,
    },
    /// More blocks of a kind than the catalogue counts.
    #[error("block {id}: {count} of them; expected at most {most}")]
    Count {
        /// The block.
        id: String,
        /// How many there would be.
        count: u32,
        /// The most.
        most: u32,
    },
    /// A block of this number has other sides.
    #[error(
        "block {id} is {size_mm:?} mm in the catalogue, not {given_mm:?} mm: give the new kind a number of its own"
    )]
    OtherSize {
        /// The block.
        id: String,
        /// In the catalogue, mm.
        size_mm: [f64; 3],
        /// As given, mm.
        given_mm: [f64; 3],
    },
    /// No such block.
    #[error("the catalogue has no block {id}")]
    Unknown {
        /// As given.
        id: String,
    },
    /// The last one is gone.
    #[error("there is no block {id} left")]
    NoneLeft {
        /// The block.
        id: String,
    },
    /// A file of the catalogue cannot be made, locked or read.
    #[error("{}: it cannot be made, locked or read", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The changed catalogue cannot be written.
    #[error(transparent)]
    Write(#[from] PlanFileError),
    /// Another program holds the catalogue.
    #[error("the catalogue {} has been locked by another program for {} s: try again when that has ended", path.display(), crate::catalogue::WAIT.as_secs())]
    Locked {
        /// The catalogue.
        path: PathBuf,
    },
}

impl CatalogueError {
    /// What became of a file.
    pub(super) fn of_file(path: &Path) -> impl FnOnce(io::Error) -> Self + '_ {
        move |source| Self::File { path: path.into(), source }
    }
}
