"""Cases and plans: the command's numbers, files that come and go whole, pickling, threads, stopping."""

import filecmp
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
import tomllib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import nibabel
import numpy as np
import pytest

import bonemill
from tables import same_as_file, same_rows

FILES = [
    "plan.toml",
    "waypoints.csv",
    "forces.csv",
    "trajectory.csv",
    "robot.urdf",
    "report.html",
    "access.csv",
    "dropped.csv",
]


def test_the_bytes_are_the_commands(
    planned: bonemill.Plan, block: bonemill.Case, command: Path, tmp_path: Path
) -> None:
    by_command = tmp_path / "command"
    subprocess.run([command, "plan", block.path, "--out", by_command, "--quiet"], check=True)
    saved = planned.save(tmp_path / "python")
    assert filecmp.cmpfiles(saved, by_command, FILES, shallow=False) == (FILES, [], [])


def test_arrays_are_the_files(planned: bonemill.Plan, tmp_path: Path) -> None:
    saved = planned.save(tmp_path / "plan")
    same_as_file(planned.waypoints, saved / "waypoints.csv")
    same_as_file(planned.forces, saved / "forces.csv")
    table = np.loadtxt(saved / "trajectory.csv", delimiter=",", skiprows=1)
    assert planned.trajectory.dtype.names == tuple((saved / "trajectory.csv").open().readline().strip().split(","))
    np.testing.assert_array_equal(table[:, 1:5], planned.q)
    np.testing.assert_array_equal(table[:, 5:], planned.qd)
    np.testing.assert_array_equal(table[:, 0], planned.trajectory["time_s"])
    assert np.shares_memory(planned.q, planned.trajectory)


def test_a_plan_reads_back(planned: bonemill.Plan, tmp_path: Path) -> None:
    read = bonemill.Plan.load(planned.save(tmp_path / "plan"))
    same_rows(read.waypoints, planned.waypoints)
    same_rows(read.forces, planned.forces)
    same_rows(read.trajectory, planned.trajectory)
    assert (read.metrics, read.modelled) == (planned.metrics, planned.modelled)
    assert (read.shortfalls, read.warnings) == (planned.shortfalls, planned.warnings)
    assert read.structures == planned.structures == (("facial_nerve", 1.0, 1),)
    assert read.case.text == planned.case.text
    # and is written elsewhere, with a way to its case from there
    again = bonemill.Plan.load(read.save(tmp_path / "deep" / "er" / "plan"))
    same_rows(again.trajectory, planned.trajectory)
    for name in FILES[1:]:
        assert filecmp.cmp(tmp_path / "plan" / name, tmp_path / "deep/er/plan" / name, shallow=False)


def test_the_arm_brings_the_burr_to_the_waypoints(planned: bonemill.Plan) -> None:
    """Distances between waypoints, which no registration changes, by forward kinematics."""
    at = np.searchsorted(planned.trajectory["time_s"], planned.waypoints["time_s"][:: 40])
    burr = planned.arm.fk(planned.q[at])[:, :3, 3]
    place = np.stack([planned.waypoints[n][:: 40] for n in ("x_mm", "y_mm", "z_mm")], axis=-1)
    apart = [np.linalg.norm(p[:, None] - p, axis=-1) for p in (burr, place)]
    # a sample is up to 2 ms after its waypoint, at up to 10 mm/s
    np.testing.assert_allclose(*apart, atol=0.1)


def test_metrics_say_what_the_arrays_say(planned: bonemill.Plan) -> None:
    m, w = planned.metrics, planned.waypoints
    assert m["total_time_s"] == pytest.approx(w["time_s"][-1], abs=1e-6)
    ends_n = np.linalg.norm([w["fx_n"], w["fy_n"], w["fz_n"]], axis=0)
    assert (w["peak_force_n"] >= ends_n - 1e-12).all() and m["peak_force_n"] == w["peak_force_n"].max() > 0
    nearest = np.nanmin(w["distance_mm"])
    assert m["structures"]["facial_nerve"]["least_surface_distance_mm"] == nearest - 2.5 > 1.0
    assert planned.modelled["waypoints"] == len(w)
    assert np.isfinite([w["fx_n"], w["fy_n"], w["fz_n"], w["force_toward_n"]]).all()


