//! The scan's edge: what of the target lies beyond it, and where bone beside the target reaches it.
//!
//! The scan is the union of the CT's closed voxel boxes. Beyond it nothing is known: HU count as air's, so bone that goes
//! on there is not kept and a target that goes on there cannot be removed. Both are measured here, by face of the CT, so
//! that a user learns on which side the scan ends too early.

use bonemill_geometry::{Ct, Grid, Point, Rigid, Volume, Work};
use bonemill_imaging::distance_within;

use super::{SceneError, SceneSpec};

/// A place this far beyond the outermost voxel's face still lies on it, voxels: rounding.
const ON_FACE: f64 = 1e-9;
/// Anatomical directions of the frame ct (RAS+): of +x, −x, +y, −y, +z, −z.
const DIRECTIONS: [&str; 6] =
    ["right (R)", "left (L)", "anterior (A)", "posterior (P)", "superior (S)", "inferior (I)"];

/// An amount for each face of the CT: the lower and the upper one of its axes i, j and k.
#[derive(Debug, Clone, PartialEq)]
pub struct ByFace {
    /// In the order i lower, i upper, j lower, j upper, k lower, k upper.
    pub amounts: [f64; 6],
    /// The anatomical direction that each face looks most nearly to.
    pub sides: [&'static str; 6],
}

impl ByFace {
    /// Nothing on any face of `ct`.
    pub(super) fn none(ct: &Grid<Ct>) -> Self {
        let side = |face: usize| {
            let axis = ct.axes().column(face / 2);
            let along = axis.iamax();
            let is_negative = (axis[along] < 0.0) != face.is_multiple_of(2);
            DIRECTIONS[2 * along + usize::from(is_negative)]
        };
        Self { amounts: [0.0; 6], sides: std::array::from_fn(side) }
    }

    /// Over all faces.
    pub fn total(&self) -> f64 {
        self.amounts.iter().sum()
    }

    /// The faces that have any of it, the largest amount first: "superior (S) and left (L)".
    pub fn text(&self) -> String {
        let mut faces: Vec<usize> = (0..6).filter(|n| self.amounts[*n] > 0.0).collect();
        faces.sort_by(|a, b| self.amounts[*b].total_cmp(&self.amounts[*a]));
        faces.iter().map(|n| self.sides[*n]).collect::<Vec<_>>().join(" and ")
    }
}

/// The part of the target beyond the scan.
#[derive(Debug, Clone, PartialEq)]
pub struct TargetOutside {
    /// Its volume by the face that it lies farthest beyond, mm³.
    pub mm3: ByFace,
    /// Its share of the whole target, 0..1.
    pub share: f64,
}

impl TargetOutside {
    /// More than this share of the target outside is refused: the images do not belong to the plan.
    pub const MOST_SHARE: f64 = 0.05;
    /// Up to this share a plan may still meet its case, with a warning.
    pub const FEW_SHARE: f64 = 0.005;

