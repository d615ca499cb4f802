//! The drawing of a block's plan: the target shrinks, structures stay, slices and surfaces agree.

use std::path::{Path, PathBuf};

use bonemill_case::Case;
use bonemill_imaging::phantom::{PhantomKind, phantom};
use bonemill_imaging::{PHANTOM_CASE_FILE, write_phantom};
use bonemill_planfile::{Need, Replace, StagedDirectory};

use super::*;
use crate::pages::report::CtSlices;

struct Silent;
impl Progress for Silent {
    fn stage(&self, _: &str) {}
    fn advance(&self, _: usize, _: usize) {}
}

/// Plans a small pocket of the block in `dir`.
fn small_plan(dir: &Path) -> PathBuf {
    let folder = dir.join("case");
    std::fs::create_dir(&folder).unwrap();
    let mut block = phantom(PhantomKind::Block, 1);
    let pocket = "box = { min_mm = [-1.0, -4.0, -4.0], max_mm = [7.0, 4.0, 0.0] } #";
    block.case_toml = block.case_toml.replace("label = 20 ", pocket);
    write_phantom(&folder, &block).unwrap();
    let case_path = folder.join(PHANTOM_CASE_FILE);
    let case = Case::parse(&std::fs::read_to_string(&case_path).unwrap(), &case_path).unwrap();
    let plan = bonemill_pipeline::plan(&case, &case_path, &Silent).unwrap();
    let staged = StagedDirectory::create(&dir.join("plan"), Replace::Nothing).unwrap();
    crate::pages::save::plan(&plan, &case_path, &staged, CtSlices::Shown).unwrap();
    staged.commit().unwrap()
}

/// Plans the channel of a drilled tibia in `dir`.
fn channel_plan(dir: &Path) -> PathBuf {
    let folder = dir.join("case");
    std::fs::create_dir(&folder).unwrap();
    write_phantom(&folder, &phantom(PhantomKind::Tibia, 1)).unwrap();
    let case_path = folder.join(PHANTOM_CASE_FILE);
    let case = Case::parse(&std::fs::read_to_string(&case_path).unwrap(), &case_path).unwrap();
    let plan = bonemill_channel::plan(&case, case.job.channel().unwrap(), &case_path, &Silent).unwrap();
    let staged = StagedDirectory::create(&dir.join("plan"), Replace::Nothing).unwrap();
    crate::pages::save::channel(&plan, &case_path, &staged, CtSlices::Shown).unwrap();
    staged.commit().unwrap()
}

/// Signed volume by the divergence theorem, mm³.
fn volume_mm3(s: &Surface) -> f64 {
    let at = |n: u32| nalgebra::Vector3::from(s.vertices[n as usize].map(f64::from));
    s.triangles.iter().map(|t| at(t[0]).dot(&at(t[1]).cross(&at(t[2]))) / 6.0).sum()
}

