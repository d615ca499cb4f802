//! Scenes of a block of bone under air, with a rod to be kept and labels that are drawn wrong.

use bonemill_geometry::TargetRegion;
use bonemill_geometry::{Ct, Grid, Point, Volume};
use bonemill_imaging::{AffineChoice, DensityTable};
use nalgebra::{Matrix3, Vector3};

use super::*;

const TARGET: u16 = 20;
const ROD: u16 = 7;
const BONE_HU: f32 = 1200.0;
const AIR_HU: f32 = -1000.0;
const DIMS: [usize; 3] = [36, 34, 30];
/// First slice of air.
const AIR_FROM: usize = 20;

fn grid() -> Grid<Ct> {
    Grid::aligned(DIMS, 0.5, Point::new(-3.0, 2.0, 5.0)).unwrap()
}

/// Values by voxel.
fn volume<T>(grid: &Grid<Ct>, of: impl Fn([usize; 3]) -> T) -> Volume<T, Ct> {
    Volume::new(grid.clone(), (0..grid.len()).map(|n| of(grid.voxel(n))).collect()).unwrap()
}

fn is_in(voxel: [usize; 3], [is, js, ks]: [std::ops::Range<usize>; 3]) -> bool {
    is.contains(&voxel[0]) && js.contains(&voxel[1]) && ks.contains(&voxel[2])
}

fn label(voxel: [usize; 3]) -> u16 {
    if is_in(voxel, [8..17, 9..20, 12..20]) {
        TARGET
    } else if is_in(voxel, [20..22, 6..24, 14..16]) {
        ROD
    } else {
        0
    }
}

/// What a test changes of a case.
struct Body {
    ct: Volume<f32, Ct>,
    labels: Volume<u16, Ct>,
    further: Vec<(u32, u16)>,
    labels_affine: Option<AffineChoice>,
    target: Target<u16>,
    also: Vec<TargetRegion<u16>>,
    less: Vec<TargetRegion<u16>>,
    name: &'static str,
    is_swept: bool,
    spacing_mm: f64,
}

impl Body {
    fn new() -> Self {
        Self {
            ct: volume(&grid(), |v| if v[2] < AIR_FROM { BONE_HU } else { AIR_HU }),
            labels: volume(&grid(), label),
            further: vec![],
            labels_affine: Some(AffineChoice::Auto),
            target: Target::Label(TARGET),
            also: vec![],
            less: vec![],
            name: "nerve",
            is_swept: false,
            spacing_mm: 0.5,
        }
    }

    fn scene(&self) -> Result<Scene, SceneError> {
        build_scene(&SceneSpec {
            ct: &self.ct,
            labels: &self.labels,
            further: &self.further,
            labels_affine: self.labels_affine,
            target: self.target.clone(),
            also: &self.also,
            less: &self.less,
            is_swept: self.is_swept,
            structures: &[(self.name.into(), ROD)],
            clearances_mm: &[1.0],
            table: &DensityTable::new(&[-1000.0, 2000.0], &[0.01, 1.8]).unwrap(),
            air_hu: -700.0,
            bone_hu: 200.0,
            sheets: Sheets::Keep,
            approach: ApproachSpec::Fixed(Vector3::z()),
            spacing_mm: self.spacing_mm,
            memory: MemoryNeed { bytes_per_voxel: 66.0, available_mb: None },
            margin_mm: 1.0,
            tool: ToolReach {
                cutter_radius_mm: 1.5,
                shank_length_mm: 20.0,
                shank_radius_mm: 3.0,
                influence_mm: 15.0,
            },
        })
    }

    fn warnings(&self) -> String {
        self.scene().unwrap().warnings.join("\n")
    }
}

/// Places, in ct, of a scene's target voxels.
fn places(scene: &Scene) -> Vec<Point<Ct>> {
    let class = &scene.class;
    let target = (0..class.data().len()).filter(|n| class.data()[*n].is(Class::TARGET));
    target.map(|n| scene.ct_from_work * class.grid().center(class.grid().voxel(n))).collect()
}

