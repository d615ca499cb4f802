//! A milling machine's program from a toolpath: G-code that drives exactly the moves.
//!
//! The machine has X along the rotary axis A, Z along the spindle and its zero on the rotary axis at the frame's origin. A point (x, y, z) of the block's frame is
//! at X = x, Y = −z, Z = y for A = 0 and at X = x, Y = z, Z = −y for A = 180°. Cuts are G1 with their feed, repositioning is G0, and between the sides A
//! turns while the tip stands above the block's swing. The moves are whole micrometres, so three decimals lose nothing: what is read back is what was
//! planned.
//!
//! The program first cancels what another left on (G40 G49 G80), takes Z to the machine's top, `G53 G0 Z0`, and only then turns A and goes to X and Y.
//! One whose plan falls short stops in its first line, `M0`, with the reason.
//!
//! **Source:** Castelli et al. 2020, section 4.3: set-up, sides A and B with half a turn between, contour, home, off. Words and modes: ISO 6983-1; the dwell's
//! unit and the decimal point: LinuxCNC 2.9 G-code reference (G4 P in seconds), Fanuc 30i operator's manual B-64484 and Haas mill operator's manual, G04
//! (P without a point in milliseconds; a number without a point is in the least increment).
//!
//! ```
//! # use bonemill_case::prosthesis::{CutSense, GCode, MachineKind, MachineSpec, OnFlange, ProcessSpec};
//! # use bonemill_prosthesis::machining::{Block, EndMill, Kind, MachiningJob, Side, TipMove};
//! # let job = MachiningJob {
//! #     block: Block { low_mm: [-20.0, -8.0, -30.0].into(), high_mm: [20.0, 8.0, 20.0].into(), grip_mm: 10.0 },
//! #     tool: EndMill { radius_mm: 1.5, corner_radius_mm: 0.0, flutes: 1, length_mm: 20.0, holder: vec![] },
//! #     process: ProcessSpec {
//! #         spindle_rpm: 8500.0, feed_per_tooth_mm: 0.04, side_load: 0.6, depth_of_cut: 0.7, finishing_step_mm: 0.1, strip_mm: 1.0,
//! #         clearance_mm: 3.0, sense: CutSense::Climb,
//! #     },
//! #     machine: MachineSpec {
//! #         kind: MachineKind::FiveAxis, dialect: GCode::Haas, on_flange: OnFlange::Spindle,
//! #         travel_mm: [200.0; 3], rotary_range_rad: [-6.3, 6.3], max_feed_mm_min: 1500.0, rapid_mm_min: 1500.0, rotary_rad_s: 1.0,
//! #         acceleration_mm_s2: 500.0, jerk_mm_s3: 5000.0, max_time_min: None,
//! #     },
//! # };
//! use bonemill_prosthesis::program::write;
//! let to = |kind, y| TipMove { side: Side::A, kind, tip_mm: [1.0, y, -3.0].into(), a_rad: 0.0, feed_mm_min: 340.0, time_s: 0.0 };
//! let text = write(&[to(Kind::Link, 12.0), to(Kind::Rough, 2.5)], &job, "a test", &[]);
//! assert!(text.contains("G53 G0 Z0.000\nT1 M6\nG0 A0.000\n") && text.contains("G0 X1.000 Y3.000\nG0 Z12.000\nG1 Z2.500 F340.00\n"));
//! assert!(text.contains("G4 P3000\n") && text.contains("(block at A0: X -20.000 to 20.000, Y -20.000 to 30.000, Z -8.000 to 8.000)"));
//! ```

use std::fmt::Write;

use bonemill_case::prosthesis::GCode;

use crate::machining::{Facing, MachiningJob, Side, TipMove};

/// The line above the moves that cut the outline.
pub const OUTLINE: &str = "(side C: outline)";
/// How long the spindle is given to reach its speed, s. Assumed.
const SPIN_UP_S: u32 = 3;
/// Longest comment; LinuxCNC reads lines of up to 255 characters.
const COMMENT: usize = 200;

