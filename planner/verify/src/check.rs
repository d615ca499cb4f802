//! The result of a check: the measured value, its limit, the margin between them, and the place of the worst value.

use std::fmt;

/// On which side of the limit a value must lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LimitSide {
    /// value ≤ limit.
    AtMost,
    /// value ≥ limit.
    AtLeast,
}

/// Where the worst was found.
#[derive(Debug, Clone, PartialEq)]
pub enum Place {
    /// A row of `waypoints.csv`, from 0: the move that ends there.
    Waypoint(usize),
    /// An instant of `trajectory.csv`, s, and the waypoint at which its move ends.
    Instant {
        /// Time, s.
        time_s: f64,
        /// The waypoint at which the move ends.
        waypoint: usize,
    },
    /// A file or a key.
    Named(String),
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Waypoint(n) => write!(f, "waypoint {n}"),
            Self::Instant { time_s, waypoint } => write!(f, "t = {time_s:.3} s, move to waypoint {waypoint}"),
            Self::Named(name) => f.write_str(name),
        }
    }
}

/// The result of one check.
#[derive(Debug, Clone, PartialEq)]
pub struct Check {
    /// What is checked, e.g. `clearance of moves`; the names are fixed.
    pub name: &'static str,
    /// The structure, joint or file that is checked, where there are several.
    pub subject: Option<String>,
    /// The worst value found.
    pub value: f64,
    /// The limit.
    pub limit: f64,
    /// On which side of the limit the value must lie.
    pub sense: LimitSide,
    /// Unit of value and limit; empty for counts.
    pub unit: &'static str,
    /// Place of the worst value.
    pub place: Option<Place>,
    /// A further remark for the reader, or empty.
    pub note: String,
}

impl Check {
    /// A check that `value` does not exceed `limit`.
    pub fn at_most(name: &'static str, value: f64, limit: f64, unit: &'static str) -> Self {
        Self {
            name,
            subject: None,
            value,
            limit,
            sense: LimitSide::AtMost,
            unit,
            place: None,
            note: String::new(),
        }
    }

    /// A check that `value` is not below `limit`.
    pub fn at_least(name: &'static str, value: f64, limit: f64, unit: &'static str) -> Self {
        Self { sense: LimitSide::AtLeast, ..Self::at_most(name, value, limit, unit) }
    }

    /// A check that the number of wrong things, `count`, is 0.
    pub fn none_wrong(name: &'static str, count: usize) -> Self {
        Self::at_most(name, count as f64, 0.0, "")
    }

    /// The same check with its subject.
    #[must_use]
    pub fn of(mut self, subject: impl Into<String>) -> Self {
        self.subject = Some(subject.into());
        self
    }

    /// The same check with the place of its worst value.
    #[must_use]
    pub fn at(mut self, place: impl Into<Option<Place>>) -> Self {
        self.place = place.into();
        self
    }

    /// The same check with a remark.
    #[must_use]
    pub fn noting(mut self, note: impl Into<String>) -> Self {
        self.note = note.into();
        self
    }

    /// Distance of the value from the limit on the right side; negative if it is on the wrong side.
    pub fn margin(&self) -> f64 {
        match self.sense {
            LimitSide::AtMost => self.limit - self.value,
            LimitSide::AtLeast => self.value - self.limit,
        }
    }

    /// Whether the value is on the right side of the limit; false for NaN.
    pub fn passed(&self) -> bool {
        self.margin() >= 0.0
    }
}

impl fmt::Display for Check {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // the relation that holds
        let sign = match (self.sense, self.passed() || self.value.is_nan()) {
            (LimitSide::AtMost, true) => "<=",
            (LimitSide::AtMost, false) => ">",
            (LimitSide::AtLeast, true) => ">=",
            (LimitSide::AtLeast, false) => "<",
        };
        write!(f, "{}", self.name)?;
        if let Some(subject) = &self.subject {
            write!(f, " ({subject})")?;
        }
        write!(f, ": {} {sign} {}", Short(self.value), Short(self.limit))?;
        if !self.unit.is_empty() {
            write!(f, " {}", self.unit)?;
        }
        if let Some(place) = &self.place {
            write!(f, ", at {place}")?;
        }
        if !self.note.is_empty() {
            write!(f, "; {}", self.note)?;
        }
        Ok(())
    }
}

/// A number printed with about five digits.
pub struct Short(pub f64);

impl fmt::Display for Short {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let size = self.0.abs();
        if self.0 == self.0.trunc() && size < 1e6 {
            write!(f, "{}", self.0)
        } else if (1e-3..1e6).contains(&size) {
            let digits = (4.0 - size.log10().floor()).clamp(0.0, 7.0) as usize;
            write!(f, "{:.*}", digits, self.0)
        } else {
            write!(f, "{:.3e}", self.0)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_margin_is_on_the_right_side() {
        let most = Check::at_most("a", 0.4, 0.5, "mm");
        let least = Check::at_least("a", 0.4, 0.5, "mm");
        assert!(most.passed() && !least.passed());
        assert!((most.margin() - 0.1).abs() < 1e-15 && (least.margin() + 0.1).abs() < 1e-15);
        assert!(!Check::at_most("a", f64::NAN, 0.5, "mm").passed());
        assert!(Check::none_wrong("a", 0).passed() && !Check::none_wrong("a", 1).passed());
    }

    #[test]
    fn a_line_says_value_limit_and_place() {
        let check = Check::at_least("clearance", 0.98124, 1.0, "mm").of("nerve").at(Place::Waypoint(7));
        assert_eq!(check.to_string(), "clearance (nerve): 0.98124 < 1 mm, at waypoint 7");
        assert_eq!(Short(1234.5678).to_string(), "1234.6");
        assert_eq!(Short(1e-7).to_string(), "1.000e-7");
    }
}
