//! The width of a cut that is near the allowed one, measured again on finer columns.
//!
//! The columns are those of a piece of the block around the cut, as all motions before have cut it. They are kept for the next cut that is looked at
//! again, which is often beside it, and go on from where they were: a program of many such cuts would else be replayed once for each.

use crate::proof::ProofJob;
use crate::proof::dexels::{Columns, Width};
use crate::proof::gcode::{ProgramMotion, SideUp};

/// Columns of the second measure across one of the first.
pub(crate) const FINER: f64 = 4.0;
/// How far they reach beyond what one motion needs, in radii of the cutter.
const BEYOND: f64 = 3.0;

/// Finer columns of a piece of the block, as the first motions of a program have cut them.
pub(crate) struct Finer {
    /// What they are of, x and z, mm.
    window: [(f64, f64); 2],
    stock: Columns,
    width: Width,
    /// Number of motions that have cut them.
    done: usize,
}

/// Width of cut of the last of some motions, on finer columns around it that all motions before have cut, mm. `kept`: those of a motion before,
/// which go on where they reach far enough: motions that are looked at twice come one after the other.
pub(crate) fn finer_width_mm(
    motions: &[ProgramMotion],
    job: &ProofJob,
    cell: f64,
    kept: &mut Option<Finer>,
) -> f64 {
    let Some(last) = motions.last() else { return 0.0 };
    let bounds = |m: &ProgramMotion| {
        let turn = if m.facing == SideUp::Front { -1.0 } else { 1.0 };
        let (a, b) = ([m.from_mm.x, turn * m.from_mm.y], [m.to_mm.x, turn * m.to_mm.y]);
        [0, 1].map(|n| (a[n].min(b[n]), a[n].max(b[n])))
    };
    let block = [(job.low_mm.x, job.high_mm.x), (job.low_mm.z, job.high_mm.z)];
    let around = |reach: f64| {
        let window = bounds(last).map(|(low, high)| (low - reach, high + reach));
        [0, 1].map(|n| (window[n].0.max(block[n].0), window[n].1.min(block[n].1)))
    };
    let reach = job.radius_mm + 3.0 * cell;
    let needed = around(reach);
    let reaches =
        |found: &Finer| (0..2).all(|n| found.window[n].0 <= needed[n].0 && found.window[n].1 >= needed[n].1);
    let new = || {
        let window = around(reach + BEYOND * job.radius_mm);
        let stock = Columns::over(job, window[0], window[1], cell / FINER);
        Finer { window, stock, width: Width::default(), done: 0 }
    };
    let finer = match kept.take().filter(reaches) {
        Some(found) => kept.insert(found),
        None => kept.insert(new()),
    };
    let window = finer.window;
    let is_near = |m: &&ProgramMotion| {
        let bounds = bounds(m);
        let r = job.radius_mm;
        !m.turns && (0..2).all(|n| bounds[n].0 <= window[n].1 + r && bounds[n].1 >= window[n].0 - r)
    };
    // what is not near takes nothing there
    let done = std::mem::replace(&mut finer.done, motions.len());
    for motion in motions[done..].iter().filter(is_near) {
        finer.stock.drive(motion, job, &mut finer.width);
    }
    finer.width.widest_mm
}
