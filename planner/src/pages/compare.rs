//! Compares two plans: cases, removed volumes, paths, forces and times.
//!
//! Only the plans' own files are read, so plans whose images are missing or changed can still be compared. A figure that only
//! one plan has is `None` for the other. The comparison does not say which plan is better.

mod between;
mod summary;

pub use between::BetweenPlans;

use bonemill_case::explained;
use bonemill_cutting::cutter::MoveKind;
use bonemill_planfile::{StoredPlan, Value};
use bonemill_verify::Short;

/// A value of each of two plans.
pub type Pair<T> = [Option<T>; 2];

/// A number of each plan; its unit ends its name.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    /// What it is.
    pub name: String,
    /// Its values in the first and the second plan.
    pub values: Pair<f64>,
}

/// Figures that belong together.
#[derive(Debug, Clone, PartialEq)]
pub struct Group {
    /// `path`, `volumes`, `times`, `forces`, or `structure NAME`.
    pub title: String,
    /// Its figures, in order.
    pub figures: Vec<Figure>,
}

/// The result of comparing two plans.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    /// Keys of the cases whose values differ, as a case file writes them; structures by name.
    pub case: Vec<(String, Pair<String>)>,
    /// Inputs whose digests differ, by the path that the case gives; the case files themselves are not among them.
    pub inputs: Vec<(String, Pair<String>)>,
    /// Figures of both plans.
    pub groups: Vec<Group>,
    /// Distances between the paths.
    pub between: BetweenPlans,
    /// The structure of the first plan with the highest priority.
    pub most_important: Option<String>,
}

impl Comparison {
    /// Compares two plans.
    pub fn of(plans: [&StoredPlan; 2]) -> Self {
        Self {
            case: differing(plans.map(case_values)),
            inputs: differing(plans.map(digests)),
            groups: groups(plans.map(figures)),
            between: BetweenPlans::of(plans),
            most_important: plans[0]
                .record
                .case
                .structures
                .iter()
                .min_by_key(|s| s.priority)
                .map(|s| s.name.clone()),
        }
    }

    /// Every figure as a table for a terminal.
    pub fn table(&self, names: [&str; 2]) -> String {
        let mut rows = vec![["".to_owned(), names[0].into(), names[1].into(), "second - first".into()]];
        let title = |text: &str| [text.to_owned(), String::new(), String::new(), String::new()];
        for Group { title: name, figures } in &self.groups {
            rows.push(title(name));
            rows.extend(figures.iter().map(|figure| {
                let [a, b] = figure.values.map(|v| v.map_or("-".into(), |v| Short(v).to_string()));
                let difference = figure.difference().map_or("-".into(), |d| Short(d).to_string());
                [format!("  {}", figure.name), a, b, difference]
            }));
        }
        rows.push(title("between the paths"));
        let between = self.between.entries().into_iter();
        rows.extend(
            between.map(|(name, v)| [format!("  {name}"), "".into(), "".into(), Short(v).to_string()]),
        );
        rows.extend(self.differing_rows());
        lines(rows)
    }

    /// Keys of the cases and inputs that differ, as rows of a table.
    fn differing_rows(&self) -> Vec<[String; 4]> {
        let mut rows = Vec::new();
        for (name, differing) in
            [("keys of the cases that differ", &self.case), ("inputs that differ", &self.inputs)]
        {
            if !differing.is_empty() {
                rows.push([name.to_owned(), String::new(), String::new(), String::new()]);
            }
            rows.extend(differing.iter().map(|(key, values)| {
                let [a, b] =
                    values.each_ref().map(|v| v.as_deref().unwrap_or("-").chars().take(40).collect());
                [format!("  {key}"), a, b, String::new()]
            }));
        }
        rows
    }
}

/// The rows as lines, columns beneath one another.
fn lines(rows: Vec<[String; 4]>) -> String {
    let width = |n: usize| rows.iter().map(|row| row[n].chars().count()).max().unwrap_or(0);
    let widths = [0, 1, 2, 3].map(width);
    let line = |[name, a, b, d]: &[String; 4]| {
        let [w, wa, wb, wd] = widths;
        format!("{name:<w$}  {a:>wa$}  {b:>wb$}  {d:>wd$}").trim_end().to_owned() + "\n"
    };
    rows.iter().map(line).collect()
}

impl Figure {
    /// The second plan's value less the first's.
    pub fn difference(&self) -> Option<f64> {
        let [a, b] = self.values;
        Some(b? - a?)
    }
}

/// Entries that differ, in the order of the first list and then of the second.
fn differing([a, b]: [Vec<(String, String)>; 2]) -> Vec<(String, Pair<String>)> {
    paired([a, b]).into_iter().filter(|(_, [a, b])| a != b).collect()
}

/// Pairs of values by name, in the order of the first list and then of the second.
fn paired<T: Clone>([a, b]: [Vec<(String, T)>; 2]) -> Vec<(String, Pair<T>)> {
    let value = |of: &[(String, T)], name: &str| of.iter().find(|(n, _)| n == name).map(|(_, v)| v.clone());
    let more = b.iter().filter(|(name, _)| value(&a, name).is_none());
    let names = a.iter().chain(more).map(|(name, _)| name);
    names.map(|name| (name.clone(), [value(&a, name), value(&b, name)])).collect()
}

