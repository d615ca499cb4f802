//! Random channels beside a nerve: plan, verify and simulate must agree, and so must a twin that is the same case written otherwise.
//!
//! A drill goes from the bone's surface to a place below it, along a direction that is given or the safest; keys are drawn as in
//! [`super::agree`]. Plans are read back, verified and simulated, and their export is read back.

use bonemill_planner::Progress;
use bonemill_planner::plan::StoredPlan;
use bonemill_planner::simulate::{ModelName, Sampling, simulate};
use nalgebra::Rotation3;

use super::keys::{Choices, Keys};
use super::random::{Drawn, RandomBody, draws, list_wrong};
use super::read_back;
use super::run::{End, Quiet, run_judged};
use super::scene::{Scene, V};
use crate::{ExperimentError, Size, Table};

/// Number of keys.
const COUNT: usize = 8;

/// What may stand in a case.
const KEYS: [Choices; COUNT] = [
    &[("radius_mm = 0.75", "radius_mm = 0.5"), ("radius_mm = 0.75", "radius_mm = 1.2")],
    &[("[drill]", "[drill]\npoint_deg = 70"), ("[drill]", "[drill]\npoint_deg = 45")],
    &[("[drill]", "[drill]\nspin = 1"), ("[drill]", "[drill]\nspindle_rpm = 2500")],
    &[("[path]", "[path]\npeck_mm = 1")],
    &[("[path]", "[path]\nfeed_mm_rev = 0.05"), ("[path]", "[path]\nfeed_mm_s = 0.4")],
    &[("[path]", "[path]\ndwell_s = 0.5"), ("[path]", "[path]\nstandoff_mm = 2")],
    &[
        ("[path]", "[path]\nregistration_sigma_mm = 0.3"),
        ("[path]", "[path]\nregistration_sigma_mm = 0"),
        ("[path]", "[path]\ntouch_probability = 0.2"),
    ],
    &[(
        "[robot]",
        "[robot]\nmodel = \"ur5e\"\nflange_from_burr = { translation_mm = [0, 0, 180], rpy_rad = [3.141592653589793, 0, 0] }",
    )],
];

/// Volumes agree to this share and this much, mm³: the simulation's cells.
const VOLUME: [f64; 2] = [0.02, 0.1];
/// Figures of twins agree to this share, and to this much in their own unit.
const TWINS: [f64; 2] = [0.02, 0.02];
/// Figures of a channel's plan that twins have in common.
const FIGURES: [&str; 3] = ["removed_bone_mm3", "peak_thrust_n", "total_time_s"];

/// The same case written otherwise.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Twin {
    Priority,
    Shifted,
    Mirrored,
    Permuted,
}

/// A random channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct RandomChannel {
    body: RandomBody,
    keys: Keys<COUNT>,
    /// The channel's end below the surface and off the middle, in half millimetres.
    end: [u8; 3],
    /// Whether the direction is searched.
    is_safest: bool,
    twin: Twin,
}

impl RandomChannel {
    fn scene(self) -> Scene {
        self.at([0.0; 3])
    }

    /// The scene with the body's origin somewhere in ct, mm.
    fn at(self, origin_mm: [f64; 3]) -> Scene {
        let mut scene = Scene { origin_mm, ..self.body.scene() };
        scene.edits.clear();
        let turn = Rotation3::new(V::from(scene.turn_rad));
        let [x, y, z] = self.end.map(|half| f64::from(half) * 0.5);
        let end: [f64; 3] = (V::from(origin_mm) + turn * V::new(x - 1.5, y - 1.5, -z)).into();
        let into: [f64; 3] = (turn * -V::z()).into();
        let direction = if self.is_safest { "\"safest\"".to_owned() } else { format!("{into:?}") };
        scene = scene
            .with("[target]\nlabel = 20\n# what is hard is the way to what the burr can reach, not how much of the target that is\nleast_share = 0.0\n\n", "")
            .with("[burr]\nradius_mm = 1.5\nneck_radius_mm = 0.6", "[tool]\nkind = \"drill\"\n\n[drill]\nradius_mm = 0.75")
            .with("[[25.0, 0.7], [60.0, 6.0]]", "[[25.0, 0.45], [60.0, 6.0]]")
            .with(
                "[path]\nlayer_mm = 1.5\nstep_mm = 0.25",
                format!("[path]\npattern = \"plunge\"\ntarget_mm = {end:?}\ndirection = {direction}"),
            )
            .with("[speed]\nmin_mm_s = 0.5\n\n", "");
        scene = if self.body.nerve[0] == 0 {
            scene.without_nerve()
        } else {
            scene.with("clearance_mm = 0.8", self.body.nerve_clearance())
        };
        self.keys.chosen(&KEYS).fold(scene, |scene, (from, to)| scene.with(from, to))
    }

    fn twin(self) -> Scene {
        match self.twin {
            Twin::Priority => self.scene().with("name = \"nerve\"", "name = \"nerve\"\npriority = 3"),
            Twin::Shifted => self.at([31.7, -12.3, 104.9]),
            Twin::Mirrored => Scene { mirrored: [true, false, true], ..self.scene() },
            Twin::Permuted => Scene { order: [2, 0, 1], ..self.scene() },
        }
    }

