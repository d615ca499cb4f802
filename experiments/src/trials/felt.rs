//! Whole plans beside what a user could do instead, driven by the same arm in the same time: the two controls (straight shaft, constant
//! speed, lines along and across) and the straight shaft with the least force.
//!
//! Figures are those that the plan states at the speeds that are driven: toward each structure of the highest priority while the burr's
//! surface is within 2 mm of it, and in any direction. Changes are computed for each body and then averaged; the worst body is also given.

use bonemill_imaging::phantom::{BlockParams, NerveSide, PhantomKind, block, phantom};
use bonemill_planner::Progress;
use bonemill_planner::case::{Case, OrientationMode, Registration, Sense, SpeedMode};
use bonemill_planner::pipeline::{JUDGED, Plan, StructureForces, plan};

use super::percent;
use crate::body::{self, Body};
use crate::{ExperimentError, Size, Table};

pub(super) const COLUMNS: [&str; 5] =
    ["mean toward, F_v > 0", "mean toward, zeros in", "peak toward", "mean |F|", "peak |F|"];
/// Beside controls no change is computed where their force is below the first of these, N, beside the straight shaft below the second.
const LEAST_N: [f64; 2] = [0.01, 0.001];
/// A figure counts as above another from this share on.
const SAME_SHARE: f64 = 0.02;
/// Largest number of heads, and of bodies whose levers are taken apart.
const MOST_HEADS: u64 = 4;
const MOST_APART: u64 = 2;

/// An arm, and how many angles it chooses.
#[derive(Debug, Clone, Copy)]
pub(super) enum ArmKind {
    BoneAttached,
    Ur5e(u32),
}

impl ArmKind {
    const ALL: [Self; 3] = [Self::BoneAttached, Self::Ur5e(1), Self::Ur5e(2)];

    fn name(self) -> String {
        match self {
            Self::BoneAttached => "bone-attached, 1 angle".into(),
            Self::Ur5e(1) => "UR5e, 1 angle".into(),
            Self::Ur5e(angles) => format!("UR5e, {angles} angles"),
        }
    }

    /// A case with this arm; a UR with the README's mount.
    pub(super) fn put_into(self, case: &mut Case) {
        if let Self::Ur5e(angles) = self {
            case.orientation.angles = angles;
            case.robot.model = "ur5e".into();
            case.robot.base_from_ct = Registration::Assumed;
            case.robot.flange_from_burr = Some(([0.0, -90.0, 155.0], [2.618, 0.0, 0.0]));
        }
    }
}

/// Figures in the order of [`COLUMNS`], of the force toward one structure, N.
fn figures(forces: &StructureForces, structure: usize) -> [f64; 5] {
    let near = &forces.structures[structure].near;
    let [mean, zeros, peak] = JUDGED.map(|(_, figure)| figure(near));
    [mean, zeros, peak, forces.mean_n, forces.peak_n]
}

/// Figures of a plan and its references for one structure.
pub(super) struct Row {
    body: String,
    structure: String,
    priority: u32,
    /// Whether its case has no structure of a higher priority.
    is_first: bool,
    controls: Vec<[f64; 5]>,
    straight: Option<[f64; 5]>,
    plan: [f64; 5],
    /// Total time of the plan, s, and how long planning took, s.
    total_s: f64,
    seconds: f64,
    falls_short: bool,
}

impl Row {
    /// Changes against the mean of the controls, and against the straight shaft, %.
    pub(super) fn changes(&self) -> [[Option<f64>; 5]; 2] {
        let n = self.controls.len().max(1) as f64;
        let change = |k: usize, of: Option<f64>, least_n: f64| {
            of.filter(|of| *of >= least_n).map(|of| 100.0 * (self.plan[k] / of - 1.0))
        };
        [
            std::array::from_fn(|k| {
                change(k, Some(self.controls.iter().map(|c| c[k]).sum::<f64>() / n), LEAST_N[0])
            }),
            std::array::from_fn(|k| change(k, self.straight.map(|s| s[k]), LEAST_N[1])),
        ]
    }

    /// Number of figures toward the structure that are above the better control's, and above the straight shaft's.
    fn worse(&self) -> [usize; 2] {
        let better = |k: usize| self.controls.iter().map(|c| c[k]).fold(f64::INFINITY, f64::min);
        let above = |of: &dyn Fn(usize) -> f64| {
            let is_above = |k: &usize| self.plan[*k] > of(*k).max(LEAST_N[1]) * (1.0 + SAME_SHARE);
            (0..JUDGED.len()).filter(is_above).count()
        };
        [above(&better), above(&|k| self.straight.map_or(f64::INFINITY, |s| s[k]))]
    }
}

