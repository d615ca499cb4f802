//! Signed distances of a solid of revolution in its half-plane, on a fine grid, so that a lattice takes it out quickly.

use bonemill_cutting::cutter::SolidOfRevolution;

/// Points of the table along a cell.
const PER_CELL: f64 = 8.0;
/// How far beyond the solid the table reaches, cells.
const BEYOND_CELLS: f64 = 3.0;
/// Most points along a side: a longer table has a coarser step.
const MOST_POINTS: f64 = 4000.0;

/// Distances over (r, z), mm; bilinear between points.
#[derive(Debug, Clone)]
pub(super) struct RadialDistances {
    values: Vec<f32>,
    count: [usize; 2],
    step_mm: f64,
    bottom_mm: f64,
    /// Where the solid ends below, where it reaches its full radius, and where it ends above.
    pub z_mm: [f64; 3],
    pub radius_mm: f64,
}

impl RadialDistances {
    pub fn new(solid: &SolidOfRevolution, cell_mm: f64) -> Self {
        let [bottom, top] = solid.z_range_mm();
        let radius_mm = solid.max_radius_mm();
        let full = solid.profile().iter().find(|p| p[1] >= radius_mm).map_or(top, |p| p[0]);
        let beyond = BEYOND_CELLS * cell_mm;
        let (width, height) = (radius_mm + beyond, top - bottom + 2.0 * beyond);
        let step_mm = (cell_mm / PER_CELL).max(width.max(height) / MOST_POINTS);
        let count = [width, height].map(|length| (length / step_mm).ceil() as usize + 2);
        let bottom_mm = bottom - beyond;
        let value = |n: usize| {
            let (i, k) = (n % count[0], n / count[0]);
            solid.signed_distance_at_mm(i as f64 * step_mm, bottom_mm + k as f64 * step_mm) as f32
        };
        let values = (0..count[0] * count[1]).map(value).collect();
        Self { values, count, step_mm, bottom_mm, z_mm: [bottom, full, top], radius_mm }
    }

    /// The distance at a radius and height over the tip, mm; far away where the table ends.
    #[inline]
    pub fn at(&self, radius_mm: f64, z_mm: f64) -> f32 {
        let (x, z) = (radius_mm / self.step_mm, (z_mm - self.bottom_mm) / self.step_mm);
        if !(x >= 0.0 && z >= 0.0) {
            return f32::INFINITY;
        }
        let (i, k) = (x as usize, z as usize);
        if i + 1 >= self.count[0] || k + 1 >= self.count[1] {
            return f32::INFINITY;
        }
        let (u, v) = ((x - i as f64) as f32, (z - k as f64) as f32);
        let row = |k: usize| {
            let [a, b] = [self.values[i + self.count[0] * k], self.values[i + 1 + self.count[0] * k]];
            a + u * (b - a)
        };
        let (low, high) = (row(k), row(k + 1));
        low + v * (high - low)
    }
}
