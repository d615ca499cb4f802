//! The keys of a prosthesis' job: unit, plausible range, default, meaning and where the default comes from.

use bonemill_arm::ur::UrModel;

use super::{CutSense, CutterKind, GCode, MachineKind, OnFlange, OrientMode};
use crate::keys::Fallback::{Derived, Value, Words};
use crate::keys::{Choice, Entry, Number, Other, Unit};

const ASSUMED: &str = "assumed";
const TABLE_4: &str = "C Table 4, soft plastic";
const REQUIRED: &str = "required";

table! {
    numbers {
        GAP_X = "stock.gap_mm.x" Mm 0.0..100.0, Value(5.0), "material left on either side of the part along x, its longest side", "assumed: wider than the channel that the contour takes";
        GAP_Y = "stock.gap_mm.y" Mm 0.0..100.0, Value(2.0), "the same along y, across its thickness", ASSUMED;
        GAP_Z = "stock.gap_mm.z" Mm 0.0..100.0, Value(8.0), "the same along z", ASSUMED;
        GRIP = "stock.grip_mm" Mm 1.0..200.0, Value(10.0), "height of the gripped zone at the block's lower end in z, beside the gap", "assumed (C 3: a region for gripping in the lower centre)";
        BLOCK_SIZE = "stock.blocks.size_mm" Mm 1.0..1000.0, Words(REQUIRED), "the block's three sides, in any order", "-";
        BLOCK_COUNT = "stock.blocks.count" One 0.0..1e6, Value(1.0), "how many there are", "-";
        DIAMETER = "tool.diameter_mm" Mm 0.2..50.0, Value(3.175), "diameter of the cutter", "C 5.1: 1/8 inch";
        CORNER = "tool.corner_radius_mm" Mm 0.0..25.0, Derived("0 for a flat end, half the diameter for a ball, a quarter of it for bull"), "radius of the corner between end and side of a bull-nose cutter", ASSUMED;
        CUTTER_FLUTES = "tool.flutes" One 1.0..20.0, Value(1.0), "cutting edges", "C 5.1: a single one";
        CUTTER_LENGTH = "tool.length_mm" Mm 1.0..500.0, Value(20.0), "from the tip to the holder", ASSUMED;
        HOLDER = "tool.holder" Mm 0.05..500.0, Words("[[20.0, 8.0]]"), "[length, radius] of the holder's cylinders from below", ASSUMED;
        PROCESS_RPM = "process.spindle_rpm" Rpm 1.0..500_000.0, Value(8500.0), "spindle speed", TABLE_4;
        FEED_PER_TOOTH = "process.feed_per_tooth_mm" Mm 1e-4..5.0, Value(0.0381), "feed a tooth", TABLE_4;
        SIDE_LOAD = "process.side_load" One 0.05..1.0, Value(0.6), "greatest width of a cut as a share of the diameter", TABLE_4;
        DEPTH_OF_CUT = "process.depth_of_cut" One 0.02..10.0, Value(0.7), "depth of a roughing level as a share of the diameter", TABLE_4;
        FINISHING_STEP = "process.finishing_step_mm" Mm 0.01..5.0, Value(0.1), "greatest height of what finishing leaves, along the surface's normal", ASSUMED;
        STRIP = "process.strip_mm" Mm 0.05..50.0, Derived("side_load · depth_of_cut · diameter: what one pass at full width may cut"), "thickness of the strip that holds the part", "C 4.1: one single pass";
        CLEARANCE = "process.clearance_mm" Mm 0.1..100.0, Value(3.0), "height of repositioning moves above the stock", "the job's contract; C 5.1 names the gap without a value";
        TRAVEL = "machine.travel_mm" Mm 1.0..1e5, Words("[115.5, 128.3, 90.1]"), "travel of the machine's X, Y and Z", "assumed: a desktop machine as in C section 5";
        ROTARY_RANGE = "machine.rotary_range_deg" Deg -3600.0..3600.0, Words("[-360, 360]"), "lowest and highest angle of the rotary axis; side A is cut at 0, side B at 180", ASSUMED;
        MAX_FEED = "machine.max_feed_mm_min" MmMin 1.0..1e6, Value(1524.0), "fastest feed", "C section 5, read as mm/min";
        RAPID = "machine.rapid_mm_min" MmMin 1.0..1e6, Value(1524.0), "speed of repositioning", "C section 5, read as mm/min";
        ROTARY_SPEED = "machine.rotary_deg_s" Deg 0.1..10_000.0, Value(40.0), "speed of the rotary axis, degrees a second", "C section 5";
        AXIS_ACCELERATION = "machine.acceleration_mm_s2" MmS2 1.0..1e6, Value(500.0), "acceleration of an axis", ASSUMED;
        AXIS_JERK = "machine.jerk_mm_s3" One 1.0..1e9, Value(10_000.0), "jerk of an axis, mm/s³", ASSUMED;
        MAX_TIME = "machine.max_time_min" Min 0.01..1e5, Words("none"), "the time that there is; a program that takes longer falls short, and what would meet it is said", "C 4.3";
    }
    choices {
        MESH_UNIT: Option<&'static str> = "part.unit" ["auto" => None, "mm" => Some("mm"), "cm" => Some("cm"), "m" => Some("m"), "inch" => Some("inch"), "um" => Some("um")],
            "unit of the file's coordinates; `auto`: mm if the part is then 5 to 400 mm long, else the unit is asked for", "-";
        ORIENT: OrientMode = "orient.mode" ["least_residual" => OrientMode::LeastResidual, "least_time" => OrientMode::LeastTime, "none" => OrientMode::AsGiven],
            "how the part is laid: the least sum of the three residual areas; the least machining time; as the file gives it", "C section 3";
        CUTTER: CutterKind = "tool.kind" ["flat" => CutterKind::Flat, "ball" => CutterKind::Ball, "bull" => CutterKind::Bull],
            "shape of the cutter's end", ASSUMED;
        CUT_SENSE: CutSense = "process.sense" ["climb" => CutSense::Climb, "conventional" => CutSense::Conventional],
            "sense of cut beside the stock", ASSUMED;
        MACHINE: MachineKind = "machine.kind" ["five-axis" => MachineKind::FiveAxis, "ur3e" => MachineKind::Ur(UrModel::Ur3e), "ur5e" => MachineKind::Ur(UrModel::Ur5e), "ur10e" => MachineKind::Ur(UrModel::Ur10e), "ur16e" => MachineKind::Ur(UrModel::Ur16e), "ur20" => MachineKind::Ur(UrModel::Ur20), "ur30" => MachineKind::Ur(UrModel::Ur30)],
            "what moves the cutter against the part: a milling machine with a rotary axis, or an arm, which gets trajectory.csv too", "C section 5";
        DIALECT: GCode = "machine.dialect" ["linuxcnc" => GCode::LinuxCnc, "fanuc" => GCode::Fanuc, "haas" => GCode::Haas],
            "whose G-code program.nc is: the unit of a dwell, the program's number", ASSUMED;
        ON_FLANGE: OnFlange = "machine.on_flange" ["spindle" => OnFlange::Spindle, "part" => OnFlange::Part],
            "what an arm holds: the spindle, while a table turns the block between the sides; or the part in its block, which it turns itself under a spindle that stands still", ASSUMED;
        ROTARY: () = "machine.rotary" ["A" => ()], "the rotary axis that turns the block between sides A and B: about the machine's X", "C 4.3";
    }
    others {
        STL = "part.stl" "the path of a .stl, .obj or .ply file, relative to the job file", REQUIRED, "the part", "-";
        CATALOGUE = "stock.catalogue" "the path of a TOML file made by `bonemill stock`", "none: stock.blocks", "the blocks in stock; the chosen one is taken out of it", "C section 3";
        BLOCKS = "stock.blocks" "tables { id, size_mm, count }", "S 50×25×60, M 65×30×75, L 90×45×100 mm, one each", "blocks, where there is no catalogue", ASSUMED;
        BLOCK_ID = "stock.blocks.id" "text without commas and quotes", REQUIRED, "the block's number", "-";
    }
}
