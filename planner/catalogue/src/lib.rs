//! The blocks in stock: an SQLite database that several stations share, and the choice of the smallest block that will do.
//!
//! Every change is one transaction that takes the database's write lock first, so that of two stations that want the last block
//! one gets it and the other is told that there is none ([`CatalogueError::NoneLeft`]). A station waits for the lock for at most
//! [`WAIT`]. Sizes are mm. Not here: what a part needs around it.
//!
//! ```
//! use bonemill_catalogue::{Catalogue, smallest};
//! let mut stock = Catalogue::in_memory()?;
//! stock.add("B1", [60.0, 25.0, 55.0], 2)?;
//! let mounted = smallest(&stock.list()?, [41.0, 16.0, 54.0]).expect("it fits");
//! assert_eq!((mounted.id.as_str(), mounted.size_mm), ("B1", [55.0, 25.0, 60.0]));
//! stock.take("B1")?;
//! assert_eq!(stock.list()?[0].count, 1);
//! # Ok::<(), bonemill_catalogue::CatalogueError>(())
//! ```

mod error;
mod fit;

use std::path::Path;
use std::time::Duration;

use rusqlite::{Connection, OptionalExtension, Transaction, TransactionBehavior, params};

pub use error::CatalogueError;
pub use fit::{Mounted, smallest};

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
        Self::prepared(Connection::open(path)?, path)
    }

    /// Opens a catalogue, or begins an empty one.
    ///
    /// # Errors
    /// As [`Self::open`], but for a file that does not exist.
    pub fn open_or_create(path: &Path) -> Result<Self, CatalogueError> {
        Self::prepared(Connection::open(path)?, path)
    }

    /// An empty catalogue that lasts as long as the value.
    ///
    /// # Errors
    /// [`CatalogueError::Database`].
    pub fn in_memory() -> Result<Self, CatalogueError> {
        Self::prepared(Connection::open_in_memory()?, Path::new(":memory:"))
    }

    fn prepared(mut database: Connection, path: &Path) -> Result<Self, CatalogueError> {
        database.busy_timeout(WAIT)?;
        let foreign = || CatalogueError::Foreign { path: path.into() };
        let transaction =
            database.transaction_with_behavior(TransactionBehavior::Immediate).map_err(|e| {
                if e.sqlite_error_code() == Some(rusqlite::ErrorCode::NotADatabase) {
                    foreign()
                } else {
                    e.into()
                }
            })?;
        let pragma = |name: &str| transaction.pragma_query_value(None, name, |row| row.get::<_, i32>(0));
        let tables: i32 =
            transaction.query_row("SELECT count(*) FROM sqlite_schema", [], |row| row.get(0))?;
        match (pragma("application_id")?, pragma("user_version")?) {
            (APPLICATION_ID, VERSION) => {}
            (0, 0) if tables == 0 => create(&transaction)?,
            _ => return Err(foreign()),
        }
        transaction.commit()?;
        Ok(Self { database })
    }

    /// Adds blocks of a kind; the sizes of a kind that is there already must be the same.
    ///
    /// # Errors
    /// [`CatalogueError::Id`], [`CatalogueError::Size`], [`CatalogueError::Count`], [`CatalogueError::OtherSize`].
    pub fn add(&mut self, id: &str, size_mm: [f64; 3], count: u32) -> Result<(), CatalogueError> {
        check(id, size_mm)?;
        self.change(|t| {
            let before = block(t, id)?;
            if let Some(before) = before.as_ref().filter(|b| b.size_mm != size_mm) {
                return Err(CatalogueError::OtherSize {
                    id: id.into(),
                    size_mm: before.size_mm,
                    given_mm: size_mm,
                });
            }
            let total = before.map_or(0, |b| b.count).saturating_add(count);
            if total > MOST_BLOCKS {
                return Err(CatalogueError::Count { id: id.into(), count: total, most: MOST_BLOCKS });
            }
            let [a, b, c] = size_mm;
            t.execute(
                "INSERT OR REPLACE INTO block VALUES (?1, ?2, ?3, ?4, ?5)",
                params![id, a, b, c, total],
            )?;
            Ok(())
        })
    }

    /// Every kind of block, by number.
    ///
    /// # Errors
    /// [`CatalogueError::Database`].
    pub fn list(&self) -> Result<Vec<StockBlock>, CatalogueError> {
        let mut statement =
            self.database.prepare("SELECT id, a_mm, b_mm, c_mm, count FROM block ORDER BY id")?;
        let rows = statement.query_map([], read)?;
        Ok(rows.collect::<Result<_, _>>()?)
    }

    /// Takes one block of a kind.
    ///
    /// # Errors
    /// [`CatalogueError::Unknown`], [`CatalogueError::NoneLeft`].
    pub fn take(&mut self, id: &str) -> Result<StockBlock, CatalogueError> {
        self.change(|t| take(t, id))
    }

    /// Takes the smallest block that holds a box of these sides along x, y and z; choice and taking are one step. `None`: none does.
    ///
    /// # Errors
    /// [`CatalogueError::Database`].
    pub fn take_smallest(&mut self, needed_mm: [f64; 3]) -> Result<Option<Mounted>, CatalogueError> {
        self.change(|t| {
            let mut statement = t.prepare("SELECT id, a_mm, b_mm, c_mm, count FROM block ORDER BY id")?;
            let blocks: Vec<StockBlock> = statement.query_map([], read)?.collect::<Result<_, _>>()?;
            let found = smallest(&blocks, needed_mm);
            if let Some(mounted) = &found {
                take(t, &mounted.id)?;
            }
            Ok(found)
        })
    }

    /// Puts one block of a kind back.
    ///
    /// # Errors
    /// [`CatalogueError::Unknown`].
    pub fn put_back(&mut self, id: &str) -> Result<StockBlock, CatalogueError> {
        self.change(|t| {
            t.execute("UPDATE block SET count = count + 1 WHERE id = ?1", [id])?;
            block(t, id)?.ok_or_else(|| CatalogueError::Unknown { id: id.into() })
        })
    }

    /// One change, whole or not at all; others wait until it is done.
    fn change<T>(
        &mut self,
        work: impl FnOnce(&Transaction<'_>) -> Result<T, CatalogueError>,
    ) -> Result<T, CatalogueError> {
        let transaction = self.database.transaction_with_behavior(TransactionBehavior::Immediate)?;
        let done = work(&transaction)?;
        transaction.commit()?;
        Ok(done)
    }
}

fn create(transaction: &Transaction<'_>) -> Result<(), CatalogueError> {
    transaction.execute_batch(
        "CREATE TABLE block (id TEXT PRIMARY KEY, a_mm REAL NOT NULL CHECK (a_mm > 0), b_mm REAL NOT NULL CHECK (b_mm > 0), \
         c_mm REAL NOT NULL CHECK (c_mm > 0), count INTEGER NOT NULL CHECK (count >= 0)) STRICT;",
    )?;
    transaction.pragma_update(None, "application_id", APPLICATION_ID)?;
    transaction.pragma_update(None, "user_version", VERSION)?;
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
