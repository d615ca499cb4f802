//! How important a structure is beside the others of its case.

use super::Case;

impl Case {
    /// The priority of a structure over the smallest: 1 for the most important, infinite for one that the case does not have.
    pub fn rank(&self, structure: usize) -> f64 {
        let smallest = self.structures.iter().map(|s| s.priority).min();
        let highest = smallest.map_or(1.0, f64::from);
        self.structures.get(structure).map_or(f64::INFINITY, |s| f64::from(s.priority) / highest)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_ratios_of_priorities_count() {
        let ranks = |[a, b]: [u32; 2]| {
            let text = format!(
                "[images]\nct = \"c\"\nlabels = \"l\"\n[target]\nlabel = 20\n\
                 [[structure]]\nname = \"a\"\nlabel = 1\npriority = {a}\n\
                 [[structure]]\nname = \"b\"\nlabel = 2\npriority = {b}\n"
            );
            let case = Case::parse(&text, std::path::Path::new("case.toml")).unwrap();
            [0, 1, 2].map(|n| case.rank(n))
        };
        assert_eq!(ranks([2, 4]), [1.0, 2.0, f64::INFINITY]);
        assert_eq!(ranks([6, 12]), ranks([2, 4]));
        assert_eq!(ranks([4, 2]), [2.0, 1.0, f64::INFINITY]);
    }
}
