//! A finished prosthesis in the viewer: the part coloured by deviation, its block, the toolpath by side and kind, the cutter over time.

use bonemill_planner::Progress;
use bonemill_planner::show::Surface;
use bonemill_prosthesis::machining::{Kind, Move, Side};
use bonemill_prosthesis::show::{ShownProsthesis, turn};
use nalgebra::Vector3;
use rerun::blueprint::components::PlayState;
use rerun::blueprint::{
    Blueprint, BlueprintActivation, ContainerLike, Horizontal, Spatial3DView, Tabs, TextDocumentView,
    TimeSeriesView, Vertical,
};
use rerun::{RecordingStream, TimeColumn};

use super::{TIME, colour, cylinder, mesh, open, panels, quaternion};
use crate::args::ViewArgs;
use crate::outcome::Outcome;

/// The colour of a kind of moves.
fn tint(kind: Kind) -> [u8; 3] {
    match kind {
        Kind::Rough => [70, 130, 200],
        Kind::Finish => [46, 160, 90],
        Kind::Contour => [200, 60, 60],
        Kind::Link | Kind::Retract => [190, 190, 190],
    }
}

/// Facets around the cutter.
const FACETS: usize = 48;

pub fn run(args: &ViewArgs, progress: &dyn Progress) -> anyhow::Result<Outcome> {
    if let Some(log) = &args.follow {
        anyhow::bail!("--follow {}: runs of a prosthesis' program are not logged", log.display());
    }
    let shown = ShownProsthesis::read(&args.folder.plan, progress)?;
    progress.stage("draw");
    let stream = open(args.save.as_deref())?;
    layout(&stream)?;
    part(&stream, &shown)?;
    paths(&stream, &shown.moves)?;
    motion(&stream, &shown)?;
    stream.log_static("about", &rerun::TextDocument::from_markdown(about(&shown)))?;
    super::finish(&stream, args.save.as_deref(), "")
}

/// Part and block.
fn part(stream: &RecordingStream, shown: &ShownProsthesis) -> anyhow::Result<()> {
    stream.log_static("scene", &rerun::ViewCoordinates::RIGHT_HAND_Z_UP())?;
    let colours = shown.colours.iter().map(|c| colour(*c));
    let surface = mesh(Surface::of(&shown.part), [255; 3], 255).with_vertex_colors(colours);
    stream.log_static("scene/part", &surface)?;
    let block = &shown.record.block;
    let single = |v: Vector3<f64>| v.map(|c| c as f32).into();
    let frame = |low: Vector3<f64>, high: Vector3<f64>| {
        let (low, size): ([f32; 3], [f32; 3]) = (single(low), single(high - low));
        rerun::Boxes3D::from_mins_and_sizes([low], [size]).with_colors([colour([150, 160, 170])])
    };
    stream.log_static("scene/block", &frame(block.low_mm, block.high_mm))?;
    let mut grip = block.high_mm;
    grip.z = block.low_mm.z + block.grip_mm;
    stream.log_static("scene/block/grip", &frame(block.low_mm, grip).with_labels(["grip"]))?;
    Ok(())
}

/// The moves of each side and kind, consecutive ones as one strip.
fn paths(stream: &RecordingStream, moves: &[Move]) -> anyhow::Result<()> {
    for side in Side::ALL {
        for kind in Kind::ALL {
            let mut strips: Vec<Vec<[f32; 3]>> = Vec::new();
            let mut goes_on = false;
            for pair in moves.windows(2) {
                let is_one =
                    pair.iter().all(|m| m.side == side && m.a_rad == pair[0].a_rad) && pair[1].kind == kind;
                let [from, to] = [0, 1].map(|n| pair[n].tip_mm.map(|c| c as f32).into());
                match strips.last_mut() {
                    Some(strip) if is_one && goes_on => strip.push(to),
                    _ if is_one => strips.push(vec![from, to]),
                    _ => {}
                }
                goes_on = is_one;
            }
            if !strips.is_empty() {
                let lines = rerun::LineStrips3D::new(strips)
                    .with_colors([colour(tint(kind))])
                    .with_radii([rerun::Radius::new_ui_points(0.8)]);
                stream.log_static(format!("scene/path/{}/{}", side.name(), kind.name()), &lines)?;
            }
        }
    }
    Ok(())
}

