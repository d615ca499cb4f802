//! The blocks in stock: an SQLite database that several stations share, and the choice of the smallest block that will do.
//!
//! Every change is one transaction that takes the database's write lock first, so that of two stations that want the last block
//! one gets it and the other is told that there is none ([`CatalogueError::NoneLeft`]). A station waits for the lock for at most
//! [`WAIT`]. Reading takes no lock. A block that a plan needs is leased ([`Lease`]): it goes back however the program ends, unless the plan is kept.
//! Sizes are mm. Not here: what a part needs around it.
//!
//! ```
//! use bonemill_prosthesis::catalogue::{Catalogue, smallest};
//! let mut stock = Catalogue::in_memory()?;
//! stock.add("B1", [60.0, 25.0, 55.0], 2)?;
//! let mounted = smallest(&stock.list()?, [41.0, 16.0, 54.0]).expect("it fits");
//! assert_eq!((mounted.id.as_str(), mounted.size_mm), ("B1", [55.0, 25.0, 60.0]));
//! stock.take("B1")?;
//! assert_eq!(stock.list()?[0].count, 1);
//! # Ok::<(), bonemill_prosthesis::catalogue::CatalogueError>(())
//! ```

mod error;
mod fit;
mod lease;

use std::path::{Path, PathBuf};
use std::time::Duration;

use rusqlite::{Connection, OptionalExtension, Transaction, TransactionBehavior, params};

pub use error::CatalogueError;
pub use fit::{Mounted, smallest};
pub use lease::Lease;

/// How long a station waits for another one's change.
pub const WAIT: Duration = Duration::from_secs(10);
/// Marks a database as a catalogue: "bnml".
const APPLICATION_ID: i32 = 0x626E_6D6C;
/// The table's version.
const VERSION: i32 = 1;
/// Most blocks of a kind.
const MOST_BLOCKS: u32 = 1_000_000;

/// A kind of block.
#[derive(Debug, Clone, PartialEq)]
pub struct StockBlock {
    /// Its number.
    pub id: String,
    /// Its three sides as they were entered, mm.
    pub size_mm: [f64; 3],
    /// How many there are.
    pub count: u32,
}

/// The catalogue.
#[derive(Debug)]
pub struct Catalogue {
    database: Connection,
    path: PathBuf,
}

impl Catalogue {
    /// Opens a catalogue.
    ///
    /// # Errors
    /// [`CatalogueError::Missing`] when there is no such file, [`CatalogueError::Foreign`] when it is none of ours,
    /// [`CatalogueError::Database`].
    pub fn open(path: &Path) -> Result<Self, CatalogueError> {
        if !path.exists() {
            return Err(CatalogueError::Missing { path: path.into() });
        }
        let refuse = |source| CatalogueError::of_database(path, source);
        let database = Connection::open(path).map_err(refuse)?;
        database.busy_timeout(WAIT).map_err(refuse)?;
        let pragma = |name: &str| database.pragma_query_value(None, name, |row| row.get::<_, i32>(0));
        if (pragma("application_id").map_err(refuse)?, pragma("user_version").map_err(refuse)?)
            != (APPLICATION_ID, VERSION)
        {
            return Err(CatalogueError::Foreign { path: path.into() });
        }
        Ok(Self { database, path: path.into() })
    }

    /// Opens a catalogue, or begins an empty one where there is no file.
    ///
    /// # Errors
    /// As [`Self::open`], but for a file that does not exist.
    pub fn open_or_create(path: &Path) -> Result<Self, CatalogueError> {
        if !path.exists() {
            // made whole beside its place: no other station sees half of it
            let mut name = path.as_os_str().to_owned();
            name.push(format!(".new-{}", std::process::id()));
            let new = PathBuf::from(name);
            let refuse = |source| CatalogueError::of_database(path, source);
            let made = Connection::open(&new).and_then(|database| create(&database));
            // one that another station made meanwhile stays
            let linked = made.map(|()| std::fs::hard_link(&new, path));
            let _ = std::fs::remove_file(&new);
            match linked.map_err(refuse)? {
                Err(source) if source.kind() != std::io::ErrorKind::AlreadyExists => {
                    return Err(CatalogueError::Lease { path: path.into(), source });
                }
                _ => {}
            }
        }
        Self::open(path)
    }

