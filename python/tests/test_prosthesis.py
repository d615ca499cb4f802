"""A prosthesis from its job file: figures, moves, deviations, the folder; and what is refused."""

from pathlib import Path

import numpy as np
import pytest

import bonemill


def ellipsoid(folder: Path) -> Path:
    """A flat ellipsoid, 16 × 12 × 4 mm, as OBJ, and a coarse job for it."""
    rings, sectors = 12, 24
    points = [(0.0, 0.0, 2.0)]
    for ring in range(1, rings):
        tilt = np.pi * ring / rings
        for sector in range(sectors):
            turn = 2 * np.pi * sector / sectors
            points.append((8 * np.sin(tilt) * np.cos(turn), 6 * np.sin(tilt) * np.sin(turn), 2 * np.cos(tilt)))
    points.append((0.0, 0.0, -2.0))
    faces = []
    for sector in range(sectors):
        after = (sector + 1) % sectors
        faces.append((1, 2 + sector, 2 + after))
        for ring in range(rings - 2):
            a, b = 2 + ring * sectors, 2 + (ring + 1) * sectors
            faces += [(a + sector, b + sector, b + after), (a + sector, b + after, a + after)]
        last = 2 + (rings - 2) * sectors
        faces.append((last + sector, len(points), last + after))
    lines = [f"v {x} {y} {z}" for x, y, z in points] + [f"f {a} {b} {c}" for a, b, c in faces]
    (folder / "part.obj").write_text("\n".join(lines) + "\n")
    job = folder / "job.toml"
    job.write_text('[part]\nstl = "part.obj"\n[tool]\ndiameter_mm = 4\nkind = "ball"\n[process]\nfinishing_step_mm = 0.3\n')
    return job


def test_a_job_becomes_a_folder(tmp_path: Path) -> None:
    job = ellipsoid(tmp_path)
    stages: list[str] = []
    plan = bonemill.prosthesis(job, progress=lambda stage, done, of: stages.append(stage))
    assert stages[0] == "read part" and "prove program" in stages
    assert plan.metrics["deepest_gouge_mm"] <= 0.02
    assert plan.block[0] == "S"
    assert set(plan.moves["side"]) == {"A", "B", "C"}
    assert np.all(np.diff(plan.moves["time_s"]) >= 0)
    assert plan.deviations.shape[1] == 4 and plan.deviations[:, 3].min() >= -0.02
    assert plan.program.startswith("(")
    out = plan.save(tmp_path / "out")
    assert (out / "program.nc").read_text() == plan.program


def test_what_is_wrong_is_told(tmp_path: Path) -> None:
    job = ellipsoid(tmp_path)
    job.write_text(job.read_text() + "[machine]\nspeed = 3\n")
    with pytest.raises(bonemill.CaseError, match="unknown key `machine.speed`"):
        bonemill.prosthesis(job)
    (tmp_path / "part.obj").write_text("v 0 0 0\n")
    ellipsoid_job = tmp_path / "empty.toml"
    ellipsoid_job.write_text('[part]\nstl = "part.obj"\n')
    with pytest.raises(bonemill.PlanError, match="no facets"):
        bonemill.prosthesis(ellipsoid_job)
    with pytest.raises(FileNotFoundError):
        bonemill.prosthesis(tmp_path / "none.toml")