#[test]
fn what_is_drawn_is_what_the_plan_does() {
    let dir = tempfile::tempdir().unwrap();
    let stored = StoredPlan::load(&small_plan(dir.path())).unwrap();
    let show = Show::read(&stored, &Silent).unwrap();
    let images = show.images().unwrap();
    let last = stored.waypoints.len() as u32 - 1;

    // the target shrinks by the volume that the plan states
    let whole = volume_mm3(&images.target(None));
    let left = [last / 4, last / 2, last].map(|i| volume_mm3(&images.target(Some(i))));
    assert!(whole > left[0] && left[0] > left[1] && left[1] > left[2] && left[2] > 0.0, "{whole} {left:?}");
    let metrics = &stored.record.metrics;
    assert!((whole / metrics.target_mm3 - 1.0).abs() < 0.03, "{whole}");
    assert!(((whole - left[2]) / metrics.removed_mm3 - 1.0).abs() < 0.05, "{whole} {left:?}");

    // the shell is around the nerve
    let (nerve, shell) = (
        images.around(0, 0.0).unwrap(),
        images.around(0, stored.record.case.structures[0].clearance_mm).unwrap(),
    );
    assert!(!nerve.is_empty() && volume_mm3(&shell) > 2.0 * volume_mm3(&nerve));
    assert!(images.around(1, 0.0).unwrap().is_empty());
    assert!(nerve.normals.iter().all(|n| (n.iter().map(|c| c * c).sum::<f32>() - 1.0).abs() < 1e-4));

    // slices show the same voxels, removed one after the other; through the deepest position of the burr every plane meets the
    // cavity
    let mid = *show.path().iter().min_by(|a, b| a.z().total_cmp(&b.z())).unwrap();
    for plane in &PLANES {
        let [before, after] = [0, last].map(|i| images.slice(plane, mid, i));
        assert_eq!(before.code.len(), before.width * before.height);
        let count = |s: &Slice, code| s.code.iter().filter(|c| **c == code).count();
        assert!(count(&after, CUT) > 0 && count(&before, CUT) < count(&after, CUT));
        assert_eq!(count(&before, TARGET) + count(&before, CUT), count(&after, TARGET) + count(&after, CUT));
        let [x, y] = images.pixel(plane, mid);
        assert!(x > 0.0 && x < before.width as f32 && y > 0.0 && y < before.height as f32);
    }

    // the trajectory's burr is at the waypoints
    let moments = show.moments(300).unwrap();
    assert!(moments.len() > 200 && moments.len() <= 301);
    for m in &moments {
        let burr = Point::<Work>::from_coords(m.tool.translation_mm);
        let (a, b) = (show.path()[m.waypoint.saturating_sub(1)].coords, show.path()[m.waypoint].coords);
        let off = bonemill_geometry::capsule::segment_distance_squared(&burr.coords, &a, &b).sqrt();
        assert!(off < 0.06, "{off} mm at {} s", m.time_s);
        // the bone-attached arm ends at the burr
        assert!(m.links.last().unwrap().distance_mm(&burr) < 1e-9 && m.links.len() == 5);
    }
    assert!(moments.iter().any(|m| m.force_n.is_some()));

    // frames are the surfaces and slices of their moments, including the first and the last
    let frames = show.frames(&moments, 10);
    assert!((10..=12).contains(&frames.len()) && frames.windows(2).all(|f| f[0].time_s < f[1].time_s));
    for (frame, moment) in
        [(&frames[0], &moments[0]), (&frames[frames.len() - 1], &moments[moments.len() - 1])]
    {
        let burr = Point::<Work>::from_coords(moment.tool.translation_mm);
        assert_eq!(frame.time_s, moment.time_s);
        assert_eq!(frame.target, images.target(Some(moment.waypoint as u32)));
        assert_eq!(frame.slices[1].0, images.slice(&PLANES[1], burr, moment.waypoint as u32));
    }

    // names of structures are drawn beside the bone, with lines to the structures
    let bodies = show.bodies().unwrap();
    assert_eq!(bodies.iter().map(|b| b.name.as_str()).collect::<Vec<_>>(), ["facial_nerve"]);
    assert!(bodies[0].surface == nerve && bodies[0].shell == shell);
    let [before, body] = bodies[0].leader;
    assert!(nerve.vertices.contains(&body) && bodies[0].name_at[0] > before[0] && before[0] > body[0]);

    // plots hold the files' values, and their axes leave room for legends
    let plots = show.plots(&moments);
    let found: Vec<_> = plots.iter().map(|p| (p.title.as_str(), p.curves.len(), p.legend())).collect();
    let (several, one) = (true, false);
    assert_eq!(
        found,
        [
            ("force [N]", 2, several),
            ("distance [mm]", 2, several),
            ("speed [mm/s]", 1, one),
            ("joints [mm]", 3, several),
            ("tilt [rad]", 1, one)
        ]
    );
    assert_eq!(plots[2].curves[0].values, stored.waypoints.iter().map(|w| w.speed_mm_s).collect::<Vec<_>>());
    for plot in &plots {
        let end = stored.waypoints[last as usize].time_s;
        assert!(plot.time_s[0] <= 0.0 && plot.time_s[1] >= end);
        for curve in &plot.curves {
            assert_eq!(curve.time_s.len(), curve.values.len());
            assert!(curve.values.iter().all(|v| *v > plot.values[0] && *v < plot.values[1]));
        }
    }
}

