//! `plunge.csv`: what the tool of a channel feels at each waypoint, over depth.

use super::PlanFileError;
use super::cells::push_number;
use super::columns::{PLUNGE_ROWS, names};

/// The file's name in a plan's directory.
pub const PLUNGE: &str = "plunge.csv";

/// The columns, in order.
const COLUMNS: [&str; 6] = names(&PLUNGE_ROWS);

/// One row of `plunge.csv`; the index is the waypoint's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlungeRow {
    /// Depth of the tool's origin from the entry, mm.
    pub depth_mm: f64,
    /// Force along the axis, toward the handpiece, N.
    pub thrust_n: f64,
    /// Torque that resists the turn, N mm.
    pub torque_nmm: f64,
    /// Force across the axis, N.
    pub lateral_n: f64,
    /// Area of the tool's front in bone, mm².
    pub contact_mm2: f64,
}

/// The file's text.
///
/// # Errors
/// [`PlanFileError::NotFinite`] with the waypoint.
pub fn plunge_text(rows: &[PlungeRow]) -> Result<String, PlanFileError> {
    let mut text = COLUMNS.join(",").into_bytes();
    text.push(b'\n');
    for (index, row) in rows.iter().enumerate() {
        text.extend_from_slice(index.to_string().as_bytes());
        let values = [row.depth_mm, row.thrust_n, row.torque_nmm, row.lateral_n, row.contact_mm2];
        for (value, column) in values.into_iter().zip(&COLUMNS[1..]) {
            text.push(b',');
            push_number(&mut text, Some(value), || format!("`{column}` of waypoint {index}"))?;
        }
        text.push(b'\n');
    }
    Ok(String::from_utf8_lossy(&text).into_owned())
}
