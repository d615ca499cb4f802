//! The room of a case: the arm's links, the patient as scanned, and the obstacles.
//!
//! The patient is every voxel above -300 HU, on cells of about 2.5 mm: a cell belongs to the patient if any of its
//! voxels does. Air that is not joined to the scan's border is filled, and pieces below 500 mm³ are left out. Cells of the
//! scan's outermost layer are repeated beyond it for `robot.head_beyond_mm`, but for faces within 60° of the approach: the tool comes in there.

use bonemill_arm::ur::UrModel;
use bonemill_arm::{Arm, ArmKind};
use bonemill_case::{Case, HeadSource, ObstacleFrame, ObstacleShape};
use bonemill_geometry::{Base, Capsule, Ct, Grid, Point, Rigid, Tool, Volume};
use bonemill_imaging::{ImageError, distance_only};
use bonemill_robot::resolve::Meeting;
use bonemill_robot::room::{Handpiece, Head, Obstacle, Room, Shape};
use nalgebra::{Rotation3, Vector3};
use rayon::prelude::*;

use super::PlanError;

/// Above it a voxel belongs to the patient, HU. Between air and fat; noise of air is kept out. Assumed.
const TISSUE_HU: f32 = -300.0;
/// Side of a cell, mm, about.
const CELL_MM: f64 = 2.5;
/// Smaller pieces of tissue are noise, mm³.
const SPECK_MM3: f64 = 500.0;
/// Faces of the scan whose way out has more than this in common with the approach are open. Assumed: 60°.
const OPEN: f64 = 0.5;
/// The patient's name in messages.
const HEAD_NAME: &str = "the patient (the scan's tissue)";

/// The room of an arm, the approach unit in ct; `None` where the case asks for no clearance of links, or the arm's shapes are not known.
///
/// # Errors
/// When the scan's distance field cannot be made.
pub fn room(
    case: &Case,
    arm: &Arm,
    (ct, approach): (&Volume<f32, Ct>, &Vector3<f64>),
    base_from_ct: &Rigid<Base, Ct>,
) -> Result<Option<Room>, PlanError> {
    let spec = case.robot.room;
    let Some(clearance_mm) = spec.link_clearance_mm else { return Ok(None) };
    if arm.kind() != ArmKind::Ur {
        return Ok(None);
    }
    let mut obstacles = obstacles(case, base_from_ct);
    if spec.head == HeadSource::Scan
        && let Some(field) = head_field((ct, approach), spec.head_beyond_mm)?
    {
        let shape = Shape::Head(Head::new(field, base_from_ct));
        obstacles.push(Obstacle { name: HEAD_NAME.into(), shape });
    }
    Ok(Room::new(arm, &handpiece(case, arm), obstacles, clearance_mm))
}

/// The obstacles of a case, in base.
pub fn obstacles(case: &Case, base_from_ct: &Rigid<Base, Ct>) -> Vec<Obstacle> {
    case.obstacles.iter().map(|obstacle| placed(obstacle, base_from_ct)).collect()
}

/// A room of the case as it is with the arm's base elsewhere.
pub fn seen_from(case: &Case, room: &Room, base_from_ct: &Rigid<Base, Ct>) -> Room {
    let head = |obstacle: &Obstacle| match &obstacle.shape {
        Shape::Head(head) => {
            Some(Obstacle { name: obstacle.name.clone(), shape: Shape::Head(head.seen_from(base_from_ct)) })
        }
        _ => None,
    };
    let patient = room.obstacles().iter().filter_map(head);
    room.among(obstacles(case, base_from_ct).into_iter().chain(patient).collect())
}

/// Refuses a place of the base at which it comes nearer to patient or obstacle than links may.
///
/// # Errors
/// [`PlanError::BaseMeets`].
pub fn judge_base(room: Option<&Room>) -> Result<(), PlanError> {
    room.and_then(base_meets).map_or(Ok(()), |meeting| Err(PlanError::BaseMeets(meeting)))
}

/// What the base comes too near to.
pub(crate) fn base_meets(room: &Room) -> Option<Meeting> {
    let base = room.base();
    (base.other.is_some() && base.distance_mm < room.clearance_mm()).then(|| Meeting::of(room, base))
}

/// What the user should know of links that are not checked.
pub fn warning(case: &Case, room: Option<&Room>) -> Option<String> {
    let asked = case.robot.room.link_clearance_mm.is_some() || !case.obstacles.is_empty();
    (asked && room.is_none()).then(|| {
        format!(
            "the shapes of the arm's links are not known (they are for robot.model = {}): links are held neither against the patient \
             nor against an [[obstacle]]",
            UrModel::names()
        )
    })
}

