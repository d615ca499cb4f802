//! Random small bodies, planned and verified. A body that fails is simplified as far as it still fails.
//!
//! A body consists of a few numbers drawn from a seed, each with a simplest value. Shrinking sets them to this value one after
//! the other as long as the scene still fails; the remaining numbers show the cause.

use bonemill_planner::Progress;
use rayon::prelude::*;

use super::run::{End, run};
use super::scene::{AIR, BONE, NERVE, Scene, TARGET, V};
use crate::Table;

/// The numbers that define a random body, all small integers, so that a body can be written down.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RandomBody {
    /// Half the pocket's length and width, and its depth, in half millimetres.
    pub pocket: [u8; 3],
    /// The nerve's position beside it: distance and height in half millimetres, 0 for no nerve.
    pub nerve: [u8; 2],
    /// Period of the air cells in tenths of a millimetre; 0 for none.
    pub cells: u8,
    /// Size of a roof over a part of the pocket, in half millimetres; 0 for none.
    pub roof: u8,
    /// Burr in tenths of a millimetre.
    pub burr: u8,
    /// Clearance in tenths of a millimetre.
    pub clearance: u8,
    /// Tilt limit in degrees.
    pub tilt_deg: u8,
    /// Turn of the scan about three axes in tenths of a radian.
    pub turn: [u8; 3],
    /// CT voxel along each axis in quarters of a millimetre, which matches the planner's grid.
    pub voxel: [u8; 3],
}

/// Numbers below a bound, drawn from a seed: splitmix64 (Steele et al. 2014).
pub(crate) fn draws(seed: u64) -> impl FnMut(u64) -> u8 {
    let mut state = seed.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    move |n| {
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) % n) as u8
    }
}

impl RandomBody {
    /// The body with this number.
    pub fn draw(number: u64) -> Self {
        let mut below = draws(number);
        Self {
            pocket: [4 + below(6), 4 + below(6), 3 + below(6)],
            nerve: [below(6), below(8)],
            cells: below(3) * (12 + below(20)),
            roof: below(4).saturating_sub(1) * (1 + below(3)),
            burr: 10 + below(12),
            clearance: below(16),
            tilt_deg: 5 + below(60),
            turn: [below(32), below(32), below(32)],
            voxel: [1 + below(2), 1 + below(2), 1 + below(3)],
        }
    }

    /// The simplest body.
    const PLAIN: Self = Self {
        pocket: [6, 6, 6],
        nerve: [0, 0],
        cells: 0,
        roof: 0,
        burr: 15,
        clearance: 8,
        tilt_deg: 45,
        turn: [0; 3],
        voxel: [1; 3],
    };

    /// Bodies of which one number each is simpler.
    pub(super) fn simpler(self) -> Vec<Self> {
        let p = Self::PLAIN;
        let all = [
            Self { turn: p.turn, ..self },
            Self { voxel: p.voxel, ..self },
            Self { cells: p.cells, ..self },
            Self { roof: p.roof, ..self },
            Self { nerve: p.nerve, ..self },
            Self { tilt_deg: p.tilt_deg, ..self },
            Self { clearance: p.clearance, ..self },
            Self { burr: p.burr, ..self },
            Self { pocket: p.pocket, ..self },
        ];
        all.into_iter().filter(|simpler| *simpler != self).collect()
    }

    /// The scene of the body. It must be planned, fall short, or be refused for a reason in `REASONS`.
    pub fn scene(self) -> Scene {
        let mm = |v: u8| f64::from(v) * 0.5;
        let plain = Scene::plain("random", "drawn from a number");
        let mut scene = plain.body(move |p| self.hu(p), move |p| self.label(p));
        scene.spacing_mm = self.voxel.map(|v| f64::from(v) * 0.25);
        scene.turn_rad = self.turn.map(|v| f64::from(v) * 0.1);
        scene.half_mm = [mm(self.pocket[0]) + 5.0, mm(self.pocket[1]) + 5.0, mm(self.pocket[2]) + 4.5];
        let scene = scene
            .with("radius_mm = 1.5", format!("radius_mm = {:?}", f64::from(self.burr) * 0.1))
            .with("[speed]", format!("[orientation]\ntilt_limit_deg = {}\n\n[speed]", self.tilt_deg));
        if self.nerve[0] == 0 {
            scene.without_nerve()
        } else {
            scene.with("clearance_mm = 0.8", self.nerve_clearance())
        }
    }

    /// The nerve's clearance, a line of the case.
    pub(super) fn nerve_clearance(self) -> String {
        format!("clearance_mm = {:?}", f64::from(self.clearance) * 0.1)
    }

    /// HU at a place.
    fn hu(&self, p: &V) -> f32 {
        let period = f64::from(self.cells) * 0.1;
        let cell = self.cells > 0 && {
            let wave = |v: f64| (v * std::f64::consts::TAU / period).sin();
            wave(p.x) * wave(p.y + 0.3) * wave(p.z + 0.7) > 0.3
        };
        let roof = f64::from(self.roof) * 0.5;
        if p.z >= 0.0 {
            if p.z < roof && p.x > 0.5 { BONE } else { AIR }
        } else if cell && self.label(p) == TARGET {
            AIR
        } else {
            BONE
        }
    }

