//! Small parts from mesh to proof: what is planned, written, read back and cut has no gouge, leaves no more than was asked for, and hits nothing.

#![allow(clippy::unwrap_used, reason = "a test's helper fails by panicking")]

mod common;

use bonemill_case::prosthesis::GCode;
use bonemill_geometry::{Block, Mesh, Point};
use bonemill_prosthesis::machining::leftover::Reason;
use bonemill_prosthesis::machining::strip::cutting_force_n;
use bonemill_prosthesis::machining::time::times;
use bonemill_prosthesis::machining::{
    EndMill, Facing, Kind, Machining, MachiningError, MachiningJob, Side, TipMove, plan,
};
use bonemill_prosthesis::program::{OUTLINE, write};
use bonemill_prosthesis::proof::{Proof, ProofJob, gcode, prove};
use common::{Shell, flat, job, proof_job};
use nalgebra::Vector3;

/// Plans, writes, reads back and judges.
fn proven(part: &Mesh<Block>, job: &MachiningJob) -> (Machining, Proof, ProofJob) {
    let planned = plan(part, job).unwrap();
    let text = write(&planned.moves, job, "a test", &[]);
    let proof_job = proof_job(job, planned.tab_boxes.clone());
    let proof = prove(&text, part, &proof_job).unwrap();
    (planned, proof, proof_job)
}

fn is_clean(proof: &Proof, job: &MachiningJob) {
    assert!(
        proof.deepest_gouge_mm <= 0.02,
        "gouge of {} mm at {:?}",
        proof.deepest_gouge_mm,
        proof.gouge_at_mm
    );
    assert!(proof.collisions.is_empty(), "{:?}", proof.collisions.first());
    assert!(proof.too_wide.is_empty(), "{:?} for {}", proof.too_wide.first(), job.widest_mm());
    assert!(proof.loose.is_empty(), "{:?}", proof.loose.first());
}

/// Greatest force of the cuts from the outline on, N.
fn outline_force_n(planned: &Machining, proof: &Proof, job: &MachiningJob) -> f64 {
    let text = write(&planned.moves, job, "a test", &[]);
    let line = text.lines().position(|line| line == OUTLINE).unwrap();
    cutting_force_n(job, proof.chip_mm(line))
}

/// A coarse tool and step, so that the test is quick.
fn quick(part: &Mesh<Block>, tool: EndMill) -> MachiningJob {
    let mut job = job(part, tool);
    job.process.finishing_step_mm = 0.15;
    job
}

#[test]
fn a_bevelled_shell_is_made_to_the_finishing_step() {
    for (bevel_mm, corner_radius_mm) in [(0.8, 0.0), (-0.6, 0.5)] {
        let shell =
            Shell { outer_mm: 40.0, inner_mm: 36.0, outline_mm: 7.0, bevel_mm, thickness_mm: 4.0, rings: 10 };
        let part = shell.mesh();
        assert!(part.volume_mm3() > 0.0);
        let job = quick(&part, EndMill { corner_radius_mm, ..flat() });
        let (planned, proof, _) = proven(&part, &job);
        is_clean(&proof, &job);
        assert!(proof.thickest_uncut_mm <= job.process.finishing_step_mm, "{}", proof.thickest_uncut_mm);
        assert!(planned.times.limited_s >= planned.times.constant_s * 0.9);
        // the tab bears twice the force of the outline's cuts
        let outline_n = outline_force_n(&planned, &proof, &job);
        assert!(planned.strip.tab_bears_n >= 2.0 * outline_n, "{:?} for {outline_n} N", planned.strip);
    }
}

