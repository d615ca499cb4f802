"""The two processes of the arm's client, with a client made here that prints, refuses, fails and hangs."""

import time
from collections.abc import Callable
from pathlib import Path

import pytest

from bonemill.stream import Settings, UrLink

CONTROL = """
import os, time
import rtde_io
class RTDEControlInterface:
    def __init__(self, host, rate):
        os.write(1, b"RTDEControlInterface: Reconnecting...")
    def setWatchdog(self, hz):
        return rtde_io.KIND != "no watchdog"
    def servoJ(self, *values):
        os.write(1, b"Lost connection")
        if rtde_io.KIND == "hangs":
            time.sleep(60.0)
        return True
    def servoStop(self, slowing):
        rtde_io.note("stop")
        if rtde_io.KIND == "stop fails":
            raise RuntimeError("no connection")
        if rtde_io.KIND == "stop hangs":
            time.sleep(60.0)
        return True
    def stopScript(self):
        rtde_io.note("script ends")
"""
IO = """
import os
KIND = os.environ["CLIENT_KIND"]
def note(text):
    with open(os.environ["CLIENT_NOTES"], "a") as notes:
        notes.write(text + ",")
class RTDEIOInterface:
    def __init__(self, host): pass
    def setStandardDigitalOut(self, output, on):
        note(f"spindle {int(on)}")
        return True
"""
RECEIVE = """
import os, time
class RTDEReceiveInterface:
    def __init__(self, host, rate, variables):
        self.began = time.monotonic()
        os.write(1, b"RTDEReceiveInterface: Reconnecting...")
    def getTimestamp(self): return round(time.monotonic() - self.began, 3)
    def getActualQ(self): return [0.5] * 6
    def getActualTCPPose(self): return [0.1, 0.2, 0.3, 0.0, 0.0, 0.0]
    def getActualTCPForce(self):
        felt = time.monotonic() - self.began < 0.5 or os.environ["CLIENT_KIND"] != "sensor fails"
        return [0.0, 0.0, 1.5 if felt else 0.0, 0.0, 0.0, 0.0]
    def getSafetyMode(self): return 1
    def getRuntimeState(self): return 2
    def getTargetSpeedFraction(self): return 1.0
    def getSpeedScalingCombined(self): return 1.0
    def getPayload(self): return 1.0
    def getRobotMode(self): return 7
    def getRobotStatus(self): return 1
    def getActualDigitalOutputBits(self):
        notes = os.environ["CLIENT_NOTES"]
        return int(os.path.exists(notes) and open(notes).read().rpartition("spindle ")[2][:1] == "1")
    def isConnected(self): return True
"""

Begin = Callable[[str], UrLink]


@pytest.fixture
def notes(tmp_path: Path) -> Path:
    return tmp_path / "notes"


@pytest.fixture
def begin(tmp_path: Path, notes: Path, monkeypatch: pytest.MonkeyPatch) -> Begin:
    for name, text in (("rtde_control", CONTROL), ("rtde_io", IO), ("rtde_receive", RECEIVE)):
        (tmp_path / f"{name}.py").write_text(text)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setenv("CLIENT_NOTES", str(notes))

    def link(kind: str) -> UrLink:
        monkeypatch.setenv("CLIENT_KIND", kind)
        return UrLink("127.0.0.41", 0.002, Settings())

    return link


def watched(link: UrLink, until: Callable[[], bool], seconds: float = 10.0) -> None:
    """Looks at the state as a run does, until something holds."""
    ends = time.monotonic() + seconds
    while not until():
        link.state()
        link.fault()
        assert time.monotonic() < ends, "it did not come in time"
        time.sleep(0.002)


def is_on(link: UrLink) -> bool:
    """Whether the spindle's output is seen on."""
    state = link.state()
    return state is not None and state[9][2]


def test_what_the_client_prints_is_no_answer_and_no_state(begin: Begin, notes: Path) -> None:
    link = begin("prints")
    try:
        watched(link, lambda: link.state() is not None)
        for what, values in (("start", []), ("spindle", [1.0]), *[("target", [0.5] * 6)] * 20):
            link.order(what, values)
        assert link.waiting() > 0
        watched(link, lambda: link.waiting() == 0)
        watched(link, lambda: is_on(link))
        _, _, q, (place_mm, _), force_n, safety_mode, *_, more = link.state() or ()
        assert (list(q), place_mm, list(force_n), safety_mode) == ([0.5] * 6, [100.0, 200.0, 300.0], [0.0, 0.0, 1.5], 1)
        assert more == (7, False, True)
    finally:
        link.close()
    said = notes.read_text().split(",")
    assert sorted(said) == ["", "script ends", "spindle 0", "spindle 1", "stop"]
    assert said.index("stop") < said.index("script ends") and said.index("spindle 1") < said.index("spindle 0")


def test_a_watchdog_that_is_refused_is_told(begin: Begin) -> None:
    link = begin("no watchdog")
    try:
        link.order("start", [])
        watched(link, lambda: link.waiting() == 0)
        assert link.fault() == "watchdog"
    finally:
        link.close()


@pytest.mark.parametrize("kind", ["stop fails", "stop hangs"])
def test_the_spindle_is_switched_off_whatever_the_stop_does(begin: Begin, notes: Path, kind: str) -> None:
    link = begin(kind)
    try:
        link.order("start", [])
        watched(link, lambda: link.waiting() == 0)
        link.order("spindle", [1.0])
        watched(link, lambda: link.waiting() == 0)
        watched(link, lambda: is_on(link))
        link.order("stop", [])
        link.order("spindle", [0.0])
        began = time.monotonic()
        watched(link, lambda: not is_on(link))
        assert time.monotonic() - began < 1.0 and link.state() is not None
        if kind == "stop fails":
            watched(link, lambda: link.fault() is not None)
            assert "no connection" in (link.fault() or "")
    finally:
        link.close()
    assert "spindle 0" in notes.read_text().split(",")


def test_the_spindle_is_switched_off_when_no_order_comes_any_more(begin: Begin, notes: Path) -> None:
    link = begin("prints")
    link.order("start", [])
    watched(link, lambda: link.waiting() == 0)
    link.close()
    assert sorted(notes.read_text().split(",")) == ["", "script ends", "spindle 0", "stop"]


def test_orders_wait_before_a_client_that_hangs_and_closing_does_not(begin: Begin) -> None:
    link = begin("hangs")
    link.order("start", [])
    watched(link, lambda: link.waiting() == 0)
    link.order("target", [0.5] * 6)
    time.sleep(0.2)
    for _ in range(4):
        link.order("target", [0.5] * 6)
    time.sleep(0.1)
    link.fault()
    assert link.waiting() == 5
    began = time.monotonic()
    link.close()
    assert time.monotonic() - began < 3.0


def test_a_sensor_that_falls_silent_is_no_force_and_no_fault_of_the_link(begin: Begin) -> None:
    link = begin("sensor fails")
    try:
        watched(link, lambda: (link.state() or (0.0,) * 5)[4] == [0.0, 0.0, 1.5])
        watched(link, lambda: (link.state() or (0.0,) * 5)[4] is None)
        assert link.fault() is None
    finally:
        link.close()
