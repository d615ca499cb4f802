//! A small G-code interpreter: a program's text as straight motions of X, Y, Z and turns of A.
//!
//! Understood: G0, G1, G4 P, G17, G21, G40, G49, G53 G0 Z0, G54, G80, G90, G94; M0, M2, M3, M5, M6, M30; X Y Z A F S T N O; %; comments in parentheses and
//! after a semicolon. Everything else is refused with its line: a word that is passed over silently could be a motion.
//!
//! Where the axes stand at first is unknown, so a program begins with `G53 G0 Z0`: Z to the machine's top, above everything. From there X, Y and A go where
//! they are wanted, and then Z comes down alone. One cutter is put in, before the spindle starts, and the spindle is off at the end.
//!
//! **Source:** words and modes: ISO 6983-1; RS274/NGC, Kramer, Proctor & Messina 2000.

use nalgebra::Vector3;

use crate::proof::ProofError;

/// Which side faces the spindle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SideUp {
    /// A = 0.
    Front,
    /// A = ±180°.
    Back,
}

impl SideUp {
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
pub struct ProgramMotion {
    /// Start, mm.
    pub from_mm: Vector3<f64>,
    /// End, mm.
    pub to_mm: Vector3<f64>,
    /// Side that faces the spindle.
    pub facing: SideUp,
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
    pub motions: Vec<ProgramMotion>,
}

/// Z of the machine's top, mm: above every block and holder.
pub const TOP_MM: f64 = 1e5;
/// M words that take effect after their line's motion.
const STOPS: [f64; 3] = [0.0, 2.0, 30.0];
/// Letters that may stand twice in a line.
const MODES: &str = "GM";

/// Modes and places while a program is read.
#[derive(Debug, Default)]
struct Machine {
    at: [Option<f64>; 3],
    /// Whether Z is at the machine's top.
    retracted: bool,
    a_deg: Option<f64>,
    rapid: Option<bool>,
    feed_mm_min: f64,
    speed_rpm: f64,
    spindle: bool,
    tool: Option<f64>,
    tool_is_in: bool,
    millimetres: bool,
    absolute: bool,
    ended: bool,
}

/// What a line asks for beside modes.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
enum Asks {
    #[default]
    Motion,
    /// G4.
    Dwell,
    /// G53.
    Top,
}

/// Reads a program.
///
/// # Errors
/// [`ProofError::Line`] with the first line that is not understood, moves before every axis has a place, cuts with the spindle off, without a feed or at an
/// angle other than 0 or 180°, changes the cutter, or follows the program's end; and for a program that never ends or ends with the spindle on.
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
    let mut words: Vec<(char, f64)> = Vec::new();
    let mut rest = line.trim();
    if rest == "%" {
        return Ok(words);
    }
    while let Some(letter) = rest.chars().next() {
        if letter == '(' {
            let end = rest.find(')').ok_or("a comment is not closed: ) was expected")?;
            rest = rest[end + 1..].trim_start();
            continue;
        }
        if letter == ';' {
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
        let letter = letter.to_ascii_uppercase();
        if !MODES.contains(letter) && words.iter().any(|(other, _)| *other == letter) {
            return Err(format!("{letter} stands twice"));
        }
        words.push((letter, value));
        rest = number[end..].trim_start();
    }
    Ok(words)
}

impl Machine {
    fn run(&mut self, words: &[(char, f64)], line: usize) -> Result<Option<ProgramMotion>, String> {
        if self.ended && !words.is_empty() {
            return Err("the program goes on after its end".into());
        }
        let has = |letter: char| words.iter().any(|(other, _)| *other == letter);
        let mut target = self.at;
        let mut a_deg = self.a_deg;
        let mut asks = Asks::Motion;
        let mut is_motion_mode_set = false;
        for &(letter, value) in words {
            match letter {
                'N' => {}
                'O' if words.len() == 1 => {}
                'P' if words.contains(&('G', 4.0)) && value >= 0.0 => {}
                'T' if self.tool_is_in => {
                    return Err(format!("T{value} would change the cutter: there is one"));
                }
                'T' => self.tool = Some(value),
                'G' => {
                    if [0.0, 1.0].contains(&value) && std::mem::replace(&mut is_motion_mode_set, true) {
                        return Err("G0 and G1 in one line".into());
                    }
                    match self.preparatory(value)? {
                        Asks::Motion => {}
                        other if asks == Asks::Motion => asks = other,
                        _ => return Err("G4 and G53 in one line".into()),
                    }
                }
                'M' => {}
                'F' if value > 0.0 => self.feed_mm_min = value,
                'S' if value >= 0.0 => self.speed_rpm = value,
                'X' | 'Y' | 'Z' => target[(letter as u8 - b'X') as usize] = Some(value),
                'A' => a_deg = Some(value),
                _ => return Err(format!("{letter}{value} is not understood")),
            }
        }
        // spindle and cutter change before a line's motion, it stops and ends after it
        let miscellaneous = |machine: &mut Self, stops: bool| {
            let words =
                words.iter().filter(|(letter, value)| *letter == 'M' && STOPS.contains(value) == stops);
            words.copied().try_for_each(|(_, value)| machine.miscellaneous(value))
        };
        miscellaneous(self, false)?;
        let moves = "XYZA".chars().any(has);
        let motion = match asks {
            Asks::Dwell if moves || !has('P') => Err("G4 stands with P alone".into()),
            Asks::Dwell => Ok(None),
            Asks::Top
                if words
                    .iter()
                    .any(|(letter, value)| "XYAF".contains(*letter) || *letter == 'Z' && *value != 0.0)
                    || !has('Z') =>
            {
                Err("G53 is understood as G53 G0 Z0 only: Z to the machine's top".into())
            }
            Asks::Top => self.retract_to_top(line),
            Asks::Motion if moves => self.motion(target, a_deg, line),
            Asks::Motion => Ok(None),
        }?;
        miscellaneous(self, true)?;
        Ok(motion)
    }