/// A polygon in (y, z) drawn along x, counter-clockwise seen from +x; fans of triangles from its first corner must lie in it.
fn drawn(outline: &[[f64; 2]], length_mm: f64) -> Mesh<Block> {
    let count = outline.len() as u32;
    let at = |x: f64| outline.iter().map(move |[y, z]| Point::new(x, *y, *z));
    let vertices = at(-0.5 * length_mm).chain(at(0.5 * length_mm)).collect();
    let mut triangles = Vec::new();
    for k in 1..count - 1 {
        triangles.push([0, k + 1, k]);
        triangles.push([count, count + k, count + k + 1]);
    }
    for k in 0..count {
        let next = (k + 1) % count;
        triangles.push([k, next, count + next]);
        triangles.push([k, count + next, count + k]);
    }
    Mesh { vertices, triangles }
}

/// Quadrilaterals between an outer and an inner line of points in (x, z), drawn along y; both run clockwise seen from +y.
fn bent(outer: &[[f64; 2]], inner: &[[f64; 2]], thickness_mm: f64) -> Mesh<Block> {
    let count = outer.len() as u32;
    let at = |y: f64| outer.iter().chain(inner).map(move |[x, z]| Point::new(*x, y, *z));
    let vertices = at(-0.5 * thickness_mm).chain(at(0.5 * thickness_mm)).collect();
    let mut triangles = Vec::new();
    // four corners, clockwise seen from outside
    let mut add = |[a, b, c, d]: [u32; 4]| triangles.extend([[a, c, b], [a, d, c]]);
    let (inside, upper) = (count, 2 * count);
    for k in 0..count - 1 {
        let [a, b, c, d] = [k, k + 1, inside + k + 1, inside + k];
        add([a, b, c, d]);
        add([d, c, b, a].map(|n| n + upper));
        add([a, a + upper, b + upper, b]);
        add([c, c + upper, d + upper, d]);
    }
    let last = count - 1;
    add([0, inside, inside + upper, upper]);
    add([last, last + upper, inside + last + upper, inside + last]);
    Mesh { vertices, triangles }
}

#[test]
fn no_piece_of_the_block_comes_loose() {
    let mill = EndMill { radius_mm: 1.5, ..flat() };
    // the channel opens through the block's ends, leaves a thin sheet or leaves a frame: the stock above the part is cut off in all but the last
    let part = drawn(&[[-2.0, -5.0], [2.0, -5.0], [2.0, 5.0], [-2.0, 5.0]], 12.0);
    for (gap_mm, is_loose) in [(0.0, true), (2.9, true), (3.066, true), (3.15, true), (5.0, false)] {
        let mut job = quick(&part, mill.clone());
        job.block.low_mm.x = -6.0 - gap_mm;
        job.block.high_mm.x = 6.0 + gap_mm;
        let (planned, proof, _) = proven(&part, &job);
        assert!(proof.too_wide.is_empty(), "{gap_mm}: {:?}", proof.too_wide);
        is_clean(&proof, &job);
        assert!(proof.thickest_uncut_mm <= job.process.finishing_step_mm, "{}", proof.thickest_uncut_mm);
        let above = |m: &&TipMove| m.kind == Kind::Rough && m.tip_mm.z > 5.0 + 2.0 * 1.5;
        assert_eq!(planned.moves.iter().any(|m| above(&m)), is_loose, "{gap_mm}");
    }
    // the channel closes the mouth of a C: its core is cut off. Its corners are rounder than the cutter
    let around = |radius_mm: f64| {
        let corner = move |n: u32| {
            let direction = |degrees: u32| f64::from(degrees).to_radians().sin_cos();
            let (x, z) = direction(90 * n + 45);
            let arc = (0..=6).map(move |k| direction(90 * n + 15 * k));
            arc.map(move |(u, w)| [4.0 * x.signum() + radius_mm * u, 4.0 * z.signum() + radius_mm * w])
        };
        let mouth = |x: f64| [[x, 4.0 + radius_mm]];
        [&mouth(2.0)[..], &(0..4).flat_map(corner).collect::<Vec<_>>(), &mouth(-2.0)].concat()
    };
    let part = bent(&around(6.0), &around(3.0), 4.0);
    let area_mm2 = 32.0 * (6.0 - 3.0) + 12.0 * 15f64.to_radians().sin() * (36.0 - 9.0) - 4.0 * 3.0;
    assert!((part.volume_mm3() - 4.0 * area_mm2).abs() < 1e-9, "{}", part.volume_mm3());
    let job = quick(&part, mill);
    let (_, proof, _) = proven(&part, &job);
    is_clean(&proof, &job);
}

