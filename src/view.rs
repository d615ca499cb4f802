//! `bonemill view`: a plan in the rerun viewer, or as a file for it. The only user of rerun.
//!
//! One time line, `time`, in seconds of the plan. Entities: `scene/…` in 3-D (target, what is cut so far, structures with
//! the surface at their clearance, path, burr and shank, force, arm), `slices/…` through the burr, `plots/…`, `about`.
//! What is drawn comes from [`bonemill_planner::show`]; here it only gets names, colours and places on the screen.

use std::path::Path;

use anyhow::Context;
use bonemill_geometry::{Point, Work};
use bonemill_planner::Progress;
use bonemill_planner::plan::{StoredPlan, Waypoint};
use bonemill_planner::show::{
    self, ARROW_MM_PER_N, Moment, PAINTS, PLANES, STRUCTURE_COLOURS, Show, Slice, Surface,
};
use bonemill_robot::JointKind;
use rerun::blueprint::{
    Blueprint, BlueprintActivation, BlueprintPanel, ContainerLike, Horizontal, SelectionPanel, Spatial2DView,
    Spatial3DView, Tabs, TextDocumentView, TimePanel, TimeSeriesView, Vertical,
};
use rerun::external::re_sdk_types::blueprint::components::{PanelState, PlayState};
use rerun::{Color, RecordingStream, RecordingStreamBuilder, TimeColumn};

use crate::args::ViewArgs;
use crate::outcome::Outcome;

/// The time line's name.
const TIME: &str = "time";
/// Moments at which the cut and the slices are drawn anew.
const SLICE_MOMENTS: usize = 80;
/// Moments of the burr and the arm.
const MOTION_MOMENTS: usize = 4000;
/// A structure whose box has a diagonal above this share of the target's is drawn so that one sees through.
const LARGE_SHARE: f32 = 1.0;
/// Of the target in slices, as in the report.
const TARGET_COLOUR: [u8; 3] = [80, 255, 140];
/// Of the target in 3-D.
const BONE_COLOUR: [u8; 3] = [226, 201, 160];

pub fn run(args: &ViewArgs, progress: &dyn Progress) -> anyhow::Result<Outcome> {
    progress.stage("read plan");
    let plan = StoredPlan::load(&args.plan)?;
    let show = Show::read(&plan, progress)?;
    let stream = open(args.save.as_deref())?;
    draw(&stream, &show, progress)?;
    progress.stage("write");
    stream.flush_blocking().context("the viewer or the file did not take the drawing")?;
    Ok(match &args.save {
        Some(path) => {
            let bytes =
                std::fs::metadata(path).with_context(|| format!("cannot find {}", path.display()))?.len();
            Outcome::written("view", path, &format!("{:.1} MB; open it with: rerun FILE", bytes as f64 / 1e6))
        }
        None => Outcome::text("view", "opened in the rerun viewer\n".into()),
    })
}

fn open(save: Option<&Path>) -> anyhow::Result<RecordingStream> {
    let builder = RecordingStreamBuilder::new("bonemill");
    match save {
        Some(path) => builder.save(path).with_context(|| format!("cannot write {}", path.display())),
        None => builder.spawn().context(
            "cannot open the viewer: install rerun 0.36.3 (pip install rerun-sdk==0.36.3), or write a file with --save",
        ),
    }
}

/// Draws everything.
fn draw(stream: &RecordingStream, show: &Show, progress: &dyn Progress) -> anyhow::Result<()> {
    let plan = show.plan();
    progress.stage("draw");
    stream.log_static("scene", &rerun::ViewCoordinates::RIGHT_HAND_Z_UP())?;
    structures(stream, show)?;
    path(stream, show)?;
    let moments = show.moments(MOTION_MOMENTS)?;
    motion(stream, show, &moments)?;
    let frames = show.frames(&moments, SLICE_MOMENTS);
    progress.stage("write drawing");
    let count = frames.len();
    for (n, frame) in frames.into_iter().enumerate() {
        stream.set_duration_secs(TIME, frame.time_s);
        stream.log("scene/target", &mesh(frame.target, BONE_COLOUR, 150))?; // the path shows through
        slices(stream, show, frame.slices)?;
        progress.advance(n, count);
    }
    stream.reset_time();
    plots(stream, plan, &moments)?;
    stream.log_static("about", &rerun::TextDocument::from_markdown(show.about()))?;
    blueprint(plan).send(stream, BlueprintActivation::default())?;
    Ok(())
}

