"""The package and a user's script pass a strict type checker; a wrong call does not."""

import subprocess
import sys
from pathlib import Path

import pytest

import bonemill

pytest.importorskip("mypy")

GOOD = """
import numpy as np
import bonemill
case = bonemill.Case.load("case.toml")
plan = bonemill.plan(case, progress=lambda stage, done, of: print(stage), threads=2)
total: float = plan.metrics["total_time_s"]
distance, nearest = bonemill.distance_transform(np.zeros((2, 2, 2), bool), spacing=0.5)
flat = distance.ravel() + 1
tool: bonemill.Tool = {"radius": 2.5, "blades": 8}
force = bonemill.burr_force(
    1.0, center=(0, 0, 0), axis=(0, 0, 1), velocity=(1, 0, 0), rpm=6e4, tool=tool,
    material={"K": (1, 1, 1), "rho_ref": 0.8},
)
pose = bonemill.Arm.load("bone-attached").fk([0, 0, 0, 0])
"""


def mypy(*arguments: str, cwd: Path) -> "subprocess.CompletedProcess[str]":
    call = [sys.executable, "-m", "mypy", "--strict", *arguments]
    return subprocess.run(call, cwd=cwd, capture_output=True, text=True, check=False)


def test_a_users_script_is_typed(tmp_path: Path) -> None:
    (tmp_path / "good.py").write_text(GOOD)
    done = mypy("good.py", cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    (tmp_path / "bad.py").write_text("import bonemill\nbonemill.plan(3)\nbonemill.Plan.load('p').metric\n")
    assert mypy("bad.py", cwd=tmp_path).stdout.count("error:") == 2


def test_the_package_is_typed(tmp_path: Path) -> None:
    project = Path(__file__).resolve().parents[1] / "pyproject.toml"
    done = mypy("--config-file", str(project), "-p", "bonemill", cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert (Path(bonemill.__file__).parent / "py.typed").exists()
