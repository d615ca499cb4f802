//! The time law: position, velocity, acceleration and jerk of every joint at every instant, in closed form.

use std::sync::Arc;

use rayon::prelude::*;

use super::geometry::{Geometry, PathElement};
use super::input::PathLimits;
use super::pass::{Phase, for_each_phase};
use super::smooth::{CubicPiece, smooth};
use super::stretch::{Stretch, element_at};

/// Joint positions and their derivatives at one instant; mm and rad by joint, shape (dof) each.
#[derive(Debug, Clone, PartialEq)]
pub struct JointState {
    /// Positions, mm or rad.
    pub q: Vec<f64>,
    /// Velocities, mm/s or rad/s.
    pub qd: Vec<f64>,
    /// Accelerations, mm/s² or rad/s².
    pub qdd: Vec<f64>,
    /// Jerks, mm/s³ or rad/s³; at an instant where they jump, the values after it.
    pub qddd: Vec<f64>,
}

/// Greatest ratios of a motion to the joints' limits: 1 is at the limit.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LimitRatios {
    /// Greatest |q̇|/limit over all joints and sampled instants.
    pub velocity: f64,
    /// Greatest |q̈|/limit.
    pub acceleration: f64,
    /// Greatest |q⃛|/limit.
    pub jerk: f64,
}

/// Number of instants at which limits are checked in each piece, and again for every element of the path in it.
const INSTANTS: usize = 6;

/// Time between instants at which it is asked which joint is at a limit, s, and the most instants.
const LOOK_S: f64 = 0.01;
const MOST_LOOKS: f64 = 1e5;

/// Number of intervals in each piece between instants at which the burr's speed is evaluated.
const BURR_INSTANTS: usize = 16;

/// A motion along a prepared path: at rest at both ends, within all limits at every instant between.
///
/// q(t) = q(s(t)), q̇ = q' ṡ, q̈ = q'' ṡ² + q' s̈, q⃛ = q''' ṡ³ + 3 q'' ṡ s̈ + q' s⃛, with s⃛ constant on each piece.
#[derive(Debug, Clone)]
pub struct TimeLaw {
    geometry: Arc<Geometry>,
    elements: Arc<[(f64, f64, PathElement)]>,
    /// The first element of each stretch between rests, and their number.
    rests: Vec<usize>,
    pieces: Vec<CubicPiece>,
    duration_s: f64,
    waypoint_times_s: Vec<f64>,
}

impl TimeLaw {
    /// Computes the base motion through `stretches` and smooths it over a window.
    pub(super) fn new(
        geometry: Arc<Geometry>,
        elements: Arc<[(f64, f64, PathElement)]>,
        stretches: &[Stretch],
        window_s: f64,
    ) -> Self {
        let mut phases: Vec<Phase> = Vec::with_capacity(stretches.len());
        for_each_phase(stretches, window_s, |phase| push_unless_continued(&mut phases, phase));
        let end_mm = phases.last().map_or(0.0, |last| {
            let t = last.duration_s;
            last.s_mm + t * (last.speed_mm_s + 0.5 * last.acceleration_mm_s2 * t)
        });
        let (pieces, duration_s) =
            if phases.is_empty() { (vec![], 0.0) } else { smooth(&phases, window_s, end_mm) };
        let rests = rests(&geometry, &elements);
        let mut law = Self { geometry, elements, rests, pieces, duration_s, waypoint_times_s: vec![] };
        let kept_times_s = law.kept_times_s();
        law.waypoint_times_s = law.geometry.kept_of.iter().map(|&i| kept_times_s[i as usize]).collect();
        law
    }

    /// Number of joints.
    pub fn dof(&self) -> usize {
        self.geometry.dof
    }

    /// Duration from rest to rest, s; 0 for a path of no length.
    pub fn duration_s(&self) -> f64 {
        self.duration_s
    }

    /// When each given waypoint is passed, s, never decreasing, shape (waypoints). At a rounded corner it is the corner's
    /// middle.
    pub fn waypoint_times_s(&self) -> &[f64] {
        &self.waypoint_times_s
    }

    /// When the burr has gone a share, 0 to 1, of its way along the polyline from one given waypoint to a later one, s.
    pub fn on_the_way_s(&self, [from, to]: [usize; 2], share: f64) -> f64 {
        let Geometry { kept_of, s_mm, length_mm, burr_per_s, .. } = &*self.geometry;
        let segments = kept_of[from] as usize..kept_of[to] as usize;
        let burr_mm = |i: usize| length_mm[i] * burr_per_s[i];
        let mut left_mm = share * segments.clone().map(burr_mm).sum::<f64>();
        for i in segments {
            if left_mm < burr_mm(i) {
                return self.passes_s(s_mm[i] + left_mm / burr_per_s[i]);
            }
            left_mm -= burr_mm(i);
        }
        self.waypoint_times_s[to]
    }

