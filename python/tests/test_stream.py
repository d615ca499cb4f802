"""Streaming: the real ``ur_rtde`` client against a controller's protocol double on loopback, and what is refused."""

import itertools
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import fuzz_stream
import numpy as np
import pytest
from ur_double import SERVO_STOP, STOP_SCRIPT, Double

import bonemill
from bonemill.stream import Report, Rows, Settings, UrLink, follow, rows_of, stream

START = np.array([0.1, -1.2, 1.5, -0.3, 0.4, 0.0])
# other programs share this machine's cores: lateness is reported, not judged, here
PATIENT = Settings(late_s=2.0, track_s=1.0)
addresses = (f"127.0.0.{n}" for n in itertools.count(40))


def swing(seconds: float = 1.0) -> Rows:
    """All joints to and fro, at rest in the end to 1e-3 rad/s."""
    t = np.arange(round(seconds * 500)) * 0.002
    return Rows(0.002, START + 0.01 * (1 - np.cos(2 * np.pi * t / seconds))[:, None] * np.linspace(0.5, 1, 6))


def test_every_row_arrives_in_order_and_the_arm_is_stopped() -> None:
    pytest.importorskip("rtde_control")
    rows = swing()
    with Double(next(addresses), START) as double:
        report = follow(UrLink(double.host, 500.0, PATIENT), rows, PATIENT)
        sent, commands = np.array(double.get("sent")), double.get("commands")
    np.testing.assert_array_equal(sent[: len(rows.q)], rows.q)
    np.testing.assert_array_equal(sent[len(rows.q) :], np.broadcast_to(rows.q[-1], (500, 6)))
    assert commands[0] == 35  # the watchdog, before anything moves
    assert commands[-2:] == [SERVO_STOP, STOP_SCRIPT]
    assert report.rows == 500 and report.seconds >= 2.0 and report.largest_error_rad < 0.01


@pytest.mark.parametrize(
    ("change", "value", "says"),
    [
        ("q", (START + [0, 0.5, 0, 0, 0, 0]).tolist(), "joint 2 is 0.5000 rad off"),
        ("speed_fraction", 0.5, "slider is at 50 %"),
        ("safety_mode", 3, "safety mode is 3"),
    ],
)
def test_an_arm_that_is_not_ready_is_not_moved(change: str, value: Any, says: str) -> None:
    pytest.importorskip("rtde_control")
    with Double(next(addresses), START) as double:
        double.set(change, value)
        with pytest.raises(bonemill.StreamError) as caught:
            follow(UrLink(double.host, 500.0, PATIENT), swing(), PATIENT)
        assert says in str(caught.value)
        assert double.get("sent") == [] and double.get("commands")[-1] == STOP_SCRIPT


def test_an_arm_that_does_not_follow_is_stopped() -> None:
    pytest.importorskip("rtde_control")
    with Double(next(addresses), START) as double:
        double.set("stuck", True)
        with pytest.raises(bonemill.StreamError, match="rad off its track"):
            follow(UrLink(double.host, 500.0, PATIENT), swing(8.0), replace(PATIENT, track_tolerance_rad=0.002))
        assert double.get("commands")[-2:] == [SERVO_STOP, STOP_SCRIPT]


def test_a_plan_for_a_ur_arm_is_streamed(ur_planned: bonemill.Plan, tmp_path: Path) -> None:
    pytest.importorskip("rtde_control")
    saved = ur_planned.save(tmp_path / "plan")
    rows = rows_of(bonemill.Plan.load(saved))
    assert rows.period_s == pytest.approx(0.002) and rows.q.shape == (len(ur_planned.trajectory), 6)
    # a second of it
    some = Rows(rows.period_s, rows.q[:500])
    with Double(next(addresses), some.q[0]) as double:
        report = follow(UrLink(double.host, 500.0, PATIENT), some, PATIENT)
        np.testing.assert_array_equal(np.array(double.get("sent"))[:500], some.q)
    assert report.rows == 500
    done = run("stream", saved, "--host", "192.0.2.1", "--dry-run")
    assert done.returncode == 0 and f"would send {len(rows.q)} rows" in done.stdout, done.stderr
    assert "nominal kinematics" in done.stderr


class Imagined:
    """An arm that is where it was told to be, with a clock of its own."""

    def __init__(self, late_s: float = 0.0) -> None:
        self.q, self.now, self.rows, self.stopped, self.late_s = START, 0.0, 0, False, late_s
        self.mode, self.fraction = 1, 1.0

    def actual_q(self) -> np.ndarray:
        return self.q

    def speed_fraction(self) -> float:
        return self.fraction

    def safety_mode(self) -> int:
        return self.mode

    def servo(self, q: np.ndarray, period_s: float, settings: Settings) -> bool:
        assert not self.stopped
        self.q, self.rows = q, self.rows + 1
        self.now += self.late_s
        return self.rows != 400 or self.late_s >= 0

    def stop(self) -> None:
        self.stopped = True

    def run(self, settings: Settings = Settings(), **how: Any) -> Report:
        return follow(self, swing(), settings, clock=lambda: self.now, sleep=self.wait, **how)

    def wait(self, seconds: float) -> None:
        self.now += seconds


def test_rows_are_sent_on_time() -> None:
    arm = Imagined()
    told: list[tuple[int, int]] = []
    report = arm.run(progress=lambda row, of: told.append((row, of)))
    assert (report.rows, report.late_rows, report.largest_error_rad) == (500, 0, 0.0)
    assert report.seconds == pytest.approx(499 * 0.002 + 0.25) and arm.stopped
    assert told == [(0, 500), (250, 500)]


def test_a_clock_that_runs_behind_stops_the_arm() -> None:
    arm = Imagined(late_s=0.0035)
    with pytest.raises(bonemill.StreamError, match=r"row 67 of 500: 0\.10. s late"):
        arm.run()
    assert arm.stopped


