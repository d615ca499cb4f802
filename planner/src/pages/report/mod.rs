//! `report.html`: the overview of a plan, in one file that needs no network.
//!
//! The page is computed from a [`Plan`] alone and does not depend on time or place, so equal plans give equal pages.
//! Simulation and verification later add their parts between marks in the page.

pub(crate) mod chart;
mod columns;
pub mod compare;
mod compared;
pub(crate) mod frame;
pub mod images;
mod peak;
pub mod run;
pub mod simulation;
mod slices;
mod structures;
mod terms;
pub mod verification;

use std::fmt::Write;

use bonemill_arm::Joint;
use bonemill_arm::ur::branch_name;
use bonemill_geometry::Rigid;
pub use bonemill_pipeline::{percent, rounded_percent};
use chart::{Level, Series, chart};
use peak::Peak;

use crate::pages::show::{CUT_COLOUR, LINK_COLOUR, STRUCTURE_COLOURS, TARGET_COLOUR, css};
use bonemill_case::{Case, OrientationMode, Registration, Sheets, Structure};
use bonemill_pipeline::{Plan, Volumes, dropped_by_reason};
pub(crate) use bonemill_planfile::page::escape;
use bonemill_planfile::{ReportPart, Waypoint};
use bonemill_toolpath::orientation::OpenAround;

/// Whether a report holds grey values of the CT: it may go where the scan may not.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CtSlices {
    /// Slices about the target, with structures tinted.
    Shown,
    /// The path alone.
    LeftOut,
}

impl CtSlices {
    /// What the page says about it.
    pub(crate) fn note(self) -> &'static str {
        match self {
            Self::Shown => {
                "<p class=\"note\">The pictures hold parts of the patient's scan: grey values of the CT about the target, −1000 to 2000\u{a0}HU in 256 \
                 steps, tinted where structures lie. Whoever gets this page gets them. <code>--no-slices</code> leaves them out.</p>"
            }
            Self::LeftOut => {
                "<p class=\"note\">The slices of the CT are left out (<code>--no-slices</code>): this page holds no voxel of the scan and no outline of a structure, of grey values only each body's median.</p>"
            }
        }
    }
}

/// The whole page.
pub fn html(plan: &Plan, ct_slices: CtSlices) -> String {
    let mut page = frame::head("Milling plan", &plan.shortfalls, &plan.warnings);
    page.push_str(&cards(plan));
    page.push_str(&images::section(&plan.setup));
    page.push_str(terms::TERMS);
    page.push_str(&ReportPart::Verification.marks().concat());
    let is_shown = ct_slices == CtSlices::Shown;
    page.push_str(if is_shown { "<h2>Path over the CT</h2>" } else { "<h2>Path</h2>" });
    page.push_str(&legend(plan, ct_slices));
    let _ = write!(page, "<div class=\"slices\">{}</div>", slices::slices(plan, ct_slices));
    page.push_str(ct_slices.note());
    page.push_str("<h2>Along the path</h2>");
    if let Some(peak) = Peak::of(&plan.moves.waypoints) {
        let _ = write!(page, "<p>{}</p>", peak.sentence(&plan.moves.waypoints));
    }
    page.push_str(&charts(plan));
    page.push_str(&ReportPart::Simulation.marks().concat());
    page.push_str("<h2>Coverage</h2>");
    page.push_str(&coverage(plan));
    page.push_str("<h2>Structures</h2>");
    page.push_str(&structures::structure_table(
        &plan.setup.case,
        &plan.results.figures.structures,
        ["", "at waypoint"],
        |row| peak::short_place(&plan.moves.waypoints, row),
    ));
    if !plan.setup.case.structures.is_empty() {
        page.push_str("<h2>Compared with a straight shaft at constant speed</h2>");
        page.push_str(&compared::section(plan));
    }
    page.push_str("<h2>What was modelled</h2>");
    page.push_str(&modelled(plan));
    page.push_str(&frame::tail(&plan.setup.inputs, &as_planned(plan), &plan.setup.case));
    page
}

