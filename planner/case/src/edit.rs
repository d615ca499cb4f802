//! A case's text with some of its keys set or taken out: for sweeps, and for cases that move to another folder.

use std::path::Path;

use toml::{Table, Value};

use super::suggest::nearest;
use super::{Case, CaseError, CaseFault, Located, keys};

/// The text of a case with keys set to new values, written as TOML, or taken out (`None`). A structure's keys are
/// `structure.NAME.KEY`. Only what stands in the text is written: defaults stay defaults. Comments are lost.
///
/// # Errors
/// [`CaseError`] with every key that no case has, every structure that this one has not, and every value that is no TOML; `file`
/// is named in it. Whether the values are sensible is for [`super::Case::parse`] to say.
pub fn with_values(
    text: &str,
    file: &Path,
    values: &[(String, Option<String>)],
) -> Result<String, CaseError> {
    let fail = |faults| CaseError { file: file.into(), faults };
    let located = |fault| Located { line: None, fault };
    let syntax = |e: toml::de::Error| located(CaseFault::Syntax { message: e.message().into() });
    let mut root: Table = text.parse().map_err(|e| fail(vec![syntax(e)]))?;
    let mut faults = Vec::new();
    for (key, value) in values {
        let parsed = value.as_ref().map(|value| format!("value = {value}").parse::<Table>()).transpose();
        let value = match parsed {
            Ok(table) => table.and_then(|mut table| table.remove("value")),
            Err(e) => {
                let message = format!("`{key}`: {}", e.message());
                faults.push(located(CaseFault::Syntax { message }));
                continue;
            }
        };
        if let Err(fault) = set(&mut root, key, value) {
            faults.push(located(fault));
        }
    }
    if faults.is_empty() { Ok(root.to_string()) } else { Err(fail(faults)) }
}

impl Case {
    /// Every file that the case names, relative to its folder, with the key under which [`with_values`] sets it.
    pub fn files(&self) -> Vec<(String, &Path)> {
        let images = [("images.ct", self.images.ct.as_path()), ("images.labels", &self.images.labels)];
        let named = images.into_iter().chain(self.robot.files()).chain(self.tool.files());
        let structures = self.structures.iter().map(|s| (format!("structure.{}", s.name), &s.label));
        let of_target = self.labels().into_iter().filter(|(table, _)| table.starts_with("target"));
        let labels = of_target.chain(structures);
        let masks = labels.filter_map(|(table, label)| Some((format!("{table}.file"), label.file()?)));
        named.map(|(key, path)| (key.to_owned(), path)).chain(masks).collect()
    }
}

fn set(root: &mut Table, key: &str, value: Option<Value>) -> Result<(), CaseFault> {
    let unknown = |nearest: Option<String>| CaseFault::UnknownKey { key: key.into(), nearest };
    let entries = keys::case_entries();
    let known = |path: &str| {
        // an entry of a list of regions has the keys of the target
        let entry = path.split('.').filter_map(|part| part.split('[').next()).collect::<Vec<_>>().join(".");
        let own = ["target.less.", "target.also."].iter().find_map(|list| entry.strip_prefix(list));
        let entry = match own {
            Some("margin_mm") => keys::REGION_MARGIN.path.to_owned(),
            Some(own) => format!("target.{own}"),
            None => entry,
        };
        let path = entry.as_str();
        entries.iter().any(|e| e.path.strip_prefix(path).is_some_and(|r| r.is_empty() || r.starts_with('.')))
    };
    let close = |path: &str| nearest(path, entries.iter().map(|e| e.path)).map(str::to_owned);
    let Some(rest) = key.strip_prefix("structure.") else {
        if !known(key) {
            return Err(unknown(close(key)));
        }
        return place(root, key, value).ok_or_else(|| unknown(None));
    };
    let structures = root.get_mut("structure").and_then(Value::as_array_mut).into_iter().flatten();
    let mut named: Vec<(String, &mut Table)> = structures
        .filter_map(Value::as_table_mut)
        .filter_map(|table| Some((table.get("name")?.as_str()?.to_owned(), table)))
        .collect();
    let own = |name: &str| rest.strip_prefix(name).and_then(|rest| rest.strip_prefix('.'));
    if let Some((name, table)) = named.iter_mut().find(|(name, _)| own(name).is_some()) {
        let own = own(name).unwrap_or_default();
        let path = format!("structure.{own}");
        if !known(&path) {
            let close = close(&path)
                .and_then(|path| Some(format!("structure.{name}.{}", path.strip_prefix("structure.")?)));
            return Err(unknown(close));
        }
        return place(table, own, value).ok_or_else(|| unknown(None));
    }
    let (name, own) = rest.rsplit_once('.').unwrap_or((rest, ""));
    let close = nearest(name, named.iter().map(|(name, _)| name.as_str()))
        .or(named.first().map(|(name, _)| name.as_str()));
    Err(unknown(close.map(|name| format!("structure.{name}.{own}"))))
}