    /// Greatest speed of the burr within the move that ends at each given waypoint, mm/s, shape (waypoints); 0 for the first.
    ///
    /// A rounded corner belongs to both moves, half each. A waypoint that was merged has the speed of the move that it lies on.
    pub fn burr_speeds_mm_s(&self) -> Vec<f64> {
        let count = self.geometry.count();
        if self.pieces.is_empty() || count < 2 {
            return vec![0.0; self.geometry.kept_of.len()];
        }
        let of_segment = |i: usize| self.greatest_burr_speed_mm_s(i);
        let of_segments: Vec<f64> = (0..count - 1).into_par_iter().map(of_segment).collect();
        let of_move = |kept: &u32| (*kept as usize).checked_sub(1).map_or(0.0, |i| of_segments[i]);
        self.geometry.kept_of.iter().map(of_move).collect()
    }

    /// The same for the kept segment i: ṡ is a parabola in time on each piece, and the burr's way per s is constant on the straight and
    /// sampled on the halves of the corners.
    fn greatest_burr_speed_mm_s(&self, i: usize) -> f64 {
        let (from_mm, to_mm) = (self.geometry.s_mm[i], self.geometry.s_mm[i + 1]);
        let half_mm = &self.geometry.half_blend_mm;
        let straight_mm = [from_mm + half_mm[i], to_mm - half_mm[i + 1]];
        let first = self.pieces.partition_point(|piece| piece.s_mm <= from_mm).saturating_sub(1);
        let mut greatest = 0f64;
        for (k, piece) in self.pieces.iter().enumerate().skip(first) {
            if piece.s_mm >= to_mm {
                break;
            }
            let end_s = self.pieces.get(k + 1).map_or(self.duration_s, |next| next.start_s) - piece.start_s;
            let enters_s = if piece.s_mm < from_mm { passed_after_s(piece, from_mm, end_s) } else { 0.0 };
            let leaves_s =
                if piece.at(end_s)[0] > to_mm { passed_after_s(piece, to_mm, end_s) } else { end_s };
            let turns_s = -piece.acceleration_mm_s2 / piece.jerk_mm_s3;
            let is_inside = turns_s > enters_s && turns_s < leaves_s;
            let mut meet = |elapsed_s: f64| {
                let [s_mm, speed, _] = piece.at(elapsed_s);
                greatest = greatest.max(speed * self.geometry.burr_per_s_at(i, s_mm));
            };
            (0..=BURR_INSTANTS)
                .for_each(|n| meet(enters_s + (leaves_s - enters_s) * n as f64 / BURR_INSTANTS as f64));
            if is_inside {
                meet(turns_s);
            }
            // where the corners end the burr's way per s is greatest
            for place_mm in straight_mm {
                if piece.s_mm < place_mm && piece.at(leaves_s)[0] > place_mm {
                    meet(passed_after_s(piece, place_mm, leaves_s));
                }
            }
        }
        greatest
    }

    /// Joint state at a time; before the start and from the end on the arm stands at the first and the last waypoint.
    pub fn sample(&self, time_s: f64) -> JointState {
        let mut state = JointState {
            q: vec![0.0; self.dof()],
            qd: vec![0.0; self.dof()],
            qdd: vec![0.0; self.dof()],
            qddd: vec![0.0; self.dof()],
        };
        let mut cursor = self.cursor(time_s);
        cursor.visit(time_s, |j, [q, qd, qdd, qddd]| {
            (state.q[j], state.qd[j], state.qdd[j], state.qddd[j]) = (q, qd, qdd, qddd);
        });
        state
    }

