//! The least distance of the burr from every structure, along the moves between waypoints and along the joint trajectory.
//!
//! The distance to a structure changes no faster than the burr moves. So a stretch of length L between places at distances
//! d₀ and d₁ comes no nearer than (d₀ + d₁ − L)/2. Stretches that could be nearer than the nearest place found are halved;
//! all others are skipped. The reported distance is a certain lower bound: that of the nearest place less [`TOLERANCE_MM`].

use bonemill_geometry::{Ct, Point, Rigid, Work, cancel};
use nalgebra::Vector3;
use rayon::prelude::*;

use super::boxes::Boxes;

/// The burr can be nearer than at any tested place by at most this, mm.
pub const TOLERANCE_MM: f64 = 1e-3;

/// Number of rows or moves that one task searches; fixed, so that the result does not depend on the number of threads.
const PORTION: usize = 4096;

/// The nearest place along a polyline.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nearest {
    /// Certain lower bound of the distance of the burr's centre from the structure, mm.
    pub distance_mm: f64,
    /// Index of the end of the stretch in which it lies.
    pub at: usize,
}

/// The least distance from a structure along the polyline through `points` (work); `None` without points.
pub fn nearest_along(
    boxes: &Boxes<'_>,
    ct_from_grid: &Rigid<Ct, Work>,
    points: &[Vector3<f64>],
) -> Option<Nearest> {
    // a known upper bound makes the search faster
    let distance = |p: &Vector3<f64>, at_most_mm: f64| {
        let p = *ct_from_grid * Point::<Work>::from_coords(*p);
        boxes.nearest_within(p, at_most_mm + TOLERANCE_MM).unwrap_or_else(|| boxes.nearest(p)).0
    };
    let starts: Vec<usize> = (0..points.len()).step_by(PORTION).collect();
    let portions: Vec<Nearest> = starts
        .into_par_iter()
        .filter_map(|start| {
            cancel::poll();
            // one place of overlap: the stretch between portions belongs to the later one
            let first = start.saturating_sub(1);
            let mut search = NearestSearch { distance, best: f64::INFINITY, at: start };
            let mut before: Option<(&Vector3<f64>, f64)> = None;
            let mut free_mm = 0.0; // path length since the last tested place
            let mut skipped = Vec::new();
            for (n, p) in points.iter().enumerate().take(start + PORTION).skip(first) {
                let Some((last, d_last)) = before else {
                    before = Some((p, search.ask(p, n, f64::INFINITY)));
                    continue;
                };
                let step = (p - skipped.last().copied().unwrap_or(last)).norm();
                free_mm += step;
                // no stretch since then can be nearer than the best
                if d_last - free_mm >= search.best {
                    skipped.push(p);
                    continue;
                }
                // the stretch could be nearer: it is searched from the last place whose distance is known
                let from = skipped.last().copied().unwrap_or(last);
                let d_from =
                    if skipped.is_empty() { d_last } else { search.ask(from, n - 1, d_last + free_mm) };
                let d = search.ask(p, n, d_from + step);
                search.stretch([from, p], [d_from, d], n);
                before = Some((p, d));
                skipped.clear();
                free_mm = 0.0;
            }
            search.best.is_finite().then_some(Nearest { distance_mm: search.best, at: search.at })
        })
        .collect();
    let least = portions.into_iter().reduce(|a, b| if b.distance_mm < a.distance_mm { b } else { a })?;
    Some(Nearest { distance_mm: (least.distance_mm - TOLERANCE_MM).max(0.0), at: least.at })
}

struct NearestSearch<D> {
    distance: D,
    best: f64,
    at: usize,
}

impl<D: Fn(&Vector3<f64>, f64) -> f64> NearestSearch<D> {
    /// Measures the distance of a place that is at most `at_most_mm` away.
    fn ask(&mut self, p: &Vector3<f64>, n: usize, at_most_mm: f64) -> f64 {
        let d = (self.distance)(p, at_most_mm);
        if d < self.best {
            (self.best, self.at) = (d, n);
        }
        d
    }

    /// Halves the stretch while it could come nearer; each half is half as long, so the depth is bounded.
    fn stretch(&mut self, [a, b]: [&Vector3<f64>; 2], [da, db]: [f64; 2], n: usize) {
        let length = (b - a).norm();
        if 0.5 * (da + db - length) >= self.best - TOLERANCE_MM || !length.is_finite() {
            return;
        }
        let middle = (a + b) * 0.5;
        let d = self.ask(&middle, n, da.min(db) + 0.5 * length);
        self.stretch([a, &middle], [da, d], n);
        self.stretch([&middle, b], [d, db], n);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bonemill_geometry::{Grid, Volume};

    #[test]
    fn the_nearest_place_is_that_of_a_dense_walk() {
        let grid = Grid::<Ct>::aligned([9, 9, 9], 0.5, Point::new(0.0, 0.0, 0.0)).unwrap();
        let mut labels = Volume::filled(grid, 0u16);
        for voxel in [[2, 2, 2], [3, 2, 2], [6, 7, 5]] {
            let n = labels.grid().index(voxel);
            labels.data_mut()[n] = 4;
        }
        let boxes = Boxes::new(&labels, 4).unwrap();
        let place: Rigid<Ct, Work> =
            Rigid::new(nalgebra::Rotation3::new(Vector3::new(0.1, 0.7, -0.3)), Vector3::new(0.5, -1.0, 2.0));
        for seed in 0..60usize {
            let coordinate = |n: usize| ((seed * 97 + n * 53) % 101) as f64 / 10.0 - 4.0;
            let points: Vec<_> = (0..30)
                .map(|n| Vector3::new(coordinate(n), coordinate(n + 31), coordinate(n + 77)))
                .collect();
            let found = nearest_along(&boxes, &place, &points).unwrap();
            let mut brute = f64::INFINITY;
            for pair in points.windows(2) {
                for n in 0..=4000 {
                    let p = pair[0] + (pair[1] - pair[0]) * (f64::from(n) / 4000.0);
                    brute = brute.min(boxes.distance_mm(place * Point::from_coords(p)));
                }
            }
            let error = brute - found.distance_mm;
            assert!((-1e-9..=2.0 * TOLERANCE_MM + 3e-3).contains(&error), "seed {seed}: {error}");
        }
    }
}
