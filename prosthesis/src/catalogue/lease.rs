//! A block that a plan holds until it is kept: it goes back however the program ends.
//!
//! The catalogue remembers every lease, and its holder locks a file of its own beside the catalogue, `NAME.lease-HOLDER`. The operating system
//! gives the lock up when the holder ends, be it killed: whoever changes the catalogue next finds the lock free and puts that block back.

use std::fs::{self, File, OpenOptions};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process;
use std::time::{SystemTime, UNIX_EPOCH};

use super::stock::{LeaseEntry, Stock};
use super::{Catalogue, CatalogueError, Mounted, beside};

/// A block out of the catalogue; it goes back when dropped, unless kept.
#[derive(Debug)]
pub struct Lease {
    /// Which block, and how it is mounted.
    pub mounted: Mounted,
    path: PathBuf,
    holder: String,
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
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let holder = format!("{}-{}", process::id(), since.as_nanos());
        let held = lock_path(path, &holder);
        let file = OpenOptions::new().create_new(true).append(true).open(&held);
        let file =
            file.and_then(|file| file.lock().map(|()| file)).map_err(CatalogueError::of_file(&held))?;
        // a block that stands for itself is out already
        let taken = (replaces != Some(mounted.id.as_str())).then(|| mounted.id.clone());
        if let Some(id) = &taken {
            stock.take(id)?;
        }
        stock.leases.push(LeaseEntry { holder: holder.clone(), block: taken });
        Ok(Self { mounted, path: path.into(), holder, replaces: replaces.map(Into::into), _lock: file })
    }

    /// The block is used: it does not go back, but the one that it replaces does.
    ///
    /// # Errors
    /// As [`Catalogue::open`], [`CatalogueError::Locked`], [`CatalogueError::Write`].
    pub fn keep(self) -> Result<(), CatalogueError> {
        Catalogue::open(&self.path)?.change(|stock| {
            stock.leases.retain(|lease| lease.holder != self.holder);
            // unless its kind has been removed
            let other = self.replaces.as_ref().filter(|id| **id != self.mounted.id);
            let _ = other.map(|id| stock.put_back(id));
            Ok(())
        })
        // dropping finds no lease any more
    }
}

impl Drop for Lease {
    fn drop(&mut self) {
        // a catalogue that cannot be reached now is put right by the next one that reaches it
        let _ = Catalogue::open(&self.path).and_then(|catalogue| {
            catalogue.change(|stock| {
                end(stock, &self.path, &self.holder);
                Ok(())
            })
        });
    }
}

/// Ends the leases whose holders have ended, also in their files.
pub(super) fn sweep(stock: &mut Stock, path: &Path) {
    ended(stock, path).iter().for_each(|holder| end(stock, path, holder));
}

/// The same in what was read alone.
pub(super) fn put_back_ended(stock: &mut Stock, path: &Path) {
    ended(stock, path).iter().for_each(|holder| put_back(stock, holder));
}

/// The holders that have ended without a word.
fn ended(stock: &Stock, path: &Path) -> Vec<String> {
    let has_ended = |holder: &str| match OpenOptions::new().append(true).open(lock_path(path, holder)) {
        Ok(file) => file.try_lock().is_ok(),
        Err(error) => error.kind() == ErrorKind::NotFound,
    };
    let holders = stock.leases.iter().map(|lease| lease.holder.clone());
    holders.filter(|holder| has_ended(holder)).collect()
}

/// Ends a lease, if it is there.
fn end(stock: &mut Stock, path: &Path, holder: &str) {
    put_back(stock, holder);
    // without its entry the file means nothing
    let _ = fs::remove_file(lock_path(path, holder));
}

/// Takes a lease out; its block goes back, unless its kind has been removed.
fn put_back(stock: &mut Stock, holder: &str) {
    if let Some(place) = stock.leases.iter().position(|lease| lease.holder == holder) {
        let block = stock.leases.remove(place).block;
        let _ = block.map(|id| stock.put_back(&id));
    }
}

fn lock_path(path: &Path, holder: &str) -> PathBuf {
    beside(path, &format!("lease-{holder}"))
}
