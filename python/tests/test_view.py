"""The plan in rerun: a file is written that rerun's own reader opens, with every entity in it."""

import subprocess
import sys
import warnings
from pathlib import Path

import pytest

import bonemill

pytest.importorskip("rerun")

ENTITIES = [
    "/scene/target",
    "/scene/structures/facial_nerve/surface",
    "/scene/structures/facial_nerve/clearance",
    "/scene/path/force_toward_structures",
    "/scene/path/speed",
    "/scene/tool/cutter",
    "/scene/force",
    "/scene/arm",
    "/slices/x_y/ct",
    "/slices/y_z/labels",
    "/plots/force/toward",
    "/plots/distance/clearance",
    "/plots/joints_turning/q4",
    "/about",
]


def test_a_recording_holds_everything(planned: bonemill.Plan, tmp_path: Path) -> None:
    path = tmp_path / "plan.rrd"
    stages: list[str] = []
    with warnings.catch_warnings():
        # rerun warns where it drops what it does not understand
        warnings.simplefilter("error")
        bonemill.view(planned, save=path, progress=lambda stage, done, of: stages.append(stage))
    assert path.stat().st_size > 100_000 and "scene" in stages
    call = [sys.executable, "-m", "rerun", "rrd", "print", str(path)]
    said = subprocess.run(call, capture_output=True, text=True, check=True).stdout
    for entity in ENTITIES:
        assert entity in said, entity


def test_without_rerun_it_says_what_is_missing(planned: bonemill.Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(bonemill.BonemillError, match="rerun-sdk"):
        bonemill.view(planned)


def test_a_folder_that_is_missing_is_named(planned: bonemill.Plan, tmp_path: Path) -> None:
    with pytest.raises(bonemill.BonemillError, match=r"cannot write .*x\.rrd: there is no folder .*missing"):
        bonemill.view(planned, save=tmp_path / "missing" / "x.rrd")


def test_a_plan_without_its_images_is_drawn_without_slices(own_block: bonemill.Case, tmp_path: Path) -> None:
    saved = bonemill.plan(own_block).save(tmp_path / "plan")
    own_block.path.parent.rename(tmp_path / "away")
    path = tmp_path / "plan.rrd"
    bonemill.view(bonemill.Plan.load(saved), save=path)
    call = [sys.executable, "-m", "rerun", "rrd", "print", str(path)]
    said = subprocess.run(call, capture_output=True, text=True, check=True).stdout
    assert "/scene/path/speed" in said and "/scene/tool/cutter" in said and "/slices/x_y/ct" not in said