    /// An empty catalogue that lasts as long as the value; nothing can be leased from it.
    ///
    /// # Errors
    /// [`CatalogueError::Database`].
    pub fn in_memory() -> Result<Self, CatalogueError> {
        let path = PathBuf::from(":memory:");
        let refuse = |source| CatalogueError::of_database(&path, source);
        let database = Connection::open_in_memory().map_err(refuse)?;
        create(&database).map_err(refuse)?;
        Ok(Self { database, path })
    }

    /// Adds blocks of a kind; the sizes of a kind that is there already must be the same.
    ///
    /// # Errors
    /// [`CatalogueError::Id`], [`CatalogueError::Size`], [`CatalogueError::Count`], [`CatalogueError::OtherSize`].
    pub fn add(&mut self, id: &str, size_mm: [f64; 3], count: u32) -> Result<(), CatalogueError> {
        check(id, size_mm)?;
        self.change(|t| {
            let before = block(t, id)?;
            // a block is turned as it is needed: the order of its sides says nothing
            if let Some(before) = before.as_ref().filter(|b| sorted(b.size_mm) != sorted(size_mm)) {
                return Err(CatalogueError::OtherSize {
                    id: id.into(),
                    size_mm: before.size_mm,
                    given_mm: size_mm,
                });
            }
            let [a, b, c] = before.as_ref().map_or(size_mm, |b| b.size_mm);
            let total = before.map_or(0, |b| b.count).saturating_add(count);
            if total > MOST_BLOCKS {
                return Err(CatalogueError::Count { id: id.into(), count: total, most: MOST_BLOCKS });
            }
            t.execute(
                "INSERT OR REPLACE INTO block VALUES (?1, ?2, ?3, ?4, ?5)",
                params![id, a, b, c, total],
            )?;
            Ok(())
        })
    }

    /// Takes a kind out of the catalogue, with all of its blocks: to correct one, remove and add it.
    ///
    /// # Errors
    /// [`CatalogueError::Unknown`].
    pub fn remove(&mut self, id: &str) -> Result<StockBlock, CatalogueError> {
        self.change(|t| {
            let there = block(t, id)?.ok_or_else(|| CatalogueError::Unknown { id: id.into() })?;
            t.execute("DELETE FROM block WHERE id = ?1", [id])?;
            Ok(there)
        })
    }

    /// Every kind of block, by number. A block whose lease has ended without its program's word is counted once the next change is made.
    ///
    /// # Errors
    /// [`CatalogueError::Database`].
    pub fn list(&self) -> Result<Vec<StockBlock>, CatalogueError> {
        kinds(&self.database).map_err(|source| CatalogueError::of_database(&self.path, source))
    }

    /// Takes one block of a kind.
    ///
    /// # Errors
    /// [`CatalogueError::Unknown`], [`CatalogueError::NoneLeft`].
    pub fn take(&mut self, id: &str) -> Result<StockBlock, CatalogueError> {
        self.change(|t| take(t, id))
    }

    /// Leases the smallest block that holds a box of these sides along x, y and z; choice and taking are one step. `None`: none does.
    ///
    /// `replaces`: the kind of the block that goes back if this lease is kept; it may be that block itself.
    ///
    /// # Errors
    /// [`CatalogueError::Database`], [`CatalogueError::Lease`].
    pub fn lease_smallest(
        &mut self,
        needed_mm: [f64; 3],
        replaces: Option<&str>,
    ) -> Result<Option<Lease>, CatalogueError> {
        let path = self.path.clone();
        self.change(|t| {
            let mut blocks = kinds(t)?;
            blocks
                .iter_mut()
                .filter(|block| Some(block.id.as_str()) == replaces)
                .for_each(|block| block.count = block.count.saturating_add(1));
            let replaces = replaces.filter(|id| blocks.iter().any(|block| block.id == *id));
            let found = smallest(&blocks, needed_mm);
            found.map(|mounted| Lease::begin(t, &path, mounted, replaces)).transpose()
        })
    }