fn mm3(scene: &Scene) -> f64 {
    scene.count(Class::TARGET) as f64 * scene.target_voxel_mm3
}

#[test]
fn a_label_map_of_the_cts_dimensions_lies_where_the_ct_lies() {
    let moved = |spacing_mm: f64, by_mm: f64| {
        let origin = grid().origin().coords + Vector3::new(by_mm, 0.0, 0.0);
        let grid = Grid::aligned(DIMS, spacing_mm, Point::from_coords(origin)).unwrap();
        Body { labels: volume(&grid, label), ..Body::new() }
    };
    assert_eq!(moved(0.5, 0.0).warnings(), "");
    assert_eq!(moved(0.5, 0.004).warnings(), "");
    let said = moved(0.5, 0.3).warnings();
    assert!(said.contains("up to 0.300 mm (0.60 voxels) beside it"), "{said}");
    // the far corner of 36 × 34 × 30 voxels that are a tenth too small
    for (body, mm) in [(moved(0.5, 1.0), 1.0), (moved(0.45, 0.0), 0.05 * 35.5f64.hypot(33.5).hypot(29.5))] {
        match body.scene() {
            Err(error @ SceneError::LabelsDisplaced { mm: found, .. }) => {
                assert!((found - mm).abs() < 1e-9, "{error}");
                assert!(error.to_string().contains("images.labels_affine"), "{error}");
            }
            other => panic!("{other:?}"),
        }
        // only NIfTI has several transforms to choose from
        let body = Body { labels_affine: None, ..body };
        let said = body.scene().unwrap_err().to_string();
        assert!(said.contains(&format!("up to {mm:.3} mm")) && !said.contains("labels_affine"), "{said}");
        let said = Body { labels_affine: Some(AffineChoice::Sform), ..body }.warnings();
        assert!(said.contains(&format!("{mm:.3} mm")), "{said}");
    }
    // the same map with its axes stored in another order and sense, and a crop of it
    let [nx, ny, nz] = DIMS;
    let axes = Matrix3::from_columns(&[Vector3::z(), -Vector3::x(), Vector3::y()]);
    let first = grid().center([nx - 1, 0, 0]).coords;
    let stored = Grid::new([nz, nx, ny], Vector3::repeat(0.5), axes, first).unwrap();
    let other = Body { labels: volume(&stored, |[a, b, c]| label([nx - 1 - b, c, a])), ..Body::new() };
    assert_eq!(other.warnings(), "");
    let crop = Grid::aligned([30, 30, 28], 0.5, grid().origin()).unwrap();
    assert_eq!(Body { labels: volume(&crop, label), ..Body::new() }.warnings(), "");
}

#[test]
fn implausible_labels_are_told() {
    let with_rod = |is_rod: &dyn Fn([usize; 3]) -> bool| {
        let of = |v| match label(v) {
            TARGET => TARGET,
            _ => ROD * u16::from(is_rod(v)),
        };
        volume(&grid(), of)
    };
    // in the air above the block
    let above = Body { labels: with_rod(&|v| is_in(v, [20..22, 6..24, 24..26])), ..Body::new() };
    let said = above.warnings();
    assert!(said.contains("100 % of structure 'nerve' lies outside the body"), "{said}");
    // in a closed cavity of the block
    let cavity = |v| is_in(v, [20..23, 6..24, 13..16]);
    let hollow = || volume(&grid(), |v| if v[2] < AIR_FROM && !cavity(v) { BONE_HU } else { AIR_HU });
    let in_air = Body { ct: hollow(), ..Body::new() };
    let said = in_air.warnings();
    assert!(
        said.contains("structure 'nerve' lies in air: the median of its grey values is -1000 HU"),
        "{said}"
    );
    assert_eq!(Body { name: "ear_canal", ..in_air }.warnings(), "");
    // soft tissue where the target is
    let soft = |v: [usize; 3]| if label(v) == TARGET { 40.0 } else { BONE_HU };
    let ct = volume(&grid(), |v| if v[2] < AIR_FROM { soft(v) } else { AIR_HU });
    let said = Body { ct, ..Body::new() }.warnings();
    assert!(
        said.contains("the target is hardly bone: 0.0 % of it reaches density.bone_hu = 200 HU"),
        "{said}"
    );
    // a target most of which hangs in the air
    let of = |v| if is_in(v, [8..17, 9..20, 18..26]) { TARGET } else { label(v) % TARGET };
    let said = Body { labels: volume(&grid(), of), ..Body::new() }.warnings();
    assert!(said.contains("% of the target lies outside the body"), "{said}");
}

