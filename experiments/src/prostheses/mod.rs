//! Drawn prostheses and the published reference, from STL to a proven program: residual areas, machining times beside those of Castelli et
//! al. 2020, Tables 2 and 3, deviation of the machined surface, seconds of computation, and the published zig-zag on the same part.

pub mod agree;

use std::time::Instant;

use bonemill_planner::Progress;
use bonemill_planner::case::prosthesis::{BlockSource, ProsthesisJob};
use bonemill_planner::part::phantom::Operculum;
use bonemill_prosthesis::catalogue::{Catalogue, CatalogueError};
use bonemill_prosthesis::machining::{self, Machining, ZigZag};
use bonemill_prosthesis::orient::Laid;
use bonemill_prosthesis::program::write;
use bonemill_prosthesis::proof::{Proof, prove};
use bonemill_prosthesis::{Placing, ProsthesisError, ProsthesisPlan, Trial, most_uncut_mm, phantom, plan};

use crate::{ExperimentError, Size, Table};

/// Facets of a part.
const FACETS: usize = 200_000;
/// Blocks of the catalogue: number, sides, mm.
const BLOCKS: [(&str, [f64; 3]); 4] = [
    ("S", [45.0, 20.0, 55.0]),
    ("M", [55.0, 25.0, 65.0]),
    ("L", [65.0, 30.0, 75.0]),
    ("XL", [90.0, 45.0, 100.0]),
];

/// Three tables: programs, orientations, the published zig-zag.
pub fn run(size: Size, progress: &dyn Progress) -> Result<Vec<Table>, ExperimentError> {
    let mut tables = Tables::new(size.seeds);
    for seed in 0..=size.seeds {
        let (name, shape) = match seed {
            0 => ("reference".to_owned(), Operculum::reference()),
            seed => (format!("seed {seed}"), Operculum::drawn(seed)),
        };
        progress.stage(&name);
        tables.part(&name, &shape)?;
    }
    Ok(vec![tables.programs, tables.orientations, tables.zigzags])
}

struct Tables {
    programs: Table,
    orientations: Table,
    zigzags: Table,
}

impl Tables {
    fn new(seeds: u64) -> Self {
        let parts = format!("The reference and seeds 1 to {seeds}, {FACETS} facets each.");
        Self {
            programs: Table::new(
                "prostheses",
                format!(
                    "From STL to a proven program. {parts} Seconds: reading and checking, orientation, toolpath and program; the proof apart. Time of machining under the \
                     machine's accelerations."
                ),
                &[
                    "part",
                    "block",
                    "size x × y × z [mm]",
                    "machining [min]",
                    "deepest gouge [mm]",
                    "thickest uncut [mm]",
                    "widest cut [mm]",
                    "collisions",
                    "left [mm³]",
                    "STL to program [s]",
                    "proof [s]",
                    "falls short",
                ],
            ),
            orientations: Table::new(
                "prostheses-orientation",
                format!(
                    "Sum of the three residual areas and machining time at constant speeds, in blocks cut to size: as given, after the first and the last run of the published \
                     procedure, and at the least residual area. {parts}"
                ),
                &[
                    "part",
                    "runs",
                    "given [mm²]",
                    "run 1 [mm²]",
                    "last run [mm²]",
                    "least [mm²]",
                    "given [min]",
                    "run 1 [min]",
                    "last run [min]",
                    "least [min]",
                ],
            ),
            zigzags: Table::new(
                "prostheses-zigzag",
                format!(
                    "The published zig-zag and ours in the same block, time at constant speeds. The zig-zag's last rows are as fine as it needs for (a) a surface error no larger than \
                     ours, (b) no stock thicker than the finishing step asks. Error: area-weighted 95th percentile of the stock left. {parts}"
                ),
                &[
                    "part",
                    "ours [min]",
                    "our error [mm]",
                    "zig-zag (a) [min]",
                    "less [%]",
                    "widest cut [mm]",
                    "zig-zag (b) [min]",
                    "less [%]",
                    "widest cut [mm]",
                ],
            ),
        }
    }

