//! Random bodies under random keys: plan, verify and simulate must agree, and so must a twin that is the same case written otherwise.
//!
//! A case is a random body and, for each of [`KEYS`], a choice, of which 0 leaves the key out. It is planned, read back, verified and
//! simulated, and its export and report are read back. Then a twin is planned: the same images stored backwards, elsewhere, turned or with other axes first,
//! labels in smaller voxels, all priorities times three, or a structure in two parts. Where two of these disagree, the case is made simpler as long as they still do.

use std::sync::Arc;

use bonemill_planner::Progress;
use bonemill_planner::plan::{ForceToward, StoredPlan};
use bonemill_planner::simulate::{ModelName, Sampling, simulate};
use nalgebra::{Matrix3, Rotation3};

use super::keys::{Choices, Keys};
use super::random::{Drawn, RandomBody, draws, ended_well, list_wrong};
use super::read_back;
use super::run::{End, Quiet, run_judged};
use super::scene::{BONE, NERVE, Scene, V};
use crate::{ExperimentError, Size, Table};

/// Number of keys.
const COUNT: usize = 9;

/// What may stand in a case.
const KEYS: [Choices; COUNT] = [
    &[
        ("[orientation]", "[orientation]\nmode = \"greedy\""),
        ("[orientation]", "[orientation]\nmode = \"fixed\""),
    ],
    &[("[burr]", "[burr]\nturns = \"both_ways\""), ("[burr]", "[burr]\nspin = 1")],
    &[
        ("[path]", "[path]\nsense = \"both\""),
        ("[path]", "[path]\nsense = \"climb\""),
        ("[path]", "[path]\nsense = \"away\""),
        ("[path]", "[path]\nraster_deg = 30"),
    ],
    &[
        ("[speed]", "[speed]\nmode = \"constant\""),
        ("[speed]", "[speed]\nmode = \"mass\""),
        ("[speed]", "[speed]\nmode = \"force_limited\"\nforce_n = 0.4"),
        ("[speed]", "[speed]\npower_w = 0.3"),
        ("[speed]", "[speed]\ntotal_time_s = 40"),
        ("[speed]", "[speed]\ntotal_time_s = 900"),
    ],
    &[("[grid]", "[cost]\nobjective = \"dillon\"\n\n[grid]")],
    &[("[grid]", "[material]\nk_te = 0.5\nk_re = 0.2\n\n[grid]")],
    &[(
        "[robot]",
        "[robot]\nmodel = \"ur5e\"\nflange_from_burr = { translation_mm = [0, -90, 155], rpy_rad = [2.618, 0, 0] }",
    )],
    &[("direction = [", "# direction = [")],
    &[("[images]", "preset = \"paper\"\n[images]")],
];

/// Keys of the cost's objective and of the arm among them.
const OBJECTIVE: usize = 4;
const ARM: usize = 6;

/// What takes the arm's place from [`WITH_ARMS`] on: other arms and mounts, two angles, the deflection.
const ARMS: [Edits; 7] = [
    &[],
    &[(
        "[robot]",
        "[robot]\nmodel = \"ur3e\"\nflange_from_burr = { translation_mm = [0, 0, 160], rpy_rad = [3.141592653589793, 0, 0] }",
    )],
    &[(
        "[robot]",
        "[robot]\nmodel = \"ur10e\"\nflange_from_burr = { translation_mm = [0, -90, 155], rpy_rad = [2.618, 0, 0] }",
    )],
    &[
        (
            "[robot]",
            "[robot]\nmodel = \"ur5e\"\nflange_from_burr = { translation_mm = [0, -90, 155], rpy_rad = [2.618, 0, 0] }",
        ),
        ("[orientation]", "[orientation]\nangles = 2"),
    ],
    &[
        (
            "[robot]",
            "[robot]\nmodel = \"ur10e\"\nflange_from_burr = { translation_mm = [0, 0, 180], rpy_rad = [3.141592653589793, 0, 0] }",
        ),
        ("[orientation]", "[orientation]\nangles = 2"),
    ],
    &[
        ("[robot]", "[robot]\njoint_stiffness = [200, 150, 250, 300000]"),
        ("[path]", "[cost]\nforce = \"deflection\"\n\n[path]"),
    ],
    &[("[robot]", "[robot]\nvelocity_limits = [3, 3, 3, 0.3]\nacceleration_limits = [40, 40, 40, 2]")],
];

