//! The voxels of one label in a window of the map, one bit each, and the boxes that make up their surface.
//!
//! For a point outside, the nearest point always lies on a voxel with an uncovered face: if it lies on an edge or corner
//! of a covered voxel, then also on a voxel with an uncovered face, because the voxels around an edge or corner join face
//! to face. So only voxels with an uncovered face are kept as boxes.

use bonemill_geometry::{Ct, Volume};
use nalgebra::Vector3;

use super::tree::Bounds;

/// The most voxels in a box of the tree. Longer boxes would make the tree's nodes too wide.
const LONGEST_BOX: usize = 8;

/// Which voxels of a window have the label.
#[derive(Debug, Clone)]
pub(super) struct Mask {
    first: [usize; 3],
    dims: [usize; 3],
    /// One bit per voxel, x-fastest; each row begins a new word.
    words: Vec<u64>,
    words_per_row: usize,
}

impl Mask {
    /// The voxels of `label` from first to last, inclusive, along each axis.
    pub fn new(labels: &Volume<u16, Ct>, label: u16, window: [[usize; 2]; 3]) -> Self {
        let first = window.map(|[lo, _]| lo);
        let dims = window.map(|[lo, hi]| hi - lo + 1);
        let words_per_row = dims[0].div_ceil(64);
        let mut words = vec![0; words_per_row * dims[1] * dims[2]];
        for (row, words) in words.chunks_exact_mut(words_per_row).enumerate() {
            let start = labels.grid().index([first[0], first[1] + row % dims[1], first[2] + row / dims[1]]);
            for (word, values) in words.iter_mut().zip(labels.data()[start..start + dims[0]].chunks(64)) {
                // most words contain no voxel of the label
                if values.contains(&label) {
                    *word = values.iter().rev().fold(0, |word, v| word << 1 | u64::from(*v == label));
                }
            }
        }
        Self { first, dims, words, words_per_row }
    }

    /// Whether a voxel of the window, counted from its first one, has the label.
    fn get(&self, [i, j, k]: [usize; 3]) -> bool {
        self.words[i / 64 + self.words_per_row * (j + self.dims[1] * k)] >> (i % 64) & 1 == 1
    }

    /// The voxels that have the label, on the map's grid, ascending in memory.
    pub fn voxels(&self) -> impl Iterator<Item = [usize; 3]> {
        let ([nx, ny, nz], [x, y, z]) = (self.dims, self.first);
        (0..nz)
            .flat_map(move |k| (0..ny).flat_map(move |j| (0..nx).map(move |i| [i, j, k])))
            .filter(|voxel| self.get(*voxel))
            .map(move |[i, j, k]| [x + i, y + j, z + k])
    }

    /// Whether a voxel of the map lies in the window and has the label.
    pub fn holds(&self, voxel: [usize; 3]) -> bool {
        let inside = (0..3).all(|a| voxel[a] >= self.first[a] && voxel[a] - self.first[a] < self.dims[a]);
        inside && self.get(std::array::from_fn(|a| voxel[a] - self.first[a]))
    }

    /// The row beside row (j, k), or an empty one beyond the window.
    fn row(&self, j: Option<usize>, k: Option<usize>) -> &[u64] {
        match (j, k) {
            (Some(j), Some(k)) if j < self.dims[1] && k < self.dims[2] => {
                let start = self.words_per_row * (j + self.dims[1] * k);
                &self.words[start..start + self.words_per_row]
            }
            _ => &[],
        }
    }

    /// Boxes of the voxels that have a face which no other voxel of the window covers, neighbours along x merged.
    pub fn surface(&self, spacing_mm: &Vector3<f64>) -> Vec<Bounds> {
        let mut boxes = Vec::new();
        for (k, j) in (0..self.dims[2]).flat_map(|k| (0..self.dims[1]).map(move |j| (k, j))) {
            let row = self.row(Some(j), Some(k));
            let beside = [
                (j.checked_sub(1), Some(k)),
                (Some(j + 1), Some(k)),
                (Some(j), k.checked_sub(1)),
                (Some(j), Some(k + 1)),
            ]
            .map(|(j, k)| self.row(j, k));
            let bit = |row: &[u64], i: usize| row.get(i / 64).is_some_and(|word| word >> (i % 64) & 1 == 1);
            let uncovered = |i: usize| {
                let covered =
                    i > 0 && bit(row, i - 1) && bit(row, i + 1) && beside.iter().all(|row| bit(row, i));
                bit(row, i) && !covered
            };
            let mut i = 0;
            while i < self.dims[0] {
                if i % 64 == 0 && row[i / 64] == 0 {
                    i += 64;
                    continue;
                }
                let length = (i..self.dims[0].min(i + LONGEST_BOX)).take_while(|i| uncovered(*i)).count();
                if length > 0 {
                    let low: [usize; 3] = [i, j, k];
                    let mm = |a: usize, n: f64| ((self.first[a] + low[a]) as f64 + n) * spacing_mm[a];
                    let high = [length as f64 - 0.5, 0.5, 0.5];
                    boxes.push(Bounds {
                        low: std::array::from_fn(|a| mm(a, -0.5)),
                        high: std::array::from_fn(|a| mm(a, high[a])),
                    });
                }
                i += length.max(1);
            }
        }
        boxes
    }
}