fn colour([r, g, b]: [u8; 3]) -> Color {
    Color::from_rgb(r, g, b)
}

fn structure_colour(n: usize) -> [u8; 3] {
    STRUCTURE_COLOURS[n % STRUCTURE_COLOURS.len()]
}

fn single(p: &Point<Work>) -> [f32; 3] {
    [p.x() as f32, p.y() as f32, p.z() as f32]
}

/// A surface of one colour; `alpha` below 255 lets through what lies behind.
fn mesh(surface: Surface, [r, g, b]: [u8; 3], alpha: u8) -> rerun::Mesh3D {
    rerun::Mesh3D::new(surface.vertices)
        .with_vertex_normals(surface.normals)
        .with_triangle_indices(
            surface.triangles.into_iter().map(|[a, b, c]| rerun::TriangleIndices::from([a, b, c])),
        )
        .with_albedo_factor(rerun::Rgba32::from_unmultiplied_rgba(r, g, b, alpha))
}

/// Diagonal of a surface's box, mm.
fn extent(surface: &Surface) -> f32 {
    let side = |a: usize| {
        let along = surface.vertices.iter().map(|v| v[a]);
        along.clone().fold(f32::NEG_INFINITY, f32::max) - along.fold(f32::INFINITY, f32::min)
    };
    if surface.is_empty() { 0.0 } else { (0..3).map(|a| side(a).powi(2)).sum::<f32>().sqrt() }
}

/// Mean height of a surface's vertices, mm.
fn height(surface: &Surface) -> f32 {
    surface.vertices.iter().map(|v| v[2]).sum::<f32>() / surface.vertices.len() as f32
}

/// A structure's name in a column beside the bone, with a line to it, so that names do not cover each other.
fn label(
    stream: &RecordingStream,
    entity: &str,
    name: &str,
    surface: &Surface,
    tint: [u8; 3],
    at: [f32; 3],
) -> anyhow::Result<()> {
    let apart = |v: &[f32; 3]| (0..3).map(|a| (v[a] - at[a]).powi(2)).sum::<f32>();
    let Some(nearest) = surface.vertices.iter().min_by(|a, b| apart(a).total_cmp(&apart(b))) else {
        return Ok(());
    };
    let point = rerun::Points3D::new([at]).with_labels([name]).with_radii([0.05]).with_colors([colour(tint)]);
    stream.log_static(format!("{entity}/name"), &point)?;
    let line = rerun::LineStrips3D::new([[at, *nearest]])
        .with_colors([colour(tint)])
        .with_radii([rerun::Radius::new_ui_points(0.7)]);
    stream.log_static(format!("{entity}/leader"), &line)?;
    Ok(())
}

fn structures(stream: &RecordingStream, show: &Show) -> anyhow::Result<()> {
    // room for the names: beside the grid, from its top downwards
    let grid = show.scene().class.grid();
    let [beside, label_y, top] = std::array::from_fn(|a| {
        let along = grid.dims()[a] as f32 * grid.spacing_mm()[a] as f32;
        if a == 0 { along + 6.0 } else { along }
    });
    let size = extent(&show.target(None));
    let mut classes = vec![
        (u16::from(show::NOTHING), "elsewhere", rerun::Rgba32::TRANSPARENT),
        (u16::from(show::TARGET), "target, still there", rerun::Rgba32::from(colour(TARGET_COLOUR).0)),
        (u16::from(show::CUT), "cut away", rerun::Rgba32::from(colour([0, 0, 0]).0)),
    ];
    let mut found = Vec::new();
    for (n, structure) in show.plan().record.case.structures.iter().enumerate() {
        let tint = structure_colour(n);
        let code = u16::from(show::FIRST_STRUCTURE) + n as u16;
        classes.push((code, structure.name.as_str(), rerun::Rgba32::from(colour(tint).0)));
        let surface = show.structure(n)?;
        if !surface.is_empty() {
            found.push((n, structure.name.as_str(), surface));
        }
    }
    // names from top to bottom as the structures lie, so that few leaders cross
    found.sort_by(|a, b| height(&b.2).total_cmp(&height(&a.2)));
    for (place, (n, name, surface)) in found.into_iter().enumerate() {
        let tint = structure_colour(n);
        let entity = format!("scene/structures/{}", rerun::EntityPath::from_single_string(name.to_owned()));
        let alpha = if extent(&surface) > LARGE_SHARE * size { 100 } else { 255 };
        label(stream, &entity, name, &surface, tint, [beside, 0.5 * label_y, top - 3.0 * place as f32])?;
        stream.log_static(format!("{entity}/clearance"), &mesh(show.shell(n)?, tint, 40))?;
        stream.log_static(format!("{entity}/surface"), &mesh(surface, tint, alpha))?;
    }
    stream.log_static("slices", &rerun::AnnotationContext::new(classes))?;
    Ok(())
}