    fn preparatory(&mut self, value: f64) -> Result<Asks, String> {
        match value {
            0.0 => self.rapid = Some(true),
            1.0 => self.rapid = Some(false),
            4.0 => return Ok(Asks::Dwell),
            53.0 => return Ok(Asks::Top),
            17.0 | 40.0 | 49.0 | 54.0 | 80.0 | 94.0 => {}
            21.0 => self.millimetres = true,
            90.0 => self.absolute = true,
            _ => {
                return Err(format!(
                    "G{value} is not understood: G0, G1, G4, G17, G21, G40, G49, G53, G54, G80, G90 and G94 are"
                ));
            }
        }
        Ok(Asks::Motion)
    }

    fn miscellaneous(&mut self, value: f64) -> Result<(), String> {
        match value {
            0.0 => {}
            3.0 if self.speed_rpm > 0.0 => self.spindle = true,
            3.0 => return Err("the spindle starts without a speed: S was expected".into()),
            5.0 => self.spindle = false,
            6.0 if self.spindle => return Err("the cutter is changed with the spindle on".into()),
            6.0 if self.tool.is_none() => return Err("M6 without a T before it".into()),
            6.0 if self.tool_is_in => return Err("the cutter is changed: there is one".into()),
            6.0 => self.tool_is_in = true,
            2.0 | 30.0 if self.spindle => {
                return Err("the program ends with the spindle on: M5 was expected before".into());
            }
            2.0 | 30.0 => self.ended = true,
            _ => return Err(format!("M{value} is not understood: M0, M2, M3, M5, M6 and M30 are")),
        }
        Ok(())
    }

    /// Up to the machine's top, from wherever the tip is.
    fn retract_to_top(&mut self, line: usize) -> Result<Option<ProgramMotion>, String> {
        if self.rapid != Some(true) {
            return Err("G53 with G0 was expected".into());
        }
        self.retracted = true;
        let [x, y, z] = self.at;
        self.at[2] = None;
        let (Some(x), Some(y), Some(z), Some(a_deg)) = (x, y, z, self.a_deg) else { return Ok(None) };
        let (from_mm, to_mm) = (Vector3::new(x, y, z), Vector3::new(x, y, TOP_MM));
        Ok(Some(self.rapid_motion(from_mm, to_mm, a_deg, line)?))
    }