    /// Label at a place.
    fn label(&self, p: &V) -> u8 {
        let [a, b, depth] = self.pocket.map(|v| f64::from(v) * 0.5);
        // rounded at the bottom, because no burr reaches into corners
        let within = (p.x / a).powi(4) + (p.y / b).powi(4) + (p.z / depth).powi(4) < 1.0;
        if within && p.z < 0.0 {
            return TARGET;
        }
        let [beside, height] = self.nerve.map(|v| f64::from(v) * 0.5);
        let off = (p.x - a - 0.6 - beside).abs();
        let is_nerve =
            self.nerve[0] > 0 && off < 0.6 && p.y.abs() < b + 2.0 && (p.z + height + 0.5).abs() < 0.6;
        if is_nerve { NERVE } else { 0 }
    }
}

/// Why a random body may be refused.
const REASONS: [&str; 7] = [
    "can reach no voxel",
    "reach no place",
    "finds no place",
    "faces bone",
    "touches structure",
    "empty",
    "caps are kept with",
];

/// Whether a result is acceptable.
pub(super) fn ended_well(end: &End) -> bool {
    match end {
        End::Verified | End::FallsShort(_) => true,
        End::Refused(why) => REASONS.iter().any(|reason| why.contains(reason)),
        End::Faulty(..) | End::Broken(_) => false,
    }
}

/// Simplifies a body that fails: each step takes the first simpler body that still fails.
pub fn shrink(body: RandomBody, fails: impl Fn(RandomBody) -> bool) -> RandomBody {
    let mut body = body;
    // the loop ends, because every step sets a number to its simplest value
    while let Some(simpler) = body.simpler().into_iter().find(|b| fails(*b)) {
        body = simpler;
    }
    body
}

/// A random case that may be simpler.
pub(super) trait Drawn: Copy + std::fmt::Debug {
    /// The case with this number.
    fn draw(number: u64) -> Self;
    /// Where programs disagree; empty where they agree.
    fn disagreements(self) -> Vec<String>;
    /// Cases that are simpler in one thing.
    fn simpler(self) -> Vec<Self>;
}

/// Number of cases after which disagreements are told.
const PORTION: usize = 50;

/// Lists in a table what is wrong with the cases of some numbers, each with the case as simple as something is wrong with it.
pub(super) fn list_wrong<T: Drawn>(mut table: Table, numbers: &[u64], progress: &dyn Progress) -> Table {
    let told = |case: T| {
        let said = case.disagreements();
        (!said.is_empty()).then(|| said.join("; ").replace('\n', "; ").replace('|', "/"))
    };
    let row = |number: &u64| {
        let mut simplest = T::draw(*number);
        let said = told(simplest)?;
        let mut why = said.clone();
        // the loop ends, because every step sets a number to its simplest value
        while let Some(next) = simplest.simpler().into_iter().find_map(|case| Some((case, told(case)?))) {
            (simplest, why) = next;
        }
        Some([number.to_string(), said, format!("{simplest:?}: {why}")])
    };
    for portion in numbers.chunks(PORTION) {
        for [case, said, simple] in portion.par_iter().filter_map(row).collect::<Vec<_>>() {
            let shortfall = format!("case {case}: {said}; as simple as {simple}");
            progress.note(&shortfall);
            table.shortfalls.push(shortfall);
            table.push(vec![case, said, simple]);
        }
    }
    table
}

/// Runs bodies 0 to `count`; lists the results, and the simplified form of each body that failed.
pub fn random_scenes(count: u64, progress: &dyn Progress) -> Table {
    let mut table =
        Table::new("random-scenes", format!("{count} random bodies"), &["ended", "bodies", "an example"]);
    let mut ends: Vec<(u64, End)> = Vec::new();
    for first in (0..count).step_by(PORTION) {
        let portion: Vec<u64> = (first..(first + PORTION as u64).min(count)).collect();
        let run_one = |n: &u64| (*n, run(&RandomBody::draw(*n).scene()));
        ends.extend(portion.par_iter().map(run_one).collect::<Vec<_>>());
        progress.advance(ends.len(), count as usize);
    }
    for told in ["verified", "fell short", "refused", "FAULTY", "BROKEN"] {
        let of_word: Vec<_> = ends.iter().filter(|(_, end)| end.word() == told).collect();
        if let Some((n, end)) = of_word.first() {
            let example = format!("body {n}: {}", end.reason().replace('\n', "; ").replace('|', "/"));
            table.push(vec![told.into(), of_word.len().to_string(), example]);
        }
    }
    for (n, end) in ends.iter().filter(|(_, end)| !ended_well(end)) {
        let small = shrink(RandomBody::draw(*n), |body| !ended_well(&run(&body.scene())));
        table.shortfalls.push(format!("body {n}: {end}; as simple as {small:?}"));
    }
    table
}
