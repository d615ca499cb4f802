//! `report.html` of a prosthesis: which block to mount and how, pictures of part, toolpath and deviation, figures, the resolved job.

pub(crate) mod pictures;

use std::fmt::Write;

use crate::machining::strip::{FORCE_N_MM2, SHEAR_N_MM2, StripStrength, TENSILE_N_MM2};
use crate::orient::Laid;
use bonemill_case::explained_job;
use bonemill_case::prosthesis::MachineKind;
use bonemill_planfile::page::{escape, opening, parameters, verdict};
use bonemill_planfile::{ReportPart, Value};

use crate::{JobRecord, ProsthesisPlan, RobotMotion};

const MEETS: &str = "The program makes the part: it was read back and cut out of the block.";

/// The whole page.
pub(crate) fn html(plan: &ProsthesisPlan, record: &JobRecord) -> String {
    let mut page = opening("Prosthesis", "");
    page += &verdict(MEETS, &record.shortfalls, &record.warnings);
    page += &cards(plan);
    page += &instructions(plan, record);
    page += &ReportPart::Verification.marks().concat();
    page += "<h2>The part in its block</h2>";
    page += &pictures::part_in_block(plan);
    page += &strip(&plan.machining.strip, record);
    page += "<h2>Orientation</h2>";
    page += &orientation(plan);
    page += "<h2>Toolpath</h2>";
    page += &pictures::toolpath(plan);
    page += "<h2>Deviation of the machined surface from the part</h2>";
    page += &pictures::deviation(plan);
    page += "<h2>Figures</h2>";
    page += &figures(record);
    page += "<h2>Choices</h2>";
    page += "<p>How the part is laid, which block was chosen and what holds the part stand above.</p>";
    page += &parameters(&explained_job(&record.job), "C: Castelli et al. 2020");
    let _ = write!(
        page,
        "<h2>Job, with every default</h2><details><summary>show</summary><pre>{}</pre></details></main></body></html>",
        escape(&record.job.to_toml())
    );
    page
}

fn cards(plan: &ProsthesisPlan) -> String {
    let minutes = |s: f64| format!("{:.1} min", s / 60.0);
    let times = &plan.machining.times;
    let cards = [
        ("machining time under the machine's accelerations", minutes(times.limited_s)),
        ("at constant speeds", minutes(times.constant_s)),
        ("block", escape(&plan.taken.mounted.id)),
        ("deepest cut into the part", format!("{:.4} mm", plan.proof.deepest_gouge_mm)),
        ("thickest stock left on the part", format!("{:.3} mm", plan.proof.thickest_uncut_mm)),
        ("widest cut", format!("{:.2} mm", plan.proof.widest_mm)),
    ];
    let by_arm = plan.robot.as_ref().map(|robot| ("by the arm", minutes(robot.duration_s)));
    let items = by_arm
        .into_iter()
        .chain(cards)
        .map(|(label, value)| format!("<div><b>{value}</b><span>{label}</span></div>"));
    format!("<div class=\"cards\">{}</div>", items.collect::<String>())
}

/// Which block to mount, how, and what to run.
fn instructions(plan: &ProsthesisPlan, record: &JobRecord) -> String {
    let [x, y, z] = plan.taken.mounted.size_mm;
    let (tool, place) = (&record.job.tool, where_it_stands(record));
    let from = match (plan.taken.is_from_catalogue(), plan.shortfalls.is_empty()) {
        (false, _) => "",
        (true, true) => " It was taken out of the catalogue.",
        (true, false) => " It is still in the catalogue, because the plan falls short.",
    };
    let (mount, run) = match (&plan.robot, record.job.machine.kind) {
        (Some(robot), _) => by_arm(robot),
        (None, MachineKind::FiveAxis) => on_machine([x, y, z]),
        (None, MachineKind::Ur(_)) => {
            let none = "Do not mount it: the arm cannot follow this toolpath, as is said above.";
            (none.into(), "There is no trajectory to run.".into())
        }
    };
    format!(
        "<h2>What to do</h2><ol class=\"steps\">\
         <li>Take block <b>{}</b>, {x} × {y} × {z} mm.{from}</li>\
         <li>{mount}</li>\
         <li>{place}</li>\
         <li>Put in the cutter: diameter {} mm, corner radius {} mm, flutes: {}, {} mm from the tip to the holder.</li>\
         <li>{run}</li>\
         <li>Break the part off its last tab of {:.1} mm and take off the burrs.</li></ol>{}",
        escape(&plan.taken.mounted.id),
        tool.diameter_mm,
        tool.corner_radius_mm,
        tool.flutes,
        tool.length_mm,
        plan.machining.strip.tab_mm,
        pictures::set_up(plan),
    )
}

