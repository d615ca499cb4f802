//! Facets to a solid: checked, repaired where there is no doubt, else refused with the place.

use bonemill_geometry::{Mesh, Part, Point};

use super::crossings::shallow_crossings;
use super::edges::Edges;
use super::unit::plausible_unit;
use super::{Change, Facets, LengthUnit, PartError, holes, pieces, pinches, turn, weld};

/// How deep two facets may cross before the surface is refused, mm: a tenth of what a machined surface may be off.
pub const CROSSING_TOLERANCE_MM: f64 = 0.002;

/// What is repaired without asking; the defaults are assumed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RepairLimits {
    /// Vertices of open edges at most so far apart become one, mm.
    pub weld_mm: f64,
    /// The longest way around a hole that is filled, mm.
    pub hole_perimeter_mm: f64,
    /// Separate pieces with at most this share of the largest one's area are dropped.
    pub debris_share: f64,
}

impl Default for RepairLimits {
    fn default() -> Self {
        Self { weld_mm: 0.01, hole_perimeter_mm: 10.0, debris_share: 0.01 }
    }
}

/// A closed, manifold surface in one piece, facing outwards.
#[derive(Debug, Clone, PartialEq)]
pub struct Solid {
    /// The surface, mm.
    pub mesh: Mesh<Part>,
    /// What was repaired, in order.
    pub changes: Vec<Change>,
    /// Unit of the file's coordinates.
    pub unit: LengthUnit,
    /// Pairs of facets that touch or cross, no deeper than [`CROSSING_TOLERANCE_MM`].
    pub shallow_crossings: usize,
}

impl Solid {
    /// Checks and repairs facets; `unit` is that of their coordinates, `None`: mm if that is plausible.
    ///
    /// # Errors
    /// [`PartError`] with the place of what cannot be repaired.
    pub fn from_facets(
        mut facets: Facets,
        unit: Option<LengthUnit>,
        limits: &RepairLimits,
    ) -> Result<Self, PartError> {
        facets.check()?;
        let unit = plausible_unit(facets.length(), unit)?;
        facets.vertices.iter_mut().for_each(|v| *v *= unit.mm());
        let mut changes = Vec::new();
        weld::weld_equal(&mut facets);
        clean(&mut facets, &mut changes);
        let edges = close(&mut facets, &mut changes, limits)?;
        let doubled = pinches::open_pinches(&mut facets, &edges);
        if doubled > 0 {
            changes.push(Change::PinchesOpened { vertices: doubled });
        }
        let shallow_crossings = shallow_crossings(&facets, CROSSING_TOLERANCE_MM)?;
        facets.drop_unused_vertices();
        let mesh = Mesh {
            vertices: facets.vertices.into_iter().map(Point::from_coords).collect(),
            triangles: facets.triangles,
        };
        let volume_mm3 = mesh.volume_mm3();
        if volume_mm3 <= 0.0 {
            return Err(PartError::NoVolume { volume_mm3 });
        }
        Ok(Self { mesh, changes, unit, shallow_crossings })
    }
}

/// Takes out facets that bound nothing.
fn clean(facets: &mut Facets, changes: &mut Vec<Change>) {
    let corners = facets.triangles.clone();
    let degenerate = facets.retain(|f| {
        let [a, b, c] = corners[f];
        a != b && b != c && c != a
    });
    if degenerate > 0 {
        changes.push(Change::DegenerateDropped { facets: degenerate });
    }
    let repeated = drop_repeated(facets);
    if repeated > 0 {
        changes.push(Change::DuplicatesDropped { facets: repeated });
    }
}

/// Keeps one of facets on the same three vertices, or none where two face each other: they bound nothing.
fn drop_repeated(facets: &mut Facets) -> usize {
    let key = |f: usize| {
        let mut sorted = facets.triangles[f];
        sorted.sort_unstable();
        sorted
    };
    let mut order: Vec<([u32; 3], usize)> = (0..facets.triangles.len()).map(|f| (key(f), f)).collect();
    order.sort_unstable();
    let mut is_kept = vec![true; order.len()];
    for group in order.chunk_by(|a, b| a.0 == b.0).filter(|group| group.len() > 1) {
        let senses = group.iter().map(|(_, f)| sense(facets.triangles[*f]));
        let faces_both_ways = senses.sum::<i64>().unsigned_abs() < group.len() as u64;
        for (_, f) in &group[usize::from(!faces_both_ways)..] {
            is_kept[*f] = false;
        }
    }
    facets.retain(|f| is_kept[f])
}

/// +1 or −1: the order of a triangle's vertices, up to rotation.
fn sense([a, b, c]: [u32; 3]) -> i64 {
    let inversions = [a > b, b > c, a > c].iter().filter(|v| **v).count();
    if inversions % 2 == 0 { 1 } else { -1 }
}

/// Makes one closed surface that faces outwards.
fn close(facets: &mut Facets, changes: &mut Vec<Change>, limits: &RepairLimits) -> Result<Edges, PartError> {
    let mut edges = Edges::of(facets);
    if edges.open().next().is_some() {
        let (vertices, largest_move_mm) = weld::weld_open(facets, &edges, limits.weld_mm);
        if vertices > 0 {
            changes.push(Change::Welded { vertices, largest_move_mm });
            clean(facets, changes);
            edges = Edges::of(facets);
        }
    }
    if let Some(debris) = pieces::drop_debris(facets, &edges, limits.debris_share) {
        changes.push(debris);
        edges = Edges::of(facets);
    }
    if facets.triangles.is_empty() {
        return Err(PartError::Empty);
    }
    if let Some(&first) = edges.crowded().first() {
        return Err(PartError::NonManifold {
            edges: edges.crowded().len(),
            place: facets.place(first as usize / 3),
        });
    }
    pieces::refuse_several(facets, &edges)?;
    let turned = turn::turn_outwards(facets, &edges)?;
    if turned > 0 {
        changes.push(Change::Turned { facets: turned, of: facets.triangles.len() });
        edges = Edges::of(facets);
    }
    if let Some(filled) = holes::fill(facets, &edges, limits.hole_perimeter_mm)? {
        changes.push(filled);
        edges = Edges::of(facets);
    }
    // a filling may meet another one
    match edges.crowded().first() {
        Some(&first) => Err(PartError::NonManifold {
            edges: edges.crowded().len(),
            place: facets.place(first as usize / 3),
        }),
        None => Ok(edges),
    }
}

#[cfg(test)]
#[path = "solid_tests.rs"]
mod tests;