/// That with the deflection.
const DEFLECTION: u8 = 5;

/// Lines of a case, and what takes their place.
type Edits = &'static [(&'static str, &'static str)];

/// Those of them that choose by sums over structures: orientation's mode, the cost's objective, the preset.
const BY_SUMS: [usize; 3] = [0, 4, 8];

/// A simulated peak may exceed the stated one by this share and this much, N: the simulation's lattice.
const PEAK: [f64; 2] = [0.1, 0.1];
/// Volumes agree to this share and this much, mm³: the simulation's cells.
const VOLUME: [f64; 2] = [0.02, 2.0];
/// The twins' volume and time agree to this share, their peaks to the second: rounding decides between nearly equal choices.
const TWINS: [f64; 2] = [0.01, 0.1];

/// Approaches that differ by less are the same, rad.
const ROUNDING_RAD: f64 = 1e-6;
/// Label of a part of the nerve.
const SPLIT: u8 = 8;
/// Label of a second structure, on the pocket's other side.
const VEIN: u8 = 9;
/// From this number on cases have more beside the body, and more ways to be written otherwise.
const WITH_MORE: u64 = 1000;
/// From this number on they have other arms, and bodies that are turned.
const WITH_ARMS: u64 = 2000;

/// A random case.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct RandomCase {
    /// Its body.
    body: RandomBody,
    /// The choice for each key.
    keys: Keys<COUNT>,
    /// The second structure's distance from the pocket, in half millimetres; 0 for none.
    vein: u8,
    /// Radius of an island of bone above the pocket, in half millimetres; 0 for none.
    island: u8,
    /// Where the scan ends beside the pocket, in half millimetres; 0 for far away.
    edge: u8,
    /// Number of its arm in [`ARMS`].
    arm: u8,
    /// How the case is written otherwise.
    twin: Twin,
}

/// The same case written otherwise.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Twin {
    /// Every priority times three.
    Priorities,
    /// The nerve in two structures of the first priority.
    Parts,
    /// The images elsewhere.
    Shifted,
    /// The images stored backwards.
    Mirrored,
    /// The images stored with another axis first.
    Permuted,
    /// Labels in voxels of half the size.
    Finer,
    /// The body turned in ct, and the registration.
    Turned,
}

/// What two plans of one case must have in common.
#[derive(Debug, Clone, PartialEq)]
struct Figures {
    /// In the body.
    approach: V,
    removed_mm3: f64,
    /// What is removed of what the burr can reach, mm³.
    removed_reachable_mm3: f64,
    total_time_s: f64,
    peak_n: f64,
    /// Whether forces.csv has a waypoint at which another structure than the nearest is pushed the most: both count there.
    farther_counts: bool,
}

impl RandomCase {
    fn scene(self) -> Scene {
        let mut scene =
            self.keys.chosen(&KEYS).fold(self.body.scene(), |scene, (from, to)| scene.with(from, to));
        let mm = |v: u8| f64::from(v) * 0.5;
        let [a, b, depth] = self.body.pocket.map(mm);
        if self.vein > 0 && self.body.nerve[0] > 0 {
            let (label, beside_mm) = (Arc::clone(&scene.label), a + mm(self.vein));
            let is_vein = move |p: &V| (p.x + beside_mm).hypot(p.z + depth) < 0.6 && p.y.abs() < b + 1.0;
            scene.label = Arc::new(move |p| if label(p) == 0 && is_vein(p) { VEIN } else { label(p) });
            let line = format!(
                "[[structure]]\nname = \"vein\"\nlabel = {VEIN}\npriority = 2\nclearance_mm = 0.4\n\n[approach]"
            );
            scene = scene.with("[approach]", line);
        }
        if self.island > 0 {
            let (hu, radius_mm) = (Arc::clone(&scene.hu), mm(self.island));
            let middle = V::new(0.6 * a, 0.3 * b, radius_mm + 0.4);
            scene.hu = Arc::new(move |p| if (p - middle).norm() < radius_mm { BONE } else { hu(p) });
        }
        if self.edge > 0 {
            scene.half_mm[1] = b + mm(self.edge);
        }
        let arm = ARMS[usize::from(self.arm)].iter();
        scene = arm.fold(scene, |scene, (from, to)| scene.with(from, *to));
        if self.twin == Twin::Turned { self.registered(scene) } else { scene }
    }