/// The path four times, each time coloured by another value.
fn path(stream: &RecordingStream, show: &Show) -> anyhow::Result<()> {
    let points: Vec<_> = show.path().iter().map(single).collect();
    for paint in PAINTS {
        let (strips, colours) = runs(&points, &paint.colours(show.plan()));
        let lines = rerun::LineStrips3D::new(strips)
            .with_colors(colours.into_iter().map(colour))
            .with_radii([rerun::Radius::new_ui_points(1.2)]);
        stream.log_static(format!("scene/path/{}", paint.entity()), &lines)?;
    }
    Ok(())
}

/// Consecutive moves of one colour as one strip; a move has the colour of the waypoint that it ends at.
fn runs(points: &[[f32; 3]], of: &[[u8; 3]]) -> (Vec<Vec<[f32; 3]>>, Vec<[u8; 3]>) {
    let (mut strips, mut colours): (Vec<Vec<[f32; 3]>>, Vec<[u8; 3]>) = (Vec::new(), Vec::new());
    for (pair, tint) in points.windows(2).zip(of.iter().skip(1)) {
        match (strips.last_mut(), colours.last()) {
            (Some(strip), Some(before)) if before == tint => strip.push(pair[1]),
            _ => {
                strips.push(pair.to_vec());
                colours.push(*tint);
            }
        }
    }
    (strips, colours)
}

/// Burr, shank, force and arm at every moment.
fn motion(stream: &RecordingStream, show: &Show, moments: &[Moment]) -> anyhow::Result<()> {
    let case = &show.plan().record.case;
    let radius = case.burr.radius_mm as f32;
    let burr = rerun::Ellipsoids3D::from_radii([radius])
        .with_colors([Color::from_rgb(235, 235, 240)])
        .with_fill_mode(rerun::FillMode::Solid);
    stream.log_static("scene/tool/burr", &burr)?;
    let mut from_mm = case.burr.radius_mm;
    for (n, segment) in case.shank.iter().enumerate() {
        // what is thicker than the burr stays outside and would hide the bone: only the arm's own view shows it
        let part = if segment.radius_mm > case.burr.radius_mm { "handpiece" } else { "shank" };
        let middle = [0.0, 0.0, (from_mm + 0.5 * segment.length_mm) as f32];
        let cylinder = rerun::Cylinders3D::from_lengths_and_radii(
            [segment.length_mm as f32],
            [segment.radius_mm as f32],
        )
        .with_centers([middle])
        .with_colors([Color::from_rgb(170, 176, 186)])
        .with_fill_mode(rerun::FillMode::Solid);
        stream.log_static(format!("scene/tool/{part}/{n}"), &cylinder)?;
        from_mm += segment.length_mm;
    }

    let times = || [TimeColumn::new_duration_secs(TIME, moments.iter().map(|m| m.time_s))];
    let translations = moments.iter().map(|m| single(&Point::from_coords(m.tool.translation_mm)));
    let quaternions = moments.iter().map(|m| {
        let q = nalgebra::UnitQuaternion::from_rotation_matrix(&m.tool.rotation);
        rerun::Quaternion::from_xyzw([q.i as f32, q.j as f32, q.k as f32, q.w as f32])
    });
    let poses = rerun::Transform3D::update_fields()
        .with_many_translation(translations)
        .with_many_quaternion(quaternions);
    stream.send_columns("scene/tool", times(), poses.columns_of_unit_batches()?)?;

    let arrow = |m: &Moment| {
        let push = m.force_n.unwrap_or_default() * ARROW_MM_PER_N;
        [push.x as f32, push.y as f32, push.z as f32]
    };
    let arrows = rerun::Arrows3D::update_fields()
        .with_vectors(moments.iter().map(arrow))
        .with_origins(moments.iter().map(|m| single(&Point::from_coords(m.tool.translation_mm))));
    stream.send_columns("scene/force", times(), arrows.columns_of_unit_batches()?)?;
    let look =
        rerun::Arrows3D::update_fields().with_colors([Color::from_rgb(255, 60, 60)]).with_radii([0.25]);
    stream.log_static("scene/force", &look)?;

    let links = rerun::LineStrips3D::update_fields()
        .with_strips(moments.iter().map(|m| m.links.iter().map(single).collect::<Vec<_>>()));
    stream.send_columns("scene/arm", times(), links.columns_of_unit_batches()?)?;
    let look =
        rerun::LineStrips3D::update_fields().with_colors([Color::from_rgb(120, 140, 170)]).with_radii([1.5]);
    stream.log_static("scene/arm", &look)?;
    Ok(())
}

