//! From passes to moves: only what cuts is driven at feed, the rest is passed over.
//!
//! A pass is a line of places of the tip. Where it would take nothing from the stock it is left out; the runs between are joined by links over the stock
//! as it then is. A closed pass that cuts everywhere is entered on a slant from the pass before it, or by a ramp along itself. A cut that would be
//! wider than the process allows is first taken in shallower steps ([`crate::machining::MachiningJob::entry_mm`]).
//!
//! Invariant: the tip is never below the height that the pass gives. Coordinates are whole micrometres, heights rounded up.

use bonemill_geometry::cancel;
use rayon::prelude::*;

use crate::machining::MachiningJob;
use crate::machining::moves::{Facing, Kind, Side, TipMove};
use crate::machining::pass::{Height, TipPass, across_mm, rounded, simplified};
use crate::machining::stock::{Stock, TipPoint, steps};

/// Share of the entries' depth that is used, so that heights between cells stay below it.
const ENTRY_SHARE: f64 = 0.95;
/// Lengths of slants between passes, in diameters, the best first.
const SLANTS: [f64; 4] = [3.0, 2.0, 1.0, 0.6];
/// Lead before and after what is needed, and the longest gap that is cut through, in radii.
const LEAD: f64 = 0.1;
const BRIDGE: f64 = 2.0;
/// Most shallower steps of a pass.
const MOST_STEPS: usize = 32;
/// Width of cut up to which the tip goes down beside the stock, in diameters.
const BESIDE: f64 = 0.3;
/// Places of a way to a cell.
const CLOSE: usize = 4;
/// Places of a pass that one thread looks at, at least.
const SHARED: usize = 16;
/// Most laps of a ramp.
const LAPS: usize = 200;
/// Steepest ramp into stock, rise over run.
const RAMP: f64 = 0.1;

/// Stock that roughing leaves to finishing: thinner or narrower than this, mm.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sliver {
    pub thinner_mm: f64,
    pub narrower_mm: f64,
}

/// Lays moves from one side.
pub struct Passes<'a> {
    pub(crate) job: &'a MachiningJob,
    pub(crate) facing: Facing,
    pub(crate) side: Side,
    pub(crate) stock: Stock,
    /// Cells whose stock is worth a cut.
    pub(crate) counts: Vec<bool>,
    /// Whether cuts are kept from being too wide.
    pub(crate) bounded: bool,
    /// How much wider than the tool stock is looked for, mm.
    grown_mm: f64,
    /// Whether cells are to be cut whole: a sheet may stand between their centres.
    pub(crate) wholly: bool,
    /// Stock that is not worth a cut.
    pub(crate) left_alone: Option<Sliver>,
    at: Option<TipPoint>,
    /// Whether the last move cut.
    cutting: bool,
    moves: Vec<TipMove>,
}

/// Direction from one place to another across the cutter's axis; `None` where they are one.
fn toward(from: &TipPoint, to: &TipPoint) -> Option<[f64; 2]> {
    let length = across_mm(from, to);
    (length > 0.0).then(|| [(to[0] - from[0]) / length, (to[1] - from[1]) / length])
}

impl<'a> Passes<'a> {
    /// On the stock as the side sees it.
    /// The tip is at `at` in the machine's axes, above the block; the block is turned before the first move.
    pub fn new(
        job: &'a MachiningJob,
        facing: Facing,
        side: Side,
        stock: Stock,
        at: Option<TipPoint>,
    ) -> Self {
        let counts = vec![true; stock.centres.top.len()];
        Self {
            job,
            facing,
            side,
            stock,
            counts,
            bounded: true,
            grown_mm: 0.0,
            wholly: false,
            left_alone: None,
            at,
            cutting: false,
            moves: vec![],
        }
    }

    /// The moves, after a retract to a height from which the block can be turned, and the stock that is left.
    pub fn finished(mut self) -> (Vec<TipMove>, Option<TipPoint>, Stock) {
        let safe = self.safe_mm();
        if let Some([u, v, _]) = self.at.filter(|at| at[2] < safe) {
            self.go(Kind::Retract, [u, v, safe]);
        }
        (self.moves, self.at, self.stock)
    }

