//! A small G-code interpreter: a program's text as straight motions of X, Y, Z and turns of A.
//!
//! Understood: G0, G1, G4, G17, G21, G90, G94, G54; M3, M5, M6, M30, M2; X Y Z A F S T P N; comments in parentheses and after a semicolon.
//! Everything else is refused with its line: a word that is passed over silently could be a motion.
//!
//! **Source:** words and modes: ISO 6983-1; RS274/NGC, Kramer, Proctor & Messina 2000.

use nalgebra::Vector3;

use crate::ProofError;

/// Which side faces the spindle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Facing {
    /// A = 0.
    Front,
    /// A = ±180°.
    Back,
}

impl Facing {
    /// The block's frame to the machine's axes.
    pub fn machine(self, p: &Vector3<f64>) -> Vector3<f64> {
        match self {
            Self::Front => Vector3::new(p.x, -p.z, p.y),
            Self::Back => Vector3::new(p.x, p.z, -p.y),
        }
    }
}

/// A straight motion of the tip in the machine's axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// Start, mm.
    pub from_mm: Vector3<f64>,
    /// End, mm.
    pub to_mm: Vector3<f64>,
    /// Side that faces the spindle.
    pub facing: Facing,
    /// Angle of the rotary axis at its end, degrees.
    pub a_deg: f64,
    /// G0.
    pub rapid: bool,
    /// Whether the block is turned in it.
    pub turns: bool,
    /// F, mm/min; 0 for G0.
    pub feed_mm_min: f64,
    /// S, 1/min.
    pub spindle_rpm: f64,
    /// Line of the program, from 1.
    pub line: usize,
}

/// What a program does.
#[derive(Debug, Clone, PartialEq)]
pub struct Program {
    /// Motions in their order.
    pub motions: Vec<Motion>,
}

/// Modes and places while a program is read.
#[derive(Debug, Default)]
struct Machine {
    at: [Option<f64>; 3],
    a_deg: Option<f64>,
    rapid: Option<bool>,
    feed_mm_min: f64,
    speed_rpm: f64,
    spindle: bool,
    millimetres: bool,
    absolute: bool,
    ended: bool,
}

/// Reads a program.
///
/// # Errors
/// [`ProofError::Line`] with the first line that is not understood, cuts with the spindle off, without a feed, before the axes have a place or at an
/// angle other than 0 or 180°, or follows the program's end; and for a program that never ends.
pub fn read(text: &str) -> Result<Program, ProofError> {
    let mut machine = Machine::default();
    let mut program = Program { motions: vec![] };
    let mut last = 0;
    for (n, line) in text.lines().enumerate() {
        last = n + 1;
        let words = words(line).and_then(|words| machine.run(&words, last));
        let motion = words.map_err(|what| ProofError::Line { line: last, what })?;
        program.motions.extend(motion);
    }
    if !machine.ended {
        return Err(ProofError::Line {
            line: last,
            what: "the program has no end: M30 or M2 was expected".into(),
        });
    }
    Ok(program)
}

/// Letters and numbers of a line without its comments.
fn words(line: &str) -> Result<Vec<(char, f64)>, String> {
    let mut words = Vec::new();
    let mut rest = line.trim_start();
    while let Some(letter) = rest.chars().next() {
        if letter == '(' {
            let end = rest.find(')').ok_or("a comment is not closed: ) was expected")?;
            rest = rest[end + 1..].trim_start();
            continue;
        }
        if letter == ';' || letter == '%' && rest.len() == 1 {
            break;
        }
        if !letter.is_ascii_alphabetic() {
            return Err(format!("{letter:?} stands where a letter was expected"));
        }
        let number = rest[1..].trim_start();
        let end = number.find(|c: char| !(c.is_ascii_digit() || "+-.".contains(c))).unwrap_or(number.len());
        let value: f64 =
            number[..end].parse().map_err(|_| format!("a number was expected after {letter}"))?;
        if !value.is_finite() {
            return Err(format!("the number after {letter} is too large"));
        }
        words.push((letter.to_ascii_uppercase(), value));
        rest = number[end..].trim_start();
    }
    Ok(words)
}

