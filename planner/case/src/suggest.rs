//! Which known name an unknown one was meant to be.

/// Endings that name a unit.
const UNITS: [&str; 26] = [
    "_mm", "_um", "_cm", "_m", "_in", "_deg", "_rad", "_mm_s", "_m_s", "_um_s", "_rpm", "_hz", "_khz", "_s",
    "_ms", "_min", "_g_cm3", "_kg_m3", "_per_mm", "_per_m", "_n_mm2", "_n_mm", "_mpa", "_hu", "_degrees",
    "_meters",
];

/// The name without the unit at its end.
fn stem(name: &str) -> &str {
    let longest = UNITS.iter().filter_map(|u| name.strip_suffix(u)).min_by_key(|s| s.len());
    longest.filter(|s| !s.is_empty()).unwrap_or(name)
}

/// Whether two different names are one quantity, but for the unit.
pub(super) fn same_quantity(a: &str, b: &str) -> bool {
    stem(&a.to_lowercase()) == stem(b)
}

/// The candidate within a third of the name's length in edits, if any; the first of equals.
pub fn nearest<'c>(name: &str, candidates: impl Iterator<Item = &'c str>) -> Option<&'c str> {
    if name.len() > 64 {
        return None; // the search is quadratic, and no key is that long
    }
    let limit = (name.chars().count() / 3).max(1);
    candidates
        .map(|c| (edits(&name.to_lowercase(), &c.to_lowercase()), c))
        .filter(|(d, _)| *d <= limit)
        .min_by_key(|(d, _)| *d)
        .map(|(_, c)| c)
}

/// Insertions, deletions, substitutions and swaps of neighbours that turn `a` into `b` (optimal string alignment).
fn edits(a: &str, b: &str) -> usize {
    let (a, b): (Vec<char>, Vec<char>) = (a.chars().collect(), b.chars().collect());
    let width = b.len() + 1;
    let mut d: Vec<usize> = (0..(a.len() + 1) * width).map(|n| if n < width { n } else { 0 }).collect();
    for i in 1..=a.len() {
        d[i * width] = i;
        for j in 1..=b.len() {
            let substitute = d[(i - 1) * width + j - 1] + usize::from(a[i - 1] != b[j - 1]);
            let mut best = substitute.min(d[(i - 1) * width + j] + 1).min(d[i * width + j - 1] + 1);
            if i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1] {
                best = best.min(d[(i - 2) * width + j - 2] + 1);
            }
            d[i * width + j] = best;
        }
    }
    d[a.len() * width + b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edits_are_counted() {
        for (a, b, n) in
            [("", "abc", 3), ("kitten", "sitting", 3), ("raduis", "radius", 1), ("same", "same", 0)]
        {
            assert_eq!(edits(a, b), n, "{a} {b}");
        }
    }

    #[test]
    fn a_typo_finds_its_key_and_nonsense_none() {
        let keys = ["radius_mm", "flutes", "spindle_rpm", "spin"];
        assert_eq!(nearest("raduis_mm", keys.into_iter()), Some("radius_mm"));
        assert_eq!(nearest("Flutes", keys.into_iter()), Some("flutes"));
        assert_eq!(nearest("colour", keys.into_iter()), None);
    }

    #[test]
    fn case_and_accents_find_their_name() {
        let names = ["Facial nerve", "Sigmoïd sinus", "Äußerer Gehörgang"];
        // composed, decomposed, and without
        for (said, meant) in [
            ("FACIAL NERVE", names[0]),
            ("sigmoid sinus", names[1]),
            ("Sigmoi\u{308}d Sinus", names[1]),
            ("Ausserer Gehorgang", names[2]),
        ] {
            assert_eq!(nearest(said, names.into_iter()), Some(meant), "{said}");
        }
    }

    #[test]
    fn the_unit_alone_may_differ() {
        for other in ["radius", "radius_m", "radius_um", "Radius_mm"] {
            assert!(same_quantity(other, "radius_mm"), "{other}");
        }
        assert!(same_quantity("min_m_s", "min_mm_s") && same_quantity("raster_rad", "raster_deg"));
        assert!(!same_quantity("neck_radius_mm", "radius_mm"));
    }
}