    /// Depth of a cut at the tool's full width, mm.
    pub(crate) fn entry_mm(&self) -> f64 {
        ENTRY_SHARE * self.job.entry_mm()
    }

    /// For passes that are at least `step_mm` apart: a strip as wide as a cell holds a row of centres wherever it lies.
    pub(crate) fn look_beyond(&mut self, step_mm: f64) {
        self.grown_mm = (self.stock.pitch_mm() - step_mm).max(0.0);
    }

    /// Where the tip is.
    pub(crate) fn place(&self) -> Option<TipPoint> {
        self.at
    }

    /// Above the block, however it is turned.
    pub fn safe_mm(&self) -> f64 {
        let block = &self.job.block;
        let farthest = |axis: usize| block.low_mm[axis].abs().max(block.high_mm[axis].abs());
        farthest(1).hypot(farthest(2)) + self.job.process.clearance_mm
    }

    /// Cuts along a pass wherever that takes anything; where that would be too wide, first in steps of the entries' depth.
    pub fn cut(&mut self, pass: &TipPass, height: Height<'_>, kind: Kind) {
        let entry = self.entry_mm();
        let mut needed = self.needed(pass);
        for _ in 0..MOST_STEPS {
            cancel::poll();
            let driven = self.driven(pass, &needed);
            let is_deep = |p: &TipPoint| self.stock.lowest_mm([p[0], p[1]]) - entry > p[2];
            let wide = |n: usize| driven[n] && is_deep(&pass.places[n]) && self.is_wide(pass, n);
            let wide: Vec<bool> = (0..driven.len()).into_par_iter().with_min_len(SHARED).map(wide).collect();
            if !wide.contains(&true) {
                break;
            }
            let shallow = |p: &TipPoint| [p[0], p[1], p[2].max(self.stock.lowest_mm([p[0], p[1]]) - entry)];
            let shallow = TipPass { places: pass.places.iter().map(shallow).collect(), closed: pass.closed };
            self.cut_where(&shallow, wide, height, kind);
            needed = self.needed(pass);
        }
        self.cut_where(pass, needed, height, kind);
    }

    /// Where a pass takes anything that counts.
    fn needed(&self, pass: &TipPass) -> Vec<bool> {
        let takes = |p: TipPoint| {
            if self.wholly {
                self.stock.meets_whole(p, &self.counts)
            } else {
                self.stock.meets(p, self.grown_mm, &self.counts)
            }
        };
        let meets = |p: &TipPoint| p[2].is_finite() && takes(*p);
        let worth = |n: usize| {
            let enough = |sliver: Sliver| self.width_mm(pass, n, sliver.thinner_mm) > sliver.narrower_mm;
            self.left_alone.is_none_or(enough)
        };
        (0..pass.places.len())
            .into_par_iter()
            .with_min_len(SHARED)
            .map(|n| meets(&pass.places[n]) && worth(n))
            .collect()
    }

    /// How much of the tool's width meets stock thicker than `deeper_mm` ahead of a place of a pass, mm; 0 where it goes nowhere.
    fn width_mm(&self, pass: &TipPass, n: usize, deeper_mm: f64) -> f64 {
        // an open pass ends in the direction in which it came
        let ends = !pass.closed && n + 1 == pass.places.len();
        let n = if ends { n.saturating_sub(1) } else { n };
        let at = pass.places[n];
        toward(&at, &pass.next(n)).map_or(0.0, |along| self.stock.width_mm(at, along, deeper_mm, 0.0))
    }

    /// Whether a cut is too wide where it arrives at a place or where it leaves it: before a corner of the part stock stands ahead of the cutter and
    /// beside it, behind the corner beside it only. Strips of cells tell a width to a cell and a half.
    fn is_wide(&self, pass: &TipPass, n: usize) -> bool {
        let pitch_mm = self.stock.pitch_mm();
        let at = pass.places[n];
        let leaves = (pass.closed || n + 1 < pass.places.len()).then(|| toward(&at, &pass.next(n)));
        let arrives = pass.before(n).map(|before| toward(before, &at));
        let is_wide = |along: [f64; 2]| {
            self.stock.width_mm(at, along, self.entry_mm(), 0.5 * pitch_mm)
                > self.job.widest_mm() - 1.5 * pitch_mm
        };
        self.bounded && [leaves, arrives].into_iter().flatten().flatten().any(is_wide)
    }

