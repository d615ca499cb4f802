//! The three trials of Dillon et al. 2016 (D III, IV) on the foam block: control (constant angle and speed), angle (chosen
//! angle, constant speed), full (chosen angle, speed by mass, equal time), each greedy and optimal.
//!
//! D milled one block three times. Here one path is laid per block, and spin, material, weights, angles and speeds vary on it;
//! forces are computed by the model. The reductions are computed per block and then averaged, so that each block is its own
//! control.

mod felt;
mod figures;
mod sweep;
mod turning;

use std::f64::consts::FRAC_PI_2;

use bonemill_imaging::phantom::{BlockParams, NerveSide, block};
use bonemill_planner::Progress;
use bonemill_planner::case::{Case, OrientationMode, Sense, SpeedMode};
use bonemill_planner::pipeline::{Choices, Chosen, Prepared, with_prepared};
use bonemill_planner::toward::NEAR_MM;

use crate::body::Body;
use crate::{ExperimentError, Size, Table};
pub use felt::run as felt;
use figures::{CutSample, TrialFigures};
pub use sweep::run as sweep;
pub use turning::run as turning;

/// D's reductions, in the order of [`TrialFigures::values`], %: trial 2 and trial 3 against trial 1; `None` where D gives none.
const PAPER: [[Option<f64>; 7]; 2] = [
    [Some(-37.0), None, Some(-25.0), None, Some(-27.0), None, None],
    [Some(-63.0), None, Some(-51.0), None, Some(-50.0), Some(-10.0), Some(-48.0)],
];
const COLUMNS: [&str; 7] = [
    "mean toward, F_v > 0",
    "mean toward, zeros in",
    "p75 toward, F_v > 0",
    "p75 toward, zeros in",
    "peak toward",
    "mean |F|",
    "peak |F|",
];

/// No change is computed where the control's force is below this, N.
const LEAST_N: f64 = 0.01;

/// Changes in the order of [`TrialFigures::values`], %.
type Changes = [Option<f64>; 7];

/// One block, the position of its nerve and the direction of the lines.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BlockSetup {
    /// Seed of the block's air cells.
    pub seed: u64,
    /// The wall that the nerve passes.
    pub nerve: NerveSide,
    /// Direction of the lines from work x, rad.
    pub raster_rad: f64,
}

/// Figures of the control, the angle trial and the full trial, for one orientation mode.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Trials {
    /// Constant angle and speed.
    pub control: TrialFigures,
    /// Chosen angle.
    pub angle: TrialFigures,
    /// Chosen angle and speed.
    pub full: TrialFigures,
}

impl Trials {
    /// Changes of trials 2 and 3 against the control, %, in the order of [`TrialFigures::values`]; `None` for forces below
    /// [`LEAST_N`].
    fn changes(&self) -> [Changes; 2] {
        let control = self.control.values();
        [self.angle, self.full].map(|trial| {
            let v = trial.values();
            std::array::from_fn(|k| (control[k] >= LEAST_N).then(|| 100.0 * (v[k] / control[k] - 1.0)))
        })
    }
}

/// Prepares a block and calls `work` with it, with the paper's defaults or this project's; `adjust` changes the case before the
/// path is laid.
fn on_block<R>(
    setup: &BlockSetup,
    adjust: impl Fn(&mut Case),
    work: impl FnOnce(&Body, &Prepared) -> Result<R, ExperimentError>,
) -> Result<R, ExperimentError> {
    let params = BlockParams { nerve: setup.nerve, ..BlockParams::paper() };
    let body = Body::phantom(&block(&params, setup.seed))?;
    let mut case = body.case(false)?;
    case.path.raster_rad = Some(setup.raster_rad);
    case.path.sense = Sense::Both;
    adjust(&mut case);
    with_prepared(&case, body.case_path(), &(), |prepared| Ok(work(&body, prepared)))?
}

/// The three trials with one orientation mode, for a case that matches the prepared block.
fn trials(
    prepared: &Prepared,
    case: &Case,
    control: &Chosen,
    mode: OrientationMode,
) -> Result<Trials, ExperimentError> {
    let mut choices = Choices { mode, ..Choices::of(case) };
    choices.speed.mode = SpeedMode::Constant;
    let chosen = prepared.choose(&choices)?;
    let constant = prepared.speeds(&choices, &chosen, None)?;
    let control_speeds = prepared.speeds(&choices, control, None)?;
    let cutting_s = samples(prepared, control, &control_speeds).iter().map(|s| s.seconds).sum();
    let angle = TrialFigures::of(&samples(prepared, &chosen, &constant));
    choices.speed.mode = SpeedMode::Mass;
    let by_mass = prepared.speeds(&choices, &chosen, Some(cutting_s))?;
    Ok(Trials {
        control: TrialFigures::of(&samples(prepared, control, &control_speeds)),
        angle,
        full: TrialFigures::of(&samples(prepared, &chosen, &by_mass)),
    })
}

