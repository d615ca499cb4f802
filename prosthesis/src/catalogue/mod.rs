//! The blocks in stock: a TOML file that several stations share, and the choice of the smallest block that will do.
//!
//! A station locks `NAME.lock`, beside the file, while it changes it, so that of two stations that want the last block one gets it and the
//! other is told that there is none ([`CatalogueError::NoneLeft`]). A station waits for the lock for at most [`WAIT`]. The changed file takes
//! the place of the one before at once, so reading takes no lock. A lock holds across stations where the file system's locks do.
//! A block that a plan needs is leased ([`Lease`]): it goes back however the program ends, unless the plan is kept.
//! Sizes are mm. Not here: what a part needs around it.
//!
//! ```
//! use bonemill_prosthesis::catalogue::{Catalogue, smallest};
//! let folder = tempfile::tempdir()?;
//! let stock = Catalogue::open_or_create(&folder.path().join("stock.toml"))?;
//! stock.add("B1", [60.0, 25.0, 55.0], 2)?;
//! let mounted = smallest(&stock.list()?, [41.0, 16.0, 54.0]).expect("it fits");
//! assert_eq!((mounted.id.as_str(), mounted.size_mm), ("B1", [55.0, 25.0, 60.0]));
//! stock.take("B1")?;
//! assert_eq!(stock.list()?[0].count, 1);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod error;
mod fit;
mod lease;
mod stock;

use std::fs::{self, File, OpenOptions, TryLockError};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use self::stock::Stock;

pub use error::CatalogueError;
pub use fit::{Mounted, smallest};
pub use lease::Lease;
pub use stock::StockBlock;

/// How long a station waits for another one's change.
pub const WAIT: Duration = Duration::from_secs(10);
/// How often it looks whether that is done.
const LOOKS: Duration = Duration::from_millis(5);

/// The catalogue.
#[derive(Debug)]
pub struct Catalogue {
    path: PathBuf,
}

impl Catalogue {
    /// Opens a catalogue.
    ///
    /// # Errors
    /// [`CatalogueError::Missing`] when there is no such file, [`CatalogueError::Foreign`] when it is none of ours,
    /// [`CatalogueError::File`].
    pub fn open(path: &Path) -> Result<Self, CatalogueError> {
        Stock::read(path)?;
        // stations that name it by different links share one lock
        let path = fs::canonicalize(path).map_err(CatalogueError::of_file(path))?;
        Ok(Self { path })
    }

    /// Opens a catalogue, or begins an empty one where there is no file.
    ///
    /// # Errors
    /// As [`Self::open`], but for a file that does not exist.
    pub fn open_or_create(path: &Path) -> Result<Self, CatalogueError> {
        // a link to a share that is not there is no place for a new one
        let is_free = || fs::symlink_metadata(path).is_err();
        if is_free() {
            let _lock = locked(path)?;
            // one that another station made meanwhile stays
            if is_free() {
                Stock::default().write(path)?;
            }
        }
        Self::open(path)
    }

    /// Adds blocks of a kind; the sizes of a kind that is there already must be the same.
    ///
    /// # Errors
    /// [`CatalogueError::Id`], [`CatalogueError::Size`], [`CatalogueError::Count`], [`CatalogueError::OtherSize`].
    pub fn add(&self, id: &str, size_mm: [f64; 3], count: u32) -> Result<(), CatalogueError> {
        self.change(|stock| stock.add(StockBlock { id: id.into(), size_mm, count }))
    }

    /// Takes a kind out of the catalogue, with all of its blocks: to correct one, remove and add it.
    ///
    /// # Errors
    /// [`CatalogueError::Unknown`].
    pub fn remove(&self, id: &str) -> Result<StockBlock, CatalogueError> {
        self.change(|stock| stock.remove(id))
    }

    /// Every kind of block, by number. A block whose lease has ended without its program's word counts as one that is there.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub fn list(&self) -> Result<Vec<StockBlock>, CatalogueError> {
        let mut stock = Stock::read(&self.path)?;
        lease::put_back_ended(&mut stock, &self.path);
        Ok(stock.blocks)
    }

    /// Takes one block of a kind.
    ///
    /// # Errors
    /// [`CatalogueError::Unknown`], [`CatalogueError::NoneLeft`].
    pub fn take(&self, id: &str) -> Result<StockBlock, CatalogueError> {
        self.change(|stock| stock.take(id))
    }

    /// Leases the smallest block that holds a box of these sides along x, y and z; choice and taking are one step. `None`: none does.
    ///
    /// `replaces`: the kind of the block that goes back if this lease is kept; it may be that block itself.
    ///
    /// # Errors
    /// As [`Self::open`], [`CatalogueError::Locked`].
    pub fn lease_smallest(
        &self,
        needed_mm: [f64; 3],
        replaces: Option<&str>,
    ) -> Result<Option<Lease>, CatalogueError> {
        self.change(|stock| {
            let mut blocks = stock.blocks.clone();
            blocks
                .iter_mut()
                .filter(|block| Some(block.id.as_str()) == replaces)
                .for_each(|block| block.count = block.count.saturating_add(1));
            let replaces = replaces.filter(|id| blocks.iter().any(|block| block.id == *id));
            let found = smallest(&blocks, needed_mm);
            found.map(|mounted| Lease::begin(stock, &self.path, mounted, replaces)).transpose()
        })
    }

    /// Puts one block of a kind back.
    ///
    /// # Errors
    /// [`CatalogueError::Unknown`], [`CatalogueError::Count`].
    pub fn put_back(&self, id: &str) -> Result<StockBlock, CatalogueError> {
        self.change(|stock| stock.put_back(id))
    }

    /// One change, whole or not at all; others wait until it is done.
    fn change<T>(
        &self,
        work: impl FnOnce(&mut Stock) -> Result<T, CatalogueError>,
    ) -> Result<T, CatalogueError> {
        let lock = locked(&self.path)?;
        let mut stock = Stock::read(&self.path)?;
        lease::sweep(&mut stock, &self.path);
        let done = work(&mut stock)?;
        let written = stock.write(&self.path);
        // a lease that is dropped here takes the lock itself
        drop(lock);
        written.map(|()| done)
    }
}

/// The lock of a catalogue, as long as the file is open.
fn locked(path: &Path) -> Result<File, CatalogueError> {
    let lock = beside(path, "lock");
    let file = OpenOptions::new().create(true).append(true).open(&lock);
    let file = file.map_err(CatalogueError::of_file(&lock))?;
    if let Ok(there) = fs::metadata(path) {
        // whoever may change the catalogue may lock it; only the lock's owner can say so
        let _ = file.set_permissions(there.permissions());
    }
    let began = Instant::now();
    loop {
        match file.try_lock() {
            Ok(()) => return Ok(file),
            Err(TryLockError::WouldBlock) if began.elapsed() < WAIT => std::thread::sleep(LOOKS),
            Err(TryLockError::WouldBlock) => return Err(CatalogueError::Locked { path: path.into() }),
            Err(TryLockError::Error(source)) => return Err(CatalogueError::File { path: lock, source }),
        }
    }
}

/// The path of a file beside the catalogue.
fn beside(path: &Path, ending: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".");
    name.push(ending);
    name.into()
}

#[cfg(test)]
mod tests;