    /// Greatest ratios to limits, sampled several times in every piece of the closed form and in every element of the path that
    /// the piece passes, so also between the rows of a file.
    pub fn limit_ratios(&self, limits: &PathLimits) -> LimitRatios {
        let instants = |(k, piece): (usize, &CubicPiece)| {
            let end_s = self.pieces.get(k + 1).map_or(self.duration_s, |next| next.start_s);
            let length_s = end_s - piece.start_s;
            let mut cursor = self.cursor(piece.start_s);
            let passed = element_at(&self.elements, piece.at(length_s)[0]) - cursor.element;
            let count = INSTANTS + INSTANTS * passed;
            let mut worst = LimitRatios::default();
            let mut meet = |j: usize, [qd, qdd, qddd]: [f64; 3]| {
                worst.velocity = greater(worst.velocity, qd.abs() / limits.velocity[j]);
                worst.acceleration = greater(worst.acceleration, qdd.abs() / limits.acceleration[j]);
                worst.jerk = greater(worst.jerk, qddd.abs() / limits.jerk[j]);
            };
            // on a straight move all joints are fastest at the same time, so the greatest |ṡ|, |s̈| and |s⃛| suffice
            let mut straight: Option<(u32, [f64; 3])> = None;
            let meet_straight = |straight: &mut Option<(u32, [f64; 3])>,
                                 meet: &mut dyn FnMut(usize, [f64; 3])| {
                let Some((i, greatest)) = straight.take() else { return };
                let directions = self.geometry.direction(i as usize).iter().enumerate();
                directions.for_each(|(j, d)| meet(j, greatest.map(|rate| d * rate)));
            };
            for n in 0..=count {
                // the end belongs to the next piece
                let share = (n as f64 / count as f64).min(1.0 - 1e-9);
                let Some((element, x, rates)) = cursor.place(piece.start_s + share * length_s) else {
                    continue;
                };
                match element {
                    PathElement::Straight(i) => {
                        if straight.is_none_or(|(on, _)| on != i) {
                            meet_straight(&mut straight, &mut meet);
                        }
                        let (_, greatest) = straight.get_or_insert((i, [0.0; 3]));
                        greatest
                            .iter_mut()
                            .zip(rates)
                            .for_each(|(most, rate)| *most = greater(*most, rate.abs()));
                    }
                    PathElement::Blend(_) => {
                        self.at(element, x, rates, |j, [_, qd, qdd, qddd]| meet(j, [qd, qdd, qddd]));
                    }
                }
            }
            meet_straight(&mut straight, &mut meet);
            worst
        };
        let worse = |a: LimitRatios, b: LimitRatios| LimitRatios {
            velocity: greater(a.velocity, b.velocity),
            acceleration: greater(a.acceleration, b.acceleration),
            jerk: greater(a.jerk, b.jerk),
        };
        self.pieces.par_iter().enumerate().map(instants).reduce(LimitRatios::default, worse)
    }

    /// The time for which each joint is the one that is nearest to a limit, s, by its velocity, acceleration and jerk; only while it
    /// takes at least `share` of that limit. Sampled at equal distances of time.
    pub fn seconds_at_limits(&self, limits: &PathLimits, share: f64) -> Vec<[f64; 3]> {
        let mut seconds = vec![[0.0; 3]; self.dof()];
        let period_s = (self.duration_s / MOST_LOOKS).max(LOOK_S);
        let mut cursor = self.cursor(0.0);
        for n in 0..(self.duration_s / period_s) as usize {
            let (mut most, mut nearest) = (share, None);
            cursor.visit((n as f64 + 0.5) * period_s, |j, [_, qd, qdd, qddd]| {
                let used = [qd / limits.velocity[j], qdd / limits.acceleration[j], qddd / limits.jerk[j]];
                for (of, ratio) in used.into_iter().enumerate() {
                    if ratio.abs() >= most {
                        (most, nearest) = (ratio.abs(), Some((j, of)));
                    }
                }
            });
            if let Some((j, of)) = nearest {
                seconds[j][of] += period_s;
            }
        }
        seconds
    }

    /// q, q̇, q̈ and q⃛ of every joint at x on an element, at ṡ, s̈, s⃛.
    fn at(
        &self,
        element: PathElement,
        x: f64,
        [v, a, jerk]: [f64; 3],
        mut take: impl FnMut(usize, [f64; 4]),
    ) {
        self.geometry.at(element, x, |j, [q, slope, bend, snap]| {
            let qddd = snap * v * v * v + 3.0 * bend * v * a + slope * jerk;
            take(j, [q, slope * v, bend * v * v + slope * a, qddd]);
        });
    }

    /// A cursor that advances in time without a search.
    pub(super) fn cursor(&self, time_s: f64) -> Cursor<'_> {
        let piece = self.pieces.partition_point(|piece| piece.start_s <= time_s).saturating_sub(1);
        let s_mm = self.pieces.get(piece).map_or(0.0, |piece| piece.s_mm);
        Cursor { law: self, piece, element: element_at(&self.elements, s_mm) }
    }

    /// The element next to a rest on the side of `piece`, in case rounding has put s on the other side.
    fn beside_rest(&self, piece: &CubicPiece, element: usize) -> usize {
        let at = piece.rests as usize;
        let first = self.rests.get(at).copied().unwrap_or(0);
        let end = self.rests.get(at + 1).copied().unwrap_or(self.elements.len());
        element.clamp(first, end.saturating_sub(1).max(first))
    }

    /// When each kept waypoint is passed, s.
    fn kept_times_s(&self) -> Vec<f64> {
        let mut times_s: Vec<f64> = self.geometry.s_mm.par_iter().map(|s_mm| self.passes_s(*s_mm)).collect();
        // up to rounding they never decrease
        let mut last_s = 0.0f64;
        for time_s in &mut times_s {
            last_s = last_s.max(*time_s);
            *time_s = last_s;
        }
        if let Some(last) = times_s.last_mut() {
            *last = self.duration_s;
        }
        times_s
    }

    /// When a place of the path is passed, s.
    fn passes_s(&self, s_mm: f64) -> f64 {
        let at = self.pieces.partition_point(|piece| piece.s_mm < s_mm).saturating_sub(1);
        let Some(piece) = self.pieces.get(at) else { return 0.0 };
        let end_s = self.pieces.get(at + 1).map_or(self.duration_s, |next| next.start_s);
        piece.start_s + passed_after_s(piece, s_mm, end_s - piece.start_s)
    }
}

