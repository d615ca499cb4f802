//! The waypoints of a channel: depths of the tip one after the other, with what each move does and how fast.
//!
//! The tool comes from the standoff through free space to just before the bone, cuts in steps to its depth, and is drawn
//! back. With pecks it is drawn out to before the bone after each, and comes back to just before where it was. A move that
//! removes bone is a cut. A dwell is the last hundredth of a millimetre, passed so slowly that it takes that long.

use bonemill_cutting::cutter::MoveKind;

/// The feed begins this far before the bone, and after a peck this far before where the tip was, mm; assumed.
pub const LEAD_MM: f64 = 0.5;
/// The way on which a dwell passes, mm.
const DWELL_MM: f64 = 0.01;

/// How a channel is gone through. Depths are those of the tip from the entry, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Strokes {
    /// Where the tool begins and ends, negative.
    pub start_mm: f64,
    /// Where it first meets bone.
    pub contact_mm: f64,
    /// Where it ends.
    pub end_mm: f64,
    /// Longest cut between two waypoints.
    pub step_mm: f64,
    /// Between two retractions.
    pub peck_mm: Option<f64>,
    /// At the end, s.
    pub dwell_s: f64,
    /// Speed of cuts, mm/s.
    pub feed_mm_s: f64,
    /// Speed of all other moves, mm/s.
    pub link_mm_s: f64,
}

/// One waypoint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TipPlace {
    /// Depth of the tip, mm.
    pub depth_mm: f64,
    /// What the move that ends here does.
    pub kind: MoveKind,
    /// Its speed cap, mm/s.
    pub speed_mm_s: f64,
    /// Which stroke, from 0.
    pub stroke: u32,
    /// Whether the tool turns back here.
    pub turns_back: bool,
}

impl Strokes {
    /// The waypoints, in order.
    pub fn places(&self) -> Vec<TipPlace> {
        let before_bone = (self.contact_mm - LEAD_MM).max(self.start_mm);
        let mut places = Vec::new();
        let mut push = |depth_mm: f64, kind: MoveKind, speed_mm_s: f64, stroke: u32| {
            places.push(TipPlace { depth_mm, kind, speed_mm_s, stroke, turns_back: false });
        };
        push(self.start_mm, MoveKind::Link, self.link_mm_s, 0);
        let mut reached = before_bone;
        for (stroke, to) in (0u32..).zip(self.stroke_ends()) {
            let from = if stroke == 0 { before_bone } else { (reached - LEAD_MM).max(before_bone) };
            let way_in = if stroke == 0 { MoveKind::Link } else { MoveKind::Retract };
            push(from, way_in, self.link_mm_s, stroke);
            let is_last = to >= self.end_mm;
            let dwells = is_last && self.dwell_s > 0.0 && to - from > 2.0 * DWELL_MM;
            let cut_to = if dwells { to - DWELL_MM } else { to };
            let steps = ((cut_to - from) / self.step_mm - 1e-9).ceil().max(1.0);
            let count = steps as u32;
            for n in 1..=count {
                let share = f64::from(n) / f64::from(count);
                push(from + share * (cut_to - from), MoveKind::Cut, self.feed_mm_s, stroke);
            }
            if dwells {
                push(to, MoveKind::Cut, (DWELL_MM / self.dwell_s).min(self.feed_mm_s), stroke);
            }
            let out = if is_last { self.start_mm } else { before_bone };
            push(out, MoveKind::Retract, self.link_mm_s, stroke);
            reached = to;
        }
        mark_turns(&mut places);
        places
    }

    /// Where each stroke ends, mm.
    fn stroke_ends(&self) -> Vec<f64> {
        let way_mm = self.end_mm - self.contact_mm;
        let peck_mm = self.peck_mm.unwrap_or(f64::INFINITY).max(self.step_mm.min(way_mm));
        let count = (way_mm / peck_mm - 1e-9).ceil().max(1.0) as u32;
        let end = |n: u32| if n == count { self.end_mm } else { self.contact_mm + f64::from(n) * peck_mm };
        (1..=count).map(end).collect()
    }
}

fn mark_turns(places: &mut [TipPlace]) {
    for n in 1..places.len().saturating_sub(1) {
        let [a, b, c] = [n - 1, n, n + 1].map(|n| places[n].depth_mm);
        places[n].turns_back = (b - a) * (c - b) < 0.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STROKES: Strokes = Strokes {
        start_mm: -5.0,
        contact_mm: 0.2,
        end_mm: 10.0,
        step_mm: 0.25,
        peck_mm: None,
        dwell_s: 0.0,
        feed_mm_s: 0.5,
        link_mm_s: 10.0,
    };

    #[test]
    fn one_stroke_cuts_in_even_steps_and_comes_back() {
        let places = STROKES.places();
        assert_eq!((places[0].depth_mm, places[1].depth_mm), (-5.0, -0.3));
        let cuts: Vec<_> = places.iter().filter(|p| p.kind == MoveKind::Cut).collect();
        assert_eq!(cuts.len(), 42);
        assert_eq!(cuts.last().unwrap().depth_mm, 10.0);
        assert!(places.windows(2).skip(1).take(42).all(|w| w[1].depth_mm - w[0].depth_mm <= 0.25 + 1e-12));
        let last = places.last().unwrap();
        assert_eq!((last.depth_mm, last.kind), (-5.0, MoveKind::Retract));
        assert_eq!(places.iter().filter(|p| p.turns_back).count(), 1);
    }

    #[test]
    fn pecks_come_out_of_the_bone_and_every_removing_move_is_a_cut() {
        let places = Strokes { peck_mm: Some(3.0), dwell_s: 2.0, ..STROKES }.places();
        let mut deepest = f64::NEG_INFINITY;
        for w in places.windows(2) {
            let removes = w[1].depth_mm > deepest.max(0.2);
            assert!(!removes || w[1].kind == MoveKind::Cut, "{w:?}");
            deepest = deepest.max(w[1].depth_mm);
        }
        assert_eq!(places.iter().filter(|p| p.kind == MoveKind::Retract && p.depth_mm < 0.0).count(), 4);
        assert_eq!(places.iter().filter(|p| p.turns_back).count(), 7);
        let dwell = places.iter().rev().find(|p| p.kind == MoveKind::Cut).unwrap();
        assert!((DWELL_MM / dwell.speed_mm_s - 2.0).abs() < 1e-12 && dwell.depth_mm == 10.0);
        assert_eq!(deepest, 10.0);
    }
}