/// Where block and grip stand at A = 0, in the machine's axes and the block's.
fn where_it_stands(record: &JobRecord) -> String {
    let block = &record.block;
    let [low, high] = block.at_a0_mm();
    format!(
        "Seen from the program's zero, at A = 0, the block stands from X = {:.2} to {:.2}, Y = {:.2} to {:.2} and Z = {:.2} to {:.2} mm, and the grip may cover it from \
         Y = {:.2} to {:.2} mm. The report, <code>toolpath.csv</code> and <code>job.toml</code> give places in the block's frame: its x is X, its y is Z and its z is \
         −Y at A = 0, so the grip is at the block's lower end in z, from {:.2} to {:.2} mm.",
        low.x,
        high.x,
        low.y,
        high.y,
        low.z,
        high.z,
        high.y - block.grip_mm,
        high.y,
        block.low_mm.z,
        block.low_mm.z + block.grip_mm,
    )
}

/// How the block is mounted on a machine, and what the machine runs.
fn on_machine([x, y, z]: [f64; 3]) -> (String, String) {
    let mount = format!(
        "Mount it with its {x} mm side along X (the rotary axis A), its {y} mm side toward the spindle and its {z} mm side across. At A = 0 side A faces the \
         spindle. Set the program's zero on the rotary axis."
    );
    (mount, "Run <code>program.nc</code>: side A, half a turn, side B, then the outline.".into())
}

/// How block and spindle are mounted for an arm, and what it runs.
fn by_arm(robot: &RobotMotion) -> (String, String) {
    let run = format!(
        "Run <code>trajectory.csv</code> by the arm, {:.1} min: side A, half a turn, side B, then the outline. <code>program.nc</code> is the same for a \
         milling machine with a rotary axis along the block's x.",
        robot.duration_s / 60.0
    );
    (escape(&robot.setup), run)
}

/// What holds the part until the end, and what that rests on.
fn strip(strip: &StripStrength, record: &JobRecord) -> String {
    let number = |name: &str| record.number(name).unwrap_or(0.0);
    format!(
        "<p>Until the outline is cut, a strip {:.2} mm thick and {:.0} mm long holds the part: it bears {:.0} N in shear, the greatest cutting force of the program is \
         {:.1} N. Then a tab of it holds the part, {:.1} mm long: it bears {:.1} N in shear and, by a force at the farthest place of the outline, in bending; the greatest \
         cutting force from the outline on is {:.1} N. Assumed, for PMMA: a shear strength of {SHEAR_N_MM2:.0} N/mm², a tensile strength of {TENSILE_N_MM2:.0} N/mm², \
         a specific cutting force of {FORCE_N_MM2:.0} N/mm²; other materials bear other forces. Forces along the cutter are not counted.</p>",
        strip.thickness_mm,
        strip.length_mm,
        strip.strip_bears_n,
        number("cutting_force_n"),
        strip.tab_mm,
        strip.tab_bears_n,
        number("outline_force_n"),
    )
}

/// Residual areas as given, after each run of the published procedure, and as chosen.
fn orientation(plan: &ProsthesisPlan) -> String {
    let row = |name: String, laid: &Laid| {
        let (r, s) = (&laid.residual, &laid.size_mm);
        format!(
            "<tr><th>{name}</th><td>{:.2}</td><td>{:.2}</td><td>{:.2}</td><td>{:.2}</td><td>{:.2} × {:.2} × {:.2}</td></tr>",
            r.xy_mm2,
            r.xz_mm2,
            r.yz_mm2,
            r.sum_mm2(),
            s.x,
            s.y,
            s.z
        )
    };
    let placing = &plan.placing;
    let mut rows = row("as given".into(), &placing.given);
    for (n, run) in placing.runs.iter().enumerate() {
        rows += &row(format!("published procedure, run {}", n + 1), &run.laid);
    }
    rows += &placing.exact.iter().map(|laid| row("least residual area".into(), laid)).collect::<String>();
    rows += &row("machined".into(), &placing.chosen);
    format!(
        "<p>Residual area: the bounding rectangle of the part's projection less the projection, mm².</p><div class=\"wide\"><table><thead><tr><th></th>\
         <th>xy</th><th>xz</th><th>yz</th><th>sum</th><th>size x × y × z, mm</th></tr></thead><tbody>{rows}</tbody></table></div>"
    )
}

fn figures(record: &JobRecord) -> String {
    let rows = record.metrics.iter().map(|(name, value)| {
        let value = short(value);
        format!("<tr><th><code>{name}</code></th><td>{}</td></tr>", escape(&value))
    });
    format!("<div class=\"wide\"><table><tbody>{}</tbody></table></div>", rows.collect::<String>())
}

/// A figure with the digits that a reader needs.
fn short(value: &Value) -> String {
    match value {
        Value::Number(v) if v.abs() >= 100.0 => format!("{v:.1}"),
        Value::Number(v) => format!("{v:.4}"),
        Value::List(items) => items.iter().map(short).collect::<Vec<_>>().join(", "),
        other => other.to_toml("").unwrap_or_default(),
    }
}