fn case_values(plan: &StoredPlan) -> Vec<(String, String)> {
    let case = &plan.record.case;
    let named = |key: String| match key.strip_prefix("structure[").and_then(|rest| rest.split_once(']')) {
        Some((n, rest)) => {
            let structure = n.parse().ok().and_then(|n: usize| case.structures.get(n));
            structure.map_or(key.clone(), |s| format!("structure.{}{rest}", s.name))
        }
        None => key,
    };
    explained(case).into_iter().map(|p| (named(p.key), p.value)).collect()
}

fn digests(plan: &StoredPlan) -> Vec<(String, String)> {
    let case = plan.record.case_input();
    let files = plan.record.inputs.iter().filter(|input| Some(input.path.as_path()) != case);
    files.map(|input| (input.path.display().to_string(), input.sha256.to_string())).collect()
}

/// Figures of one plan, by group and name.
type Figures = Vec<(String, Vec<(String, f64)>)>;

fn groups([a, b]: [Figures; 2]) -> Vec<Group> {
    let pair = |(title, [a, b]): (String, Pair<Vec<(String, f64)>>)| {
        let figures = paired([a.unwrap_or_default(), b.unwrap_or_default()]);
        let figures = figures.into_iter().map(|(name, values)| Figure { name, values }).collect();
        Group { title, figures }
    };
    paired([a, b]).into_iter().map(pair).filter(|group| !group.figures.is_empty()).collect()
}

/// The numbers of `[metrics]` in groups, and figures computed from the waypoints.
fn figures(plan: &StoredPlan) -> Figures {
    let mut stated = Vec::new();
    flatten("", &Value::Table(plan.record.metrics.entries()), &mut stated);
    let mut groups: Figures =
        ["path", "volumes", "times", "forces", "rest"].map(|t| (t.into(), Vec::new())).into();
    groups[0].1 = path(plan);
    let mut structures: Vec<_> =
        plan.record.case.structures.iter().map(|s| (s.name.as_str(), Vec::new())).collect();
    for (name, value) in stated {
        let of_structure = structures.iter_mut().find_map(|(structure, rows)| {
            Some((
                name.strip_prefix("structures.")?.strip_prefix(*structure)?.strip_prefix('.')?.to_owned(),
                rows,
            ))
        });
        match of_structure {
            Some((name, rows)) => rows.push((name, value)),
            None => groups[1 + kind_of(&name)].1.push((name, value)),
        }
    }
    groups.extend(structures.into_iter().map(|(name, rows)| (format!("structure {name}"), rows)));
    groups
}

/// Index of a figure's group among volumes, times, forces and the rest, by its unit.
fn kind_of(name: &str) -> usize {
    let (head, last) = (name.split('.').next().unwrap_or(name), name.rsplit('.').next().unwrap_or(name));
    let is = |ending: &str| head.ends_with(ending) || last.ends_with(ending);
    match () {
        () if is("_mm3") => 0,
        () if is("_n") => 2,
        () if (is("_s") && !is("_mm_s")) || head == "seconds_by_kind" => 1,
        () => 3,
    }
}

/// Every number in a value, with its path.
fn flatten(name: &str, value: &Value, found: &mut Vec<(String, f64)>) {
    match value {
        Value::Number(v) => found.push((name.to_owned(), *v)),
        Value::Integer(v) => found.push((name.to_owned(), *v as f64)),
        Value::Table(entries) => entries.iter().for_each(|(key, v)| {
            let dot = if name.is_empty() { "" } else { "." };
            flatten(&format!("{name}{dot}{key}"), v, found);
        }),
        Value::Text(_) | Value::Flag(_) | Value::List(_) => {}
    }
}

fn path(plan: &StoredPlan) -> Vec<(String, f64)> {
    let length_mm = |kind: MoveKind| -> f64 {
        let moves = plan.waypoints.windows(2).filter(|pair| pair[1].kind == kind);
        moves.map(|pair| pair[0].position.distance_mm(&pair[1].position)).sum()
    };
    let layers = plan.waypoints.iter().map(|w| w.layer + 1).max().unwrap_or(0);
    let mut rows =
        vec![("waypoints".to_owned(), plan.waypoints.len() as f64), ("layers".into(), f64::from(layers))];
    rows.extend(MoveKind::ALL.map(|kind| (format!("{}_length_mm", kind.word()), length_mm(kind))));
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_differs_is_named_once_and_what_one_lacks_has_no_value() {
        let list = |of: &[(&str, &str)]| -> Vec<(String, String)> {
            of.iter().map(|(k, v)| ((*k).into(), (*v).into())).collect()
        };
        let found = differing([
            list(&[("a", "1"), ("b", "2"), ("c", "3")]),
            list(&[("b", "5"), ("a", "1"), ("d", "4")]),
        ]);
        let some = |v: &str| Some(v.to_owned());
        let expected = [
            ("b".to_owned(), [some("2"), some("5")]),
            ("c".into(), [some("3"), None]),
            ("d".into(), [None, some("4")]),
        ];
        assert_eq!(found, expected);
    }

    #[test]
    fn figures_are_sorted_by_what_they_measure() {
        let kinds = ["removed_mm3", "target.all_mm3", "total_time_s", "seconds_by_kind.cut", "peak_force_n"]
            .map(kind_of);
        assert_eq!(kinds, [0, 0, 1, 1, 2]);
        assert_eq!(
            ["smallest_singular_value_mm_s", "path_length_mm", "reached_share"].map(kind_of),
            [3, 3, 3]
        );
    }
}
