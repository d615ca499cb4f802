//! Two plans side by side.

use std::path::PathBuf;

use bonemill_planner::compare::{Comparison, Pair};
use bonemill_planner::plan::{Need, PlanFileError, StoredPlan};
use bonemill_planner::report::compare::page;
use pyo3::prelude::*;

use crate::{apart, errors};

/// Keys with the texts of both plans.
type Texts = Vec<(String, Pair<String>)>;
/// A group's title, and its figures: name and the values of both plans.
type Groups = Vec<(String, Vec<(String, Pair<f64>)>)>;

/// Case keys and inputs that differ, figures, distances between the paths, table and page.
type Compared = (Texts, Texts, Groups, Vec<(&'static str, f64)>, [String; 2]);

/// Differences of the cases and inputs of two plans' folders, their figures, distances between the paths; table and page.
#[pyfunction]
pub fn compare(py: Python<'_>, dirs: [PathBuf; 2], names: [String; 2]) -> PyResult<Compared> {
    let done = apart::run(py, None, None, move |_| {
        // the plans' inputs are not needed
        let [a, b] = dirs.map(|dir| StoredPlan::load_with(&dir, None, Need::Nothing));
        let plans = [a?, b?];
        let (plans, names) = (plans.each_ref(), names.each_ref().map(String::as_str));
        let found = Comparison::of(plans);
        let texts = [found.table(names), page(&found, names, plans)];
        let groups = found.groups.into_iter().map(|group| {
            (group.title, group.figures.into_iter().map(|figure| (figure.name, figure.values)).collect())
        });
        Ok::<_, PlanFileError>((found.case, found.inputs, groups.collect(), found.between.entries(), texts))
    })?;
    done.map_err(|e| errors::file(&e))
}
