//! Programs and parts small enough to know the answer.

use bonemill_geometry::{Block, Mesh, Point};
use nalgebra::Vector3;

use crate::proof::gcode::{self, SideUp};
use crate::proof::{ProofError, ProofJob, Struck, prove};

const HEAD: &str = "G21 G90 G94\nG53 G0 Z0\nG0 X0 Y0 A0\nG0 Z30 S8000 M3\n";

fn job() -> ProofJob {
    ProofJob {
        low_mm: Vector3::new(-10.0, -5.0, -10.0),
        high_mm: Vector3::new(10.0, 5.0, 10.0),
        grip_mm: 2.0,
        radius_mm: 1.5,
        corner_radius_mm: 0.0,
        length_mm: 12.0,
        holder_mm: vec![[20.0, 6.0]],
        widest_mm: 1.8,
        entry_mm: 1.0,
        clearance_mm: 0.2,
        flutes: 1,
        sample_mm: 0.25,
        kept: vec![],
    }
}

/// A box in the block's frame.
fn part(low: [f64; 3], high: [f64; 3]) -> Mesh<Block> {
    let corner = |n: usize| {
        let [x, y, z] = [0, 1, 2].map(|a| if n >> a & 1 == 0 { low[a] } else { high[a] });
        Point::new(x, y, z)
    };
    let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = faces.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
    Mesh { vertices: (0..8).map(corner).collect(), triangles }
}

/// Rows over the whole block at a height, from the front.
fn faced(height_mm: f64) -> String {
    let mut text = HEAD.to_owned();
    for row in 0..=20 {
        let y = -10.0 + f64::from(row);
        text += &format!("G0 X-12 Y{y}\nG1 Z{height_mm} F300\nG1 X12\nG0 Z30\n");
    }
    text + "M5\nM30\n"
}

#[test]
fn a_faced_top_deviates_by_how_much_too_high_or_low_it_is() {
    for (height_mm, expected) in [(2.0, 0.0), (2.3, 0.3), (1.9, -0.1)] {
        let proof = prove(&faced(height_mm), &part([-4.0, -2.0, -4.0], [4.0, 2.0, 4.0]), &job()).unwrap();
        let top = proof.samples.iter().filter(|s| s.at_mm.y > 1.999 && s.area_mm2 > 0.0);
        let worst = top.map(|s| (s.deviation_mm - expected).abs()).fold(0.0, f64::max);
        assert!(worst < 1e-9, "at {height_mm}: {worst}");
        assert!((proof.deepest_gouge_mm - (-expected).max(0.0)).abs() < 1e-9);
    }
}

#[test]
fn a_wall_is_gouged_sideways_by_its_depth_and_not_by_its_height() {
    // the cutter passes at 1.5 − 0.05 from a wall of 4 mm
    let text = format!("{HEAD}G0 X-12 Y-5.45\nG1 Z-2 F300\nG1 X12\nG0 Z30\nM5\nM30\n");
    let proof = prove(&text, &part([-4.0, -2.0, -4.0], [4.0, 2.0, 4.0]), &job()).unwrap();
    assert!((proof.deepest_gouge_mm - 0.05).abs() < 1e-6, "{}", proof.deepest_gouge_mm);
    assert!((proof.gouge_at_mm.z - 4.0).abs() < 1e-9, "{:?}", proof.gouge_at_mm);
}