    fn with_keys(mut self, keys: Keys<COUNT>) -> Self {
        self.keys = keys;
        self
    }

    fn with_body(mut self, body: RandomBody) -> Self {
        self.body = body;
        self
    }
}

impl Drawn for RandomChannel {
    fn draw(number: u64) -> Self {
        let mut below = draws(number ^ 0x00c0_ffee_0000_0000);
        let keys = Keys::draw(&KEYS, &mut below);
        let end = [below(6), below(6), 4 + below(8)];
        let is_safest = below(3) > 0;
        let mut body = RandomBody::draw(number);
        body.roof = 0;
        let twin = match below(4) {
            0 if body.nerve[0] > 0 => Twin::Priority,
            0 | 1 => Twin::Shifted,
            2 => Twin::Mirrored,
            _ => Twin::Permuted,
        };
        Self { body, keys, end, is_safest, twin }
    }

    fn disagreements(self) -> Vec<String> {
        let (end, figures) = judged(&self.scene());
        if matches!(end, End::Faulty(..) | End::Broken(_)) || is_wrong_refusal(&end) {
            return vec![end.to_string()];
        }
        let (twin_end, twin) = judged(&self.twin());
        if twin_end.word() != end.word() {
            return vec![format!("{end}; its twin {twin_end}")];
        }
        let [share, least] = TWINS;
        let each = FIGURES.iter().zip(figures.iter().zip(&twin));
        let differs = |(_, (a, b)): &(&&str, (&f64, &f64))| {
            (*a - *b).abs() > share * a.max(**b) + least || a.is_nan() != b.is_nan()
        };
        each.filter(differs).map(|(name, (a, b))| format!("{name} {a:.4}, of its twin {b:.4}")).collect()
    }

    fn simpler(self) -> Vec<Self> {
        let fewer = self.keys.simpler().map(|keys| self.with_keys(keys));
        let keeps_nerve = |body: &RandomBody| body.nerve[0] > 0 || self.twin != Twin::Priority;
        let smaller = self.body.simpler().into_iter().filter(keeps_nerve);
        fewer.chain(smaller.map(|body| self.with_body(body))).collect()
    }
}

/// Whether a case was refused although nothing in it is wrong.
fn is_wrong_refusal(end: &End) -> bool {
    const REASONS: [&str; 3] = ["lies outside the CT", "touches structure", "meets no bone"];
    matches!(end, End::Refused(why) if !REASONS.iter().any(|reason| why.contains(reason)))
}

/// How a scene ends, its simulation included, and the plan's figures where there is one.
fn judged(scene: &Scene) -> (End, Vec<f64>) {
    let mut figures = Vec::new();
    let end = run_judged(scene, |plan| {
        let metrics = &plan.record.metrics;
        let thrust_n = metrics.number("peak_thrust_n").unwrap_or(f64::NAN);
        figures = vec![metrics.removed_bone_mm3, thrust_n, metrics.total_time_s];
        simulated(plan)
            .into_iter()
            .chain(read_back::exported(plan).unwrap_or_else(|error| vec![format!("export: {error}")]))
            .collect()
    });
    (end, figures)
}

/// Where a simulation of a plan disagrees with it.
fn simulated(plan: &StoredPlan) -> Vec<String> {
    let found = match simulate(plan, ModelName::Fluted, Sampling::Step { step_mm: 0.1 }, &Quiet) {
        Ok(found) => found,
        Err(error) => return vec![format!("simulate: {error}")],
    };
    let ([share, most_mm3], stated_mm3) = (VOLUME, plan.record.metrics.removed_bone_mm3);
    let [_, _, bone_mm3, ..] = found.removed.volume_mm3;
    let agrees = (bone_mm3 - stated_mm3).abs() <= share * stated_mm3 + most_mm3;
    (!agrees)
        .then(|| format!("simulate: {bone_mm3:.2} mm³ of bone, the plan states {stated_mm3:.2} mm³"))
        .into_iter()
        .collect()
}

/// Runs the channels of `size`, disagreements told as they are found.
///
/// # Errors
/// None: every disagreement is a shortfall of the table.
pub fn run(size: Size, progress: &dyn Progress) -> Result<Vec<Table>, ExperimentError> {
    progress.stage("agree-channels");
    Ok(vec![agree(size.cases(), progress)])
}

/// Runs the channels of these numbers; each that disagrees is listed as simple as it can be.
pub(super) fn agree(numbers: impl IntoIterator<Item = u64>, progress: &dyn Progress) -> Table {
    let numbers: Vec<u64> = numbers.into_iter().collect();
    let title = format!("{} random channels: plan, verify, simulate, export, and a twin", numbers.len());
    let table = Table::new("agree-channels", title, &["case", "disagrees", "as simple as"]);
    list_wrong::<RandomChannel>(table, &numbers, progress)
}
