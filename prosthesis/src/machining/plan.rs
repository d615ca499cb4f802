//! The whole: from the part in its block to moves, with what stays, what holds the part, and how long it takes.
//!
//! Side A is roughed and finished from the front, side B from the back after half a turn, side C cuts the strip along the outline and then finishes what
//! the strip had covered of the rim, from the back and, where the rim slopes the other way, from the front.

use bonemill_geometry::{Block as BlockFrame, Mesh};

use crate::machining::MachiningError;
use crate::machining::effort;
use crate::machining::envelope::{Envelope, Facet};
use crate::machining::job::MachiningJob;
use crate::machining::leftover::{self, Leftover, Reason};
use crate::machining::moves::{Facing, Side, TipMove};
use crate::machining::part::Part;
use crate::machining::passes::Passes;
use crate::machining::raster::CellRaster;
use crate::machining::sides::Sight;
use crate::machining::silhouette::Silhouette;
use crate::machining::stock::Stock;
use crate::machining::strip::StripStrength;
use crate::machining::time::{Times, faster, times};
use crate::machining::zigzag::ZigZag;

/// Cells across the tool, at least; largest side of a cell in finishing steps; and bounds of it, mm.
const CELLS_ACROSS: f64 = 24.0;
const CELL_IN_STEPS: f64 = 1.2;
const CELL_MM: [f64; 2] = [0.05, 0.12];

/// The moves and what is to be known of them.
#[derive(Debug, Clone)]
pub struct Machining {
    /// Moves in their order; the first leads from anywhere to above the block.
    pub moves: Vec<TipMove>,
    /// Stock that stays beside the part.
    pub left: Vec<Leftover>,
    /// What holds the part.
    pub strip: StripStrength,
    /// Boxes in which the tab keeps stock on the part: lowest and highest corner, block's frame, mm.
    pub tab_boxes: Vec<[nalgebra::Vector3<f64>; 2]>,
    /// How long it takes.
    pub times: Times,
    /// What the user must know.
    pub warnings: Vec<Warning>,
}

impl Machining {
    /// Volume of the stock that stays beside the part, mm³; the empty sum is 0, not −0.
    pub fn left_mm3(&self) -> f64 {
        self.left.iter().fold(0.0, |sum, left| sum + left.volume_mm3)
    }
}

/// What the user must know.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Warning {
    /// An axis would leave its travel.
    Travel {
        /// X, Y or Z of the machine.
        axis: char,
        /// What the moves span, mm.
        needed_mm: f64,
        /// What there is, mm.
        travel_mm: f64,
    },
    /// The rotary axis does not reach a side.
    Rotary {
        /// The side's angle, rad.
        angle_rad: f64,
        /// What it reaches, rad.
        range_rad: [f64; 2],
    },
    /// The feed of the process is above the machine's.
    Feed {
        /// Of the process, mm/min.
        wanted_mm_min: f64,
        /// Of the machine, mm/min.
        most_mm_min: f64,
    },
    /// It takes longer than there is time.
    Time {
        /// What it takes, min.
        takes_min: f64,
        /// What there is, min.
        most_min: f64,
        /// The feed per tooth that would meet it with all else the same, mm; `None` where the machine's feed does not allow it.
        feed_per_tooth_mm: Option<f64>,
        /// The finishing step that would about meet it with all else the same, mm; `None` where roughing alone takes longer.
        finishing_step_mm: Option<f64>,
    },
}

impl std::fmt::Display for Warning {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Travel { axis, needed_mm, travel_mm } => {
                write!(f, "{axis} needs {needed_mm:.1} mm of travel, the machine has {travel_mm:.1} mm")
            }
            Self::Rotary { angle_rad, range_rad } => {
                let [angle, low, high] = [*angle_rad, range_rad[0], range_rad[1]].map(f64::to_degrees);
                write!(f, "A turns to {angle:.0}°, the machine reaches {low:.0}° to {high:.0}°")
            }
            Self::Feed { wanted_mm_min, most_mm_min } => {
                write!(
                    f,
                    "the process asks for a feed of {wanted_mm_min:.0} mm/min, the machine drives {most_mm_min:.0} mm/min"
                )
            }
            Self::Time { takes_min, most_min, feed_per_tooth_mm, finishing_step_mm } => {
                write!(f, "machining takes {takes_min:.1} min, but there are {most_min:.1} min")?;
                if let Some(feed) = feed_per_tooth_mm {
                    write!(f, "; process.feed_per_tooth_mm = {feed:.4} would meet it")?;
                }
                if let Some(step) = finishing_step_mm {
                    write!(f, "; process.finishing_step_mm = {step:.2} would about meet it")?;
                }
                Ok(())
            }
        }
    }
}

/// Plans how a part is milled from its block.
///
/// `part` is a closed mesh, oriented outwards, in the block's frame.
///
/// # Errors
/// [`MachiningError`] where a number is out of range, the mesh names a vertex that is not there, or part and channel do not lie in the block above
/// the grip. What the cutter cannot reach is no error but [`Machining::left`].
pub fn plan(part: &Mesh<BlockFrame>, job: &MachiningJob) -> Result<Machining, MachiningError> {
    plan_sides(part, job, |sight, part, passes| sight.rough_and_finish(part, passes))
}

