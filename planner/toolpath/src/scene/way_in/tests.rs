//! The way out of half-spaces, shafts and walls.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use nalgebra::Rotation3;

use super::super::build::structure_region;
use super::super::{MemoryNeed, SceneSpec, Sheets, Target, ToolReach};
use super::*;
use bonemill_geometry::Grid;
use bonemill_imaging::{AffineChoice, DensityTable};

const TARGET: u16 = 9;

/// A scan of 60 × 50 × 40 mm in voxels of 1 mm, turned, of which `hu` says the values. The target is a block of 13 × 10 × 8 mm in its middle.
fn found(
    turn: Matrix3<f64>,
    hu: impl Fn([f64; 3]) -> f32,
    given: Option<Vector3<f64>>,
) -> Result<ChosenWay, SceneError> {
    found_for(turn, hu, given, (Tilts::Freely, None))
}

fn found_for(
    turn: Matrix3<f64>,
    hu: impl Fn([f64; 3]) -> f32,
    given: Option<Vector3<f64>>,
    (tilts, arm): (Tilts, Option<ArmHolds<'_>>),
) -> Result<ChosenWay, SceneError> {
    let grid = Grid::<Ct>::new([60, 50, 40], Vector3::repeat(1.0), turn, Vector3::zeros()).unwrap();
    let at = |n: usize| grid.voxel(n).map(|c| c as f64);
    // skewed, so that its axes have signs
    let is_target = |[x, y, z]: [f64; 3]| {
        (24.0..37.0).contains(&x)
            && (20.0..30.0).contains(&y)
            && (17.0..25.0).contains(&z)
            && (x - 24.0) + 1.5 * (y - 20.0) < 20.0
            && (y - 20.0) + 2.0 * (25.0 - z) < 20.0
    };
    let ct = Volume::new(
        grid.clone(),
        (0..grid.len()).map(|n| if is_target(at(n)) { 900.0 } else { hu(at(n)) }).collect(),
    );
    let labels = (0..grid.len()).map(|n| if is_target(at(n)) { TARGET } else { 0 }).collect();
    let (ct, labels) = (ct.unwrap(), Volume::new(grid.clone(), labels).unwrap());
    let target: Vec<_> =
        (0..grid.len()).filter(|n| is_target(at(*n))).map(|n| grid.center(grid.voxel(n))).collect();
    let tool = WayInTool { shank_mm: vec![[15.0, 1.0], [40.0, 6.0]], tilt_limit_rad: 0.5, tilts };
    let spec = SceneSpec {
        ct: &ct,
        labels: &labels,
        further: &[],
        labels_affine: Some(AffineChoice::Auto),
        target: Target::Label(TARGET),
        also: &[],
        less: &[],
        is_swept: false,
        clearances_mm: &[],
        structures: &[],
        table: &DensityTable::new(&[-1000.0, 300.0, 2000.0], &[0.01, 1.145, 1.856]).unwrap(),
        air_hu: -700.0,
        bone_hu: 200.0,
        sheets: Sheets::Keep,
        approach: ApproachSpec::For { given: given.map(|d| turn * d), tool, arm },
        spacing_mm: 0.5,
        memory: MemoryNeed { bytes_per_voxel: 100.0, available_mb: None },
        margin_mm: 3.0,
        tool: ToolReach {
            cutter_radius_mm: 2.0,
            shank_length_mm: 57.0,
            shank_radius_mm: 6.0,
            influence_mm: 5.0,
        },
    };
    let region = structure_region(&spec, &target);
    let (direction, chosen) = approach(&spec, (&target, &region), &[])?;
    Ok(chosen.unwrap_or(ChosenWay {
        best: Way { direction, reached: f64::NAN },
        others: vec![],
        by_arm: false,
    }))
}

/// Bone below and beside the target, air above.
fn half_space([_, _, z]: [f64; 3]) -> f32 {
    if z < 25.0 { 900.0 } else { -1000.0 }
}

#[test]
fn out_of_a_half_space_leads_its_normal_and_turns_and_mirrors_with_the_scan() {
    let straight = found(Matrix3::identity(), half_space, None).unwrap().best;
    assert!(straight.direction.z > 0.97 && straight.reached > 0.9, "{straight:?}");
    let turn = Rotation3::new(Vector3::new(0.7, -0.3, 1.1)).into_inner();
    let mirror = Matrix3::from_diagonal(&Vector3::new(-1.0, 1.0, 1.0));
    for change in [turn, mirror, turn * mirror] {
        let turned = found(change, half_space, None).unwrap().best;
        assert!((change * straight.direction).angle(&turned.direction) < 0.03, "{turned:?}");
        assert!((turned.reached - straight.reached).abs() < 0.02);
    }
}

#[test]
fn a_long_way_through_tissue_or_an_air_cell_is_no_way() {
    // soft tissue above, 10 mm of it; below, tissue to the scan's edge; an air cell beside the target
    let tissue = |[x, y, z]: [f64; 3]| {
        let bone = (10.0..50.0).contains(&x) && (10.0..40.0).contains(&y) && (12.0..26.0).contains(&z);
        let cell = (35.0..40.0).contains(&x) && (20.0..30.0).contains(&y) && (15.0..25.0).contains(&z);
        match () {
            () if cell || z > 36.0 => -1000.0,
            () if bone && !(15.0..25.0).contains(&z) && !(25.0..35.0).contains(&x) => 900.0,
            () if (25.0..35.0).contains(&x) && (20.0..30.0).contains(&y) => 40.0,
            () if bone => 900.0,
            () => 40.0,
        }
    };
    let found = found(Matrix3::identity(), tissue, None).unwrap();
    assert!(found.best.direction.z > 0.9, "{found:?}");
}

#[test]
fn the_thick_part_of_the_shank_must_fit_too() {
    // a shaft of 4 mm half-width leads up to the scan's edge; a wide one leads along x
    let shaft = |[x, y, z]: [f64; 3]| {
        let up = (26.0..34.0).contains(&x) && (21.0..29.0).contains(&y) && z > 20.0;
        let along = x > 30.0 && (10.0..40.0).contains(&y) && (8.0..32.0).contains(&z);
        if up || along { -1000.0 } else { 900.0 }
    };
    let found = found(Matrix3::identity(), shaft, None).unwrap();
    assert!(found.best.direction.x > 0.9, "{found:?}");
}

#[test]
fn beyond_a_scan_that_ends_close_above_the_bone_there_is_room() {
    // the shank's thick part begins 2 mm beyond the scan, wider than the air between bone and scan's end
    let shaft = |[x, y, z]: [f64; 3]| {
        let up = (26.0..34.0).contains(&x) && (21.0..29.0).contains(&y) && z > 20.0;
        if up || z > 35.0 { -1000.0 } else { 900.0 }
    };
    let found = found(Matrix3::identity(), shaft, None).unwrap();
    assert!(found.best.direction.z > 0.9 && found.best.reached > 0.5, "{found:?}");
}

#[test]
fn a_direction_into_bone_is_refused_with_the_better_one() {
    let error = found(Matrix3::identity(), half_space, Some(-Vector3::z())).unwrap_err();
    let said = error.to_string();
    assert!(
        said.contains("approach.direction (0.00, 0.00, -1.00) faces bone") && said.contains(" 0 % of"),
        "{said}"
    );
    assert!(found(Matrix3::identity(), half_space, Some(Vector3::z())).is_ok());
}

#[test]
fn walled_in_is_refused() {
    let error = found(Matrix3::identity(), |_| 900.0, None).unwrap_err();
    assert!(matches!(error, SceneError::NoApproach | SceneError::NoRoom { .. }), "{error}");
    // with a direction it is for the rest of the planner to say what is left
    assert!(found(Matrix3::identity(), |_| 900.0, Some(Vector3::z())).is_ok());
}

#[test]
fn only_what_the_arm_can_hold_at_the_target_counts_unless_it_can_hold_nothing() {
    let chosen = |holds: HoldsAt<'_>| {
        found_for(Matrix3::identity(), half_space, None, (Tilts::Freely, Some(ArmHolds(holds))))
            .unwrap()
            .best
            .direction
    };
    let free = found(Matrix3::identity(), half_space, None).unwrap().best.direction;
    // an arm that holds the handpiece only if it leans by 24 degrees or more to one side: lines lean so, the approach need not
    let leaning = chosen(&|places, shaft| {
        assert!(places.len() == 6 && places.iter().all(|p| (20.0..40.0).contains(&p.x())), "{places:?}");
        shaft.x < -0.4
    });
    assert!(leaning.x < -0.1 && leaning.z > 0.7 && leaning.x < free.x - 0.1, "{leaning:?}");
    assert_eq!(chosen(&|_, _| true), free);
    assert_eq!(chosen(&|_, _| false), free);
}

#[test]
fn an_arm_that_tilts_about_one_axis_comes_across_it() {
    let (hinge, zero) = (Vector3::new(0.0, 0.8, 0.6), Vector3::x());
    let way =
        found_for(Matrix3::identity(), half_space, None, (Tilts::About { hinge, zero }, None)).unwrap().best;
    assert!(way.direction.dot(&hinge).abs() < 1e-12 && way.reached > 0.5, "{way:?}");
    // the normal itself lies 37 degrees from the plane, in which 0.8 is the most
    assert!(way.direction.z > 0.7, "{way:?}");
}
