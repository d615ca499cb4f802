"""Streaming only what was verified: altered, failed and stale plans are refused, each with its reason."""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import bonemill
from bonemill._verdict import SENTENCE, require_verified
from bonemill.__main__ import main


@pytest.fixture(scope="module")
def judged(ur_planned: bonemill.Plan, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A saved plan with a passed verification beside it; not to be written to."""
    folder = ur_planned.save(tmp_path_factory.mktemp("judged") / "plan", pack=True)
    assert bonemill.verify(bonemill.Plan.load(folder), save=True).passed
    return folder


@pytest.fixture
def own(judged: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(judged, tmp_path / "plan"))


def said(folder: Path, *more: str) -> tuple[int, str]:
    """Exit code of a dry run and what it prints as its error; no arm is needed."""
    import contextlib
    import io

    err = io.StringIO()
    with contextlib.redirect_stderr(err), contextlib.redirect_stdout(io.StringIO()):
        code = main(["stream", str(folder), "--host", "192.0.2.1", "--dry-run", *more])
    return code, err.getvalue()


def test_a_verified_plan_passes_and_names_its_files(judged: Path) -> None:
    files = bonemill.verified(judged)
    assert {"plan.toml", "waypoints.csv", "forces.csv", "trajectory.csv", "robot.urdf", "access.csv"} <= set(files)
    code, err = said(judged, "--slow", "--payload-kg", "1")
    assert code == 0, err


def bump(folder: Path, joint: int = 3, rad: float = 0.02) -> None:
    """A smooth bump of a joint in the middle of the trajectory, within every limit."""
    path = folder / "trajectory.csv"
    lines = path.read_text().splitlines()
    rows = np.array([[float(cell) for cell in line.split(",")] for line in lines[1:]])
    middle, half = len(rows) // 2, min(500, len(rows) // 4)
    shape = 0.5 * (1 + np.cos(np.pi * np.linspace(-1, 1, 2 * half)))
    rows[middle - half : middle + half, 1 + joint] += rad * shape
    path.write_text("\n".join([lines[0], *(",".join(f"{v:.9f}" for v in row) for row in rows)]) + "\n")


def test_a_bump_in_the_trajectory_is_refused_although_every_step_keeps_its_limits(own: Path) -> None:
    bump(own)
    code, err = said(own)
    assert code != 0 and "trajectory.csv is not the file that was verified" in err
    # and a verification of the altered plan fails, so that it is no way around
    assert not bonemill.verify(bonemill.Plan.load(own), save=True).passed
    code, err = said(own)
    assert code != 0 and "the verification failed" in err


@pytest.mark.parametrize("name", ["plan.toml", "waypoints.csv", "forces.csv", "robot.urdf", "access.csv", "case.toml"])
def test_a_change_of_any_file_is_refused(own: Path, name: str) -> None:
    if not (own / name).exists():
        pytest.skip(f"this plan has no {name}")
    (own / name).write_text((own / name).read_text() + "\n")
    with pytest.raises(bonemill.PlanFileError, match=f"{name} is not the file that was verified"):
        bonemill.verified(own)


def test_a_plan_that_nobody_verified_is_refused(own: Path) -> None:
    (own / "verification.toml").unlink()
    code, err = said(own)
    assert code != 0 and "run `bonemill verify` on it first" in err


def test_a_verdict_of_another_plan_is_stale(planned: bonemill.Plan, judged: Path, tmp_path: Path) -> None:
    other = planned.save(tmp_path / "other")
    shutil.copy(judged / "verification.toml", other)
    with pytest.raises(bonemill.PlanFileError, match="plan.toml is not the file that was verified"):
        bonemill.verified(other)


def test_unverified_tells_the_risk_and_asks(own: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bump(own)
    asked: list[str] = []

    def answer(text: str) -> str:
        asked.append(text)
        return SENTENCE

    assert require_verified(own, unverified=True, ask=answer) == {}
    assert "nerve" in capsys.readouterr().err and SENTENCE in asked[0]
    for refusal in ("", "yes", "y"):
        with pytest.raises(bonemill.StreamError, match="not confirmed"):
            require_verified(own, unverified=True, ask=lambda _, refusal=refusal: refusal)
    with pytest.raises(bonemill.StreamError, match="trajectory.csv"):
        require_verified(own)


def test_a_sentence_that_was_typed_before_it_was_asked_for_confirms_nothing(own: Path) -> None:
    (own / "verification.toml").unlink()
    call = [sys.executable, "-m", "bonemill", "stream", str(own), "--dry-run", "--unverified", "--slow", "--payload-kg", "1"]
    done = subprocess.run(call, input=SENTENCE + "\n", capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 2 and "not confirmed" in done.stderr, done.stderr