#[test]
fn a_corner_that_the_cutter_is_too_wide_for_is_told_with_its_volume() {
    // an L: its inner corner of 90° keeps (1 − π/4) R² of the plate's thickness
    let outer = [[-8.0, 8.0], [-8.0, -8.0], [8.0, -8.0]];
    let inner = [[-2.0, 8.0], [-2.0, -2.0], [8.0, -2.0]];
    let part = bent(&inner, &outer, 4.0);
    let mut job = quick(&part, EndMill { radius_mm: 3.0, ..flat() });
    job.block.grip_mm = 4.0;
    let (planned, proof, proof_job) = proven(&part, &job);
    is_clean(&proof, &job);
    let expected_mm3 = (1.0 - 0.25 * std::f64::consts::PI) * 9.0 * 4.0;
    let [left] = planned.left[..] else { panic!("{:?}", planned.left) };
    assert_eq!(left.reason, Reason::Corner);
    assert!((left.volume_mm3 - expected_mm3).abs() < 0.05 * expected_mm3, "{left:?} for {expected_mm3}");
    // it is where the proof finds it
    let places = proof.uncut(0.2, &proof_job);
    assert!(!places.is_empty() && places.iter().all(|p| (p.at_mm - left.at_mm).norm() < 3.0), "{places:?}");
}

#[test]
fn a_corner_beside_the_tab_is_told_like_any_other() {
    let outer = [[-6.0, 4.5], [-6.0, -4.5], [6.0, -4.5]];
    let part = bent(&[[-3.0, 4.5], [-3.0, -1.5], [6.0, -1.5]], &outer, 3.0);
    let job = quick(&part, EndMill { radius_mm: 1.6, ..flat() });
    let (planned, proof, proof_job) = proven(&part, &job);
    is_clean(&proof, &job);
    let expected_mm = (2f64.sqrt() - 1.0) * 1.6;
    assert!((proof.thickest_uncut_mm - expected_mm).abs() < 0.03, "{}", proof.thickest_uncut_mm);
    let there = |p: &Vector3<f64>| (p.x + 3.0).hypot(p.z + 1.5) < 1.0;
    assert!(proof.uncut(0.3, &proof_job).iter().all(|p| there(&p.at_mm)), "{:?}", planned.tab_boxes);
    assert_eq!(planned.left.len(), 1, "{:?}", planned.left);
}

#[test]
fn a_cutter_that_is_tiny_for_its_block_is_refused_with_what_would_do() {
    let part = plate_with_hole(6.0);
    let mut job = quick(&part, EndMill { radius_mm: 0.1, ..flat() });
    // 12 mm of block on either side of a plate of 12 mm
    (job.block.low_mm.y, job.block.high_mm.y) = (-12.0, 12.0);
    let refused = plan(&part, &job).unwrap_err();
    let MachiningError::TooMuch { length_mm, most_mm, .. } = refused else { panic!("{refused}") };
    // 24 mm of a square of 12.4 mm, but for the plate, by 0.12 · 0.14 mm at most; rows on both sides
    let volume_mm3 = 24.0 * 12.4 * 12.4 - 108.0 * 4.0;
    assert!(
        length_mm > volume_mm3 / (0.12 * 0.14) && length_mm < 3.0 * volume_mm3 / (0.12 * 0.14),
        "{length_mm}"
    );
    assert!(most_mm < length_mm);
    let said = refused.to_string();
    assert!(said.contains("`tool.diameter_mm` = 0.2") && said.contains("wider cutter"), "{said}");
}

