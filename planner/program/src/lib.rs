//! A milling machine's program from a toolpath: G-code that drives exactly the moves.
//!
//! The machine has X along the rotary axis A, Z along the spindle and its zero on the rotary axis at the frame's origin. A point (x, y, z) of the block's frame is
//! at X = x, Y = −z, Z = y for A = 0 and at X = x, Y = z, Z = −y for A = 180°. Cuts are G1 with their feed, repositioning is G0, and between the sides A
//! turns while the tip stands above the block's swing. The moves are whole micrometres, so three decimals lose nothing: what is read back is what was
//! planned.
//!
//! **Source:** Castelli et al. 2020, section 4.3: set-up, sides A and B with half a turn between, contour, home, off. Words and modes: ISO 6983-1.
//!
//! ```
//! use bonemill_machining::{Kind, Move, Side};
//! let cut = Move { side: Side::A, kind: Kind::Rough, tip_mm: [1.0, 2.5, -3.0].into(), a_rad: 0.0, feed_mm_min: 323.85, time_s: 0.0 };
//! let text = bonemill_program::write(&[cut], 8500.0);
//! assert!(text.contains("G1 X1.000 Y3.000 Z2.500 F323.85"));
//! ```

use std::fmt::Write;

use bonemill_machining::{Facing, Move, Side};

/// The program of some moves. The first places the tip above the block; the program ends there too, the spindle off.
pub fn write(moves: &[Move], spindle_rpm: f64) -> String {
    let mut text = Text::default();
    text.line("(bonemill: a part from a block, X Y Z in mm, A in degrees)");
    text.line("(zero on the rotary axis, X along it, Z along the spindle, side A faces the spindle at A0)");
    text.line("G21 G90 G17 G94 G54");
    text.line("T1 M6");
    let mut side = None;
    for step in moves {
        let a_deg = if Facing::of(step.a_rad) == Facing::Front { 0 } else { 180 };
        if text.a_deg != Some(a_deg) {
            text.turn(a_deg);
        }
        if side.is_none() {
            text.line(&format!("S{spindle_rpm:.0} M3"));
            text.line("G4 P3");
        }
        if side != Some(step.side) {
            text.line(title(step.side));
            side = Some(step.side);
        }
        text.step(step);
    }
    text.home(moves);
    text.out
}

fn title(side: Side) -> &'static str {
    match side {
        Side::A => "(side A)",
        Side::B => "(side B)",
        Side::C => "(side C: outline)",
    }
}

/// Text and the words that hold so far.
#[derive(Debug, Default)]
struct Text {
    out: String,
    at_um: [Option<i64>; 3],
    a_deg: Option<i32>,
    feed_mm_min: Option<f64>,
}

impl Text {
    fn line(&mut self, line: &str) {
        self.out.push_str(line);
        self.out.push('\n');
    }

    fn turn(&mut self, a_deg: i32) {
        self.line(&format!("G0 A{a_deg}"));
        self.a_deg = Some(a_deg);
    }

    fn step(&mut self, step: &Move) {
        let machine = Facing::of(step.a_rad).from_block(&step.tip_mm);
        let to_um = [0, 1, 2].map(|n| (machine[n] * 1000.0).round() as i64);
        let rapid = !step.kind.cuts();
        let mut words = String::new();
        for (n, letter) in ['X', 'Y', 'Z'].into_iter().enumerate() {
            if self.at_um[n] != Some(to_um[n]) {
                // writing to a string does not fail
                let _ = write!(words, " {letter}{}", decimal(to_um[n]));
            }
        }
        if words.is_empty() {
            return;
        }
        let feed = (!rapid && self.feed_mm_min != Some(step.feed_mm_min)).then_some(step.feed_mm_min);
        if let Some(feed) = feed {
            let _ = write!(words, " F{feed:.2}");
            self.feed_mm_min = Some(feed);
        }
        let mode = if rapid { "G0" } else { "G1" };
        self.at_um = to_um.map(Some);
        self.line(&format!("{mode}{words}"));
    }

    /// Up to the height of the first move, over the origin, A back to 0, spindle off.
    fn home(&mut self, moves: &[Move]) {
        if let Some(first) = moves.first() {
            let top = Facing::of(first.a_rad).from_block(&first.tip_mm).z;
            self.line(&format!("G0 Z{}", decimal((top * 1000.0).round() as i64)));
            self.line("G0 X0.000 Y0.000");
            self.line("G0 A0");
        }
        self.line("M5");
        self.line("M30");
    }
}

/// Micrometres as millimetres with three decimals.
fn decimal(um: i64) -> String {
    let sign = if um < 0 { "-" } else { "" };
    format!("{sign}{}.{:03}", um.abs() / 1000, um.abs() % 1000)
}
