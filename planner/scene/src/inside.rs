//! Which places are target: a label's voxels, or in a shape the bone and the air that it encloses.

use bonemill_geometry::{Ct, Grid, Point, Rigid, Volume, Work};
use bonemill_imaging::AIR_HU;
use bonemill_imaging::{distance_within, resample_hu};
use nalgebra::Vector3;

use super::{SceneError, SceneSpec, Target};

/// Radius of the closing that decides which air a geometric target encloses, mm.
const CLOSING_MM: f64 = 4.0;
/// The closing's grid is no finer than this, mm: finer ones differ from each other by about as much.
const FINEST_CLOSING_MM: f64 = 0.25;

/// Tells target from what is not.
#[derive(Debug)]
#[allow(clippy::large_enum_variant, reason = "there is one a scene")]
pub(super) enum Inside {
    /// Every voxel of this label.
    Label(u16),
    /// Bone and enclosed air in a shape, outside structures.
    Shape {
        shape: Target<u16>,
        /// Labels of the structures.
        kept: Vec<u16>,
        bone_hu: f64,
        /// Bone, closed, on a grid that reaches beyond the work grid.
        closed: Volume<bool, Work>,
    },
}

impl Inside {
    /// Of a case's target, for places in `grid`.
    ///
    /// # Errors
    /// [`SceneError`] for a closing that cannot be made.
    pub fn new(
        spec: &SceneSpec,
        grid: &Grid<Work>,
        ct_from_work: &Rigid<Ct, Work>,
    ) -> Result<Self, SceneError> {
        if let Target::Label(label) = spec.target {
            return Ok(Self::Label(label));
        }
        // far enough around the crop for the closing to see the bone there
        let h = spec.spacing_mm.max(FINEST_CLOSING_MM);
        let pad = (2.0 * CLOSING_MM / h).ceil() * h + h;
        let size = Vector3::from(grid.dims().map(|d| (d - 1) as f64 * spec.spacing_mm));
        let dims = (size / h).map(|n| n.ceil()) + Vector3::repeat(2.0 * pad / h + 1.0);
        let wide = Grid::<Work>::aligned(
            [dims.x.round() as usize, dims.y.round() as usize, dims.z.round() as usize],
            h,
            Point::new(-pad, -pad, -pad),
        )?;
        let bone = resample_hu(spec.ct, &wide, ct_from_work, AIR_HU).map(|hu| f64::from(*hu) >= spec.bone_hu);
        Ok(Self::Shape {
            shape: spec.target.clone(),
            kept: spec.structures.iter().map(|(_, label)| *label).collect(),
            bone_hu: spec.bone_hu,
            closed: close(&bone, CLOSING_MM)?,
        })
    }

    /// Whether a place of this label lies in the label or the shape, whatever its grey value.
    #[inline]
    pub fn bounds(&self, p_ct: Point<Ct>, label: u16) -> bool {
        match self {
            Self::Label(target) => label == *target,
            Self::Shape { shape, kept, .. } => shape.contains(p_ct) && !kept.contains(&label),
        }
    }

    /// Whether a place, given in both frames, with its grey value and label is target.
    #[inline]
    pub fn holds(&self, p: Point<Work>, p_ct: Point<Ct>, hu: f64, label: u16) -> bool {
        let is_bone_or_enclosed = || match self {
            Self::Label(_) => true,
            // bone is bone, wherever the nearest voxel of the closing's grid lies
            Self::Shape { bone_hu, closed, .. } => {
                hu >= *bone_hu || closed.grid().nearest(p).is_some_and(|v| *closed.get(v))
            }
        };
        self.bounds(p_ct, label) && is_bone_or_enclosed()
    }
}

/// Morphological closing by a ball: dilation, then erosion.
fn close(mask: &Volume<bool, Work>, radius_mm: f64) -> Result<Volume<bool, Work>, SceneError> {
    let limit_mm = radius_mm + mask.grid().diagonal_mm();
    let Some(outside) = distance_within(mask, limit_mm)? else { return Ok(mask.clone()) };
    let beyond = outside.map(|d| f64::from(*d) > radius_mm);
    let Some(depth) = distance_within(&beyond, limit_mm)? else { return Ok(beyond.map(|b| !b)) };
    let mut closed = depth.map(|d| f64::from(*d) > radius_mm);
    closed.data_mut().iter_mut().zip(mask.data()).for_each(|(c, m)| *c |= *m);
    Ok(closed)
}