fn cards(plan: &Plan) -> String {
    // rounded once, as it stands elsewhere
    let total_s = plan.moves.law.duration_s().round();
    let kept = plan.results.figures.structures.iter().zip(&plan.setup.case.structures);
    let [closest, tightest] = closest_and_tightest(kept.filter_map(|(found, s)| Some((found.least?.0, s))));
    let peak_toward = plan.results.figures.structures.iter().zip(&plan.setup.case.structures);
    let peak_toward = peak_toward.max_by(|a, b| a.0.force.peak_n.total_cmp(&b.0.force.peak_n));
    let plain = |label, value| (label, value, String::new());
    let mut cards = vec![
        plain("removed of what the burr can reach", percent(plan.results.coverage.reached_share())),
        plain("removed of the target", percent(plan.results.coverage.removed_share())),
        plain("total time", format!("{:.0} min {:02.0} s", (total_s / 60.0).floor(), total_s % 60.0)),
        (
            "peak force",
            format!("{:.2} N", plan.results.figures.peak_force_n),
            Peak::of(&plan.moves.waypoints).map_or(String::new(), |peak| {
                format!("<small>{}</small>", peak::place(&plan.moves.waypoints, peak.index))
            }),
        ),
    ];
    if let Some((found, structure)) = peak_toward {
        let place = found.force.peak_row.map_or(String::new(), |row| peak::place(&plan.moves.waypoints, row));
        let name = format!("<small>{}, {place}</small>", escape(&structure.name));
        cards.push(("peak force toward a structure", format!("{:.2} N", found.force.peak_n), name));
    }
    let of = |label, value_mm: f64, s: &Structure| {
        let name = format!("<small>{}, clearance {}\u{a0}mm</small>", escape(&s.name), s.clearance_mm);
        (label, format!("{value_mm:.2} mm"), name)
    };
    if let Some((margin_mm, structure)) = tightest {
        cards.insert(2, of("smallest margin (distance less clearance)", margin_mm, structure));
    }
    if let Some((distance_mm, structure)) = closest {
        cards.insert(
            2,
            of("smallest distance of the burr's surface from a structure", distance_mm, structure),
        );
    }
    let items: String = cards
        .into_iter()
        .map(|(label, value, more)| format!("<div><b>{value}</b><span>{label}</span>{more}</div>"))
        .collect();
    format!("<div class=\"cards\">{items}</div>")
}