#[test]
fn side_b_is_turned_to_the_way_that_the_rotary_axis_reaches() {
    let part = plate_with_hole(6.0);
    let mut job = quick(&part, flat());
    for (range_deg, a_deg) in [([-360.0, 360.0], "A180"), ([-200.0, 10.0], "A-180"), ([-180.0, 0.0], "A-180")]
    {
        job.machine.rotary_range_rad = range_deg.map(f64::to_radians);
        let planned = plan(&part, &job).unwrap();
        assert_eq!(planned.warnings, [], "{range_deg:?}");
        let text = write(&planned.moves, &job, "a test", &[]);
        assert!(text.contains(&format!("G0 {a_deg}.000\n")), "{range_deg:?}");
        let proof = prove(&text, &part, &proof_job(&job, planned.tab_boxes.clone())).unwrap();
        is_clean(&proof, &job);
    }
}

#[test]
fn a_program_that_falls_short_stops_at_its_first_line_in_every_dialect() {
    let part = plate_with_hole(6.0);
    let mut job = quick(&part, flat());
    let moves = plan(&part, &job).unwrap().moves;
    let reason = ["stock of 9.1 mm³ stays at (1, 2) mm".to_owned(), "more".to_owned()];
    for (dialect, head, dwell, end) in [
        (GCode::LinuxCnc, "", "G4 P3\n", "M30\n"),
        (GCode::Fanuc, "%\nO0001\n", "G4 P3000\n", "M30\n%\n"),
        (GCode::Haas, "%\nO00001\n", "G4 P3000\n", "M30\n%\n"),
    ] {
        job.machine.dialect = dialect;
        let [good, short] = [&[][..], &reason].map(|reasons| write(&moves, &job, "a test", reasons));
        let first = short.strip_prefix(head).unwrap().lines().next().unwrap();
        assert_eq!(first, "M0 (DO NOT RUN: stock of 9.1 mm3 stays at [1, 2] mm; 1 more reasons)");
        // no other line is another
        let others = good.lines().zip(short.lines()).filter(|(a, b)| a != b).count();
        assert_eq!((others, good.lines().count()), (1, short.lines().count()));
        assert!(good.contains(dwell) && good.ends_with(end) && good.is_ascii(), "{dialect:?}");
        // the safety line and Z come before anything else moves
        let words: Vec<&str> = good.lines().filter(|line| line.starts_with(['G', 'M', 'T', 'S'])).collect();
        assert_eq!(words[..4], ["G17 G21 G40 G49 G80 G90 G94 G54", "G53 G0 Z0.000", "T1 M6", "G0 A0.000"]);
        let read = gcode::read(&good).unwrap();
        assert_eq!(read.motions, gcode::read(&short).unwrap().motions);
    }
}

#[test]
fn a_step_that_overhangs_on_both_sides_is_told_with_its_place() {
    // a groove of 2 mm in the rim at z = 4, between y = −0.8 and 0.8, that neither side sees
    let outline = [
        [0.0, 1.0],
        [-0.8, 2.0],
        [-0.8, 4.0],
        [-2.0, 4.0],
        [-2.0, -4.0],
        [2.0, -4.0],
        [2.0, 4.0],
        [0.8, 4.0],
        [0.8, 2.0],
    ];
    let part = drawn(&outline, 8.0);
    let job = quick(&part, flat());
    let (planned, proof, _) = proven(&part, &job);
    is_clean(&proof, &job);
    let hidden: Vec<_> = planned.left.iter().filter(|l| l.reason == Reason::Hidden).collect();
    let [groove] = hidden.as_slice() else { panic!("{hidden:?}") };
    assert!((groove.volume_mm3 - 8.0 * (1.6 * 2.0 + 0.8)).abs() < 2.0, "{groove:?}");
    assert!((groove.at_mm.z - 2.8).abs() < 0.4 && groove.at_mm.x.abs() < 0.2, "{groove:?}");
}

/// A plate of 12 × 4 × 12 mm with a square hole along y.
fn plate_with_hole(hole_mm: f64) -> Mesh<Block> {
    plate_cut_to(hole_mm, None)
}

