//! Phantoms: test bodies computed from a seed, with everything that a plan needs, so that planning can be tried without a
//! patient.
//!
//! [`PhantomKind::Block`] is the foam block of Dillon et al. 2016 (D), section III; [`PhantomKind::Temporal`] is a mastoid
//! with its air cells and the structures around it; [`PhantomKind::Tibia`] and [`PhantomKind::Glenoid`] are bones to be drilled
//! and reamed. A phantom consists of an image in HU, a label map on the same grid,
//! the labels' names and the text of a case file. This module writes no files.
//!
//! Invariants: the same kind and seed give the same voxels, whatever the number of threads; every seed of `block`
//! and `temporal` gives a case whose target is one piece, reaches the outside along the approach, and keeps every structure's
//! clearance; every seed of `tibia` and `glenoid` one whose channel does.
//!
//! ```
//! use bonemill_imaging::phantom::{PhantomKind, phantom};
//! let block = phantom("block".parse()?, 1);
//! assert_eq!(block.ct.grid().dims(), block.labels.grid().dims());
//! assert!(block.label_names.contains(&("target".to_string(), 20)));
//! assert!("skull".parse::<PhantomKind>().is_err());
//! # Ok::<(), bonemill_imaging::phantom::UnknownPhantom>(())
//! ```

mod block;
mod cells;
mod glenoid;
mod rng;
mod shapes;
mod temporal;
mod tibia;
mod variation;

use std::fmt;
use std::str::FromStr;

use bonemill_geometry::{Ct, Grid, Point, Volume};
use rayon::prelude::*;

pub use block::{BlockParams, NerveSide, block};
use rng::Rng;

/// Label of the bone to be removed, in every phantom.
const TARGET: u8 = 20;

/// Which phantom.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PhantomKind {
    /// D's foam block: a square pocket, round air cells, a virtual facial nerve beside it.
    Block,
    /// A procedural right mastoid: a cavity behind the ear canal, between dura, sinus, labyrinth and facial nerve.
    Temporal,
    /// A stretch of a tibia's shaft to be drilled through both cortices.
    Tibia,
    /// The head of a scapula with a glenoid to be reamed.
    Glenoid,
}

impl PhantomKind {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Block, Self::Temporal, Self::Tibia, Self::Glenoid];
}

/// There is no phantom of the given name.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("phantom '{found}': expected 'block', 'temporal', 'tibia' or 'glenoid'")]
pub struct UnknownPhantom {
    /// The name given.
    pub found: String,
}

impl fmt::Display for PhantomKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Block => "block",
            Self::Temporal => "temporal",
            Self::Tibia => "tibia",
            Self::Glenoid => "glenoid",
        })
    }
}

impl FromStr for PhantomKind {
    type Err = UnknownPhantom;

    fn from_str(name: &str) -> Result<Self, UnknownPhantom> {
        match name {
            "block" => Ok(Self::Block),
            "temporal" => Ok(Self::Temporal),
            "tibia" => Ok(Self::Tibia),
            "glenoid" => Ok(Self::Glenoid),
            _ => Err(UnknownPhantom { found: name.to_string() }),
        }
    }
}

/// A phantom in memory.
#[derive(Debug, Clone)]
pub struct Phantom {
    /// The image, HU.
    pub ct: Volume<i16, Ct>,
    /// The label map, on the image's grid; 0 where there is no label.
    pub labels: Volume<u8, Ct>,
    /// Name and value of every label: the content of `labels.json`.
    pub label_names: Vec<(String, u8)>,
    /// The case file. It names the images `ct.nii.gz` and `labels.nii.gz`.
    pub case_toml: String,
}

/// The phantom of a kind and seed. It takes 0.3 s (block) or 2 s (temporal) of processor time, shared by rayon's threads.
pub fn phantom(kind: PhantomKind, seed: u64) -> Phantom {
    match kind {
        PhantomKind::Block => block(&BlockParams::paper(), seed),
        PhantomKind::Temporal => temporal::temporal(seed),
        PhantomKind::Tibia => tibia::tibia(seed),
        PhantomKind::Glenoid => glenoid::glenoid(seed),
    }
}

/// A grid along ct's axes. The numbers are constants of this module, so an error here is a bug.
fn ct_grid(dims: [usize; 3], spacing_mm: f64, origin: Point<Ct>) -> Grid<Ct> {
    match Grid::aligned(dims, spacing_mm, origin) {
        Ok(grid) => grid,
        Err(error) => unreachable!("a phantom's grid is constant: {error}"),
    }
}

/// The image: HU plus normal noise of the given standard deviation, rounded. The noise of a voxel depends on its place in
/// memory only.
fn with_noise(hu: &Volume<f32, Ct>, sd_hu: f64, rng: &Rng) -> Volume<i16, Ct> {
    let mut ct = Volume::filled(hu.grid().clone(), 0i16);
    ct.data_mut().par_iter_mut().zip(hu.data()).enumerate().for_each(|(n, (out, &hu))| {
        // a float's cast to an integer saturates
        *out = (f64::from(hu) + sd_hu * rng.normal_at(n as u64)).round() as i16;
    });
    ct
}

/// Makes `label_names` from constants.
fn names(pairs: &[(&str, u8)]) -> Vec<(String, u8)> {
    pairs.iter().map(|&(name, value)| (name.to_string(), value)).collect()
}

#[cfg(test)]
mod tests;