    fn part(&mut self, name: &str, shape: &Operculum) -> Result<(), ExperimentError> {
        let folder = tempfile::tempdir().map_err(ExperimentError::Folder)?;
        let job_path = phantom::write(folder.path(), shape, FACETS).map_err(ProsthesisError::from)?;
        let text = std::fs::read_to_string(&job_path).map_err(ExperimentError::Folder)?;
        let mut job = ProsthesisJob::parse(&text, &job_path)?;
        let stock = folder.path().join("stock.toml");
        let refuse = |source: CatalogueError| ProsthesisError::Catalogue { path: stock.clone(), source };
        let catalogue = Catalogue::open_or_create(&stock).map_err(refuse)?;
        for (id, size_mm) in BLOCKS {
            catalogue.add(id, size_mm, 1).map_err(refuse)?;
        }
        job.stock.source = BlockSource::Catalogue(stock.clone());
        let clock = Clock::default();
        match plan(&job, &job_path, None, &clock) {
            Ok(plan) => {
                self.program(name, &plan, &clock.seconds());
                self.orientation(name, &job, &plan);
                self.zigzag(name, &job, &plan)?;
            }
            Err(error) => {
                self.programs.push_note(name.into(), error.to_string());
                self.programs.shortfalls.push(format!("{name}: {error}"));
            }
        }
        Ok(())
    }

    fn program(&mut self, name: &str, plan: &ProsthesisPlan, seconds: &[(String, f64)]) {
        let proof = &plan.proof;
        let s = &plan.placing.chosen.size_mm;
        let proving: f64 = seconds.iter().filter(|(stage, _)| stage == "prove program").map(|(_, s)| s).sum();
        let all: f64 = seconds.iter().map(|(_, s)| s).sum();
        self.programs.push(vec![
            name.into(),
            plan.taken.mounted.id.clone(),
            format!("{:.1} × {:.1} × {:.1}", s.x, s.y, s.z),
            format!("{:.1}", plan.machining.times.limited_s / 60.0),
            format!("{:.4}", proof.deepest_gouge_mm),
            format!("{:.3}", proof.thickest_uncut_mm),
            format!("{:.2}", proof.widest_mm),
            proof.collisions.len().to_string(),
            format!("{:.1}", plan.machining.left_mm3()),
            format!("{:.1}", all - proving),
            format!("{proving:.1}"),
            if plan.shortfalls.is_empty() { "no".into() } else { plan.shortfalls.join("; ") },
        ]);
        self.programs.shortfalls.extend(plan.shortfalls.iter().map(|reason| format!("{name}: {reason}")));
    }

    fn orientation(&mut self, name: &str, job: &ProsthesisJob, plan: &ProsthesisPlan) {
        let Placing { given, runs, exact, .. } = &plan.placing;
        let laid = [Some(given), runs.first().map(|r| &r.laid), runs.last().map(|r| &r.laid), exact.as_ref()];
        let area =
            |laid: Option<&Laid>| laid.map_or("-".into(), |laid| format!("{:.1}", laid.residual.sum_mm2()));
        let time = |laid: Option<&Laid>| laid.map_or("-".into(), |laid| minutes(job, plan, laid));
        let mut row = vec![name.to_owned(), runs.len().to_string()];
        row.extend(laid.map(area));
        row.extend(laid.map(time));
        if let (Some(last), Some(exact)) = (runs.last(), exact)
            && exact.residual.sum_mm2() > last.laid.residual.sum_mm2()
        {
            self.orientations
                .shortfalls
                .push(format!("{name}: the exact orientation is worse than the published one"));
        }
        self.orientations.push(row);
    }

