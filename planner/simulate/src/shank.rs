//! Tests whether the shank touches remaining bone (Yang and Chen's alarm), and finds where and how deep.
//!
//! The shank is a row of cylinders behind the burr. It touches a solid cell if the cell's centre lies in a cylinder and
//! inside the remaining bone; the depth is the distance of that centre below the cylinder's side. Bricks without remaining
//! solid cells take one lookup each.
//!
//! Beyond the lattice a coarse map of bone is used; there only certain contacts are reported.

use bonemill_cutting::cutter::ShankCylinder;
use bonemill_geometry::capsule::segment_distance_squared;
use bonemill_geometry::{Point, Work};
use nalgebra::{Unit, Vector3};

use super::bone::VoxelKind;
use super::lattice::{Brick, Lattice, SIDE, tag};

/// The shank touches bone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ShankContact {
    /// The deepest place.
    pub at: Point<Work>,
    /// How far it lies below the cylinder's side, mm.
    pub depth_mm: f64,
    /// Distance from the burr's centre along the shaft, mm.
    pub along_mm: f64,
    /// The kind of voxel touched there.
    pub kind: VoxelKind,
}

/// The deepest contact of a cylinder of the shank, or the distance to the nearest solid cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ShankView {
    /// The deepest contact.
    pub contact: Option<ShankContact>,
    /// Without contact, nothing solid is nearer to the cylinder than this, mm.
    pub clear_mm: f64,
}

/// Position and direction of the shaft.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shaft {
    pub center: Vector3<f64>,
    pub axis: Unit<Vector3<f64>>,
}

/// A brick that the shank may touch.
#[derive(Debug, Clone, Copy)]
struct NearBrick {
    brick: usize,
    /// Its first cell.
    first: [usize; 3],
    /// Lower bound of the distance of its cells from the cylinder's axis, mm; negative where the axis may pass through it.
    apart_mm: f64,
}

