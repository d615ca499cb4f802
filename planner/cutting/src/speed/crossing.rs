//! The last parameter at which a time that never falls with the parameter keeps within a limit.
//!
//! The time may have kinks, flat parts and jumps; one evaluation may be a whole time law. So two are made side by side: a little to either
//! side of the place where the line through the bracket's ends meets the limit,
//!
//! ```text
//! x = (f_b a − f_a b)/(f_b − f_a) ∓ δ        δ = k (b − a)²/(b₀ − a₀)
//! ```
//!
//! Where the time is smooth, the line is off by less than δ, and the next bracket is 2 δ long: brackets shrink quadratically, as with the
//! shift of ITP (Oliveira and Takahashi 2021, ACM Transactions on Mathematical Software 47(1)), but from both ends at once. Where two
//! evaluations leave more than a third of the bracket, the next two divide it in three: at a jump, four evaluations leave a third or less.

/// k: the line through the ends of a bent function is off by an eighth of its bend.
const BESIDE_LINE: f64 = 0.05;
/// A little more than a third: rounding decides nothing.
const SLOW_SHARE: f64 = 0.34;

/// The parameter, within the bracket, at which the time is at most `total_s` and at least `total_s − tolerance_s`; where a jump
/// or the number of evaluations leaves none, the largest that was found with a time of at most `total_s`.
///
/// `bracket`: two parameters, ascending, each with its time, s; the first time is at most `total_s`, the second above it.
/// `evaluations`: how often `time_s` is called at most.
///
/// # Errors
/// Those of `time_s`.
pub fn last_within<E: Send>(
    bracket: [(f64, f64); 2],
    total_s: f64,
    tolerance_s: f64,
    evaluations: u32,
    time_s: impl Fn(f64) -> Result<f64, E> + Sync,
) -> Result<f64, E> {
    let [(mut a, mut at_a), (mut b, mut at_b)] = bracket;
    let (whole, aim) = (b - a, total_s - 0.5 * tolerance_s);
    let mut is_slow = false;
    for _ in 0..evaluations / 2 {
        let long = b - a;
        let [x, y] = if is_slow {
            [a + long / 3.0, b - long / 3.0]
        } else {
            let line = a + long * (aim - at_a) / (at_b - at_a);
            let beside = BESIDE_LINE * long * long / whole;
            [(line - beside).max(a), (line + beside).min(b)]
        };
        if at_a >= total_s - tolerance_s || x >= b || y <= a || x <= a && y >= b {
            break;
        }
        let (at_x, at_y) = rayon::join(|| time_s(x), || time_s(y));
        for (x, at_x) in [(x, at_x?), (y, at_y?)] {
            if at_x > total_s {
                (b, at_b) = (x, at_x);
                break;
            }
            (a, at_a) = (x, at_x);
        }
        is_slow = b - a > SLOW_SHARE * long;
    }
    Ok(a)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::convert::Infallible;
    use std::sync::atomic::{AtomicU32, Ordering};

    /// The parameter found, and how often the time was evaluated.
    fn found(time_s: impl Fn(f64) -> f64 + Sync, total_s: f64, tolerance_s: f64, most: u32) -> (f64, u32) {
        let calls = AtomicU32::new(0);
        let ends = [0.0, 3.0].map(|x| (x, time_s(x)));
        let x = last_within(ends, total_s, tolerance_s, most, |x| {
            calls.fetch_add(1, Ordering::Relaxed);
            Ok::<_, Infallible>(time_s(x))
        });
        (x.unwrap_or(f64::NAN), calls.into_inner())
    }

    #[test]
    fn smooth_times_take_few_evaluations_and_none_takes_more_than_it_may() {
        let straight = |x: f64| 300.0 + 200.0 * x;
        let bent = |x: f64| 300.0 + 200.0 * x + 30.0 * x * x;
        let kinked = |x: f64| 300.0 + (10.0 * x).max(300.0 * x - 500.0);
        let steep = |x: f64| 300.0 + 1.0 / (3.001 - x);
        for (time, most_calls) in
            [(&straight as &(dyn Fn(f64) -> f64 + Sync), 6), (&bent, 12), (&kinked, 14), (&steep, 40)]
        {
            for share in [0.01, 0.2, 0.5, 0.77, 0.999] {
                let total_s = time(0.0) + share * (time(3.0) - time(0.0));
                let (x, calls) = found(time, total_s, 1e-3, 60);
                assert!((total_s - 1e-3..=total_s).contains(&time(x)), "{x} {share}");
                assert!(calls <= most_calls, "{calls} for {share}, expected {most_calls}");
            }
        }
    }

    #[test]
    fn a_jump_is_met_from_below_and_a_flat_part_at_its_end() {
        let jump = |x: f64| if x < 1.0 { x } else { x + 10.0 };
        let (x, calls) = found(jump, 5.0, 1e-6, 50);
        assert!(x < 1.0 && x > 1.0 - 1e-9 && calls <= 50, "{x} {calls}");
        let flat = |x: f64| if x < 2.0 { 1.0 } else { 1.0 + (x - 2.0) };
        let (x, calls) = found(flat, 1.0, 0.0, 60);
        assert!(x <= 2.0 + 1e-15 && calls <= 60, "{x} {calls}");
    }

    #[test]
    fn an_error_of_the_time_is_handed_on() {
        assert_eq!(last_within([(0.0, 0.0), (1.0, 1.0)], 0.5, 1e-3, 9, |_| Err("broken")), Err("broken"));
    }
}
