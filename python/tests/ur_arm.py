"""A UR arm as its controller moves it: servoj with a lag, stops with a deceleration, a watchdog, safety modes.

The motion is that of six joints that follow the last row by a critically damped second-order filter, `LAG_S` behind a
ramp, within an acceleration; a stop scales all joint speeds down together, so that it is a straight line in joint space.
The speed slider scales time. Units: rad, s. Not here: sockets, dynamics, the arm's script.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

SERVOJ, SERVO_STOP, SET_WATCHDOG, GET_TCP_OFFSET, STOP_SCRIPT = 11, 16, 35, 40, 255
STOPPED, PLAYING, PAUSED = 1, 2, 4
NORMAL, PROTECTIVE, EMERGENCY = 1, 3, 7
RUNNING, IDLE, POWER_OFF = 7, 5, 3

LAG_S = 0.034
"""How far servoj is behind a ramp at lookahead 0.03 s and gain 2000 (measured by users of real arms)."""
GAIN_S = 8.0
"""What a gain adds to that lag, times the gain; assumed."""
MOST_ACCELERATION = 40.0
"""rad/s², the largest that servoj's interface names."""
STOP_DECELERATION = 10.0
"""rad/s² of servoStop without a number, of a script that ends and of safety stops; assumed."""
STEP_S = 0.001
UR5E_A_MM = np.array([0, -425.0, -392.2, 0, 0, 0])
UR5E_D_MM = np.array([162.5, 0, 0, 133.3, 99.7, 99.6])
UR5E_ALPHA_RAD = np.array([0.5, 0, 0, 0.5, -0.5, 0]) * np.pi
BURR_Z_MM = 180.0
"""The burr's centre lies so far before the flange, the handpiece behind it: `flange_from_burr` is turned by pi about x."""


def flange_poses(q: Floats) -> Floats:
    """The UR5e's flange in its base by the published DH parameters, mm, shape (n, 4, 4); q has shape (n, 6)."""
    pose = np.broadcast_to(np.eye(4), (len(q), 4, 4)).copy()
    for joint in range(6):
        c, s = np.cos(q[:, joint]), np.sin(q[:, joint])
        ca, sa = np.cos(UR5E_ALPHA_RAD[joint]), np.sin(UR5E_ALPHA_RAD[joint])
        step = np.zeros((len(q), 4, 4))
        step[:, 0, :] = np.stack([c, -s * ca, s * sa, UR5E_A_MM[joint] * c], axis=1)
        step[:, 1, :] = np.stack([s, c * ca, -c * sa, UR5E_A_MM[joint] * s], axis=1)
        step[:, 2, 1:] = [sa, ca, UR5E_D_MM[joint]]
        step[:, 3, 3] = 1.0
        pose = pose @ step
    return pose


def burr_mm(q: Floats) -> Floats:
    """The burr's centre in base, shape (n, 3)."""
    pose = flange_poses(q)
    return pose[:, :3, 3] + BURR_Z_MM * pose[:, :3, 2]


def tool_pose(q: Floats) -> list[float]:
    """The controller's tool centre point for one joint vector: m, and the rotation vector, rad."""
    rotation = flange_poses(q[None])[0, :3, :3] @ np.diag([1.0, -1.0, -1.0])
    place_m = burr_mm(q[None])[0] / 1e3
    angle = float(np.arccos(np.clip((np.trace(rotation) - 1.0) / 2.0, -1.0, 1.0)))
    values, vectors = np.linalg.eigh(0.5 * (rotation + rotation.T))
    axis = vectors[:, values.argmax()]
    twist = np.array([rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]])
    return [*place_m.tolist(), *(angle * axis * (1.0 if twist @ axis >= 0 else -1.0)).tolist()]