def test_forces_toward_structures_follow_from_force_and_direction(planned: bonemill.Plan) -> None:
    w, f = planned.waypoints, planned.forces
    force = np.stack([w["fx_n"], w["fy_n"], w["fz_n"]], axis=1)[f["index"]]
    toward = np.stack([f["toward_x"], f["toward_y"], f["toward_z"]], axis=1)
    np.testing.assert_allclose(np.linalg.norm(toward, axis=1), 1, atol=1e-12)
    np.testing.assert_allclose(np.maximum(0, (force * toward).sum(axis=1)), f["force_toward_n"], atol=1e-12)
    m = planned.metrics["structures"]["facial_nerve"]
    cuts = (f["structure"] == "facial_nerve") & (w["mass_mg"][f["index"]] > 0)
    assert (f["peak_toward_n"] >= f["force_toward_n"] - 1e-12).all()
    assert m["peak_force_toward_n"] == f["peak_toward_n"][f["structure"] == "facial_nerve"].max() > 0
    seconds = np.diff(w["time_s"], prepend=0)[f["index"]]
    structures = tomllib.loads(planned.case.text)["structure"]
    clearance_mm = next(s for s in structures if s["name"] == "facial_nerve")["clearance_mm"]
    for figures, most_mm in ((m, clearance_mm + 8), (m["near"], 2)):
        rows = cuts & (f["distance_mm"] - 2.5 <= most_mm)
        if not rows.any():
            assert figures["cutting_s"] == 0
            continue
        mean = np.average(f["mean_toward_n"][rows], weights=seconds[rows])
        assert figures["mean_force_toward_with_zeros_n"] == pytest.approx(mean, rel=1e-9)
        assert figures["cutting_s"] == pytest.approx(seconds[rows].sum(), rel=1e-9)
    assert (f["mean_toward_n"] <= f["peak_toward_n"] + 1e-12).all()
    assert set(planned.seconds) >= {"scene", "path", "access"}


def test_arrays_are_read_only(planned: bonemill.Plan) -> None:
    for rows in (planned.waypoints, planned.trajectory):
        with pytest.raises(ValueError, match="read-only"):
            rows["time_s"][0] = 1.0
    assert planned.waypoints is planned.waypoints


def test_threads_change_nothing_and_two_plan_at_once(planned: bonemill.Plan, block: bonemill.Case) -> None:
    with ThreadPoolExecutor(2) as pool:
        for made in pool.map(lambda n: bonemill.plan(block, threads=n), (1, 3)):
            same_rows(made.waypoints, planned.waypoints)
            same_rows(made.trajectory, planned.trajectory)


def test_python_goes_on_meanwhile(block: bonemill.Case) -> None:
    counted = 0
    done = threading.Event()

    def count() -> None:
        nonlocal counted
        while not done.is_set():
            counted += 1
            time.sleep(0.001)

    thread = threading.Thread(target=count)
    thread.start()
    bonemill.plan(block)
    done.set()
    thread.join()
    # the lock is held while nothing is computed: otherwise the count would stand still
    assert counted > 20


def test_progress_comes_in_order_and_in_this_thread(block: bonemill.Case) -> None:
    told: list[tuple[str, int, int]] = []
    threads = set()

    def progress(stage: str, done: int, of: int) -> None:
        told.append((stage, done, of))
        threads.add(threading.get_ident())

    bonemill.plan(block, progress=progress)
    stages = [stage for stage, _, _ in told]
    assert stages[:3] == ["read images", "scene", "free space"]
    # how much of the whole is done, in thousandths: from nothing, never back, to the last stage
    shares = [(done, of) for _, done, of in told]
    assert shares[0] == (0, 1000) and shares == sorted(shares) and "time law, coverage" in stages
    assert shares[-1][0] >= 860 and {of for _, of in shares} == {1000}
    assert threads == {threading.get_ident()}


def test_what_progress_raises_stops_the_plan(block: bonemill.Case) -> None:
    class MyStop(Exception):
        pass

    def progress(stage: str, done: int, of: int) -> None:
        if stage == "scene":
            raise MyStop

    with pytest.raises(MyStop):
        bonemill.plan(block, progress=progress)
    # and the next one is whole
    assert bonemill.plan(block).shortfalls == []