/// The rows of a plan: one per structure near which the plan or a reference has a force toward it.
pub(super) fn rows(name: &str, plan: &Plan) -> Vec<Row> {
    let compared = &plan.results.compared;
    let structures = plan.setup.case.structures.iter().enumerate();
    let row = |(n, s): (usize, &bonemill_planner::case::Structure)| Row {
        body: name.to_owned(),
        structure: s.name.clone(),
        priority: s.priority,
        is_first: plan.setup.case.rank(n) <= 1.0,
        controls: compared.controls.iter().map(|c| figures(&c.forces, n)).collect(),
        straight: compared.straight.as_ref().map(|s| figures(&s.forces, n)),
        plan: figures(&compared.plan, n),
        total_s: plan.moves.law.duration_s(),
        seconds: plan.seconds.iter().map(|(_, s)| s).sum(),
        // a time that the case does not give is missed with a warning
        falls_short: !plan.shortfalls.is_empty()
            || plan.warnings.iter().any(|said| said.contains("cannot be met")),
    };
    let is_near = |row: &Row| row.controls.iter().chain([&row.plan]).any(|f| f[2] > 0.0);
    structures.map(row).filter(is_near).collect()
}

pub(super) fn planned(
    name: &str,
    body: &Body,
    adjust: impl Fn(&mut Case),
) -> Result<Vec<Row>, ExperimentError> {
    let mut case = body.case(false)?;
    case.speed.mode = SpeedMode::LeastForce;
    adjust(&mut case);
    Ok(rows(name, &plan(&case, body.case_path(), &())?))
}

/// Bodies of one kind, each with its name.
type Kind = (String, Vec<(String, Body)>);

fn bodies(size: Size) -> Result<Vec<Kind>, ExperimentError> {
    let sides = [
        (NerveSide::BesideTiltPlane, "block, nerve beside the tilt plane"),
        (NerveSide::InTiltPlane, "block, nerve in the tilt plane"),
    ];
    let mut groups = Vec::new();
    for (nerve, name) in sides {
        let params = BlockParams { nerve, ..BlockParams::paper() };
        let body = |seed: u64| Ok((format!("{name}, seed {seed}"), Body::phantom(&block(&params, seed))?));
        let bodies = (1..=size.seeds).map(body).collect::<Result<_, ExperimentError>>()?;
        groups.push((name.to_owned(), bodies));
    }
    let head = |seed: u64| {
        Ok((format!("temporal, seed {seed}"), Body::phantom(&phantom(PhantomKind::Temporal, seed))?))
    };
    let heads = (1..=size.seeds.min(MOST_HEADS)).map(head).collect::<Result<_, ExperimentError>>()?;
    groups.push(("temporal".to_owned(), heads));
    let scan = Body::case_file(&body::data().join("tbone_RT143/case.toml"));
    groups.extend(scan.map(|scan| ("tbone_RT143".to_owned(), vec![("tbone_RT143".to_owned(), scan)])));
    Ok(groups)
}

/// Runs blocks with the nerve in both planes, heads, and a scan if available, with both arms.
///
/// # Errors
/// When a body cannot be made or planned.
pub fn run(size: Size, progress: &dyn Progress) -> Result<Vec<Table>, ExperimentError> {
    let bodies = bodies(size)?;
    let mut groups: Vec<(String, String, Vec<Row>)> = Vec::new();
    for arm in ArmKind::ALL {
        for (name, bodies) in &bodies {
            progress.stage(name);
            let mut found = Vec::new();
            for (name, body) in bodies {
                found.extend(planned(name, body, |case| arm.put_into(case))?);
            }
            groups.push((name.clone(), arm.name(), found));
        }
    }
    progress.stage("levers");
    Ok(vec![summary(size, &groups), each(&groups), levers(size, &bodies)?])
}

/// Change in % of the rows, mean ± standard deviation / worst, against each kind of reference.
pub(super) fn change_cells(rows: &[&Row]) -> Vec<String> {
    let changes: Vec<_> = rows.iter().map(|r| r.changes()).collect();
    let cell = |of: usize, k: usize| {
        let worst = changes.iter().filter_map(|c| c[of][k]).max_by(f64::total_cmp);
        let worst = worst.map_or("-".into(), |worst| format!("{worst:+.0}"));
        format!("{} / {worst}", percent(changes.iter().map(|c| c[of][k])))
    };
    (0..COLUMNS.len()).map(|k| format!("{}; {}", cell(0, k), cell(1, k))).collect()
}

