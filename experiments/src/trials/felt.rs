//! Forces toward structures in complete plans, compared with each plan's controls: a straight shaft at constant speed in the
//! same time, along lines in two directions.
//!
//! Changes are computed for each body against the mean of its two controls, then averaged; the worst body is also given. The
//! number of figures above the better of the two controls is counted, for every structure of the body.
//!
//! For comparison, each plan also has the forces with the best axis of each waypoint alone along the same path: the axis with
//! the least force toward the nearest structure, as if the shaft could turn at once, with the least force in the plan's time. No
//! sequence of axes has a smaller push at any waypoint. Its mean over F_v > 0 may still be above the plan's, because it is a
//! mean over fewer waypoints.

use bonemill_imaging::phantom::{BlockParams, NerveSide, PhantomKind, block, phantom};
use bonemill_planner::Progress;
use bonemill_planner::case::{Case, CostSpec, Registration, SpeedMode};
use bonemill_planner::cost::SeveralStructures;
use bonemill_planner::path::MoveKind;
use bonemill_planner::pipeline::{Choices, JUDGED, Plan, Prepared, StructureForces, plan, with_prepared};

use super::percent;
use crate::body::{self, Body};
use crate::{ExperimentError, Size, Table};

const COLUMNS: [&str; 5] =
    ["mean toward, F_v > 0", "mean toward, zeros in", "peak toward", "peak |F|", "mean |F|"];
/// No change is computed where the control's force is below this, N.
const LEAST_N: f64 = 0.01;
/// Largest number of heads.
const MOST_HEADS: u64 = 4;

/// Figures in the order of [`COLUMNS`], of the force toward one structure, N.
fn figures(forces: &StructureForces, structure: usize) -> [f64; 5] {
    let near = &forces.structures[structure].near;
    let [mean, zeros, peak] = JUDGED.map(|(_, figure)| figure(near));
    [mean, zeros, peak, forces.peak_n, forces.mean_n]
}

/// Figures of a plan and its controls for one structure.
struct Row {
    body: String,
    structure: String,
    priority: u32,
    controls: Vec<[f64; 5]>,
    plan: [f64; 5],
    /// Figures with every waypoint's best axis alone.
    alone: [f64; 5],
    seconds: f64,
}

impl Row {
    /// Changes against the mean of the controls, %.
    fn changes(&self) -> [Option<f64>; 5] {
        let n = self.controls.len().max(1) as f64;
        std::array::from_fn(|k| {
            let control = self.controls.iter().map(|c| c[k]).sum::<f64>() / n;
            (control >= LEAST_N).then(|| 100.0 * (self.plan[k] / control - 1.0))
        })
    }

    /// Number of figures that are above the better control's.
    fn worse(&self) -> usize {
        let better = |k: usize| self.controls.iter().map(|c| c[k]).fold(f64::INFINITY, f64::min);
        (0..JUDGED.len()).filter(|k| self.plan[*k] > better(*k).max(LEAST_N) * (1.0 + 1e-6)).count()
    }
}

/// The rows of a plan: one per structure near which the plan or a control has a force toward it.
fn rows(name: &str, plan: &Plan, alone: &StructureForces) -> Vec<Row> {
    let structures = plan.setup.case.structures.iter().enumerate();
    let row = |(n, s): (usize, &bonemill_planner::case::Structure)| Row {
        body: name.to_owned(),
        structure: s.name.clone(),
        priority: s.priority,
        controls: plan.results.compared.controls.iter().map(|c| figures(&c.forces, n)).collect(),
        plan: figures(&plan.results.compared.plan, n),
        alone: figures(alone, n),
        seconds: plan.seconds.iter().map(|(_, s)| s).sum(),
    };
    let is_near = |row: &Row| row.controls.iter().chain([&row.plan]).any(|f| f[2] > 0.0);
    structures.map(row).filter(is_near).collect()
}

/// The forces with the best axis of each waypoint alone, in the time that the plan takes for its cuts.
fn alone(plan: &Plan, body: &Body) -> Result<StructureForces, ExperimentError> {
    let planned = Choices::of(&plan.setup.case);
    // the cost is only the push toward the nearest structure
    let cost = CostSpec {
        structures: SeveralStructures::Nearest,
        kappa_per_mm: 0.0,
        alpha_max: 1.0,
        ..planned.cost
    };
    let nearest_only = Choices { cost, ..planned.clone() };
    let cuts = plan.moves.waypoints.windows(2).filter(|pair| pair[1].kind == MoveKind::Cut);
    let cutting_s =
        cuts.map(|pair| pair[0].position.distance_mm(&pair[1].position) / pair[1].speed_mm_s).sum();
    let forces = |prepared: &Prepared| {
        let chosen = prepared.choose_alone(&nearest_only)?;
        let speed_mm_s = prepared.speeds(&planned, &chosen, Some(cutting_s))?;
        Ok(prepared.structure_forces(&chosen, &speed_mm_s))
    };
    Ok(with_prepared(&plan.setup.case, body.case_path(), &(), forces)?)
}

fn planned(name: &str, body: &Body, adjust: impl Fn(&mut Case)) -> Result<Vec<Row>, ExperimentError> {
    let mut case = body.case(false)?;
    case.speed.mode = SpeedMode::LeastForce;
    adjust(&mut case);
    let plan = plan(&case, body.case_path(), &())?;
    Ok(rows(name, &plan, &alone(&plan, body)?))
}