#[test]
fn deviation_is_that_of_brute_force_for_a_sloping_bull_nose() {
    let mut job = job();
    job.corner_radius_mm = 0.6;
    let text = format!("{HEAD}G0 X-3 Y-1\nG1 Z2.1 F300\nG1 X3 Y1.5 Z3.3\nG0 Z30\nM5\nM30\n");
    let part = part([-4.0, -2.0, -4.0], [4.0, 2.0, 4.0]);
    let proof = prove(&text, &part, &job).unwrap();
    let cutter = crate::proof::cutter::CutterShape { radius_mm: 1.5, corner_mm: 0.6 };
    let motions = gcode::read(&text).unwrap().motions;
    for sample in proof.samples.iter().step_by(97) {
        let p = SideUp::Front.machine(&sample.at_mm);
        let mut least: f64 =
            (0..3).map(|n| 10.0_f64.min([10.0, 5.0, 10.0][n] - sample.at_mm[n].abs())).fold(3.0, f64::min);
        for motion in &motions {
            let at = |k: u32| motion.from_mm + (motion.to_mm - motion.from_mm) * (f64::from(k) / 2000.0);
            least = (0..=2000).map(|k| cutter.distance_mm(&(p - at(k)))).fold(least, f64::min);
        }
        assert!((sample.deviation_mm - least).abs() < 5e-3, "{} for {least}", sample.deviation_mm);
    }
}

#[test]
fn moves_of_a_hundred_metres_count_where_they_are_over_the_block() {
    let part = part([-4.0, -2.0, -4.0], [4.0, 2.0, 4.0]);
    let proved = |x: f64| {
        // one cut through the block from far away, and a thousand moves beside and above it
        let away = format!("G1 X{x} Y{x} F300\nG1 X{x} Y-{x}\n").repeat(500);
        let text = format!("{HEAD}G0 Z60\n{away}G0 X-{x} Y-5.45\nG0 Z-2\nG1 X{x} F300\n{away}M5\nM30\n");
        prove(&text, &part, &job()).unwrap()
    };
    let (near, far) = (proved(20.0), proved(1e5));
    assert!((far.deepest_gouge_mm - 0.05).abs() < 1e-6, "{}", far.deepest_gouge_mm);
    let deviations =
        |proof: &crate::proof::Proof| proof.samples.iter().map(|s| s.deviation_mm).collect::<Vec<_>>();
    let apart =
        deviations(&near).iter().zip(deviations(&far)).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(apart < 1e-6, "{apart}");
    assert!((near.widest_mm - far.widest_mm).abs() <= near.column_mm, "{} {}", near.widest_mm, far.widest_mm);
    assert_eq!(near.collisions.len(), far.collisions.len());
}

#[test]
fn a_slot_is_as_wide_as_the_cutter_and_a_shallow_one_is_an_entry() {
    let slot = |depth: f64| format!("{HEAD}G0 X-12 Y0\nG1 Z{} F300\nG1 X12\nG0 Z30\nM5\nM30\n", 5.0 - depth);
    let far = part([-9.0, -4.0, -9.0], [-8.0, -3.0, -8.0]);
    let deep = prove(&slot(2.0), &far, &job()).unwrap();
    assert!((deep.widest_mm - 3.0).abs() < 2.0 * deep.column_mm, "{}", deep.widest_mm);
    assert_eq!(deep.too_wide.len(), 1);
    let shallow = prove(&slot(0.9), &far, &job()).unwrap();
    assert_eq!((shallow.widest_mm, shallow.too_wide.len()), (0.0, 0));
    // beside a slot, a row 1 mm on is 1 mm wide
    let beside = slot(0.9).replace("M5\nM30\n", "G0 X-12 Y1\nG1 Z3.5 F300\nG1 X12\nG0 Z30\nM5\nM30\n");
    let beside = prove(&beside, &far, &job()).unwrap();
    assert!((beside.widest_mm - 1.0).abs() < 2.0 * beside.column_mm, "{}", beside.widest_mm);
}