/// The greater of two values; NaN is greater than every number.
fn greater(a: f64, b: f64) -> f64 {
    if a.is_nan() || a > b { a } else { b }
}

/// Where stretches between rests begin and end, as indices of elements.
fn rests(geometry: &Geometry, elements: &[(f64, f64, PathElement)]) -> Vec<usize> {
    let is_rest =
        |element: &PathElement| matches!(element, PathElement::Straight(i) if geometry.stop[*i as usize]);
    let starts = elements.iter().enumerate().filter(|(_, (_, _, element))| is_rest(element));
    starts.map(|(at, _)| at).chain([elements.len()]).collect()
}

/// When s reaches a place within a piece, s after its start: bisection, since ṡ may be 0 at either end.
fn passed_after_s(piece: &CubicPiece, s_mm: f64, length_s: f64) -> f64 {
    let (mut low, mut high) = (0.0, length_s);
    if piece.s_mm >= s_mm {
        return 0.0;
    }
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if piece.at(middle)[0] < s_mm {
            low = middle
        } else {
            high = middle
        }
        if high - low <= 1e-13 * length_s {
            break;
        }
    }
    high
}

/// Reads a law at times that never decrease.
pub(super) struct Cursor<'a> {
    law: &'a TimeLaw,
    piece: usize,
    element: usize,
}

impl Cursor<'_> {
    /// Positions and velocities at `time_s`, which must not be before the previous call's time.
    pub fn read(&mut self, time_s: f64, q: &mut [f64], qd: &mut [f64]) {
        self.visit(time_s, |j, [position, velocity, ..]| {
            q[j] = position;
            qd[j] = velocity;
        });
    }

    /// q, q̇, q̈ and q⃛ of every joint at `time_s`, which must not be before the previous call's time.
    pub fn visit(&mut self, time_s: f64, mut take: impl FnMut(usize, [f64; 4])) {
        let law = self.law;
        match self.place(time_s) {
            Some((element, x, rates)) => law.at(element, x, rates, take),
            None => {
                let at = if time_s >= law.duration_s { law.geometry.count() - 1 } else { 0 };
                let waypoint = law.geometry.waypoint(at).iter().enumerate();
                waypoint.for_each(|(j, q)| take(j, [*q, 0.0, 0.0, 0.0]));
            }
        }
    }

    /// The element, x on it, and ṡ, s̈, s⃛ at `time_s`, which must not be before the previous call's time; `None` before and
    /// after the motion.
    fn place(&mut self, time_s: f64) -> Option<(PathElement, f64, [f64; 3])> {
        let law = self.law;
        if time_s >= law.duration_s || time_s < 0.0 || law.pieces.is_empty() {
            return None;
        }
        while law.pieces.get(self.piece + 1).is_some_and(|next| next.start_s <= time_s) {
            self.piece += 1;
        }
        let piece = &law.pieces[self.piece];
        let [s_mm, v, a] = piece.at(time_s - piece.start_s);
        while law.elements.get(self.element + 1).is_some_and(|(start, ..)| *start <= s_mm) {
            self.element += 1;
        }
        let (_, _, element) = law.elements.get(law.beside_rest(piece, self.element))?;
        Some((*element, law.geometry.place(*element, s_mm), [v, a, piece.jerk_mm_s3]))
    }
}

/// Adds a phase, or lengthens the last one if it continues with the same acceleration.
fn push_unless_continued(phases: &mut Vec<Phase>, phase: Phase) {
    match phases.last_mut() {
        Some(last)
            if last.acceleration_mm_s2 == 0.0
                && phase.acceleration_mm_s2 == 0.0
                && last.speed_mm_s == phase.speed_mm_s =>
        {
            last.duration_s += phase.duration_s;
        }
        _ => phases.push(phase),
    }
}
