"""What may go wrong at a controller or on the way to it, by name: each a function of the `Controller`, from then on."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from ur_arm import EMERGENCY, NORMAL, PROTECTIVE
from ur_wire import FOREVER_S

Fault = Callable[[Any], None]
RTDE = ("control", "receive", "io")
ALL = (*RTDE, "script", "dashboard")


def _cut(*roles: str) -> Fault:
    return lambda controller: controller.cut(*roles)


def _weather(roles: tuple[str, ...] = ALL, **changes: Any) -> Fault:
    def change(controller: Any) -> None:
        for role in roles:
            for name, value in changes.items():
                setattr(controller.weather[role], name, value)

    return change


def _stall(seconds: float) -> Fault:
    return lambda controller: _weather(stalled_until_s=time.monotonic() + seconds)(controller)


def _dead(controller: Any) -> None:
    """Power is gone: brakes, no answer, no new connection; the client's sockets stay open."""
    controller.arm.end_program()
    controller.deafen()
    _weather(stalled_until_s=FOREVER_S)(controller)


def _restarted(controller: Any) -> None:
    """Brakes, resets, and two seconds later a controller without a program."""
    controller.arm.end_program()
    controller.deafen()
    controller.cut(*ALL)
    controller.later(2.0, controller.listen)


def _closed(controller: Any) -> None:
    """The controller closes every connection and takes none; its program ends, its outputs stay."""
    controller.arm.end_program()
    controller.deafen()
    controller.hang_up(*ALL)


def _output(changes: dict[str, Any]) -> Fault:
    return lambda controller: [setattr(controller.arm, name, value) for name, value in changes.items()]


def _slider(fraction: float) -> Fault:
    return lambda controller: setattr(controller.arm, "speed_fraction", fraction)


def _ignores(seconds: float) -> Fault:
    """Rows are not followed for a while, then they are."""

    def ignore(controller: Any) -> None:
        controller.arm.stuck = True
        controller.later(seconds, lambda: setattr(controller.arm, "stuck", False))

    return ignore


OFFSET, OFFSET_RAD = "joint offset 9.5 mrad", 0.0095


def _offset(controller: Any) -> None:
    """Every joint stands so far beside where it is told to stand."""
    controller.arm.offset = np.full(6, OFFSET_RAD)


FAULTS: dict[str, Fault] = {
    "both sockets cut": _cut(*RTDE),
    "receive cut": _cut("receive"),
    "control cut": _cut("control"),
    "dashboard cut": _cut("dashboard"),
    "half-open": _weather(("control",), deaf=True),
    "stall 20 ms": _stall(0.02),
    "stall 85 ms": _stall(0.085),
    "stall 100 ms": _stall(0.1),
    "stall 250 ms": _stall(0.25),
    "stall 2 s": _stall(2.0),
    "stall for ever": _stall(FOREVER_S),
    "delay 50 ms": _weather(RTDE, delay_s=0.05),
    "delay 150 ms": _weather(RTDE, delay_s=0.15),
    "jitter 5 ms": _weather(RTDE, jitter_s=0.005),
    "jitter 20 ms": _weather(RTDE, jitter_s=0.02),
    "packets twice": _weather(RTDE, twice=0.1),
    "packets mixed": _weather(RTDE, mixed=0.1),
    "outputs frozen": lambda controller: controller.freeze(),
    "controller dead": _dead,
    "controller restarted": _restarted,
    "protective stop": lambda controller: controller.arm.safety_stop(PROTECTIVE),
    "emergency stop": lambda controller: controller.arm.safety_stop(EMERGENCY),
    "pendant stop": lambda controller: controller.arm.end_program(),
    "slider 0 %": _slider(0.0),
    "slider 10 %": _slider(0.1),
    "slider 50 %": _slider(0.5),
    "arm ignores, then follows": _ignores(0.3),
    "controller closed": _closed,
    "spindle's connection closed": lambda controller: controller.hang_up("io"),
    "spindle's output goes off": _output({"digital_outputs": 0}),
    "spindle's output stays": _output({"outputs_stuck": True}),
    OFFSET: _offset,
}


def cured(controller: Any) -> None:
    """Everything works again, as after a repair; the arm stays where it is."""
    for weather in controller.weather.values():
        weather.__init__()
    arm = controller.arm
    arm.end_program()
    arm.safety_mode, arm.robot_mode, arm.speed_fraction, arm.stuck = NORMAL, 7, 1.0, False
    arm.offset, controller.frozen = np.zeros(6), None
    arm.outputs_stuck, arm.digital_outputs = False, 0
    controller.cut(*ALL)
    if not controller.listeners:
        controller.listen()
