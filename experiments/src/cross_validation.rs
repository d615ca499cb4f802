//! Leave-one-out cross-validation of the drill's force models, as Faieghi et al. III-A: three of the four scenarios (0.01 and
//! 0.02 mm/rev, 500 and 3000 rpm) calibrate, the fourth tests.
//!
//! The measured curves behind the source's Fig. 4 are not published as data. The logs here are made: lips entering bone through a flat
//! face, by a truth that is stated, each trial with a hardness of its own and noise on every sample, as the source shows trials of one
//! scenario to differ. So the table says how the models extrapolate from such logs, not which is right for bone.

use bonemill_planner::Progress;
use bonemill_planner::cutter::{Cutter, TwistDrill, TwistDrillSpec};
use bonemill_planner::edge::{CoefficientModel, PlungeFitting, PlungeInstant, Regression};

use crate::{ExperimentError, Size, Table};

/// Feed, mm a revolution, and spindle speed, rpm.
const SCENARIOS: [[f64; 2]; 4] = [[0.01, 500.0], [0.02, 500.0], [0.01, 3000.0], [0.02, 3000.0]];
/// Trials of a scenario, and samples of each.
const TRIALS: usize = 5;
const SAMPLES: usize = 40;
/// Standard deviation of a trial's hardness about 1, and of a sample's noise in parts of the full force. Assumed from the spread of
/// the black curves of the source's Fig. 4.
const SPREAD: f64 = 0.25;
const NOISE: f64 = 0.1;

/// A model: its name, its regression, and whether it has the feed angle.
const MODELS: [(&str, Regression, bool); 3] = [
    ("rake, with feed angle (Faieghi et al., ours)", Regression::Rake, true),
    ("power law (Chandrasekharan et al.)", Regression::PowerLaw, false),
    ("reciprocal of speed (Zheng et al.)", Regression::Reciprocal, false),
];

/// Measures the table over `size.seeds` sets of logs.
///
/// # Errors
/// [`ExperimentError`] when the drill refuses a feed.
pub fn run(size: Size, progress: &dyn Progress) -> Result<Vec<Table>, ExperimentError> {
    let drill = TwistDrill::new(TwistDrillSpec::FAIEGHI).map_err(ExperimentError::Cutter)?;
    let truths = [
        ("k by rake alone", CoefficientModel::Rake([[60.0, 150.0], [30.0, 50.0]])),
        (
            "k by rake, chip and speed",
            CoefficientModel::PowerLaw([[3.6, -0.2, -0.08, 0.8], [2.6, -0.2, -0.05, 0.6]]),
        ),
    ];
    let title = format!(
        "Leave-one-out over the four scenarios, {} sets of logs, {TRIALS} trials a scenario: error of the mean thrust and torque of the \
         scenario left out (mean and worst, % of the true one), predictions below 0, and fits refused",
        size.seeds
    );
    let columns = [
        "truth",
        "model",
        "thrust, mean [%]",
        "thrust, worst [%]",
        "torque, mean [%]",
        "torque, worst [%]",
        "negative torques",
        "refused",
        "predictions",
    ];
    let mut table = Table::new("cross-validation", title, &columns);
    for (truth_name, truth) in &truths {
        progress.stage(truth_name);
        for (name, regression, with_feed_angle) in MODELS {
            let fitting = PlungeFitting { cutter: &drill, regression, with_feed_angle, with_chisel: false };
            let mut score = Score::default();
            for seed in 1..=size.seeds {
                let logs = logs(&drill, truth, seed)?;
                for left_out in 0..SCENARIOS.len() {
                    score.add(&fitting, &logs, left_out, &drill, truth)?;
                }
            }
            table.push(score.row(truth_name, name));
        }
    }
    Ok(vec![table])
}

#[derive(Default)]
struct Score {
    errors: [Vec<f64>; 2],
    negative: usize,
    refused: usize,
}

impl Score {
    #[expect(clippy::too_many_arguments, reason = "a fit, the logs without one of them, and what made them")]
    fn add(
        &mut self,
        fitting: &PlungeFitting<'_>,
        logs: &[Vec<PlungeInstant>; 4],
        left_out: usize,
        cutter: &dyn Cutter,
        truth: &CoefficientModel,
    ) -> Result<(), ExperimentError> {
        let calibration: Vec<PlungeInstant> =
            (0..4).filter(|s| *s != left_out).flat_map(|s| logs[s].iter().copied()).collect();
        let Ok(fit) = fitting.fit(&calibration) else {
            self.refused += 1;
            return Ok(());
        };
        let [feed_mm_rev, spindle_rpm] = SCENARIOS[left_out];
        let full = PlungeInstant {
            feed_mm_rev,
            spindle_rpm,
            depth_mm: f64::INFINITY,
            thrust_n: 0.0,
            torque_nmm: 0.0,
        };
        let found = fitting.predict(&fit.model, &full).map_err(ExperimentError::Cutter)?;
        let own =
            PlungeFitting { cutter, regression: Regression::Rake, with_feed_angle: true, with_chisel: false };
        let expected = own.predict(truth, &full).map_err(ExperimentError::Cutter)?;
        for part in 0..2 {
            self.errors[part].push(100.0 * (found[part] / expected[part] - 1.0).abs());
        }
        self.negative += usize::from(found[1] < 0.0);
        Ok(())
    }

    fn row(&self, truth: &str, model: &str) -> Vec<String> {
        let figures = self.errors.iter().flat_map(|errors| {
            let mean = errors.iter().sum::<f64>() / errors.len().max(1) as f64;
            [mean, errors.iter().copied().fold(0.0, f64::max)].map(|v| format!("{v:.1}"))
        });
        let counts = [self.negative, self.refused, self.errors[0].len()].map(|n| n.to_string());
        [truth.to_owned(), model.to_owned()].into_iter().chain(figures).chain(counts).collect()
    }
}

/// The logs of the four scenarios.
fn logs(
    cutter: &dyn Cutter,
    truth: &CoefficientModel,
    seed: u64,
) -> Result<[Vec<PlungeInstant>; 4], ExperimentError> {
    let truth_of =
        PlungeFitting { cutter, regression: Regression::Rake, with_feed_angle: true, with_chisel: false };
    let mut state = seed;
    let mut logs: [Vec<PlungeInstant>; 4] = Default::default();
    for (log, [feed_mm_rev, spindle_rpm]) in logs.iter_mut().zip(SCENARIOS) {
        for _ in 0..TRIALS {
            let hardness = (1.0 + SPREAD * normal(&mut state)).max(0.2);
            let row = |depth_mm| PlungeInstant {
                feed_mm_rev,
                spindle_rpm,
                depth_mm,
                thrust_n: 0.0,
                torque_nmm: 0.0,
            };
            let whole = truth_of.predict(truth, &row(f64::INFINITY)).map_err(ExperimentError::Cutter)?;
            for n in 0..SAMPLES {
                let row = row(0.8 * (n + 1) as f64 / SAMPLES as f64);
                let force = truth_of.predict(truth, &row).map_err(ExperimentError::Cutter)?;
                let [thrust_n, torque_nmm] =
                    [0, 1].map(|p| hardness * force[p] + NOISE * whole[p] * normal(&mut state));
                log.push(PlungeInstant { thrust_n, torque_nmm, ..row });
            }
        }
    }
    Ok(logs)
}

/// A normal deviate: the sum of twelve uniform ones of splitmix64, docs/force-model.md 11.
fn normal(state: &mut u64) -> f64 {
    let mut uniform = || {
        *state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = *state;
        let z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    };
    (0..12).map(|_| uniform()).sum::<f64>() - 6.0
}