def test_a_row_that_is_not_taken_and_a_user_who_stops_stop_the_arm() -> None:
    arm = Imagined(late_s=-1e-12)
    with pytest.raises(bonemill.StreamError, match="row 399 of 500: the arm did not take it"):
        arm.run()
    assert arm.stopped

    def impatient(row: int, of: int) -> None:
        if row:
            raise KeyboardInterrupt

    arm = Imagined()
    with pytest.raises(KeyboardInterrupt):
        arm.run(progress=impatient)
    assert arm.stopped and arm.rows == 251


@pytest.mark.parametrize(("name", "value", "says"), [("mode", 3, "stopped itself"), ("fraction", 0.8, "80 %")])
def test_what_happens_on_the_way_is_seen(name: str, value: Any, says: str) -> None:
    arm = Imagined()
    with pytest.raises(bonemill.StreamError, match=says):
        arm.run(progress=lambda row, of: setattr(arm, name, value if row else getattr(arm, name)))
    assert arm.stopped and arm.rows <= 252


def fake(rows: Rows, **changes: Any) -> Any:
    """As much of a plan as streaming looks at."""
    joints = tuple(bonemill.Joint(f"j{n}", "revolute", -6.28, 6.28, 3.14, 31.4) for n in range(6))
    trajectory = {"time_s": rows.period_s * np.arange(len(rows.q))}
    plan = dict(arm=SimpleNamespace(joints=joints), registration_assumed=False, trajectory=trajectory, q=rows.q)
    return SimpleNamespace(**(plan | changes))


def test_nonsense_from_the_arm_stops_it_before_another_row() -> None:
    """Damaged answers at random rows, from the first to the last: never a row after one, always stopped, always ours."""
    random = np.random.default_rng(20261122)
    nan, inf = float("nan"), float("inf")
    nonsense: dict[str, list[Any]] = {
        "actual_q": [
            np.full(6, nan), [*START[:5], nan], [*START[:5], inf], [*START[:5], -inf], [], START[:5], [*START, 0.0],
            START[None], None, "q", [None] * 6, ["x"] * 6, 3.0, START + 1e300, START - 0.1, RuntimeError("gone"), OSError("gone"),
        ],
        "speed_fraction": [nan, inf, -inf, -0.1, 0.0, 0.99, 1.01, 1e300, None, "fast", [], RuntimeError("gone")],
        "safety_mode": [0, 2, -1, 2**40, nan, inf, None, "normal", [], RuntimeError("gone")],
    }  # fmt: skip
    cases = [(name, value) for name, values in nonsense.items() for value in values]
    for trial in range(4 * len(cases)):
        name, value = cases[trial % len(cases)]
        arm = Imagined()
        honest, asked = getattr(arm, name), 0
        # asked once before the first row and once after each
        at = int(random.integers(0, 501)) if trial >= 2 * len(cases) else (trial // len(cases)) * 500

        def answer(value: Any = value, at: int = at, honest: Any = honest) -> Any:
            nonlocal asked
            asked += 1
            if asked <= at:
                return honest()
            if isinstance(value, Exception):
                raise value
            return value

        setattr(arm, name, answer)
        with pytest.raises(bonemill.StreamError) as caught:
            arm.run()
        assert arm.stopped and arm.rows <= at, (name, value, at, arm.rows)
        assert str(caught.value).startswith(("the arm", "the speed slider", "at the start", f"row {max(at - 1, 0)}"))


def test_random_answers_stop_the_arm_when_they_must_and_only_then() -> None:
    done = [fuzz_stream.trial(number) for number in range(300)]
    assert 50 < sum(done) < 250


def test_a_dry_run_needs_no_arm() -> None:
    assert stream(fake(swing()), "192.0.2.1", dry_run=True) == Report(500, pytest.approx(0.998), 0, 0.0, 0.0)


def test_plans_that_no_ur_arm_can_follow_are_refused(planned: bonemill.Plan) -> None:
    rows = swing()
    for plan, says in [
        (planned, "six revolute joints"),
        (fake(rows, registration_assumed=True), "registration"),
        (fake(Rows(0.1, rows.q)), "every 0.1 s"),
        (fake(Rows(0.002, rows.q[:1])), "at least 2"),
        (fake(rows, q=np.where(np.arange(500)[:, None] == 250, 7.0, rows.q)), "row 250: joint j0"),
        (fake(rows, q=np.where(np.arange(500)[:, None] >= 250, 1.0, rows.q)), "rad/s"),
        (fake(rows, trajectory={"time_s": np.r_[np.arange(499) * 0.002, 1.01]}), "even steps"),
    ]:
        with pytest.raises(bonemill.StreamError) as caught:
            rows_of(plan)
        assert says in str(caught.value)
    for wrong in ({"lookahead_s": 0.01}, {"gain": 5000.0}, {"late_s": float("nan")}):
        with pytest.raises(bonemill.StreamError, match="expected"):
            Settings(**wrong)


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    call = [sys.executable, "-m", "bonemill", *map(str, arguments)]
    return subprocess.run(call, capture_output=True, text=True, check=False)


def test_the_command_line_says_what_is_wrong(planned: bonemill.Plan, tmp_path: Path) -> None:
    saved = planned.save(tmp_path / "plan")
    done = run("stream", saved, "--host", "192.0.2.1", "--dry-run")
    assert done.returncode == 2 and "six revolute joints" in done.stderr
    assert run("stream", tmp_path, "--host", "h").returncode == 2
    assert run("stream", saved).returncode == 2
    assert run("stream", saved, "--host", "h", "--gain", "1").returncode == 2
    assert run("--version").stdout.strip() == bonemill.__version__