#[test]
fn a_plan_without_its_images_is_drawn_as_far_as_its_own_files_go() {
    let dir = tempfile::tempdir().unwrap();
    let plan = small_plan(dir.path());
    let away = dir.path().join("away/plan");
    std::fs::create_dir(dir.path().join("away")).unwrap();
    std::fs::rename(&plan, &away).unwrap();
    let stored = StoredPlan::load_with(&away, None, Need::Unchanged).unwrap();
    let show = Show::read(&stored, &Silent).unwrap();
    assert!(show.images().is_none() && show.bodies().unwrap().is_empty());
    let moments = show.moments(20).unwrap();
    assert!(moments.len() > 10 && show.frames(&moments, 10).is_empty());
    assert_eq!(show.path().len(), stored.waypoints.len());
    assert!(show.plots(&moments).len() == 5 && show.eye()[0].iter().all(|x| x.is_finite()));
    let about = show.about();
    assert!(about.contains("slices are not drawn") && about.contains("ct.nii.gz (SHA-256 "), "{about}");
    // with the folder of its images given, the plan is drawn completely, in the same places
    let found = StoredPlan::load_with(&away, Some(&dir.path().join("case")), Need::All).unwrap();
    let whole = Show::read(&found, &Silent).unwrap();
    assert!(whole.images().is_some() && whole.path() == show.path() && whole.eye() == show.eye());
}

/// A drill is drawn with its point at the trajectory's tip, and each voxel goes on the first way of the drill's solid over it.
#[test]
fn a_channel_is_drawn_with_its_own_tool() {
    let dir = tempfile::tempdir().unwrap();
    let stored = StoredPlan::load(&channel_plan(dir.path())).unwrap();
    let show = Show::read(&stored, &Silent).unwrap();
    let tool = show.tool();
    assert_eq!(tool.radius_mm(), stored.record.channel().unwrap().radius_mm);
    let lowest = tool.cutter.vertices.iter().map(|v| v[2]).fold(f32::INFINITY, f32::min);
    assert!(lowest.abs() < 1e-6 && tool.cutter.triangles.len() > 100, "{lowest}");
    assert!(tool.shank.iter().all(|(part, is_thick)| *is_thick == (part.radius_mm > tool.radius_mm())));

    // a twin by brute force: the first waypoint whose tip brings the solid, or what it swept on the way down, over the voxel
    let images = show.images().unwrap();
    let grid = images.scene.class.grid();
    let path = show.path();
    let drill =
        bonemill_channel::tool::ChannelTool::of_case(&stored.record.case, |f| stored.input_path(f)).unwrap();
    let swept = drill.cutter.solid().swept_towards_tip(1000.0);
    let mut removed = 0;
    for n in (0..grid.len()).step_by(7) {
        let p = grid.center(grid.voxel(n));
        let over = |tip: &Point<Work>| swept.contains(Point::from_coords(p - *tip));
        let first = path.iter().position(over).map_or(u32::MAX, |index| index as u32);
        assert_eq!(images.removal[n], first, "voxel {n} at {p:?}");
        removed += usize::from(first != u32::MAX);
    }
    assert!(removed > 1000, "{removed}");

    // its corridor reaches from the entry to the depth, each wider than the tool by what the registration's error is likely to exceed
    let record = stored.record.channel().unwrap();
    let spec = stored.record.case.job.channel().unwrap();
    let error = spec.registration_sigma_mm * 2.326_347_874;
    assert_eq!(spec.touch_probability, 0.01);
    let corridor = show.corridor().unwrap().unwrap();
    let aside = |v: &[f32; 3]| (f64::from(v[0]) - path[0].x()).hypot(f64::from(v[1]) - path[0].y());
    let widest = corridor.vertices.iter().map(aside).fold(0.0, f64::max);
    assert!((widest - record.radius_mm - error).abs() < 1e-5, "{widest} {error}");
    let [low, high] =
        [f32::min, f32::max].map(|of| corridor.vertices.iter().map(|v| v[2]).reduce(of).unwrap());
    assert!((f64::from(high - low) - record.depth_mm - error).abs() < 1e-4, "{low} {high}");

    // its outline: as wide as the tool from above, its point at the origin from the side
    for (plane, low) in PLANES.iter().zip([-tool.radius_mm(), 0.0, 0.0]) {
        let outline = tool.outline(plane);
        let least = |a: usize| outline.iter().map(|p| p[a]).fold(f64::INFINITY, f64::min);
        assert!(
            (least(0) + tool.radius_mm()).abs() < 1e-6 && (least(1) - low).abs() < 1e-6,
            "{}",
            plane.name
        );
        let [first, last] = [outline[0], outline[outline.len() - 1]];
        assert!((first[0] - last[0]).hypot(first[1] - last[1]) < 1e-9, "{}: not closed", plane.name);
    }
}
