//! A block that a plan holds until it is kept: it goes back however the program ends.
//!
//! The catalogue remembers every lease, and its holder locks a file beside the catalogue, `NAME.lease-N`. The operating system gives the lock up when the holder
//! ends, be it killed: whoever changes the catalogue next finds the lock free and puts that block back.

use std::fs::{self, File, OpenOptions};
use std::path::{Path, PathBuf};

use super::stock::{LeaseEntry, Stock};
use super::{Catalogue, CatalogueError, Mounted, beside};

/// A block out of the catalogue; it goes back when dropped, unless kept.
#[derive(Debug)]
pub struct Lease {
    /// Which block, and how it is mounted.
    pub mounted: Mounted,
    path: PathBuf,
    number: u64,
    /// The kind that goes back when this one is kept.
    replaces: Option<String>,
    /// Locked as long as the lease lasts.
    _lock: File,
}

impl Lease {
    /// Leases a block that is there, as a part of a change.
    pub(super) fn begin(
        stock: &mut Stock,
        path: &Path,
        mounted: Mounted,
        replaces: Option<&str>,
    ) -> Result<Self, CatalogueError> {
        let number = stock.next_lease;
        let held = lock_path(path, number);
        let file = OpenOptions::new().create(true).append(true).open(&held);
        let file =
            file.and_then(|file| file.lock().map(|()| file)).map_err(CatalogueError::of_file(&held))?;
        // a block that stands for itself is out already
        let taken = (replaces != Some(mounted.id.as_str())).then(|| mounted.id.clone());
        if let Some(id) = &taken {
            stock.take(id)?;
        }
        stock.leases.push(LeaseEntry { number, block: taken });
        stock.next_lease += 1;
        Ok(Self { mounted, path: path.into(), number, replaces: replaces.map(Into::into), _lock: file })
    }

    /// The block is used: it does not go back, but the one that it replaces does.
    ///
    /// # Errors
    /// As [`Catalogue::put_back`].
    pub fn keep(self) -> Result<(), CatalogueError> {
        Catalogue::open(&self.path)?.change(|stock| {
            stock.leases.retain(|lease| lease.number != self.number);
            match self.replaces.as_ref().filter(|id| **id != self.mounted.id) {
                Some(id) => stock.put_back(id).map(|_| ()),
                None => Ok(()),
            }
        })
        // dropping finds no lease any more
    }
}

impl Drop for Lease {
    fn drop(&mut self) {
        // a catalogue that cannot be reached now is put right by the next one that reaches it
        let _ = Catalogue::open(&self.path).and_then(|catalogue| {
            catalogue.change(|stock| {
                end(stock, &self.path, self.number);
                Ok(())
            })
        });
    }
}

/// Ends the leases whose holders have ended.
pub(super) fn sweep(stock: &mut Stock, path: &Path) {
    let is_held =
        |number: u64| File::open(lock_path(path, number)).is_ok_and(|file| file.try_lock().is_err());
    let ended: Vec<u64> = stock.leases.iter().map(|lease| lease.number).filter(|n| !is_held(*n)).collect();
    ended.into_iter().for_each(|number| end(stock, path, number));
}

/// Ends a lease, if it is there: its block goes back, unless its kind has been removed.
fn end(stock: &mut Stock, path: &Path, number: u64) {
    if let Some(place) = stock.leases.iter().position(|lease| lease.number == number) {
        let block = stock.leases.remove(place).block;
        let _ = block.map(|id| stock.put_back(&id));
    }
    // without its entry the file means nothing
    let _ = fs::remove_file(lock_path(path, number));
}

fn lock_path(path: &Path, number: u64) -> PathBuf {
    beside(path, &format!("lease-{number}"))
}
