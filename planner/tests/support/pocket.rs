//! An L-shaped pocket in bone with a rod beside it, and the path that mills it.

use bonemill_geometry::{Ct, Grid, Point, Volume};
use bonemill_imaging::DensityTable;
use bonemill_planner::case::Sheets;
use bonemill_planner::cutter::Ball;
use bonemill_planner::path::{Lines, MillPath, PathSpacing, RasterFrame, lay_path};
use bonemill_planner::scene::{MemoryNeed, Scene, SceneError, SceneSpec, Target, build_scene};
use bonemill_planner::space::BurrSpace;
use nalgebra::Vector3;

pub const RADIUS_MM: f64 = 1.5;
pub const BALL: Ball = Ball { radius_mm: RADIUS_MM };
pub const CLEARANCE_MM: f64 = 1.0;
pub const TARGET: u16 = 20;
pub const ROD: u16 = 7;
pub const DIMS: [usize; 3] = [40, 40, 30];
pub const SPACING_MM: f64 = 0.5;
pub const FIRST: Point<Ct> = Point::new(-11.0, -8.0, 3.0);
/// First voxel of air along k.
pub const AIR_FROM: usize = 22;
/// The rod's voxels.
pub const ROD_VOXELS: [[usize; 2]; 3] = [[30, 32], [24, 36], [12, 14]];
pub const SPACING: PathSpacing = PathSpacing { layer_mm: 1.5, stepover_mm: 1.0, step_mm: 0.5 };

pub fn inside(voxel: [usize; 3], ranges: [[usize; 2]; 3]) -> bool {
    (0..3).all(|a| (ranges[a][0]..ranges[a][1]).contains(&voxel[a]))
}

/// The CT and the label map.
pub fn images() -> (Volume<f32, Ct>, Volume<u16, Ct>) {
    let grid: Grid<Ct> = Grid::aligned(DIMS, SPACING_MM, FIRST).unwrap();
    let ct = (0..grid.len()).map(|n| {
        let [i, j, k] = grid.voxel(n);
        if k >= AIR_FROM { -1000.0 } else { 1100.0 + ((7 * i + 13 * j + 5 * k) % 11) as f32 * 20.0 }
    });
    let ct = Volume::new(grid.clone(), ct.collect()).unwrap();
    let labels = (0..grid.len()).map(|n| match grid.voxel(n) {
        v if inside(v, [[11, 27], [12, 26], [15, AIR_FROM]])
            || inside(v, [[11, 18], [26, 31], [17, AIR_FROM]]) =>
        {
            TARGET
        }
        v if inside(v, ROD_VOXELS) => ROD,
        _ => 0,
    });
    let labels = Volume::new(grid.clone(), labels.collect()).unwrap();
    (ct, labels)
}

pub fn table() -> DensityTable {
    DensityTable::new(&[-1000.0, 300.0, 2000.0], &[0.01, 1.145, 1.856]).unwrap()
}

pub fn scene() -> Scene {
    scene_at(SPACING_MM, None).unwrap()
}

pub fn scene_at(spacing_mm: f64, available_mb: Option<f64>) -> Result<Scene, SceneError> {
    let (ct, labels) = images();
    build_scene(&SceneSpec {
        ct: &ct,
        labels: &labels,
        target: Target::Label(TARGET),
        structures: &[("rod".into(), ROD)],
        table: &table(),
        air_hu: -700.0,
        bone_hu: 200.0,
        sheets: Sheets::Keep,
        approach: Some(Vector3::z()),
        spacing_mm,
        memory: MemoryNeed { bytes_per_voxel: 100.0, available_mb },
        margin_mm: 3.0,
        burr_radius_mm: RADIUS_MM,
        influence_mm: 10.0,
        shank_length_mm: 85.0,
        shank_radius_mm: 6.0,
    })
}

pub fn path(space: &BurrSpace) -> MillPath {
    lay_path(space, SPACING, &Lines::to_and_fro(RasterFrame::at_angle(0.0)))
}

/// Distance of `p` from the segment a–b, mm.
pub fn from_segment(p: &Vector3<f64>, a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
    let d = b - a;
    let t = if d.norm_squared() > 0.0 { ((p - a).dot(&d) / d.norm_squared()).clamp(0.0, 1.0) } else { 0.0 };
    (p - a - d * t).norm()
}

pub fn moves(path: &MillPath) -> Vec<(Vector3<f64>, Vector3<f64>)> {
    let at = |n: usize| path.points[n].position.coords;
    (0..path.points.len()).map(|n| (at(n.saturating_sub(1)), at(n))).collect()
}
