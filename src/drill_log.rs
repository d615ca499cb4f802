//! `bonemill simulate --calibrate` of a plan with a drill or reamer: the coefficients of `material.edge_model` from thrust and torque
//! while the tool enters bone of the density `rho_ref_g_cm3` through a flat face.

use std::path::Path;

use anyhow::Context;
use bonemill_planner::case::EdgeModel;
use bonemill_planner::channel::tool::ChannelTool;
use bonemill_planner::edge::{PlungeFit, PlungeFitError, PlungeFitting, PlungeInstant, Regression};
use bonemill_planner::plan::{DrillLogRow, StoredPlan, read_drill_log};
use serde_json::json;

use crate::outcome::Outcome;

/// Fits the coefficients that the case's material has to a log.
pub fn fit(plan: &StoredPlan, log: &Path) -> anyhow::Result<Outcome> {
    let rows = read_drill_log(log)?;
    let case = &plan.record.case;
    let tool = ChannelTool::of_case(case, |file| plan.input_path(file))?;
    let fitting = PlungeFitting {
        cutter: tool.cutter.as_ref(),
        regression: regression(case.edge_material.model),
        with_feed_angle: true,
        with_chisel: true,
    };
    let of_row = |row: &DrillLogRow| PlungeInstant {
        feed_mm_rev: row.feed_mm_rev,
        spindle_rpm: row.spindle_rpm,
        depth_mm: row.depth_mm,
        thrust_n: row.thrust_n,
        torque_nmm: row.torque_nmm,
    };
    let fit = fitting.fit(&rows.iter().map(of_row).collect::<Vec<_>>());
    let fit = fit.map_err(|error| match (&error, rows.as_slice()) {
        (PlungeFitError::Row { row }, rows) if *row < rows.len() => {
            anyhow::anyhow!(
                "{}:{}: expected a feed and a spindle speed above 0",
                log.display(),
                rows[*row].line
            )
        }
        _ => error.into(),
    });
    let fit = fit.with_context(|| {
        format!(
            "{}: no calibration of material.edge_model; a simpler one has fewer coefficients",
            log.display()
        )
    })?;
    Ok(Outcome::values("simulate", text(&fit, rows.len()), values(&fit, rows.len())))
}

fn regression(model: EdgeModel) -> Regression {
    match model {
        EdgeModel::Constant => Regression::Constant,
        EdgeModel::Rake => Regression::Rake,
        EdgeModel::Chip => Regression::Chip,
        EdgeModel::PowerLaw => Regression::PowerLaw,
        EdgeModel::Reciprocal => Regression::Reciprocal,
    }
}

/// The coefficients of k_c and of k_f k_c, by the keys of `[material]`.
fn by_key(fit: &PlungeFit) -> [(&'static str, &[[f64; 2]]); 2] {
    let (normal, friction) = fit.estimates.split_at(fit.estimates.len() / 2);
    [("k_normal", normal), ("k_friction", friction)]
}

fn text(fit: &PlungeFit, rows: usize) -> String {
    let list = |of: &[[f64; 2]], n: usize| {
        of.iter().map(|estimate| format!("{:.5}", estimate[n])).collect::<Vec<_>>().join(", ")
    };
    let lines: String = by_key(fit)
        .iter()
        .map(|(key, of)| format!("{key} = [{}] ± [{}] (95 %)\n", list(of, 0), list(of, 1)))
        .collect();
    let [thrust, torque] = fit.residual;
    format!(
        "{lines}the model leaves {thrust:.4} N of thrust and {torque:.4} N mm of torque, over {rows} rows\n"
    )
}

fn values(fit: &PlungeFit, rows: usize) -> serde_json::Value {
    let column = |of: &[[f64; 2]], n: usize| of.iter().map(|estimate| estimate[n]).collect::<Vec<_>>();
    let coefficients: serde_json::Map<_, _> = by_key(fit)
        .iter()
        .map(|(key, of)| ((*key).to_owned(), json!({ "value": column(of, 0), "half_width": column(of, 1) })))
        .collect();
    let [thrust_n, torque_nmm] = fit.residual;
    json!({ "coefficients": coefficients, "residual_thrust_n": thrust_n, "residual_torque_nmm": torque_nmm, "rows": rows })
}