/// The structure to which the burr's surface comes nearest, with the distance, mm; and the structure with the least distance
/// beyond its clearance, with that margin, mm. The two often differ where clearances differ.
fn closest_and_tightest<'a>(
    kept: impl Iterator<Item = (f64, &'a Structure)> + Clone,
) -> [Option<(f64, &'a Structure)>; 2] {
    let closest = kept.clone().min_by(|a, b| a.0.total_cmp(&b.0));
    let margins = kept.map(|(distance_mm, s)| (distance_mm - s.clearance_mm, s));
    [closest, margins.min_by(|a, b| a.0.total_cmp(&b.0))]
}

fn legend(plan: &Plan, ct_slices: CtSlices) -> String {
    let chip = |colour: [u8; 3], name: &str| {
        format!("<span class=\"chip\"><i style=\"background:{}\"></i>{}</span>", css(colour), escape(name))
    };
    let structures = plan.setup.case.structures.iter().enumerate();
    let structures = structures.map(|(n, s)| chip(STRUCTURE_COLOURS[n % STRUCTURE_COLOURS.len()], &s.name));
    let tints = match ct_slices {
        CtSlices::Shown => [chip(TARGET_COLOUR, "target")].into_iter().chain(structures).collect(),
        CtSlices::LeftOut => String::new(),
    };
    format!(
        "<p class=\"legend\">{tints}{}{}Letters: the patient's right, left, anterior, posterior, superior, inferior.</p>",
        chip(CUT_COLOUR, "cuts within half a layer of the slice"),
        chip(LINK_COLOUR, "links and retracts (dashed), in the same range"),
    )
}

fn charts(plan: &Plan) -> String {
    let over_time = |value: &dyn Fn(&Waypoint) -> Option<f64>| -> Vec<(f64, Option<f64>)> {
        plan.moves.waypoints.iter().map(|w| (w.time_s, value(w))).collect()
    };
    let one = |name, class, value: &dyn Fn(&Waypoint) -> Option<f64>| Series {
        name,
        class,
        points: over_time(value),
    };
    let radius = plan.setup.case.burr.radius_mm;
    let mut charts = vec![
        chart(
            "Force",
            "N",
            &[
                one("magnitude", "line-a", &|w| Some(w.force_n.norm())),
                one("toward the nearest structure", "line-b", &|w| Some(w.force_toward_n.unwrap_or(0.0))),
            ],
            &[],
        ),
        chart("Speed cap", "mm/s", &[one("speed", "line-a", &|w| Some(w.speed_mm_s))], &[]),
        chart("Mass ahead of the burr", "mg", &[one("mass", "line-a", &|w| Some(w.mass_mg))], &[]),
    ];
    if !plan.setup.case.structures.is_empty() {
        let least = plan.setup.case.structures.iter().map(|s| s.clearance_mm).fold(f64::INFINITY, f64::min);
        charts.push(chart(
            "Distance of the burr's surface from the structure with the smallest margin",
            "mm",
            &[one("distance", "line-a", &|w| w.distance_mm.map(|d| d - radius))],
            &[Level { name: "smallest clearance", value: least }],
        ));
    }
    charts.push(chart("Tilt from the approach", "°", &[one("tilt", "line-a", &|w| Some(tilt_deg(w)))], &[]));
    charts.push(free_angles(plan));
    if let Some(room) = &plan.setup.room {
        let near = |w: &Waypoint| {
            let q = plan.moves.law.sample(w.time_s).q;
            let nearest = room.nearest(&q, [f64::NEG_INFINITY, FAR_MM])?;
            Some(nearest.distance_mm.min(room.base().distance_mm))
        };
        charts.push(chart(
            "Distance of the arm's links from patient, obstacles and each other, at the waypoints",
            "mm",
            &[one("least distance", "line-a", &near)],
            &[Level { name: "clearance", value: room.clearance_mm() }],
        ));
    }
    charts.concat()
}

/// Links that are farther away are drawn at this distance, mm.
const FAR_MM: f64 = 200.0;

/// The section on the free range around the chosen axis.
fn free_angles(plan: &Plan) -> String {
    let series = |name, class, value: &dyn Fn(&OpenAround) -> Option<f64>| {
        let around = plan
            .moves
            .waypoints
            .iter()
            .zip(&plan.access.allowed)
            .map(|(w, allowed)| (w.time_s, &allowed.around));
        Series { name, class, points: around.map(|(t, a)| (t, value(a).map(f64::to_degrees))).collect() }
    };
    let in_plane = |pick: fn([f64; 3]) -> f64| {
        move |around: &OpenAround| match *around {
            OpenAround::Interval { low_rad, at_rad, high_rad } => Some(pick([low_rad, at_rad, high_rad])),
            OpenAround::Cap { .. } => None,
        }
    };
    let cap = |around: &OpenAround| match *around {
        OpenAround::Cap { radius_rad } => Some(radius_rad),
        OpenAround::Interval { .. } => None,
    };
    if plan.access.allowed.iter().any(|allowed| cap(&allowed.around).is_some()) {
        let title = "Angle around the shaft within which every tested direction is free";
        return chart(title, "°", &[series("cap", "line-a", &cap)], &[]);
    }
    let curves = [
        series("lowest free", "line-b", &in_plane(|[low, ..]| low)),
        series("highest free", "line-b", &in_plane(|[.., high]| high)),
        series("chosen", "line-a", &in_plane(|[_, at, _]| at)),
    ];
    chart("Angle of the shaft in the arm's tilt plane", "°", &curves, &[])
}

/// Angle between shaft and approach, degrees: cos = cos θ cos φ.
fn tilt_deg(waypoint: &Waypoint) -> f64 {
    (waypoint.theta_rad.cos() * waypoint.phi_rad.cos()).clamp(-1.0, 1.0).acos().to_degrees()
}

fn share(part: f64, whole: f64) -> f64 {
    if whole > 0.0 { part / whole } else { 0.0 }
}

fn coverage(plan: &Plan) -> String {
    let c = &plan.results.coverage;
    let whole_mm3 = c.target.all_mm3 + c.outside_mm3;
    let row = |name: &str, v: &Volumes| {
        format!(
            "<tr><th>{name}</th><td>{:.1}</td><td>{:.1}</td><td>{:.1}</td><td>{}</td></tr>",
            v.all_mm3,
            v.material_mm3,
            v.bone_mm3,
            percent(share(v.all_mm3, whole_mm3))
        )
    };
    let kept: String = c
        .rest
        .iter()
        .map(|(cause, v)| {
            let why = escape(&cause.text(&plan.setup.case));
            format!(
                "<tr><th>{why}</th><td>{v:.1}</td><td>{}</td></tr>",
                rounded_percent(share(*v, whole_mm3))
            )
        })
        .collect();
    format!(
        "<div class=\"wide\"><table><thead><tr><th></th><th>all [mm³]</th><th>above air [mm³]</th><th>bone [mm³]</th><th>of the target</th></tr></thead><tbody>{}{}{}</tbody></table>\
         <table><thead><tr><th>Why the rest of the target stays</th><th>[mm³]</th><th>of the target</th></tr></thead><tbody>{kept}</tbody></table></div>\
         <p class=\"note\">Shares of what is reachable and removed are cut, so that none looks like more than it is; the others are rounded.</p>\
         <p>Bone removed outside the target, by voxel centres: {:.1} mm³, {:.1} mm³ of it specks and sheets, bone thinner than the band \
         of {:.2} mm{}. Of other bone no voxel centre is deeper than {:.3} mm inside the swept ball. The planner keeps the ball from these \
         centres, so parts of voxels add up to more: <code>verify</code> counts points half as far apart, a simulation parts of voxels, and each names \
         its figure so.</p>\
         <p>Bone on the scan's edge within the burr's diameter of the target: {:.1} mm². Everything beyond the scan is unknown and counts as air.</p>",
        row("target", &c.target),
        row("reachable by the ball under the clearances", &c.reachable),
        row("removed", &c.removed),
        c.untargeted_bone_by_voxels_mm3,
        c.thin_bone_by_voxels_mm3,
        plan.setup.scene.band_mm,
        match plan.setup.case.sheets {
            Sheets::Keep => " within the band of the target (partial volume)",
            Sheets::Cut => "",
        },
        c.deepest_in_obstacle_mm,
        plan.setup.scene.edge_bone_mm2.total(),
    )
}

fn modelled(plan: &Plan) -> String {
    let m = &plan.modelled;
    let mut rows = vec![
        ("waypoints".to_owned(), m.path.waypoints.to_string()),
        ("waypoints that remove material".into(), m.path.cutting.to_string()),
        ("waypoints whose orientation cost includes the force".into(), m.axes.cost_with_force.to_string()),
        (
            "waypoints whose orientation cost leaves the force out (weight below 0.01)".into(),
            match m.axes.closed_form_error {
                error if error > 0.0 => format!(
                    "{}; the cost of no choice is worse by more than {error:.1e}",
                    m.axes.cost_closed_form
                ),
                _ => m.axes.cost_closed_form.to_string(),
            },
        ),
        (
            "error of the force of single cuts, in the mean; of the push toward structures".into(),
            format!(
                "{:.2} %; {:.2} % (measured on {} cuts by finer sums)",
                100.0 * m.axes.force_error.of_cuts_share,
                100.0 * m.axes.force_error.toward_share,
                m.axes.force_error.cuts,
            ),
        ),
        (
            "error of the removed volume, share of the target; of the least distances, between waypoints".into(),
            format!("{:+.3} %; {:.4} mm", 100.0 * m.path.error.removed_share, m.path.error.distance_mm),
        ),
        (
            "candidate directions of the shaft, before refinement".into(),
            format!("{:.1}° apart", m.axes.direction_spacing_rad.to_degrees()),
        ),
        ("moves in which the turning shank is not free throughout".into(), m.axes.blocked_turns.to_string()),
        ("milling layers".into(), m.path.layers.to_string()),
        ("direction of the lines, angle from work x".into(), format!("{:.1}°", m.path.raster_rad.to_degrees())),
        (
            "compliance of the arm".into(),
            m.arm.stiffness.map_or("not modelled: no stiffness in the case".into(), |along| {
                let toward = along.least_toward_n_mm;
                format!(
                    "Dillon et al. 2016, eq. 10; stiffness at the burr along the path: least {:.3} N/mm (waypoint {}), mean {:.3} N/mm{}",
                    along.softest_n_mm,
                    along.softest_waypoint,
                    along.mean_softest_n_mm,
                    toward.map_or(String::new(), |n_mm| format!(", at least {n_mm:.3} N/mm toward the nearest structure"))
                )
            }),
        ),
        ("CT affine".into(), escape(&plan.setup.placements[0].to_string())),
        ("label affine".into(), escape(&plan.setup.placements[1].to_string())),
    ];
    if plan.modelled.axes.mode == OrientationMode::Greedy {
        let held = m.axes.low_pass_held.to_string();
        rows.push(("waypoints at which the low-pass result was not free and was replaced".into(), held));
    }
    if let Some(lowest) = m.arm.lowest_link {
        let branch = branch_name(m.arm.branch).replace('/', ", ").replace('-', " ");
        let height =
            format!("{:.0} mm above the mounting plane, at waypoint {}", lowest.height_mm, lowest.waypoint);
        rows.push(("branch of the arm, for the whole path".into(), format!("{branch} ({})", m.arm.branch)));
        rows.push(("lowest point of the arm's links (lines from joint to joint)".into(), height));
    }
    if let Some(near) = &m.arm.link_distance {
        let said = format!("{} (robot.link_clearance_mm = {})", near.text(), near.clearance_mm);
        rows.push(("least distance of the arm's links, between the waypoints too".into(), escape(&said)));
    }
    rows.push((
        "waypoints moved to the end of the path, because the shank was not free, or the burr pushed toward a structure".into(),
        m.path.put_off.to_string(),
    ));
    rows.extend(
        dropped_by_reason(&plan.access.dropped)
            .into_iter()
            .map(|(why, n)| (format!("waypoints dropped: {}", escape(why)), n.to_string())),
    );
    let rows: String = rows.into_iter().map(|(k, v)| format!("<tr><th>{k}</th><td>{v}</td></tr>")).collect();
    format!("<div class=\"wide\"><table class=\"words\"><tbody>{rows}</tbody></table></div>")
}

/// The case, completed with the values that the plan chose.
fn as_planned(plan: &Plan) -> Case {
    let mut case = plan.setup.case.clone();
    case.approach.get_or_insert(plan.setup.scene.approach);
    case.path.raster_rad.get_or_insert(plan.modelled.path.raster_rad);
    if case.robot.base_from_ct == Registration::Assumed {
        let Rigid { rotation, translation_mm, .. } = plan.setup.registered.base_from_ct;
        case.robot.base_from_ct = Registration::Given { rotation, translation_mm };
    }
    let joints = plan.setup.arm.joints();
    let of_arm = |limit: fn(&Joint) -> f64| joints.iter().map(limit).collect();
    case.robot.velocity_limits.get_or_insert_with(|| of_arm(|joint| joint.velocity_limit));
    case.robot.acceleration_limits.get_or_insert_with(|| of_arm(|joint| joint.acceleration_limit));
    case.robot.jerk_limits.get_or_insert_with(|| of_arm(|joint| joint.jerk_limit));
    case
}

#[cfg(test)]
mod tests {
    use super::*;
    use bonemill_case::LabelRef;

    #[test]
    fn the_nearest_structure_is_not_always_the_one_with_the_least_margin() {
        let structure = |name: &str, clearance_mm| Structure {
            name: name.into(),
            label: LabelRef::Number(1),
            clearance_mm,
            priority: 1,
            shank_clearance_mm: 0.0,
        };
        let [canal, sinus] = [structure("canal", 0.4), structure("sinus", 1.0)];
        let [closest, tightest] = closest_and_tightest([(0.52, &canal), (1.02, &sinus)].into_iter());
        assert_eq!(closest.map(|(mm, s)| (mm, s.name.as_str())), Some((0.52, "canal")));
        let (margin_mm, structure) = tightest.unwrap();
        assert!((margin_mm - 0.02).abs() < 1e-12 && structure.name == "sinus");
        assert_eq!(closest_and_tightest(std::iter::empty()), [None, None]);
    }
}
