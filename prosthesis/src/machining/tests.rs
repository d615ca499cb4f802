//! Twins of the kernels: brute force on small parts, and known answers.

use bonemill_case::prosthesis::{CutSense, GCode, MachineKind, MachineSpec, OnFlange, ProcessSpec};
use bonemill_geometry::{Block as BlockFrame, Mesh, Point};
use nalgebra::Vector3;
use proptest::prelude::*;

use crate::machining::dropcutter::DropCutter;
use crate::machining::envelope::{Envelope, Facet};
use crate::machining::pass::TipPass;
use crate::machining::passes::Passes;
use crate::machining::raster::{CellRaster, NONE};
use crate::machining::reach::shift_to_reach_mm;
use crate::machining::rings::{Field, iso_loops};
use crate::machining::silhouette::{NearestPoints, Silhouette, area_mm2};
use crate::machining::stock::Stock;
use crate::machining::{Block, EndMill, Facing, HolderSegment, Kind, MachiningJob, Side};

fn tool(radius_mm: f64, corner_radius_mm: f64) -> EndMill {
    let holder = vec![HolderSegment { length_mm: 20.0, radius_mm: 8.0 }];
    EndMill { radius_mm, corner_radius_mm, flutes: 1, length_mm: 20.0, holder }
}

/// max over points of the facets of p_w − f(|p − axis|), on a fine grid of barycentric coordinates.
fn dropped_by_points(facets: &[Facet], tool: &EndMill, at: [f64; 2], pieces: usize) -> f64 {
    let mut best = NONE;
    for [a, b, c] in facets {
        for i in 0..=pieces {
            for j in 0..=pieces - i {
                let (s, t) = (i as f64 / pieces as f64, j as f64 / pieces as f64);
                let p = a + (b - a) * s + (c - a) * t;
                if let Some(f) = tool.profile_mm((p.x - at[0]).hypot(p.y - at[1])) {
                    best = best.max(p.z - f);
                }
            }
        }
    }
    best
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]
    #[test]
    fn a_dropped_cutter_touches_what_brute_force_finds(
        corners in prop::collection::vec(prop::array::uniform3(-3.0f64..3.0), 9),
        at in prop::array::uniform2(-3.0f64..3.0),
        corner in prop::sample::select(vec![0.0, 0.4, 1.2]),
    ) {
        let p = |n: usize| Vector3::from(corners[n]);
        // counter-clockwise seen from the tool, so that every facet faces it
        let facing = |[a, b, c]: Facet| if (b - a).cross(&(c - a)).z > 0.0 { [a, b, c] } else { [a, c, b] };
        let facets = [[p(0), p(1), p(2)], [p(3), p(4), p(5)], [p(6), p(7), p(8)]].map(facing);
        prop_assume!(facets.iter().all(|[a, b, c]| (b - a).cross(&(c - a)).z > 0.1));
        let tool = tool(1.2, corner);
        let exact = DropCutter::new(&facets, &tool).height_mm(at);
        let points = dropped_by_points(&facets, &tool, at, 200);
        prop_assert!(points <= exact + 1e-9, "points {points} above {exact}");
        // points are up to 0.05 mm apart, on slopes and at the edge of a flat end
        prop_assert!(points == NONE || exact - points < 0.4, "points {points} far below {exact}");
    }
}

#[test]
fn a_ball_rests_on_a_slope_by_its_normal() {
    // w = u/2: a ball's centre is r above the plane along the normal
    let facets =
        [[Vector3::new(-50.0, -50.0, -25.0), Vector3::new(50.0, -50.0, 25.0), Vector3::new(0.0, 80.0, 0.0)]];
    let height = DropCutter::new(&facets, &tool(2.0, 2.0)).height_mm([1.0, 0.0]);
    assert!((height - (0.5 - 2.0 + 2.0 * 1.25f64.sqrt())).abs() < 1e-9, "{height}");
    // a flat end touches at its edge, uphill
    let height = DropCutter::new(&facets, &tool(2.0, 0.0)).height_mm([1.0, 0.0]);
    assert!((height - 1.5).abs() < 1e-9, "{height}");
}