/// Sets or takes out a key below a table; tables on the way are made. `None` where something on the way is no table.
fn place(table: &mut Table, key: &str, value: Option<Value>) -> Option<()> {
    match (key.split_once('.'), value) {
        (Some((head, rest)), value) if head.ends_with(']') => {
            let (list, n) = head.trim_end_matches(']').split_once('[')?;
            let entry = table.get_mut(list)?.as_array_mut()?.get_mut(n.parse::<usize>().ok()?)?;
            place(entry.as_table_mut()?, rest, value)
        }
        (Some((head, rest)), value) => {
            let below = table.entry(head).or_insert_with(|| Value::Table(Table::new()));
            place(below.as_table_mut()?, rest, value)
        }
        (None, Some(value)) => {
            table.insert(key.into(), value);
            Some(())
        }
        (None, None) => {
            table.remove(key);
            Some(())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "preset = \"none\"\n[images]\nct = \"c\"\nlabels = \"l\"\n[target]\nlabel = 1\n[burr]\nradius_mm = 2.0\n\
        [[structure]]\nname = \"nerve\"\nlabel = 2\nclearance_mm = 1.25\n[[structure]]\nname = \"sinus.1\"\nlabel = 3\n";

    fn edited(values: &[(&str, Option<&str>)]) -> Result<Case, String> {
        let values: Vec<_> = values.iter().map(|(k, v)| ((*k).to_owned(), v.map(str::to_owned))).collect();
        let file = Path::new("a.toml");
        let text = with_values(TEXT, file, &values).map_err(|e| e.to_string())?;
        Case::parse(&text, file).map_err(|e| e.to_string())
    }

    #[test]
    fn values_are_set_where_they_belong_and_the_rest_stays() {
        let file = Path::new("a.toml");
        assert_eq!(edited(&[]).unwrap(), Case::parse(TEXT, file).unwrap());
        let case = edited(&[
            ("path.step_mm", Some("0.2")),
            ("structure.nerve.clearance_mm", Some("1.5")),
            ("structure.sinus.1.clearance_mm", Some("2.5")),
            ("shank.segments", Some("[[25.0, 1.1], [60.0, 1.5]]")),
            ("speed.mode", Some("\"constant\"")),
            (
                "robot.base_from_ct",
                Some("{ rotation = [[1, 0, 0], [0, 1, 0], [0, 0, 1]], translation_mm = [1, 2, 3] }"),
            ),
        ])
        .unwrap();
        assert_eq!((case.path.step_mm, case.burr.radius_mm, case.shank.len()), (0.2, 2.0, 2));
        assert_eq!(case.structures.iter().map(|s| s.clearance_mm).collect::<Vec<_>>(), [1.5, 2.5]);
        // what follows from another key still follows from it
        let by = |radius: &str| edited(&[("burr.radius_mm", Some(radius))]).unwrap();
        assert!(by("3.0").path.stepover_mm > by("2.0").path.stepover_mm);
        // taken out: the default again
        assert_eq!(edited(&[("burr.radius_mm", None)]).unwrap().burr.radius_mm, 2.5);
        assert!(edited(&[("burr.radius_mm", Some("2000"))]).unwrap_err().contains("`burr.radius_mm` = 2000"));
    }

    #[test]
    fn every_file_of_a_label_is_named_and_can_be_moved() {
        let labels = "label = 1\nless = [{ label = 4 }, { file = \"c.nii\", margin_mm = 1.0 }]";
        let file = Path::new("a.toml");
        let text = TEXT.replace("label = 1", labels).replace("label = 2", "file = \"b.nii\"\nlabel = 5");
        let case = Case::parse(&text, file).unwrap();
        let files = case.files();
        let named: Vec<_> = files.iter().map(|(key, path)| (key.as_str(), path.to_str().unwrap())).collect();
        let own = [("target.less[1].file", "c.nii"), ("structure.nerve.file", "b.nii")];
        assert_eq!(named, [&[("images.ct", "c"), ("images.labels", "l")][..], &own[..]].concat());
        let moved: Vec<_> =
            own.iter().map(|(key, path)| ((*key).to_owned(), Some(format!("\"/d/{path}\"")))).collect();
        let moved = Case::parse(&with_values(&text, file, &moved).unwrap(), file).unwrap();
        let moved: Vec<_> =
            moved.files().iter().skip(2).map(|(_, path)| path.display().to_string()).collect();
        assert_eq!(moved, ["/d/c.nii", "/d/b.nii"]);
    }

    #[test]
    fn unknown_keys_and_structures_are_refused_with_the_nearest() {
        let says = |key: &str| edited(&[(key, Some("1.0"))]).unwrap_err();
        assert_eq!(says("path.stp_mm"), "a.toml: unknown key `path.stp_mm`; did you mean `path.step_mm`?");
        let nerve =
            "a.toml: unknown key `structure.nerv.clearance_mm`; did you mean `structure.nerve.clearance_mm`?";
        assert_eq!(says("structure.nerv.clearance_mm"), nerve);
        assert!(
            says("structure.nerve.clearence_mm").contains("did you mean `structure.nerve.clearance_mm`?")
        );
        assert!(edited(&[("path.step_mm", Some("0.2 mm"))]).unwrap_err().contains("`path.step_mm`"));
        assert!(says("target.less[0].file").contains("unknown key"));
        assert!(edited(&[("a", Some("1")), ("b", Some("1"))]).unwrap_err().lines().count() == 2);
    }
}
