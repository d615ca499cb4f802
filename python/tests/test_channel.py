"""Drilled and reamed channels through the same functions as a milled cavity."""

from pathlib import Path

import numpy as np
import pytest

import bonemill


@pytest.mark.parametrize("kind", ["tibia", "glenoid"])
def test_a_channel_is_planned_saved_verified_and_simulated(kind: str, tmp_path: Path) -> None:
    case = bonemill.phantom(kind, tmp_path / "bone")
    plan = bonemill.plan(case)
    assert plan.shortfalls == []
    assert plan.metrics["removed_bone_mm3"] > 10
    # what is in memory is what the files say
    folder = plan.save(tmp_path / "plan")
    stored = bonemill.Plan.load(folder)
    for name in ("waypoints", "forces", "trajectory"):
        made, read = getattr(plan, name), getattr(stored, name)
        assert made.dtype == read.dtype and len(made) == len(read) and len(made) > 0
        for column in made.dtype.names:
            np.testing.assert_array_equal(made[column], read[column])
    assert plan.metrics == stored.metrics
    # the replay of the plan in memory and of the one in its folder are the same
    first, second = bonemill.simulate(plan), bonemill.simulate(stored)
    np.testing.assert_array_equal(first.rows["fz_n"], second.rows["fz_n"])
    assert first.rows["torque_nmm"].max() > 0.5
    removed = first.figures["simulated_removed"]["bone"]["mm3"]
    assert removed == pytest.approx(plan.metrics["removed_bone_mm3"], rel=2e-3)
    assert bonemill.verify(stored).passed


def test_a_channel_that_cannot_be_drilled_says_why(tmp_path: Path) -> None:
    bonemill.phantom("tibia", tmp_path / "bone")
    text = (tmp_path / "bone" / "case.toml").read_text().replace("web_mm = 0.15", "web_mm = 1.2")
    (tmp_path / "bone" / "thick.toml").write_text(text)
    with pytest.raises(bonemill.BonemillError, match="the web leaves no lip"):
        bonemill.plan(bonemill.Case.load(tmp_path / "bone" / "thick.toml"))