impl<T: Copy + Into<f64> + Sync> Lattice<'_, T> {
    /// Searches solid cells within `look_mm` of a cylinder's side; `is_swept` tells which points are removed but not yet in the
    /// lattice.
    pub(super) fn view_shank(
        &self,
        shaft: &Shaft,
        cylinder: &ShankCylinder,
        look_mm: f64,
        is_swept: impl Fn(&Vector3<f64>) -> bool,
    ) -> ShankView {
        let mut view = ShankView { contact: None, clear_mm: look_mm };
        let mut bricks = self.bricks_around(shaft, cylinder, look_mm);
        // nearest first, because a contact found there makes it unnecessary to search the others
        bricks.sort_unstable_by(|a, b| a.apart_mm.total_cmp(&b.apart_mm).then(a.brick.cmp(&b.brick)));
        for near in bricks {
            if near.apart_mm > cylinder.radius_mm + view.clear_mm {
                break;
            }
            self.view_brick(&near, (shaft, cylinder), &is_swept, &mut view);
        }
        view
    }

    /// Bricks with solid cells that may lie within `look_mm` of a cylinder's side.
    fn bricks_around(&self, shaft: &Shaft, cylinder: &ShankCylinder, look_mm: f64) -> Vec<NearBrick> {
        let (bricks, mut found) = (self.bricks, Vec::new());
        let s = self.spacing_mm();
        let side = SIDE as f64;
        let half = 0.5 * side;
        let [from, to] = [cylinder.from_mm, cylinder.to_mm]
            .map(|at| self.cell_of(&(shaft.center + shaft.axis.into_inner() * at)));
        let reach = (cylinder.radius_mm + look_mm) / s + half * 3f64.sqrt();
        let a = shaft.axis.iamax();
        let [b, c] = [(a + 1) % 3, (a + 2) % 3];
        let lean = 1.0 / shaft.axis[a].abs();
        // layers of bricks across the axis' main direction; the line is short in each
        let clip = |lo: f64, hi: f64, axis: usize| {
            let last = ((hi / side).floor()).min((bricks[axis] - 1) as f64);
            let first = (lo / side).floor().max(0.0);
            if hi < 0.0 || first > last { 0..0 } else { first as usize..last as usize + 1 }
        };
        let wide = reach * lean + half * lean;
        for layer in clip(from[a].min(to[a]) - reach, from[a].max(to[a]) + reach, a) {
            let t = ((layer as f64 + 0.5) * side - from[a]) / shaft.axis[a];
            let line = from + shaft.axis.into_inner() * t;
            for j in clip(line[c] - wide, line[c] + wide, c) {
                for i in clip(line[b] - wide, line[b] + wide, b) {
                    let mut at = [0; 3];
                    (at[a], at[b], at[c]) = (layer, i, j);
                    let brick = self.brick_index(at);
                    if matches!(self.tag(brick), tag::GONE | tag::NOTHING) {
                        continue;
                    }
                    let middle = Vector3::from(at.map(|v| v as f64 * side)).add_scalar(half - 0.5);
                    let squared = segment_distance_squared(&middle, &from, &to);
                    if squared <= reach * reach && self.looked_at(brick) != tag::NOTHING {
                        let apart_mm = (squared.sqrt() - half * 3f64.sqrt()) * s;
                        found.push(NearBrick { brick, first: at.map(|v| v * SIDE), apart_mm });
                    }
                }
            }
        }
        found
    }

    /// Searches one brick. A cell beyond an end of the cylinder counts with its distance from that end, because the same motion
    /// may bring it beside the cylinder.
    fn view_brick(
        &self,
        &NearBrick { brick, first, .. }: &NearBrick,
        (shaft, cylinder): (&Shaft, &ShankCylinder),
        is_swept: &impl Fn(&Vector3<f64>) -> bool,
        view: &mut ShankView,
    ) {
        let tag = self.tag(brick);
        let stored = if tag < tag::FIRST { self.stored[tag as usize].as_deref() } else { None };
        // along the axis, beyond the cylinder's ends, and the square of the distance from the axis
        let seen = |at| {
            let point: Point<Work> = self.point(at);
            let from_burr = point.coords - shaft.center;
            let along_mm = from_burr.dot(&shaft.axis);
            let beyond_mm = (cylinder.from_mm - along_mm).max(along_mm - cylinder.to_mm).max(0.0);
            let across2 = (from_burr.norm_squared() - along_mm * along_mm).max(0.0);
            (point, along_mm, beyond_mm, across2)
        };
        // half a row, and half a cell for rounding
        let half_row_mm = 0.5 * SIDE as f64 * self.spacing_mm();
        let is_row_near = |view: &ShankView, middle| {
            let (_, _, beyond_mm, across2) = seen(middle);
            let look_mm = view.clear_mm + half_row_mm;
            across2 < (cylinder.radius_mm + look_mm).powi(2) && beyond_mm <= look_mm
        };
        self.sites(first, view, is_row_near, |view, site, at| {
            let (point, along_mm, beyond_mm, across2) = seen(at);
            let near_mm = cylinder.radius_mm + view.clear_mm;
            if across2 >= near_mm * near_mm || beyond_mm > view.clear_mm {
                return;
            }
            let depth_mm = cylinder.radius_mm - across2.sqrt();
            let is_inside = beyond_mm <= 0.0 && depth_mm > 0.0;
            let apart_mm = (-depth_mm).max(0.0);
            let clear_mm = (beyond_mm * beyond_mm + apart_mm * apart_mm).sqrt();
            if !is_inside && clear_mm >= view.clear_mm {
                return;
            }
            if stored.is_some() && self.depth_at(&at) <= 0.0 {
                return;
            }
            let Some(kind) = self.kind_at(stored, site).filter(|kind| kind.stops_shank()) else { return };
            if is_swept(&point.coords) {
                return;
            }
            view.clear_mm = view.clear_mm.min(clear_mm);
            if is_inside && view.contact.is_none_or(|c| c.depth_mm < depth_mm) {
                view.contact = Some(ShankContact { at: point, depth_mm, along_mm, kind });
            }
        });
    }

    /// Centres of a brick's voxels, or of its cells where these are larger: one cell of each, and the centre's cell coordinates.
    ///
    /// As in the planner, a voxel counts by its centre, because its parts are not known more exactly. A row for whose middle
    /// `may` is false is skipped.
    fn sites<S>(
        &self,
        first: [usize; 3],
        state: &mut S,
        may: impl Fn(&S, Vector3<f64>) -> bool,
        mut visit: impl FnMut(&mut S, [usize; 3], Vector3<f64>),
    ) {
        let split = self.split();
        // the cells that contain a voxel's centre: the first of the voxel's upper half
        let cells = |a: usize| (first[a]..first[a] + SIDE).filter(move |c| c % split == split / 2);
        let middle = if split.is_multiple_of(2) { 0.5 } else { 0.0 };
        for z in cells(2) {
            for y in cells(1) {
                let at = |x: f64| Vector3::new(x, y as f64, z as f64).add_scalar(-middle);
                if may(state, at(first[0] as f64 + 0.5 * (SIDE - 1) as f64)) {
                    cells(0).for_each(|x| visit(state, [x, y, z], at(x as f64)));
                }
            }
        }
    }

    fn kind_at(&self, stored: Option<&Brick>, cell: [usize; 3]) -> Option<VoxelKind> {
        let [x, y, z] = cell.map(|c| c % SIDE);
        let known = stored.and_then(|brick| brick.held[x + SIDE * (y + SIDE * z)]);
        known.unwrap_or_else(|| self.held(cell)).kind
    }

    /// Contact of a piece of a cylinder beyond the grid, if it is certain by the coarse map: a voxel that holds something solid
    /// lies in the cylinder as a whole.
    pub(super) fn view_far(
        &self,
        shaft: &Shaft,
        piece: &ShankCylinder,
        whole: &ShankCylinder,
        view: &mut ShankView,
    ) {
        let Some(far) = self.bone().far() else { return };
        let on_axis = |along_mm: f64| shaft.center + shaft.axis.into_inner() * along_mm;
        let is_beyond = |p: Point<Work>| self.bone().grid().nearest(p).is_none();
        let count = ((piece.to_mm - piece.from_mm) / far.spacing_mm()).ceil().clamp(1.0, 1e4) as usize;
        let places = (0..=count).map(|n| {
            Point::from_coords(on_axis(
                piece.from_mm + (piece.to_mm - piece.from_mm) * n as f64 / count as f64,
            ))
        });
        let near_mm = places.filter(|p| is_beyond(*p)).filter_map(|p| far.at_least_mm(p));
        let clear_mm = near_mm.fold(f64::INFINITY, f64::min) - piece.radius_mm;
        view.clear_mm = view.clear_mm.min(clear_mm.max(0.0));
        if clear_mm > 0.0 {
            return;
        }
        let inside_mm = far.half_diagonal_mm();
        let (from, to) = (on_axis(piece.from_mm), on_axis(piece.to_mm));
        let aside = Vector3::repeat(piece.radius_mm);
        for at in far.full_between(&(from.inf(&to) - aside), &(from.sup(&to) + aside)) {
            let from_burr = at.coords - shaft.center;
            let along_mm = from_burr.dot(&shaft.axis);
            let across_mm = (from_burr - shaft.axis.into_inner() * along_mm).norm();
            let depth_mm = piece.radius_mm - across_mm - inside_mm;
            let is_in_piece = (piece.from_mm..=piece.to_mm).contains(&along_mm);
            let is_in_whole = (whole.from_mm + inside_mm..=whole.to_mm - inside_mm).contains(&along_mm);
            let is_deepest = depth_mm > 0.0 && view.contact.is_none_or(|c| c.depth_mm < depth_mm);
            if is_in_piece && is_in_whole && is_deepest && is_beyond(at) {
                view.contact = Some(ShankContact { at, depth_mm, along_mm, kind: VoxelKind::Obstacle });
            }
        }
    }
}
