//! A block that a plan holds until it is kept: it goes back however the program ends.
//!
//! The catalogue remembers every lease, and its holder locks a file beside the catalogue, `NAME.lease-N`. The operating system gives the lock up when the holder
//! ends, be it killed: whoever takes or gives a block next finds the lock free and puts that block back. A lock holds across stations
//! where the file system's locks do.

use std::fs::{File, OpenOptions};
use std::path::{Path, PathBuf};

use rusqlite::{Transaction, params};

use crate::catalogue::{Catalogue, CatalogueError, Mounted};

/// A block out of the catalogue; it goes back when dropped, unless kept.
#[derive(Debug)]
pub struct Lease {
    /// Which block, and how it is mounted.
    pub mounted: Mounted,
    path: PathBuf,
    row: i64,
    /// The kind that goes back when this one is kept.
    replaces: Option<String>,
    /// Locked as long as the lease lasts.
    _lock: File,
}

impl Lease {
    /// Leases a block that is there, inside a transaction.
    pub(crate) fn begin(
        t: &Transaction<'_>,
        path: &Path,
        mounted: Mounted,
        replaces: Option<&str>,
    ) -> Result<Self, CatalogueError> {
        // a block that stands for itself is out already
        let taken = replaces != Some(mounted.id.as_str());
        if taken {
            crate::catalogue::take(t, &mounted.id)?;
        }
        t.execute("INSERT INTO lease (block) VALUES (?1)", params![taken.then_some(&mounted.id)])?;
        let row = t.last_insert_rowid();
        let lock = lock_path(path, row);
        let io = |source| CatalogueError::Lease { path: lock.clone(), source };
        let file = OpenOptions::new().create(true).append(true).open(&lock).map_err(io)?;
        file.lock().map_err(io)?;
        Ok(Self { mounted, path: path.into(), row, replaces: replaces.map(Into::into), _lock: file })
    }

    /// The block is used: it does not go back, but the one that it replaces does.
    ///
    /// # Errors
    /// As [`Catalogue::take`].
    pub fn keep(self) -> Result<(), CatalogueError> {
        Catalogue::open(&self.path)?.change(|t| {
            t.execute("DELETE FROM lease WHERE id = ?1", [self.row])?;
            match self.replaces.as_ref().filter(|id| **id != self.mounted.id) {
                Some(id) => crate::catalogue::put_back(t, id),
                None => Ok(()),
            }
        })
        // dropping finds no lease any more
    }
}

impl Drop for Lease {
    fn drop(&mut self) {
        // a catalogue that cannot be reached now is put right by the next one that reaches it
        let _ =
            Catalogue::open(&self.path).and_then(|mut stock| stock.change(|t| end(t, &self.path, self.row)));
    }
}

/// Ends the leases whose holders have ended.
pub(crate) fn sweep(t: &Transaction<'_>, path: &Path) -> Result<(), CatalogueError> {
    let mut statement = t.prepare("SELECT id FROM lease")?;
    let rows: Vec<i64> = statement.query_map([], |row| row.get(0))?.collect::<Result<_, _>>()?;
    for row in rows {
        let is_held = File::open(lock_path(path, row)).is_ok_and(|file| file.try_lock().is_err());
        if !is_held {
            end(t, path, row)?;
        }
    }
    Ok(())
}

/// Ends a lease, if it is there: its block goes back.
fn end(t: &Transaction<'_>, path: &Path, row: i64) -> Result<(), CatalogueError> {
    t.execute(
        "UPDATE block SET count = count + 1 WHERE id = (SELECT block FROM lease WHERE id = ?1)",
        [row],
    )?;
    t.execute("DELETE FROM lease WHERE id = ?1", [row])?;
    // without its row the file means nothing
    let _ = std::fs::remove_file(lock_path(path, row));
    Ok(())
}

fn lock_path(path: &Path, row: i64) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(format!(".lease-{row}"));
    name.into()
}