/// Runs blocks with the nerve in both planes, heads, and a scan if available.
///
/// # Errors
/// When a body cannot be made or planned.
pub fn run(size: Size, progress: &dyn Progress) -> Result<Vec<Table>, ExperimentError> {
    let sides = [
        (NerveSide::BesideTiltPlane, "block, nerve beside the tilt plane"),
        (NerveSide::InTiltPlane, "block, nerve in the tilt plane"),
    ];
    let mut groups: Vec<(String, u32, Vec<Row>)> = Vec::new();
    for angles in [1, 2] {
        let one_or_two = |case: &mut Case| {
            if angles == 2 {
                // the bone-attached arm has one tilt angle; the place of a UR is assumed
                case.orientation.angles = angles;
                case.robot.model = "ur5e".into();
                case.robot.base_from_ct = Registration::Assumed;
                case.robot.flange_from_burr = Some(([0.0, 0.0, 180.0], [std::f64::consts::PI, 0.0, 0.0]));
            }
        };
        for (nerve, name) in sides {
            let mut found = Vec::new();
            for seed in 1..=size.seeds {
                progress.stage("blocks");
                let params = BlockParams { nerve, ..BlockParams::paper() };
                let body = Body::phantom(&block(&params, seed))?;
                found.extend(planned(&format!("{name}, seed {seed}"), &body, one_or_two)?);
            }
            groups.push((name.into(), angles, found));
        }
        let mut found = Vec::new();
        for seed in 1..=size.seeds.min(MOST_HEADS) {
            progress.stage("heads");
            let body = Body::phantom(&phantom(PhantomKind::Temporal, seed))?;
            found.extend(planned(&format!("temporal {seed}"), &body, one_or_two)?);
        }
        groups.push(("temporal".into(), angles, found));
        if let Some(body) = Body::case_file(&body::data().join("tbone_RT143/case.toml")) {
            progress.stage("scan");
            groups.push(("tbone_RT143".into(), angles, planned("tbone_RT143", &body, one_or_two)?));
        }
    }
    Ok(vec![summary(size, &groups), each(&groups)])
}

/// Summary of the forces toward structures of priority 1, by group.
fn summary(size: Size, groups: &[(String, u32, Vec<Row>)]) -> Table {
    let title = format!(
        "Toward structures of priority 1, the burr's surface within 2 mm: change in % against the mean of two controls (straight \
         shaft, constant speed, the same time; lines in two directions), mean ± standard deviation over the bodies / worst body; {} \
         seeds. Controls below {LEAST_N} N are left out. Worse: figures above the better control's, toward priority 1 / toward any \
         structure, of how many.",
        size.seeds
    );
    let head = ["body", "angles"].iter().chain(&COLUMNS).chain(&["worse"]).copied().collect::<Vec<_>>();
    let mut table = Table::new("trials-felt", title, &head);
    for (name, angles, rows) in groups {
        let first: Vec<&Row> = rows.iter().filter(|r| r.priority == 1).collect();
        let changes: Vec<_> = first.iter().map(|r| r.changes()).collect();
        let figure = |k: usize| {
            let worst = changes.iter().filter_map(|c| c[k]).max_by(f64::total_cmp);
            let worst = worst.map_or("-".into(), |worst| format!("{worst:+.0}"));
            format!("{} / {worst}", percent(changes.iter().map(|c| c[k])))
        };
        let worse = |rows: &[&Row]| rows.iter().map(|r| r.worse()).sum::<usize>();
        let all: Vec<&Row> = rows.iter().collect();
        let counts = format!(
            "{} of {} / {} of {}",
            worse(&first),
            first.len() * JUDGED.len(),
            worse(&all),
            all.len() * JUDGED.len()
        );
        let cells = (0..COLUMNS.len()).map(figure).chain([counts]);
        table.push([name.clone(), angles.to_string()].into_iter().chain(cells).collect());
    }
    table
}

/// The figures of every body and structure, in newtons.
fn each(groups: &[(String, u32, Vec<Row>)]) -> Table {
    let head: Vec<String> = ["body", "angles", "structure"]
        .map(str::to_owned)
        .into_iter()
        .chain(COLUMNS.iter().map(|c| format!("{c} [N]")))
        .chain(["worse".into(), "planning [s]".into()])
        .collect();
    let head: Vec<&str> = head.iter().map(String::as_str).collect();
    let title = "Control along the plan's lines / control across / plan / each waypoint's best axis alone.";
    let mut table = Table::new("trials-felt-bodies", title, &head);
    for (_, angles, rows) in groups {
        for row in rows {
            let figure = |k: usize| {
                let all = row.controls.iter().chain([&row.plan, &row.alone]);
                all.map(|f| format!("{:.3}", f[k])).collect::<Vec<_>>().join(" / ")
            };
            let cells = (0..COLUMNS.len()).map(figure);
            let end = [row.worse().to_string(), format!("{:.1}", row.seconds)];
            let start =
                [row.body.clone(), angles.to_string(), format!("{} ({})", row.structure, row.priority)];
            table.push(start.into_iter().chain(cells).chain(end).collect());
        }
    }
    table
}
