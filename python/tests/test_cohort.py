"""Many cases, one table: by processes, by a Dask cluster, and with cases that fail."""

import csv
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import bonemill
from bonemill.cohort import plan_cohort


@pytest.fixture
def cohort(block: bonemill.Case, tmp_path: Path) -> dict[str, Path]:
    """A good case, the same again, one without its CT, and one whose file is missing."""
    for name in ("a", "b", "bad"):
        shutil.copytree(block.path.parent, tmp_path / "cases" / name)
    (tmp_path / "cases/bad/ct.nii.gz").unlink()
    return {name: tmp_path / "cases" / name / "case.toml" for name in ("bad", "b", "missing", "a")}


def check(rows: list[dict[str, object]], out: Path, planned: bonemill.Plan) -> None:
    assert [(r["name"], r["outcome"]) for r in rows] == [
        ("bad", "error"),
        ("b", "done"),
        ("missing", "error"),
        ("a", "done"),
    ]
    assert "ct.nii.gz" in str(rows[0]["why"]) and "cannot read the case" in str(rows[2]["why"])
    for row in (rows[1], rows[3]):
        assert row["removed_mm3"] == planned.metrics["removed_mm3"]
        assert row["structures.facial_nerve.peak_force_toward_n"] > 0  # type: ignore[operator]
    assert bonemill.Plan.load(out / "a").metrics == planned.metrics
    with open(out / "cohort.csv", newline="") as file:
        table = list(csv.DictReader(file))
    assert [r["name"] for r in table] == ["bad", "b", "missing", "a"]
    assert float(table[3]["total_time_s"]) == planned.metrics["total_time_s"]
    assert table[0]["total_time_s"] == ""
    assert sorted(p.name for p in out.iterdir()) == ["a", "b", "cohort.csv"]


def test_a_cohort_by_processes(cohort: dict[str, Path], tmp_path: Path, planned: bonemill.Plan) -> None:
    told: list[tuple[int, int]] = []
    rows = plan_cohort(cohort, tmp_path / "out", workers=2, progress=lambda name, n, of: told.append((n, of)))
    check(rows, tmp_path / "out", planned)
    assert told == [(1, 4), (2, 4), (3, 4), (4, 4)]


def test_a_cohort_on_a_dask_cluster(cohort: dict[str, Path], tmp_path: Path, planned: bonemill.Plan) -> None:
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster:
        with distributed.Client(cluster) as client:
            cases = {name: path for name, path in cohort.items()}
            check(plan_cohort(cases, tmp_path / "out", client=client), tmp_path / "out", planned)


def test_names_come_from_folders_and_must_differ(cohort: dict[str, Path], tmp_path: Path) -> None:
    with pytest.raises(bonemill.ArrayError, match="two cases are called 'a'"):
        plan_cohort([cohort["a"], cohort["a"]], tmp_path / "out")
    for name in ("", "..", "a/b", "cohort.csv"):
        with pytest.raises(bonemill.ArrayError, match="case name"):
            plan_cohort({name: cohort["a"]}, tmp_path / "out")
    assert plan_cohort([], tmp_path / "out") == []


def test_it_comes_with_the_package() -> None:
    """Without an import of its own, and only when it is used."""
    heavy = "'concurrent.futures.process' in sys.modules"
    code = f"import bonemill, sys; print({heavy}); print(bonemill.cohort.plan_cohort.__name__, {heavy}, bonemill.stream.stream.__name__)"
    out = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout
    assert out.split() == ["False", "plan_cohort", "True", "stream"]
    with pytest.raises(AttributeError, match="cohorts"):
        bonemill.cohorts  # type: ignore[attr-defined]