/// The shank's thick end, and from there straight to the flange, in the tool's frame.
fn handpiece(case: &Case, arm: &Arm) -> Handpiece {
    let Some(mount) = arm.mount().tool() else { return vec![] };
    let Some(last) = case.shank.last() else { return vec![] };
    let all_mm: f64 = case.burr.radius_mm + case.shank.iter().map(|s| s.length_mm).sum::<f64>();
    let [front, back] = [all_mm - last.length_mm, all_mm].map(|z| Point::<Tool>::new(0.0, 0.0, z));
    let flange = Point::from_coords(mount.flange_from_burr.inverse().translation_mm);
    [(front, back), (back, flange)].map(|(from, to)| Capsule { from, to, radius_mm: last.radius_mm }).to_vec()
}

/// An obstacle in base.
fn placed(obstacle: &bonemill_case::Obstacle, base_from_ct: &Rigid<Base, Ct>) -> Obstacle {
    let base_from_own: Rigid<Base, Base> = match obstacle.frame {
        ObstacleFrame::Base => Rigid::identity(),
        ObstacleFrame::Ct => Rigid::new(base_from_ct.rotation, base_from_ct.translation_mm),
    };
    let at = |p: &Vector3<f64>| base_from_own * Point::<Base>::from_coords(*p);
    let shape = match &obstacle.shape {
        ObstacleShape::Box { min_mm, max_mm } => {
            let own_from_box = Rigid::new(Rotation3::identity(), 0.5 * (min_mm + max_mm));
            let box_from_base = (base_from_own * own_from_box).inverse();
            Shape::Box { box_from_base, half_mm: 0.5 * (max_mm - min_mm) }
        }
        ObstacleShape::Ball { center_mm, radius_mm } => {
            let center = at(center_mm);
            Shape::Capsule(Capsule { from: center, to: center, radius_mm: *radius_mm })
        }
        ObstacleShape::Cylinder { from_mm, to_mm, radius_mm } => {
            Shape::Cylinder { from: at(from_mm), to: at(to_mm), radius_mm: *radius_mm }
        }
        ObstacleShape::Capsule { from_mm, to_mm, radius_mm } => {
            Shape::Capsule(Capsule { from: at(from_mm), to: at(to_mm), radius_mm: *radius_mm })
        }
    };
    Obstacle { name: obstacle.name.clone(), shape }
}

/// Distances between the centres of cells, mm, on a grid that holds all of the patient; `None` for a scan of air.
fn head_field(
    (ct, approach): (&Volume<f32, Ct>, &Vector3<f64>),
    beyond_mm: f64,
) -> Result<Option<Volume<f32, Ct>>, ImageError> {
    let Some(cells) = Cells::of(ct) else { return Ok(None) };
    let Some(mask) = cells.solid().extended(beyond_mm, approach) else { return Ok(None) };
    distance_only(&mask)
}

/// Cells of whole voxels, and which of them belong to the patient.
struct Cells {
    grid: Grid<Ct>,
    tissue: Vec<bool>,
}

impl Cells {
    fn of(ct: &Volume<f32, Ct>) -> Option<Self> {
        let (fine, dims) = (ct.grid(), ct.grid().dims());
        let voxels: [usize; 3] =
            std::array::from_fn(|k| (CELL_MM / fine.spacing_mm()[k]).round().max(1.0) as usize);
        let counts: [usize; 3] = std::array::from_fn(|k| dims[k].div_ceil(voxels[k]));
        let spacing_mm = Vector3::from_fn(|k, _| fine.spacing_mm()[k] * voxels[k] as f64);
        let first = fine.at(std::array::from_fn(|k| 0.5 * (voxels[k] as f64 - 1.0)));
        let grid = Grid::new(counts, spacing_mm, *fine.axes(), first.coords).ok()?;
        let mut tissue = vec![false; grid.len()];
        let slab = counts[0] * counts[1];
        tissue.par_chunks_mut(slab).enumerate().for_each(|(z, slab)| {
            for k in z * voxels[2]..((z + 1) * voxels[2]).min(dims[2]) {
                for j in 0..dims[1] {
                    let row = &ct.data()[fine.index([0, j, k])..][..dims[0]];
                    let cells = &mut slab[j / voxels[1] * counts[0]..][..counts[0]];
                    for (cell, row) in cells.iter_mut().zip(row.chunks(voxels[0])) {
                        *cell |= row.iter().any(|hu| *hu > TISSUE_HU);
                    }
                }
            }
        });
        Some(Self { grid, tissue })
    }

