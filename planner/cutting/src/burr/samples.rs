//! What one gathering keeps of the bone: samples in lanes, the merged ones and the directions that they were made of.

use std::f64::consts::PI;

use nalgebra::Vector3;

/// Samples are stored and summed in lanes of this many: a width that every SIMD set divides.
pub(super) const LANES: usize = 8;
/// Within this many cell radii of a pole of the shaft, merged samples give way to the directions they were made of.
const NEAR_POLE: f64 = 3.0;

/// The samples of one waypoint that lie in bone, in lanes of `f32`: the sum's error is that of the lattice, 1e-3, not of
/// its arithmetic, 1e-6.
#[derive(Debug, Clone, Default)]
pub struct EngagedSamples {
    /// Merged samples. Neighbours in the list are neighbours on the sphere.
    pub(super) merged: Vec<Lane>,
    /// Every direction in bone; those of `merged[i]` end before `fine[end_fine[i]]`. Empty if none are merged.
    pub(super) fine: Vec<Lane>,
    pub(super) end_fine: Vec<usize>,
    /// Samples in the last lane of each list.
    pub(super) filled: usize,
    pub(super) fine_filled: usize,
    pub(super) count: usize,
    pub(super) mrr_mm2: f64,
    pub(super) weighted_mrr_mm2: f64,
}

#[derive(Debug, Clone, Copy)]
pub(super) struct Lane {
    pub(super) normal: [[f32; LANES]; 3],
    /// w (n·v) dA/r², and E w dA/r².
    pub(super) cut: [f32; LANES],
    pub(super) edge: [f32; LANES],
    /// Square of the cell's radius, rad².
    pub(super) cell2: [f32; LANES],
    /// A shaft with (a·center)² above `near` has its pole within [`NEAR_POLE`] cells of the lane.
    pub(super) center: [f32; 3],
    pub(super) near: f32,
}

impl Lane {
    /// What stays empty weighs nothing; its cell keeps divisions finite. Near nothing.
    const EMPTY: Self = Self {
        normal: [[0.0; LANES]; 3],
        cut: [0.0; LANES],
        edge: [0.0; LANES],
        cell2: [1.0; LANES],
        center: [0.0; 3],
        near: 2.0,
    };

    fn set(&mut self, at: usize, sample: &Sample) {
        let n = sample.normal.normalize();
        for a in 0..3 {
            self.normal[a][at] = n[a] as f32;
        }
        self.cut[at] = sample.cut as f32;
        self.edge[at] = sample.edge as f32;
        self.cell2[at] = (sample.area / PI) as f32;
    }

    /// Sets the circle within which a pole is near.
    fn close(&mut self, filled: usize) {
        let n = |l: usize| Vector3::from_fn(|a, _| f64::from(self.normal[a][l]));
        let center = (0..filled).map(n).sum::<Vector3<f64>>().normalize();
        let reach = |l: usize| center.angle(&n(l)) + NEAR_POLE * f64::from(self.cell2[l]).sqrt();
        let reach = (0..filled).map(reach).fold(0.0, f64::max);
        self.center = center.map(|c| c as f32).into();
        self.near = if reach < 0.5 * PI { reach.cos().powi(2) as f32 } else { -1.0 };
    }
}

impl EngagedSamples {
    /// Samples of the sum.
    pub fn len(&self) -> usize {
        self.count
    }

    /// Whether nothing is cut.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Removal per mm of feed, mm²: everything that has weight, whatever the axis (a neck not counted).
    pub fn mrr_mm2(&self) -> f64 {
        self.mrr_mm2
    }

    /// Removal per mm of feed, mm², weighted with w.
    pub fn weighted_mrr_mm2(&self) -> f64 {
        self.weighted_mrr_mm2
    }

    /// Gives back what memory it does not use.
    pub fn shrink_to_fit(&mut self) {
        self.merged.shrink_to_fit();
        self.fine.shrink_to_fit();
        self.end_fine.shrink_to_fit();
    }

    /// Forgets the samples, and keeps their memory.
    pub fn clear(&mut self) {
        self.merged.clear();
        self.fine.clear();
        self.end_fine.clear();
        (self.filled, self.fine_filled, self.count) = (LANES, LANES, 0);
        (self.mrr_mm2, self.weighted_mrr_mm2) = (0.0, 0.0);
    }

    /// Adds a direction in bone to the lane of fine ones.
    pub(super) fn push_fine(&mut self, sample: &Sample) {
        push(&mut self.fine, &mut self.fine_filled, sample);
    }

    /// Adds a merged sample, after its fine ones.
    pub(super) fn push(&mut self, sample: &Sample) {
        push(&mut self.merged, &mut self.filled, sample);
        self.count += 1;
        if self.filled == LANES {
            self.close_lane();
        }
    }

    /// The next merged sample and the next fine one begin new lanes.
    fn close_lane(&mut self) {
        if let Some(lane) = self.merged.last_mut()
            && !self.fine.is_empty()
        {
            lane.close(self.filled);
            self.end_fine.push(self.fine.len());
            self.fine_filled = LANES;
        }
        self.filled = LANES;
    }

    pub(super) fn finish(&mut self) {
        if self.filled < LANES {
            self.close_lane();
        }
    }

    /// The fine lanes of merged lane `i`.
    pub(super) fn fine_of(&self, i: usize) -> &[Lane] {
        let start = if i == 0 { 0 } else { self.end_fine[i - 1] };
        &self.fine[start..self.end_fine[i]]
    }
}

/// Puts a sample into the last lane, of which `filled` are taken, or into a new one.
fn push(lanes: &mut Vec<Lane>, filled: &mut usize, sample: &Sample) {
    if *filled == LANES {
        lanes.push(Lane::EMPTY);
        *filled = 0;
    }
    if let Some(lane) = lanes.last_mut() {
        lane.set(*filled, sample);
        *filled += 1;
    }
}

/// A direction that lies in bone, or neighbouring ones as one.
#[derive(Default)]
pub(super) struct Sample {
    /// Sum of the normals by weight.
    pub(super) normal: Vector3<f64>,
    /// w (n·v) dA/r², E w dA/r², (n·v) dA/r², dA/r².
    pub(super) cut: f64,
    pub(super) edge: f64,
    pub(super) swept: f64,
    pub(super) area: f64,
}

impl Sample {
    #[inline]
    pub(super) fn one(n: &Vector3<f64>, w: f64, forward: f64, area: f64, edge_factor: f64) -> Self {
        let cut = w * forward * area;
        Self { normal: n * cut, cut, edge: edge_factor * w * area, swept: forward * area, area }
    }

    #[inline]
    pub(super) fn merge(&mut self, other: &Self) {
        self.normal += other.normal;
        self.cut += other.cut;
        self.edge += other.edge;
        self.swept += other.swept;
        self.area += other.area;
    }
}