/// The control's axes and forces.
fn control(prepared: &Prepared, case: &Case) -> Result<Chosen, ExperimentError> {
    let mut choices = Choices { mode: OrientationMode::Fixed, ..Choices::of(case) };
    choices.speed.mode = SpeedMode::Constant;
    Ok(prepared.choose(&choices)?)
}

/// The cuts as samples, at these speeds.
fn samples(prepared: &Prepared, chosen: &Chosen, speed_mm_s: &[f64]) -> Vec<CutSample> {
    let radius_mm = prepared.radius_mm();
    (0..speed_mm_s.len())
        .filter_map(|i| {
            let force = chosen.forces[i]?.force_n(speed_mm_s[i]);
            let near = prepared.nearest(i).filter(|n| n.distance_mm - radius_mm <= NEAR_MM);
            Some(CutSample {
                seconds: prepared.length_mm()[i] / speed_mm_s[i],
                force_n: force.norm(),
                toward_n: near.map(|n| force.dot(&n.toward).max(0.0)),
            })
        })
        .collect()
}

/// Positions of the nerve: beside the tilt plane and in it.
const NERVES: [(NerveSide, &str); 2] =
    [(NerveSide::BesideTiltPlane, "beside the tilt plane"), (NerveSide::InTiltPlane, "in the tilt plane")];
const RASTERS: [f64; 2] = [0.0, FRAC_PI_2];
const MODES: [(OrientationMode, &str); 2] =
    [(OrientationMode::Greedy, "greedy"), (OrientationMode::Optimal, "optimal")];
const PRESETS: [(bool, &str); 2] = [(true, "paper"), (false, "defaults")];
const SPINS: [i8; 2] = [-1, 1];

/// One cell of the table: all runs that differ only in seed, spin and raster.
#[derive(Default)]
struct Cell {
    found: Vec<Trials>,
    changes: Vec<[Changes; 2]>,
    by_spin: [Vec<Option<f64>>; 2],
    by_raster: [Vec<Option<f64>>; 2],
}

/// D's table, over seeds, spins, rasters, nerve planes, presets and modes.
pub fn run(size: Size, progress: &dyn Progress) -> Result<Vec<Table>, ExperimentError> {
    let mut cells: Vec<Cell> = (0..8).map(|_| Cell::default()).collect();
    let mut controls: Vec<[f64; 7]> = Vec::new();
    let of = (size.seeds * 4) as usize;
    let mut done = 0;
    for seed in 1..=size.seeds {
        for (plane, (nerve, _)) in NERVES.iter().enumerate() {
            for (direction, raster_rad) in RASTERS.iter().enumerate() {
                progress.stage("trials");
                progress.advance(done, of);
                done += 1;
                let setup = BlockSetup { seed, nerve: *nerve, raster_rad: *raster_rad };
                on_block(
                    &setup,
                    |_| (),
                    |body, prepared| {
                        for (preset, (paper, _)) in PRESETS.iter().enumerate() {
                            for (turn, spin) in SPINS.iter().enumerate() {
                                let mut case = body.case(*paper)?;
                                case.burr.spin = *spin;
                                let still = control(prepared, &case)?;
                                for (way, (mode, _)) in MODES.iter().enumerate() {
                                    let found = trials(prepared, &case, &still, *mode)?;
                                    let cell = &mut cells[plane * 4 + preset * 2 + way];
                                    let changes = found.changes();
                                    cell.found.push(found);
                                    cell.changes.push(changes);
                                    cell.by_spin[turn].push(changes[1][0]);
                                    cell.by_raster[direction].push(changes[1][0]);
                                    if !*paper && way == 0 {
                                        controls.push(found.control.values());
                                    }
                                }
                            }
                        }
                        Ok(())
                    },
                )?;
            }
        }
    }
    Ok(vec![
        changes_table(size, &cells),
        parts_table(&cells),
        newtons_table(&cells),
        control_table(&controls),
    ])
}

/// Mean and standard deviation of the values that are known, and their number if some are not.
fn percent(values: impl Iterator<Item = Option<f64>> + Clone) -> String {
    let (all, some) = (values.clone().count(), values.flatten());
    let of = some.clone().count();
    let n = of.max(1) as f64;
    let mean = some.clone().sum::<f64>() / n;
    let sd = (some.map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0)).sqrt();
    let how_many = if of < all { format!(" ({of} of {all})") } else { String::new() };
    if of > 0 { format!("{mean:+.0} ± {sd:.0}{how_many}") } else { "-".into() }
}

