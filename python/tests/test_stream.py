"""Streaming: the real ``ur_rtde`` client against a controller's protocol double on loopback, and what is refused."""

import os
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from addresses import addresses
from fault_run import prefer
from streaming import STALL, TRIES, Yes, ready
from ur_arm import SERVO_STOP, SET_WATCHDOG, STOP_SCRIPT, burr_mm, tool_pose
from ur_double import Double

import bonemill
from bonemill.__main__ import tell_lateness
from bonemill.stream import Report, Settings, Streaming, UrLink


def test_a_whole_plan_is_streamed_in_order_and_resumed_where_the_machine_stalls(judged: Path, tmp_path: Path) -> None:
    pytest.importorskip("rtde_control")
    prefer()
    streaming = ready(judged)
    q = bonemill.Plan.load(judged).q
    reports: list[Report] = []
    start_row = 0.0
    with Double(next(addresses), q[0]) as double:
        for attempt in range(20):
            log = tmp_path / f"{attempt}.run"
            link = UrLink(double.host, streaming.period_s, Settings())
            reports.append(streaming.run(link, Yes(), start_row=start_row, log=log))
            if reports[-1].reason is None:
                break
            assert STALL in reports[-1].reason or "program on the controller" in reports[-1].reason, reports[-1]
            start_row = streaming.resume_row(log)
            double.call("cured")
        sent, commands = np.array(double.get("sent")), double.get("commands")
        outputs, at = double.get("digital_outputs"), np.array(double.get("q"))
    assert reports[-1].reason is None and reports[-1].at_rest, reports
    # the targets pass every row of the plan, in its order: each within a step of the one before and none left out
    steps = np.abs(np.diff(q, axis=0)).max()
    place = 0
    for target in sent:
        window = q[place : place + 40]
        place += int(np.abs(window - target).max(axis=1).argmin())
    assert place == len(q) - 1 and np.abs(np.diff(sent, axis=0)).max() <= 2 * steps + 1e-3
    np.testing.assert_allclose(at, q[-1], atol=1e-4)
    assert commands[0] == SET_WATCHDOG and commands[-2:] == [SERVO_STOP, STOP_SCRIPT]
    assert outputs == 0 and all(r.farthest_off_mm < 0.5 for r in reports)


@pytest.mark.parametrize(
    ("names", "says"),
    [
        (("UR10", "20225000000", False), "moves a UR10, the plan is for a ur5e"),
        (("UR5", "20225000001", False), "serial number 20225000001, expected 20225000000"),
        (("", "", False), "did not say its model and serial number"),
        (("UR5", "20225000000", True), "local control"),
    ],
)
def test_another_arm_is_not_moved(judged: Path, names: tuple[str, str, bool], says: str) -> None:
    streaming = ready(judged, serial="20225000000")
    arm = Imagined(streaming.joints(0.0))
    arm.names = names
    report = streaming.run(arm, Yes())
    assert report.reason is not None and says in report.reason and arm.orders == ["end"]


def test_a_controller_that_is_not_there_is_told_within_its_deadline(judged: Path) -> None:
    began = time.monotonic()
    report = ready(judged).run(UrLink("127.0.0.39", 0.002, Settings()), Yes())
    assert report.reason is not None and "connection to the controller" in report.reason
    assert time.monotonic() - began < 20


class Imagined:
    """An arm that is where it was told to be; `damage` changes what it says of itself from some answer on."""

    def __init__(self, q: list[float], at: int = 10**9, damage: Any = None) -> None:
        self.q, self.at, self.damage = list(q), at, damage
        self.orders: list[str] = []
        self.names = ("UR5", "20225000000", False)
        self.answers, self.closed, self.began, self.state_2 = 0, False, time.monotonic(), 1

    def state(self) -> Any:
        self.answers += 1
        if self.answers > self.at and isinstance(self.damage, Exception):
            raise self.damage
        now = time.monotonic()
        pose = tool_pose(np.array(self.q))
        on = self.orders.count("spindle") % 2 == 1
        place = ([1e3 * v for v in pose[:3]], pose[3:])
        state = [0.0, now - self.began, self.q, place, None, 1, self.state_2, 1.0, 1.0, (7, False, on)]
        if self.answers > self.at:
            place, value = self.damage
            state[place] = value
        return tuple(state)

    def order(self, what: str, values: list[float]) -> None:
        self.orders.append(what)
        if what == "target":
            self.q = values
        self.state_2 = {"start": 2, "end": 1}.get(what, self.state_2)

    def fault(self) -> str | None:
        return None

    def identity(self) -> tuple[str, str, bool]:
        return self.names

    def waiting(self) -> int:
        return 0

    def close(self) -> None:
        self.closed = True