    /// What lies outside and on which side, as a sentence's beginning.
    pub fn text(&self) -> String {
        format!(
            "{:.2} % of the target ({:.1} mm³) lies outside the CT, beyond its {} side",
            100.0 * self.share,
            self.mm3.total(),
            self.mm3.text()
        )
    }
}

/// The face of the scan that `p` lies farthest beyond; `None` inside and on the faces themselves.
pub(super) fn beyond_face(ct: &Grid<Ct>, p: Point<Ct>) -> Option<usize> {
    let (index, dims) = (ct.continuous_index(p), ct.dims());
    let mut farthest = None;
    for axis in 0..3 {
        let past = [-0.5 - index[axis], index[axis] - (dims[axis] as f64 - 0.5)];
        for (side, voxels) in past.into_iter().enumerate().filter(|(_, voxels)| *voxels > ON_FACE) {
            let mm = voxels * ct.spacing_mm()[axis];
            if farthest.is_none_or(|(most_mm, _)| mm > most_mm) {
                farthest = Some((mm, 2 * axis + side));
            }
        }
    }
    farthest.map(|(_, face)| face)
}

/// Takes the voxels beyond the scan out of `mask`; their volume by face, mm³.
pub(super) fn cut_off(
    ct: &Grid<Ct>,
    mask: &mut Volume<bool, Work>,
    ct_from_work: &Rigid<Ct, Work>,
) -> ByFace {
    let mut outside_mm3 = ByFace::none(ct);
    let grid = mask.grid().clone();
    if grid.corners().iter().all(|corner| beyond_face(ct, *ct_from_work * *corner).is_none()) {
        return outside_mm3;
    }
    for (n, is_in) in mask.data_mut().iter_mut().enumerate().filter(|(_, is_in)| **is_in) {
        if let Some(face) = beyond_face(ct, *ct_from_work * grid.center(grid.voxel(n))) {
            outside_mm3.amounts[face] += grid.voxel_mm3();
            *is_in = false;
        }
    }
    outside_mm3
}

/// Where bone beside the target reaches the scan's edge, mm² by face.
///
/// Counted are the outer faces of the CT's outermost voxels with HU ≥ `bone_hu` whose middles lie within the burr's
/// diameter of the target: removing a point of the target, the burr reaches no farther. The distance is the trilinear
/// interpolation, on the work grid, of the distance to the nearest centre of a target voxel; faces whose middles lie
/// beyond the work grid's outermost centres are not counted.
pub(super) fn edge_bone(
    spec: &SceneSpec,
    in_target: &Volume<bool, Work>,
    ct_from_work: &Rigid<Ct, Work>,
) -> Result<ByFace, SceneError> {
    let ct = spec.ct.grid();
    let mut found_mm2 = ByFace::none(ct);
    let grid = in_target.grid();
    if grid.corners().iter().all(|corner| beyond_face(ct, *ct_from_work * *corner).is_none()) {
        return Ok(found_mm2);
    }
    let reach_mm = 2.0 * spec.tool.cutter_radius_mm;
    let Some(from_target_mm) = distance_within(in_target, reach_mm + grid.diagonal_mm())? else {
        return Ok(found_mm2);
    };
    let work_from_ct = ct_from_work.inverse();
    for face in 0..6 {
        let area_mm2 = ct.voxel_mm3() / ct.spacing_mm()[face / 2];
        for (voxel, middle) in outer_faces(ct, face) {
            let is_near = || {
                let index = grid.continuous_index(work_from_ct * middle);
                from_target_mm.trilinear_inside(index).is_some_and(|mm| mm <= reach_mm)
            };
            if f64::from(*spec.ct.get(voxel)) >= spec.bone_hu && is_near() {
                found_mm2.amounts[face] += area_mm2;
            }
        }
    }
    Ok(found_mm2)
}

/// The outermost voxels along one face of a grid, each with the middle of its outer face.
fn outer_faces(ct: &Grid<Ct>, face: usize) -> impl Iterator<Item = ([usize; 3], Point<Ct>)> {
    let (axis, is_upper) = (face / 2, face % 2 == 1);
    let dims = ct.dims();
    let [across, along] = [(axis + 1) % 3, (axis + 2) % 3];
    (0..dims[across] * dims[along]).map(move |n| {
        let mut voxel = [0; 3];
        voxel[axis] = if is_upper { dims[axis] - 1 } else { 0 };
        (voxel[across], voxel[along]) = (n % dims[across], n / dims[across]);
        let mut index = voxel.map(|v| v as f64);
        index[axis] += if is_upper { 0.5 } else { -0.5 };
        (voxel, ct.at(index))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Vector3};

    /// 4 × 6 × 8 voxels of 1 × 0.5 × 2 mm whose i runs to the left, j upwards and k to the front.
    fn grid() -> Grid<Ct> {
        let axes = Matrix3::from_columns(&[-Vector3::x(), Vector3::z(), Vector3::y()]);
        Grid::new([4, 6, 8], Vector3::new(1.0, 0.5, 2.0), axes, Vector3::new(10.0, -3.0, 5.0)).unwrap()
    }

    #[test]
    fn faces_are_named_by_where_they_look() {
        let sides = ByFace::none(&grid()).sides.map(|side| side.chars().rev().nth(1).unwrap());
        assert_eq!(sides, ['R', 'L', 'I', 'S', 'P', 'A']);
        let amounts = [0.0, 2.0, 0.0, 7.0, 0.0, 0.0];
        let by_face = ByFace { amounts, ..ByFace::none(&grid()) };
        assert_eq!(by_face.text(), "superior (S) and left (L)");
    }

    #[test]
    fn a_place_is_beyond_the_face_that_it_is_farthest_from_and_faces_belong_to_the_scan() {
        let ct = grid();
        let beyond = |index: [f64; 3]| beyond_face(&ct, ct.at(index));
        assert_eq!(beyond([1.0, 2.0, 3.0]), None);
        assert_eq!((beyond([-0.5, 2.0, 3.0]), beyond([3.5, 5.5, 7.5])), (None, None));
        assert_eq!(beyond([-0.6, 2.0, 3.0]), Some(0));
        // two voxels of 0.5 mm are less than one of 2 mm
        assert_eq!(beyond([1.0, 7.5, 8.5]), Some(5));
    }

    #[test]
    fn outer_faces_lie_on_the_scans_surface_and_cover_it() {
        let ct = grid();
        for face in 0..6 {
            let found: Vec<_> = outer_faces(&ct, face).collect();
            assert_eq!(found.len(), ct.len() / ct.dims()[face / 2]);
            for (voxel, middle) in found {
                let (index, edge) = (ct.continuous_index(middle), [-0.5, ct.dims()[face / 2] as f64 - 0.5]);
                assert!((index[face / 2] - edge[face % 2]).abs() < 1e-9);
                assert!((0..3).all(|a| (index[a] - voxel[a] as f64).abs() < 0.5 + 1e-9));
            }
        }
    }
}