#[test]
fn a_width_near_the_allowed_one_is_known_to_a_quarter_of_a_column() {
    let far = part([-9.0, -4.0, -9.0], [-8.0, -3.0, -8.0]);
    // a shallow slot askew to the columns, then a row beside it
    let beside = |width_mm: f64| {
        let row = |off: f64, z: f64, half: f64| {
            let [x, y] = [-0.6 * off, 0.8 * off];
            let (start, end) = (
                format!("X{:.3} Y{:.3}", x - 0.8 * half, y - 0.6 * half),
                format!("X{:.3} Y{:.3}", x + 0.8 * half, y + 0.6 * half),
            );
            format!("G0 {start}\nG1 Z{z} F300\nG1 {end}\nG0 Z30\n")
        };
        prove(&format!("{HEAD}{}{}M5\nM30\n", row(0.0, 4.1, 12.0), row(width_mm, 3.5, 6.0)), &far, &job())
            .unwrap()
    };
    for width_mm in [1.71, 1.75, 1.79, 1.86, 1.9, 1.97] {
        let proof = beside(width_mm);
        let finer_mm = proof.column_mm / 4.0;
        assert_eq!(
            proof.too_wide.len(),
            usize::from(width_mm > 1.8 + finer_mm),
            "{width_mm}: {}",
            proof.widest_mm
        );
        let off_mm = proof.widest_mm - width_mm;
        assert!(
            (-finer_mm..2.0 * finer_mm).contains(&off_mm) || proof.widest_mm <= 1.8,
            "{width_mm}: {off_mm}"
        );
    }
}

#[test]
fn rapid_moves_holder_and_turns_are_seen_in_the_stock() {
    let far = part([-9.0, -4.0, -9.0], [-8.0, -3.0, -8.0]);
    let struck = |body: &str, job: &ProofJob| {
        let proof = prove(&format!("{HEAD}{body}M5\nM30\n"), &far, job).unwrap();
        proof.collisions.iter().map(|c| (c.struck, c.line)).collect::<Vec<_>>()
    };
    assert_eq!(struck("G0 X0 Y0\nG0 Z4\nG0 Z30\n", &job())[0], (Struck::RapidCutter, 6));
    assert_eq!(struck("G0 X0 Y0\nG1 Z4 F100\nG0 Z30\n", &job()), []);
    let mut short = job();
    short.length_mm = 3.0;
    assert_eq!(struck("G0 X0 Y0\nG1 Z1 F100\nG0 Z30\n", &short)[0], (Struck::Holder, 6));
    assert_eq!(struck("G0 Z8\nG0 A180\n", &job())[0], (Struck::Turn, 6));
    assert_eq!(struck("G0 A180\nG0 A0\n", &job()), []);
}

#[test]
fn what_a_cut_frees_of_the_grip_comes_loose_with_its_volume() {
    let far = part([-9.0, -4.0, -9.0], [-8.0, -3.0, -8.0]);
    let loose = |body: &str| prove(&format!("{HEAD}{body}M5\nM30\n"), &far, &job()).unwrap().loose;
    // a slot right through the block along x: the upper part of 20 × 10 × 6.5 mm is off; machine's Y = −z
    let slot = |y: f64, depth: f64| format!("G0 X-12 Y{y}\nG1 Z{depth} F300\nG1 X12\nG0 Z30\n");
    let [piece] = loose(&slot(-2.0, -5.1)).try_into().unwrap();
    assert_eq!(piece.line, 7);
    assert!((piece.volume_mm3 - 1300.0).abs() < 30.0, "{piece:?}");
    assert!((piece.at_mm - Vector3::new(0.0, 0.0, 6.75)).norm() < 0.1, "{piece:?}");
    // a membrane holds it, and so does a bridge at the slot's end
    assert_eq!(loose(&slot(-2.0, -4.9)), []);
    assert_eq!(loose("G0 X-12 Y-2\nG1 Z-5.1 F300\nG1 X7\nG0 Z30\n"), []);
    // cut half way from either side, it is off with the second cut
    let back = "G0 A180\nG0 X-12 Y2\nG1 Z-0.5 F300\nG1 X12\nG0 Z30\nG0 A0\n";
    let [piece] = loose(&(slot(-2.0, 0.0) + back)).try_into().unwrap();
    assert_eq!(piece.line, 12);
    // of a frame all round, what is milled away is no piece
    assert_eq!(loose(&(-9..=-2).rev().map(|y| slot(f64::from(y), -5.1)).collect::<String>()).len(), 1);
    assert_eq!(loose(&(-9..=-2).map(|y| slot(f64::from(y), -5.1)).collect::<String>()), []);
}

