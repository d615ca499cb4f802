"""The spindle's state is read from the controller's output, not believed: nothing is fed without it, and the end says what was seen."""

from pathlib import Path

import pytest
from addresses import addresses
from fault_run import prefer
from streaming import STALL, TRIES, Yes, ready, run_with
from ur_double import Double

from bonemill.stream import Report

pytest.importorskip("rtde_control")
ROW = 500
"""A fault begins when so many targets have arrived: after the approach and the run-up."""


def ran(judged: Path, fault: str, row: int) -> tuple[Report, Yes, int, list[list[float]]]:
    """How a run with a fault ended, what was told, the outputs after it, and the targets."""
    prefer()
    streaming = ready(judged)
    for _ in range(TRIES):
        with Double(next(addresses), streaming.joints(0.0)) as double:
            double.call("arrange", fault, row)
            user = Yes()
            report = run_with(streaming, double, user)
            found = report, user, double.get("digital_outputs"), double.get("sent")
        # a busy machine may stop it before the fault begins, which contains it like any other
        if row == 0 or len(found[3]) >= row:
            return found
        assert report.reason is not None and (STALL in report.reason or "program on the controller" in report.reason), report
    pytest.fail("no run came as far as its fault")


def test_nothing_is_fed_with_an_output_that_does_not_switch(judged: Path) -> None:
    report, _, outputs, sent = ran(judged, "spindle's output stays", 0)
    assert report.reason is not None and "is not seen on" in report.reason, report
    assert report.targets == 0 and outputs == 0 and report.is_off
    first = ready(judged).joints(0.0)
    assert max(abs(a - b) for row in sent for a, b in zip(row, first, strict=True)) < 1e-6


def test_an_output_that_goes_off_under_way_stops_the_arm(judged: Path) -> None:
    report, _, outputs, sent = ran(judged, "spindle's output goes off", ROW)
    assert report.reason is not None and "went off, not by this program" in report.reason, report
    assert outputs == 0 and report.is_off and report.at_rest and len(sent) < ROW + 100


def test_the_spindles_connection_that_is_closed_is_noticed_and_the_spindle_goes_off_by_another(judged: Path) -> None:
    report, _, outputs, sent = ran(judged, "spindle's connection closed", ROW)
    assert report.reason is not None and "closed the spindle's connection" in report.reason, report
    assert outputs == 0 and report.is_off and len(sent) < ROW + 100


@pytest.mark.parametrize("fault", ["controller closed", "stall for ever"])
def test_a_spindle_that_nobody_hears_is_said_to_be_able_to_turn(judged: Path, fault: str) -> None:
    report, _, outputs, _ = ran(judged, fault, ROW)
    assert outputs == 1 and not report.is_off
    assert report.reason is not None and "the spindle's output was not seen off" in report.reason, report


def test_a_spindle_that_was_never_on_is_not_said_to_turn(judged: Path) -> None:
    streaming = ready(judged)
    with Double(next(addresses), streaming.joints(0.0)) as double:
        # another program stands on the controller by the time that the user agrees
        user = Yes(lambda: double.set("runtime_state", 2))
        report = run_with(streaming, double, user)
    assert report.reason is not None and "spindle" not in report.reason and report.is_off, report


class Watching(Yes):
    """Notes at each question what the output was; says no at a hold."""

    def __init__(self, double: Double) -> None:
        super().__init__()
        self.double, self.outputs = double, list[int]()

    def ask(self, text: str) -> None:
        super().ask(text)
        self.outputs.append(self.double.get("digital_outputs"))

    def answer(self) -> bool | None:
        answer = super().answer()
        return None if answer is None else len(self.asked) == 1


@pytest.mark.parametrize("switches", [True, False])
def test_a_hold_is_asked_about_once_the_spindle_is_seen_off(held: Path, switches: bool) -> None:
    prefer()
    streaming = ready(held)
    for _ in range(TRIES):
        with Double(next(addresses), streaming.joints(0.0)) as double:
            if not switches:
                double.call("arrange", "spindle's output stays", ROW)
            user = Watching(double)
            report = run_with(streaming, double, user)
            sent = double.get("sent")
        if len(user.asked) == 2 or (report.reason is not None and "spindle" in report.reason):
            break
        assert STALL in report.reason or "program on the controller" in report.reason, report
    assert len(sent) > ROW and user.outputs[0] == 0
    if switches:
        assert user.outputs == [0, 0] and "Held, the spindle's output is seen off: 8 mm from facial_nerve" in user.asked[1]
        assert report.reason is not None and "not confirmed by the user" in report.reason and report.is_off, report
    else:
        assert len(user.asked) == 1 and not report.is_off
        assert report.reason is not None and "was switched off and is still seen on" in report.reason and "seen ON: it turns" in report.reason, report
