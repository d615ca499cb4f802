//! Whether the channel is the one that the case asks for, and whether the waypoints go through it and nowhere else.

use bonemill_case::{ChannelDirection, ChannelEnd, ChannelSpec, Entry, LabelRef};
use bonemill_geometry::{Ct, Point};
use bonemill_planfile::{ChannelRecord, StoredPlan};
use nalgebra::Vector3;

use super::super::anatomy::Anatomy;
use super::super::check::{Check, Place};
use super::super::moves::Moves;
use super::super::requirements::MEETS;
use super::sweep::OwnSolid;
use super::{ROUNDING, is_cut};

/// Feed may begin this far before the bone, mm, and a search for a contact area may end this far beyond it.
const BEFORE_MM: f64 = 0.7;

/// The plan's own word.
pub fn meets(plan: &StoredPlan) -> Check {
    let shortfalls = &plan.record.shortfalls;
    Check::none_wrong(MEETS, shortfalls.len()).noting(shortfalls.join("; "))
}

/// The waypoints against the channel and the case.
pub fn rows(plan: &StoredPlan, spec: &ChannelSpec, channel: &ChannelRecord, moves: &Moves) -> Vec<Check> {
    const NAME: &str = "rows";
    let rows = &plan.waypoints;
    let out = -channel.direction.into_inner();
    let worst = |of: &dyn Fn(usize) -> f64| {
        (0..rows.len())
            .map(|n| (of(n), n))
            .fold((0.0, 0), |a, b| if b.0 > a.0 || b.0.is_nan() { b } else { a })
    };
    let check = |subject: &str, (value, at): (f64, usize), limit: f64, unit| {
        Check::at_most(NAME, value, limit, unit).of(subject).at(Place::Waypoint(at))
    };
    let depth = |n: usize| (rows[n].position - channel.entry).dot(&channel.direction);
    let across = |n: usize| (rows[n].position - channel.entry - channel.direction.as_ref() * depth(n)).norm();
    let axis = |n: usize| (rows[n].axis - out).norm();
    let deepest_before = |n: usize| (0..n).map(depth).fold(f64::NEG_INFINITY, f64::max);
    // bone is met from the first contact on: a move that goes deeper than that, and than any before, removes it
    let removes = |n: usize| n > 0 && depth(n) > deepest_before(n).max(channel.contact_depth_mm) + ROUNDING;
    let unfit = |n: usize| f64::from(u8::from(removes(n) && !is_cut(moves, n)));
    let feed = match plan.record.case.tool.spindle() {
        Some(spindle) => spec.feed.speed_mm_s(spindle.rpm),
        None => 0.0,
    };
    let fast = |n: usize| {
        rows[n].speed_mm_s - if is_cut(moves, n) { feed } else { plan.record.case.speed.link_mm_s }
    };
    let long = |n: usize| {
        if n > 0 && is_cut(moves, n) { (rows[n].position - rows[n - 1].position).norm() } else { 0.0 }
    };
    let deepest = (0..rows.len()).map(depth).fold(f64::NEG_INFINITY, f64::max);
    let starts = rows.first().is_some_and(|w| !is_cut(moves, 0) && w.time_s == 0.0);
    let first_mm = rows.first().map_or(0.0, |_| depth(0));
    let stands_mm = first_mm - (channel.contact_depth_mm.min(0.0) - spec.standoff_mm);
    vec![
        Check::none_wrong(NAME, usize::from(!starts)).of("the first is a link at 0 s"),
        check("on the channel's line", worst(&across), ROUNDING, "mm"),
        check("axis along the channel", worst(&axis), ROUNDING, ""),
        check("what removes bone is a cut", worst(&unfit), 0.0, ""),
        check("speeds", worst(&fast), ROUNDING, "mm/s over"),
        check("length of cuts", worst(&long), spec.step_mm + ROUNDING, "mm"),
        Check::at_most(NAME, (deepest - channel.depth_mm).abs(), ROUNDING, "mm")
            .of("the deepest is the channel's end"),
        Check::at_most(NAME, stands_mm.abs(), ROUNDING, "mm").of("the first stands off"),
    ]
}

/// The channel against the case's `[path]`.
pub fn channel(
    plan: &StoredPlan,
    spec: &ChannelSpec,
    channel: &ChannelRecord,
    anatomy: &Anatomy,
    solid: &OwnSolid,
) -> Vec<Check> {
    const NAME: &str = "channel of the case";
    let off = |value: f64, subject: &str, unit| Check::at_most(NAME, value, ROUNDING, unit).of(subject);
    let mut checks = vec![match spec.end {
        ChannelEnd::Target(target) => off((channel.end().coords - target).norm(), "ends at target_mm", "mm"),
        ChannelEnd::Depth(mm) => off((channel.depth_mm - mm).abs(), "depth_mm", "mm"),
        ChannelEnd::ContactArea(mm2) => {
            let found = largest_contact_mm2(plan);
            Check::at_least(NAME, found, (1.0 - 1e-3) * mm2, "mm²").of("contact_area_mm2, as written")
        }
    }];
    if let ChannelDirection::Given(direction) = spec.direction {
        checks.push(off((channel.direction.as_ref() - direction).norm(), "direction", ""));
    }
    if let Entry::Point(entry) = spec.entry {
        checks.push(off((channel.entry.coords - entry).norm(), "entry_mm", "mm"));
    } else {
        let bone_hu = plan.record.case.density.bone_hu;
        let out = -channel.direction.into_inner();
        // the entry is where the bone ends for good: no bone from half a voxel on
        let half_mm = 0.5 * anatomy.ct.grid().diagonal_mm();
        let reach =
            anatomy.ct.grid().corners().iter().map(|c| c.distance_mm(&channel.entry)).fold(0.0, f64::max);
        let step = 0.25 * anatomy.ct.grid().spacing_mm().min();
        let outside = (0..(reach / step) as usize).map(|n| half_mm + n as f64 * step);
        let bone = outside.filter(|s| anatomy.hu(channel.entry + out * *s) >= bone_hu).count();
        checks.push(Check::none_wrong(NAME, bone).of("no bone on the line before the entry"));
        checks.push(leads_outside(anatomy, plan.record.case.density.air_hu, channel.entry, &out));
        if let (ChannelDirection::Safest, Some(about)) = (spec.direction, plan.record.case.approach) {
            let off_deg = out.angle(&about).to_degrees();
            let check = Check::at_most(NAME, off_deg, spec.cone_deg + ROUNDING, "°");
            checks.push(check.of("angle from approach.direction"));
        }
        checks.push(
            Check::none_wrong(NAME, usize::from(!in_region(spec, channel.entry, anatomy)))
                .of("entry in its region"),
        );
    }
    checks.push(first_contact(plan, channel, anatomy, solid));
    checks
}

