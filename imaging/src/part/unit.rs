//! The unit of a mesh file's coordinates. STL, OBJ and PLY do not say it; the size of the part tells whether it can be right.

use std::fmt;
use std::str::FromStr;

use super::PartError;

/// Least plausible longest side of a part, mm. Assumed: the smallest operculum of C's Table 1 is 17 mm.
pub const SHORTEST_MM: f64 = 5.0;
/// Largest plausible longest side, mm. Assumed: a skull is about 200 mm long.
pub const LONGEST_MM: f64 = 400.0;

/// A unit of length.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LengthUnit {
    /// Millimetre.
    Mm,
    /// Centimetre.
    Cm,
    /// Metre.
    M,
    /// Inch, 25.4 mm.
    Inch,
    /// Micrometre.
    Um,
}

impl LengthUnit {
    /// Every unit.
    pub const ALL: [Self; 5] = [Self::Mm, Self::Cm, Self::M, Self::Inch, Self::Um];

    /// Its length, mm.
    pub fn mm(self) -> f64 {
        match self {
            Self::Mm => 1.0,
            Self::Cm => 10.0,
            Self::M => 1000.0,
            Self::Inch => 25.4,
            Self::Um => 1e-3,
        }
    }

    /// The word in files.
    pub fn word(self) -> &'static str {
        match self {
            Self::Mm => "mm",
            Self::Cm => "cm",
            Self::M => "m",
            Self::Inch => "inch",
            Self::Um => "um",
        }
    }
}

impl fmt::Display for LengthUnit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.word())
    }
}

impl FromStr for LengthUnit {
    type Err = ();
    fn from_str(text: &str) -> Result<Self, ()> {
        Self::ALL.into_iter().find(|unit| unit.word() == text).ok_or(())
    }
}

/// The unit of coordinates whose bounding box is `length` long: the stated one, else mm, if that is plausible.
///
/// # Errors
/// [`PartError::UnitNeeded`] and [`PartError::Implausible`], with the units that would be plausible.
pub(crate) fn plausible_unit(length: f64, stated: Option<LengthUnit>) -> Result<LengthUnit, PartError> {
    let fits = |unit: &LengthUnit| (SHORTEST_MM..=LONGEST_MM).contains(&(length * unit.mm()));
    let unit = stated.unwrap_or(LengthUnit::Mm);
    if fits(&unit) {
        return Ok(unit);
    }
    let plausible = LengthUnit::ALL.into_iter().filter(fits).collect();
    Err(match stated {
        Some(unit) => PartError::Implausible { unit, length_mm: length * unit.mm(), plausible },
        None => PartError::UnitNeeded { length, plausible },
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn millimetres_are_taken_where_they_are_plausible() {
        assert_eq!(plausible_unit(30.0, None).unwrap(), LengthUnit::Mm);
        assert_eq!(plausible_unit(0.03, Some(LengthUnit::M)).unwrap(), LengthUnit::M);
    }

    #[test]
    fn an_implausible_size_names_the_units_that_would_do() {
        let text = plausible_unit(0.03, None).unwrap_err().to_string();
        assert!(text.contains("0.03 mm is not plausible") && text.ends_with("plausible: \"m\""), "{text}");
        let text = plausible_unit(1.5, None).unwrap_err().to_string();
        assert!(text.contains("\"cm\", \"inch\""), "{text}");
        let text = plausible_unit(30.0, Some(LengthUnit::M)).unwrap_err().to_string();
        assert!(text.contains("30000 mm long") && text.contains("\"mm\""), "{text}");
    }

    #[test]
    fn words_read_back() {
        for unit in LengthUnit::ALL {
            assert_eq!(unit.to_string().parse(), Ok(unit));
        }
        assert_eq!("ft".parse::<LengthUnit>(), Err(()));
    }
}
