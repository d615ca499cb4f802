//! `bonemill view`: shows a plan in the rerun viewer, or writes a file for it. Only this module uses rerun.
//!
//! There is one time line, `time`, in seconds of the plan. Entities: `scene/…` in 3-D (target, removed part, structures with the
//! surface at their clearance, a channel's corridor, path, tool, force, arm), `slices/…` through the tool's origin, `plots/…`, `about`. The data come
//! from [`bonemill_planner::show`]; this module gives them names, colours and places on the screen. A prosthesis: [`prosthesis`].

mod prosthesis;

use std::path::Path;
use std::time::Duration;

use anyhow::Context;
use bonemill_geometry::{Point, Work};
use bonemill_planner::Progress;
use bonemill_planner::cutter::ShankCylinder;
use bonemill_planner::plan::{Need, Sha256, is_prosthesis};
use bonemill_planner::show::{
    self, ARROW_MM_PER_N, Moment, PAINTS, PLANES, Plot, Show, ShownBody, ShownFrame, Slice, Surface,
};
use nalgebra::{Rotation3, UnitQuaternion};
use rerun::blueprint::components::{Corner2D, PanelState, PlayState};
use rerun::blueprint::{
    Blueprint, BlueprintActivation, BlueprintPanel, ContainerLike, Horizontal, SelectionPanel, Spatial2DView,
    Spatial3DView, Tabs, TextDocumentView, TextLogView, TimePanel, TimeSeriesView, Vertical,
};
use rerun::datatypes::{TimeInt, TimeRange, TimeRangeBoundary};
use rerun::external::re_sdk_types::blueprint::archetypes::{EyeControls3D, PlotLegend, ScalarAxis, TimeAxis};
use rerun::{Color, EntityPath, RecordingStream, RecordingStreamBuilder, TimeColumn};

use crate::args::ViewArgs;
use crate::follow::LogTail;
use crate::outcome::Outcome;

/// Name of the application in the viewer.
const APPLICATION: &str = "bonemill";
/// Name of the time line.
const TIME: &str = "time";
/// The time line of a run that is followed.
const RUN_TIME: &str = "run";
/// How often its log is looked at.
const FOLLOW_PERIOD: Duration = Duration::from_millis(100);
/// How much of the way that a run came is shown, logged steps: 20 s.
const WAY_POINTS: usize = 2000;
/// Number of times at which target and slices are updated.
const SLICE_MOMENTS: usize = 80;
/// Number of times at which tool and arm are updated.
const MOTION_MOMENTS: usize = 4000;
/// Colour of the target in 3-D.
const BONE_COLOUR: [u8; 3] = [226, 201, 160];

pub fn run(args: &ViewArgs, progress: &dyn Progress) -> anyhow::Result<Outcome> {
    if is_prosthesis(&args.folder.plan).is_ok() {
        return prosthesis::run(args, progress);
    }
    let stages = ["read plan", "read images", "scene", "removal", "draw", "write drawing", "write"];
    progress.expect(&stages.map(|name| (name, 1)));
    progress.stage("read plan");
    let plan = args.folder.load(Need::Unchanged)?;
    let show = Show::read(&plan, progress)?;
    // a log of another plan is refused before anything is drawn
    let tail = args.follow.as_deref().map(|log| {
        let digest = Sha256::of_file(&plan.dir.join("trajectory.csv"))?;
        LogTail::open(log, &digest.to_string())
    });
    let tail = tail.transpose()?;
    let stream = open(args.save.as_deref())?;
    let frames = draw(&stream, &show, tail.is_some(), progress)?;
    if let Some(tail) = tail {
        progress.stage("follow the run");
        follow(&stream, &show, tail, frames)?;
    }
    progress.stage("write");
    let drawn = if show.images().is_some() {
        ""
    } else {
        ", without target, structures and slices: images are missing"
    };
    finish(&stream, args.save.as_deref(), drawn)
}

/// Waits until everything is taken, and says where it is and what is not `drawn`.
fn finish(stream: &RecordingStream, save: Option<&Path>, drawn: &str) -> anyhow::Result<Outcome> {
    stream.flush_blocking().context("the viewer or the file did not take the drawing")?;
    Ok(match save {
        Some(path) => {
            let bytes =
                std::fs::metadata(path).with_context(|| format!("cannot find {}", path.display()))?.len();
            let what = format!("{:.1} MB{drawn}; open it with: rerun FILE", bytes as f64 / 1e6);
            Outcome::written("view", path, &what)
        }
        None => Outcome::text("view", format!("opened in the rerun viewer{drawn}\n")),
    })
}

