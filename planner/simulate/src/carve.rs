//! Removes capsules from the lattice: D = min(D, |p − segment| − r), brick by brick, row by row.
//!
//! Only bricks that the capsule reaches are processed. A piece that continues where an earlier one ended changes nothing
//! behind its start, because there the nearest point is the start, whose ball is removed already. Bricks are independent
//! and are processed in parallel; their losses are added in a fixed order, so the result does not depend on the number of
//! threads.

use bonemill_geometry::{Point, Work};
use nalgebra::Vector3;
use rayon::prelude::*;

use super::bone::Amount;
use super::lattice::{Brick, CELLS, FAR, Lattice, SIDE, tag};

/// Distance from a brick's middle to its outermost cell centres along an axis, cells.
const HALF: f64 = 0.5 * (SIDE - 1) as f64;
/// Fewer bricks than this are processed on one thread.
const WORTH_SHARING: usize = 48;

/// A straight part of the burr's path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Piece {
    /// Where it starts.
    pub from: Point<Work>,
    /// Where it ends.
    pub to: Point<Work>,
    /// Whether the ball at its start is removed already.
    pub continues: bool,
}

/// A piece in cell coordinates.
#[derive(Debug, Clone, Copy)]
struct CellCapsule {
    start: Vector3<f64>,
    along: Vector3<f64>,
    length: f64,
    radius: f64,
    continues: bool,
}

/// A brick's number, its cells if it is stored, and the capsules near it, each as (brick, capsule).
type Task<'a> = (usize, Option<Box<Brick>>, &'a [(usize, usize)]);

/// A brick after removal.
struct Carved {
    brick: usize,
    /// `None` if the brick is completely removed.
    cells: Option<Box<Brick>>,
    changed: bool,
    lost: Amount,
}

impl<T: Copy + Into<f64> + Sync> Lattice<'_, T> {
    /// Removes the sweep of a ball from the bone, and returns the removed amount.
    pub fn remove(&mut self, pieces: &[Piece], radius_mm: f64) -> Amount {
        let radius = radius_mm / self.spacing_mm();
        let capsules: Vec<_> = pieces.iter().map(|piece| self.capsule(piece, radius)).collect();
        let mut near = Vec::new();
        for (n, capsule) in capsules.iter().enumerate() {
            self.bricks_near(capsule, |brick| near.push((brick, n)));
        }
        // D does not depend on the order of the pieces, but a fixed order gives the same sums
        near.sort_unstable();
        let work: Vec<_> = near
            .chunk_by(|a, b| a.0 == b.0)
            .filter_map(|group| {
                let brick = group.first()?.0;
                let cells = match self.looked_at(brick) {
                    tag::GONE | tag::NOTHING => return None,
                    place if place < tag::FIRST => self.stored[place as usize].take(),
                    _ => None,
                };
                Some((brick, cells, group))
            })
            .collect();
        let carve = |(brick, cells, group): Task<'_>| {
            self.carve(brick, cells, group.iter().map(|(_, n)| &capsules[*n]))
        };
        let carved: Vec<_> = if work.len() < WORTH_SHARING {
            work.into_iter().map(carve).collect()
        } else {
            work.into_par_iter().map(carve).collect()
        };
        let mut lost = Amount::default();
        for brick in carved {
            lost.merge(&brick.lost);
            self.put_back(brick);
        }
        lost
    }

    fn capsule(&self, piece: &Piece, radius: f64) -> CellCapsule {
        let (start, end) = (self.cell_of(&piece.from.coords), self.cell_of(&piece.to.coords));
        let length = (end - start).norm();
        let along = if length > 0.0 { (end - start) / length } else { Vector3::zeros() };
        CellCapsule { start, along, length, radius, continues: piece.continues && length > 0.0 }
    }

    /// Bricks in which the capsule can change a depth.
    fn bricks_near(&self, capsule: &CellCapsule, mut visit: impl FnMut(usize)) {
        let end = capsule.start + capsule.along * capsule.length;
        let reach = capsule.radius + f64::from(FAR);
        let range = |a: usize| {
            let (lo, hi) = (capsule.start[a].min(end[a]) - reach, capsule.start[a].max(end[a]) + reach);
            let side = SIDE as f64;
            let last = (hi / side).min((self.bricks[a] - 1) as f64);
            let first = (lo / side).floor().max(0.0);
            if hi < 0.0 || first > last { 0..0 } else { first as usize..last as usize + 1 }
        };
        let outer2 = (reach + HALF * 3f64.sqrt()).powi(2);
        let ahead = HALF * capsule.along.lp_norm(1);
        for k in range(2) {
            for j in range(1) {
                for i in range(0) {
                    let brick = self.brick_index([i, j, k]);
                    if matches!(self.tag(brick), tag::GONE | tag::NOTHING) {
                        continue;
                    }
                    let middle = Vector3::new(i as f64, j as f64, k as f64) * SIDE as f64;
                    let from_start = middle.add_scalar(HALF) - capsule.start;
                    let t = from_start.dot(&capsule.along);
                    let behind = capsule.continues && t + ahead <= 0.0;
                    let clamped = t.clamp(0.0, capsule.length);
                    let squared = from_start.norm_squared() + clamped * (clamped - 2.0 * t);
                    if !behind && squared < outer2 {
                        visit(brick);
                    }
                }
            }
        }
    }

    fn carve<'c>(
        &self,
        index: usize,
        cells: Option<Box<Brick>>,
        capsules: impl Iterator<Item = &'c CellCapsule>,
    ) -> Carved {
        let mut brick = cells.unwrap_or_else(|| Box::new(Brick::INTACT));
        let first = Vector3::from(self.first_cell(index).map(|c| c as f64));
        let before = brick.depth;
        let mut changed = false;
        for capsule in capsules {
            changed |= lower(&mut brick.depth, &capsule.from(&first));
        }
        let mut lost = Amount::default();
        if changed {
            let part_mm3 = self.part_mm3();
            for (n, (&old, &new)) in before.iter().zip(&brick.depth).enumerate() {
                // cells far on either side of the surface lose nothing
                if new < old && new < 0.5 && old > -1.0 {
                    let held = brick.held[n].get_or_insert_with(|| self.held(self.cell_in(index, n)));
                    let Some(kind) = held.kind else { continue };
                    let part = self.part_left(old) - self.part_left(new);
                    lost.add(kind, part * f64::from(held.parts) * part_mm3, part * held.mass_mg);
                }
            }
        }
        let gone = changed && brick.depth.iter().all(|&d| d <= -FAR);
        Carved { brick: index, cells: (!gone).then_some(brick), changed, lost }
    }

    fn put_back(&mut self, carved: Carved) {
        let Carved { brick, cells, changed, .. } = carved;
        let tag = self.tag(brick);
        let is_stored = tag < tag::FIRST;
        match cells {
            // a brick that is still intact is not stored
            Some(_) if !changed && !is_stored => {}
            Some(cells) if is_stored => self.stored[tag as usize] = Some(cells),
            Some(cells) => {
                let place = match self.vacant.pop() {
                    Some(place) => {
                        self.stored[place as usize] = Some(cells);
                        place
                    }
                    None => {
                        self.stored.push(Some(cells));
                        (self.stored.len() - 1) as u32
                    }
                };
                self.set_tag(brick, place);
            }
            None => {
                if is_stored {
                    self.vacant.push(tag);
                }
                self.set_tag(brick, tag::GONE);
            }
        }
        if changed {
            self.touch(brick);
        }
    }
}