    /// Puts one block of a kind back.
    ///
    /// # Errors
    /// [`CatalogueError::Unknown`].
    pub fn put_back(&mut self, id: &str) -> Result<StockBlock, CatalogueError> {
        self.change(|t| {
            put_back(t, id)?;
            block(t, id)?.ok_or_else(|| CatalogueError::Unknown { id: id.into() })
        })
    }

    /// One change, whole or not at all; others wait until it is done.
    fn change<T>(
        &mut self,
        work: impl FnOnce(&Transaction<'_>) -> Result<T, CatalogueError>,
    ) -> Result<T, CatalogueError> {
        let path = self.path.clone();
        let changed = || -> Result<T, CatalogueError> {
            let t = self.database.transaction_with_behavior(TransactionBehavior::Immediate)?;
            t.execute_batch(LEASES)?;
            lease::sweep(&t, &path)?;
            let done = work(&t)?;
            t.commit()?;
            Ok(done)
        };
        changed().map_err(|error| error.at(&self.path))
    }
}

/// Blocks that plans hold; a block of none is one that a plan held before.
const LEASES: &str =
    "CREATE TABLE IF NOT EXISTS lease (id INTEGER PRIMARY KEY AUTOINCREMENT, block TEXT) STRICT;";

fn create(database: &Connection) -> rusqlite::Result<()> {
    database.execute_batch(
        "CREATE TABLE block (id TEXT PRIMARY KEY, a_mm REAL NOT NULL CHECK (a_mm > 0), b_mm REAL NOT NULL CHECK (b_mm > 0), \
         c_mm REAL NOT NULL CHECK (c_mm > 0), count INTEGER NOT NULL CHECK (count >= 0)) STRICT;",
    )?;
    database.pragma_update(None, "application_id", APPLICATION_ID)?;
    database.pragma_update(None, "user_version", VERSION)
}

fn kinds(database: &Connection) -> rusqlite::Result<Vec<StockBlock>> {
    let mut statement = database.prepare("SELECT id, a_mm, b_mm, c_mm, count FROM block ORDER BY id")?;
    statement.query_map([], read)?.collect()
}

fn sorted(mut size_mm: [f64; 3]) -> [f64; 3] {
    size_mm.sort_by(f64::total_cmp);
    size_mm
}

fn put_back(transaction: &Transaction<'_>, id: &str) -> Result<(), CatalogueError> {
    transaction.execute("UPDATE block SET count = count + 1 WHERE id = ?1", [id])?;
    Ok(())
}

fn block(transaction: &Transaction<'_>, id: &str) -> Result<Option<StockBlock>, CatalogueError> {
    let sql = "SELECT id, a_mm, b_mm, c_mm, count FROM block WHERE id = ?1";
    Ok(transaction.query_row(sql, [id], read).optional()?)
}

fn read(row: &rusqlite::Row<'_>) -> rusqlite::Result<StockBlock> {
    Ok(StockBlock { id: row.get(0)?, size_mm: [row.get(1)?, row.get(2)?, row.get(3)?], count: row.get(4)? })
}

fn take(transaction: &Transaction<'_>, id: &str) -> Result<StockBlock, CatalogueError> {
    let changed =
        transaction.execute("UPDATE block SET count = count - 1 WHERE id = ?1 AND count > 0", [id])?;
    match block(transaction, id)? {
        Some(block) if changed == 1 => Ok(block),
        Some(_) => Err(CatalogueError::NoneLeft { id: id.into() }),
        None => Err(CatalogueError::Unknown { id: id.into() }),
    }
}

fn check(id: &str, size_mm: [f64; 3]) -> Result<(), CatalogueError> {
    if id.trim().is_empty() || id.contains([',', '"', '\'']) || id.chars().any(char::is_control) {
        return Err(CatalogueError::Id { id: id.into() });
    }
    match size_mm.into_iter().find(|side| !(1.0..=1000.0).contains(side)) {
        Some(side_mm) => Err(CatalogueError::Size { id: id.into(), side_mm }),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests;