/// A box as facets, seen from the front.
fn box_facets(low: [f64; 3], high: [f64; 3]) -> Vec<Facet> {
    let corner = |n: usize| Vector3::from([0, 1, 2].map(|a| if n >> a & 1 == 0 { low[a] } else { high[a] }));
    let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    faces.iter().flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]].map(|t| t.map(|n| corner(*n)))).collect()
}

#[test]
fn an_envelope_tells_top_bottom_and_what_is_hidden() {
    let raster = CellRaster::over(-3.0, 3.0, 3.0, 0.25).unwrap();
    let mut facets = box_facets([-2.0, -2.0, 0.0], [2.0, 2.0, 1.0]);
    facets.extend(box_facets([-2.0, -2.0, 3.0], [0.0, 2.0, 4.0]));
    let envelope = Envelope::of(&raster, &facets);
    let under = raster.cell([-1.1, 0.3]).unwrap();
    let beside = raster.cell([1.1, 0.3]).unwrap();
    assert_eq!((envelope.bottom[under], envelope.top[under], envelope.hidden_mm[under]), (0.0, 4.0, 2.0));
    assert_eq!((envelope.bottom[beside], envelope.top[beside], envelope.hidden_mm[beside]), (0.0, 1.0, 0.0));
    assert!(!envelope.holds(raster.cell([2.6, 0.0]).unwrap()));
    let back = envelope.heights(&raster, Facing::Back);
    assert_eq!(back[raster.cell([-1.1, -0.3]).unwrap()], 0.0);
}

#[test]
fn a_silhouette_and_its_offset_have_their_areas() {
    let silhouette = Silhouette::of(&box_facets([-2.0, -1.0, 0.0], [2.0, 1.0, 3.0]));
    let area: f64 = silhouette.loops().map(|l| area_mm2(l)).sum();
    assert!((area - 8.0).abs() < 1e-6, "{area}");
    let grown: f64 = silhouette.offset(1.5).iter().map(|l| area_mm2(l)).sum();
    let expected = 8.0 + 12.0 * 1.5 + std::f64::consts::PI * 2.25;
    assert!((grown - expected).abs() < 2e-3, "{grown} for {expected}");
}

#[test]
fn nearest_points_are_those_of_brute_force() {
    let raster = CellRaster::over(0.0, 4.0, 2.0, 0.2).unwrap();
    let points: Vec<[f64; 2]> =
        (0..40).map(|n| [2.0 + (n as f64 * 0.37).sin(), (n as f64 * 0.61).cos()]).collect();
    let nearest = NearestPoints::of(&raster, &points);
    for cell in 0..raster.len() {
        let c = raster.centre_of(cell);
        let least = points.iter().map(|p| (c[0] - p[0]).hypot(c[1] - p[1])).fold(f64::INFINITY, f64::min);
        assert!(
            nearest.distance_mm[cell] - least < 0.02,
            "cell {cell}: {} for {least}",
            nearest.distance_mm[cell]
        );
    }
}

