//! Which places are target: what the case asks for and adds, less what it takes away, less what structures need.
//!
//! A label that the case names as its target is taken as it is drawn, unless it touches a structure. All else - such a label, a shape,
//! and whatever the case adds - gives way to the structures and their clearances; what is taken away is taken from everything. In a shape only bone and the air
//! that it encloses are target.

use bonemill_geometry::TargetRegion;
use bonemill_geometry::{Ct, Grid, Point, Rigid, Volume, Work};
use bonemill_imaging::{AIR_HU, ImageError, Region, StructureField, distance_within, resample_hu, whole};
use nalgebra::Vector3;
use rayon::prelude::*;

use super::{SceneError, SceneSpec, SceneStructure, Target};

/// Radius of the closing that decides which air a geometric target encloses, mm.
const CLOSING_MM: f64 = 4.0;
/// The closing's grid is no finer than this, mm: finer ones differ from each other by about as much.
const FINEST_CLOSING_MM: f64 = 0.25;

/// A label or a shape, as large as its margin makes it.
#[derive(Debug)]
pub(super) struct Part {
    of: Target<u16>,
    /// Of a label with a margin: the distance to it, and the margin, mm.
    around: Option<(StructureField, f64)>,
    /// Whether it gives way to structures.
    gives_way: bool,
}

impl Part {
    /// Of a region of the case, for places near `around`.
    ///
    /// # Errors
    /// When a distance field cannot be computed.
    pub fn new(region: &TargetRegion<u16>, spec: &SceneSpec, around: &Region) -> Result<Self, ImageError> {
        let field = match region.of {
            Target::Label(label) if region.margin_mm > 0.0 => {
                let near = Region { reach_mm: region.margin_mm, ..*around };
                StructureField::new(&whole(spec.labels, spec.further, label), label, Some(&near))?
            }
            _ => None,
        };
        let around = field.map(|field| (field, region.margin_mm));
        Ok(Self { of: region.of.grown(region.margin_mm), around, gives_way: true })
    }

    fn is_label(&self) -> bool {
        matches!(self.of, Target::Label(_))
    }

    /// Whether it holds a place of this label.
    #[inline]
    pub fn holds(&self, p_ct: Point<Ct>, label: u16) -> bool {
        match self.of {
            Target::Label(of) => {
                label == of || self.around.as_ref().is_some_and(|(field, mm)| field.is_nearer_than(p_ct, *mm))
            }
            _ => self.of.contains(p_ct),
        }
    }

    /// Volume on its own grid or as a solid, mm³; `None` for a label with a margin.
    fn volume_mm3(&self, labels: &Volume<u16, Ct>) -> Option<f64> {
        match self.of {
            Target::Label(_) if self.around.is_some() => None,
            Target::Label(of) => {
                let count = labels.data().par_iter().with_min_len(1 << 16).filter(|l| **l == of).count();
                Some(count as f64 * labels.grid().voxel_mm3())
            }
            _ => self.of.volume_mm3(),
        }
    }
}

/// Tells target from what is not.
#[derive(Debug)]
pub(super) struct Inside {
    /// What the case asks for first, then what it adds.
    parts: Vec<Part>,
    less: Vec<Part>,
    /// Labels of the structures.
    kept: Vec<u16>,
    /// Structures with their clearances, mm.
    near: Vec<(StructureField, f64)>,
    bone_hu: f64,
    /// Where there is a shape: bone, closed, on a grid that reaches beyond the work grid.
    closed: Option<Volume<bool, Work>>,
}

impl Inside {
    /// Of a case's target, for places in `grid`; `around` holds the target.
    ///
    /// # Errors
    /// [`SceneError`] for a closing or a distance field that cannot be made.
    pub fn new(
        spec: &SceneSpec,
        structures: &[SceneStructure],
        around: &Region,
        grid: &Grid<Work>,
        ct_from_work: &Rigid<Ct, Work>,
    ) -> Result<Self, SceneError> {
        let part = |region: &TargetRegion<u16>| Part::new(region, spec, around);
        let main = TargetRegion { of: spec.target.clone(), margin_mm: 0.0 };
        let mut parts = vec![part(&main)?];
        parts[0].gives_way = !parts[0].is_label();
        for region in spec.also {
            parts.push(part(region)?);
        }
        let less = spec.less.iter().map(part).collect::<Result<_, _>>()?;
        // what a channel's tool sweeps gives way to nothing
        let gives_way = !spec.is_swept && parts.iter().any(|part| part.gives_way);
        let near = if gives_way { near(spec, structures) } else { vec![] };
        let has_shape = parts.iter().any(|part| !part.is_label());
        Ok(Self {
            parts,
            less,
            kept: spec.structures.iter().map(|(_, label)| *label).collect(),
            near,
            bone_hu: spec.bone_hu,
            closed: if has_shape { Some(closed_bone(spec, grid, ct_from_work)?) } else { None },
        })
    }