#[test]
fn a_structure_outside_the_ct_is_told_with_its_volume_and_refused_where_nothing_of_it_is_inside() {
    let crop = Grid::aligned([22, 14, 30], 0.5, grid().origin()).unwrap();
    let rod = |is_rod: [std::ops::Range<usize>; 3]| Body {
        ct: volume(&crop, |v| if v[2] < AIR_FROM { BONE_HU } else { AIR_HU }),
        labels: volume(&grid(), |v| ROD * u16::from(is_in(v, is_rod.clone()))),
        target: small_box(),
        ..Body::new()
    };
    // 19 of 27 voxels along j
    let said = rod([19..22, 6..33, 14..16]).warnings();
    assert!(said.contains("70.4 % of structure 'nerve' lies outside the CT: 14.25 of 20.25 mm³"), "{said}");
    let said = rod([19..22, 20..33, 14..16]).scene().unwrap_err().to_string();
    // from the face at 13.5 to the centre at 20
    let parts = ["structure 'nerve' (label 7) lies wholly outside the CT", "9.75 mm³", "3.25 mm beyond"];
    assert!(parts.iter().all(|part| said.contains(part)), "{said}");
    // a crop of the CT's grid lies on its voxels, and one that is shifted by half a voxel does not
    let crop = |by_mm: f64| {
        let origin = grid().origin().coords + Vector3::new(by_mm, 0.0, 0.0);
        let crop = Grid::aligned([30, 30, 28], 0.5, Point::from_coords(origin)).unwrap();
        Body { labels: volume(&crop, label), labels_affine: None, ..Body::new() }.warnings()
    };
    assert_eq!([crop(0.0), crop(0.5)], ["", ""]);
    let said = crop(0.25);
    assert!(said.contains("lie up to 0.250 mm (0.50 voxels) beside the CT's"), "{said}");
}

/// A box in the block, away from the rod.
fn small_box() -> Target<u16> {
    Target::Box { min_mm: Vector3::new(-0.5, 4.0, 10.0), max_mm: Vector3::new(3.0, 7.0, 14.5) }
}

fn shapes() -> [Target<u16>; 3] {
    [
        small_box(),
        Target::Ball { center_mm: Vector3::new(2.0, 8.0, 10.0), radius_mm: 2.5 },
        Target::Frustum {
            from_mm: Vector3::new(1.0, 6.0, 8.0),
            to_mm: Vector3::new(2.5, 7.5, 13.0),
            from_radius_mm: 2.0,
            to_radius_mm: 3.0,
        },
    ]
}

#[test]
fn a_targets_volume_is_that_on_its_own_grid_whatever_the_planning_grid() {
    let own_mm3 = 9.0 * 11.0 * 8.0 * 0.125;
    for spacing_mm in [0.5, 0.33, 0.27] {
        let found = mm3(&Body { spacing_mm, ..Body::new() }.scene().unwrap());
        assert!((found - own_mm3).abs() < 1e-9, "{found} at {spacing_mm}");
        for target in shapes() {
            // nothing but bone in it
            let scene = Body { target: target.clone(), spacing_mm, ..Body::new() }.scene().unwrap();
            let solid_mm3 = target.volume_mm3().unwrap();
            assert!((mm3(&scene) - solid_mm3).abs() < 1e-9, "{target:?} at {spacing_mm}");
        }
    }
    // half of a box in the air above the block
    let target = Target::Box { min_mm: Vector3::new(0.0, 4.0, 13.0), max_mm: Vector3::new(4.0, 8.0, 16.5) };
    let found = mm3(&Body { target, spacing_mm: 0.25, ..Body::new() }.scene().unwrap());
    assert!((found / (4.0 * 4.0 * 1.75) - 1.0).abs() < 0.08, "{found}");
}

