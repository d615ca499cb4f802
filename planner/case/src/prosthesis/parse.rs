//! From text to a [`ProsthesisJob`]: every key by itself, defaults included, then relations between keys.

use std::path::{Path, PathBuf};

use toml::de::DeTable;

use super::keys as k;
use super::{
    BlockSource, BlockSpec, CutSense, CutterKind, CutterSpec, GCode, MachineKind, MachineSpec, OnFlange,
    OrientMode, PartSpec, ProcessSpec, ProsthesisJob, StockSpec,
};
use crate::error::{CaseError, CaseFault};
use crate::keys::Unit;
use crate::syntax;
use crate::walker::{Log, Walk};

/// Number and sides of the blocks that are used where the job names none, mm. Assumed.
const DEFAULT_BLOCKS: [(&str, [f64; 3]); 3] =
    [("S", [50.0, 25.0, 60.0]), ("M", [65.0, 30.0, 75.0]), ("L", [90.0, 45.0, 100.0])];
/// Length and radius of the default holder, mm. Assumed.
const DEFAULT_HOLDER_MM: [f64; 2] = [20.0, 8.0];
/// The machine of C section 5. Assumed.
const DEFAULT_TRAVEL_MM: [f64; 3] = [115.5, 128.3, 90.1];
/// Assumed: an axis that turns freely.
const DEFAULT_ROTARY_DEG: [f64; 2] = [-360.0, 360.0];

impl ProsthesisJob {
    /// The job in `text`; `source` names the file in messages. No file is touched.
    ///
    /// # Errors
    /// [`CaseError`] with every fault, each with its line.
    pub fn parse(text: &str, source: &Path) -> Result<Self, CaseError> {
        let fail = |faults| CaseError { file: source.to_path_buf(), faults };
        let table = DeTable::parse(text).map_err(|e| fail(vec![syntax(text, &e)]))?;
        Self::from_table(text, table.get_ref(), "").map_err(fail)
    }

    /// The job in a table of a larger file; `path` is the table's.
    pub fn from_table(text: &str, table: &DeTable<'_>, path: &str) -> Result<Self, Vec<crate::Located>> {
        let log = Log::new(text);
        let mut job = read(&log, table, path);
        job.given = log.given().into_iter().collect();
        if log.is_clean() { Ok(job) } else { Err(log.into_faults()) }
    }
}

fn read(log: &Log<'_>, table: &DeTable<'_>, path: &str) -> ProsthesisJob {
    let root = Walk::root(log, table, path);
    let part = read_part(root.table("part"));
    let orient = root.table("orient");
    let mode = orient.choice(&k::ORIENT, OrientMode::LeastResidual);
    orient.finish();
    let stock = read_stock(root.table("stock"));
    let tool = read_tool(root.table("tool"));
    let process = read_process(root.table("process"), tool.diameter_mm);
    let machine = read_machine(root.table("machine"));
    // what a finished job's file holds beside the job, so that it can be run again
    root.accept(&["result"]);
    root.finish();
    ProsthesisJob { part, orient: mode, stock, tool, process, machine, given: Default::default() }
}

fn read_part(walk: Walk<'_, '_>) -> PartSpec {
    let part =
        PartSpec { file: PathBuf::from(walk.required_text(&k::STL)), unit: walk.choice(&k::MESH_UNIT, None) };
    walk.finish();
    part
}

fn read_stock(walk: Walk<'_, '_>) -> StockSpec {
    let catalogue = walk.text(&k::CATALOGUE).map(PathBuf::from);
    if catalogue.is_some() && walk.has("blocks") {
        let why = "stock.blocks is given too; give one of both";
        walk.note("catalogue", CaseFault::Contradiction { key: walk.key("catalogue"), why });
    }
    let blocks = if walk.has("blocks") { read_blocks(&walk) } else { default_blocks() };
    walk.accept(&["blocks"]);
    let gap = walk.table("gap_mm");
    let gap_mm = [gap.number(&k::GAP_X), gap.number(&k::GAP_Y), gap.number(&k::GAP_Z)];
    gap.finish();
    let grip_mm = walk.number(&k::GRIP);
    walk.finish();
    StockSpec {
        source: catalogue.map_or(BlockSource::Blocks(blocks), BlockSource::Catalogue),
        gap_mm,
        grip_mm,
    }
}

fn default_blocks() -> Vec<BlockSpec> {
    DEFAULT_BLOCKS.map(|(id, size_mm)| BlockSpec { id: id.into(), size_mm, count: 1 }).to_vec()
}

