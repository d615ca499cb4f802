//! Searches along a ray for the first voxel whose removal time is late enough to block.
//!
//! A march reads the voxel of every sample; samples are one voxel apart. Positions are integers in units of 2⁻³² voxel, so
//! that a step is an addition and the voxel of a position is a shift. Blocks of voxels, each with its latest time, tell how
//! many samples can be skipped.

use nalgebra::Vector3;

use super::field::TimeField;

/// Number of bits for the fraction of a voxel.
const FRACTION: u32 = 32;
/// A block's side is 2 to this power, voxels.
const BLOCK: u32 = 3;

/// A field with the latest time in each of its blocks.
#[derive(Debug)]
pub(super) struct Marched {
    pub field: TimeField,
    blocks: [usize; 3],
    latest: Vec<f32>,
}

/// Samples along a ray through a field: the first at the start, the others one voxel apart, the last at the ray's end.
#[derive(Debug)]
pub(super) struct Ray {
    /// Number of the next sample.
    next: usize,
    /// Number of the last sample.
    last: usize,
    /// Position of the next sample along the field's axes, unless it is the last; and the step from each sample to the next.
    at: [i64; 3],
    step: [i64; 3],
    per_step: [f64; 3],
    /// Position of the last sample.
    end: [i64; 3],
}

impl Marched {
    pub(super) fn new(field: TimeField) -> Self {
        let (blocks, latest) = field.blocks(1 << BLOCK);
        Self { field, blocks, latest }
    }

    /// The ray center + t·axis (unit) for t from `from_mm` to `to_mm`; `None` if this is empty.
    pub(super) fn ray(
        &self,
        center: &Vector3<f64>,
        axis: &Vector3<f64>,
        [from_mm, to_mm]: [f64; 2],
    ) -> Option<Ray> {
        let one = (1i64 << FRACTION) as f64;
        let place = |at_mm: f64| self.field.place(&(center + axis * at_mm)).map(|at| (at * one) as i64);
        let step = self.field.turned([axis.x, axis.y, axis.z]).map(|a| (a * one) as i64);
        // also empty if one of them is NaN
        (from_mm <= to_mm).then(|| Ray {
            next: 0,
            last: ((to_mm - from_mm) / self.field.spacing_mm) as usize + 1,
            at: place(from_mm),
            step,
            // a ray that does not move along an axis never leaves a block along it
            per_step: step.map(|s| if s == 0 { f64::NEG_INFINITY } else { 1.0 / s as f64 }),
            end: place(to_mm),
        })
    }
}

impl Ray {
    /// The next sample at which the field is `index` or later: its number and the field's value there. The march continues
    /// after it.
    #[inline]
    pub(super) fn next_standing(&mut self, marched: &Marched, index: f32) -> Option<(usize, f32)> {
        let dims = marched.field.dims();
        let mut seen = usize::MAX;
        while self.next <= self.last {
            let at = if self.next == self.last { self.end } else { self.at };
            let voxel = at.map(|c| (c >> FRACTION) as usize);
            // a negative value becomes larger than every dimension
            if voxel[0] >= dims[0] || voxel[1] >= dims[1] || voxel[2] >= dims[2] {
                self.skip(1);
                continue;
            }
            let block = {
                let [i, j, k] = voxel.map(|v| v >> BLOCK);
                i + marched.blocks[0] * (j + marched.blocks[1] * k)
            };
            if block != seen {
                if marched.latest[block] < index {
                    self.skip(1 + self.within_block());
                    continue;
                }
                seen = block;
            }
            let latest = marched.field.value[voxel[0] + dims[0] * (voxel[1] + dims[1] * voxel[2])];
            let sample = self.next;
            self.skip(1);
            if latest >= index {
                return Some((sample, latest));
            }
        }
        None
    }

    /// Skips samples; the last one is skipped only if it is the next.
    #[inline]
    pub(super) fn skip(&mut self, samples: usize) {
        if self.next >= self.last {
            self.next += samples.min(1);
            return;
        }
        let samples = samples.min(self.last - self.next);
        self.next += samples;
        for a in 0..3 {
            self.at[a] += self.step[a] * samples as i64;
        }
    }