#[test]
fn a_shape_gives_way_to_structures_and_their_clearances() {
    // around the rod, whose voxel boxes span 6.75..7.75 × 4.75..13.75 × 11.75..12.75 mm
    let target =
        Target::Box { min_mm: Vector3::new(4.0, 6.0, 10.0), max_mm: Vector3::new(11.0, 12.0, 14.75) };
    let from_rod = |p: &Point<Ct>| {
        let [dx, dz] = [(p.x() - 7.25).abs() - 0.5, (p.z() - 12.25).abs() - 0.5].map(|d| d.max(0.0));
        dx.hypot(dz)
    };
    let scene = Body { target: target.clone(), spacing_mm: 0.25, ..Body::new() }.scene().unwrap();
    let found = places(&scene);
    assert!(found.iter().all(|p| from_rod(p) >= 1.0 - 1e-9));
    // the box less the rod with rounded edges of 1 mm
    let left_mm3 = 7.0 * 6.0 * 4.75 - 6.0 * (1.0 + 4.0 + std::f64::consts::PI);
    assert!((mm3(&scene) / left_mm3 - 1.0).abs() < 0.02, "{} {left_mm3}", mm3(&scene));
    // and a voxel beyond the clearance is target
    assert!(found.iter().any(|p| from_rod(p) < 1.3));
    // what a tool sweeps gives way to nothing
    let swept = Body { target, is_swept: true, ..Body::new() };
    assert!(matches!(swept.scene(), Err(SceneError::TargetTouches { .. })));
}

#[test]
fn what_is_added_and_taken_away_counts_with_its_margin() {
    let rod = |margin_mm| TargetRegion { of: Target::Label(ROD), margin_mm };
    let ball = Target::Ball { center_mm: Vector3::new(1.0, 12.0, 12.0), radius_mm: 1.0 };
    let ball = |margin_mm| TargetRegion { of: ball.clone(), margin_mm };
    let at = Point::new(1.0, 12.0, 12.0);
    let plain = places(&Body::new().scene().unwrap());
    let more = places(&Body { also: vec![ball(0.5)], ..Body::new() }.scene().unwrap());
    let is_drawn = |p: &Point<Ct>| grid().nearest(*p).is_some_and(|v| label(v) == TARGET);
    assert!(plain.iter().all(is_drawn));
    let added: Vec<_> = more.iter().filter(|p| !is_drawn(p)).collect();
    assert!(added.len() > 30 && added.iter().all(|p| p.distance_mm(&at) <= 1.5), "{}", added.len());
    let fewer = places(&Body { less: vec![ball(2.0)], ..Body::new() }.scene().unwrap());
    assert!(fewer.len() < plain.len() && fewer.iter().all(|p| p.distance_mm(&at) > 3.0));
    // the target ends 2.25 mm beside the rod
    assert_eq!(places(&Body { less: vec![rod(1.4)], ..Body::new() }.scene().unwrap()).len(), plain.len());
    assert!(places(&Body { less: vec![rod(2.5)], ..Body::new() }.scene().unwrap()).len() < plain.len());
    // a label that touches the rod as drawn, and no more once its neighbourhood is taken away
    let wide = |v| if is_in(v, [8..20, 9..20, 12..20]) { TARGET } else { label(v) };
    let touching = |less| Body { labels: volume(&grid(), wide), less, ..Body::new() };
    assert!(touching(vec![]).warnings().contains("the target touches structure 'nerve'"));
    assert_eq!(touching(vec![rod(0.6)]).warnings(), "");
}