/// The program of some moves. The first places the tip above the block; the program ends there too, the spindle off.
///
/// `made_for` says what it was made for, in a comment. `shortfalls` are why it must not be run: with any, it stops in its first line.
pub fn write(moves: &[TipMove], job: &MachiningJob, made_for: &str, shortfalls: &[String]) -> String {
    let dialect = job.machine.dialect;
    let mut text = Text::default();
    text.head(job, made_for, shortfalls);
    let mut side = None;
    for step in moves {
        let a_deg = match Facing::of(step.a_rad) {
            Facing::Front => 0,
            Facing::Back if step.a_rad < 0.0 => -180,
            Facing::Back => 180,
        };
        if text.a_deg != Some(a_deg) {
            text.turn(a_deg);
        }
        if side.is_none() {
            text.line(&format!("S{:.0} M3", job.process.spindle_rpm));
            text.line(&match dialect {
                GCode::LinuxCnc => format!("G4 P{SPIN_UP_S}"),
                GCode::Fanuc | GCode::Haas => format!("G4 P{}", 1000 * SPIN_UP_S),
            });
        }
        if side != Some(step.side) {
            text.line(title(step.side));
            side = Some(step.side);
        }
        text.step(step);
    }
    text.home();
    if dialect != GCode::LinuxCnc {
        text.line("%");
    }
    text.out
}

/// Plain characters in parentheses, as every controller reads them.
fn comment(text: &str) -> String {
    let mut plain = String::new();
    for letter in text.chars() {
        match letter {
            '(' => plain.push('['),
            ')' => plain.push(']'),
            '²' => plain.push('2'),
            '³' => plain.push('3'),
            '°' => plain.push_str(" deg"),
            '×' => plain.push('x'),
            '−' => plain.push('-'),
            ' '..='~' => plain.push(letter),
            _ => plain.push('?'),
        }
    }
    plain.truncate(COMMENT);
    format!("({plain})")
}

fn title(side: Side) -> &'static str {
    match side {
        Side::A => "(side A)",
        Side::B => "(side B)",
        Side::C => OUTLINE,
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

    /// What must hold before the first motion, and what is mounted.
    fn head(&mut self, job: &MachiningJob, made_for: &str, shortfalls: &[String]) {
        match job.machine.dialect {
            GCode::LinuxCnc => {}
            GCode::Fanuc => self.line("%\nO0001"),
            GCode::Haas => self.line("%\nO00001"),
        }
        match shortfalls {
            [] => self.line("(bonemill: a part from a block, X Y Z in mm, A in degrees)"),
            [first, more @ ..] => {
                let more =
                    if more.is_empty() { String::new() } else { format!("; {} more reasons", more.len()) };
                self.line(&format!("M0 {}", comment(&format!("DO NOT RUN: {first}{more}"))));
            }
        }
        let (block, tool) = (&job.block, &job.tool);
        let [low, high] = block.at_a0_mm();
        self.line(
            "(zero: X0 Y0 Z0 with the cutter's tip on the rotary axis A, X along it, Z along the spindle)",
        );
        self.line(&comment(&format!(
            "block at A0: X {:.3} to {:.3}, Y {:.3} to {:.3}, Z {:.3} to {:.3}",
            low.x, high.x, low.y, high.y, low.z, high.z
        )));
        self.line(&comment(&format!("grip at A0: Y {:.3} to {:.3}", high.y - block.grip_mm, high.y)));
        self.line(&comment(&format!(
            "T1: diameter {:.3}, corner radius {:.3}, flutes {}, {:.3} from tip to holder",
            tool.diameter_mm(),
            tool.corner_radius_mm,
            tool.flutes,
            tool.length_mm
        )));
        self.line(&comment(made_for));
        self.line("G17 G21 G40 G49 G80 G90 G94 G54");
        self.line("G53 G0 Z0.000");
        self.line("T1 M6");
    }

    fn turn(&mut self, a_deg: i32) {
        self.line(&format!("G0 A{a_deg}.000"));
        self.a_deg = Some(a_deg);
    }

    fn step(&mut self, step: &TipMove) {
        let machine = Facing::of(step.a_rad).from_block(&step.tip_mm);
        let to_um = [0, 1, 2].map(|n| (machine[n] * 1000.0).round() as i64);
        let rapid = !step.kind.cuts();
        if self.at_um[2].is_none() {
            // from the machine's top: across, then down
            self.line(&format!("G0 X{} Y{}", decimal(to_um[0]), decimal(to_um[1])));
            self.at_um = [Some(to_um[0]), Some(to_um[1]), None];
        }
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

    /// Up to the machine's top, spindle off, over the zero, A back to 0.
    fn home(&mut self) {
        for line in ["G53 G0 Z0.000", "M5", "G0 X0.000 Y0.000", "G0 A0.000", "M30"] {
            self.line(line);
        }
    }
}

/// Micrometres as millimetres with three decimals.
fn decimal(um: i64) -> String {
    let sign = if um < 0 { "-" } else { "" };
    format!("{sign}{}.{:03}", um.abs() / 1000, um.abs() % 1000)
}
