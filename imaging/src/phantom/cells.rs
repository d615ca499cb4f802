//! Pneumatised bone: air cells are rounded Voronoi cells, and their walls (septa) are thin plates between them.
//!
//! Seed points are placed at random, no nearer to each other than a spacing that depends on the place. A share of the
//! walls is left out, so that neighbours merge into the irregular, communicating cells of a mastoid.

use super::rng::Rng;
use super::shapes::V3;

/// Half of a septum's thickness, mm: septa are 0.3 to 0.6 mm thick.
const HALF_SEPTUM_MM: [f64; 2] = [0.15, 0.30];
/// Share of the walls that is left out.
const OPEN_WALLS: f64 = 0.2;
/// Radius to which a cell's edges are rounded, mm.
const ROUNDING_MM: f64 = 0.8;

/// Air cells by their seeds.
#[derive(Debug)]
pub(super) struct AirCells {
    seeds: Vec<V3>,
    rng: Rng,
}

impl AirCells {
    /// Places seed points at random in the box `lo..hi`. A point is kept where `spacing_mm` gives a spacing and no other seed
    /// is nearer than that.
    pub(super) fn scatter(
        (lo, hi): (V3, V3),
        throws: usize,
        mut rng: Rng,
        spacing_mm: impl Fn(&V3) -> Option<f64>,
    ) -> Self {
        let mut seeds: Vec<V3> = Vec::new();
        for _ in 0..throws {
            let p = V3::from_fn(|a, _| rng.range(lo[a], hi[a]));
            let Some(spacing) = spacing_mm(&p) else { continue };
            let square = spacing * spacing;
            if seeds.iter().all(|s| (s - p).norm_squared() >= square) {
                seeds.push(p);
            }
        }
        Self { seeds, rng }
    }

    /// The cells that shape the bone within `radius_mm` of `center`.
    pub(super) fn near(&self, center: &V3, radius_mm: f64) -> LocalCells<'_> {
        let distance = |n: usize| (self.seeds[n] - center).norm();
        let nearest = (0..self.seeds.len()).map(distance).fold(f64::INFINITY, f64::min);
        // the wall to a seed that is d farther than the nearest seed is at least d/2 away
        let reach = nearest + 2.0 * (radius_mm + ROUNDING_MM + HALF_SEPTUM_MM[1]);
        let seeds =
            (0..self.seeds.len()).filter(|&n| distance(n) <= reach).map(|n| (n, self.seeds[n])).collect();
        LocalCells { cells: self, seeds }
    }

    /// Half the thickness of the wall between two cells, mm; `None` where it is left out.
    fn half_septum_mm(&self, a: usize, b: usize) -> Option<f64> {
        let (lo, hi) = (a.min(b) as u64, a.max(b) as u64);
        let pair = 2 * (hi * (hi - 1) / 2 + lo);
        // counters far above those that `scatter` uses
        let draw = |n: u64| self.rng.unit_at((1 << 40) + n);
        let [thin, thick] = HALF_SEPTUM_MM;
        (draw(pair) >= OPEN_WALLS).then(|| thin + (thick - thin) * draw(pair + 1))
    }
}

/// The cells around one place.
#[derive(Debug)]
pub(super) struct LocalCells<'a> {
    cells: &'a AirCells,
    /// Number and position of each seed.
    seeds: Vec<(usize, V3)>,
}

impl LocalCells<'_> {
    /// Signed distance to the nearest wall or to the edge of the pneumatised region, mm: negative inside a cell, positive in
    /// a septum or outside the region. `bound_mm` is the signed distance of the region. Valid within the radius given to
    /// [`AirCells::near`].
    pub(super) fn distance(&self, p: &V3, bound_mm: f64) -> f64 {
        let squares = self.seeds.iter().map(|(_, seed)| (seed - p).norm_squared());
        let nearest = squares.enumerate().min_by(|a, b| a.1.total_cmp(&b.1));
        let Some((own, own_square)) = nearest else { return f64::INFINITY };
        let (own_number, own_seed) = self.seeds[own];
        // as rounded_intersection of all walls, but without storing them in a list
        let (mut deepest, mut sum) = (bound_mm, (bound_mm + ROUNDING_MM).max(0.0).powi(2));
        for (_, &(number, seed)) in self.seeds.iter().enumerate().filter(|(n, _)| *n != own) {
            let bisector = 0.5 * ((seed - p).norm_squared() - own_square) / (seed - own_seed).norm();
            if bisector > ROUNDING_MM + HALF_SEPTUM_MM[1] {
                continue;
            }
            let Some(half) = self.cells.half_septum_mm(own_number, number) else { continue };
            let wall = half - bisector;
            deepest = deepest.max(wall);
            sum += (wall + ROUNDING_MM).max(0.0).powi(2);
        }
        deepest.min(-ROUNDING_MM) + sum.sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cells() -> AirCells {
        let bounds = (V3::repeat(-8.0), V3::repeat(8.0));
        AirCells::scatter(bounds, 4000, Rng::new(3, 0), |p| (p.norm() < 8.0).then_some(3.0))
    }

    #[test]
    fn seeds_keep_their_spacing_and_fill_the_region() {
        let cells = cells();
        for (n, a) in cells.seeds.iter().enumerate() {
            assert!(a.norm() < 8.0 && cells.seeds[..n].iter().all(|b| (a - b).norm() >= 3.0));
        }
        assert!(cells.seeds.len() > 60, "{}", cells.seeds.len());
    }

    #[test]
    fn the_local_cells_give_the_same_as_all_cells() {
        let cells = cells();
        let mut rng = Rng::new(9, 9);
        let (mut air, mut septum) = (0, 0);
        for _ in 0..400 {
            let center = V3::from_fn(|_, _| rng.range(-4.0, 4.0));
            let p = center + V3::from_fn(|_, _| rng.range(-0.5, 0.5));
            let local = cells.near(&center, 0.87).distance(&p, -9.0);
            assert_eq!(local, cells.near(&center, 99.0).distance(&p, -9.0));
            if local < 0.0 { air += 1 } else { septum += 1 }
        }
        assert!(air > 200 && septum > 20, "{air} in air, {septum} in septa");
    }

    #[test]
    fn the_bound_closes_a_cell() {
        let cells = cells();
        let local = cells.near(&cells.seeds[0], 0.5);
        assert!(local.distance(&cells.seeds[0], -9.0) < 0.0);
        assert!(local.distance(&cells.seeds[0], 0.4) > 0.0);
    }
}
