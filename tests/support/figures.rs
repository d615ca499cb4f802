//! Access to the values of a plan.toml by their keys.

use bonemill_planner::plan::{PlanRecord, Value};

/// A number among the metrics.
pub fn figure(record: &PlanRecord, keys: &[&str]) -> f64 {
    match entry(&record.metrics.more, keys) {
        Value::Number(v) => *v,
        Value::Integer(n) => *n as f64,
        other => panic!("{other:?} is no number"),
    }
}

/// The entry with this path of keys through nested tables.
pub fn entry<'a>(entries: &'a [(String, Value)], keys: &[&str]) -> &'a Value {
    let (key, rest) = keys.split_first().unwrap_or_else(|| panic!("no key"));
    let (_, value) = entries.iter().find(|(name, _)| name == key).unwrap_or_else(|| panic!("no {key}"));
    match value {
        Value::Table(entries) if !rest.is_empty() => entry(entries, rest),
        _ => value,
    }
}
