//! The fastest speed profile under caps and an acceleration limit.
//!
//! Places j = 0..n along a path, Δs_i the move from place i − 1 to place i, u_j the speed at place j, u² linear along a move
//! (constant acceleration). With x_j = u_j²:
//!
//! ```text
//! maximise every x_j     subject to   v_min² ≤ x_j ≤ X_j      |x_j − x_{j−1}| ≤ 2 a Δs_j
//! X_j = min(cap of the move that ends at j, cap of the move that starts there)²
//! ```
//!
//! "Every" is meant: bounds and differences are kept by the larger of two feasible profiles, place by place (both sides of a
//! difference are kept by a maximum), so the feasible profiles have a greatest one. It has the least time
//! Σ 2Δs/(u_{j−1} + u_j), since the time falls with every u. It is the shortest-path bound x_j = min_k (X_k + 2a·distance(j, k)),
//! and on a line one pass forward and one back give it. v_min ≤ every cap makes the constant v_min feasible, so the
//! greatest profile is never below it.
//!
//! **Source:** the forward-backward pass is that of time-optimal control under state-dependent limits (Bobrow et al. 1985),
//! here in closed form; the lattice argument is derived here and tested against every profile one by one.

use crate::burr::ModelError;
use crate::burr::checked;

/// A profile: speeds at places, and what they mean for moves.
#[derive(Debug, Clone, PartialEq)]
pub struct LimitedProfile {
    /// u_j at the place where each move ends, mm/s. The first place has no move before it.
    pub place_mm_s: Vec<f64>,
    /// Largest speed during each move, mm/s: never above its cap.
    pub move_mm_s: Vec<f64>,
    /// Σ 2Δs/(u_{j−1} + u_j), s.
    pub time_s: f64,
}

