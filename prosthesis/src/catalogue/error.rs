//! What can go wrong with a catalogue of blocks.

use std::path::{Path, PathBuf};

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
    /// The file that says whose a block is cannot be made or locked.
    #[error("{}: it cannot be made or locked", path.display())]
    Lease {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// Another program holds the catalogue.
    #[error("the catalogue {} has been locked by another program for {} s: try again when that has ended", path.display(), crate::catalogue::WAIT.as_secs())]
    Locked {
        /// The catalogue.
        path: PathBuf,
    },
    /// The database refused.
    #[error("the catalogue {} cannot be read or changed", path.display())]
    Database {
        /// The catalogue.
        path: PathBuf,
        /// Why.
        source: rusqlite::Error,
    },
}

impl CatalogueError {
    /// What a refusal of the database at a path means.
    pub(crate) fn of_database(path: &Path, source: rusqlite::Error) -> Self {
        use rusqlite::ErrorCode::{DatabaseBusy, DatabaseLocked, NotADatabase};
        let path = path.to_path_buf();
        match source.sqlite_error_code() {
            Some(NotADatabase) => Self::Foreign { path },
            Some(DatabaseBusy | DatabaseLocked) => Self::Locked { path },
            _ => Self::Database { path, source },
        }
    }

    /// The same with the catalogue's path, where a change met the database itself.
    pub(crate) fn at(self, path: &Path) -> Self {
        match self {
            Self::Database { source, .. } => Self::of_database(path, source),
            other => other,
        }
    }
}

impl From<rusqlite::Error> for CatalogueError {
    fn from(source: rusqlite::Error) -> Self {
        Self::Database { path: PathBuf::new(), source }
    }
}
