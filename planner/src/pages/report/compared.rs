//! Compares the forces toward structures with those of a straight shaft at constant speed in the same time, and lists the
//! choices that the plan made.

use bonemill_case::{ForceTerm, Objective, OrientationMode, Sense, SpeedMode};
use bonemill_pipeline::{Compared, LinesDraft, Plan, Raster, Reference, StructureForces, half_turn};
use bonemill_planfile::toward::{NEAR_MM, TowardFigures};

use super::escape;

/// A figure of the table: its name, and how it is read.
type Figure = (&'static str, fn(&TowardFigures) -> f64);

const FIGURES: [Figure; 5] = [
    ("mean", |f| f.mean_n),
    ("mean, with zeros", |f| f.mean_with_zeros_n),
    ("75th percentile", |f| f.p75_n),
    ("75th percentile, with zeros", |f| f.p75_with_zeros_n),
    ("peak", |f| f.peak_n),
];

/// No change in per cent is given where the control's force is below this, N.
const LEAST_N: f64 = 1e-3;

/// The table and a sentence for each choice.
pub fn section(plan: &Plan) -> String {
    let compared = &plan.results.compared;
    let table = if compared.named().next().is_none() { String::new() } else { table(plan, compared) };
    let choices: String = choices(plan).into_iter().map(|text| format!("<li>{text}</li>")).collect();
    format!("{table}<ul class=\"choices\">{choices}</ul>{}", drafts(plan))
}

/// What each structure would feel in the drafts that the lines were chosen from.
fn drafts(plan: &Plan) -> String {
    let structures = &plan.setup.case.structures;
    let drafts: Vec<_> = plan.modelled.drafts.iter().filter_map(|d| Some((d, d.forces.as_ref()?))).collect();
    let is_felt = |n: usize| drafts.iter().any(|(_, forces)| forces.structures[n].near.peak_n > 0.0);
    let felt: Vec<usize> = (0..structures.len()).filter(|n| is_felt(*n)).collect();
    if drafts.len() < 2 {
        return String::new();
    }
    let heads: String = felt.iter().map(|n| format!("<th>{}</th>", escape(&structures[*n].name))).collect();
    let row = |(draft, forces): &(&LinesDraft, &StructureForces)| {
        let degrees = degrees(plan, &draft.raster);
        let path = &plan.modelled.path;
        let is_chosen = draft.raster.sense == path.sense && degrees == path.raster_rad.to_degrees();
        let cells: String = felt
            .iter()
            .map(|n| forces.structures[*n].near)
            .map(|near| format!("<td>{:.3} / {:.3}</td>", near.mean_n, near.peak_n))
            .collect();
        let chosen = if is_chosen { ", chosen" } else { "" };
        format!(
            "<tr><th>{degrees:.0}°, {}{chosen}</th>{cells}<td>{:.3} / {:.3}</td></tr>",
            draft.raster.sense.words(),
            forces.mean_n,
            forces.peak_n
        )
    };
    let rows: String = drafts.iter().map(row).collect();
    format!(
        "<div class=\"wide\"><table><thead><tr><th>draft: lines, passes</th>{heads}<th>whole force</th></tr></thead><tbody>{rows}</tbody></table></div>\
         <p class=\"note\">Mean / peak [N] of coarse drafts in one and the same time, forces toward structures within {NEAR_MM} mm of them. The first draft stands \
         unless the product of the figures of another, each by its importance, is lower by a fifth.</p>"
    )
}

/// The angle of lines from work x as plans call it, degrees.
fn degrees(plan: &Plan, raster: &Raster) -> f64 {
    half_turn(raster.frame.angle_rad() + plan.setup.scene.turn_rad).to_degrees()
}

fn table(plan: &Plan, compared: &Compared) -> String {
    let references: Vec<&Reference> = compared.named().map(|(_, reference)| reference).collect();
    let forces: Vec<&StructureForces> =
        references.iter().map(|r| &r.forces).chain([&compared.plan]).collect();
    let row = |name: String, values: Vec<f64>| {
        let (ours, theirs) = values.split_last().map_or((0.0, &[][..]), |(ours, theirs)| (*ours, theirs));
        let cells: String = values.iter().map(|n| format!("<td>{n:.3}</td>")).collect();
        let better = theirs.iter().copied().fold(f64::INFINITY, f64::min);
        let change = if better < LEAST_N {
            "–".to_owned()
        } else {
            format!("{:+.0}&nbsp;%", 100.0 * (ours / better - 1.0))
        };
        format!("<tr><th>{name}</th>{cells}<td>{change}</td></tr>")
    };
    let mut rows = String::new();
    for (n, structure) in plan.setup.case.structures.iter().enumerate() {
        let near = |forces: &&StructureForces| forces.structures.get(n).map(|s| s.near).unwrap_or_default();
        if forces.iter().all(|f| near(f).peak_n == 0.0) {
            continue;
        }
        for (name, figure) in FIGURES {
            let name = format!("{}: {name}", escape(&structure.name));
            rows.push_str(&row(name, forces.iter().map(|f| figure(&near(f))).collect()));
        }
    }
    rows.push_str(&row("whole force: mean".into(), forces.iter().map(|f| f.mean_n).collect()));
    rows.push_str(&row("whole force: peak".into(), forces.iter().map(|f| f.peak_n).collect()));
    let head = |reference: &&Reference| {
        let degrees = degrees(plan, &reference.raster);
        let how = match reference.speed_mm_s {
            Some(speed) => format!("at {speed:.2}&nbsp;mm/s"),
            None => "with the least force".to_owned(),
        };
        let seconds = reference.total_time_s;
        format!("<th>straight shaft {how}, lines at {degrees:.0}°, {seconds:.0}&nbsp;s</th>")
    };
    let heads: String = references.iter().map(head).collect();
    let takes_s = plan.moves.law.duration_s();
    let times = if references.iter().all(|reference| reference.takes(takes_s)) {
        "in the plan's time"
    } else {
        "each in the time that stands above it, since their speeds do not all allow the plan's time"
    };
    format!(
        "<div class=\"wide\"><table><thead><tr><th>force [N]</th>{heads}<th>this plan, {takes_s:.0}&nbsp;s</th><th>change from the lowest</th></tr></thead>\
         <tbody>{rows}</tbody></table></div><p class=\"note\">Forces are those at the greatest speed that the arm drives within each move. Forces toward a structure count while the \
         burr's surface is within {NEAR_MM} mm of it: over the time in which \
         they point toward it, or, with zeros, over all of that time. The straight shafts mill the same target along the approach, driven by the same arm {times}, \
         links, approach and retracts included; their shank is not tested for collisions.</p>"
    )
}

/// One sentence for each choice that affects the forces toward structures.
fn choices(plan: &Plan) -> Vec<String> {
    let (case, m) = (&plan.setup.case, &plan.modelled);
    let by_drafts = |is_given: bool| {
        if is_given {
            "as the case asks"
        } else {
            "chosen by the forces toward structures in coarse drafts of the same duration"
        }
    };
    let lines = format!(
        "Lines run at {:.0}° from work x: {}.",
        m.path.raster_rad.to_degrees(),
        by_drafts(case.path.raster_rad.is_some())
    );
    let sense =
        format!("Passes are {}: {}.", m.path.sense.words(), by_drafts(case.path.sense != Sense::Auto));
    let spin = format!(
        "The burr turns {}: {}.",
        if m.path.spin < 0 { "forward (clockwise seen from the handpiece)" } else { "in reverse" },
        if case.burr.turns_both_ways {
            "chosen by the forces toward structures in two complete plans"
        } else {
            "as the case asks"
        }
    );
    let push = match case.cost.force {
        ForceTerm::Cutting => "force",
        ForceTerm::Deflection => "deflection",
    };
    let axes = match m.axes.mode {
        OrientationMode::Fixed => {
            "The shaft is along the approach, or along the free direction nearest to it.".to_owned()
        }
        OrientationMode::Greedy => {
            "The shaft's direction is chosen for each waypoint alone, then smoothed.".to_owned()
        }
        OrientationMode::Optimal if case.cost.objective == Objective::Dillon => format!(
            "The shaft is turned so that near structures the {push} toward them is least over the whole path, and elsewhere the loss of inertia and the turning."
        ),
        OrientationMode::Optimal => format!(
            "The shaft is turned so that cuts and turns together fit the time at the lowest levels of {push}."
        ),
    };
    let speed = match (&m.speeds.levels, case.speed.mode) {
        (Some(levels), _) => {
            format!("Speeds: the least {push} in the given time, {}.", escape(&levels.sentence(case)))
        }
        (None, SpeedMode::Constant) => "Every cut has one speed.".to_owned(),
        (None, SpeedMode::ForceLimited) => "Speeds are the fastest that keep the force caps.".to_owned(),
        (None, _) => {
            "Speeds decrease with the mass ahead of the burr and do not depend on structures.".to_owned()
        }
    };
    vec![lines, sense, spin, axes, speed]
}
