//! An L-shaped pocket in bone with a rod beside it, and the path that mills it.

use bonemill_geometry::testkit::pocket::{DIMS, ORIGIN_MM, hu, label};
#[allow(unused_imports, reason = "every test program uses its own part of it")]
pub use bonemill_geometry::testkit::pocket::{ROD, ROD_VOXELS, SPACING_MM, TARGET, is_inside as inside};
use bonemill_geometry::{Ct, Grid, Point, Volume};
use bonemill_imaging::{AffineChoice, DensityTable};
use bonemill_planner::case::Sheets;
use bonemill_planner::cutter::Ball;
use bonemill_planner::path::{Lines, MillPath, PathSpacing, RasterFrame, lay_path};
use bonemill_planner::scene::{
    ApproachSpec, MemoryNeed, Scene, SceneError, SceneSpec, Target, ToolReach, build_scene,
};
use bonemill_planner::space::BurrSpace;
use nalgebra::Vector3;

pub const RADIUS_MM: f64 = 1.5;
pub const BALL: Ball = Ball { radius_mm: RADIUS_MM };
pub const CLEARANCE_MM: f64 = 1.0;
/// Centre of voxel (0, 0, 0).
pub const FIRST: Point<Ct> = Point::new(ORIGIN_MM[0], ORIGIN_MM[1], ORIGIN_MM[2]);
pub const SPACING: PathSpacing = PathSpacing { layer_mm: 1.5, stepover_mm: 1.0, step_mm: 0.5 };

/// The CT and the label map.
pub fn images() -> (Volume<f32, Ct>, Volume<u16, Ct>) {
    let grid: Grid<Ct> = Grid::aligned(DIMS, SPACING_MM, FIRST).unwrap();
    let of = |n: usize| grid.voxel(n);
    let ct = Volume::new(grid.clone(), (0..grid.len()).map(|n| hu(of(n))).collect()).unwrap();
    let labels = Volume::new(grid.clone(), (0..grid.len()).map(|n| label(of(n))).collect()).unwrap();
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
        further: &[],
        labels_affine: Some(AffineChoice::Auto),
        target: Target::Label(TARGET),
        also: &[],
        less: &[],
        is_swept: false,
        structures: &[("rod".into(), ROD)],
        clearances_mm: &[1.0],
        table: &table(),
        air_hu: -700.0,
        bone_hu: 200.0,
        sheets: Sheets::Keep,
        approach: ApproachSpec::Fixed(Vector3::z()),
        spacing_mm,
        memory: MemoryNeed { bytes_per_voxel: 100.0, available_mb },
        margin_mm: 3.0,
        tool: ToolReach {
            cutter_radius_mm: RADIUS_MM,
            shank_length_mm: 85.0,
            shank_radius_mm: 6.0,
            influence_mm: 10.0,
        },
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