    /// With enclosed air filled and specks left out.
    fn solid(mut self) -> Self {
        let dims = self.grid.dims();
        let is_border = |n: usize| (0..3).any(|k| [0, dims[k] - 1].contains(&self.grid.voxel(n)[k]));
        let mut outside = vec![false; self.tissue.len()];
        let mut stack = vec![];
        for n in (0..self.tissue.len()).filter(|n| !self.tissue[*n] && is_border(*n)) {
            self.spread(n, false, &mut outside, &mut stack);
        }
        self.tissue = outside.iter().map(|outside| !outside).collect();
        let least = (SPECK_MM3 / self.grid.voxel_mm3()).ceil() as usize;
        let mut seen = vec![false; self.tissue.len()];
        for n in 0..self.tissue.len() {
            if self.tissue[n] && !seen[n] {
                let piece = self.spread(n, true, &mut seen, &mut stack);
                if piece.len() < least {
                    piece.into_iter().for_each(|cell| self.tissue[cell] = false);
                }
            }
        }
        self
    }

    /// Marks and gives the cells of a kind that are joined to a cell by faces.
    fn spread(&self, from: usize, tissue: bool, seen: &mut [bool], stack: &mut Vec<usize>) -> Vec<usize> {
        let (dims, mut piece) = (self.grid.dims(), vec![]);
        if !std::mem::replace(&mut seen[from], true) {
            stack.push(from);
        }
        while let Some(n) = stack.pop() {
            piece.push(n);
            let voxel = self.grid.voxel(n);
            for (k, step) in [1, dims[0], dims[0] * dims[1]].into_iter().enumerate() {
                let before = (voxel[k] > 0).then(|| n - step);
                let after = (voxel[k] + 1 < dims[k]).then(|| n + step);
                for other in [before, after].into_iter().flatten() {
                    if self.tissue[other] == tissue && !std::mem::replace(&mut seen[other], true) {
                        stack.push(other);
                    }
                }
            }
        }
        piece
    }

    /// The mask with its border repeated beyond it, where the approach does not lead out.
    fn extended(&self, beyond_mm: f64, approach: &Vector3<f64>) -> Option<Volume<bool, Ct>> {
        let (dims, spacing) = (self.grid.dims(), self.grid.spacing_mm());
        let out: [f64; 3] = std::array::from_fn(|k| self.grid.axes().column(k).dot(approach));
        let more = |k: usize, out: f64| if out > OPEN { 0 } else { (beyond_mm / spacing[k]).ceil() as usize };
        let before: [usize; 3] = std::array::from_fn(|k| more(k, -out[k]));
        let first = self.grid.at(std::array::from_fn(|k| -(before[k] as f64)));
        let counts = std::array::from_fn(|k| before[k] + dims[k] + more(k, out[k]));
        let grid = Grid::new(counts, spacing, *self.grid.axes(), first.coords).ok()?;
        let held = |n: usize| {
            let voxel = grid.voxel(n);
            let within = std::array::from_fn(|k| voxel[k].saturating_sub(before[k]).min(dims[k] - 1));
            self.tissue[self.grid.index(within)]
        };
        let mask: Vec<bool> = (0..grid.len()).into_par_iter().map(held).collect();
        Volume::new(grid, mask).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tissue_goes_on_beyond_the_scan_but_not_where_the_tool_comes_in() {
        // 20 mm of tissue from border to border, turned about z
        let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), 0.4);
        let grid =
            Grid::<Ct>::new([8; 3], Vector3::repeat(2.5), turn.into_inner(), Vector3::zeros()).unwrap();
        let ct = Volume::new(grid.clone(), vec![40.0; grid.len()]).unwrap();
        let middle = grid.at([3.5; 3]);
        let base_from_ct = Rigid::<Base, Ct>::identity();
        for (approach, open) in [
            (turn * Vector3::x(), [true, false, false]),
            // 45 degrees between two faces: both are open
            (turn * Vector3::new(1.0, 0.0, 1.0).normalize(), [true, false, true]),
        ] {
            let field = head_field((&ct, &approach), 50.0).unwrap().unwrap();
            let head = Obstacle { name: String::new(), shape: Shape::Head(Head::new(field, &base_from_ct)) };
            let at = |way: Vector3<f64>| {
                let p = middle + turn * way;
                head.at_least_mm(&Point::<Base>::from_coords(p.coords), f64::INFINITY)
            };
            for (k, is_open) in open.into_iter().enumerate() {
                let way = Vector3::ith(k, 40.0);
                // 30 mm beyond the face
                assert_eq!(at(way) > 20.0, is_open, "{k}: {}", at(way));
                assert!(at(-way) <= 0.0, "{k}: {}", at(-way));
            }
        }
    }
}