/// Cutter and holder at the end of every move, and the feed.
fn motion(stream: &RecordingStream, shown: &ShownProsthesis) -> anyhow::Result<()> {
    let cutter = mesh(Surface::of(&shown.cutter.mesh(FACETS)), [235, 235, 240], 255);
    stream.log_static("scene/tool/cutter", &cutter)?;
    for (n, part) in shown.holder.iter().enumerate() {
        stream.log_static(format!("scene/tool/holder/{n}"), &cylinder(part))?;
    }
    let moves = &shown.moves;
    let times = || [TimeColumn::new_duration_secs(TIME, moves.iter().map(|m| m.time_s))];
    let at = moves.iter().map(|m| <[f32; 3]>::from(m.tip_mm.map(|c| c as f32)));
    let turns = moves.iter().map(|m| quaternion(&turn(m)));
    let poses = rerun::Transform3D::update_fields().with_many_translation(at).with_many_quaternion(turns);
    stream.send_columns("scene/tool", times(), poses.columns_of_unit_batches()?)?;
    let look = rerun::SeriesLines::new().with_names(["feed"]).with_widths([1.5]);
    stream.log_static("plots/feed", &look)?;
    let feeds = rerun::Scalars::new(moves.iter().map(|m| m.feed_mm_min));
    stream.send_columns("plots/feed", times(), feeds.columns_of_unit_batches()?)?;
    Ok(())
}

/// The legend, Markdown.
fn about(shown: &ShownProsthesis) -> String {
    let record = &shown.record;
    let number = |name: &str, digits: usize| match record.number(name) {
        Some(v) => format!("{v:.digits$}"),
        None => "unknown".to_owned(),
    };
    let mut text = format!(
        "# Prosthesis\n\nBlock {}; bonemill {}; research software, not a medical device. The frame is the block's; mm.\n\n\
         **Part**: grey as asked for, through yellow to red (0.1 mm) where stock stays, blue (0.02 mm) where the program cuts into it.\n\n\
         **Toolpath** by side (A from +y, B from −y, C the outline): blue roughing, green finishing, red contour, grey repositioning.\n\n\
         | | |\n|---|---|\n| deepest gouge | {} mm |\n| thickest uncut | {} mm |\n| machining time | {} s |\n| moves | {} |\n",
        record.block_id,
        record.version,
        number("deepest_gouge_mm", 4),
        number("thickest_uncut_mm", 3),
        number("total_time_s", 0),
        number("moves", 0)
    );
    for problem in record.shortfalls.iter().chain(&record.warnings) {
        text += &format!("\n- {problem}");
    }
    text
}

fn layout(stream: &RecordingStream) -> anyhow::Result<()> {
    let space = |name: &str, more: &[String]| {
        let all = ["+ $origin/**", "- $origin/path/**"].map(String::from);
        let contents = [&all[..], more].concat();
        ContainerLike::from(Spatial3DView::new(name).with_origin("scene").with_contents(contents))
    };
    // repositioning would hide the rest; it can be shown by hand
    let cuts = |side: Side| {
        let cuts = Kind::ALL.into_iter().filter(|kind| kind.cuts());
        cuts.map(|kind| format!("+ $origin/path/{}/{}", side.name(), kind.name())).collect::<Vec<_>>()
    };
    let mut tabs = vec![space("deviation", &[])];
    tabs.extend(Side::ALL.map(|side| space(&format!("side {}", side.name()), &cuts(side))));
    let feed = ContainerLike::from(TimeSeriesView::new("feed [mm/min]").with_origin("plots/feed"));
    let about = ContainerLike::from(TextDocumentView::new("about").with_origin("about"));
    let beside = Vertical::new([about, feed]).with_row_shares([1.6, 1.0]);
    let views = Horizontal::new([Tabs::new(tabs).into(), beside.into()]).with_column_shares([2.2, 1.0]);
    let blueprint = panels(Blueprint::new(views), TIME, PlayState::Paused);
    blueprint.send(stream, BlueprintActivation::default())?;
    Ok(())
}
