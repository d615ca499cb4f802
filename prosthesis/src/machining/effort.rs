//! How much there is to plan, before it is planned: a cutter that is tiny for its block would take hours.
//!
//! Roughing takes away a volume V in cuts of the widest width times the depth of a level, finishing goes over the part's area A in rows:
//! length ≈ V / (widest · level) + A / row. The stock is looked at every cell along that, over all cells under the cutter. What links and
//! entries add is left out.

use std::f64::consts::PI;

use crate::machining::MachiningError;
use crate::machining::job::MachiningJob;
use crate::machining::part::Part;
use crate::machining::sides::STEP_SHARE;
use crate::machining::surface::apart_mm;

/// Cells of stock that may be looked at: some minutes on two cores.
const MOST_CELLS: f64 = 3e9;

/// Refuses what would take too long to plan.
///
/// # Errors
/// [`MachiningError::TooMuch`].
pub(crate) fn check(part: &Part, job: &MachiningJob) -> Result<(), MachiningError> {
    let (raster, tool, envelope) = (&part.raster, &job.tool, &part.envelope);
    let cell_mm2 = raster.pitch_mm * raster.pitch_mm;
    let block_mm = job.block.high_mm.y - job.block.low_mm.y;
    let thickness =
        |cell: usize| if envelope.holds(cell) { envelope.top[cell] - envelope.bottom[cell] } else { 0.0 };
    let milled = || (0..raster.len()).filter(|cell| part.milled_mm[*cell] <= tool.diameter_mm());
    let volume_mm3: f64 = milled().map(|cell| (block_mm - thickness(cell)).max(0.0) * cell_mm2).sum();
    let area_mm2 = 2.0 * cell_mm2 * milled().filter(|cell| envelope.holds(*cell)).count() as f64;
    let row_mm =
        apart_mm(tool, job.process.finishing_step_mm, 0.0, 0.0).clamp(raster.pitch_mm, tool.diameter_mm());
    let length_mm = volume_mm3 / (STEP_SHARE * job.widest_mm() * job.level_mm()) + area_mm2 / row_mm;
    let under_tool = PI * (tool.radius_mm / raster.pitch_mm).powi(2).max(1.0);
    let most_mm = MOST_CELLS * raster.pitch_mm / under_tool;
    if length_mm <= most_mm {
        return Ok(());
    }
    Err(MachiningError::TooMuch {
        length_mm,
        most_mm,
        diameter_mm: tool.diameter_mm(),
        finishing_step_mm: job.process.finishing_step_mm,
    })
}
