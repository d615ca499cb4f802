"""Simulation, verification and calibration: the command's bytes and numbers, refusals, stopping."""

import filecmp
import json
import subprocess
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bonemill
from tables import same_as_file, same_rows


@pytest.fixture
def twins(planned: bonemill.Plan, tmp_path: Path) -> tuple[Path, Path]:
    """The same plan in two folders."""
    return planned.save(tmp_path / "one"), planned.save(tmp_path / "two")


def command_json(command: Path, *arguments: Any) -> dict[str, Any]:
    ran = subprocess.run([command, *arguments, "--json"], capture_output=True, text=True, check=False)
    assert ran.returncode in (0, 1), ran.stderr
    found: dict[str, Any] = json.loads(ran.stdout)
    return found


def test_a_simulation_is_the_commands(twins: tuple[Path, Path], planned: bonemill.Plan, command: Path) -> None:
    by_command, by_python = twins
    told = command_json(command, "simulate", by_command)["figures"]
    loaded = bonemill.Plan.load(by_python)
    assert not (by_python / "simulation.csv").exists()
    found = bonemill.simulate(loaded, save=True)
    files = ["simulation.csv", "report.html"]
    assert filecmp.cmpfiles(by_command, by_python, files, shallow=False) == (files, [], [])
    assert found.figures == told and found.figures["stopped_steps"] == 0
    same_as_file(found.rows, by_python / "simulation.csv")
    # and without a folder of its own
    same_rows(bonemill.simulate(planned).rows, found.rows)
    with pytest.raises(ValueError, match="read-only"):
        found.rows["time_s"][0] = 1.0


def test_a_simulation_is_of_this_plan(planned: bonemill.Plan) -> None:
    stages: list[str] = []
    found = bonemill.simulate(planned, rate_hz=20, progress=lambda stage, done, of: stages.append(stage))
    assert "simulate" in stages
    assert len(found.rows) == pytest.approx(20 * planned.metrics["total_time_s"], abs=2)
    cut = found.figures["simulated_removed"]
    assert cut["material"]["mm3"] + cut["bone"]["mm3"] == pytest.approx(planned.metrics["removed_material_mm3"], rel=0.02)
    assert cut["structure"]["mm3"] == 0
    lumped = bonemill.simulate(planned, rate_hz=20, model="lumped")
    assert (lumped.rows["mrr_mm3_s"] == found.rows["mrr_mm3_s"]).all()
    assert lumped.figures["simulated_peak_force_n"] != found.figures["simulated_peak_force_n"]


def test_a_verification_is_the_commands(twins: tuple[Path, Path], planned: bonemill.Plan, command: Path) -> None:
    by_command, by_python = twins
    told = command_json(command, "verify", by_command)
    found = bonemill.verify(bonemill.Plan.load(by_python), save=True)
    files = ["verification.toml", "report.html"]
    assert filecmp.cmpfiles(by_command, by_python, files, shallow=False) == (files, [], [])
    assert found.passed is told["passed"] and found.passed is not bool(found.failed)
    assert len(found.checks) == len(told["checks"]) > 50
    for check, of_command in zip(found.checks, told["checks"], strict=True):
        assert (check.name, check.subject, check.unit) == (of_command["name"], of_command["subject"] or "", of_command["unit"])
        assert (check.value, check.limit, check.margin) == tuple(of_command[key] for key in ("value", "limit", "margin"))
    # and without a folder of its own
    assert [c.value for c in bonemill.verify(planned).checks] == [c.value for c in found.checks]


