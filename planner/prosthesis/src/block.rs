//! The block that a part is milled from: chosen, taken from stock, and where the part lies in it.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use bonemill_case::prosthesis::{BlockSource, ProsthesisJob};
use bonemill_catalogue::{Catalogue, CatalogueError, Mounted, StockBlock, smallest};
use bonemill_machining::Block;
use nalgebra::Vector3;

use crate::{ProsthesisError, settings};

/// A block, taken from its catalogue if there is one; it goes back when dropped, unless kept.
#[derive(Debug)]
pub struct TakenBlock {
    /// Which one, and how it is mounted.
    pub mounted: Mounted,
    /// The catalogue to which it goes back.
    catalogue: Option<PathBuf>,
    is_kept: AtomicBool,
}

impl TakenBlock {
    /// The block is used: it does not go back.
    pub fn keep(&self) {
        self.is_kept.store(true, Ordering::Relaxed);
    }

    /// Whether it was taken from a catalogue.
    pub fn is_from_catalogue(&self) -> bool {
        self.catalogue.is_some()
    }
}

impl Drop for TakenBlock {
    fn drop(&mut self) {
        if let Some(path) = self.catalogue.as_ref().filter(|_| !self.is_kept.load(Ordering::Relaxed)) {
            // a catalogue that cannot be reached any more is looked after by people
            let _ = Catalogue::open(path).and_then(|mut stock| stock.put_back(&self.mounted.id));
        }
    }
}

/// Sides that a block needs along x, y and z for a part of this size, mm: part, gaps on either side, grip below.
pub(crate) fn needed_mm(job: &ProsthesisJob, size_mm: &Vector3<f64>) -> [f64; 3] {
    let [x, y, z] = job.stock.gap_mm;
    [size_mm.x + 2.0 * x, size_mm.y + 2.0 * y, size_mm.z + 2.0 * z + job.stock.grip_mm]
}

/// Takes the smallest block that will do.
pub(crate) fn take(
    job: &ProsthesisJob,
    folder: &Path,
    size_mm: &Vector3<f64>,
) -> Result<TakenBlock, ProsthesisError> {
    let needed_mm = needed_mm(job, size_mm);
    let (mounted, there, catalogue) = match &job.stock.source {
        BlockSource::Blocks(blocks) => {
            let there: Vec<StockBlock> = blocks.iter().map(settings::stock_block).collect();
            (smallest(&there, needed_mm), there, None)
        }
        BlockSource::Catalogue(path) => {
            let path = folder.join(path);
            let (mounted, there) = from_catalogue(&path, needed_mm)
                .map_err(|source| ProsthesisError::Catalogue { path: path.clone(), source })?;
            (mounted, there, Some(path))
        }
    };
    let there = || there.iter().filter(|b| b.count > 0).map(|b| (b.id.clone(), b.size_mm)).collect();
    let mounted = mounted.ok_or_else(|| ProsthesisError::NoBlock { needed_mm, there: there() })?;
    Ok(TakenBlock { mounted, catalogue, is_kept: AtomicBool::new(false) })
}

fn from_catalogue(
    path: &Path,
    needed_mm: [f64; 3],
) -> Result<(Option<Mounted>, Vec<StockBlock>), CatalogueError> {
    let mut stock = Catalogue::open(path)?;
    let mounted = stock.take_smallest(needed_mm)?;
    Ok((mounted, stock.list()?))
}

/// Where the block lies about a part of this size around the origin: in the middle along x and y; along z the part has its gap above, the rest is below.
pub(crate) fn around(job: &ProsthesisJob, mounted: &Mounted, size_mm: &Vector3<f64>) -> Block {
    let [x, y, z] = mounted.size_mm;
    let top = size_mm.z / 2.0 + job.stock.gap_mm[2];
    Block {
        low_mm: Vector3::new(-x / 2.0, -y / 2.0, top - z),
        high_mm: Vector3::new(x / 2.0, y / 2.0, top),
        grip_mm: job.stock.grip_mm,
    }
}