/// The same plate, with the hole from +y to a floor, or through.
fn plate_cut_to(hole_mm: f64, floor_y: Option<f64>) -> Mesh<Block> {
    let ring = |half: f64, y: f64| {
        [[-half, -half], [half, -half], [half, half], [-half, half]].map(|[x, z]| Point::new(x, y, z))
    };
    let half = 0.5 * hole_mm;
    let rings = [ring(6.0, 2.0), ring(half, 2.0), ring(6.0, -2.0), ring(half, floor_y.unwrap_or(-2.0))];
    let mut triangles = Vec::new();
    let mut quad = |a: u32, b: u32, c: u32, d: u32| triangles.extend([[a, b, c], [a, c, d]]);
    for k in 0..4 {
        let n = (k + 1) % 4;
        // x to z is clockwise seen from +y
        quad(k, 4 + k, 4 + n, n);
        quad(k, n, 8 + n, 8 + k);
        quad(4 + k, 12 + k, 12 + n, 4 + n);
        if floor_y.is_none() {
            quad(8 + k, 8 + n, 12 + n, 12 + k);
        }
    }
    if floor_y.is_some() {
        quad(15, 14, 13, 12);
        quad(8, 9, 10, 11);
    }
    Mesh { vertices: rings.concat(), triangles }
}

#[test]
fn square_holes_and_pockets_keep_the_side_load_in_their_corners_and_nothing_in_them_comes_loose() {
    let mill = EndMill { radius_mm: 1.0, ..flat() };
    for (diameters, floor_y) in
        [(2.0, None), (2.3, None), (2.67, None), (3.1, None), (2.0, Some(-1.0)), (2.67, Some(-1.0))]
    {
        let side_mm = diameters * mill.diameter_mm();
        let part = plate_cut_to(side_mm, floor_y);
        let removed_mm3 = side_mm * side_mm * (2.0 - floor_y.unwrap_or(-2.0));
        assert!((part.volume_mm3() - (144.0 * 4.0 - removed_mm3)).abs() < 1e-9);
        let job = quick(&part, mill.clone());
        let (_, proof, _) = proven(&part, &job);
        is_clean(&proof, &job);
    }
}

#[test]
fn a_hole_is_cut_where_the_cutter_fits_and_told_where_not() {
    let wide = plate_with_hole(6.0);
    assert!((wide.volume_mm3() - (144.0 - 36.0) * 4.0).abs() < 1e-9);
    let job = quick(&wide, flat());
    let (_, proof, proof_job) = proven(&wide, &job);
    is_clean(&proof, &job);
    // what stays is in the hole's corners, where a round cutter does not come
    for place in proof.uncut(job.process.finishing_step_mm, &proof_job) {
        assert!(
            place.at_mm.x.abs() > 2.0 && place.at_mm.x.abs() < 3.1 && place.at_mm.z.abs() > 2.0,
            "{place:?}"
        );
    }
    let narrow = plate_with_hole(2.0);
    let (planned, proof, _) = proven(&narrow, &quick(&narrow, flat()));
    is_clean(&proof, &job);
    assert!(
        planned.left.is_empty() || planned.left.iter().all(|l| l.volume_mm3 < 20.0),
        "{:?}",
        planned.left
    );
    assert!(proof.thickest_uncut_mm > 0.5, "{}", proof.thickest_uncut_mm);
}