impl Machine {
    fn run(&mut self, words: &[(char, f64)], line: usize) -> Result<Option<Motion>, String> {
        if self.ended && !words.is_empty() {
            return Err("the program goes on after its end".into());
        }
        let mut target = self.at;
        let mut a_deg = self.a_deg;
        let (mut moves, mut waits) = (false, false);
        for &(letter, value) in words {
            match letter {
                'N' | 'T' | 'P' => {}
                'G' => waits |= self.preparatory(value)?,
                'M' => self.miscellaneous(value)?,
                'F' if value > 0.0 => self.feed_mm_min = value,
                'S' if value >= 0.0 => self.speed_rpm = value,
                'X' | 'Y' | 'Z' => {
                    target[(letter as u8 - b'X') as usize] = Some(value);
                    moves = true;
                }
                'A' => {
                    a_deg = Some(value);
                    moves = true;
                }
                _ => return Err(format!("{letter}{value} is not understood")),
            }
        }
        if !moves || waits {
            return Ok(None);
        }
        self.motion(target, a_deg, line)
    }

    /// Whether the line is a dwell.
    fn preparatory(&mut self, value: f64) -> Result<bool, String> {
        match (value * 10.0).round() as i64 {
            0 => self.rapid = Some(true),
            10 => self.rapid = Some(false),
            40 => return Ok(true),
            170 | 540 | 940 => {}
            210 => self.millimetres = true,
            900 => self.absolute = true,
            _ => {
                return Err(format!(
                    "G{value} is not understood: G0, G1, G4, G17, G21, G54, G90 and G94 are"
                ));
            }
        }
        Ok(false)
    }

    fn miscellaneous(&mut self, value: f64) -> Result<(), String> {
        match value as i64 {
            3 => self.spindle = self.speed_rpm > 0.0,
            5 => self.spindle = false,
            6 => {}
            2 | 30 => self.ended = true,
            _ => return Err(format!("M{value} is not understood: M2, M3, M5, M6 and M30 are")),
        }
        Ok(())
    }

    fn motion(
        &mut self,
        target: [Option<f64>; 3],
        a_deg: Option<f64>,
        line: usize,
    ) -> Result<Option<Motion>, String> {
        let rapid = self.rapid.ok_or("a motion without G0 or G1")?;
        if !(self.millimetres && self.absolute) {
            return Err("a motion before G21 and G90".into());
        }
        let turns = a_deg != self.a_deg && self.a_deg.is_some();
        let before = self.at;
        (self.at, self.a_deg) = (target, a_deg);
        if !rapid && (!self.spindle || self.speed_rpm <= 0.0 || self.feed_mm_min <= 0.0) {
            return Err("a cut with the spindle off or without a feed".into());
        }
        let ([Some(x), Some(y), Some(z)], Some(a_deg)) = (target, a_deg) else {
            return if rapid { Ok(None) } else { Err("a cut before X, Y, Z and A have a place".into()) };
        };
        let to_mm = Vector3::new(x, y, z);
        if to_mm.amax() > 1e5 {
            return Err("a place beyond 100 m".into());
        }
        let from_mm = match before {
            [Some(x), Some(y), Some(z)] => Vector3::new(x, y, z),
            _ => to_mm,
        };
        if turns && !rapid {
            return Err("A turns while the cutter cuts".into());
        }
        let facing = match a_deg.rem_euclid(360.0) {
            a if !(1e-6..=360.0 - 1e-6).contains(&a) => Facing::Front,
            a if (a - 180.0).abs() < 1e-6 => Facing::Back,
            a => return Err(format!("A is {a}°, expected 0 or 180°")),
        };
        let feed_mm_min = if rapid { 0.0 } else { self.feed_mm_min };
        let spindle_rpm = self.speed_rpm;
        Ok(Some(Motion { from_mm, to_mm, facing, a_deg, rapid, turns, feed_mm_min, spindle_rpm, line }))
    }
}
