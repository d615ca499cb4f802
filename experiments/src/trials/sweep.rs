//! Sensitivity of D's reductions to values that D does not give: one assumption is changed at a time.

use bonemill_planner::Progress;
use bonemill_planner::case::{Case, Measure, OrientationMode};

use super::{BlockSetup, Changes, NERVES, SPINS, control, on_block, percent, trials};
use crate::{ExperimentError, Size, Table};

/// An assumption, its value in words, and a function that sets it.
struct Variant {
    name: &'static str,
    value: &'static str,
    set: fn(&mut Case),
}

/// Assumptions that change the path or its access, so that the path is laid again.
const LAID_ANEW: &[Variant] = &[
    Variant { name: "tilt limit", value: "30°", set: |c| c.orientation.tilt_limit_rad = 30f64.to_radians() },
    Variant { name: "tilt limit", value: "60°", set: |c| c.orientation.tilt_limit_rad = 60f64.to_radians() },
    Variant { name: "stepover", value: "0.5 r", set: |c| c.path.stepover_mm = 0.5 * c.burr.radius_mm },
    Variant { name: "stepover", value: "1.0 r", set: |c| c.path.stepover_mm = c.burr.radius_mm },
    Variant { name: "step", value: "0.5 mm", set: |c| c.path.step_mm = 0.5 },
];

/// Assumptions that change only the cost or the force on the same path.
const ON_ONE_PATH: &[Variant] = &[
    Variant { name: "defaults", value: "db, 0.8, 0.7/mm, 0.6, 0.1, 45°, 2/3 r", set: |_| () },
    Variant { name: "measure", value: "dz", set: |c| c.material.measure = Measure::Dz },
    Variant { name: "alpha_max", value: "0.5", set: |c| c.cost.alpha_max = 0.5 },
    Variant { name: "alpha_max", value: "1.0", set: |c| c.cost.alpha_max = 1.0 },
    Variant { name: "alpha_max", value: "0 (efficiency alone)", set: |c| c.cost.alpha_max = 0.0 },
    Variant { name: "kappa", value: "0.35/mm", set: |c| c.cost.kappa_per_mm = 0.35 },
    Variant { name: "kappa", value: "1.4/mm", set: |c| c.cost.kappa_per_mm = 1.4 },
    Variant { name: "K_r/K_t", value: "0.3", set: |c| c.material.k_n_mm2[1] = 0.3 * c.material.k_n_mm2[0] },
    Variant { name: "K_r/K_t", value: "1", set: |c| c.material.k_n_mm2[1] = c.material.k_n_mm2[0] },
    Variant { name: "K_r/K_t", value: "2", set: |c| c.material.k_n_mm2[1] = 2.0 * c.material.k_n_mm2[0] },
    Variant { name: "K_a/K_t", value: "0", set: |c| c.material.k_n_mm2[2] = 0.0 },
    Variant { name: "K_a/K_t", value: "0.3", set: |c| c.material.k_n_mm2[2] = 0.3 * c.material.k_n_mm2[0] },
    Variant {
        name: "speed range",
        value: "1 to 3 mm/s",
        set: |c| (c.speed.min_mm_s, c.speed.max_mm_s) = (1.0, 3.0),
    },
    Variant { name: "speed smoothing", value: "plain average", set: |c| c.paper = true },
];

/// Runs the sweep with the greedy mode as in D, both spins, and lines along x.
pub fn run(size: Size, progress: &dyn Progress) -> Result<Vec<Table>, ExperimentError> {
    let columns = [
        "assumption",
        "value",
        "nerve",
        "mean toward, angle",
        "mean toward, full",
        "peak toward, angle",
        "peak toward, full",
        "mean |F|, full",
        "peak |F|, full",
    ];
    let title = format!(
        "Changes against the control in %, greedy, one assumption at a time (mean ± standard deviation over {} hole seeds and both spins; mean toward over F_v > 0).",
        size.seeds
    );
    let mut table = Table::new("trials-sweep", title, &columns);
    let jobs = LAID_ANEW.iter().map(std::slice::from_ref).chain([ON_ONE_PATH]);
    let of = LAID_ANEW.len() + 1;
    for (done, variants) in jobs.enumerate() {
        for (nerve, where_) in NERVES {
            progress.stage("sweep");
            progress.advance(done, of);
            let mut found: Vec<Vec<[Changes; 2]>> = vec![Vec::new(); variants.len()];
            for seed in 1..=size.seeds {
                let setup = BlockSetup { seed, nerve, raster_rad: 0.0 };
                let lay = |case: &mut Case| {
                    if let [one] = variants {
                        (one.set)(case)
                    }
                };
                on_block(&setup, lay, |body, prepared| {
                    for (variant, found) in variants.iter().zip(&mut found) {
                        for spin in SPINS {
                            let mut case = body.case(false)?;
                            (variant.set)(&mut case);
                            case.burr.spin = spin;
                            let still = control(prepared, &case)?;
                            found.push(trials(prepared, &case, &still, OrientationMode::Greedy)?.changes());
                        }
                    }
                    Ok(())
                })?;
            }
            for (variant, changes) in variants.iter().zip(&found) {
                let figure = |trial: usize, k: usize| percent(changes.iter().map(move |c| c[trial][k]));
                let figures = [(0, 0), (1, 0), (0, 4), (1, 4), (1, 5), (1, 6)].map(|(t, k)| figure(t, k));
                let head = [variant.name, variant.value, where_].map(str::to_owned);
                table.push(head.into_iter().chain(figures).collect());
            }
        }
    }
    Ok(vec![table])
}