#[test]
fn a_rapid_motion_keeps_its_height_above_the_stock_unless_it_rises() {
    let far = part([-9.0, -4.0, -9.0], [-8.0, -3.0, -8.0]);
    let low = |body: &str| {
        let proof =
            prove(&format!("{HEAD}{body}M5\nM30\n"), &far, &ProofJob { clearance_mm: 3.0, ..job() }).unwrap();
        proof.collisions.iter().map(|c| (c.struck, c.line, c.depth_mm)).collect::<Vec<_>>()
    };
    // the block's top is at 5 mm
    assert_eq!(low("G0 X4 Y4 Z8\nG0 Z30\n"), []);
    let [(Struck::Clearance, 5, short_mm)] = low("G0 X4 Y4 Z7.5\nG0 Z30\n")[..] else { panic!() };
    assert!((short_mm - 0.5).abs() < 1e-9, "{short_mm}");
    assert_eq!(low("G0 Z7.5\nG0 X20\nG0 Z30\n").len(), 2);
    // beside the block, up from a cut, and over what was cut
    assert_eq!(low("G0 X-20\nG0 Z-2\nG0 Z30\n"), []);
    assert_eq!(low("G1 Z3 F100\nG0 Z30\nG0 Z6\nG0 Z30\n"), []);
}

#[test]
fn the_chip_is_the_depth_at_the_front_of_the_cutter_and_less_at_its_side() {
    let far = part([-9.0, -4.0, -9.0], [-8.0, -3.0, -8.0]);
    let chip_mm = |body: &str, flutes: u32| {
        let proof = prove(&format!("{HEAD}{body}M5\nM30\n"), &far, &ProofJob { flutes, ..job() }).unwrap();
        proof.chip_mm(0)
    };
    // a slot of 2 mm: the whole chip is 2 mm deep where the tooth goes along the feed; a second tooth is opposite, a fourth at the side
    let slot = "G0 X-12 Y0\nG1 Z3 F300\nG1 X12\nG0 Z30\n";
    for (flutes, expected) in [(1, 2.0), (2, 2.0), (4, 2.0 * 2f64.sqrt()), (8, 2.0 * (1.0 + 2f64.sqrt()))] {
        let found = chip_mm(slot, flutes);
        assert!((found - expected).abs() < 0.1 * expected, "{flutes}: {found} for {expected}");
    }
    // a row w wide beside it: sin φ = 2 √(w/D (1 − w/D)) at its edge
    for width_mm in [0.3, 0.75] {
        // the width is known to a column
        let expected = |width_mm: f64| 4.0 * (width_mm / 3.0 * (1.0 - width_mm / 3.0)).sqrt();
        let beside = format!("G0 X-12 Y{width_mm}\nG1 Z3 F300\nG1 X12\nG0 Z30\n");
        let both = prove(&format!("{HEAD}{slot}{beside}M5\nM30\n"), &far, &job()).unwrap();
        let found = both.chip_mm(9);
        let [least, most] = [-1.0, 1.0].map(|by| expected(width_mm + by * both.column_mm));
        assert!((least..most).contains(&found), "{width_mm}: {found} for {least} to {most}");
    }
}