    /// A lower bound of the number of samples after the next one that lie in the same block.
    #[inline]
    fn within_block(&self) -> usize {
        let mut steps = f64::INFINITY;
        for a in 0..3 {
            let block = self.at[a] >> (FRACTION + BLOCK);
            let edge = (block + i64::from(self.step[a] > 0)) << (FRACTION + BLOCK);
            let room = (edge - self.at[a]) as f64 * self.per_step[a];
            // exactly on the edge 0·∞ is NaN, and the comparison is false
            if room < steps {
                steps = room;
            }
        }
        // a sample that lies on the edge, or nearly, is not skipped
        (steps - 1e-3).max(0.0).min(f64::from(u32::MAX)) as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(bonemill_geometry::fixed!(2000))]
        /// Samples almost on the face between two voxels may count for either.
        #[test]
        fn a_march_finds_what_looking_at_every_sample_finds(
            cubes in prop::collection::vec((prop::array::uniform3((0usize..8).prop_map(|n| 4 * n)), 1usize..9, 0.0f32..9.0), 0..25),
            is_z_first in any::<bool>(),
            center in prop::array::uniform3(-1.0f64..9.0),
            axis in prop::array::uniform3(-1.0f64..1.0),
            along in 0usize..6,
            ends in (-3.0f64..3.0, 0.0f64..12.0),
            index in 0.0f32..9.0,
            skip in 0usize..9,
        ) {
            // for axes along the field's axes, or perpendicular to one, some coordinates never change
            let axis = std::array::from_fn(|n| if along < 3 && n != along || along == n + 3 { 0.0 } else { axis[n] });
            let Some(axis) = Vector3::from(axis).try_normalize(1e-3) else { return Ok(()) };
            let dims = [43, 21, 30];
            let holds = |from: [usize; 3], side: usize, n: usize| {
                let at = [n % 43, n / 43 % 21, n / (43 * 21)];
                (0..3).all(|a| (from[a]..from[a] + side).contains(&at[a]))
            };
            let solid: Vec<(usize, f32)> = cubes
                .into_iter()
                .flat_map(|(from, side, latest)| {
                    (0..43 * 21 * 30).filter(move |n| holds(from, side, *n)).map(move |n| (n, latest))
                })
                .collect();
            let field = TimeField::of_test(dims, 0.4, is_z_first, &solid);
            let (center, to_mm) = (Vector3::from(center), ends.0 + ends.1);
            let samples = (ends.1 / 0.4) as usize + 1;
            let at = |n: usize| center + axis * (ends.0 + n as f64 * 0.4).min(to_mm);
            let is_between = |n: usize| field.place(&at(n)).iter().any(|c| (c - c.round()).abs() < 1e-6);
            let stands: Vec<usize> = (0..=samples).filter(|n| field.at(&at(*n)) >= index).collect();
            let between = (0..=samples).any(is_between);
            let marched = Marched::new(field);
            let mut ray = marched.ray(&center, &axis, [ends.0, to_mm]).unwrap();
            let (mut found, mut wanted) = (Vec::new(), Vec::new());
            while let Some((n, latest)) = ray.next_standing(&marched, index) {
                prop_assert!(latest >= index);
                found.push(n);
                ray.skip(skip);
            }
            let mut next = 0;
            for n in stands {
                if n >= next {
                    wanted.push(n);
                    next = if n + 1 == samples { samples + skip.min(1) } else { (n + 1 + skip).min(samples) };
                }
            }
            prop_assert!(between || found == wanted, "{found:?} {wanted:?}");
        }
    }

    #[test]
    fn no_ray_where_there_is_no_way() {
        let marched = Marched::new(TimeField::of_test([4, 4, 4], 0.4, true, &[]));
        for ends in [[1.0, 0.5], [f64::NAN, 1.0], [0.0, f64::NAN], [f64::INFINITY, 0.0]] {
            assert!(marched.ray(&Vector3::zeros(), &Vector3::z(), ends).is_none());
        }
    }
}
