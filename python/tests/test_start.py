"""The start conditions: each is looked at when the controller has answered, and again when the user has agreed."""

import time
from pathlib import Path
from typing import Any

import pytest
from addresses import addresses
from streaming import Yes, ready, run_with
from ur_arm import IDLE, PAUSED, PLAYING, POWER_OFF
from ur_double import Double

pytest.importorskip("rtde_control")

CONDITIONS = {
    "another program": ("runtime_state", PLAYING, "a program already runs on the controller"),
    "a paused program": ("runtime_state", PAUSED, "a program is paused on the controller"),
    "power off": ("robot_mode", POWER_OFF, "robot mode is 3 (power off)"),
    "brakes closed": ("robot_mode", IDLE, "brakes are closed"),
    "freedrive": ("freedrive", True, "freedrive"),
    "safety stop": ("safety_mode", 3, "safety mode is 3 (protective stop)"),
    "slider": ("speed_fraction", 0.5, "slider is at 50 %"),
    "payload": ("values", {"payload": 2.0}, "carries 2.00 kg on its flange, expected 1.00 kg"),
    "tool centre point": ("values", {"actual_TCP_pose": [0.0] * 6}, "Set the tool centre point"),
    "spindle on": ("digital_outputs", 1, "the spindle's output is on"),
    "local control": ("dashboard", {b"is in remote control": b"false"}, "local control"),
}


@pytest.mark.parametrize("when", ["connected", "asked"])
@pytest.mark.parametrize("condition", CONDITIONS)
def test_what_does_not_hold_is_told_and_nothing_is_started(judged: Path, condition: str, when: str) -> None:
    name, value, says = CONDITIONS[condition]
    streaming = ready(judged)
    with Double(next(addresses), streaming.joints(0.0)) as double:

        def change() -> None:
            double.set(name, value)
            # until every client has heard it
            time.sleep(0.5)

        if when == "connected":
            double.set(name, value)
        user = Yes(change if when == "asked" else lambda: None)
        report = run_with(streaming, double, user)
        after: Any = double.get(name)
        assert double.get("sent") == [] and double.get("commands") == []
    assert report.reason is not None and says in report.reason, report
    assert len(user.asked) == (when == "asked")
    # a program that stands there is left alone
    assert after == value


def test_a_controller_at_125_hz_is_told_at_the_start(judged: Path) -> None:
    streaming = ready(judged)
    with Double(next(addresses), streaming.joints(0.0)) as double:
        double.set("least_period_s", 0.008)
        report = run_with(streaming, double, Yes())
        assert double.get("sent") == []
    assert report.reason is not None and "125 Hz" in report.reason and "robot.rate_hz = 125" in report.reason, report