/// Summary of the forces toward structures of the highest priority, by group.
fn summary(size: Size, groups: &[(String, String, Vec<Row>)]) -> Table {
    let title = format!(
        "Toward structures of the highest priority, the burr's surface within 2 mm, and in any direction: change in % against the mean of the \
         two controls; against the straight shaft with the least force. All are driven by the same arm in the same time. Mean ± \
         standard deviation over the bodies / worst body; {} seeds. References below {} and {} N are left out. Above: figures toward \
         these structures (of any) that are more than 2 % above the better control's, the straight shaft's, of how many.",
        size.seeds, LEAST_N[0], LEAST_N[1]
    );
    let head: Vec<&str> =
        ["body", "arm"].into_iter().chain(COLUMNS).chain(["above", "planning [s]"]).collect();
    let mut table = Table::new("trials-felt", title, &head);
    for (name, arm, rows) in groups {
        let first: Vec<&Row> = rows.iter().filter(|r| r.is_first).collect();
        let above = |rows: &[&Row]| {
            let worse = rows.iter().map(|r| r.worse()).fold([0; 2], |sum, w| [sum[0] + w[0], sum[1] + w[1]]);
            format!("{}, {} of {}", worse[0], worse[1], rows.len() * JUDGED.len())
        };
        let counts = format!("{} ({})", above(&first), above(&rows.iter().collect::<Vec<_>>()));
        let mean_s = first.iter().map(|r| r.seconds).sum::<f64>() / first.len().max(1) as f64;
        let end = [counts, format!("{mean_s:.0}")];
        table.push([name.clone(), arm.clone()].into_iter().chain(change_cells(&first)).chain(end).collect());
    }
    table
}

/// The figures of every body and structure, in newtons.
fn each(groups: &[(String, String, Vec<Row>)]) -> Table {
    let head: Vec<String> = ["body", "arm", "structure"]
        .map(str::to_owned)
        .into_iter()
        .chain(COLUMNS.iter().map(|c| format!("{c} [N]")))
        .chain(["total time [s]".into(), "falls short".into(), "planning [s]".into()])
        .collect();
    let head: Vec<&str> = head.iter().map(String::as_str).collect();
    let title = "Control along / control across / straight shaft with the least force / plan.";
    let mut table = Table::new("trials-felt-bodies", title, &head);
    for (_, arm, rows) in groups {
        for row in rows {
            let figure = |k: usize| {
                let all = row.controls.iter().chain(&row.straight).chain([&row.plan]);
                all.map(|f| format!("{:.4}", f[k])).collect::<Vec<_>>().join(" / ")
            };
            let short = if row.falls_short { "yes" } else { "no" };
            let end = [format!("{:.1}", row.total_s), short.into(), format!("{:.1}", row.seconds)];
            let start = [row.body.clone(), arm.clone(), format!("{} ({})", row.structure, row.priority)];
            table.push(start.into_iter().chain((0..COLUMNS.len()).map(figure)).chain(end).collect());
        }
    }
    table
}

/// Levers: whether lines and their sense, speeds and tilt are chosen.
const LEVERS: [(&str, [bool; 3]); 4] = [
    ("lines and their sense", [true, false, false]),
    ("speeds", [false, true, false]),
    ("tilt", [false, false, true]),
    ("all", [true, true, true]),
];

/// A case in which only some levers are used; the others are as in a control.
fn only([lines, speeds, tilts]: [bool; 3], case: &mut Case) {
    if !lines {
        case.path.sense = Sense::Both;
        case.path.raster_rad = Some(case.path.raster_rad.unwrap_or(0.0));
    }
    if !speeds {
        case.speed.mode = SpeedMode::Constant;
    }
    if !tilts {
        case.orientation.mode = OrientationMode::Fixed;
    }
}

/// What each lever gives alone, in the time of the default plan.
fn levers(size: Size, bodies: &[Kind]) -> Result<Table, ExperimentError> {
    let title = "Levers alone and together, bone-attached arm: change in % against the mean of the two controls; against the \
                 straight shaft with the least force, mean ± standard deviation over the bodies / worst.";
    let head: Vec<&str> = ["bodies", "lever"].into_iter().chain(COLUMNS).collect();
    let mut table = Table::new("trials-felt-levers", title, &head);
    for (name, bodies) in bodies {
        let mut found: [Vec<Row>; 4] = Default::default();
        for (name, body) in bodies.iter().take(size.seeds.min(MOST_APART) as usize) {
            let mut total_s = None;
            // all of them first: that plan has the time of the others
            for (rows, (_, levers)) in found.iter_mut().zip(LEVERS).rev() {
                let plan = planned(name, body, |case| {
                    case.speed.total_time_s = total_s;
                    only(levers, case);
                })?;
                total_s = total_s.or_else(|| plan.first().map(|row| row.total_s));
                rows.extend(plan);
            }
        }
        for (rows, (lever, _)) in found.iter().zip(LEVERS) {
            let first: Vec<&Row> = rows.iter().filter(|r| r.is_first).collect();
            table.push([name.clone(), lever.into()].into_iter().chain(change_cells(&first)).collect());
        }
    }
    Ok(table)
}
