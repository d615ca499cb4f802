//! The strip that holds the part in its block until the outline is cut: where it lies, and what it bears.
//!
//! The strip runs around the part at the height of its rim, as thick as one pass cuts. Where the rim is a wall it sits in the wall's
//! middle; where the rim is an edge it sits on the side of the edge that slopes, so that the other side's surface is free of it. What it covers of
//! the slope is finished once the strip is cut. A tab of the strip stays, at the lowest z, next to the grip.
//! Around holes there is no strip: both sides go a little beyond the middle.
//!
//! **Source:** Castelli et al. 2020, section 4.1 (holding strip, residual strip at the bottom).

use crate::machining::envelope::Envelope;
use crate::machining::raster::CellRaster;
use crate::machining::silhouette::{NearestPoints, Silhouette, area_mm2, length_mm, sampled};

/// How far inside the outline the rim is measured: at its edge, and where a slope has risen, mm.
const RIM_MM: [f64; 2] = [0.2, 0.7];
/// Difference in rise of top and bottom between the two from which a wall counts as sloping, mm.
const SLOPES_MM: f64 = 0.25;
/// Overlap of the two sides in holes, mm.
const OVERLAP_MM: f64 = 0.1;
/// Length of outline over which the strip's height is evened out, mm.
const EVEN_MM: f64 = 2.0;

/// Specific cutting force that the strip's strength is stated for, N/mm²; assumed: upper end for plastics.
pub const FORCE_N_MM2: f64 = 150.0;
/// Tensile strength that it is stated for, N/mm²; assumed: PMMA.
pub const TENSILE_N_MM2: f64 = 60.0;
/// Shear strength that it is stated for, N/mm²; assumed: half of the tensile strength.
pub const SHEAR_N_MM2: f64 = 0.5 * TENSILE_N_MM2;
/// Least share of the cutting force that the tab bears.
pub const LEAST_FACTOR: f64 = 2.0;

/// Points along the outlines, and the strip's heights there, seen from the front.
#[derive(Debug, Clone)]
pub struct Strip {
    /// Points, mm.
    pub points: Vec<[f64; 2]>,
    /// Lower and upper side, mm.
    pub heights: Vec<[f64; 2]>,
    /// Lowest and highest point of the rim there, mm.
    pub rims: Vec<[f64; 2]>,
    /// Length along outer outlines, mm.
    pub length_mm: f64,
}

/// What strip and tab bear in the plane that the cutter moves in; a force along the cutter is small beside it for a cutting side and is not counted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StripStrength {
    /// Thickness, mm.
    pub thickness_mm: f64,
    /// Length around the part, mm.
    pub length_mm: f64,
    /// Length of the tab that stays, mm.
    pub tab_mm: f64,
    /// Force that the whole strip bears in shear, N.
    pub strip_bears_n: f64,
    /// Force on the part that the tab bears in shear and, with the lever to the farthest place of the outline, in bending, N.
    pub tab_bears_n: f64,
}

impl Strip {
    /// Along the silhouette, `thickness_mm` thick.
    pub fn along(
        raster: &CellRaster,
        envelope: &Envelope,
        silhouette: &Silhouette,
        thickness_mm: f64,
    ) -> Self {
        let mut strip = Self { points: vec![], heights: vec![], rims: vec![], length_mm: 0.0 };
        let step = 0.5 * raster.pitch_mm;
        for outline in silhouette.loops() {
            let points = sampled(outline, step);
            let rims = points.iter().enumerate().map(|(n, p)| rim(raster, envelope, *p, inward(&points, n)));
            let rims: Vec<Option<Rim>> = rims.collect();
            let hole = area_mm2(outline) < 0.0;
            let seat = |rim: &Option<Rim>| {
                rim.as_ref().map(|rim| rim.seat(if hole { -2.0 * OVERLAP_MM } else { thickness_mm }))
            };
            let ends = |rim: &Option<Rim>| rim.as_ref().map(|rim| [rim.low_mm, rim.high_mm]);
            let reach = (0.5 * EVEN_MM / step) as usize;
            strip.heights.extend(even(&filled(&rims.iter().map(seat).collect::<Vec<_>>()), reach));
            strip.rims.extend(even(&filled(&rims.iter().map(ends).collect::<Vec<_>>()), reach));
            if !hole {
                strip.length_mm += length_mm(outline);
            }
            strip.points.extend(points);
        }
        strip
    }

    /// Upper side of the strip over the cells outside the part, seen from the front, or from the back when `turned`; `outside` elsewhere.
    pub fn body(
        &self,
        raster: &CellRaster,
        envelope: &Envelope,
        nearest: &NearestPoints,
        back: bool,
    ) -> Vec<f64> {
        let height = |cell: usize| {
            let [low, high] = self.heights.get(nearest.point[cell] as usize).copied().unwrap_or([0.0; 2]);
            if envelope.holds(cell) {
                crate::machining::raster::NONE
            } else if back {
                -low
            } else {
                high
            }
        };
        let map: Vec<f64> = (0..raster.len()).map(height).collect();
        if back { raster.turned(&map) } else { map }
    }

    /// The tab: the part of an outline nearest the grip. It bears [`LEAST_FACTOR`] times the force, if a tenth of the outline is long enough for that.
    pub fn tab(&self, force_n: f64, thickness_mm: f64) -> Tab {
        let at = self.points.iter().copied().max_by(|a, b| a[1].total_cmp(&b[1])).unwrap_or([0.0; 2]);
        let lever_mm = self.points.iter().map(|p| (p[0] - at[0]).hypot(p[1] - at[1])).fold(0.0, f64::max);
        let mut tab = Tab { at, length_mm: 1.0, lever_mm };
        let bears = tab.bears_n(thickness_mm);
        let [shear, bending] = bears.map(|one_mm_bears_n| LEAST_FACTOR * force_n / one_mm_bears_n);
        // at least 3 mm; assumed
        tab.length_mm = shear.max(bending.sqrt()).max(3.0).min(0.1 * self.length_mm);
        tab
    }

