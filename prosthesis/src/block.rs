//! The block that a part is milled from: chosen, taken from stock, and where the part lies in it.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use crate::catalogue::{Catalogue, CatalogueError, Lease, Mounted, StockBlock, smallest};
use crate::machining::Block;
use bonemill_case::prosthesis::{BlockSource, ProsthesisJob};
use nalgebra::Vector3;

use crate::{ProsthesisError, settings};

/// A block; one from a catalogue goes back when dropped, unless kept.
#[derive(Debug)]
pub struct TakenBlock {
    /// Which one, and how it is mounted.
    pub mounted: Mounted,
    catalogue: Option<PathBuf>,
    /// Until the block is kept.
    lease: Mutex<Option<Lease>>,
}

impl TakenBlock {
    /// The block is used: it does not go back.
    ///
    /// # Errors
    /// [`ProsthesisError::Catalogue`].
    pub fn keep(&self) -> Result<(), ProsthesisError> {
        let lease = self.lease.lock().unwrap_or_else(PoisonError::into_inner).take();
        let Some((lease, path)) = lease.zip(self.catalogue.clone()) else { return Ok(()) };
        lease.keep().map_err(|source| ProsthesisError::Catalogue { path, source })
    }

    /// Whether it was taken from a catalogue.
    pub fn is_from_catalogue(&self) -> bool {
        self.catalogue.is_some()
    }
}

/// Sides that a block needs along x, y and z for a part of this size, mm: part, gaps on either side, grip below.
pub(crate) fn needed_mm(job: &ProsthesisJob, size_mm: &Vector3<f64>) -> [f64; 3] {
    let [x, y, z] = job.stock.gap_mm;
    [size_mm.x + 2.0 * x, size_mm.y + 2.0 * y, size_mm.z + 2.0 * z + job.stock.grip_mm]
}

/// Takes the smallest block that will do; `replaces`: the block of the plan that this one replaces, which is out of the catalogue.
pub(crate) fn take(
    job: &ProsthesisJob,
    folder: &Path,
    size_mm: &Vector3<f64>,
    replaces: Option<&str>,
) -> Result<TakenBlock, ProsthesisError> {
    let needed_mm = needed_mm(job, size_mm);
    let (taken, there) = match &job.stock.source {
        BlockSource::Blocks(blocks) => {
            let there: Vec<StockBlock> = blocks.iter().map(settings::stock_block).collect();
            let mounted = smallest(&there, needed_mm);
            (mounted.map(|mounted| TakenBlock { mounted, catalogue: None, lease: Mutex::default() }), there)
        }
        BlockSource::Catalogue(path) => {
            let path = folder.join(path);
            let (lease, there) = from_catalogue(&path, needed_mm, replaces)
                .map_err(|source| ProsthesisError::Catalogue { path: path.clone(), source })?;
            let taken = |lease: Lease| TakenBlock {
                mounted: lease.mounted.clone(),
                catalogue: Some(path),
                lease: Mutex::new(Some(lease)),
            };
            (lease.map(taken), there)
        }
    };
    let there = || there.iter().filter(|b| b.count > 0).map(|b| (b.id.clone(), b.size_mm)).collect();
    taken.ok_or_else(|| ProsthesisError::NoBlock { needed_mm, there: there() })
}

fn from_catalogue(
    path: &Path,
    needed_mm: [f64; 3],
    replaces: Option<&str>,
) -> Result<(Option<Lease>, Vec<StockBlock>), CatalogueError> {
    let stock = Catalogue::open(path)?;
    let lease = stock.lease_smallest(needed_mm, replaces)?;
    Ok((lease, stock.list()?))
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
