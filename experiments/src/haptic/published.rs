//! The two published engines on a point shell and a voxmap: Faieghi et al.'s, and Zheng et al.'s as they describe it.
//!
//! Every point of the shell is turned and moved into the voxmap. A point in an occupied voxel takes it; a point on an edge with an
//! occupied voxel in front of it, one voxel down the feed, feels its element's force, which is computed then and there, as published.
//! Forces are read before bone is taken, so that a step does not depend on the order of the points. Sums are of whole numbers of
//! 2⁻³² N and N mm: no order and no number of threads changes them, and a shell whose forces could overflow them is refused.
//!
//! Departure: the source lowers a voxel's density step by step until it is void and does not say by how much; here it is void once a
//! point is in it, and edges feel the voxel in front instead.

use bonemill_planner::edge::element_force;
use nalgebra::{Rotation3, Vector3};
use rayon::prelude::*;

use super::morton;
use super::shell::{PointBlock, PointShell};
use super::voxmap::Voxmap;

/// Units of the sums in a N.
const UNITS: f64 = 4_294_967_296.0;

/// What a shell's edges feel.
#[derive(Debug, Clone, Copy)]
pub struct EdgeForce {
    /// mm a revolution.
    pub feed_mm_rev: f64,
    /// k_c, N/mm², and k_f.
    pub k: [f64; 2],
}

/// Where the tool is.
#[derive(Debug, Clone, Copy)]
pub struct DrillPlace {
    /// Its tip, mm.
    pub tip_mm: Vector3<f64>,
    /// How far it has turned, rad.
    pub turn_rad: f64,
}

/// Forces that could overflow the sums.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("the shell's forces may add up to {most_n} N or N mm: expected less than {limit_n}")]
pub struct Overflow {
    most_n: f64,
    limit_n: f64,
}

/// A shell in a voxmap.
pub struct Published<'a> {
    shell: &'a PointShell,
    voxmap: &'a Voxmap,
    force: EdgeForce,
}

impl<'a> Published<'a> {
    /// # Errors
    /// [`Overflow`] when all elements together could leave the range of the sums.
    pub fn new(shell: &'a PointShell, voxmap: &'a Voxmap, force: EdgeForce) -> Result<Self, Overflow> {
        let each = shell
            .edges
            .iter()
            .map(|(_, e)| element_force(e, force.feed_mm_rev, force.k).norm() * e.radius_mm.max(1.0));
        let (most_n, limit_n) = (each.sum::<f64>(), i64::MAX as f64 / UNITS / 2.0);
        // false for NaN, too
        if most_n < limit_n { Ok(Self { shell, voxmap, force }) } else { Err(Overflow { most_n, limit_n }) }
    }

    /// Thrust, N, and torque, N mm, at a place; the bone there is gone. Points outside the bone are left out block by block.
    pub fn step(&self, place: &DrillPlace) -> [f64; 2] {
        let turn = turn(place);
        let near: Vec<&PointBlock> = self
            .shell
            .blocks
            .iter()
            .filter(|b| {
                self.voxmap
                    .touches_ball(&(turn * b.center_mm + place.tip_mm), b.radius_mm + self.shell.spacing_mm)
            })
            .collect();
        let met: Vec<([i64; 2], Vec<usize>)> = near
            .par_iter()
            .map(|block| {
                let (mut sums, mut taken) = ([0; 2], Vec::new());
                for &code in &self.shell.codes[block.first..block.last] {
                    let (felt, hit) = self.meet(code, &turn, &place.tip_mm);
                    sums = [sums[0] + felt[0], sums[1] + felt[1]];
                    taken.extend(hit);
                }
                (sums, taken)
            })
            .collect();
        met.par_iter().for_each(|(_, taken)| taken.iter().for_each(|place| self.voxmap.clear(*place)));
        in_newtons(met.iter().map(|(sums, _)| *sums))
    }

    /// The same by Zheng et al.'s scheme: every point, its force stored, then a reduction over all that is stored.
    pub fn step_stored(
        &self,
        place: &DrillPlace,
        stored: &mut Vec<[i64; 2]>,
        hits: &mut Vec<Option<usize>>,
    ) -> [f64; 2] {
        let turn = turn(place);
        let met = |code: &u64| self.meet(*code, &turn, &place.tip_mm);
        self.shell.codes.par_iter().map(met).unzip_into_vecs(stored, hits);
        hits.par_iter().flatten().for_each(|place| self.voxmap.clear(*place));
        let sum = stored.par_iter().copied().reduce(|| [0; 2], |a, b| [a[0] + b[0], a[1] + b[1]]);
        in_newtons([sum].into_iter())
    }

    /// What a point feels, and the voxel that it takes.
    #[inline]
    fn meet(&self, code: u64, turn: &Rotation3<f64>, tip_mm: &Vector3<f64>) -> ([i64; 2], Option<usize>) {
        let p = turn * self.shell.center_mm(code) + tip_mm;
        let hit = self.voxmap.place(&p).filter(|place| self.voxmap.is_bone(*place));
        if !morton::is_on_edge(code) {
            return ([0; 2], hit);
        }
        let front = p - Vector3::z() * self.voxmap.spacing_mm;
        let engaged = self.voxmap.place(&front).is_some_and(|place| self.voxmap.is_bone(place));
        let Some(element) = self.shell.element(code).filter(|_| engaged) else { return ([0; 2], hit) };
        let force = element_force(element, self.force.feed_mm_rev, self.force.k);
        let felt = [force.z, -element.radius_mm * force.y].map(|v| (v * UNITS).round() as i64);
        (felt, hit)
    }
}

fn turn(place: &DrillPlace) -> Rotation3<f64> {
    Rotation3::from_axis_angle(&Vector3::z_axis(), place.turn_rad)
}

fn in_newtons(sums: impl Iterator<Item = [i64; 2]>) -> [f64; 2] {
    let sum = sums.fold([0i64; 2], |a, b| [a[0] + b[0], a[1] + b[1]]);
    sum.map(|v| v as f64 / UNITS)
}