/// The slices through the burr, with target and structures over them and the burr's outline.
fn slices(stream: &RecordingStream, show: &Show, drawn: [(Slice, [f32; 2]); 3]) -> anyhow::Result<()> {
    let radius = (show.plan().record.case.burr.radius_mm / show.pixel_mm()) as f32;
    for ((slice, [x, y]), name) in drawn.into_iter().zip(SLICE_NAMES) {
        let size = [slice.width as u32, slice.height as u32];
        stream.log(format!("slices/{name}/ct"), &rerun::Image::from_l8(slice.grey, size))?;
        let format = rerun::components::ImageFormat::from(rerun::datatypes::ImageFormat::segmentation(
            size,
            rerun::ChannelDatatype::U8,
        ));
        let labels = rerun::SegmentationImage::new(slice.code, format).with_opacity(0.35);
        stream.log(format!("slices/{name}/labels"), &labels)?;
        let circle = (0..=48).map(|n| {
            let (sin, cos) = (n as f32 / 48.0 * std::f32::consts::TAU).sin_cos();
            [x + radius * cos, y + radius * sin]
        });
        let outline = rerun::LineStrips2D::new([circle.collect::<Vec<_>>()])
            .with_colors([Color::from_rgb(255, 255, 255)])
            .with_radii([rerun::Radius::new_ui_points(1.0)]);
        stream.log(format!("slices/{name}/burr"), &outline)?;
        let bar_y = size[1] as f32 * 0.9;
        let bar_px = (5.0 / show.pixel_mm()) as f32;
        let bar = rerun::LineStrips2D::new([[[3.0, bar_y], [3.0 + bar_px, bar_y]]])
            .with_labels(["5 mm"])
            .with_colors([Color::from_rgb(255, 255, 255)]);
        stream.log_static(format!("slices/{name}/scale"), &bar)?;
    }
    Ok(())
}

/// Entities of the planes of [`PLANES`].
const SLICE_NAMES: [&str; 3] = ["x_y", "x_z", "y_z"];

fn plots(stream: &RecordingStream, plan: &StoredPlan, moments: &[Moment]) -> anyhow::Result<()> {
    let radius = plan.record.case.burr.radius_mm;
    let series: [(&str, &str, [u8; 3], Box<dyn Fn(&Waypoint) -> Option<f64>>); 5] = [
        (
            "force/magnitude",
            "magnitude",
            [86, 156, 214],
            Box::new(|w| Some(w.force_n.map_or(0.0, |f| f.norm()))),
        ),
        (
            "force/toward",
            "toward the nearest structure",
            [232, 140, 50],
            Box::new(|w| Some(w.force_toward_n.unwrap_or(0.0))),
        ),
        ("speed/cap", "speed", [86, 156, 214], Box::new(|w| Some(w.speed_mm_s))),
        (
            "distance/surface",
            "burr's surface to structure",
            [86, 156, 214],
            Box::new(move |w| w.distance_mm.map(|d| d - radius)),
        ),
        ("distance/clearance", "clearance kept from it", [230, 80, 80], {
            let clearances: Vec<f64> = plan.record.case.structures.iter().map(|s| s.clearance_mm).collect();
            Box::new(move |w| w.structure.and_then(|n| clearances.get(n).copied()))
        }),
    ];
    for (entity, name, tint, value) in series {
        let found = plan.waypoints.iter().filter_map(|w| Some((w.time_s, value(w)?)));
        line(stream, &format!("plots/{entity}"), name, Some(tint), found)?;
    }
    for (n, joint) in plan.arm.joints().iter().enumerate() {
        let name = format!("{} [{}]", joint.name, joint.kind.unit());
        let places = moments.iter().filter_map(|m| Some((m.time_s, *m.q.get(n)?)));
        let folder = if joint.kind == JointKind::Prismatic { "linear" } else { "turning" };
        line(stream, &format!("plots/joints_{folder}/q{}", n + 1), &name, None, places)?;
    }
    Ok(())
}