#[test]
fn what_is_no_program_of_this_machine_is_refused_with_its_line() {
    let refused = |text: &str| match gcode::read(text) {
        Err(ProofError::Line { line, what }) => (line, what),
        other => panic!("{other:?}"),
    };
    let start = "G21 G90\nG53 G0 Z0\nG0 X0 Y0 A0\nG0 Z5\n";
    for (body, line, said) in [
        ("G1 X1 I1\n", 5, "I1 is not understood"),
        ("G2 X1\n", 5, "G2 is not understood"),
        ("G1.04 X1\n", 5, "G1.04 is not understood"),
        ("M3.5\n", 5, "M3.5 is not understood"),
        ("G1 X1 F10\nM30\n", 5, "a cut with the spindle off or without a feed"),
        ("M3\n", 5, "the spindle starts without a speed"),
        ("G0 A30\n", 5, "A is 30°"),
        ("G0 X0 (open\n", 5, "a comment is not closed"),
        ("M30\nG0 X0\n", 6, "the program goes on after its end"),
        ("G0 X1\n", 5, "the program has no end"),
        ("G0 X1e\n", 5, "a number was expected after e"),
        ("G0 X1 X2\n", 5, "X stands twice"),
        ("G0 G1 X1\n", 5, "G0 and G1 in one line"),
        ("G4 X3\n", 5, "G4 stands with P alone"),
        ("G0 X1 P3\n", 5, "P3 is not understood"),
        ("T1 M6\nT2 M6\n", 6, "T2 would change the cutter"),
        ("T1 M6\nM6\n", 6, "the cutter is changed"),
        ("S100 M3\nT1 M6\n", 6, "the cutter is changed with the spindle on"),
        ("M6\n", 5, "M6 without a T"),
        ("S100 M3\nM30\n", 6, "the program ends with the spindle on"),
        ("G53 G0 Z-5\n", 5, "G53 is understood as G53 G0 Z0 only"),
        ("G53 G0 X0\n", 5, "G53 is understood as G53 G0 Z0 only"),
        ("G53 G0 Z0\nG0 X1 Z3\n", 6, "Z comes down from the machine's top together"),
    ] {
        let (at, what) = refused(&format!("{start}{body}"));
        assert!(at == line && what.contains(said), "{body}: line {at}: {what}");
    }
    assert_eq!(refused("G20\n").0, 1);
    assert_eq!(refused("G0 X0\n"), (1, "a motion before G21 and G90".into()));
    // where the axes stand at first is unknown
    for first in ["G0 Z-30", "G0 X0 Y0 Z5 A0", "G0 A0"] {
        let (line, what) = refused(&format!("G21 G90\n{first}\n"));
        assert!(line == 2 && what.contains("a motion before X, Y, Z and A have a place"), "{line}: {what}");
    }
    assert_eq!(
        refused("G21 G90\nG53 G0 Z0\nG0 X0 A0\nG0 Z5\n"),
        (4, "Z comes down before X, Y and A have a place".into())
    );
    // a turn without end is no front
    assert_eq!(refused(&format!("{start}G0 A{}\n", "9".repeat(400))).0, 5);
    let whole = "%\nO0001\nG17 G21 G40 G49 G80 G90 G94 G54\nT1 M6\nG53 G0 Z0.000\nS100 M3\nG4 P3\nG0 X0 Y0 A0\nG0 Z5\nM0 (look)\nM5\nM30\n%\n";
    assert_eq!(gcode::read(whole).unwrap().motions.len(), 1);
}

#[test]
fn bad_input_is_an_error_and_no_panic() {
    let good = part([-4.0, -2.0, -4.0], [4.0, 2.0, 4.0]);
    let mut bad = job();
    bad.sample_mm = f64::NAN;
    assert!(matches!(prove(&faced(2.0), &good, &bad), Err(ProofError::Value { .. })));
    let mut broken = good.clone();
    broken.triangles[3] = [0, 1, 99];
    assert!(matches!(prove(&faced(2.0), &broken, &job()), Err(ProofError::Mesh { facet: 3 })));
    let mut fine = job();
    fine.sample_mm = 0.02;
    let huge = part([-400.0, -200.0, -400.0], [400.0, 200.0, 400.0]);
    assert!(matches!(prove(&faced(2.0), &huge, &fine), Err(ProofError::TooFine { .. })));
}