fn out_of(channel: &ChannelRecord) -> Vector3<f64> {
    -channel.direction.into_inner()
}

fn largest_contact_mm2(plan: &StoredPlan) -> f64 {
    plan.record.metrics.number("largest_contact_mm2").unwrap_or(f64::NAN)
}

/// The air on the line before the entry goes on, from voxel to voxel by their faces, to a corner of the scan: it is the air
/// outside the patient. A scan that has no air in its corners does not show the outside, and nothing is judged.
fn leads_outside(anatomy: &Anatomy, air_hu: f64, entry: Point<Ct>, out: &Vector3<f64>) -> Check {
    let grid = anatomy.ct.grid();
    let [nx, ny, nz] = grid.dims();
    let is_air = |n: usize| f64::from(anatomy.ct.data()[n]) <= air_hu;
    let is_corner =
        |[i, j, k]: [usize; 3]| (i == 0 || i + 1 == nx) && (j == 0 || j + 1 == ny) && (k == 0 || k + 1 == nz);
    let check = |wrong: bool| {
        Check::none_wrong("channel of the case", usize::from(wrong)).of("the way out reaches the outside air")
    };
    let corners = (0..8).map(|c| [[0, nx - 1][c & 1], [0, ny - 1][c >> 1 & 1], [0, nz - 1][c >> 2]]);
    if !corners.map(|voxel| grid.index(voxel)).any(is_air) {
        return check(false).noting("not judged: no corner of the scan holds air");
    }
    let step = 0.25 * grid.spacing_mm().min();
    let line = (0..).map_while(|n| grid.nearest(entry + out * (f64::from(n) * step)));
    let mut seen = vec![false; grid.len()];
    let mut open: Vec<[usize; 3]> = line.filter(|voxel| is_air(grid.index(*voxel))).collect();
    while let Some([i, j, k]) = open.pop() {
        let n = grid.index([i, j, k]);
        if std::mem::replace(&mut seen[n], true) {
            continue;
        }
        if is_corner([i, j, k]) {
            return check(false);
        }
        // one step to either side along each axis; beyond the scan there is no voxel
        let beside = [
            [i.wrapping_sub(1), j, k],
            [i + 1, j, k],
            [i, j.wrapping_sub(1), k],
            [i, j + 1, k],
            [i, j, k.wrapping_sub(1)],
            [i, j, k + 1],
        ];
        let inside = beside.into_iter().filter(|[i, j, k]| *i < nx && *j < ny && *k < nz);
        open.extend(inside.filter(|voxel| !seen[grid.index(*voxel)] && is_air(grid.index(*voxel))));
    }
    check(true)
}

/// Whether the entry lies in the region that the case names.
fn in_region(spec: &ChannelSpec, entry: Point<Ct>, anatomy: &Anatomy) -> bool {
    match &spec.entry {
        Entry::Point(_) | Entry::Surface => true,
        Entry::Ball { center_mm, radius_mm } => (entry.coords - center_mm).norm() <= radius_mm + ROUNDING,
        Entry::Label(label) => {
            let number = match label {
                LabelRef::Number(number) => Some(*number),
                LabelRef::Name(_) | LabelRef::File { .. } => anatomy.number_of(label),
            };
            let grid = anatomy.labels.grid();
            let reach = grid.diagonal_mm();
            // as near as a voxel's neighbour
            let steps = [-1.0, -0.5, 0.0, 0.5, 1.0];
            let around = steps
                .iter()
                .flat_map(|x| steps.iter().flat_map(move |y| steps.map(|z| Vector3::new(*x, *y, z))));
            number.is_some_and(|number| around.map(|d| entry + d * reach).any(|p| anatomy.label(p) == number))
        }
    }
}

/// The depth at which the plan says that bone begins: none of the tool's solid is in bone before it.
fn first_contact(plan: &StoredPlan, channel: &ChannelRecord, anatomy: &Anatomy, solid: &OwnSolid) -> Check {
    let out = out_of(channel);
    let case = &plan.record.case;
    let grid = anatomy.ct.grid();
    let at = channel.entry + channel.direction.as_ref() * (channel.contact_depth_mm - BEFORE_MM);
    let bone = anatomy.ct.data().iter().enumerate();
    let bone = bone.filter(|(_, hu)| f64::from(**hu) >= case.density.bone_hu);
    let inside = bone.filter(|(n, _)| {
        let from = grid.center(grid.voxel(*n)) - at;
        let along = from.dot(&out);
        solid.cuts((from - out * along).norm(), along)
    });
    Check::none_wrong("bone voxels in the tool before it cuts", inside.count())
}
