//! `toolpath.csv`: every move of the cutter's tip.

use std::fmt::Write;

use crate::machining::{Kind, Side, TipMove};
use bonemill_planfile::columns::{names, prosthesis::TOOLPATH};
use nalgebra::Vector3;

/// The first line.
fn header() -> String {
    names(&TOOLPATH).join(",")
}

/// The table: where each move ends, block's frame, and when, at constant speeds.
pub(crate) fn text(moves: &[TipMove]) -> String {
    let mut out = String::with_capacity(64 * moves.len());
    out.push_str(&header());
    out.push('\n');
    for (index, m) in moves.iter().enumerate() {
        let (side, kind, p) = (m.side.name(), m.kind.name(), m.tip_mm);
        // + 0.0 makes −0 a plain 0; writing to a String cannot fail
        let _ = writeln!(
            out,
            "{index},{side},{kind},{:.3},{:.3},{:.3},{:?},{:?},{:.3}",
            p.x + 0.0,
            p.y + 0.0,
            p.z + 0.0,
            m.a_rad + 0.0,
            m.feed_mm_min,
            m.time_s
        );
    }
    out
}

/// The table read back; `Err` tells what is wrong with the first that is no move.
pub(crate) fn read(table: &str) -> Result<Vec<TipMove>, String> {
    let header = header();
    if table.lines().next() != Some(header.as_str()) {
        return Err(format!("line 1: expected the header {header:?}"));
    }
    let rows = table.lines().skip(1).enumerate();
    rows.map(|(index, row)| {
        let wrong =
            || format!("line {}: expected index {index}, a side, a kind of move and six numbers", index + 2);
        read_row(row, index).ok_or_else(wrong)
    })
    .collect()
}

/// `None` for a row that is not the move of this index.
fn read_row(row: &str, index: usize) -> Option<TipMove> {
    let cells: Vec<&str> = row.split(',').collect();
    let [number, side, kind, numbers @ ..] = cells.as_slice() else { return None };
    let numbers: Vec<f64> = numbers.iter().map(|cell| cell.parse().ok()).collect::<Option<_>>()?;
    let [x, y, z, a_rad, feed_mm_min, time_s] = numbers.try_into().ok()?;
    let read = TipMove {
        side: Side::ALL.into_iter().find(|s| s.name() == *side)?,
        kind: Kind::ALL.into_iter().find(|k| k.name() == *kind)?,
        tip_mm: Vector3::new(x, y, z),
        a_rad,
        feed_mm_min,
        time_s,
    };
    let is_finite = [x, y, z, a_rad, feed_mm_min, time_s].iter().all(|v| v.is_finite());
    (*number == index.to_string() && is_finite).then_some(read)
}
