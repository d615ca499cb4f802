//! How a case names a label, and which labels it names.

use std::fmt;
use std::path::{Path, PathBuf};

use super::{Case, Target};

/// A label by its number, or by its name in the map's own file or in the `labels.json` beside it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum LabelRef {
    /// The value in the map.
    Number(u16),
    /// The name.
    Name(String),
    /// In a file of its own, relative to the case: a label there, or every voxel that is not 0.
    File {
        /// The file.
        path: PathBuf,
        /// Its label there, by number or name; `None` for a mask.
        label: Option<Box<LabelRef>>,
    },
}

impl LabelRef {
    /// The file, if it is in one of its own.
    pub fn file(&self) -> Option<&Path> {
        match self {
            Self::Number(_) | Self::Name(_) => None,
            Self::File { path, .. } => Some(path),
        }
    }

    /// The key by which a table names it: `label` or `file`.
    pub fn key(&self) -> &'static str {
        if self.file().is_some() { "file" } else { "label" }
    }
}

impl fmt::Display for LabelRef {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            LabelRef::Number(n) => write!(f, "{n}"),
            LabelRef::Name(name) => write!(f, "{name:?}"),
            LabelRef::File { path, label: None } => write!(f, "{:?}", path.to_string_lossy()),
            LabelRef::File { path, label: Some(label) } => {
                write!(f, "{label} of {:?}", path.to_string_lossy())
            }
        }
    }
}

impl Case {
    /// Labels of the target, with what it adds and takes away, and of the structures, each with the table that names it.
    pub fn labels(&self) -> Vec<(String, &LabelRef)> {
        let main = [("target".to_owned(), &self.target)];
        let regions = [("also", &self.also), ("less", &self.less)].into_iter().flat_map(|(list, regions)| {
            regions.iter().enumerate().map(move |(n, region)| (format!("target.{list}[{n}]"), &region.of))
        });
        let of_target = main.into_iter().chain(regions).filter_map(|(table, target)| match target {
            Target::Label(label) => Some((table, label)),
            _ => None,
        });
        let structures = self.structures.iter().enumerate();
        of_target.chain(structures.map(|(n, s)| (format!("structure[{n}]"), &s.label))).collect()
    }

    /// The key that names a label: alone, or in a file.
    pub fn label_key(&self, of: &LabelRef) -> Option<String> {
        let is_it = |named: &LabelRef| match named {
            LabelRef::File { label: Some(label), .. } if **label == *of => true,
            named => named == of,
        };
        let (table, named) = self.labels().into_iter().find(|(_, named)| is_it(named))?;
        Some(format!("{table}.{}", if named == of { of.key() } else { "label" }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::CaseError;

    fn parse(text: &str) -> Result<Case, CaseError> {
        Case::parse(text, Path::new("case.toml"))
    }

    #[test]
    fn a_case_of_files_needs_no_label_map() {
        let case = |target: &str, structure: &str| {
            parse(&format!(
                "[images]\nct = \"c\"\n[target]\n{target}\n[[structure]]\nname = \"nerve\"\n{structure}\n"
            ))
        };
        let ball = "ball = { center_mm = [0, 0, 0], radius_mm = 3 }";
        for (target, map) in
            [("file = \"t.nii\"", "t.nii"), ("file = \"t.nii\"\nlabel = 2", "t.nii"), (ball, "n.nii")]
        {
            let case = case(target, "file = \"n.nii\"\nsegment = \"nerve\"").unwrap();
            assert_eq!(case.images.labels.to_str(), Some(map), "{target}");
            assert_eq!(parse(&case.to_toml()).unwrap(), case);
        }
        for (target, structure) in
            [("file = \"t.nii\"", "label = 7"), ("label = 7", "file = \"n.nii\""), (ball, "label = 7")]
        {
            let said = case(target, structure).unwrap_err().to_string();
            assert!(said.contains("`images.labels` is missing"), "{said}");
        }
        let said = case("file = \"t.nii\"", "file = \"t.nii\"").unwrap_err().to_string();
        assert!(said.contains("case.toml:7: `structure[0].file`") && said.contains("target.file"), "{said}");
        // one file with several labels
        assert!(case("file = \"t.nii\"\nlabel = 1", "file = \"t.nii\"\nlabel = 2").is_ok());
    }
}