    /// Cuts along a pass where it is `needed`, with what leads there and the short gaps between.
    fn cut_where(&mut self, pass: &TipPass, needed: Vec<bool>, height: Height<'_>, kind: Kind) {
        let driven = self.driven(pass, &needed);
        if pass.closed && needed.contains(&true) && !driven.contains(&false) {
            self.cut_around(pass, height, kind);
            return;
        }
        for run in pass.runs(&driven) {
            self.cut_run(&run, height, kind);
        }
    }

    pub(crate) fn driven(&self, pass: &TipPass, needed: &[bool]) -> Vec<bool> {
        let places = |radii: f64| (radii * self.job.tool.radius_mm / pass.step_mm()).ceil() as usize;
        pass.driven(needed, places(LEAD), places(BRIDGE))
    }

    /// A closed pass that cuts everywhere: on a slant from the cut before, else by a ramp.
    fn cut_around(&mut self, pass: &TipPass, height: Height<'_>, kind: Kind) {
        let ahead_mm = SLANTS.map(|share| share * self.job.tool.diameter_mm());
        let slant = ahead_mm.into_iter().find_map(|ahead_mm| self.slant(pass, height, ahead_mm));
        match slant {
            Some((slant, start)) => {
                self.follow(&slant.places, kind);
                self.follow(&[pass.from(start), vec![pass.places[start]]].concat(), kind);
            }
            None => {
                let start = self.at.map_or(0, |at| pass.nearest(at));
                let around = pass.from(start);
                if self.width_mm(pass, start, self.stock.pitch_mm()) < BESIDE * self.job.tool.diameter_mm() {
                    self.cut_run(&[around.as_slice(), &around[..1]].concat(), height, kind);
                } else {
                    self.enter_by_ramp(&around, height, kind);
                }
            }
        }
    }

    /// The way from the cut before to a pass beside it, `ahead_mm` on, and where it meets the pass; `None` where it is far or cuts too wide.
    fn slant(&self, pass: &TipPass, height: Height<'_>, ahead_mm: f64) -> Option<(TipPass, usize)> {
        let at = self.at.filter(|_| self.cutting)?;
        let direction = self.direction()?;
        let start = pass.nearest([at[0] + ahead_mm * direction[0], at[1] + ahead_mm * direction[1], at[2]]);
        let to = pass.places[start];
        self.way(to, ahead_mm + self.job.tool.diameter_mm(), height).map(|way| (way, start))
    }

    /// The straight way from the cut before to a place, at the heights that are allowed.
    ///
    /// `None` where it is longer than `longest_mm`, climbs over a wall or falls down one, is not allowed or cuts too wide.
    fn way(&self, to: TipPoint, longest_mm: f64, height: Height<'_>) -> Option<TipPass> {
        let at = self.at.filter(|_| self.cutting)?;
        let distance = (to[0] - at[0]).hypot(to[1] - at[1]);
        if distance > longest_mm || (to[2] - at[2]).abs() >= self.job.level_mm() {
            return None;
        }
        // closely, each place as high as the line and as its neighbours must be: so no corner of the part lies between two of them
        let line: Vec<TipPoint> = steps(at, to, self.stock.pitch_mm() / CLOSE as f64).collect();
        let allowed: Vec<f64> = line.iter().map(|p| height([p[0], p[1]])).collect();
        let highest = |n: usize| allowed[n.saturating_sub(1)..(n + 2).min(allowed.len())].iter();
        let raised = |(n, [u, v, w]): (usize, &TipPoint)| [*u, *v, highest(n).fold(*w, |a, b| a.max(*b))];
        let places: Vec<TipPoint> = line.iter().enumerate().map(raised).collect();
        let most = at[2].max(to[2]) + 0.5 * self.job.entry_mm();
        let falls = |p: &[TipPoint]| p[0][2] - p[p.len() - 1][2] > 0.5 * self.job.entry_mm();
        if places.iter().any(|p| p[2] > most) || places.windows(3 * CLOSE / 2 + 1).any(falls) {
            return None;
        }
        let way = TipPass { places, closed: false };
        (0..way.places.len()).step_by(CLOSE).all(|n| !self.is_wide(&way, n)).then_some(way)
    }