fn open(save: Option<&Path>) -> anyhow::Result<RecordingStream> {
    let builder = RecordingStreamBuilder::new(APPLICATION);
    match save {
        Some(path) => builder.save(path).with_context(|| format!("cannot write {}", path.display())),
        None => builder.spawn().context(
            "cannot open the viewer: install rerun 0.36.3 (pip install rerun-sdk==0.36.3), or write a file with --save",
        ),
    }
}

/// Draws everything but, where a run is followed, the bone at the times that the run has not come to: these frames are given back.
fn draw(
    stream: &RecordingStream,
    show: &Show,
    is_followed: bool,
    progress: &dyn Progress,
) -> anyhow::Result<Vec<ShownFrame>> {
    progress.stage("draw");
    stream.log_static("scene", &rerun::ViewCoordinates::RIGHT_HAND_Z_UP())?;
    let moments = show.moments(MOTION_MOMENTS)?;
    let plots = show.plots(&moments);
    // first, so that the viewer stops at the beginning before there is anything to play
    layout(stream, show, &plots, is_followed)?;
    structures(stream, show)?;
    if let Some(corridor) = show.corridor()? {
        stream.log_static("scene/corridor", &mesh(corridor, show::CUT_COLOUR, 60))?;
    }
    path(stream, show)?;
    motion(stream, show, &moments)?;
    let frames = show.frames(&moments, SLICE_MOMENTS);
    progress.stage("write drawing");
    curves(stream, &plots)?;
    stream.log_static("about", &rerun::TextDocument::from_markdown(show.about()))?;
    if is_followed {
        return Ok(frames);
    }
    let count = frames.len();
    for (n, frame) in frames.into_iter().enumerate() {
        stream.set_duration_secs(TIME, frame.time_s);
        bone(stream, show, frame)?;
        progress.advance(n, count);
    }
    stream.reset_time();
    Ok(Vec::new())
}

/// Target and slices at the stream's time.
fn bone(stream: &RecordingStream, show: &Show, frame: ShownFrame) -> anyhow::Result<()> {
    stream.log("scene/target", &mesh(frame.target, BONE_COLOUR, 150))?; // the path shows through
    show.images().map_or(Ok(()), |images| slices(stream, images.pixel_mm(), frame.slices))
}

/// Shows a run on its own time line while its log grows, until the run has ended: the tool where the arm has it, the last of its way,
/// how far it is off its path, and the bone as the plan has it at the place that was reached.
fn follow(
    stream: &RecordingStream,
    show: &Show,
    mut tail: LogTail,
    frames: Vec<ShownFrame>,
) -> anyhow::Result<()> {
    let work_from_base = show.work_from_base();
    let plan_s = &show.plan().trajectory.time_s;
    let mut frames = frames.into_iter().peekable();
    let mut way: Vec<[f32; 3]> = Vec::new();
    loop {
        let news = tail.news()?;
        for step in &news.steps {
            // a log has six columns, whatever the arm
            let Some(q) = step.actual.as_ref().and_then(|q| q.get(..show.plan().arm.dof())) else { continue };
            stream.set_duration_secs(RUN_TIME, step.time_s);
            let tool = work_from_base * show.plan().arm.burr(q)?;
            way.push(single(&Point::from_coords(tool.translation_mm)));
            let pose =
                rerun::Transform3D::from_translation_rotation(way[way.len() - 1], quaternion(&tool.rotation));
            stream.log("scene/tool", &pose)?;
            if let Some(off_mm) = step.off_mm {
                stream.log("plots/run/off_mm", &rerun::Scalars::new([off_mm]))?;
            }
            let reached_s = plan_s.get(step.reached_row as usize).copied().unwrap_or(f64::INFINITY);
            let mut reached = None;
            while let Some(frame) = frames.next_if(|frame| frame.time_s <= reached_s) {
                reached = Some(frame);
            }
            if let Some(frame) = reached {
                bone(stream, show, frame)?;
            }
        }
        way.drain(..way.len().saturating_sub(WAY_POINTS));
        if !news.steps.is_empty() {
            let line = rerun::LineStrips3D::new([way.as_slice()])
                .with_colors([Color::from_rgb(255, 80, 200)])
                .with_radii([rerun::Radius::new_ui_points(1.5)]);
            stream.log("scene/way", &line)?;
        }
        for (time_s, said) in &news.events {
            stream.set_duration_secs(RUN_TIME, *time_s);
            stream.log("run", &rerun::TextLog::new(said.as_str()))?;
        }
        if news.ended() {
            return Ok(());
        }
        std::thread::sleep(FOLLOW_PERIOD);
    }
}