    /// What it bears.
    pub fn strength(&self, job: &crate::machining::MachiningJob) -> StripStrength {
        let thickness_mm = job.process.strip_mm;
        let tab = self.tab(outline_force_n(job), thickness_mm);
        let [shear_n, bending_n] = tab.bears_n(thickness_mm);
        StripStrength {
            thickness_mm,
            length_mm: self.length_mm,
            tab_mm: tab.length_mm,
            strip_bears_n: self.length_mm * thickness_mm * SHEAR_N_MM2,
            tab_bears_n: shear_n.min(bending_n),
        }
    }
}

/// The piece of the strip that is not cut.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tab {
    /// Its middle, (u, v) from the front, mm.
    pub at: [f64; 2],
    /// Its length, mm.
    pub length_mm: f64,
    /// From its middle to the farthest place of the outline, mm.
    pub lever_mm: f64,
}

impl Tab {
    /// What it bears in shear, τ L t, and in bending by a force at the lever, σ t L² / (6 r), N.
    ///
    /// **Source:** a rectangular beam's section modulus, Young & Budynas 2002, Roark's Formulas for Stress and Strain, section 8.1.
    fn bears_n(&self, thickness_mm: f64) -> [f64; 2] {
        let (t, length_mm) = (thickness_mm, self.length_mm);
        let lever_mm = self.lever_mm.max(f64::MIN_POSITIVE);
        [SHEAR_N_MM2 * length_mm * t, TENSILE_N_MM2 * t * length_mm * length_mm / (6.0 * lever_mm)]
    }
}

/// Force of a cut whose chip is as deep as `chip_mm` along the feed, N.
pub fn cutting_force_n(job: &crate::machining::MachiningJob, chip_mm: f64) -> f64 {
    let teeth_min = f64::from(job.tool.flutes) * job.process.spindle_rpm;
    FORCE_N_MM2 * job.feed_mm_min() / teeth_min * chip_mm
}

/// Force that is expected while the outline is cut: as deep as a level or the strip, all teeth of one side at once, N.
pub fn outline_force_n(job: &crate::machining::MachiningJob) -> f64 {
    let teeth = f64::from(job.tool.flutes.div_ceil(2));
    cutting_force_n(job, teeth * job.level_mm().max(job.process.strip_mm))
}

/// Heights of the part near its outline.
struct Rim {
    /// Lowest and highest point near the edge, mm.
    low_mm: f64,
    high_mm: f64,
    /// How much top and bottom change from there inwards, mm.
    top_slope_mm: f64,
    bottom_slope_mm: f64,
}

impl Rim {
    fn seat(&self, thickness_mm: f64) -> [f64; 2] {
        let middle = 0.5 * (self.low_mm + self.high_mm);
        let half = 0.5 * thickness_mm;
        let upright = (self.top_slope_mm - self.bottom_slope_mm).abs() < SLOPES_MM;
        if thickness_mm < 0.0 || upright && self.high_mm - self.low_mm > 1.5 * thickness_mm {
            [middle - half, middle + half]
        } else if self.top_slope_mm <= self.bottom_slope_mm {
            [self.high_mm - thickness_mm, self.high_mm]
        } else {
            [self.low_mm, self.low_mm + thickness_mm]
        }
    }
}

fn rim(raster: &CellRaster, envelope: &Envelope, p: [f64; 2], inward: [f64; 2]) -> Option<Rim> {
    let at = |depth: f64| {
        let cell = raster.cell([p[0] + depth * inward[0], p[1] + depth * inward[1]])?;
        envelope.holds(cell).then(|| (envelope.bottom[cell], envelope.top[cell]))
    };
    let (low_mm, high_mm) = at(RIM_MM[0])?;
    let (low2, high2) = at(RIM_MM[1]).unwrap_or((low_mm, high_mm));
    Some(Rim {
        low_mm,
        high_mm,
        top_slope_mm: (high2 - high_mm).abs(),
        bottom_slope_mm: (low2 - low_mm).abs(),
    })
}

/// Unit vector to the left of the outline's direction: into the part.
fn inward(points: &[[f64; 2]], n: usize) -> [f64; 2] {
    let count = points.len();
    let (before, after) = (points[(n + count - 3 % count) % count], points[(n + 3) % count]);
    let (du, dv) = (after[0] - before[0], after[1] - before[1]);
    let length = du.hypot(dv).max(1e-12);
    [-dv / length, du / length]
}

/// Missing heights from the nearest earlier one along the loop; [0, 0] where there is none at all.
fn filled(heights: &[Option<[f64; 2]>]) -> Vec<[f64; 2]> {
    let mut last = heights.iter().rev().find_map(|h| *h).unwrap_or([0.0; 2]);
    let fill = |height: &Option<[f64; 2]>| {
        last = height.unwrap_or(last);
        last
    };
    heights.iter().map(fill).collect()
}

/// Mean over `reach` points to each side along the loop.
fn even(heights: &[[f64; 2]], reach: usize) -> Vec<[f64; 2]> {
    let count = heights.len();
    let reach = reach.min(count.saturating_sub(1) / 2);
    let mean = |n: usize, side: usize| {
        let window = (0..=2 * reach).map(|k| heights[(n + count + k - reach) % count][side]);
        window.sum::<f64>() / (2 * reach + 1) as f64
    };
    (0..count).map(|n| [mean(n, 0), mean(n, 1)]).collect()
}