def test_a_risk_is_the_commands(twins: tuple[Path, Path], planned: bonemill.Plan, command: Path) -> None:
    def same(found: bonemill.Risk | None, told: dict[str, Any]) -> None:
        assert found is not None
        for s, by_command in zip(found.structures, told["structures"], strict=True):
            assert by_command == {
                "name": s.name,
                "touched": s.touched,
                "interval_95": list(s.interval_95),
                "hits": s.hits,
                "samples": s.samples,
                "kept_mm_05_50_95": list(s.kept_mm),
                "clearance_mm": s.clearance_mm,
            }
        for f, by_command in zip(found.forces, told["forces"], strict=True):
            assert by_command == {"name": f.name, "planned_n": f.planned_n, "n_05_50_95": list(f.spread_n)}

    told = command_json(command, "verify", twins[0], "--samples", "1500")
    found = bonemill.verify(bonemill.Plan.load(twins[1]), samples=1500, save=True)
    same(found.risk, told["risk"])
    assert found.risk is not None and found.risk.exceeded == ()
    files = ["verification.toml", "report.html"]
    assert filecmp.cmpfiles(*twins, files, shallow=False) == (files, [], [])
    # a registration that may be a centimetre off is too much for 99 %, and the command says so, too
    options = ("--registration-mm", 10, "--boundary-mm", 0.4, "--k-share", 0.5, "--keep", 0.99, "--draw-seed", 7)
    told = command_json(command, "verify", twins[0], "--samples", "300", *map(str, options))
    errors: bonemill.Errors = {"registration_mm": 10, "boundary_mm": 0.4, "k_share": 0.5, "keep": 0.99, "draw_seed": 7}
    lost = bonemill.verify(planned, samples=300, errors=errors)
    same(lost.risk, told["risk"])
    assert lost.passed and lost.risk is not None
    assert [s.name for s in lost.risk.exceeded] == ["facial_nerve"]
    assert [line.split(":")[0] for line in told["shortfalls"]] == ["probability of touching facial_nerve"]


@pytest.mark.parametrize("samples", [0, 1_000_001])
def test_samples_beyond_the_range_are_refused_by_both(
    twins: tuple[Path, Path], planned: bonemill.Plan, command: Path, samples: int
) -> None:
    with pytest.raises(bonemill.ArrayError) as caught:
        bonemill.verify(planned, samples=samples)
    call: list[str | Path] = [command, "verify", twins[0], "--samples", str(samples), "--quiet"]
    ran = subprocess.run(call, capture_output=True, text=True, check=False)
    assert ran.returncode == 2
    for said in (ran.stderr, str(caught.value)):
        assert all(number in said for number in (str(samples), "1", "1000000")), said


def test_errors_that_are_none_are_refused(planned: bonemill.Plan) -> None:
    for samples in (-1, 2.5, np.nan, "many"):
        with pytest.raises(bonemill.ArrayError, match="samples"):
            bonemill.verify(planned, samples=samples)  # type: ignore[arg-type]
    with pytest.raises(bonemill.ArrayError, match="without samples"):
        bonemill.verify(planned, errors={})
    with pytest.raises(bonemill.ModelError, match="'registration'"):
        bonemill.verify(planned, samples=10, errors={"registration": 1.0})  # type: ignore[arg-type]
    for key, value, says in [
        ("registration_mm", -1, "standard deviation is negative"),
        ("registration_deg", np.nan, "registration_deg"),
        ("boundary_mm", -0.1, "boundary sigma, mm = -0.1"),
        ("density_share", -1, "density"),
        ("k_share", "a", "k_share"),
        ("keep", 1.0, "keep = 1: expected 0.5 to below 1, the probability with which every structure must stay untouched"),
        ("draw_seed", -1, "draw_seed"),
        ("draw_seed", 1.5, "draw_seed"),
    ]:
        with pytest.raises(bonemill.ArrayError, match=says):
            bonemill.verify(planned, samples=10, errors={key: value})  # type: ignore[arg-type]


def test_a_fault_is_found(twins: tuple[Path, Path]) -> None:
    dir = twins[0]
    head, *lines = (dir / "waypoints.csv").read_text().splitlines()
    at = head.split(",").index("distance_mm")
    cells = lines[9].split(",")
    assert cells[at] != ""
    cells[at] = repr(float(cells[at]) + 0.5)
    (dir / "waypoints.csv").write_text("\n".join([head, *lines[:9], ",".join(cells), *lines[10:]]) + "\n")
    found = bonemill.verify(bonemill.Plan.load(dir))
    assert not found.passed
    fault = next(c for c in found.failed if c.subject == "distance_mm")
    assert fault.name == "columns" and fault.place == "waypoint 9" and fault.value == pytest.approx(0.5)


def test_another_plan_in_the_folder_is_not_taken_for_this_one(twins: tuple[Path, Path]) -> None:
    dir = twins[0]
    loaded = bonemill.Plan.load(dir)
    record = (dir / "plan.toml").read_text()
    assert "total_time_s = " in record
    (dir / "plan.toml").write_text(record.replace("total_time_s = ", "total_time_s = 1"))
    for judge in (bonemill.simulate, bonemill.verify):
        with pytest.raises(bonemill.PlanFileError, match="another plan .* load it again"):
            judge(loaded)