class Arm:
    """What the controller knows, and the joints; a test changes it."""

    def __init__(self, q: Sequence[float], now_s: float) -> None:
        self.true_q = np.array(q, dtype=np.float64)
        """Where the joints are."""
        self.qd = np.zeros(6)
        self.target = self.true_q.copy()
        self.offset = np.zeros(6)
        """The arm stands so far from where it is told to stand."""
        self.sent: list[list[float]] = []
        """Every servoj row that arrived."""
        self.commands: list[int] = []
        self.stuck = False
        """Rows arrive and are not followed."""
        self.speed_fraction = 1.0
        self.safety_mode = NORMAL
        self.robot_mode = RUNNING
        self.runtime_state = STOPPED
        self.ready = 0
        self.digital_outputs = 0
        self.outputs_stuck = False
        """Outputs do not switch."""
        self.freedrive = False
        self.lag_s = LAG_S
        self.least_period_s = 0.002
        """The controller's own, whatever a client asks for."""
        self.dashboard: dict[bytes, bytes] = {}
        """Answers before all else."""
        self.values: dict[str, Any] = {}
        """Outputs by their RTDE name, before all else."""
        self._stopping = 0.0
        self._watchdog_s = float("inf")
        self._heard_s = self._now_s = self._began_s = now_s
        self._clock_s = 0.0

    @property
    def q(self) -> list[float]:
        return self.true_q.tolist()

    @q.setter
    def q(self, value: Sequence[float]) -> None:
        """Puts an arm at rest somewhere else."""
        self.true_q = np.array(value, dtype=np.float64)
        self.target, self.qd = self.true_q.copy(), np.zeros(6)

    def command(self, number: int, doubles: list[float]) -> None:
        """What the arm's script does with a command in its registers; 0 clears the last one."""
        if number == 0:
            self.ready = 1
            return
        self.commands.append(number)
        if number == SERVOJ:
            self.sent.append(doubles[:6])
            self.lag_s = doubles[9] + GAIN_S / doubles[10]
            if self.runtime_state == PLAYING and not self.stuck:
                self.target, self._stopping = np.array(doubles[:6]) + self.offset, 0.0
            return
        if number == SET_WATCHDOG:
            self._watchdog_s = 1.0 / doubles[0]
        if number == SERVO_STOP:
            self.brake(doubles[0] if doubles and doubles[0] > 0 else STOP_DECELERATION)
        if number == STOP_SCRIPT:
            self.end_program()
        self.ready = 2

    def hear(self, now_s: float) -> None:
        """An input package feeds the watchdog."""
        self._heard_s = now_s

    def start_program(self) -> None:
        """A script arrived."""
        if self.safety_mode == NORMAL and self.robot_mode == RUNNING:
            self.runtime_state, self.ready, self._watchdog_s = PLAYING, 1, float("inf")
            self.target, self._stopping = self.true_q.copy(), 0.0

    def end_program(self) -> None:
        if self.runtime_state == PLAYING:
            self.brake(STOP_DECELERATION)
        self.runtime_state = STOPPED

    def safety_stop(self, mode: int) -> None:
        self.safety_mode = mode
        self.robot_mode = POWER_OFF if mode == EMERGENCY else RUNNING
        self.end_program()

    def switch(self, mask: int, values: int) -> None:
        """Standard outputs of a mask."""
        if not self.outputs_stuck:
            self.digital_outputs = self.digital_outputs & ~mask | values & mask

    def brake(self, deceleration: float) -> None:
        self._stopping = deceleration

    def advance(self, now_s: float) -> None:
        """Moves the joints up to now."""
        if self.runtime_state == PLAYING and now_s - self._heard_s > self._watchdog_s:
            self.end_program()
        while self._now_s + STEP_S <= now_s:
            self._now_s += STEP_S
            self._clock_s += STEP_S
            self._step(STEP_S * self.speed_fraction)

    def _step(self, dt: float) -> None:
        if self._stopping or self.runtime_state != PLAYING:
            fastest = float(np.abs(self.qd).max())
            share = max(0.0, 1.0 - (self._stopping or STOP_DECELERATION) * STEP_S / fastest) if fastest > 0 else 0.0
            self.true_q += share * self.qd * dt
            self.qd *= share
            return
        w = 2.0 / self.lag_s
        pull = w * w * (self.target - self.true_q) - 2.0 * w * self.qd
        self.qd += np.clip(pull, -MOST_ACCELERATION, MOST_ACCELERATION) * dt
        self.true_q += self.qd * dt

    def clock_s(self) -> float:
        """Its clock; a slow controller's goes on by its whole periods."""
        period_s = self.least_period_s
        return self._clock_s // period_s * period_s if period_s > 0.002 else self._clock_s

    def value(self, name: str) -> Any:
        """An RTDE output; 0 for what is not modelled."""
        if name in self.values:
            return self.values[name]
        bits = {NORMAL: 1, PROTECTIVE: 1 << 2 | 1 << 10, EMERGENCY: 1 << 6 | 1 << 7 | 1 << 10}
        known = {
            "actual_q": self.q,
            "target_q": self.target.tolist(),
            "actual_qd": self.qd.tolist(),
            "safety_mode": self.safety_mode,
            "safety_status": self.safety_mode,
            "robot_mode": self.robot_mode,
            "runtime_state": self.runtime_state,
            "target_speed_fraction": self.speed_fraction,
            "speed_scaling": 1.0,
            "output_int_register_0": self.ready,
            "robot_status_bits": 1 | (self.runtime_state == PLAYING) << 1 | self.freedrive << 2,
            "safety_status_bits": bits.get(self.safety_mode, 0),
            "actual_digital_output_bits": self.digital_outputs,
            "timestamp": self.clock_s(),
            "payload": 1.0,
        }
        return tool_pose(self.true_q) if name == "actual_TCP_pose" else known.get(name)