fn colour([r, g, b]: [u8; 3]) -> Color {
    Color::from_rgb(r, g, b)
}

fn single(p: &Point<Work>) -> [f32; 3] {
    [p.x() as f32, p.y() as f32, p.z() as f32]
}

fn quaternion(turn: &Rotation3<f64>) -> rerun::Quaternion {
    let q = UnitQuaternion::from_rotation_matrix(turn);
    rerun::Quaternion::from_xyzw([q.i, q.j, q.k, q.w].map(|c| c as f32))
}

/// A part of the shank or of a holder, in the tool's frame.
fn cylinder(part: &ShankCylinder) -> rerun::Cylinders3D {
    let length = (part.to_mm - part.from_mm) as f32;
    rerun::Cylinders3D::from_lengths_and_radii([length], [part.radius_mm as f32])
        .with_centers([[0.0, 0.0, (0.5 * (part.from_mm + part.to_mm)) as f32]])
        .with_colors([Color::from_rgb(170, 176, 186)])
        .with_fill_mode(rerun::FillMode::Solid)
}

/// A surface of one colour; it is transparent for `alpha` below 255.
fn mesh(surface: Surface, [r, g, b]: [u8; 3], alpha: u8) -> rerun::Mesh3D {
    rerun::Mesh3D::new(surface.vertices)
        .with_vertex_normals(surface.normals)
        .with_triangle_indices(
            surface.triangles.into_iter().map(|[a, b, c]| rerun::TriangleIndices::from([a, b, c])),
        )
        .with_albedo_factor(rerun::Rgba32::from_unmultiplied_rgba(r, g, b, alpha))
}

/// A structure's name in a column beside the bone, with a line to it, so that names do not cover each other.
fn label(stream: &RecordingStream, entity: &str, body: &ShownBody) -> anyhow::Result<()> {
    let point = rerun::Points3D::new([body.name_at])
        .with_labels([body.name.as_str()])
        .with_radii([0.05])
        .with_colors([colour(show::light(body.colour))]);
    stream.log_static(format!("{entity}/name"), &point)?;
    let line = rerun::LineStrips3D::new([body.leader])
        .with_colors([colour(body.colour)])
        .with_radii([rerun::Radius::new_ui_points(0.7)]);
    stream.log_static(format!("{entity}/leader"), &line)?;
    Ok(())
}