    /// Direction of the last move, if it went across.
    fn direction(&self) -> Option<[f64; 2]> {
        let [.., a, b] = self.moves.as_slice() else { return None };
        let (a, b) = (self.facing.from_block(&a.tip_mm), self.facing.from_block(&b.tip_mm));
        let length = (b.x - a.x).hypot(b.y - a.y);
        (length > 1e-6).then(|| [(b.x - a.x) / length, (b.y - a.y) / length])
    }

    /// Goes down along the pass itself, lap by lap, until a place of the ramp's end comes round again at its own height.
    fn enter_by_ramp(&mut self, around: &[TipPoint], height: Height<'_>, kind: Kind) {
        let Some(&first) = around.first() else { return };
        let free = self.stock.lowest_mm([first[0], first[1]]).max(first[2]);
        let mut places = Vec::with_capacity(around.len() + 64);
        let (mut run, mut before, mut level) = (0.0, first, 0);
        for p in around.iter().cycle().take(LAPS * around.len()) {
            run += (p[0] - before[0]).hypot(p[1] - before[1]);
            before = *p;
            let w = free - RAMP * run;
            level = if w > p[2] { 0 } else { level + 1 };
            places.push([p[0], p[1], p[2].max(w)]);
            if level > around.len() {
                break;
            }
        }
        self.cut_run(&places, height, kind);
    }

    /// An open run: straight on from the cut before, or from above its first place.
    fn cut_run(&mut self, places: &[TipPoint], height: Height<'_>, kind: Kind) {
        let Some(&first) = places.first() else { return };
        match self.way(first, self.job.tool.diameter_mm(), height) {
            Some(way) => self.follow(&way.places, kind),
            None => {
                self.link(first);
                self.cut_line(kind, first);
            }
        }
        self.follow(places, kind);
    }

    /// On along the places. The tip is at the first of them or, where a way has to rise, below it.
    fn follow(&mut self, places: &[TipPoint], kind: Kind) {
        for place in simplified(places) {
            self.cut_line(kind, place);
        }
    }

    fn cut_line(&mut self, kind: Kind, to: TipPoint) {
        cancel::poll();
        let to = rounded(to);
        if let Some(from) = self.at {
            self.stock.cut_line(from, to);
        }
        self.go(kind, to);
        self.cutting = true;
    }

    /// Up, across and down to the height of repositioning above the stock at a place.
    fn link(&mut self, to: TipPoint) {
        let clearance_mm = self.job.process.clearance_mm;
        let approach = [to[0], to[1], to[2].max(self.stock.free_mm([to[0], to[1]])) + clearance_mm];
        let Some(from) = self.at.filter(|_| !self.moves.is_empty()) else {
            self.go(Kind::Link, self.at.unwrap_or([to[0], to[1], self.safe_mm()]));
            self.go(Kind::Link, [to[0], to[1], self.safe_mm()]);
            self.go(Kind::Link, approach);
            return;
        };
        let free = self.stock.free_along_mm([from[0], from[1]], [to[0], to[1]]);
        let height = free.max(to[2]).max(from[2] - clearance_mm) + clearance_mm;
        self.go(Kind::Retract, [from[0], from[1], height]);
        self.go(Kind::Link, [to[0], to[1], height]);
        self.go(Kind::Link, approach);
    }

    /// A move, unless it goes nowhere.
    pub(crate) fn go(&mut self, kind: Kind, to: TipPoint) {
        let to = rounded(to);
        // the first move of a side turns the block, even in place
        if self.at == Some(to) && !self.moves.is_empty() {
            return;
        }
        let feed_mm_min = if kind.cuts() { self.job.feed_mm_min() } else { self.job.machine.rapid_mm_min };
        let tip_mm = self.facing.to_block(&nalgebra::Vector3::from(to));
        self.moves.push(TipMove {
            side: self.side,
            kind,
            tip_mm,
            a_rad: self.job.a_rad(self.facing),
            feed_mm_min,
            time_s: 0.0,
        });
        self.at = Some(to);
        self.cutting = kind.cuts();
    }
}
