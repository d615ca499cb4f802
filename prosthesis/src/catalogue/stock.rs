//! What the file of a catalogue holds, and its changes.

use std::ffi::OsStr;
use std::fs::File;
use std::io::Read as _;
use std::path::Path;

use bonemill_planfile::replace;
use serde::{Deserialize, Serialize};

use super::CatalogueError;

/// The file's version.
const VERSION: u32 = 1;
/// Most blocks of a kind.
const MOST_BLOCKS: u32 = 1_000_000;
/// No catalogue is longer.
const MOST_BYTES: u64 = 16 << 20;
const HEAD: &str =
    "# Blocks in stock: changed by `bonemill stock`, and by plans that hold a block (lease).\n";

/// A kind of block.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StockBlock {
    /// Its number.
    pub id: String,
    /// Its three sides as they were entered, mm.
    pub size_mm: [f64; 3],
    /// How many there are.
    pub count: u32,
}

/// A block that a plan holds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LeaseEntry {
    /// The end of the name of the file that its holder locks.
    pub holder: String,
    /// The block's kind; none where the plan that is replaced holds it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub block: Option<String>,
}

/// The file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stock {
    version: u32,
    /// By number.
    #[serde(default, rename = "block", skip_serializing_if = "Vec::is_empty")]
    pub blocks: Vec<StockBlock>,
    #[serde(default, rename = "lease", skip_serializing_if = "Vec::is_empty")]
    pub leases: Vec<LeaseEntry>,
}

impl Default for Stock {
    fn default() -> Self {
        Self { version: VERSION, blocks: Vec::new(), leases: Vec::new() }
    }
}

impl Stock {
    /// Reads a catalogue's file.
    ///
    /// # Errors
    /// [`CatalogueError::Missing`], [`CatalogueError::Foreign`], [`CatalogueError::File`].
    pub fn read(path: &Path) -> Result<Self, CatalogueError> {
        let foreign = |why: String| CatalogueError::Foreign { path: path.into(), why };
        let file = File::open(path).map_err(|source| match source.kind() {
            std::io::ErrorKind::NotFound => CatalogueError::Missing { path: path.into() },
            _ => CatalogueError::File { path: path.into(), source },
        })?;
        let mut bytes = Vec::new();
        file.take(MOST_BYTES + 1).read_to_end(&mut bytes).map_err(CatalogueError::of_file(path))?;
        if bytes.len() as u64 > MOST_BYTES {
            return Err(foreign(format!("it has more than {MOST_BYTES} bytes")));
        }
        let text = str::from_utf8(&bytes).map_err(|_| foreign("it is no text".into()))?;
        let mut stock: Self = toml::from_str(text).map_err(|error| {
            let line =
                error.span().map_or(0, |span| bytes[..span.start].iter().filter(|b| **b == b'\n').count())
                    + 1;
            foreign(format!("line {line}: {}", error.message().replace('\n', ", ")))
        })?;
        if stock.version != VERSION {
            return Err(foreign(format!("its version is {}, expected {VERSION}", stock.version)));
        }
        stock.blocks.iter().try_for_each(check).map_err(|fault| foreign(fault.to_string()))?;
        stock.blocks.sort_by(|a, b| a.id.cmp(&b.id));
        if let Some(pair) = stock.blocks.windows(2).find(|pair| pair[0].id == pair[1].id) {
            return Err(foreign(format!("block {} is there twice", pair[0].id)));
        }
        Ok(stock)
    }

    /// Writes it, whole or not at all. The catalogue must be locked.
    ///
    /// # Errors
    /// [`CatalogueError::Write`].
    pub fn write(&self, path: &Path) -> Result<(), CatalogueError> {
        let text =
            toml::to_string(self).map_err(std::io::Error::other).map_err(CatalogueError::of_file(path))?;
        let dir = path.parent().filter(|dir| !dir.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let name = path.file_name().and_then(OsStr::to_str).ok_or_else(|| CatalogueError::File {
            path: path.into(),
            source: std::io::ErrorKind::InvalidFilename.into(),
        })?;
        Ok(replace(dir, name, format!("{HEAD}{text}").as_bytes())?)
    }

    /// Adds blocks.
    ///
    /// # Errors
    /// [`CatalogueError::Id`], [`CatalogueError::Size`], [`CatalogueError::Count`], [`CatalogueError::OtherSize`].
    pub fn add(&mut self, added: StockBlock) -> Result<(), CatalogueError> {
        let place = self.blocks.partition_point(|block| block.id < added.id);
        match self.blocks.get_mut(place).filter(|block| block.id == added.id) {
            // a block is turned as it is needed: the order of its sides says nothing
            Some(there) if sorted(there.size_mm) != sorted(added.size_mm) => {
                let StockBlock { id, size_mm: given_mm, .. } = added;
                Err(CatalogueError::OtherSize { id, size_mm: there.size_mm, given_mm })
            }
            Some(there) => add_to(there, added.count),
            None => {
                check(&added)?;
                self.blocks.insert(place, added);
                Ok(())
            }
        }
    }

    /// Takes a kind out.
    ///
    /// # Errors
    /// [`CatalogueError::Unknown`].
    pub fn remove(&mut self, id: &str) -> Result<StockBlock, CatalogueError> {
        let place = self.blocks.iter().position(|block| block.id == id);
        place.map(|place| self.blocks.remove(place)).ok_or_else(|| CatalogueError::Unknown { id: id.into() })
    }

    /// Takes one block.
    ///
    /// # Errors
    /// [`CatalogueError::Unknown`], [`CatalogueError::NoneLeft`].
    pub fn take(&mut self, id: &str) -> Result<StockBlock, CatalogueError> {
        let block = self.block(id)?;
        block.count = block.count.checked_sub(1).ok_or_else(|| CatalogueError::NoneLeft { id: id.into() })?;
        Ok(block.clone())
    }

    /// Puts one block back.
    ///
    /// # Errors
    /// [`CatalogueError::Unknown`], [`CatalogueError::Count`].
    pub fn put_back(&mut self, id: &str) -> Result<StockBlock, CatalogueError> {
        let block = self.block(id)?;
        add_to(block, 1)?;
        Ok(block.clone())
    }

    fn block(&mut self, id: &str) -> Result<&mut StockBlock, CatalogueError> {
        let found = self.blocks.iter_mut().find(|block| block.id == id);
        found.ok_or_else(|| CatalogueError::Unknown { id: id.into() })
    }
}

fn add_to(block: &mut StockBlock, count: u32) -> Result<(), CatalogueError> {
    let more = StockBlock { count: block.count.saturating_add(count), ..block.clone() };
    check(&more)?;
    *block = more;
    Ok(())
}

fn check(block: &StockBlock) -> Result<(), CatalogueError> {
    let StockBlock { id, size_mm, count } = block;
    if id.trim().is_empty() || id.contains([',', '"', '\'']) || id.chars().any(char::is_control) {
        return Err(CatalogueError::Id { id: id.clone() });
    }
    if let Some(side_mm) = size_mm.iter().copied().find(|side| !(1.0..=1000.0).contains(side)) {
        return Err(CatalogueError::Size { id: id.clone(), side_mm });
    }
    if *count > MOST_BLOCKS {
        return Err(CatalogueError::Count { id: id.clone(), count: *count, most: MOST_BLOCKS });
    }
    Ok(())
}

fn sorted(mut size_mm: [f64; 3]) -> [f64; 3] {
    size_mm.sort_by(f64::total_cmp);
    size_mm
}
