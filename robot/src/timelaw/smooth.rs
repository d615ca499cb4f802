//! Computes the law from the base: the mean over a window of length T, in closed form.
//!
//! The window covers the time from t − T to t, so ṡ = (s₀(t) − s₀(t − T))/T, s̈ = (ṡ₀(t) − ṡ₀(t − T))/T and
//! s⃛ = (s̈₀(t) − s̈₀(t − T))/T. Between the times at which an end of the window passes a phase's end, s⃛ is constant and s
//! is a cubic. The law lasts T longer than the base. Where the base rests for T, the law is at rest at the end of that
//! time, at exactly the same place.

use super::pass::Phase;

/// A part of the law with constant s⃛.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct CubicPiece {
    /// Its start, s.
    pub start_s: f64,
    /// s at its start, mm.
    pub s_mm: f64,
    /// ṡ at its start, mm/s.
    pub speed_mm_s: f64,
    /// s̈ at its start, mm/s².
    pub acceleration_mm_s2: f64,
    /// s⃛, mm/s³.
    pub jerk_mm_s3: f64,
    /// Number of rests inside the path before it. At a rest the path may turn, and s alone does not tell the two sides apart.
    pub rests: u32,
}

impl CubicPiece {
    /// s, ṡ and s̈ at a time after its start.
    pub fn at(&self, elapsed_s: f64) -> [f64; 3] {
        let Self { s_mm, speed_mm_s: v, acceleration_mm_s2: a, jerk_mm_s3: j, .. } = *self;
        let t = elapsed_s;
        [s_mm + t * (v + t * (0.5 * a + t * j / 6.0)), (v + t * (a + t * 0.5 * j)).max(0.0), a + t * j]
    }
}

/// Events nearer than this are treated as one, s. The window's head leaves a rest when its tail enters it, and rounding
/// must not separate the two.
const SAME_S: f64 = 1e-11;

/// One end of the window as it moves through the base's phases.
struct End<'a> {
    phases: &'a [Phase],
    /// The phase that it is in; `None` before the first.
    at: Option<usize>,
    /// When it enters the next phase (or leaves the last), in the law's time.
    next_s: f64,
}

impl<'a> End<'a> {
    fn new(phases: &'a [Phase], delay_s: f64) -> Self {
        Self { phases, at: None, next_s: delay_s }
    }

    /// Enters the next phase at `next_s`.
    fn advance(&mut self) {
        let at = self.at.map_or(0, |at| at + 1);
        self.at = Some(at);
        self.next_s = self.phases.get(at).map_or(f64::INFINITY, |phase| self.next_s + phase.duration_s);
    }

    /// The rest that it is in. When the window's tail enters a rest, the whole window is in it.
    fn rest(&self) -> Option<&'a Phase> {
        self.phases.get(self.at?).filter(|phase| phase.speed_mm_s == 0.0 && phase.acceleration_mm_s2 == 0.0)
    }

    /// s₀, ṡ₀ and s̈₀ at a time before `next_s`; at rest before the first phase and after the last.
    fn state(&self, time_s: f64, end_mm: f64) -> [f64; 3] {
        match self.at.map(|at| self.phases.get(at)) {
            None => [0.0; 3],
            Some(None) => [end_mm, 0.0, 0.0],
            Some(Some(phase)) => {
                let left_s = if self.next_s.is_finite() { self.next_s - time_s } else { 0.0 };
                let t = (phase.duration_s - left_s).clamp(0.0, phase.duration_s);
                let a = phase.acceleration_mm_s2;
                [phase.s_mm + t * (phase.speed_mm_s + 0.5 * a * t), (phase.speed_mm_s + a * t).max(0.0), a]
            }
        }
    }
}

/// The law's pieces and its duration, s; `end_mm`: s at the path's end.
pub(super) fn smooth(phases: &[Phase], window_s: f64, end_mm: f64) -> (Vec<CubicPiece>, f64) {
    let mut pieces: Vec<CubicPiece> = Vec::with_capacity(2 * phases.len() + 1);
    let (mut head, mut tail) = (End::new(phases, 0.0), End::new(phases, window_s));
    let mut s_mm = 0.0;
    let mut time_s = 0.0;
    let mut rests = 0;
    while head.next_s.is_finite() || tail.next_s.is_finite() {
        let now_s = head.next_s.min(tail.next_s);
        if let Some(last) = pieces.last() {
            [s_mm, ..] = last.at(now_s - last.start_s);
        }
        time_s = now_s;
        if head.next_s <= now_s + SAME_S {
            head.advance();
        }
        if tail.next_s <= now_s + SAME_S {
            tail.advance();
            if let Some(rest) = tail.rest() {
                (s_mm, rests) = (rest.s_mm, rests + 1);
            }
        }
        let ahead = head.state(time_s, end_mm);
        let behind = tail.state(time_s, end_mm);
        let per_window = |k: usize| (ahead[k] - behind[k]) / window_s;
        let piece = CubicPiece {
            start_s: time_s,
            s_mm,
            speed_mm_s: per_window(0).max(0.0),
            acceleration_mm_s2: per_window(1),
            jerk_mm_s3: per_window(2),
            rests,
        };
        let is_next = head.next_s.min(tail.next_s) > time_s;
        if is_next && (head.next_s.is_finite() || tail.next_s.is_finite()) {
            pieces.push(piece);
        }
    }
    (pieces, time_s)
}
