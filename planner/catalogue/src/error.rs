//! What can go wrong with a catalogue of blocks.

use std::path::PathBuf;

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
    #[error("{} is no catalogue of blocks; expected a database made by `bonemill stock add`", path.display())]
    Foreign {
        /// The file.
        path: PathBuf,
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
    /// The database refused.
    #[error("the catalogue cannot be read or changed")]
    Database(#[from] rusqlite::Error),
}