def test_what_cannot_be_is_refused(planned: bonemill.Plan) -> None:
    for step_mm in (0, -1, np.nan, 1e-12, "a"):
        with pytest.raises(bonemill.ArrayError, match="step_mm|simulation step, mm"):
            bonemill.simulate(planned, step_mm=step_mm)  # type: ignore[arg-type]
    with pytest.raises(bonemill.ArrayError, match="simulation rate, Hz"):
        bonemill.simulate(planned, rate_hz=1e12)
    with pytest.raises(bonemill.ModelError, match="lumped-as-printed"):
        bonemill.simulate(planned, model="magic")
    for judge in (bonemill.simulate, bonemill.verify):
        with pytest.raises(bonemill.ArrayError, match="Plan.load"):
            judge(planned, save=True)


@pytest.mark.parametrize(
    ("judge", "at"),
    [
        (bonemill.simulate, "simulate"),
        (bonemill.verify, "check rows"),
        (partial(bonemill.verify, samples=1_000_000), "draw errors"),
    ],
)
def test_what_progress_raises_stops_it(planned: bonemill.Plan, judge: Any, at: str) -> None:
    class MyStop(Exception):
        pass

    def progress(stage: str, done: int, of: int) -> None:
        if stage == at and (at != "draw errors" or done > 0):
            raise MyStop

    with pytest.raises(MyStop):
        judge(planned, progress=progress)


def measured(plan: bonemill.Plan, noise_n: float) -> dict[str, np.ndarray]:
    """A log as a sensor would give it along the plan's path: the simulation's forces at 100 Hz, with noise. Slower logs cut the path's corners."""
    w, r = plan.waypoints, bonemill.simulate(plan, rate_hz=100).rows[:1000]
    log = {name: np.array(r[name]) for name in ("time_s", "x_mm", "y_mm", "z_mm")}
    log |= {name: np.interp(r["time_s"], w["time_s"], w[name]) for name in ("axis_x", "axis_y", "axis_z")}
    rng = np.random.default_rng(1)
    return log | {name: r[name] + rng.normal(0, noise_n, len(r)) for name in ("fx_n", "fy_n", "fz_n")}


def test_coefficients_come_back_from_an_array_and_from_a_file(planned: bonemill.Plan, tmp_path: Path) -> None:
    log = measured(planned, 0.02)
    fit = bonemill.calibrate(planned, log)
    assert list(fit.coefficients) == ["k_t", "k_r", "k_a"] and fit.rows > 100
    for (value, half_width, unit), true in zip(fit.coefficients.values(), (1400, 840, 140), strict=True):
        assert unit == "N/mm²" and 0 < half_width < 50 and abs(value - true) < 2 * half_width
    assert fit.residual_n == pytest.approx(0.02, rel=0.2)
    columns = [log[name] for name in bonemill.LOG_COLUMNS]
    table = "\n".join(",".join(repr(float(v)) for v in row) for row in zip(*columns))
    (tmp_path / "log.csv").write_text(",".join(bonemill.LOG_COLUMNS) + "\n" + table + "\n")
    assert bonemill.calibrate(planned, tmp_path / "log.csv") == fit


def test_a_log_that_says_nothing_is_refused(planned: bonemill.Plan, tmp_path: Path) -> None:
    log = measured(planned, 0.0)
    with pytest.raises(bonemill.CalibrationError, match="at least 4"):
        bonemill.calibrate(planned, {**log, "z_mm": log["z_mm"] + 100})
    with pytest.raises(bonemill.ArrayError, match="no column 'axis_z'"):
        bonemill.calibrate(planned, {k: v for k, v in log.items() if k != "axis_z"})
    with pytest.raises(bonemill.ArrayError, match="rise at row 1"):
        bonemill.calibrate(planned, {**log, "time_s": -log["time_s"]})
    with pytest.raises(bonemill.ArrayError, match="fz_n has shape"):
        bonemill.calibrate(planned, {**log, "fz_n": log["fz_n"][:-1]})
    with pytest.raises(bonemill.ArrayError, match="fx_n"):
        bonemill.calibrate(planned, {**log, "fx_n": np.full(len(log["fx_n"]), np.nan)})
    with pytest.raises(bonemill.ModelError, match="k_x"):
        bonemill.calibrate(planned, log, coefficients=["k_x"])
    with pytest.raises(bonemill.PlanFileError, match="nowhere"):
        bonemill.calibrate(planned, tmp_path / "nowhere.csv")