    fn rapid_motion(
        &self,
        from_mm: Vector3<f64>,
        to_mm: Vector3<f64>,
        a_deg: f64,
        line: usize,
    ) -> Result<ProgramMotion, String> {
        let (facing, spindle_rpm) = (facing(a_deg)?, self.speed_rpm);
        Ok(ProgramMotion {
            from_mm,
            to_mm,
            facing,
            a_deg,
            rapid: true,
            turns: false,
            feed_mm_min: 0.0,
            spindle_rpm,
            line,
        })
    }

    fn motion(
        &mut self,
        target: [Option<f64>; 3],
        a_deg: Option<f64>,
        line: usize,
    ) -> Result<Option<ProgramMotion>, String> {
        let rapid = self.rapid.ok_or("a motion without G0 or G1")?;
        if !(self.millimetres && self.absolute) {
            return Err("a motion before G21 and G90".into());
        }
        if !rapid && (!self.spindle || self.speed_rpm <= 0.0 || self.feed_mm_min <= 0.0) {
            return Err("a cut with the spindle off or without a feed".into());
        }
        if target.iter().flatten().any(|mm| mm.abs() > TOP_MM) {
            return Err(format!("a place beyond {} m", TOP_MM / 1000.0));
        }
        let before = (self.at, self.a_deg);
        (self.at, self.a_deg) = (target, a_deg);
        if self.retracted {
            return self.leave_top(before, line);
        }
        let ([Some(x), Some(y), Some(z)], Some(a_before)) = before else {
            return Err(
                "a motion before X, Y, Z and A have a place: G53 G0 Z0, then G0 X Y A, then Z were expected"
                    .into(),
            );
        };
        let ([Some(to_x), Some(to_y), Some(to_z)], Some(a_deg)) = (target, a_deg) else { return Ok(None) };
        let (from_mm, to_mm) = (Vector3::new(x, y, z), Vector3::new(to_x, to_y, to_z));
        let turns = a_deg != a_before;
        if turns && !rapid {
            return Err("A turns while the cutter cuts".into());
        }
        let mut motion = ProgramMotion { turns, ..self.rapid_motion(from_mm, to_mm, a_deg, line)? };
        if !rapid {
            (motion.rapid, motion.feed_mm_min) = (false, self.feed_mm_min);
        }
        Ok(Some(motion))
    }

    /// A motion with Z at the machine's top: across, or down alone.
    fn leave_top(
        &mut self,
        (at, a_before): ([Option<f64>; 3], Option<f64>),
        line: usize,
    ) -> Result<Option<ProgramMotion>, String> {
        if self.rapid != Some(true) {
            return Err("a cut with Z at the machine's top".into());
        }
        if let Some(a_deg) = self.a_deg {
            facing(a_deg)?;
        }
        let Some(z) = self.at[2] else { return Ok(None) };
        let ([Some(x), Some(y), _], Some(a_deg)) = (self.at, self.a_deg) else {
            return Err("Z comes down before X, Y and A have a place".into());
        };
        if (at[0], at[1], a_before) != (self.at[0], self.at[1], self.a_deg) {
            return Err(
                "Z comes down from the machine's top together with X, Y or A: it is to come down alone"
                    .into(),
            );
        }
        self.retracted = false;
        let (from_mm, to_mm) = (Vector3::new(x, y, TOP_MM), Vector3::new(x, y, z));
        Ok(Some(self.rapid_motion(from_mm, to_mm, a_deg, line)?))
    }
}

/// The side at an angle of the rotary axis, degrees.
fn facing(a_deg: f64) -> Result<SideUp, String> {
    match a_deg.rem_euclid(360.0) {
        a if !(1e-6..=360.0 - 1e-6).contains(&a) => Ok(SideUp::Front),
        a if (a - 180.0).abs() < 1e-6 => Ok(SideUp::Back),
        a => Err(format!("A is {a}°, expected 0 or 180°")),
    }
}