INTERRUPTED = """
import os, signal, sys, threading, time
import bonemill
# a shell's background job begins with it ignored
signal.signal(signal.SIGINT, signal.default_int_handler)
stage, delay = sys.argv[2], float(sys.argv[3])
sent = []
def kill():
    sent.append(time.perf_counter())
    os.kill(os.getpid(), signal.SIGINT)
def progress(name, done, of):
    if name == stage and not sent:
        threading.Timer(delay, kill).start()
try:
    bonemill.plan(sys.argv[1], progress=progress, threads=2)
    print("whole")
except KeyboardInterrupt:
    print(time.perf_counter() - sent[0])
"""


def interrupted(case: Path, stage: str, delay_s: float) -> float | None:
    """Seconds from Ctrl-C in a stage to its exception; None if the plan was made before."""
    run = [sys.executable, "-c", INTERRUPTED, str(case), stage, str(delay_s)]
    words = subprocess.run(run, check=True, capture_output=True, text=True).stdout.split()
    return None if words == ["whole"] else float(words[0])


@pytest.mark.parametrize("stage", ["scene", "access"])
def test_ctrl_c_stops_a_plan(block: bonemill.Case, stage: str) -> None:
    # how fast is measured, not asserted: machines differ
    assert interrupted(block.path, stage, 0.0) is not None


def test_cases_are_values(block: bonemill.Case, tmp_path: Path) -> None:
    copy = pickle.loads(pickle.dumps(block))
    assert copy == block and hash(copy) == hash(block) and copy.to_toml() == block.to_toml()
    assert copy != bonemill.phantom("block", tmp_path / "other")
    assert "case.toml" in repr(block)
    with pytest.raises(TypeError, match="Case.load"):
        bonemill.Case()


def test_a_plan_is_pickled_with_its_files(planned: bonemill.Plan) -> None:
    copy = pickle.loads(pickle.dumps(planned))
    same_rows(copy.waypoints, planned.waypoints)
    same_rows(copy.trajectory, planned.trajectory)
    assert copy.metrics == planned.metrics and copy.case.text == planned.case.text
    twice = pickle.loads(pickle.dumps(copy))
    assert twice.metrics == planned.metrics


def images(case: bonemill.Case) -> tuple[Any, Any]:
    return nibabel.load(case.path.with_name("ct.nii.gz")), nibabel.load(case.path.with_name("labels.nii.gz"))


@pytest.mark.parametrize("how", ["nibabel", "arrays", "fortran floats", "paths"])
def test_images_in_memory_give_the_same_plan(
    planned: bonemill.Plan, block: bonemill.Case, how: str, tmp_path: Path
) -> None:
    ct, labels = images(block)
    match how:
        case "nibabel":
            case = block.with_images(ct=ct, labels=labels)
        case "arrays":
            case = block.with_images(
                ct=(np.ascontiguousarray(ct.dataobj), ct.affine),
                labels=(np.asarray(labels.dataobj)[::-1][::-1], labels.affine.tolist()),
            )
        case "fortran floats":
            case = block.with_images(
                ct=(np.asfortranarray(ct.get_fdata()), ct.affine), labels=(labels.get_fdata(), labels.affine)
            )
        case "paths":
            case = block.with_images(ct=block.path.with_name("ct.nii.gz"), labels=labels)
    made = bonemill.plan(case)
    same_rows(made.waypoints, planned.waypoints)
    same_rows(made.trajectory, planned.trajectory)
    saved = made.save(tmp_path / "plan")
    del case, made
    # what was in memory lies in the plan
    read = bonemill.Plan.load(saved)
    same_rows(read.waypoints, planned.waypoints)
    same_rows(read.forces, planned.forces)
    assert (saved / "inputs" / "labels.nii").exists()
    assert bonemill.Plan.load(read.save(tmp_path / "elsewhere")).metrics == planned.metrics


def test_a_case_with_images_in_memory_is_pickled_whole(planned: bonemill.Plan, block: bonemill.Case) -> None:
    ct, labels = images(block)
    packed = pickle.dumps(block.with_images(ct=ct, labels=labels))
    made = pickle.loads(pickle.dumps(bonemill.plan(pickle.loads(packed))))
    same_rows(made.waypoints, planned.waypoints)


def test_images_are_copied_when_given(planned: bonemill.Plan, block: bonemill.Case) -> None:
    ct, labels = images(block)
    values = np.asanyarray(ct.dataobj).copy()
    case = block.with_images(ct=(values, ct.affine), labels=labels)
    values[:] = 0
    same_rows(bonemill.plan(case).waypoints, planned.waypoints)


