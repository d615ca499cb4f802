//! Gains compared with brute force, and their cost on a finer grid.

use crate::scene::{ApproachSpec, MemoryNeed, Scene, SceneSpec, Target, ToolReach, build_scene};
use bonemill_geometry::Sheets;
use bonemill_geometry::{Ct, Grid, Volume};
use bonemill_imaging::{AffineChoice, DensityTable};
use nalgebra::Vector3;

use super::*;
use crate::path::{PathSpacing, RasterFrame, rough::rough};
use crate::space::BurrSpace;

const RADIUS_MM: f64 = 1.0;
const BALL: bonemill_cutting::cutter::Ball = bonemill_cutting::cutter::Ball { radius_mm: RADIUS_MM };
const TARGET: u16 = 20;
const SPACING: PathSpacing = PathSpacing { layer_mm: 1.0, stepover_mm: 0.7, step_mm: 0.25 };

fn lines() -> Lines<'static> {
    Lines::to_and_fro(RasterFrame::at_angle(0.0))
}

/// A round hollow to be milled out of a block, from above.
fn scene(spacing_mm: f64) -> Scene {
    let grid: Grid<Ct> = Grid::aligned([24, 22, 14], 0.5, Point::new(0.0, 0.0, 0.0)).unwrap();
    let is_in = |n: usize| {
        let [i, j, k] = grid.voxel(n).map(|c| c as f64);
        ((i - 11.0) / 7.0).powi(2) + ((j - 10.0) / 6.0).powi(2) + ((k - 10.0) / 6.0).powi(2) <= 1.0
            && k < 10.5
    };
    let hu = |n: usize| if grid.voxel(n)[2] > 10 { -1000.0 } else { 1200.0 };
    let ct = Volume::new(grid.clone(), (0..grid.len()).map(hu).collect()).unwrap();
    let labels = (0..grid.len()).map(|n| if is_in(n) { TARGET } else { 0 }).collect();
    let labels = Volume::new(grid.clone(), labels).unwrap();
    build_scene(&SceneSpec {
        ct: &ct,
        labels: &labels,
        further: &[],
        labels_affine: Some(AffineChoice::Auto),
        target: Target::Label(TARGET),
        also: &[],
        less: &[],
        is_swept: false,
        structures: &[],
        clearances_mm: &[],
        table: &DensityTable::new(&[-1000.0, 300.0, 2000.0], &[0.01, 1.145, 1.856]).unwrap(),
        air_hu: -700.0,
        bone_hu: 200.0,
        sheets: Sheets::Keep,
        approach: ApproachSpec::Fixed(Vector3::z()),
        spacing_mm,
        memory: MemoryNeed { bytes_per_voxel: 70.0, available_mb: None },
        margin_mm: 1.0,
        tool: ToolReach {
            cutter_radius_mm: RADIUS_MM,
            shank_length_mm: 20.0,
            shank_radius_mm: 3.0,
            influence_mm: 5.0,
        },
    })
    .unwrap()
}

fn roughed<'a>(space: &'a BurrSpace<'a>) -> (Builder<'a>, u32) {
    let mut builder = Builder::new(space, SPACING);
    let layers = rough(&mut builder, &lines());
    (builder, layers)
}

/// For each cell, the number of standing voxels within the radius of its node.
fn gains_by_voxels(gains: &Gains, builder: &Builder) -> Vec<u32> {
    let grid = builder.space().grid();
    let left: Vec<[i64; 3]> = (0..grid.len())
        .filter(|n| gains.there.contains(*n))
        .map(|n| grid.voxel(n).map(|c| c as i64))
        .collect();
    let within = (RADIUS_MM / grid.spacing_mm().x).powi(2);
    let gain = |cell: usize| {
        let Some(node) = gains.cells.node(cell) else { return 0 };
        let at = grid.voxel(node).map(|c| c as i64);
        let squared = |v: &&[i64; 3]| (0..3).map(|a| (v[a] - at[a]).pow(2)).sum::<i64>() as f64;
        left.iter().filter(|v| squared(v) <= within).count() as u32
    };
    (0..gains.cells.len()).map(gain).collect()
}

/// Starts, walks and bounds are the same as if all gains were always known.
#[test]
fn the_choice_is_that_of_gains_counted_voxel_by_voxel() {
    for (spacing_mm, side) in [(0.25, 1), (0.2, 2)] {
        let scene = scene(spacing_mm);
        let space = BurrSpace::new(&scene, BALL, &[]).unwrap();
        let (mut builder, layer) = roughed(&space);
        let mut gains = Gains::new(&builder, Cells::new(&space, side, f32::INFINITY));
        let travel_cost = TRAVEL_COST_MM2 / space.grid().voxel_mm3();
        let mut walked = 0;
        for pass in 0..6 {
            let known = gains_by_voxels(&gains, &builder);
            assert!(known.iter().zip(&gains.most).all(|(known, most)| known <= most), "{spacing_mm}");
            let from = builder.position().unwrap();
            let value = |cell: usize| {
                f64::from(known[cell]) - travel_cost * from.distance_mm(&gains.center(&builder, cell))
            };
            let worth = (0..known.len()).filter(|cell| known[*cell] >= gains.worth);
            let expected = worth.reduce(|best, cell| if value(cell) > value(best) { cell } else { best });
            let start = gains.best_start(&builder);
            assert_eq!(start, expected, "{spacing_mm}, pass {pass}");
            let Some(start) = start else { break };
            let cells = gains.walk(&builder, start);
            walked += cells.len();
            // nothing is left in the balls along the walk, and no step from its end is worth a visit
            let known = gains_by_voxels(&gains, &builder);
            assert!(cells.iter().all(|cell| known[*cell] == 0));
            let end = cells[cells.len() - 1];
            let (nodes, step) = (&gains.cells, space.grid().spacing_mm().x);
            let reached =
                gains.offsets.iter().filter_map(|offset| nodes.at_offset(end, *offset)).find(|cell| {
                    let [from, to] = [end, *cell].map(|cell| gains.center(&builder, cell));
                    known[*cell] >= gains.worth && space.is_move_clear(from, to, step)
                });
            assert_eq!(reached, None, "{spacing_mm}, pass {pass}");
            // every other pass is not joined, so the material of its walk stands again
            if pass % 2 == 0 {
                let points = cells.iter().map(|cell| gains.center(&builder, *cell)).collect();
                builder.add(Pass { layer, points, put_off: false, from_above: false });
            }
            gains.settle(&builder);
        }
        assert!(walked > 5, "{walked}");
    }
}

/// A finer grid makes gains more exact and adds no candidate positions; rows are read at most as often as there are voxels.
#[test]
fn finishing_costs_no_more_than_there_are_voxels() {
    let [coarse, fine] = [0.25, 0.125].map(|spacing_mm| {
        let scene = scene(spacing_mm);
        let space = BurrSpace::new(&scene, BALL, &[]).unwrap();
        let (mut builder, layer) = roughed(&space);
        let rows = finish(&mut builder, layer, &lines());
        let left_mm3 = builder.left() as f64 * space.grid().voxel_mm3();
        (rows as f64, space.grid().len() as f64, left_mm3)
    });
    assert!(fine.1 > 6.0 * coarse.1);
    assert!(fine.2 <= coarse.2, "a finer grid leaves no more: {coarse:?} {fine:?}");
    assert!([coarse, fine].iter().all(|(rows, voxels, _)| rows < voxels), "{coarse:?} {fine:?}");
}