/// A capsule relative to a brick's first cell, in single precision, because coordinates stay below a few hundred cells.
struct Local {
    start: [f32; 3],
    along: [f32; 3],
    length: f32,
    radius: f32,
    continues: bool,
}

impl CellCapsule {
    fn from(&self, first: &Vector3<f64>) -> Local {
        Local {
            start: (self.start - first).map(|v| v as f32).into(),
            along: self.along.map(|v| v as f32).into(),
            length: self.length as f32,
            radius: self.radius as f32,
            continues: self.continues,
        }
    }
}

/// Lowers the depths of a brick to those of a capsule; returns whether any changed.
fn lower(depth: &mut [f32; CELLS], capsule: &Local) -> bool {
    const X: [f32; SIDE] = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];
    let Local { start, along, length, radius, continues } = *capsule;
    let half = HALF as f32;
    let outer2 = (radius + FAR + half).powi(2);
    let inner = radius - FAR - half;
    let inner2 = if inner > 0.0 { inner * inner } else { -1.0 };
    let ahead = half * along[0].abs();
    let mut changed = false;
    for (row, cells) in depth.as_chunks_mut::<SIDE>().0.iter_mut().enumerate() {
        let (wy, wz) = ((row % SIDE) as f32 - start[1], (row / SIDE) as f32 - start[2]);
        let (side, cross) = (wy * along[1] + wz * along[2], wy * wy + wz * wz);
        // the row's middle decides whether the row can change, and whether all of it is removed
        let wx = half - start[0];
        let t = wx * along[0] + side;
        let clamped = t.max(0.0).min(length);
        let middle2 = wx * wx + cross + clamped * (clamped - 2.0 * t);
        if middle2 > outer2 || (continues && t + ahead <= 0.0) {
            continue;
        }
        let mut new = [-FAR; SIDE];
        if middle2 > inner2 {
            for l in 0..SIDE {
                let wx = X[l] - start[0];
                let t = wx * along[0] + side;
                let clamped = t.max(0.0).min(length);
                let squared = wx * wx + cross + clamped * (clamped - 2.0 * t);
                new[l] = (squared.max(0.0).sqrt() - radius).max(-FAR).min(cells[l]);
            }
        }
        let mut fell = false;
        for l in 0..SIDE {
            fell |= new[l] < cells[l];
            cells[l] = new[l].min(cells[l]);
        }
        changed |= fell;
    }
    changed
}