NAN = float("nan")


@pytest.mark.parametrize(
    "damage",
    [
        (2, [NAN] * 6), (2, [0.0] * 5), (2, None), (2, "joints"), (2, [1e300] * 6), (1, NAN), (1, "soon"), (5, 1.9), (5, None), (5, 2**70),
        (5, 3), (6, 1), (7, NAN), (7, -0.1), (7, 1.1), (7, "fast"), (4, [NAN, 0.0, 0.0]), RuntimeError("gone"), OSError("gone"), ValueError(),
    ],
)  # fmt: skip
def test_nonsense_from_the_arm_stops_it_before_another_target(judged: Path, damage: Any) -> None:
    streaming = ready(judged, run_up_s=0.0)
    arm = Imagined(streaming.joints(0.0), 60, damage)
    report = streaming.run(arm, Yes())
    assert report.reason is not None and arm.closed and arm.orders[-1] == "end"
    # a state without a time is no new one: it counts as old within 20 ms, and a busy machine is slower than that
    late = damage[0] == 1 if isinstance(damage, tuple) else False
    assert arm.orders[60:].count("target") <= (25 if late else 0)


def test_a_log_is_never_written_over_and_is_of_one_plan(judged: Path, tmp_path: Path) -> None:
    streaming = ready(judged)
    log = tmp_path / "a.run"
    arm = Imagined(streaming.joints(0.0), 400, RuntimeError("gone"))
    report = streaming.run(arm, Yes(), log=log)
    assert 0 < streaming.resume_row(log) <= report.reached_row + 1
    with pytest.raises(bonemill.StreamError, match="cannot write the log"):
        streaming.run(Imagined(streaming.joints(0.0)), Yes(), log=log)
    text = log.read_text()
    log.write_text(text[: len(text) - 30])
    assert streaming.resume_row(log) > 0
    log.write_text(text.replace(text.split(",")[2], "0" * 64, 1))
    with pytest.raises(bonemill.StreamError, match="line 1 of the log"):
        streaming.resume_row(log)


def test_a_log_without_a_step_is_not_gone_on_from(judged: Path, tmp_path: Path) -> None:
    streaming = ready(judged)
    log = tmp_path / "a.run"
    streaming.run(Imagined(streaming.joints(0.0), 60, RuntimeError("gone")), Yes(), log=log)
    head = "".join(line for line in log.read_text().splitlines(keepends=True) if not line.startswith(("R,", "E,")))
    log.write_text(head)
    with pytest.raises(bonemill.StreamError, match=r"a\.run: the log holds no step of a run"):
        streaming.resume_row(log)


def test_the_bound_is_of_the_given_lookahead_and_gain(judged: Path) -> None:
    pytest.importorskip("rtde_control")
    prefer()

    def off_mm(streaming: Streaming) -> float:
        return float(streaming.bound_lines()[0].split(" mm off it")[0].rpartition(", ")[2])

    late = ready(judged, settings=Settings(lookahead_s=0.05, gain=1000.0))
    assert off_mm(late) > 1.1 * off_mm(ready(judged)) and late.refusal() is None
    refusal = ready(judged, settings=Settings(lookahead_s=0.2, gain=100.0)).refusal()
    assert refusal is not None and "smaller --lookahead-s or a larger --gain" in refusal
    # an arm that is as late comes to the end: the run expects it there
    for _ in range(TRIES):
        with Double(next(addresses), late.joints(0.0)) as double:
            report = late.run(UrLink(double.host, late.period_s, late.settings), Yes())
            lag_s = double.get("lag_s")
        if report.reason is None:
            assert lag_s == pytest.approx(0.058)
            return
        assert STALL in report.reason or "program on the controller" in report.reason, report
    pytest.fail("no run came to its end")