    fn zigzag(
        &mut self,
        name: &str,
        job: &ProsthesisJob,
        plan: &ProsthesisPlan,
    ) -> Result<(), ExperimentError> {
        let trial = Trial::new(job, &plan.solid, &plan.placing.chosen);
        let judged = |machining: &Machining| -> Result<Proof, ExperimentError> {
            let program = write(&machining.moves, &trial.machining, "a test", &[]);
            let proof = prove(&program, &trial.part, &trial.proof_job(job, machining));
            Ok(proof.map_err(ProsthesisError::from)?)
        };
        let ours = machining::plan(&trial.part, &trial.machining)?;
        let our_error_mm = error_mm(&judged(&ours)?);
        let (rows_mm, level_mm) = (trial.machining.widest_mm(), trial.machining.level_mm());
        let ours_min = ours.times.constant_s / 60.0;
        let mut row = vec![name.to_owned(), format!("{ours_min:.1}"), format!("{our_error_mm:.3}")];
        let most_mm = most_uncut_mm(job.process.finishing_step_mm);
        // rows half as wide each time leave a quarter of the height; the last are 0.12 mm apart
        let mut found = [None; 2];
        for halving in 0..5 {
            let last_row_mm = rows_mm / 2f64.powi(halving);
            let rows =
                ZigZag { row_mm: rows_mm, plane_mm: level_mm, fine_plane_mm: level_mm / 2.0, last_row_mm };
            let published = machining::plan_zigzag(&trial.part, &trial.machining, &rows)?;
            let proof = judged(&published)?;
            let enough = [error_mm(&proof) <= our_error_mm, proof.thickest_uncut_mm <= most_mm];
            for (found, _) in
                found.iter_mut().zip(enough).filter(|(found, enough)| *enough && found.is_none())
            {
                *found = Some((published.times.constant_s / 60.0, proof.widest_mm));
            }
            if found.iter().all(Option::is_some) {
                break;
            }
        }
        for found in found {
            row.extend(match found {
                Some((its_min, widest_mm)) => [
                    format!("{its_min:.1}"),
                    format!("{:.0}", 100.0 * (1.0 - ours_min / its_min)),
                    format!("{widest_mm:.2}"),
                ],
                None => ["-", "-", "-"].map(String::from),
            });
        }
        self.zigzags.push(row);
        Ok(())
    }
}

/// Time of machining in a block cut to size, min; a star where stock stays that the cutter does not reach.
fn minutes(job: &ProsthesisJob, plan: &ProsthesisPlan, laid: &Laid) -> String {
    let trial = Trial::new(job, &plan.solid, laid);
    match machining::plan(&trial.part, &trial.machining) {
        Ok(machining) => {
            let stays = machining.left_mm3() > 1.0;
            format!("{:.1}{}", machining.times.constant_s / 60.0, if stays { "*" } else { "" })
        }
        Err(error) => error.to_string(),
    }
}

/// The stock left that 95 % of the part's area stays below, mm.
fn error_mm(proof: &Proof) -> f64 {
    let mut samples: Vec<(f64, f64)> = proof.samples.iter().map(|s| (s.deviation_mm, s.area_mm2)).collect();
    samples.sort_by(|a, b| a.0.total_cmp(&b.0));
    let all: f64 = samples.iter().map(|s| s.1).sum();
    let mut below = 0.0;
    let at = samples.iter().find(|(_, area)| {
        below += area;
        below >= 0.95 * all
    });
    at.map_or(0.0, |s| s.0)
}

/// Seconds by stage.
#[derive(Default)]
struct Clock(std::cell::RefCell<Vec<(String, Instant)>>);

impl Clock {
    fn seconds(&self) -> Vec<(String, f64)> {
        let stages = self.0.borrow();
        let now = Instant::now();
        let ends = stages.iter().skip(1).map(|(_, since)| *since).chain([now]);
        stages
            .iter()
            .zip(ends)
            .map(|((name, since), end)| (name.clone(), (end - *since).as_secs_f64()))
            .collect()
    }
}

impl Progress for Clock {
    fn stage(&self, name: &str) {
        self.0.borrow_mut().push((name.into(), Instant::now()));
    }
    fn advance(&self, _: usize, _: usize) {}
}