#[test]
fn a_label_that_touches_or_overlaps_a_structure_gives_way_as_a_shape_does() {
    let from_rod = |p: &Point<Ct>| {
        let [dx, dz] = [(p.x() - 7.25).abs() - 0.5, (p.z() - 12.25).abs() - 0.5].map(|d| d.max(0.0));
        let dy = (p.y() - 9.25).abs() - 4.5;
        nalgebra::Vector3::new(dx, dy.max(0.0), dz).norm()
    };
    let wide = |v| if is_in(v, [8..22, 9..20, 12..20]) { TARGET } else { 0 };
    let with_rod = |v| if label(v) == ROD { ROD } else { wide(v) };
    let labels = volume(&grid(), with_rod);
    // the rod's own voxels in the target: 2 × 11 × 2 of 0.125 mm³
    let shared: Vec<(u32, u16)> = (0..grid().len())
        .filter(|n| label(grid().voxel(*n)) == ROD && wide(grid().voxel(*n)) == TARGET)
        .map(|n| (n as u32, TARGET))
        .collect();
    assert_eq!(shared.len(), 44);
    for (further, overlap) in [(shared, ", which overlaps it by 5.50 mm³"), (vec![], "")] {
        let drawn = 14 * 11 * 8 - 44 + further.len();
        let scene = Body { labels: labels.clone(), further, ..Body::new() }.scene().unwrap();
        let found = places(&scene);
        assert!(found.iter().all(|p| from_rod(p) >= 1.0 - 1e-9), "the clearance of 1 mm is kept");
        let kept = (0..grid().len()).map(|n| grid().voxel(n)).filter(|v| with_rod(*v) == TARGET);
        let kept = kept.filter(|v| from_rod(&grid().center(*v)) >= 1.0 - 1e-9).count();
        assert_eq!(found.len(), kept);
        let (lost_mm3, drawn_mm3) = ((drawn - kept) as f64 / 8.0, drawn as f64 / 8.0);
        let said = format!("the target touches structure 'nerve'{overlap}: ");
        let loss = format!("{lost_mm3:.2} of {drawn_mm3:.2} mm³ ({:.1} %)", 100.0 * lost_mm3 / drawn_mm3);
        let warnings = scene.warnings.join("\n");
        assert!(warnings.contains(&said) && warnings.contains(&loss), "{warnings}");
    }
    // a target around the rod alone lies within its clearance for the most part
    let around = |v| {
        if label(v) == ROD {
            ROD
        } else if is_in(v, [18..22, 9..20, 12..17]) {
            TARGET
        } else {
            0
        }
    };
    let said = Body { labels: volume(&grid(), around), ..Body::new() }.scene().unwrap_err().to_string();
    assert!(said.contains("structure 'nerve': ") && said.contains("more than half"), "{said}");
    // nothing but structure
    let all: Vec<(u32, u16)> =
        (0..grid().len()).filter(|n| label(grid().voxel(*n)) == ROD).map(|n| (n as u32, TARGET)).collect();
    let only = volume(&grid(), |v| if label(v) == ROD { ROD } else { 0 });
    let said = Body { labels: only, further: all, ..Body::new() }.scene().unwrap_err().to_string();
    assert!(said.contains("the target is empty: every voxel of it belongs to a structure"), "{said}");
}

#[test]
fn labels_in_finer_voxels_with_the_same_boxes_give_the_same_scene() {
    let coarse = Body::new();
    let fine_grid = Grid::aligned(DIMS.map(|n| 2 * n), 0.25, Point::new(-3.125, 1.875, 4.875)).unwrap();
    let fine = Body { labels: volume(&fine_grid, |v| label(v.map(|n| n / 2))), ..Body::new() };
    let [coarse, fine] = [coarse, fine].map(|body| body.scene().unwrap());
    assert_eq!(coarse.class.grid(), fine.class.grid());
    assert_eq!(coarse.class.data(), fine.class.data());
    // the boxes' outline: 9 × 11 voxels of half a millimetre
    assert_eq!(coarse.target_hull_xy, fine.target_hull_xy);
    let side = |a: usize| {
        let at = |p: &[f64; 2]| p[a];
        let most = coarse.target_hull_xy.iter().map(at).fold(f64::MIN, f64::max);
        most - coarse.target_hull_xy.iter().map(at).fold(f64::MAX, f64::min)
    };
    assert!((side(0) - 4.5).abs() < 1e-9 && (side(1) - 5.5).abs() < 1e-9);
}
