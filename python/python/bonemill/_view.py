"""A plan in the rerun viewer, from Python: the same drawing as ``bonemill view``."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from . import _native
from ._errors import BonemillError
from ._judge import _on_disk
from ._plan import Plan, Progress, _as_plan

_TIME = "time"
_SLICES = ("x_y", "x_z", "y_z")
_TARGET, _BONE = (80, 255, 140), (226, 201, 160)


def view(
    plan: Plan | str | os.PathLike[str],
    *,
    save: str | os.PathLike[str] | None = None,
    progress: Progress | None = None,
) -> None:
    """Opens the plan in the rerun viewer, or writes a file for it. Needs ``rerun-sdk`` (the extra ``view``).

    Args:
        plan: the plan, or its folder; without its images, target, structures and slices are not drawn, and the page ``about`` says so.
        save: write this ``.rrd`` file instead of opening the viewer; its folder must exist.
        progress: told ``(stage, done, of)``.

    Raises:
        BonemillError: rerun-sdk is not installed, the file cannot be written, or the images cannot be read.
    """
    plan = _as_plan(plan)
    try:
        import rerun as rr
    except ImportError as error:
        raise BonemillError("view needs rerun-sdk: pip install rerun-sdk==0.36.3 (the extra `view`)") from error
    if save is not None and not Path(save).absolute().parent.is_dir():
        raise BonemillError(f"cannot write {save}: there is no folder {Path(save).absolute().parent}; make it first")
    with _on_disk(plan, False) as saved:
        drawn = _native.show(plan._made, saved, 4000, 80, progress)
    recording = rr.RecordingStream("bonemill")
    try:
        recording.spawn() if save is None else recording.save(os.fspath(save))
    except RuntimeError as error:
        raise BonemillError(f"cannot {'open the viewer' if save is None else f'write {save}'}\n  because: {error}") from error
    # first, so that the viewer is told to wait at the beginning before it has anything to play
    recording.send_blueprint(_layout(drawn))
    _scene(rr, recording, drawn)
    _motion(rr, recording, drawn)
    for time_s, target, slices in drawn["frames"]:
        recording.set_time(_TIME, duration=time_s)
        recording.log("scene/target", _mesh(rr, target, _BONE, 150))
        for name, found in zip(_SLICES, slices):
            _slice(rr, recording, drawn, name, found)
    recording.reset_time()
    _curves(rr, recording, drawn["plots"])
    recording.log("about", rr.TextDocument(drawn["about"], media_type="text/markdown"), static=True)
    recording.flush()


def _mesh(rr: Any, surface: dict[str, Any], colour: tuple[int, int, int], alpha: int) -> Any:
    return rr.Mesh3D(
        vertex_positions=surface["vertices"],
        vertex_normals=surface["normals"],
        triangle_indices=surface["triangles"],
        albedo_factor=(*colour, alpha),
    )


def _scene(rr: Any, recording: Any, drawn: dict[str, Any]) -> None:
    recording.log("scene", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    classes = [(0, "elsewhere", (0, 0, 0, 0)), (1, "target, still there", _TARGET), (2, "cut away", (0, 0, 0))]
    classes += [(3 + n, name, tuple(tint)) for n, (name, tint) in enumerate(drawn["structures"])]
    recording.log("slices", rr.AnnotationContext(classes), static=True)
    for body in drawn["bodies"]:
        colour = tuple(body["colour"])
        entity = f"scene/structures/{rr.escape_entity_path_part(body['name'])}"
        label = rr.Points3D([body["name_at"]], labels=[body["name"]], radii=0.05, colors=tuple(body["name_colour"]))
        recording.log(f"{entity}/name", label, static=True)
        leader = rr.LineStrips3D([body["leader"]], colors=colour, radii=rr.Radius.ui_points(0.7))
        recording.log(f"{entity}/leader", leader, static=True)
        recording.log(f"{entity}/clearance", _mesh(rr, body["shell"], colour, 40), static=True)
        alpha = 100 if body["large"] else 255
        recording.log(f"{entity}/surface", _mesh(rr, body["surface"], colour, alpha), static=True)
    if drawn["corridor"] is not None:
        recording.log("scene/corridor", _mesh(rr, drawn["corridor"], tuple(drawn["corridor_colour"]), 60), static=True)
    for name, colours in drawn["paints"]:
        # consecutive moves of one colour as one strip
        ends = np.flatnonzero((colours[2:] != colours[1:-1]).any(axis=1)) + 2
        bounds = np.r_[1, ends, len(colours)]
        strips = [drawn["path"][a - 1 : b] for a, b in zip(bounds[:-1], bounds[1:])]
        lines = rr.LineStrips3D(strips, colors=colours[bounds[:-1]], radii=rr.Radius.ui_points(1.2))
        recording.log(f"scene/path/{name.replace(' ', '_')}", lines, static=True)


def _motion(rr: Any, recording: Any, drawn: dict[str, Any]) -> None:
    recording.log("scene/tool/cutter", _mesh(rr, drawn["cutter"], (235, 235, 240), 255), static=True)
    for n, (start, end, radius, is_thick) in enumerate(drawn["shank"]):
        part = "handpiece" if is_thick else "shank"
        cylinder = rr.Cylinders3D(
            lengths=[end - start],
            radii=[radius],
            centers=[(0, 0, (start + end) / 2)],
            colors=(170, 176, 186),
            fill_mode="solid",
        )
        recording.log(f"scene/tool/{part}/{n}", cylinder, static=True)
    times = [rr.TimeColumn(_TIME, duration=drawn["time_s"])]
    poses = rr.Transform3D.columns(translation=drawn["at"], quaternion=drawn["turn"])
    recording.send_columns("scene/tool", indexes=times, columns=poses)
    arrows = rr.Arrows3D.columns(vectors=drawn["force"] * drawn["arrow_mm_per_n"], origins=drawn["at"])
    recording.send_columns("scene/force", indexes=times, columns=arrows)
    recording.log("scene/force", rr.Arrows3D.from_fields(colors=(255, 60, 60), radii=0.25), static=True)
    recording.send_columns("scene/arm", indexes=times, columns=rr.LineStrips3D.columns(strips=drawn["links"]))
    recording.log("scene/arm", rr.LineStrips3D.from_fields(colors=(120, 140, 170), radii=1.5), static=True)


def _slice(rr: Any, recording: Any, drawn: dict[str, Any], name: str, found: dict[str, Any]) -> None:
    recording.log(f"slices/{name}/ct", rr.Image(found["grey"]))
    recording.log(f"slices/{name}/labels", rr.SegmentationImage(found["code"], opacity=0.35))
    outline = rr.LineStrips2D([found["outline"]], colors=(255, 255, 255), radii=rr.Radius.ui_points(1.0))
    recording.log(f"slices/{name}/cutter", outline)
    low = 0.9 * found["grey"].shape[0]
    bar = rr.LineStrips2D([[(3, low), (3 + 5.0 / drawn["pixel_mm"], low)]], labels=["5 mm"], colors=(255, 255, 255))
    recording.log(f"slices/{name}/scale", bar, static=True)


def _curves(rr: Any, recording: Any, plots: list[dict[str, Any]]) -> None:
    for plot in plots:
        for part, name, colour, times, values in plot["curves"]:
            entity = f"plots/{plot['entity']}/{part}"
            recording.log(entity, rr.SeriesLines(names=[name], widths=[1.5], colors=[tuple(colour)]), static=True)
            column = [rr.TimeColumn(_TIME, duration=times)]
            recording.send_columns(entity, indexes=column, columns=rr.Scalars.columns(scalars=values))


def _layout(drawn: dict[str, Any]) -> Any:
    import rerun.blueprint as rrb

    position, target = drawn["eye"]
    eye = rrb.EyeControls3D(position=position, look_target=target)

    def space(name: str, contents: list[str]) -> Any:
        return rrb.Spatial3DView(name=name, origin="scene", contents=contents, eye_controls=eye)

    tabs = []
    for name, _ in drawn["paints"]:
        shown = f"+ $origin/path/{name.replace(' ', '_')}"
        hidden = ["- $origin/path/**", "- $origin/arm/**", "- $origin/tool/handpiece/**"]
        tabs.append(space(f"path by {name}", ["+ $origin/**", *hidden, shown]))
    tabs.append(space("arm", ["+ $origin/**", "- $origin/path/**"]))
    tabs.append(rrb.TextDocumentView(name="about", origin="about"))
    slices = [rrb.Spatial2DView(name=p, origin=f"slices/{s}") for p, s in zip(drawn["planes"], _SLICES)]
    plots = [_plot(rrb, plot) for plot in drawn["plots"]]
    above = rrb.Horizontal(rrb.Tabs(*tabs), rrb.Vertical(*slices), column_shares=[1.7, 1.0])
    return rrb.Blueprint(
        rrb.Vertical(above, rrb.Horizontal(*plots), row_shares=[2.8, 1.0]),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=_TIME, play_state="paused", playback_speed=20.0),
    )


def _plot(rrb: Any, plot: dict[str, Any]) -> Any:
    """A plot whose axes leave room for the curves' names."""
    start, end = (rrb.TimeRangeBoundary.absolute(seconds=s) for s in plot["time_s"])
    return rrb.TimeSeriesView(
        name=plot["title"],
        origin=f"plots/{plot['entity']}",
        axis_x=rrb.TimeAxis(view_range=rrb.TimeRange(start=start, end=end)),
        axis_y=rrb.ScalarAxis(range=tuple(plot["values"])),
        plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop, visible=plot["legend"]),
    )