/// The published tool path in the same block, with the same strip and contour: for comparison.
///
/// **Source:** Castelli et al. 2020, section 4.2: planes of rows along x, there and back, finer where they meet the part, and a last pass along all
/// contours. Its side load is not bounded and its sense of cut changes from row to row.
///
/// # Errors
/// As [`plan`].
pub fn plan_zigzag(
    part: &Mesh<BlockFrame>,
    job: &MachiningJob,
    rows: &ZigZag,
) -> Result<Machining, MachiningError> {
    plan_sides(part, job, |sight, part, passes| sight.zigzag(part, passes, rows))
}

fn plan_sides(
    part: &Mesh<BlockFrame>,
    job: &MachiningJob,
    side: impl Fn(&Sight<'_>, &Part, &mut Passes<'_>),
) -> Result<Machining, MachiningError> {
    job.checked()?;
    let front = facets(part, Facing::Front)?;
    let back = facets(part, Facing::Back)?;
    let part = Part::new(&front, job)?;
    effort::check(&part, job)?;
    let (a, b) = (Sight::new(&part, job, &front, Facing::Front), Sight::new(&part, job, &back, Facing::Back));

    let mut laid = Laid { job, moves: vec![], at: None };
    let block = Stock::block(&part.raster, &job.block, &job.tool, Facing::Front);
    let stock = laid.lay(Facing::Front, Side::A, block, |passes| side(&a, &part, passes));
    let stock = laid.lay(Facing::Back, Side::B, stock.turned(), |passes| side(&b, &part, passes));
    let stock = laid.lay(Facing::Back, Side::C, stock, |passes| {
        b.contour(&part, passes);
        b.rim(&part, passes);
    });
    laid.lay(Facing::Front, Side::C, stock.turned(), |passes| a.rim(&part, passes));

    assessed(&part, [&a, &b], laid.moves, job)
}

/// What is to be known of moves that were laid before: as [`plan`] tells it, but of these moves.
///
/// # Errors
/// As [`plan`].
pub fn assess(
    part: &Mesh<BlockFrame>,
    moves: Vec<TipMove>,
    job: &MachiningJob,
) -> Result<Machining, MachiningError> {
    job.checked()?;
    let [front, back] = [facets(part, Facing::Front)?, facets(part, Facing::Back)?];
    let part = Part::new(&front, job)?;
    let sides = [(&front, Facing::Front), (&back, Facing::Back)]
        .map(|(facets, facing)| Sight::new(&part, job, facets, facing));
    assessed(&part, [&sides[0], &sides[1]], moves, job)
}

fn assessed(
    part: &Part,
    sides: [&Sight<'_>; 2],
    mut moves: Vec<TipMove>,
    job: &MachiningJob,
) -> Result<Machining, MachiningError> {
    let hidden = &part.envelope.hidden_mm;
    let mut left = leftover::places(&part.raster, hidden, &part.envelope.top, Facing::Front, Reason::Hidden);
    left.extend(part.corners(job));
    left.extend(sides.into_iter().flat_map(|side| [side.too_narrow(part), side.too_deep(part)]).flatten());
    let times = times(&mut moves, job)?;
    let warnings = warnings(&moves, &times, job);
    Ok(Machining {
        moves,
        left,
        strip: part.strip.strength(job),
        tab_boxes: part.tab_boxes(job),
        times,
        warnings,
    })
}

/// Moves so far, and where the tip is in the machine's axes.
struct Laid<'a> {
    job: &'a MachiningJob,
    moves: Vec<TipMove>,
    at: Option<[f64; 3]>,
}

impl Laid<'_> {
    fn lay(&mut self, facing: Facing, side: Side, stock: Stock, work: impl FnOnce(&mut Passes<'_>)) -> Stock {
        let mut passes = Passes::new(self.job, facing, side, stock, self.at);
        work(&mut passes);
        let (moves, at, stock) = passes.finished();
        self.at = at;
        self.moves.extend(moves);
        stock
    }
}

/// The mesh's facets as a side sees them.
fn facets(part: &Mesh<BlockFrame>, facing: Facing) -> Result<Vec<Facet>, MachiningError> {
    let corner = |n: u32| {
        let p = part.vertices.get(n as usize).filter(|p| p.is_finite())?;
        Some(facing.from_block(&p.coords))
    };
    let facet = |(facet, t): (usize, &[u32; 3])| {
        let [a, b, c] = t.map(corner);
        let all = a.zip(b).zip(c).map(|((a, b), c)| [a, b, c]);
        all.ok_or(MachiningError::Mesh { facet, expected: "three vertices with finite coordinates" })
    };
    if part.triangles.is_empty() {
        return Err(MachiningError::Mesh { facet: 0, expected: "at least one facet" });
    }
    part.triangles.iter().enumerate().map(facet).collect()
}