/// One curve over time.
fn line(
    stream: &RecordingStream,
    entity: &str,
    name: &str,
    tint: Option<[u8; 3]>,
    values: impl Iterator<Item = (f64, f64)>,
) -> anyhow::Result<()> {
    let (times, values): (Vec<f64>, Vec<f64>) = values.unzip();
    if values.is_empty() {
        return Ok(());
    }
    let mut look = rerun::SeriesLines::new().with_names([name]).with_widths([1.5]);
    if let Some(tint) = tint {
        look = look.with_colors([colour(tint)]);
    }
    stream.log_static(entity, &look)?;
    let column = TimeColumn::new_duration_secs(TIME, times);
    stream.send_columns(entity, [column], rerun::Scalars::new(values).columns_of_unit_batches()?)?;
    Ok(())
}

/// The first look: path and bone large, slices beside them, curves below.
fn blueprint(plan: &StoredPlan) -> Blueprint {
    let view = |name: &str, contents: &[&str]| {
        let contents = contents.iter().map(|c| (*c).to_owned());
        ContainerLike::from(Spatial3DView::new(name).with_origin("scene").with_contents(contents))
    };
    let mut tabs = Vec::new();
    for paint in PAINTS {
        if paint.range(plan).is_some() {
            let shown = format!("+ $origin/path/{}", paint.entity());
            let hidden = ["- $origin/path/**", "- $origin/arm/**", "- $origin/tool/handpiece/**"];
            let contents = [&["+ $origin/**"], &hidden[..], &[shown.as_str()]].concat();
            tabs.push(view(&format!("path by {}", paint.name), &contents));
        }
    }
    tabs.push(view("arm", &["+ $origin/**", "- $origin/path/**"]));
    tabs.push(ContainerLike::from(TextDocumentView::new("about").with_origin("about")));
    let slices = PLANES.iter().zip(SLICE_NAMES).map(|(plane, name)| {
        ContainerLike::from(Spatial2DView::new(plane.name).with_origin(format!("slices/{name}")))
    });
    let plot = |name: &str, entity: &str| {
        ContainerLike::from(TimeSeriesView::new(name).with_origin(format!("plots/{entity}")))
    };
    let mut plots = vec![plot("force [N]", "force"), plot("speed [mm/s]", "speed")];
    if !plan.record.case.structures.is_empty() {
        plots.insert(1, plot("distance [mm]", "distance"));
    }
    let joints = [
        (JointKind::Prismatic, "joints [mm]", "joints_linear"),
        (JointKind::Revolute, "joints [rad]", "joints_turning"),
    ];
    for (kind, name, entity) in joints {
        if plan.arm.joints().iter().any(|j| j.kind == kind) {
            plots.push(plot(name, entity));
        }
    }
    let above = Horizontal::new([Tabs::new(tabs).into(), Vertical::new(slices).into()])
        .with_column_shares([1.7, 1.0]);
    Blueprint::new(Vertical::new([above.into(), Horizontal::new(plots).into()]).with_row_shares([2.8, 1.0]))
        .with_blueprint_panel(BlueprintPanel::from_state(PanelState::Collapsed))
        .with_selection_panel(SelectionPanel::from_state(PanelState::Collapsed))
        .with_time_panel(
            TimePanel::new()
                .with_state(PanelState::Collapsed)
                .with_timeline(TIME)
                .with_play_state(PlayState::Paused)
                .with_playback_speed(20.0),
        )
}