def test_a_plan_whose_inputs_changed_is_refused(own_block: bonemill.Case, tmp_path: Path) -> None:
    saved = bonemill.plan(own_block).save(tmp_path / "plan")
    own_block.path.write_text(own_block.text + "# one more line\n")
    with pytest.raises(bonemill.PlanFileError, match="has changed since the plan was made"):
        bonemill.Plan.load(saved)
    with pytest.raises(bonemill.CaseError, match="load it again"):
        bonemill.plan(own_block)


def test_import_is_quick_enough_to_measure() -> None:
    """Nothing heavy is imported with the package."""
    heavy = "nibabel", "matplotlib", "rerun", "distributed", "rtde_control", "concurrent.futures.process"
    check = f"import bonemill, sys; print([m for m in {heavy!r} if m in sys.modules])"
    out = subprocess.run([sys.executable, "-c", check], check=True, capture_output=True, text=True).stdout
    assert out.strip() == "[]"


def test_signals_reach_python_while_it_waits(block: bonemill.Case) -> None:
    """A handler of one's own runs during the work, and the work goes on when it does not raise."""
    heard: list[int] = []
    before = signal.signal(signal.SIGUSR1, lambda number, frame: heard.append(number))
    try:
        made = bonemill.plan(block, progress=lambda *told: os.kill(os.getpid(), signal.SIGUSR1))
    finally:
        signal.signal(signal.SIGUSR1, before)
    assert heard and made.shortfalls == []


def test_a_moved_plan_is_given_its_inputs(own_block: bonemill.Case, planned: bonemill.Plan, tmp_path: Path) -> None:
    saved = bonemill.plan(own_block).save(tmp_path / "plan")
    away = tmp_path / "sent" / "plan"
    away.parent.mkdir()
    saved.rename(away)
    data = tmp_path / "data"
    own_block.path.parent.rename(data)
    read = bonemill.Plan.load(away)
    same_rows(read.waypoints, planned.waypoints)
    assert read.case.text == planned.case.text
    assert any("ct.nii.gz (SHA-256 " in missing for missing in read.missing_inputs)
    with pytest.raises(bonemill.PlanFileError, match="ct.nii.gz .SHA-256 .*inputs=DIR.*pack=True"):
        bonemill.simulate(read)
    found = bonemill.Plan.load(away, inputs=data)
    assert found.missing_inputs == [] and bonemill.simulate(found).figures["simulated_peak_force_n"] > 0
    assert pickle.loads(pickle.dumps(found)).missing_inputs == []
    # packed, it needs nothing else
    packed = found.save(tmp_path / "packed", pack=True)
    for name in ("ct.nii.gz", "labels.nii.gz", "case.toml"):
        (data / name).unlink()
    assert bonemill.simulate(bonemill.Plan.load(packed)).figures["simulated_peak_force_n"] > 0


def test_a_plan_made_to_be_packed_keeps_its_inputs(own_block: bonemill.Case, tmp_path: Path) -> None:
    saved = bonemill.plan(own_block, pack=True).save(tmp_path / "plan")
    assert (saved / "case.toml").read_bytes() == own_block.path.read_bytes()
    own_block.path.parent.rename(tmp_path / "away")
    read = bonemill.Plan.load(saved)
    assert read.missing_inputs == [] and read.case.text == own_block.text
    # and so do its copies
    again = read.save(tmp_path / "again")
    saved.rename(tmp_path / "gone")
    assert bonemill.Plan.load(again).missing_inputs == []


def test_frames_are_where_the_waypoints_say(planned: bonemill.Plan) -> None:
    frames, w = planned.frames, planned.waypoints
    for matrix in (frames.ct_from_work, frames.ct_from_grid, frames.base_from_ct, frames.flange_from_burr):
        np.testing.assert_allclose(matrix[:3, :3] @ matrix[:3, :3].T, np.eye(3), atol=1e-12)
        np.testing.assert_array_equal(matrix[3], [0, 0, 0, 1])
    # work's z is the approach, and θ and φ are measured in it
    axis = np.stack([w["axis_x"], w["axis_y"], w["axis_z"]], axis=-1) @ frames.ct_from_work[:3, :3]
    np.testing.assert_allclose(np.arctan2(-axis[:, 1], axis[:, 2]), w["theta_rad"], atol=1e-9)
    np.testing.assert_allclose(axis[:, 0], np.sin(w["phi_rad"]), atol=1e-9)
    # the arm brings the burr to the waypoints in the base
    at = np.searchsorted(planned.trajectory["time_s"], w["time_s"][::40])
    place = np.stack([w[n][::40] for n in ("x_mm", "y_mm", "z_mm")], axis=-1)
    in_base = place @ frames.base_from_ct[:3, :3].T + frames.base_from_ct[:3, 3]
    burr = planned.arm.fk(planned.q[at])[:, :3, 3]
    np.testing.assert_allclose(burr, in_base, atol=0.1)
    # and they lie on the planning grid
    grid = np.linalg.inv(frames.ct_from_grid) @ np.c_[place, np.ones(len(place))].T
    assert (grid[:3] > -frames.grid_spacing_mm).all()
    assert (grid[:3].T < np.array(frames.grid_shape) * frames.grid_spacing_mm + 60).all()