    /// A scene with the pocket's middle at the base, which turns with the body.
    fn registered(self, scene: Scene) -> Scene {
        let base_from_body =
            Rotation3::from_matrix_unchecked(Matrix3::new(0.0, 1.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 1.0));
        let base_from_ct = base_from_body * Rotation3::new(V::from(scene.turn_rad)).inverse();
        let rows: Vec<Vec<f64>> =
            base_from_ct.matrix().row_iter().map(|row| row.iter().copied().collect()).collect();
        let up_mm = 0.25 * f64::from(self.body.pocket[2]);
        let place = format!("base_from_ct = {{ rotation = {rows:?}, translation_mm = [0, 0, {up_mm:?}] }}");
        scene.with("[robot]", format!("[robot]\n{place}"))
    }

    /// The same case written otherwise.
    fn twin(self) -> Scene {
        let scene = self.scene();
        match self.twin {
            Twin::Priorities => {
                let scene = scene.with("name = \"nerve\"", "name = \"nerve\"\npriority = 3");
                if self.vein > 0 { scene.with("priority = 2", "priority = 6") } else { scene }
            }
            Twin::Parts => {
                let label = Arc::clone(&scene.label);
                let split = move |p: &V| if label(p) == NERVE && p.y > 0.1 { SPLIT } else { label(p) };
                let clearance = self.body.nerve_clearance();
                // both of the first priority
                let other = format!(
                    "name = \"other\"\nlabel = {SPLIT}\npriority = 1\n{clearance}\n\n[[structure]]\nname = \"nerve\"\npriority = 1\n"
                );
                Scene { label: Arc::new(split), ..scene }.with("name = \"nerve\"\n", other)
            }
            Twin::Shifted => Scene { origin_mm: [31.7, -12.3, 104.9], ..scene },
            Twin::Mirrored => Scene { mirrored: [true, false, true], ..scene },
            Twin::Permuted => Scene { order: [2, 0, 1], ..scene },
            Twin::Finer => Scene { label_split: 2, ..scene },
            Twin::Turned => {
                let other = RandomCase {
                    body: RandomBody { turn: self.body.turn.map(|n| (n + 11) % 32), ..self.body },
                    ..self
                };
                other.scene()
            }
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

impl Drawn for RandomCase {
    fn draw(number: u64) -> Self {
        let mut below = draws(number ^ 0x5bd1_e995_0000_0000);
        let mut keys = Keys::draw(&KEYS, &mut below);
        // pockets of a few burr's diameters: many cases rather than long ones
        let pocket = [3, 3, 2].map(|half| half + below(3));
        let burr = 10 + below(6);
        let body = RandomBody { pocket, burr, ..RandomBody::draw(number) };
        let mut some = |n: u64| if number < WITH_MORE { 0 } else { below(2) * below(n + 1) };
        let [vein, island, edge] = [some(4), some(4), some(3)];
        let has_arm = number >= WITH_ARMS;
        let arm = if has_arm { below(ARMS.len() as u64) } else { 0 };
        if arm > 0 {
            keys = keys.without(ARM);
        }
        if arm == DEFLECTION {
            keys = keys.without(OBJECTIVE);
        }
        // the place of a UR is assumed, and does not turn with the patient; without a nerve and air cells a body has two sides that are equally good
        let turns = has_arm
            && body.nerve[0].min(body.cells) > 0
            && !keys.is_chosen(ARM)
            && matches!(arm, 0 | 5 | 6)
            && below(3) == 0;
        let nerve_twins =
            if body.nerve[0] > 0 { [Twin::Priorities, Twin::Parts] } else { [Twin::Mirrored; 2] };
        let twin = match body.turn[0] % 4 {
            _ if turns => Twin::Turned,
            0 | 1 if number >= WITH_MORE && body.turn[1].is_multiple_of(2) => Twin::Permuted,
            n @ (0 | 1) => nerve_twins[usize::from(n)],
            2 => Twin::Shifted,
            _ if number >= WITH_MORE => Twin::Finer,
            _ => Twin::Mirrored,
        };
        Self { body, keys, vein, island, edge, arm, twin }
    }

    fn disagreements(self) -> Vec<String> {
        let (end, figures) = judged(&self.scene());
        if !ended_well(&end) {
            return vec![end.to_string()];
        }
        let (twin_end, twin) = judged(&self.twin());
        let is_split = self.twin == Twin::Parts;
        // the paper's cost and its presets add up over structures, and two parts count twice
        let by_sums = BY_SUMS.iter().any(|key| self.keys.is_chosen(*key));
        match (figures, twin) {
            // a symmetric body has several ways in that are equally good, and the plan tells which was chosen
            (Some(figures), Some(twin)) if figures.approach.angle(&twin.approach) > ROUNDING_RAD => {
                Vec::new()
            }
            // two parts count where each is pushed, as the plan tells
            (Some(figures), Some(twin)) if is_split && twin.farther_counts && ended_well(&twin_end) => {
                figures.differ(&twin, true)
            }
            _ if twin_end.word() != end.word() => vec![format!("{end}; its twin {twin_end}")],
            (Some(figures), Some(twin)) => figures.differ(&twin, is_split && by_sums),
            _ => Vec::new(),
        }
    }

    fn simpler(self) -> Vec<Self> {
        let fewer = self.keys.simpler().map(|keys| self.with_keys(keys));
        let less = [
            Self { vein: 0, ..self },
            Self { island: 0, ..self },
            Self { edge: 0, ..self },
            Self { arm: 0, ..self },
        ];
        // a nerve that is written otherwise stays
        let keeps_nerve = |body: &RandomBody| match self.twin {
            Twin::Priorities | Twin::Parts => body.nerve[0] > 0,
            Twin::Turned => body.nerve[0].min(body.cells) > 0,
            _ => true,
        };
        let smaller = self.body.simpler().into_iter().filter(|other| other.pocket == self.body.pocket);
        let smaller = smaller.filter(keeps_nerve).map(|body| self.with_body(body));
        less.into_iter().filter(|other| *other != self).chain(fewer).chain(smaller).collect()
    }
}

impl Figures {
    /// What differs from a twin; of a twin that is another task, which may have other lines, only what every plan of it removes.
    ///
    /// That is what the burr covers from some node of the planning grid. Lines run between nodes and cover a little more, up to 3 % of
    /// the target: how much depends on where they run, and no plan promises any of it.
    fn differ(&self, twin: &Self, is_other_task: bool) -> Vec<String> {
        let [near, peaks] = TWINS;
        let all = [
            ("removed_reachable_mm3", self.removed_reachable_mm3, twin.removed_reachable_mm3, near),
            ("removed_mm3", self.removed_mm3, twin.removed_mm3, near),
            ("total_time_s", self.total_time_s, twin.total_time_s, near),
            ("peak_force_n", self.peak_n, twin.peak_n, peaks),
        ];
        let agrees = |(_, a, b, share): &(&str, f64, f64, f64)| (a - b).abs() <= share * a.max(*b) + 0.05;
        all.iter()
            .take(if is_other_task { 1 } else { all.len() })
            .filter(|of| !agrees(of))
            .map(|(name, a, b, _)| format!("{name} {a:.4}, of its twin {b:.4}"))
            .collect()
    }
}

/// How a scene ends, its simulation included, and the plan's figures where there is one.
fn judged(scene: &Scene) -> (End, Option<Figures>) {
    let mut figures = None;
    let end = run_judged(scene, |plan| {
        let metrics = &plan.record.metrics;
        let peak_n = metrics.number("peak_force_n").unwrap_or(f64::NAN);
        figures = Some(Figures {
            approach: Rotation3::new(V::from(scene.turn_rad)).inverse()
                * plan.record.frames.approach_direction,
            removed_mm3: metrics.removed_mm3,
            removed_reachable_mm3: metrics.number("reached_share").unwrap_or(f64::NAN)
                * metrics.reachable_mm3,
            total_time_s: metrics.total_time_s,
            peak_n,
            farther_counts: farther_counts(plan),
        });
        simulated(plan, peak_n).into_iter().chain(read_back::differences(plan)).collect()
    });
    (end, figures)
}

/// Whether another structure than the one with the smallest distance less clearance is pushed more somewhere.
fn farther_counts(plan: &StoredPlan) -> bool {
    let clearance_mm = |row: &ForceToward| plan.record.case.structures[row.structure].clearance_mm;
    plan.forces.chunk_by(|a, b| a.waypoint == b.waypoint).any(|rows| {
        let margin_mm = |row: &ForceToward| row.distance_mm - clearance_mm(row);
        let nearest = rows.iter().min_by(|a, b| margin_mm(a).total_cmp(&margin_mm(b)));
        nearest.is_some_and(|nearest| rows.iter().any(|row| row.peak_toward_n > nearest.peak_toward_n))
    })
}

/// Where a simulation of a plan disagrees with it.
fn simulated(plan: &StoredPlan, peak_n: f64) -> Vec<String> {
    let found = match simulate(plan, ModelName::Fluted, Sampling::Step { step_mm: 0.1 }, &Quiet) {
        Ok(found) => found,
        Err(error) => return vec![format!("simulate: {error}")],
    };
    let mut said = Vec::new();
    if found.stopped > 0 && plan.record.shortfalls.is_empty() {
        said.push(format!("simulate: the shank stops {} steps", found.stopped));
    }
    let [share, most_n] = PEAK;
    let driven_n = found.peak_force_n();
    if driven_n > peak_n * (1.0 + share) + most_n {
        said.push(format!("simulate: peak {driven_n:.3} N, the plan states {peak_n:.3} N"));
    }
    let [share, most_mm3] = VOLUME;
    let [_, material, bone, ..] = found.removed.volume_mm3;
    let stated_mm3 = plan.record.metrics.removed_material_mm3;
    if (material + bone - stated_mm3).abs() > share * stated_mm3 + most_mm3 {
        said.push(format!(
            "simulate: {:.2} mm³ of material, the plan states {stated_mm3:.2} mm³",
            material + bone
        ));
    }
    for (kept, of) in plan.record.case.structures.iter().zip(&found.structures) {
        let clear_mm = of.least.map_or(f64::INFINITY, |(mm, _)| mm);
        if clear_mm < kept.clearance_mm - 0.01 {
            said.push(format!(
                "simulate: {clear_mm:.3} mm from {}, asked for {} mm",
                kept.name, kept.clearance_mm
            ));
        }
    }
    said
}

/// Runs the cases of `size`, disagreements told as they are found.
///
/// # Errors
/// None: every disagreement is a shortfall of the table.
pub fn run(size: Size, progress: &dyn Progress) -> Result<Vec<Table>, ExperimentError> {
    progress.stage("agree");
    Ok(vec![agree(size.cases(), progress)])
}

/// Runs the cases of these numbers; each that disagrees is listed as simple as it can be.
pub(super) fn agree(numbers: impl IntoIterator<Item = u64>, progress: &dyn Progress) -> Table {
    let numbers: Vec<u64> = numbers.into_iter().collect();
    let title = format!(
        "{} random cases: plan, verify and simulate, and the plan of a twin (images stored backwards, elsewhere, turned or with another axis first, finer labels, priorities times three, or a structure in two parts)",
        numbers.len()
    );
    let table = Table::new("agree", title, &["case", "disagrees", "as simple as"]);
    list_wrong::<RandomCase>(table, &numbers, progress)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn other_lines_may_cover_more_beside_what_the_burr_can_reach_but_no_less_of_it() {
        let plan = Figures {
            approach: V::z(),
            removed_mm3: 19.09,
            removed_reachable_mm3: 18.44,
            total_time_s: 40.0,
            peak_n: 1.9,
            farther_counts: false,
        };
        let twin = |removed_mm3: f64, removed_reachable_mm3: f64| Figures {
            removed_mm3,
            removed_reachable_mm3,
            total_time_s: 45.0,
            peak_n: 3.4,
            ..plan.clone()
        };
        assert_eq!(plan.differ(&twin(18.55, 18.44), true), Vec::<String>::new());
        let less = plan.differ(&twin(18.55, 18.1), true);
        assert_eq!(less, ["removed_reachable_mm3 18.4400, of its twin 18.1000"]);
        assert_eq!(plan.differ(&twin(18.55, 18.44), false).len(), 3);
        // what cannot be read agrees with nothing
        assert_eq!(plan.differ(&twin(18.55, f64::NAN), true).len(), 1);
    }

    #[test]
    fn a_refusal_along_an_approach_that_was_chosen_tells_the_others() {
        let (end, _) = judged(&RandomCase::draw(2120).twin());
        let End::Refused(why) = end else { panic!("{end}") };
        assert!(
            why.contains("can reach no voxel")
                && why.contains("was chosen")
                && why.contains("% of them along"),
            "{why}"
        );
    }
}
