//! The last parameter at which a time that never falls with the parameter keeps within a limit.
//!
//! The time may have kinks, flat parts and jumps; one evaluation may be a whole time law. ITP brackets as bisection does, and
//! needs no more evaluations than it and one in the worst case, but tries the line through the bracket's ends first, moved a
//! little toward the middle and kept so near to it that the bound holds:
//!
//! ```text
//! x_f = (f_b a − f_a b)/(f_b − f_a)      moved by δ = k₁ (b − a)² toward the middle m
//! x   = the place nearest to it with |x − m| ≤ ε 2^(n − j) − (b − a)/2
//! ```
//!
//! **Source:** Oliveira and Takahashi 2021, ACM Transactions on Mathematical Software 47(1), with κ₂ = 2 and n₀ = 1.

/// κ₁ times the first bracket's length. The paper's 0.2 suits curved functions; these are nearly straight.
const TOWARD_MIDDLE: f64 = 0.02;

/// The parameter, within the bracket, at which the time is at most `total_s` and at least `total_s − tolerance_s`; where a jump
/// or the number of evaluations leaves none, the largest that was found with a time of at most `total_s`.
///
/// `bracket`: two parameters, ascending, each with its time, s; the first time is at most `total_s`, the second above it.
/// `evaluations`: how often `time_s` is called at most, two or more.
///
/// # Errors
/// Those of `time_s`.
pub fn last_within<E>(
    bracket: [(f64, f64); 2],
    total_s: f64,
    tolerance_s: f64,
    evaluations: u32,
    mut time_s: impl FnMut(f64) -> Result<f64, E>,
) -> Result<f64, E> {
    let [(mut a, mut at_a), (mut b, mut at_b)] = bracket;
    let whole = b - a;
    // half the length of the last bracket, where bisection needs one evaluation less
    let least_half = whole * 0.5f64.powi(evaluations.max(2) as i32);
    for j in 0..evaluations {
        if at_a >= total_s - tolerance_s {
            break;
        }
        let (middle, aim) = (0.5 * (a + b), total_s - 0.5 * tolerance_s);
        let line = a + (b - a) * (aim - at_a) / (at_b - at_a);
        let (to_middle, shift) = (middle - line, TOWARD_MIDDLE * (b - a).powi(2) / whole);
        let tried = line + to_middle.signum() * shift.min(to_middle.abs());
        let room = (least_half * 2f64.powi((evaluations - j) as i32) - 0.5 * (b - a)).max(0.0);
        let x = middle + (tried - middle).clamp(-room, room);
        if x <= a || x >= b {
            break;
        }
        let at_x = time_s(x)?;
        if at_x > total_s { (b, at_b) = (x, at_x) } else { (a, at_a) = (x, at_x) }
    }
    Ok(a)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::convert::Infallible;

    /// The parameter found, and how often the time was evaluated.
    fn found(time_s: impl Fn(f64) -> f64, total_s: f64, tolerance_s: f64, most: u32) -> (f64, u32) {
        let mut calls = 0;
        let ends = [0.0, 3.0].map(|x| (x, time_s(x)));
        let x = last_within(ends, total_s, tolerance_s, most, |x| {
            calls += 1;
            Ok::<_, Infallible>(time_s(x))
        });
        (x.unwrap_or(f64::NAN), calls)
    }

    #[test]
    fn smooth_times_take_few_evaluations_and_none_takes_more_than_it_may() {
        let straight = |x: f64| 300.0 + 200.0 * x;
        let bent = |x: f64| 300.0 + 200.0 * x + 30.0 * x * x;
        let kinked = |x: f64| 300.0 + (10.0 * x).max(300.0 * x - 500.0);
        let steep = |x: f64| 300.0 + 1.0 / (3.001 - x);
        for (time, most_calls) in
            [(&straight as &dyn Fn(f64) -> f64, 4), (&bent, 11), (&kinked, 19), (&steep, 30)]
        {
            for share in [0.01, 0.2, 0.5, 0.77, 0.999] {
                let total_s = time(0.0) + share * (time(3.0) - time(0.0));
                let (x, calls) = found(time, total_s, 1e-3, 38);
                assert!((total_s - 1e-3..=total_s).contains(&time(x)), "{x} {share}");
                assert!(calls <= most_calls, "{calls} for {share}, expected {most_calls}");
            }
        }
    }

    #[test]
    fn a_jump_is_met_from_below_and_a_flat_part_at_its_end() {
        let jump = |x: f64| if x < 1.0 { x } else { x + 10.0 };
        let (x, calls) = found(jump, 5.0, 1e-6, 38);
        assert!(x < 1.0 && x > 1.0 - 1e-9 && calls <= 38, "{x} {calls}");
        let flat = |x: f64| if x < 2.0 { 1.0 } else { 1.0 + (x - 2.0) };
        let (x, calls) = found(flat, 1.0, 0.0, 60);
        assert!(x <= 2.0 + 1e-15 && calls <= 60, "{x} {calls}");
    }

    #[test]
    fn an_error_of_the_time_is_handed_on() {
        assert_eq!(last_within([(0.0, 0.0), (1.0, 1.0)], 0.5, 1e-3, 9, |_| Err("broken")), Err("broken"));
    }
}