    /// Makes the case's own target give way to structures and their clearances, also where it is a label.
    pub fn give_way(&mut self, spec: &SceneSpec, structures: &[SceneStructure]) {
        self.parts[0].gives_way = true;
        self.near = near(spec, structures);
    }

    /// Whether the case takes a place of this label away from its target.
    #[inline]
    pub fn is_taken_away(&self, p_ct: Point<Ct>, label: u16) -> bool {
        self.less.iter().any(|part| part.holds(p_ct, label))
    }

    /// Whether less than what is drawn may be target.
    pub fn gives_way(&self) -> bool {
        !self.less.is_empty() || self.parts.iter().any(|part| part.gives_way)
    }

    fn is_kept(&self, p_ct: Point<Ct>, label: u16) -> bool {
        self.kept.contains(&label) || self.near.iter().any(|(field, mm)| field.is_nearer_than(p_ct, *mm))
    }

    /// Whether a place of this label lies in the target, whatever its grey value.
    #[inline]
    pub fn bounds(&self, p_ct: Point<Ct>, label: u16) -> bool {
        self.is_any(p_ct, label, || true)
    }

    /// Whether a place, given in both frames, with its grey value and label is target.
    #[inline]
    pub fn holds(&self, p: Point<Work>, p_ct: Point<Ct>, hu: f64, label: u16) -> bool {
        // bone is bone, wherever the nearest voxel of the closing's grid lies
        self.is_any(p_ct, label, || {
            let closed = self.closed.as_ref();
            hu >= self.bone_hu || closed.is_some_and(|c| c.grid().nearest(p).is_some_and(|v| *c.get(v)))
        })
    }

    #[inline]
    fn is_any(&self, p_ct: Point<Ct>, label: u16, is_filled: impl Fn() -> bool) -> bool {
        let is_in = |part: &Part| {
            part.holds(p_ct, label)
                && !(part.gives_way && self.is_kept(p_ct, label))
                && (part.is_label() || is_filled())
        };
        self.parts.iter().any(is_in) && !self.is_taken_away(p_ct, label)
    }

    /// What a voxel of the target stands for, mm³: all voxels in a label or shape, the volume that it has by itself.
    ///
    /// A count of voxel centres is off by up to a voxel at every face; most where the faces lie along the grid. `place` gives a
    /// voxel's position and label.
    pub fn voxel_mm3(
        &self,
        labels: &Volume<u16, Ct>,
        grid: &Grid<Work>,
        place: impl Fn(usize) -> (Point<Ct>, u16) + Sync,
    ) -> f64 {
        let (mut own_mm3, mut counted) = (0.0, 0usize);
        for part in &self.parts {
            let Some(mm3) = part.volume_mm3(labels) else { continue };
            let holds = |n: &usize| {
                let (p_ct, label) = place(*n);
                part.holds(p_ct, label)
            };
            own_mm3 += mm3;
            counted += (0..grid.len()).into_par_iter().with_min_len(1 << 12).filter(holds).count();
        }
        if counted > 0 { own_mm3 / counted as f64 } else { grid.voxel_mm3() }
    }
}

/// Structures with their clearances, mm.
fn near(spec: &SceneSpec, structures: &[SceneStructure]) -> Vec<(StructureField, f64)> {
    let near = structures.iter().zip(spec.clearances_mm);
    near.filter_map(|(s, mm)| Some((s.field.clone()?, *mm))).collect()
}

/// Bone and the air that it encloses, in and around a grid.
fn closed_bone(
    spec: &SceneSpec,
    grid: &Grid<Work>,
    ct_from_work: &Rigid<Ct, Work>,
) -> Result<Volume<bool, Work>, SceneError> {
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
    close(&bone, CLOSING_MM)
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