fn read_blocks(walk: &Walk<'_, '_>) -> Vec<BlockSpec> {
    let mut blocks: Vec<BlockSpec> = Vec::new();
    for entry in walk.tables(&k::BLOCKS).unwrap_or_default() {
        let id = entry.required_text(&k::BLOCK_ID);
        if id.contains([',', '"', '\'']) || id.chars().any(char::is_control) {
            entry.note("id", CaseFault::Name { key: entry.key("id"), found: id.clone() });
        }
        if blocks.iter().any(|b| b.id == id) {
            let other = walk.key("blocks");
            entry.note("id", CaseFault::Duplicate { key: entry.key("id"), found: format!("{id:?}"), other });
        }
        if !entry.has("size_mm") {
            let expected = "three numbers in mm".into();
            entry.note("size_mm", CaseFault::Missing { key: entry.key("size_mm"), expected });
        }
        let size_mm = entry.exactly::<3>(&k::BLOCK_SIZE).unwrap_or([1.0; 3]);
        blocks.push(BlockSpec { id, size_mm, count: entry.whole(&k::BLOCK_COUNT, 1) });
        entry.finish();
    }
    blocks
}

fn read_tool(walk: Walk<'_, '_>) -> CutterSpec {
    let kind = walk.choice(&k::CUTTER, CutterKind::Flat);
    let diameter_mm = walk.number(&k::DIAMETER);
    let given = walk.optional(&k::CORNER);
    if given.is_some() && kind != CutterKind::Bull {
        let why = "only a cutter of kind \"bull\" has a corner radius of its own";
        walk.note("corner_radius_mm", CaseFault::Contradiction { key: walk.key("corner_radius_mm"), why });
    }
    if let Some(found) = given.filter(|corner| *corner > diameter_mm / 2.0) {
        let (key, limit, unit) = (walk.key("corner_radius_mm"), diameter_mm / 2.0, Unit::Mm);
        let (relation, of, is_default) = ("at most", "half of tool.diameter_mm", false);
        walk.note(
            "corner_radius_mm",
            CaseFault::Relation { key, found, is_default, relation, limit, of, unit },
        );
    }
    let corner_radius_mm = match kind {
        CutterKind::Flat => 0.0,
        CutterKind::Ball => diameter_mm / 2.0,
        CutterKind::Bull => given.unwrap_or(diameter_mm / 4.0),
    };
    let tool = CutterSpec {
        kind,
        diameter_mm,
        corner_radius_mm,
        flutes: walk.whole(&k::CUTTER_FLUTES, 1),
        length_mm: walk.number(&k::CUTTER_LENGTH),
        holder_mm: walk.rows::<2>(&k::HOLDER).unwrap_or_else(|| vec![DEFAULT_HOLDER_MM]),
    };
    walk.finish();
    tool
}

fn read_process(walk: Walk<'_, '_>, diameter_mm: f64) -> ProcessSpec {
    let (side_load, depth_of_cut) = (walk.number(&k::SIDE_LOAD), walk.number(&k::DEPTH_OF_CUT));
    let process = ProcessSpec {
        spindle_rpm: walk.number(&k::PROCESS_RPM),
        feed_per_tooth_mm: walk.number(&k::FEED_PER_TOOTH),
        side_load,
        depth_of_cut,
        finishing_step_mm: walk.number(&k::FINISHING_STEP),
        strip_mm: walk.optional(&k::STRIP).unwrap_or(side_load * depth_of_cut * diameter_mm),
        clearance_mm: walk.number(&k::CLEARANCE),
        sense: walk.choice(&k::CUT_SENSE, CutSense::Climb),
    };
    walk.finish();
    process
}

fn read_machine(walk: Walk<'_, '_>) -> MachineSpec {
    walk.choice(&k::ROTARY, ());
    let kind = walk.choice(&k::MACHINE, MachineKind::FiveAxis);
    let on_flange = walk.choice(&k::ON_FLANGE, OnFlange::Spindle);
    if kind == MachineKind::FiveAxis && on_flange == OnFlange::Part {
        let why = "a milling machine has no flange; an arm has one, e.g. machine.kind = \"ur5e\"";
        walk.note("on_flange", CaseFault::Contradiction { key: walk.key("on_flange"), why });
    }
    let [low, high] = walk.exactly::<2>(&k::ROTARY_RANGE).unwrap_or(DEFAULT_ROTARY_DEG);
    if low > high {
        let why = "the lowest angle comes first";
        walk.note("rotary_range_deg", CaseFault::Contradiction { key: walk.key("rotary_range_deg"), why });
    }
    let machine = MachineSpec {
        kind,
        dialect: walk.choice(&k::DIALECT, GCode::LinuxCnc),
        on_flange,
        travel_mm: walk.exactly::<3>(&k::TRAVEL).unwrap_or(DEFAULT_TRAVEL_MM),
        rotary_range_rad: [low, high].map(f64::to_radians),
        max_feed_mm_min: walk.number(&k::MAX_FEED),
        rapid_mm_min: walk.number(&k::RAPID),
        rotary_rad_s: walk.number(&k::ROTARY_SPEED).to_radians(),
        acceleration_mm_s2: walk.number(&k::AXIS_ACCELERATION),
        jerk_mm_s3: walk.number(&k::AXIS_JERK),
        max_time_min: walk.optional(&k::MAX_TIME),
    };
    walk.finish();
    machine
}
