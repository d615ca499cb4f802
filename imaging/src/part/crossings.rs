//! Where a surface crosses itself: pairs of facets whose boxes meet (R*-tree), judged by exact predicates.
//!
//! Crossings no deeper than a tolerance are counted, not refused: files in single precision have them. Work is done in batches of
//! facets in a fixed order, so that a surface that lies over itself everywhere is refused early, and always at the same place.

use bonemill_geometry::cancel;
use rayon::prelude::*;
use rstar::primitives::{GeomWithData, Rectangle};
use rstar::{AABB, RTree};

use super::triangle_pair::{Triangle, depth, meet};
use super::{Facets, PartError};

/// Facets looked at in one go.
const BATCH: usize = 2048;
/// Pairs of meeting boxes per facet, on average, above which the surface is refused; a smooth mesh has some 12.
const MOST_PAIRS_PER_FACET: u64 = 500;
/// And the least number of pairs at which that is judged.
const LEAST_PAIRS: u64 = 5_000_000;

type Boxed = GeomWithData<Rectangle<[f64; 3]>, u32>;

/// What a batch found.
#[derive(Default)]
struct Found {
    pairs: u64,
    shallow: usize,
    deep: Vec<(u32, u32, f64)>,
}

impl Found {
    fn and(mut self, other: Self) -> Self {
        self.pairs += other.pairs;
        self.shallow += other.shallow;
        self.deep.extend(other.deep);
        self
    }
}

/// The number of crossings no deeper than `tolerance_mm`.
///
/// # Errors
/// [`PartError::Crossing`] for a deeper one, [`PartError::TooDense`].
pub(crate) fn shallow_crossings(facets: &Facets, tolerance_mm: f64) -> Result<usize, PartError> {
    let count = facets.triangles.len();
    let boxes: Vec<Boxed> = (0..count).into_par_iter().map(|f| boxed(facets, f)).collect();
    let tree = RTree::bulk_load(boxes);
    let (mut pairs, mut shallow) = (0, 0);
    for start in (0..count).step_by(BATCH) {
        cancel::poll();
        let batch = start..(start + BATCH).min(count);
        let found = (batch.into_par_iter().with_min_len(64))
            .map(|f| of_facet(facets, &tree, f as u32, tolerance_mm))
            .reduce(Found::default, Found::and);
        pairs += found.pairs;
        shallow += found.shallow;
        if let Some(&(f, g, depth_mm)) = found.deep.first() {
            let (first, second) = (facets.place(f as usize), facets.place(g as usize));
            return Err(PartError::Crossing { pairs: found.deep.len(), depth_mm, first, second });
        }
        if pairs > LEAST_PAIRS.max(MOST_PAIRS_PER_FACET * count as u64) {
            return Err(PartError::TooDense { pairs, place: facets.place(start) });
        }
    }
    Ok(shallow)
}

/// The facet's pairs with those of larger numbers.
fn of_facet(facets: &Facets, tree: &RTree<Boxed>, f: u32, tolerance_mm: f64) -> Found {
    let own = facets.corners(f as usize);
    let mut found = Found::default();
    for other in tree.locate_in_envelope_intersecting(&envelope(&own)).filter(|other| other.data > f) {
        found.pairs += 1;
        let corners = facets.corners(other.data as usize);
        if meet(&own, &corners) {
            let depth_mm = depth(&own, &corners);
            if depth_mm > tolerance_mm {
                found.deep.push((f, other.data, depth_mm));
            } else {
                found.shallow += 1;
            }
        }
    }
    // the tree's order is its own
    found.deep.sort_by_key(|(_, g, _)| *g);
    found
}

fn boxed(facets: &Facets, facet: usize) -> Boxed {
    let envelope = envelope(&facets.corners(facet));
    GeomWithData::new(Rectangle::from_aabb(envelope), facet as u32)
}

fn envelope([a, b, c]: &Triangle) -> AABB<[f64; 3]> {
    AABB::from_corners(a.inf(b).inf(c).into(), a.sup(b).sup(c).into())
}