fn structures(stream: &RecordingStream, show: &Show) -> anyhow::Result<()> {
    let opaque = |tint: [u8; 3]| rerun::Rgba32::from(colour(tint).0);
    let mut classes = vec![
        (u16::from(show::NOTHING), "elsewhere", rerun::Rgba32::TRANSPARENT),
        (u16::from(show::TARGET), "target, still there", opaque(show::TARGET_COLOUR)),
        (u16::from(show::CUT), "cut away", opaque([0, 0, 0])),
    ];
    let codes = u16::from(show::FIRST_STRUCTURE)..;
    classes
        .extend(codes.zip(show.structure_colours()).map(|(code, (name, tint))| (code, name, opaque(tint))));
    stream.log_static("slices", &rerun::AnnotationContext::new(classes))?;
    for body in show.bodies()? {
        let entity = format!("scene/structures/{}", EntityPath::from_single_string(body.name.clone()));
        label(stream, &entity, &body)?;
        stream.log_static(format!("{entity}/clearance"), &mesh(body.shell, body.colour, 40))?;
        let alpha = if body.large { 100 } else { 255 };
        stream.log_static(format!("{entity}/surface"), &mesh(body.surface, body.colour, alpha))?;
    }
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

/// Consecutive moves of one colour as one strip; a move has the colour of the waypoint at which it ends.
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

/// Tool, force and arm at every moment.
fn motion(stream: &RecordingStream, show: &Show, moments: &[Moment]) -> anyhow::Result<()> {
    let tool = show.tool();
    stream.log_static("scene/tool/cutter", &mesh(tool.cutter.clone(), [235, 235, 240], 255))?;
    for (n, (cylinder, is_thick)) in tool.shank.iter().enumerate() {
        // a part thicker than the cutter stays outside the bone and would hide it, so only the arm's view shows it
        let part = if *is_thick { "handpiece" } else { "shank" };
        stream.log_static(format!("scene/tool/{part}/{n}"), &self::cylinder(cylinder))?;
    }

    let times = || [TimeColumn::new_duration_secs(TIME, moments.iter().map(|m| m.time_s))];
    let translations = moments.iter().map(|m| single(&Point::from_coords(m.tool.translation_mm)));
    let quaternions = moments.iter().map(|m| quaternion(&m.tool.rotation));
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

/// The slices through the tool's origin, overlaid with target, structures and the cutter's outline.
fn slices(stream: &RecordingStream, pixel_mm: f64, drawn: [(Slice, Vec<[f32; 2]>); 3]) -> anyhow::Result<()> {
    for ((slice, outline), name) in drawn.into_iter().zip(SLICE_NAMES) {
        let size = [slice.width as u32, slice.height as u32];
        stream.log(format!("slices/{name}/ct"), &rerun::Image::from_l8(slice.grey, size))?;
        let format = rerun::components::ImageFormat::from(rerun::datatypes::ImageFormat::segmentation(
            size,
            rerun::ChannelDatatype::U8,
        ));
        let labels = rerun::SegmentationImage::new(slice.code, format).with_opacity(0.35);
        stream.log(format!("slices/{name}/labels"), &labels)?;
        let outline = rerun::LineStrips2D::new([outline])
            .with_colors([Color::from_rgb(255, 255, 255)])
            .with_radii([rerun::Radius::new_ui_points(1.0)]);
        stream.log(format!("slices/{name}/cutter"), &outline)?;
        let bar_y = size[1] as f32 * 0.9;
        let bar_px = (5.0 / pixel_mm) as f32;
        let bar = rerun::LineStrips2D::new([[[3.0, bar_y], [3.0 + bar_px, bar_y]]])
            .with_labels(["5 mm"])
            .with_colors([Color::from_rgb(255, 255, 255)]);
        stream.log_static(format!("slices/{name}/scale"), &bar)?;
    }
    Ok(())
}

/// Entities of the planes of [`PLANES`].
const SLICE_NAMES: [&str; 3] = ["x_y", "x_z", "y_z"];

/// Curves over time.
fn curves(stream: &RecordingStream, plots: &[Plot]) -> anyhow::Result<()> {
    for plot in plots {
        for curve in &plot.curves {
            let entity = format!("plots/{}/{}", plot.entity, curve.entity);
            let look = rerun::SeriesLines::new()
                .with_names([curve.name.as_str()])
                .with_widths([1.5])
                .with_colors([colour(curve.colour)]);
            stream.log_static(entity.as_str(), &look)?;
            let times = TimeColumn::new_duration_secs(TIME, curve.time_s.iter().copied());
            let values = rerun::Scalars::new(curve.values.iter().copied());
            stream.send_columns(entity, [times], values.columns_of_unit_batches()?)?;
        }
    }
    Ok(())
}

/// The initial layout: path and bone large, slices beside them, curves below. A run that is followed shows its own curves, messages and
/// newest time.
fn layout(stream: &RecordingStream, show: &Show, plots: &[Plot], is_followed: bool) -> anyhow::Result<()> {
    let space = |name: &str, contents: &[&str]| {
        let contents = contents.iter().map(|c| (*c).to_owned());
        ContainerLike::from(Spatial3DView::new(name).with_origin("scene").with_contents(contents))
    };
    let mut tabs = Vec::new();
    for paint in PAINTS {
        if paint.range(show.plan()).is_some() {
            let shown = format!("+ $origin/path/{}", paint.entity());
            let hidden = ["- $origin/path/**", "- $origin/arm/**", "- $origin/tool/handpiece/**"];
            let contents = [&["+ $origin/**"], &hidden[..], &[shown.as_str()]].concat();
            tabs.push(space(&format!("path by {}", paint.name), &contents));
        }
    }
    tabs.push(space("arm", &["+ $origin/**", "- $origin/path/**"]));
    let slices = PLANES.iter().zip(SLICE_NAMES).map(|(plane, name)| {
        ContainerLike::from(Spatial2DView::new(plane.name).with_origin(format!("slices/{name}")))
    });
    let below: Vec<_> = plots
        .iter()
        .map(|plot| {
            let view = TimeSeriesView::new(plot.title.as_str());
            ContainerLike::from(view.with_origin(format!("plots/{}", plot.entity)))
        })
        .collect();
    let of_run = [
        ContainerLike::from(TimeSeriesView::new("off the path [mm]").with_origin("plots/run")),
        ContainerLike::from(TextLogView::new("the run").with_origin("run")),
    ];
    let eyes: Vec<_> = tabs.iter().filter_map(path_of).collect();
    let axes: Vec<_> = if is_followed { Vec::new() } else { below.iter().filter_map(path_of).collect() };
    tabs.push(ContainerLike::from(TextDocumentView::new("about").with_origin("about")));
    let above = Horizontal::new([Tabs::new(tabs).into(), Vertical::new(slices).into()])
        .with_column_shares([1.7, 1.0]);
    let below = Horizontal::new(if is_followed { of_run.into() } else { below });
    let views = Vertical::new([above.into(), below.into()]).with_row_shares([2.8, 1.0]);
    let (line, state) =
        if is_followed { (RUN_TIME, PlayState::Following) } else { (TIME, PlayState::Paused) };
    let blueprint = panels(Blueprint::new(views), line, state);
    send(stream, &blueprint, |blueprint| {
        let [position, target] = show.eye();
        for view in &eyes {
            let eye = EyeControls3D::new().with_position(position).with_look_target(target);
            blueprint.log(format!("{view}/EyeControls3D"), &eye)?;
        }
        axes.iter().zip(plots).try_for_each(|(view, plot)| axes_of(blueprint, view, plot))
    })
}

/// A blueprint with its panels collapsed, on a time line.
fn panels(blueprint: Blueprint, line: &str, state: PlayState) -> Blueprint {
    blueprint
        .with_blueprint_panel(BlueprintPanel::from_state(PanelState::Collapsed))
        .with_selection_panel(SelectionPanel::from_state(PanelState::Collapsed))
        .with_time_panel(
            TimePanel::new()
                .with_state(PanelState::Collapsed)
                .with_timeline(line)
                .with_play_state(state)
                .with_playback_speed(20.0),
        )
}

/// Path of a view's properties in a blueprint.
fn path_of(view: &ContainerLike) -> Option<EntityPath> {
    match view {
        ContainerLike::View(view) => Some(view.blueprint_path()),
        _ => None,
    }
}

/// Sets the ends of a plot's axes, and its legend.
fn axes_of(blueprint: &RecordingStream, view: &EntityPath, plot: &Plot) -> anyhow::Result<()> {
    let at = |s: f64| TimeInt((s * 1e9) as i64).into();
    let seconds = TimeRange {
        start: TimeRangeBoundary::Absolute(at(plot.time_s[0])),
        end: TimeRangeBoundary::Absolute(at(plot.time_s[1])),
    };
    blueprint.log(format!("{view}/TimeAxis"), &TimeAxis::new().with_view_range(seconds))?;
    blueprint.log(format!("{view}/ScalarAxis"), &ScalarAxis::new().with_range(plot.values))?;
    let legend = PlotLegend::new().with_corner(Corner2D::RightTop).with_visible(plot.legend());
    blueprint.log(format!("{view}/PlotLegend"), &legend)?;
    Ok(())
}

/// Sends a blueprint with the additions of `more`. rerun's Rust blueprints cannot set a plot's axes and legend or the camera, but
/// these are entities below the view's path and can be added as such.
fn send(
    stream: &RecordingStream,
    blueprint: &Blueprint,
    more: impl FnOnce(&RecordingStream) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    let (scratch, taken) = RecordingStreamBuilder::new(APPLICATION).memory()?;
    blueprint.send(&scratch, BlueprintActivation::default())?;
    let mut messages = taken.take();
    messages.retain(|m| m.store_id().is_blueprint());
    // the last message activates the blueprint, which must be complete by then
    let last = messages.pop().context("the blueprint is empty")?;
    messages.into_iter().for_each(|m| stream.record_msg(m));
    let (addition, taken) = RecordingStreamBuilder::from_store_id(last.store_id()).memory()?;
    addition.set_time_sequence("blueprint", 0);
    more(&addition)?;
    taken.take().into_iter().for_each(|m| stream.record_msg(m));
    stream.record_msg(last);
    Ok(())
}