impl Part {
    fn new(front: &[Facet], job: &MachiningJob) -> Result<Self, MachiningError> {
        let silhouette = Silhouette::of(front);
        let reach = 2.0 * job.tool.diameter_mm() + 1.0;
        let all = || front.iter().flatten();
        let low = all().map(|p| p.x).fold(f64::INFINITY, f64::min);
        let high = all().map(|p| p.x).fold(f64::NEG_INFINITY, f64::max);
        let v_mm = all().map(|p| p.y.abs()).fold(0.0, f64::max);
        lies_within(front, job)?;
        let by_step = (CELL_IN_STEPS * job.process.finishing_step_mm).clamp(CELL_MM[0], CELL_MM[1]);
        let pitch = (job.tool.diameter_mm() / CELLS_ACROSS).min(by_step);
        let over = |[low, high, v_mm]: [f64; 3]| {
            let raster = CellRaster::over(low - reach, high + reach, v_mm + reach, pitch)?;
            let envelope = Envelope::of(&raster, front);
            Ok(Self::with(raster, envelope, silhouette.clone(), job))
        };
        let part = over([low, high, v_mm])?;
        if !part.loose.contains(&true) {
            return Ok(part);
        }
        // what is milled beside the part lies on the raster too
        let block = &job.block;
        over([low.min(block.low_mm.x), high.max(block.high_mm.x), v_mm.max(block.high_mm.z)])
    }
}

/// The part in the block; the channel around it above the grip.
fn lies_within(front: &[Facet], job: &MachiningJob) -> Result<(), MachiningError> {
    let block = &job.block;
    for p in front.iter().flatten() {
        let p = Facing::Front.to_block(p);
        for (n, axis) in ['x', 'y', 'z'].into_iter().enumerate() {
            let over = if p[n] < block.low_mm[n] {
                Some(block.low_mm[n])
            } else if p[n] > block.high_mm[n] {
                Some(block.high_mm[n])
            } else {
                None
            };
            if let Some(limit_mm) = over {
                return Err(MachiningError::Outside {
                    what: "the part",
                    axis,
                    at_mm: p[n],
                    of: "the block",
                    limit_mm,
                });
            }
        }
    }
    let lowest = front.iter().flatten().map(|p| Facing::Front.to_block(p).z).fold(f64::INFINITY, f64::min);
    let (at_mm, limit_mm) = (lowest - job.tool.diameter_mm() - 0.6, block.low_mm.z + block.grip_mm);
    if at_mm < limit_mm {
        return Err(MachiningError::Outside {
            what: "the channel below the part",
            axis: 'z',
            at_mm,
            of: "the zone above the grip",
            limit_mm,
        });
    }
    Ok(())
}

fn warnings(moves: &[TipMove], times: &Times, job: &MachiningJob) -> Vec<Warning> {
    let mut warnings = Vec::new();
    for (n, axis) in ['X', 'Y', 'Z'].into_iter().enumerate() {
        let at = |m: &TipMove| Facing::of(m.a_rad).from_block(&m.tip_mm)[n];
        let span = |pick: fn(f64, f64) -> f64, start: f64| moves.iter().map(at).fold(start, pick);
        let needed_mm = span(f64::max, f64::NEG_INFINITY) - span(f64::min, f64::INFINITY);
        let travel_mm = job.machine.travel_mm[n];
        if needed_mm > travel_mm {
            warnings.push(Warning::Travel { axis, needed_mm, travel_mm });
        }
    }
    let range_rad = job.machine.rotary_range_rad;
    let reached = |m: &&TipMove| (range_rad[0]..=range_rad[1]).contains(&m.a_rad);
    if let Some(beyond) = moves.iter().find(|m| !reached(m)) {
        warnings.push(Warning::Rotary { angle_rad: beyond.a_rad, range_rad });
    }
    let wanted_mm_min = job.teeth_feed_mm_min();
    if wanted_mm_min > job.machine.max_feed_mm_min {
        warnings.push(Warning::Feed { wanted_mm_min, most_mm_min: job.machine.max_feed_mm_min });
    }
    warnings.extend(too_long(moves, times, job));
    warnings
}

/// What would meet the time that there is: the feed scales what is cut, the finishing step what is finished.
fn too_long(moves: &[TipMove], times: &Times, job: &MachiningJob) -> Option<Warning> {
    let most_s = job.machine.max_time_min? * 60.0;
    if times.limited_s <= most_s {
        return None;
    }
    // up to the decimals that are told
    let told = |by: f64| (1e4 * job.process.feed_per_tooth_mm * by).ceil() / 1e4;
    let most = job.machine.max_feed_mm_min / job.feed_mm_min();
    let feed_per_tooth_mm = faster(moves, &job.machine, most, most_s).map(told);
    let mut before_s = 0.0;
    let mut finishing_s = 0.0;
    for step in moves {
        if step.kind == crate::machining::Kind::Finish {
            finishing_s += step.time_s - before_s;
        }
        before_s = step.time_s;
    }
    let share = (most_s - (times.limited_s - finishing_s)) / finishing_s;
    Some(Warning::Time {
        takes_min: times.limited_s / 60.0,
        most_min: most_s / 60.0,
        feed_per_tooth_mm,
        finishing_step_mm: (share > 0.05).then(|| job.process.finishing_step_mm / share),
    })
}