/// The fastest profile. `cap_mm_s[i]` and `length_mm[i]` belong to the move that ends at place i; move 0 is where the burr
/// stands at the start, of any length. No speed is asked to be below `min_mm_s`: lower caps count as `min_mm_s`.
///
/// # Errors
/// [`ModelError`] when the lists differ in length, a cap is not positive, a length is negative, or the acceleration is not
/// positive (infinite is allowed: then the caps alone decide).
pub fn fastest_profile(
    cap_mm_s: &[f64],
    length_mm: &[f64],
    min_mm_s: f64,
    acceleration_mm_s2: f64,
) -> Result<LimitedProfile, ModelError> {
    super::same_length("move lengths", cap_mm_s.len(), length_mm.len())?;
    checked("least speed, mm/s", min_mm_s, |v| v > 0.0, "positive")?;
    if acceleration_mm_s2 != f64::INFINITY {
        checked("acceleration, mm/s²", acceleration_mm_s2, |a| a > 0.0, "positive")?;
    }
    for (&cap, &ds) in cap_mm_s.iter().zip(length_mm) {
        checked("speed cap, mm/s", cap, |v| v >= 0.0, "0 or more")?;
        checked("length of a move, mm", ds, |ds| ds >= 0.0, "0 or more")?;
    }
    let cap = |i: usize| cap_mm_s[i].max(min_mm_s);
    let n = cap_mm_s.len();
    let mut x: Vec<f64> =
        (0..n).map(|i| if i + 1 < n { cap(i).min(cap(i + 1)) } else { cap(i) }).map(|v| v * v).collect();
    let gain = |ds: f64| if ds > 0.0 { 2.0 * acceleration_mm_s2 * ds } else { 0.0 };
    for i in 1..n {
        x[i] = x[i].min(x[i - 1] + gain(length_mm[i]));
    }
    for i in (1..n).rev() {
        x[i - 1] = x[i - 1].min(x[i] + gain(length_mm[i]));
    }
    let place_mm_s: Vec<f64> = x.into_iter().map(f64::sqrt).collect();
    let before = |i: usize| place_mm_s[i.saturating_sub(1)];
    let move_mm_s = (0..n).map(|i| before(i).max(place_mm_s[i])).collect();
    let time_s = (1..n).map(|i| 2.0 * length_mm[i] / (before(i) + place_mm_s[i])).sum();
    Ok(LimitedProfile { place_mm_s, move_mm_s, time_s })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Every profile of whole x in 1..=`most`² whose squares keep bounds and differences.
    fn feasible(caps: &[i64], gains: &[i64]) -> Vec<Vec<i64>> {
        let (n, most) = (caps.len(), 9i64);
        let bound = |i: usize| caps[i].min(*caps.get(i + 1).unwrap_or(&most));
        (0..most.pow(n as u32))
            .map(|code| (0..n).map(|i| code / most.pow(i as u32) % most + 1).collect::<Vec<i64>>())
            .filter(|x| (0..n).all(|i| x[i] <= bound(i) && (i == 0 || (x[i] - x[i - 1]).abs() <= gains[i])))
            .collect()
    }

    proptest! {
        #![proptest_config(bonemill_geometry::fixed!(48))]

        /// With whole bounds and gains the optimum is whole: every profile is tried.
        #[test]
        fn is_the_greatest_and_the_fastest_of_all_profiles(
            caps in prop::collection::vec(1i64..=9, 1..6), gains in prop::collection::vec(0i64..5, 6),
        ) {
            let n = caps.len();
            // x = v², gain = 2aΔs with a = 1/2
            let speed: Vec<f64> = caps.iter().map(|x| (*x as f64).sqrt()).collect();
            let length: Vec<f64> = gains[..n].iter().map(|g| *g as f64).collect();
            let found = fastest_profile(&speed, &length, 1.0, 0.5).unwrap();
            let time = |x: &[i64]| {
                (1..n).map(|i| 2.0 * length[i] / ((x[i] as f64).sqrt() + (x[i - 1] as f64).sqrt())).sum::<f64>()
            };
            let all = feasible(&caps, &gains);
            prop_assert!(!all.is_empty());
            for i in 0..n {
                let greatest = all.iter().map(|x| x[i]).max().unwrap();
                prop_assert!((found.place_mm_s[i].powi(2) - greatest as f64).abs() < 1e-9);
                prop_assert!(found.move_mm_s[i] <= speed[i] + 1e-12);
            }
            let fastest = all.iter().map(|x| time(x)).fold(f64::INFINITY, f64::min);
            prop_assert!((found.time_s - fastest).abs() < 1e-9, "{} {fastest}", found.time_s);
        }

        /// Between places, at any of them: u² is linear, so ends are enough; and more room is never slower.
        #[test]
        fn higher_caps_are_never_slower(
            caps in prop::collection::vec(0.1f64..6.0, 2..40), more in prop::collection::vec(0.0f64..2.0, 40), a in 0.1f64..50.0,
        ) {
            let length = vec![0.25; caps.len()];
            let wider: Vec<f64> = caps.iter().zip(&more).map(|(c, m)| c + m).collect();
            let (tight, wide) = (
                fastest_profile(&caps, &length, 0.5, a).unwrap(),
                fastest_profile(&wider, &length, 0.5, a).unwrap(),
            );
            prop_assert!(wide.time_s <= tight.time_s + 1e-12);
            prop_assert!(tight.place_mm_s.iter().all(|v| *v >= 0.5 - 1e-12));
            for (pair, ds) in tight.place_mm_s.windows(2).zip(&length) {
                prop_assert!((pair[1].powi(2) - pair[0].powi(2)).abs() <= 2.0 * a * ds * (1.0 + 1e-12) + 1e-12);
            }
        }
    }

    #[test]
    fn short_paths_and_no_acceleration_limit() {
        assert_eq!(fastest_profile(&[], &[], 0.5, 1.0).unwrap().time_s, 0.0);
        assert_eq!(fastest_profile(&[2.0], &[0.0], 0.5, 1.0).unwrap().place_mm_s, [2.0]);
        let free = fastest_profile(&[4.0, 4.0, 1.0, 4.0], &[1.0; 4], 0.5, f64::INFINITY).unwrap();
        assert_eq!(free.place_mm_s, [4.0, 1.0, 1.0, 4.0]);
        assert_eq!(free.move_mm_s, [4.0, 4.0, 1.0, 4.0]);
        // a move without length cannot change the speed
        let standing = fastest_profile(&[4.0, 4.0, 4.0, 1.0], &[1.0, 1.0, 0.0, 1.0], 0.5, 1.0).unwrap();
        assert_eq!(standing.place_mm_s[1], standing.place_mm_s[2]);
    }

    #[test]
    fn a_million_moves_and_bad_input() {
        let caps: Vec<f64> = (0..1_000_000).map(|i| 0.6 + (i % 97) as f64 * 0.03).collect();
        let profile = fastest_profile(&caps, &vec![0.25; caps.len()], 0.5, 2.0).unwrap();
        assert!(profile.move_mm_s.iter().zip(&caps).all(|(v, cap)| v <= cap));
        assert!(fastest_profile(&[1.0], &[], 0.5, 1.0).is_err());
        assert!(fastest_profile(&[f64::NAN], &[1.0], 0.5, 1.0).is_err());
        assert!(fastest_profile(&[1.0], &[-1.0], 0.5, 1.0).is_err());
        assert!(fastest_profile(&[1.0], &[1.0], 0.5, 0.0).is_err());
        assert!(fastest_profile(&[1.0], &[1.0], 0.0, 1.0).is_err());
    }
}