/// For every cut: its length across, mm, and the area from which it takes more than the depth of cut at once, mm²; on cells of 0.1 mm.
fn too_deep(planned: &Machining, job: &MachiningJob) -> Vec<(f64, f64)> {
    const CELL_MM: f64 = 0.1;
    let (low, high) = (job.block.low_mm, job.block.high_mm);
    let dims = [high.x - low.x, high.z - low.z].map(|side| (side / CELL_MM) as usize);
    let mut stock = vec![[low.y, high.y]; dims[0] * dims[1]];
    let mut found = Vec::new();
    for pair in planned.moves.windows(2).filter(|pair| pair[0].a_rad == pair[1].a_rad) {
        let (from, to) = (pair[0].tip_mm, pair[1].tip_mm);
        let front = Facing::of(pair[1].a_rad) == Facing::Front;
        let across = (to - from).xz().norm();
        let steps = (across / (0.5 * CELL_MM)).ceil().max(1.0) as usize;
        let mut cells = 0;
        for n in 1..=steps {
            let tip = from + (to - from) * (n as f64 / steps as f64);
            let (x, z) = (tip.x - low.x, tip.z - low.z);
            let cell = |at: f64, most: usize| ((at / CELL_MM).max(0.0) as usize).min(most);
            let span = |at: f64, most: usize| {
                cell(at - job.tool.radius_mm, most)..cell(at + job.tool.radius_mm + CELL_MM, most)
            };
            for k in span(z, dims[1]) {
                for i in span(x, dims[0]) {
                    let off = ((i as f64 + 0.5) * CELL_MM - x).hypot((k as f64 + 0.5) * CELL_MM - z);
                    let Some(above) = job.tool.profile_mm(off) else { continue };
                    let column = &mut stock[i + dims[0] * k];
                    let before = *column;
                    if front {
                        column[1] = column[1].min(tip.y + above);
                    } else {
                        column[0] = column[0].max(tip.y - above);
                    }
                    let thick = |[bottom, top]: [f64; 2]| (top - bottom).max(0.0);
                    cells += usize::from(thick(before) - thick(*column) > job.level_mm() + 0.02);
                }
            }
        }
        found.push((across, cells as f64 * CELL_MM * CELL_MM));
    }
    assert!(stock.iter().any(|[bottom, top]| top <= bottom), "the channel goes through");
    found
}

#[test]
fn no_cut_is_deeper_than_the_depth_of_cut_but_in_slivers_that_roughing_leaves() {
    let shell = Shell {
        outer_mm: 40.0,
        inner_mm: 36.0,
        outline_mm: 7.0,
        bevel_mm: 0.8,
        thickness_mm: 4.0,
        rings: 10,
    };
    let (shell, plate) = (shell.mesh(), plate_with_hole(6.0));
    for (part, corner_radius_mm) in [(&shell, 0.0), (&shell, 1.5875), (&plate, 0.5)] {
        let job = quick(part, EndMill { corner_radius_mm, ..flat() });
        // a tenth of the diameter, and a cell
        let sliver_mm = 0.1 * job.tool.diameter_mm() + 0.1;
        for (across_mm, area_mm2) in too_deep(&plan(part, &job).unwrap(), &job) {
            let most_mm2 = sliver_mm * (across_mm + job.tool.radius_mm);
            assert!(area_mm2 <= most_mm2, "corner {corner_radius_mm}: {area_mm2} mm² in {across_mm} mm");
        }
    }
}

#[test]
fn the_same_part_gives_the_same_moves_on_any_number_of_threads() {
    let shell =
        Shell { outer_mm: 40.0, inner_mm: 36.0, outline_mm: 5.0, bevel_mm: 0.5, thickness_mm: 3.0, rings: 8 };
    let part = shell.mesh();
    let job = quick(&part, flat());
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| plan(&part, &job).unwrap().moves)
    };
    assert_eq!(on(1), on(3));
}

#[test]
fn a_part_outside_its_block_or_in_the_grip_is_refused_with_the_place() {
    let part = plate_with_hole(6.0);
    let mut low = job(&part, flat());
    low.block.grip_mm = 12.0;
    assert!(matches!(plan(&part, &low), Err(MachiningError::Outside { axis: 'z', .. })));
    let mut small = job(&part, flat());
    small.block.high_mm = Vector3::new(5.0, 10.0, 20.0);
    assert!(matches!(plan(&part, &small), Err(MachiningError::Outside { axis: 'x', .. })));
    let mut bad = job(&part, flat());
    bad.process.side_load = f64::NAN;
    assert!(matches!(plan(&part, &bad), Err(MachiningError::Value { what: "side load", .. })));
    let empty = Mesh { vertices: vec![], triangles: vec![] };
    assert!(matches!(plan(&empty, &job(&part, flat())), Err(MachiningError::Mesh { .. })));
}