#[test]
fn rings_of_a_disc_are_circles_one_step_apart_and_clockwise() {
    let raster = CellRaster::over(-6.0, 6.0, 6.0, 0.1).unwrap();
    let inward: Vec<f64> =
        (0..raster.len()).map(|c| 5.0 - raster.centre_of(c)[0].hypot(raster.centre_of(c)[1])).collect();
    let domain: Vec<bool> = inward.iter().map(|d| *d >= 0.0).collect();
    let loops = Field::march(&raster, &domain, &inward, &raster.filled(0.8)).loops();
    assert_eq!(loops.iter().map(|(t, _)| *t).collect::<Vec<_>>(), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
    for (t, outline) in &loops {
        let radius = (-area_mm2(outline) / std::f64::consts::PI).sqrt();
        assert!((radius - (5.0 - 0.8 * t)).abs() < 0.1, "T = {t}: {radius}");
    }
}

#[test]
fn a_ridge_gets_a_line_half_way() {
    // a strip of half-width 2.8 steps: lines at 1, 2 and, since 0.8 is more than a half, at 2.5
    let raster = CellRaster::over(-6.0, 6.0, 4.0, 0.1).unwrap();
    let inward: Vec<f64> = (0..raster.len())
        .map(|c| raster.centre_of(c))
        .map(|[u, v]| (5.0 - u.abs()).min(2.8 - v.abs()))
        .collect();
    let domain: Vec<bool> = inward.iter().map(|d| *d >= 0.0).collect();
    let loops = Field::march(&raster, &domain, &inward, &raster.filled(1.0)).loops();
    assert_eq!(loops.iter().map(|(t, _)| *t).collect::<Vec<_>>(), [1.0, 2.0, 2.5]);
}

#[test]
fn iso_lines_have_the_greater_on_their_right() {
    let raster = CellRaster::over(-2.0, 2.0, 2.0, 0.1).unwrap();
    let map: Vec<f64> =
        (0..raster.len()).map(|c| raster.centre_of(c)[0].hypot(raster.centre_of(c)[1])).collect();
    // greater outside: counter-clockwise around the middle has the outside on its right
    let [outline] = iso_loops(&raster, &map, 1.0).try_into().unwrap();
    assert!((area_mm2(&outline) - std::f64::consts::PI).abs() < 0.02);
}

#[test]
fn a_map_dilated_and_eroded_is_closed() {
    // a slot narrower than the tool stays filled, a wide one opens
    let raster = CellRaster::over(-6.0, 6.0, 2.0, 0.1).unwrap();
    let depth = |u: f64| if (u + 3.0).abs() < 0.6 || (u - 2.0).abs() < 1.6 { 0.0 } else { 2.0 };
    let map: Vec<f64> = (0..raster.len()).map(|c| depth(raster.centre_of(c)[0])).collect();
    let cutter = tool(1.0, 0.0);
    let reached = raster.eroded(&raster.dilated(&map, &cutter, 0.0), &cutter);
    let at = |u: f64| reached[raster.cell([u, 0.0]).unwrap()];
    assert_eq!((at(-3.0), at(2.0), at(-5.0)), (2.0, 0.0, 2.0));
}

#[test]
fn a_slot_in_stock_is_as_wide_as_the_tool_and_half_of_it_beside() {
    let raster = CellRaster::over(-10.0, 10.0, 10.0, 0.1).unwrap();
    let block = Block { low_mm: Vector3::repeat(-8.0), high_mm: Vector3::repeat(8.0), grip_mm: 0.0 };
    let cutter = tool(1.5, 0.0);
    let mut stock = Stock::block(&raster, &block, &cutter, Facing::Front);
    let width = |stock: &Stock, v: f64| stock.width_mm([0.0, v, 6.0], [1.0, 0.0], 1.0, 0.0);
    assert!((width(&stock, 0.0) - 3.0).abs() < 0.11);
    stock.cut_line([-8.0, 0.0, 6.0], [3.0, 0.0, 6.0]);
    assert!((width(&stock, 1.2) - 1.2).abs() < 0.11, "{}", width(&stock, 1.2));
    assert_eq!(stock.lowest_mm([-4.0, 0.0]), 6.0);
    assert_eq!(stock.lowest_mm([7.0, 0.0]), 8.0);
    // from the other side the cut is a lower far surface
    let turned = stock.turned();
    let cell = raster.cell([-4.0, 0.0]).unwrap();
    assert_eq!((turned.centres.top[cell], turned.centres.other[cell]), (8.0, -6.0));
}

#[test]
fn a_ridge_between_cells_stands_in_the_way_from_either_side() {
    let raster = CellRaster::over(-10.0, 10.0, 10.0, 0.1).unwrap();
    let block = Block { low_mm: Vector3::repeat(-8.0), high_mm: Vector3::repeat(8.0), grip_mm: 0.0 };
    let mut stock = Stock::block(&raster, &block, &tool(1.5, 0.0), Facing::Front);
    let cut_beside = |stock: &mut Stock, ridge_mm: f64, w: f64| {
        for v in [-1.5 - 0.5 * ridge_mm, 1.5 + 0.5 * ridge_mm] {
            stock.cut_line([-9.0, 0.05 + v, w], [9.0, 0.05 + v, w]);
        }
    };
    // 0.06 mm wide, between rows of cells at v = 0 and 0.1
    cut_beside(&mut stock, 0.06, 5.0);
    assert_eq!((stock.lowest_mm([0.0, 0.0]), stock.free_mm([0.0, 0.0])), (5.0, 8.0));
    let mut turned = stock.turned();
    cut_beside(&mut turned, 0.06, -2.0);
    assert_eq!((turned.lowest_mm([0.0, 0.0]), turned.free_mm([0.0, 0.0])), (-2.0, 8.0));
    // once it is gone the way is free
    stock.cut_line([-9.0, 0.0, 5.0], [9.0, 0.0, 5.0]);
    assert_eq!(stock.free_mm([0.0, 0.0]), 5.0);
}

/// A flat end of radius 1.5 mm and a block of 16 mm.
fn flat_job() -> MachiningJob {
    MachiningJob {
        block: Block { low_mm: Vector3::repeat(-8.0), high_mm: Vector3::repeat(8.0), grip_mm: 0.0 },
        tool: tool(1.5, 0.0),
        process: ProcessSpec {
            spindle_rpm: 8500.0,
            feed_per_tooth_mm: 0.04,
            side_load: 0.6,
            depth_of_cut: 0.7,
            finishing_step_mm: 0.1,
            strip_mm: 1.0,
            clearance_mm: 3.0,
            sense: CutSense::Climb,
        },
        machine: MachineSpec {
            kind: MachineKind::FiveAxis,
            dialect: GCode::LinuxCnc,
            on_flange: OnFlange::Spindle,
            travel_mm: [200.0; 3],
            rotary_range_rad: [-6.3, 6.3],
            max_feed_mm_min: 1500.0,
            rapid_mm_min: 1500.0,
            rotary_rad_s: 1.0,
            acceleration_mm_s2: 500.0,
            jerk_mm_s3: 5000.0,
            max_time_min: None,
        },
    }
}

#[test]
fn a_wall_along_the_cells_is_cut_wherever_it_lies() {
    let job = flat_job();
    let raster = CellRaster::over(-10.0, 10.0, 10.0, 0.12).unwrap();
    // passes along a row of cells, each 0.05 mm deeper into a wall than the one before
    let (step, w) = (0.05, 5.0);
    let line = |v: f64| -> Vec<[f64; 3]> { (-60..=60).map(|n| [0.15 * f64::from(n), v, w]).collect() };
    let height = |_: [f64; 2]| w;
    let cut = |look_beyond: bool| {
        let stock = Stock::block(&raster, &job.block, &job.tool, Facing::Front);
        let mut passes = Passes::new(&job, Facing::Front, Side::A, stock, None);
        if look_beyond {
            passes.look_beyond(step);
        }
        let walls = (0..=9).map(|n| 6.6 - step * f64::from(n));
        for v in walls.clone() {
            passes.cut(&TipPass { places: line(v), closed: false }, &height, Kind::Finish);
        }
        let (moves, ..) = passes.finished();
        let finishing: Vec<_> = moves.iter().filter(|m| m.kind == Kind::Finish).collect();
        let is_cut = |v: f64| finishing.iter().filter(|m| (m.tip_mm.z + v).abs() < 1e-3).count() > 1;
        walls.map(is_cut).collect::<Vec<bool>>()
    };
    assert_eq!(cut(true), [true; 10]);
    // a row of centres every 0.12 mm says nothing of most of them
    assert!(cut(false).contains(&false));
}

#[test]
fn a_way_that_must_rise_does_so_before_it_goes_across() {
    let raster = CellRaster::over(-10.0, 10.0, 10.0, 0.12).unwrap();
    let job = flat_job();
    let stock = Stock::block(&raster, &job.block, &job.tool, Facing::Front);
    let mut passes = Passes::new(&job, Facing::Front, Side::A, stock, None);
    let ring = |radius: f64| -> Vec<[f64; 2]> {
        let at = |n: u32| -f64::from(n) * std::f64::consts::TAU / 200.0;
        (0..200).map(|n| [radius * at(n).cos(), radius * at(n).sin()]).collect()
    };
    // a channel, then a ring inside it that must stay 1 mm higher, also over the channel
    let (low, high) = (|_: [f64; 2]| 7.0, |_: [f64; 2]| 7.4);
    passes.cut(&TipPass::along(&ring(5.0), 0.2, low), &low, Kind::Rough);
    let before = passes.finished();
    let mut passes = Passes::new(&job, Facing::Front, Side::A, before.2, before.1);
    passes.cut(&TipPass::along(&ring(5.0), 0.2, |_| 6.6), &|_| 6.6, Kind::Rough);
    passes.cut(&TipPass::along(&ring(4.0), 0.2, high), &high, Kind::Finish);
    let (moves, ..) = passes.finished();
    let finishing: Vec<_> = moves.windows(2).filter(|pair| pair[1].kind == Kind::Finish).collect();
    assert!(!finishing.is_empty());
    for pair in finishing {
        let across = (pair[1].tip_mm - pair[0].tip_mm).xz().norm();
        let lowest = pair[0].tip_mm.y.min(pair[1].tip_mm.y);
        assert!(across < 1e-9 || lowest >= 7.4 - 1e-9, "{:?} to {:?}", pair[0].tip_mm, pair[1].tip_mm);
    }
}

#[test]
fn a_part_moves_in_its_block_as_far_as_the_cutter_is_too_short() {
    // a pyramid, 4 mm high, its base toward the back: both sides must go to the base, which is farther from the front
    let vertices =
        [[-5.0, -2.0, -5.0], [5.0, -2.0, -5.0], [5.0, -2.0, 5.0], [-5.0, -2.0, 5.0], [0.0, 2.0, 0.0]];
    let triangles = vec![[0, 1, 2], [0, 2, 3], [1, 0, 4], [2, 1, 4], [3, 2, 4], [0, 3, 4]];
    let pyramid = |turn: f64| Mesh::<BlockFrame> {
        vertices: vertices.iter().map(|[x, y, z]| Point::new(*x, turn * y, turn * z)).collect(),
        triangles: triangles.clone(),
    };
    let mut job = flat_job();
    (job.block.low_mm.y, job.block.high_mm.y) = (-19.0, 19.0);
    // the base lies 21 mm below the front's top; the tip goes down 20 mm less the holder's distance, and 0.1 mm beyond what it cuts
    let lacks_mm = 21.0 - (20.0 - 0.005 - 0.1);
    for turn in [1.0, -1.0] {
        let shift = |job: &MachiningJob, gap_mm: f64| turn * shift_to_reach_mm(&pyramid(turn), job, gap_mm);
        assert!((shift(&job, 2.0) - lacks_mm).abs() < 1e-12);
        // the room beside the part is 17 mm
        assert!((shift(&job, 16.5) - 0.5).abs() < 1e-12 && shift(&job, 18.0) == 0.0);
        let slim = MachiningJob { tool: EndMill { holder: vec![], ..job.tool.clone() }, ..job.clone() };
        assert_eq!(shift(&slim, 2.0), 0.0);
    }
    (job.block.low_mm.y, job.block.high_mm.y) = (-17.0, 17.0);
    assert_eq!(shift_to_reach_mm(&pyramid(1.0), &job, 2.0), 0.0);
    // 27 mm below the front's top and 23 mm above the back's bottom: neither is reached, both lack the same
    (job.block.low_mm.y, job.block.high_mm.y) = (-25.0, 25.0);
    assert_eq!(shift_to_reach_mm(&pyramid(1.0), &job, 2.0), 2.0);
    // a rounded end goes deeper by its corner
    (job.block.low_mm.y, job.block.high_mm.y) = (-17.0, 17.0);
    job.tool.corner_radius_mm = 0.5;
    assert!(
        (shift_to_reach_mm(&pyramid(1.0), &job, 2.0) - (19.0 - (20.0 - 0.005 - 0.1 - 1.0))).abs() < 1e-12
    );
}