fn changes_table(size: Size, cells: &[Cell]) -> Table {
    let title = format!(
        "Changes against the control in % (mean ± standard deviation over {} hole seeds, both spins, both raster directions; \
         plans whose control has less than {LEAST_N} N are left out).",
        size.seeds
    );
    let mut table =
        Table::new("trials", title, &[&["nerve", "preset", "mode", "trial"][..], &COLUMNS[..]].concat());
    for (trial, name) in ["angle", "angle and speed"].iter().enumerate() {
        let cell = |v: &Option<f64>| v.map_or("-".into(), |v| format!("{v:+.0}"));
        let head = ["D's block", "D", "D", name].map(str::to_owned);
        table.push(head.into_iter().chain(PAPER[trial].iter().map(cell)).collect());
    }
    for (plane, (_, where_)) in NERVES.iter().enumerate() {
        for (preset, (_, preset_name)) in PRESETS.iter().enumerate() {
            for (way, (_, mode)) in MODES.iter().enumerate() {
                let cell = &cells[plane * 4 + preset * 2 + way];
                for (trial, name) in ["angle", "angle and speed"].iter().enumerate() {
                    let figures = (0..7).map(|k| percent(cell.changes.iter().map(|c| c[trial][k])));
                    let head = [where_, preset_name, mode, name].map(|s| (*s).to_owned());
                    table.push(head.into_iter().chain(figures).collect());
                }
            }
        }
    }
    table
}

/// Effect of spin and raster direction on the full trial's mean force toward the nerve.
fn parts_table(cells: &[Cell]) -> Table {
    let columns = ["nerve", "preset", "mode", "spin -1", "spin +1", "lines along x", "lines along y"];
    let title = "Mean force toward the nerve (F_v > 0), angle and speed against control in %, by spin and raster direction.";
    let mut table = Table::new("trials-parts", title, &columns);
    for (plane, (_, where_)) in NERVES.iter().enumerate() {
        for (preset, (_, preset_name)) in PRESETS.iter().enumerate() {
            for (way, (_, mode)) in MODES.iter().enumerate() {
                let cell = &cells[plane * 4 + preset * 2 + way];
                let parts = cell.by_spin.iter().chain(&cell.by_raster).map(|v| percent(v.iter().copied()));
                let head = [where_, preset_name, mode].map(|s| (*s).to_owned());
                table.push(head.into_iter().chain(parts).collect());
            }
        }
    }
    table
}

/// The figures themselves, N, because changes in % hide that a control's force is small.
fn newtons_table(cells: &[Cell]) -> Table {
    let title = "Forces in N, means over all plans.";
    let mut table = Table::new(
        "trials-newtons",
        title,
        &[&["nerve", "preset", "mode", "trial"][..], &COLUMNS[..]].concat(),
    );
    for (plane, (_, where_)) in NERVES.iter().enumerate() {
        for (preset, (_, preset_name)) in PRESETS.iter().enumerate() {
            for (way, (_, mode)) in MODES.iter().enumerate() {
                let found = &cells[plane * 4 + preset * 2 + way].found;
                for (trial, name) in ["control", "angle", "angle and speed"].iter().enumerate() {
                    let n = found.len().max(1) as f64;
                    let value = |t: &Trials, k: usize| [t.control, t.angle, t.full][trial].values()[k];
                    let mean = |k: usize| found.iter().map(|t| value(t, k)).sum::<f64>() / n;
                    let head = [where_, preset_name, mode, name].map(|s| (*s).to_owned());
                    table.push(head.into_iter().chain((0..7).map(|k| format!("{:.3}", mean(k)))).collect());
                }
            }
        }
    }
    table
}

/// The control's figures compared with D's, N.
fn control_table(controls: &[[f64; 7]]) -> Table {
    let mut table = Table::new(
        "trials-control",
        "The control trial, N (defaults; D: one block).",
        &[&["trial 1"][..], &COLUMNS[..]].concat(),
    );
    let paper = ["D", "0.51", "-", "0.67", "-", "1.60", "0.73", "3.24"].map(str::to_owned);
    table.push(paper.to_vec());
    let n = controls.len().max(1) as f64;
    let mean = |k: usize| format!("{:.2}", controls.iter().map(|c| c[k]).sum::<f64>() / n);
    table.push(std::iter::once("mean over all blocks".to_owned()).chain((0..7).map(mean)).collect());
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One block as in the paper: tests the tendency of the result, not its digits.
    #[test]
    fn angle_and_speed_at_equal_time_lower_the_force_toward_the_nerve() {
        let setup = BlockSetup { seed: 3, nerve: NerveSide::BesideTiltPlane, raster_rad: 0.0 };
        let coarse = |case: &mut Case| (case.path.step_mm, case.grid.spacing_mm) = (0.5, 0.5);
        on_block(&setup, coarse, |body, prepared| {
            let mut case = body.case(false)?;
            coarse(&mut case);
            let still = control(prepared, &case)?;
            for (mode, name) in MODES {
                let found = trials(prepared, &case, &still, mode)?;
                let [angle, full] = found.changes();
                assert!(found.control.peak_n > 0.3 && found.control.mean_toward_n > 0.05, "{name} {found:?}");
                let (angle, full) = (angle[1].unwrap(), full[1].unwrap());
                assert!(full < -20.0 && full < angle, "{name}: {angle} {full}");
            }
            Ok(())
        })
        .unwrap();
    }
}