def test_a_rehearsal_is_faster_than_the_run_and_its_log_is_one(judged: Path, tmp_path: Path) -> None:
    streaming = ready(judged)
    report = streaming.rehearse(log=tmp_path / "r.run")
    assert report.reason is None and report.reached_row == pytest.approx(streaming.rows - 1, abs=1.0)
    # a resumed run begins where the burr is the tolerance, at most 0.5 mm, away from the last place, which is within a row of the end
    burr = burr_mm(bonemill.Plan.load(judged).q)
    away_mm = np.linalg.norm(burr - burr[-1], axis=1)
    first = np.flatnonzero(away_mm >= 0.5 + away_mm[-2])[-1]
    assert first - 1 <= streaming.resume_row(tmp_path / "r.run") < streaming.rows


@pytest.fixture(scope="module")
def on_the_bone(block: bonemill.Case, planned: bonemill.Plan, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A verified plan for the bone-attached arm, whose place the case tells."""
    record = tomllib.loads((planned.save(tmp_path_factory.mktemp("assumed") / "plan") / "plan.toml").read_text())
    place = record["frames"]["base_from_ct"]
    told = f'rotation = {place["rotation"]}, translation_mm = {place["translation_mm"]}'
    text = block.text.replace('model = "bone-attached"', f'model = "bone-attached"\nbase_from_ct = {{ {told} }}')
    path = block.path.with_name("case_on_the_bone.toml")
    path.write_text(text, encoding="utf-8")
    folder = bonemill.plan(path).save(tmp_path_factory.mktemp("on_the_bone") / "plan")
    assert bonemill.verify(bonemill.Plan.load(folder), save=True).passed
    return folder


def test_an_arm_that_no_controller_here_moves_is_rehearsed_only(on_the_bone: Path, tmp_path: Path) -> None:
    log = tmp_path / "r.run"
    done = run("stream", on_the_bone, "--rehearse", "--slow", "--payload-kg", "1", "--log", log)
    assert done.returncode == 0, done.stderr
    assert "bound after any failure" in done.stdout and log.stat().st_size > 10_000
    done = run("stream", on_the_bone, "--host", "192.0.2.1", "--dry-run")
    assert done.returncode == 2 and "six revolute joints" in done.stderr
    streaming = ready(on_the_bone)
    with pytest.raises(bonemill.StreamError, match="six revolute joints"):
        streaming.run(Imagined(streaming.joints(0.0)), Yes())


def test_plans_that_no_arm_can_follow_are_refused(planned: bonemill.Plan, tmp_path: Path) -> None:
    with pytest.raises(bonemill.StreamError, match="no registration"):
        Streaming(planned.save(tmp_path / "plan"))
    for wrong in ({"lookahead_s": 0.01}, {"gain": 5000.0}, {"watchdog_hz": float("nan")}, {"spindle_output": 8}):
        with pytest.raises(bonemill.StreamError, match="expected"):
            Settings(**wrong)  # type: ignore[arg-type]


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    call = [sys.executable, "-m", "bonemill", *map(str, arguments)]
    return subprocess.run(call, capture_output=True, text=True, check=False)


def test_the_command_line_says_what_is_wrong(planned: bonemill.Plan, judged: Path, tmp_path: Path) -> None:
    saved = planned.save(tmp_path / "plan")
    done = run("stream", saved, "--host", "192.0.2.1", "--dry-run")
    assert done.returncode == 2 and "no registration" in done.stderr
    assert run("stream", tmp_path, "--host", "h").returncode == 2
    assert run("stream", saved).returncode == 2
    refused = run("stream", judged, "--rehearse")
    assert refused.returncode == 2 and "--rehearse needs --payload-kg" in refused.stderr
    assert run("stream", saved, "--host", "h", "--gain", "1").returncode == 2
    # what a run refuses, a dry run says; it needs no controller
    done = run("stream", judged, "--dry-run", "--payload-kg", "1", "--slow")
    assert done.returncode == 0 and "bound after any failure" in done.stdout, done.stderr
    done = run("stream", judged, "--dry-run", "--slow")
    assert done.returncode == 2 and "needs --payload-kg" in done.stderr
    slowed = "slowed where the bound is larger" in run("stream", judged, "--dry-run", "--payload-kg", "1", "--slow").stdout
    done = run("stream", judged, "--dry-run", "--payload-kg", "1")
    assert done.returncode == (2 if slowed else 0) and ("stream with --slow" in done.stderr) == slowed, done.stderr
    assert run("stream", judged, "--host", "h", "--resume", os.devnull).returncode == 2
    assert run("--version").stdout.strip() == bonemill.__version__


TELLS = """
import time
from bonemill.stream import Console
console = Console()
for n in range(20_000):
    console.tell(f"line {n}")
console.ask("Is the way free?")
ends = time.monotonic() + 0.3
early = [console.answer() for _ in iter(lambda: time.monotonic() < ends, False)]
print("told", set(early), flush=True)
polls = 0
while (answer := console.answer()) is None:
    polls += 1
    time.sleep(0.001)
print(answer, polls > 50, flush=True)
console.ask("Go on?")
while (answer := console.answer()) is None:
    time.sleep(0.001)
print(answer, flush=True)
"""


def test_a_terminal_that_is_halted_or_says_half_a_word_is_not_waited_for() -> None:
    pipes = {name: subprocess.PIPE for name in ("stdin", "stdout", "stderr")}
    with subprocess.Popen([sys.executable, "-c", TELLS], **pipes) as console:
        assert console.stdin and console.stdout and console.stderr
        try:
            # nobody has read a line of it yet, and a pipe holds a fraction of them: a question that nobody sees has no answer
            # typed before the question: no answer to it
            console.stdin.write(b"n\nye")
            console.stdin.flush()
            assert console.stdout.readline() == b"told {None}\n"
            lines = [console.stderr.readline() for _ in range(20_001)]
            assert lines[:20_000] == [f"line {n}\n".encode() for n in range(20_000)] and lines[-1].startswith(b"Is the way free?")
            time.sleep(0.2)
            assert console.poll() is None, "half a word was taken for an answer"
            console.stdin.write(b"y")
            console.stdin.flush()
            time.sleep(0.2)
            assert console.poll() is None, "half a line was taken for an answer"
            # the second line is there before the second question
            console.stdin.write(b"es\ny\n")
            console.stdin.flush()
            assert console.stdout.readline() == b"True True\n" and console.stderr.readline().startswith(b"Go on?")
            time.sleep(0.2)
            assert console.poll() is None, "what was typed earlier answered"
            console.stdin.write(b"no\n")
            console.stdin.flush()
            assert console.stdout.readline() == b"False\n"
        finally:
            console.kill()


HEARS = """
import signal, sys
signal.signal(signal.SIGINT, signal.SIG_IGN)
from bonemill.__main__ import main
code = main(["stream", "nowhere", "--host", "none"])
print(code, signal.getsignal(signal.SIGINT) is signal.default_int_handler)
"""


def test_ctrl_c_is_heard_by_a_command_that_was_started_in_the_background() -> None:
    done = subprocess.run([sys.executable, "-c", HEARS], capture_output=True, text=True, timeout=60)
    assert done.stdout == "2 True\n", done.stderr


def test_a_rehearsal_hears_ctrl_c(judged: Path, tmp_path: Path) -> None:
    call = [sys.executable, "-m", "bonemill", "stream", str(judged), "--rehearse", "--slow", "--payload-kg", "1", "--log", "/dev/full"]
    told = subprocess.run(call, capture_output=True, text=True, timeout=60)
    assert told.returncode == 1 and "cannot write the log" in told.stderr
    log = tmp_path / "rehearsal.run"
    with subprocess.Popen([*call[:-1], str(log)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as rehearsal:
        ends = time.monotonic() + 30.0
        while (not log.exists() or log.stat().st_size < 4000) and time.monotonic() < ends:
            time.sleep(0.002)
        rehearsal.send_signal(signal.SIGINT)
        _, said = rehearsal.communicate(timeout=10)
    assert rehearsal.returncode == 130 and "stopped by the user" in said, said


class Clock:
    """A PC's clock that is a little late each time, and very late once."""

    def __init__(self, late_s: float) -> None:
        self.now_s, self.sleeps, self.late_s = 0.0, 0, late_s

    def monotonic(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        self.sleeps += 1
        self.now_s += seconds + (self.late_s if self.sleeps == 100 else 1e-4)


@pytest.mark.parametrize(("late_s", "said"), [(0.015, "up to 15 ms late"), (0.005, "")])
def test_a_pc_that_wakes_up_late_is_told_before_the_start(late_s: float, said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bonemill.__main__.time", Clock(late_s))
    told: list[str] = []
    tell_lateness(told.append, 0.002)
    assert (len(told) == 1 and said in told[0] and "docs/realtime.md" in told[0]) if said else not told, told