#[test]
fn a_time_that_is_too_short_is_answered_with_what_would_meet_it() {
    let part = plate_with_hole(6.0);
    let mut short = quick(&part, flat());
    let takes_s = plan(&part, &short).unwrap().times.limited_s;
    short.machine.max_time_min = Some(takes_s / 60.0 * 0.8);
    let planned = plan(&part, &short).unwrap();
    let told = planned.warnings.iter().find_map(|w| match w {
        bonemill_prosthesis::machining::Warning::Time { feed_per_tooth_mm, .. } => *feed_per_tooth_mm,
        _ => None,
    });
    let feed = told.unwrap();
    assert!(feed > short.process.feed_per_tooth_mm && feed < 4.0 * short.process.feed_per_tooth_mm, "{feed}");
    // it does, and not by much
    let time_s = |feed: f64| {
        short.process.feed_per_tooth_mm = feed;
        plan(&part, &short).unwrap().times.limited_s
    };
    let [met_s, missed_s] = [feed, 0.97 * feed].map(time_s);
    assert!(
        met_s <= 0.8 * takes_s && missed_s > 0.8 * takes_s,
        "{met_s} and {missed_s} of {} s",
        0.8 * takes_s
    );
}

#[test]
fn the_rotary_axis_keeps_its_speed_and_turns_with_the_tip_at_rest() {
    let mut job = job(&plate_with_hole(6.0), flat());
    // up, half a turn in place and down again: the machine's Z is the block's y, then its reverse
    let at = |y: f64, a_rad: f64| TipMove {
        side: Side::B,
        kind: Kind::Link,
        tip_mm: Vector3::new(0.0, y, 0.0),
        a_rad,
        feed_mm_min: 1524.0,
        time_s: 0.0,
    };
    let half = std::f64::consts::PI;
    let mut moves = [at(20.0, 0.0), at(30.0, 0.0), at(-30.0, half), at(-20.0, half)];
    let [fast, slow] = [0.7, 0.1].map(|rotary_rad_s| {
        job.machine.rotary_rad_s = rotary_rad_s;
        times(&mut moves, &job).unwrap()
    });
    let straight_s = 20.0 / 1524.0 * 60.0;
    assert!((fast.constant_s - half / 0.7 - straight_s).abs() < 1e-9, "{fast:?}");
    assert!((slow.constant_s - half / 0.1 - straight_s).abs() < 1e-9, "{slow:?}");
    for times in [fast, slow] {
        assert!((times.constant_s..times.constant_s + 2.0).contains(&times.limited_s), "{times:?}");
    }
}

#[test]
fn a_program_reads_back_as_the_moves() {
    let shell =
        Shell { outer_mm: 40.0, inner_mm: 36.0, outline_mm: 5.0, bevel_mm: 0.5, thickness_mm: 3.0, rings: 8 };
    let part = shell.mesh();
    let moves = plan(&part, &quick(&part, flat())).unwrap().moves;
    let program = gcode::read(&write(&moves, &quick(&part, flat()), "a test", &[])).unwrap();
    let ends: Vec<Vector3<f64>> = program.motions.iter().filter(|m| !m.turns).map(|m| m.to_mm).collect();
    let places =
        moves.iter().map(|m| bonemill_prosthesis::machining::Facing::of(m.a_rad).from_block(&m.tip_mm));
    let mut places: Vec<Vector3<f64>> = places.collect();
    places.dedup();
    let found = places.iter().skip(1).filter(|p| ends.iter().any(|e| (*e - **p).norm() < 1e-9)).count();
    assert_eq!(found, places.len() - 1);
    assert!(program.motions.iter().filter(|m| !m.rapid).all(|m| m.spindle_rpm == 8500.0));
}