def test_values_are_swept(block: bonemill.Case, planned: bonemill.Plan) -> None:
    case = block.with_values({"path.step_mm": np.float64(0.5), "structure.facial_nerve.clearance_mm": 1.5})
    assert "step_mm = 0.5" in case.to_toml() and "clearance_mm = 1.5" in case.to_toml()
    # None: the default again
    same = block.with_values({"burr.spindle_rpm": 50000}).with_values({"burr.spindle_rpm": None})
    assert "spindle_rpm" not in same.text
    made = bonemill.plan(case)
    found = bonemill.compare(planned, made)
    # the copy of the case names its images by their whole paths
    changed = {key: pair for key, pair in found.case.items() if not key.startswith("images.")}
    assert changed == {
        "path.step_mm": (found.case["path.step_mm"][0], "0.5"),
        "structure.facial_nerve.clearance_mm": ("1.0", "1.5"),
    }
    first, second = ({pair[n] for pair in found.inputs.values() if pair[n]} for n in (0, 1))
    assert len(first & second) == 3, "the images and their names are the same files"
    removed = found.figures["volumes"]["removed_mm3"]
    assert removed == (planned.metrics["removed_mm3"], made.metrics["removed_mm3"])
    assert 0 < found.between["mean_distance_mm"] <= found.between["hausdorff_mm"]
    assert "removed_mm3" in str(found) and found.page.startswith("<!doctype html>")
    # a case with images in memory keeps them
    ct, labels = images(block)
    swept = block.with_images(ct=ct, labels=labels).with_values({"path.step_mm": 0.5})
    same_rows(bonemill.plan(swept.with_values({"structure.facial_nerve.clearance_mm": 1.5})).waypoints, made.waypoints)


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"path.stp_mm": 0.2}, "unknown key `path.stp_mm`; did you mean `path.step_mm`?"),
        ({"structure.facial_nrve.clearance_mm": 1.0}, "did you mean `structure.facial_nerve.clearance_mm`?"),
        ({"path.step_mm": -1.0}, "`path.step_mm` = -1"),
        ({"path.step_mm": object()}, "expected a number, text, boolean, list or dict"),
    ],
)
def test_values_that_no_case_has_are_refused(block: bonemill.Case, values: dict[str, Any], says: str) -> None:
    with pytest.raises(bonemill.CaseError) as refused:
        block.with_values(values)
    assert says in str(refused.value)
    # nobody has the text with these values, so no line of it is told; after other changes neither
    assert f"{block.path}:" not in str(refused.value)
    with pytest.raises(bonemill.CaseError) as refused:
        block.with_values({"burr.flutes": 6}).with_values(values)
    assert says in str(refused.value) and "/bonemill-" not in str(refused.value)
    if "path.step_mm" in values and isinstance(values["path.step_mm"], float):
        assert str(refused.value).startswith(f"{block.path} with these values: ")


def test_folders_are_compared_whatever_became_of_their_inputs(own_block: bonemill.Case, tmp_path: Path) -> None:
    first = bonemill.plan(own_block).save(tmp_path / "a")
    own_block.path.write_text(own_block.text + "# changed since\n")
    found = bonemill.compare(first, str(first))
    assert found.case == {} and found.between["hausdorff_mm"] == 0.0
    assert found.between["swept_by_first_alone_mm3"] == 0.0 < found.between["swept_by_both_mm3"]
    with pytest.raises(bonemill.PlanFileError, match="nowhere"):
        bonemill.compare(first, tmp_path / "nowhere")
