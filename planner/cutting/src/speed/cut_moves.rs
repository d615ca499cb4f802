//! The moves of a path whose cuts keep a range of speed: the greatest profile under caps on the cuts, and how long they take.
//!
//! Both modes that follow forces go through one-parameter families of caps, from the fastest (parameter 0) to the slowest. Where no
//! cap of a family rises with the parameter, no speed of the greatest profile does ([`super::fastest_profile`]), so the time of
//! the cuts never falls with it, and the parameter for a given time is found by bracketing.

use super::{LimitedProfile, fastest_profile, last_within};
use crate::burr::ModelError;

/// Evaluations until the cuts take a given time.
const EVALUATIONS: u32 = 60;
/// How exactly that time is met, as a share of it.
const TIME_SHARE: f64 = 1e-9;

/// A move that is to remove nothing may go this many times as slowly as the slowest cut: it is slow only where it meets the skin that a
/// rounded corner left, or bone between the grid's voxels.
pub const SLOWEST_SKIN: f64 = 0.1;

/// Moves in order, links included; one entry per move in each list.
#[derive(Debug, Clone)]
pub struct CutMoves<'a> {
    /// Whether the move is a cut.
    pub is_cut: Vec<bool>,
    /// Its length, mm.
    pub length_mm: &'a [f64],
    /// Slowest that it may be, mm/s.
    pub slowest_mm_s: &'a [f64],
    /// Fastest cut, mm/s.
    pub max_mm_s: f64,
    /// Speed of all other moves, mm/s.
    pub link_mm_s: f64,
    /// Largest acceleration along the path, mm/s².
    pub acceleration_mm_s2: f64,
}

impl CutMoves<'_> {
    /// The fastest profile with move i at most `cap_mm_s(i)`, which counts as the nearest speed that the move may have; a link that nothing
    /// caps goes at its own.
    ///
    /// # Errors
    /// As [`fastest_profile`].
    pub fn profile(&self, cap_mm_s: impl Fn(usize) -> f64) -> Result<LimitedProfile, ModelError> {
        let most = |i: usize| if self.is_cut[i] { self.max_mm_s } else { self.link_mm_s };
        let least = |i: usize| self.slowest_mm_s[i].min(most(i));
        let moves = 0..self.is_cut.len();
        let caps: Vec<f64> = moves.map(|i| cap_mm_s(i).min(most(i)).max(least(i))).collect();
        let least_mm_s = self.slowest_mm_s.iter().copied().fold(self.link_mm_s, f64::min);
        let mut profile = fastest_profile(&caps, self.length_mm, least_mm_s, self.acceleration_mm_s2)?;
        // between slower moves too: the arm has limits of its own
        for (i, speed) in profile.move_mm_s.iter_mut().enumerate() {
            *speed = speed.max(least(i));
        }
        Ok(profile)
    }

    /// Time of the cuts at their largest speeds: Σ Δs/v, s.
    pub fn cutting_s(&self, profile: &LimitedProfile) -> f64 {
        let moves = self.is_cut.iter().zip(self.length_mm).zip(&profile.move_mm_s);
        moves.filter(|((is_cut, _), _)| **is_cut).map(|((_, ds), v)| ds / v).sum()
    }

    /// The slowest of a family of profiles whose cuts take at most `cutting_s`: its parameter from 0 to `slowest`, and the profile;
    /// the fastest where every one takes longer.
    ///
    /// `cap_mm_s(parameter, i)`: cap of cut i, mm/s, which does not rise with the parameter.
    ///
    /// # Errors
    /// As [`fastest_profile`].
    pub fn in_time(
        &self,
        slowest: f64,
        cap_mm_s: impl Fn(f64, usize) -> f64 + Sync,
        cutting_s: f64,
    ) -> Result<(f64, LimitedProfile), ModelError> {
        let profile = |parameter: f64| self.profile(|i| cap_mm_s(parameter, i));
        let time_s = |parameter: f64| Ok(self.cutting_s(&profile(parameter)?));
        let (shortest_s, longest_s) = (time_s(0.0)?, time_s(slowest)?);
        let parameter = if longest_s <= cutting_s {
            slowest
        } else if shortest_s >= cutting_s {
            0.0
        } else {
            let bracket = [(0.0, shortest_s), (slowest, longest_s)];
            last_within(bracket, cutting_s, TIME_SHARE * cutting_s, EVALUATIONS, time_s)?
        };
        Ok((parameter, profile(parameter)?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_family_of_shares_takes_the_time_asked_for() {
        let length_mm = [0.0, 1.0, 1.0, 2.0, 1.0];
        let moves = CutMoves {
            is_cut: vec![false, true, false, true, true],
            length_mm: &length_mm,
            slowest_mm_s: &[0.05, 0.5, 0.05, 0.5, 0.5],
            max_mm_s: 4.0,
            link_mm_s: 10.0,
            acceleration_mm_s2: 20.0,
        };
        let force_cap = [9.0, 2.0, 0.0, f64::INFINITY, 0.1];
        let is_cut = moves.is_cut.clone();
        let cap = |slowness: f64, i: usize| {
            if is_cut[i] { (1.0 - slowness) * f64::min(force_cap[i], 4.0) } else { f64::INFINITY }
        };
        let fastest = moves.profile(|i| cap(0.0, i)).unwrap();
        // no cut above its cap nor below the range, links on their own speed at most
        assert_eq!(fastest.move_mm_s[1], 2.0);
        assert_eq!(fastest.move_mm_s[4], 4.0f64.min(fastest.place_mm_s[3]).max(0.5));
        assert!(fastest.move_mm_s[2] <= 10.0);
        // a link that cuts a skin may be slower than the slowest cut
        let slow = moves.profile(|i| if i == 2 { 0.02 } else { cap(0.0, i) }).unwrap();
        assert_eq!([slow.place_mm_s[1], slow.place_mm_s[2]], [0.05; 2]);
        // and a cut between two of them is as fast as cuts must be
        let between = CutMoves { is_cut: vec![false, false, true, false, false], ..moves.clone() };
        let between = CutMoves { slowest_mm_s: &[0.05, 0.05, 0.5, 0.05, 0.05], ..between };
        assert_eq!(
            between.profile(|i| if i == 2 { 4.0 } else { 0.02 }).unwrap().move_mm_s,
            [0.05, 0.05, 0.5, 0.05, 0.05]
        );
        for asked_s in [3.2, 5.0, 7.9] {
            let (slowness, profile) = moves.in_time(1.0, cap, asked_s).unwrap();
            let took_s = moves.cutting_s(&profile);
            assert!(took_s <= asked_s && took_s > asked_s * (1.0 - 1e-8), "{took_s} at {slowness}");
        }
        assert_eq!(moves.in_time(1.0, cap, 0.1).unwrap().0, 0.0);
        assert_eq!(moves.in_time(1.0, cap, 99.0).unwrap().0, 1.0);
    }
}
