//! The burr's rotation: a case that leaves it open is planned both ways, and the gentler plan stands.

use bonemill_case::{Burr, Case};
use bonemill_setup::Stopwatch;
use bonemill_setup::registration::Registered;

use super::PlanError;
use super::attempt::Attempt;
use super::start::Start;

/// The case with its burr turning the other way, where it may and there is something to spare.
pub(super) fn reversed(case: &Case) -> Option<Case> {
    let may = case.burr.turns_both_ways && !case.structures.is_empty();
    may.then(|| Case { burr: Burr { spin: -case.burr.spin, ..case.burr }, ..case.clone() })
}

/// The attempt at a case, or at the reversed one where that pushes less toward the structures and gives up nothing.
///
/// # Errors
/// [`PlanError`] of the case itself; a reversed case that cannot be planned is passed over.
pub(super) fn better<'a>(
    start: &Start<'a>,
    reversed: Option<&'a Case>,
    registered: &Registered,
    watch: &mut Stopwatch,
) -> Result<Attempt<'a>, PlanError> {
    let mut planned =
        |start: Start<'a>| start.plan(watch).map_err(|error| registered.blame(start.case, error));
    let attempt = planned(*start)?;
    let other = reversed.map(|case| planned(Start { case, ..*start }));
    Ok(match other {
        Some(Ok(other)) if is_better(&other, &attempt) => other,
        _ => attempt,
    })
}

fn is_better(other: &Attempt, attempt: &Attempt) -> bool {
    let is_gentler = other.score() < attempt.score();
    let is_worse = other.is_worse_than_controls() && !attempt.is_worse_than_controls();
    is_gentler && !is_worse && other.keeps_what(attempt)
}
