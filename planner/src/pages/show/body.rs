//! The case's structures for a viewer, the places of their names, and the camera.

use bonemill_imaging::ImageError;

use super::{STRUCTURE_COLOURS, Show, Surface};

/// Distance from the scene's box to the start of the lines to names. This and the following lengths are in diagonals of the
/// box, because the camera's distance is too.
const BESIDE: f32 = 0.05;
/// Distance from one name to the next.
const BELOW: f32 = 0.05;
/// Half the width of a letter.
const HALF_LETTER: f32 = 0.005;
/// Distance from a name to the point below which it is drawn.
const ABOVE: f32 = 0.02;
/// Direction from the bone to the camera: above and in front, so that names are on the right.
const EYE_FROM: [f32; 3] = [0.1, -0.8, 0.6];
/// Distance of the camera, in diagonals of the scene's box.
const AWAY: f32 = 0.95;

/// A structure to draw.
#[derive(Debug, Clone, PartialEq)]
pub struct ShownBody {
    /// Its name.
    pub name: String,
    /// Its colour.
    pub colour: [u8; 3],
    /// Its surface, not empty.
    pub surface: Surface,
    /// The surface at the clearance kept from it.
    pub shell: Surface,
    /// Whether it is larger than the target and would hide it; then it is drawn transparent.
    pub large: bool,
    /// Position of its name, centred, in a column beside the bone.
    pub name_at: [f32; 3],
    /// A line from the name to its surface.
    pub leader: [[f32; 3]; 2],
}

impl Show<'_> {
    /// Name and colour of every structure of the case, drawn or not.
    pub fn structure_colours(&self) -> impl Iterator<Item = (&str, [u8; 3])> {
        let names = self.plan.record.case.structures.iter().map(|s| s.name.as_str());
        names.zip(STRUCTURE_COLOURS.into_iter().cycle())
    }

    /// The structures in the images, the highest first, so that the lines to names seldom cross. Empty without images.
    ///
    /// # Errors
    /// When a distance field cannot be computed.
    pub fn bodies(&self) -> Result<Vec<ShownBody>, ImageError> {
        let Some(images) = &self.images else { return Ok(Vec::new()) };
        let size = extent(&images.target(None));
        let mut bodies = Vec::new();
        for (n, (name, colour)) in self.structure_colours().enumerate() {
            let surface = images.around(n, 0.0)?;
            if !surface.is_empty() {
                let clearance_mm = self.plan.record.case.structures[n].clearance_mm;
                bodies.push(ShownBody {
                    name: name.to_owned(),
                    colour,
                    shell: images.around(n, clearance_mm)?,
                    large: extent(&surface) > size,
                    surface,
                    name_at: [0.0; 3],
                    leader: [[0.0; 3]; 2],
                });
            }
        }
        bodies.sort_by(|a, b| height(&b.surface).total_cmp(&height(&a.surface)));
        let ([x, y, z], diagonal) = self.sides();
        for (place, body) in bodies.iter_mut().enumerate() {
            let before = [x + BESIDE * diagonal, 0.5 * y, z - BELOW * diagonal * place as f32];
            let half = HALF_LETTER * diagonal * (body.name.chars().count() as f32 + 2.0);
            body.leader = [before, nearest(&body.surface, before)];
            body.name_at = [before[0] + half, before[1], before[2] + ABOVE * diagonal];
        }
        Ok(bodies)
    }

    /// Position of a camera that sees the bone, the names beside it and a part of the shaft; and the point at which it looks.
    pub fn eye(&self) -> [[f32; 3]; 2] {
        let ([x, y, z], diagonal) = self.sides();
        let middle = [0.5 * (x + 2.0 * BESIDE * diagonal), 0.5 * y, 0.5 * z];
        [std::array::from_fn(|a| middle[a] + AWAY * diagonal * EYE_FROM[a]), middle]
    }

    /// Sides of the scene's box and its diagonal, mm.
    fn sides(&self) -> ([f32; 3], f32) {
        let record = &self.plan.record;
        let spacing_mm = record.case.grid.spacing_mm as f32;
        let sides = record.frames.grid.dims.map(|voxels| voxels as f32 * spacing_mm);
        (sides, sides.iter().map(|s| s * s).sum::<f32>().sqrt())
    }
}

/// Diagonal of a surface's box, mm.
fn extent(surface: &Surface) -> f32 {
    let side = |a: usize| {
        let along = surface.vertices.iter().map(|v| v[a]);
        along.clone().fold(f32::NEG_INFINITY, f32::max) - along.fold(f32::INFINITY, f32::min)
    };
    if surface.is_empty() { 0.0 } else { (0..3).map(|a| side(a).powi(2)).sum::<f32>().sqrt() }
}

/// Mean height of a surface's vertices, mm.
fn height(surface: &Surface) -> f32 {
    surface.vertices.iter().map(|v| v[2]).sum::<f32>() / surface.vertices.len() as f32
}

/// The surface's vertex that is nearest to a point.
fn nearest(surface: &Surface, at: [f32; 3]) -> [f32; 3] {
    let apart = |v: &[f32; 3]| (0..3).map(|a| (v[a] - at[a]).powi(2)).sum::<f32>();
    surface.vertices.iter().copied().min_by(|a, b| apart(a).total_cmp(&apart(b))).unwrap_or(at)
}
