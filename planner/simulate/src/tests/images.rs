//! What the burr meets is what the images hold, whatever grid a plan was made on.

use bonemill_geometry::{Ct, TargetRegion};
use bonemill_imaging::{AffineChoice, DensityTable};
use bonemill_toolpath::scene::{
    ApproachSpec, MemoryNeed, Scene, SceneSpec, Sheets, Target, ToolReach, build_scene,
};

use super::*;

const TARGET: u16 = 20;
/// Height of the label's upper face, mm.
const FACE_MM: f64 = 14.75;

/// Values by voxel of a block of 0.5 mm voxels.
fn voxels<T>(of: impl Fn([usize; 3]) -> T) -> Volume<T, Ct> {
    let grid = Grid::aligned([36, 34, 30], 0.5, Point::new(-3.0, 2.0, 5.0)).unwrap();
    let data = (0..grid.len()).map(|n| of(grid.voxel(n))).collect();
    Volume::new(grid, data).unwrap()
}

fn table() -> DensityTable {
    DensityTable::new(&[-1000.0, 2000.0], &[0.01, 1.8]).unwrap()
}

/// Bone under air, seen from above and aside, on a planning grid.
fn scene(spacing_mm: f64) -> Scene {
    let is_target =
        |[i, j, k]: [usize; 3]| (6..24).contains(&i) && (6..24).contains(&j) && (10..20).contains(&k);
    let also: [TargetRegion<u16>; 0] = [];
    build_scene(&SceneSpec {
        ct: &voxels(|v| if v[2] < 20 { 1200.0 } else { -1000.0 }),
        labels: &voxels(|v| if is_target(v) { TARGET } else { 0 }),
        further: &[],
        labels_affine: Some(AffineChoice::Auto),
        target: Target::Label(TARGET),
        also: &also,
        less: &also,
        is_swept: false,
        structures: &[],
        clearances_mm: &[],
        table: &table(),
        air_hu: -700.0,
        bone_hu: 200.0,
        sheets: Sheets::Keep,
        approach: ApproachSpec::Fixed(Vector3::new(0.1, 0.2, 0.97).normalize()),
        spacing_mm,
        memory: MemoryNeed { bytes_per_voxel: 66.0, available_mb: None },
        margin_mm: 1.0,
        tool: ToolReach {
            cutter_radius_mm: RADIUS_MM,
            shank_length_mm: 20.0,
            shank_radius_mm: 1.0,
            influence_mm: 5.0,
        },
    })
    .unwrap()
}

/// The force on a burr that moves over the middle of the target's face, so deep in it, N.
fn grazing_n(scene: &Scene, bone: Bone<'_, f32>, depth_mm: f64) -> f64 {
    let work_from_ct = scene.ct_from_work.inverse();
    let axis = work_from_ct.rotate(&Vector3::z());
    let at = |x: f64| {
        let center: Point<Ct> = Point::new(x, 9.3, FACE_MM + RADIUS_MM - depth_mm);
        Pose::new(work_from_ct * center, axis).unwrap()
    };
    let spec = spec();
    let model = burr(&spec);
    let mut engine = Engine::new(bone, spec, model, at(3.0)).unwrap();
    straight(&mut engine, at(4.5), 30).last().unwrap().force.force_n.norm()
}

#[test]
fn a_grazing_burr_feels_the_face_where_the_images_have_it() {
    let scenes = [0.7, 0.5, 0.15].map(scene);
    let densities = scenes.each_ref().map(|scene| solid_density(scene, &table()).unwrap());
    for depth_mm in [0.1, 0.2, 0.4] {
        let by_images = |n: usize| bone_of(&scenes[n], &densities[n]).unwrap();
        let by_grid = |n: usize| Bone::new(&densities[n]).unwrap().with_classes(&scenes[n].class).unwrap();
        let [coarse, middle, fine] = [0, 1, 2].map(|n| grazing_n(&scenes[n], by_images(n), depth_mm));
        let off = (coarse - fine).abs().max((middle - fine).abs());
        assert!(fine > 0.01 && off < 1e-6 * fine, "{depth_mm} mm: {coarse}, {middle} and {fine} N");
        let sampled = [0, 1].map(|n| grazing_n(&scenes[n], by_grid(n), depth_mm));
        eprintln!("{depth_mm} mm deep: {fine:.4} N, as the grids sample the face {sampled:.4?} N");
        let is_off = |n: &f64| (n - fine).abs() > 0.2 * fine;
        assert!(depth_mm > 0.2 || sampled.iter().all(is_off), "{depth_mm} mm: {sampled:?} N");
    }
}
