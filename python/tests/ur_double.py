"""A UR controller as far as ``ur_rtde`` sees one: RTDE, script and dashboard ports on an address of its own.

It speaks the protocol, takes servoJ rows and reports them back after a lag, like an arm that follows. Nothing of the
arm's script is run.
"""

from __future__ import annotations

import multiprocessing
import socket
import struct
import threading
import time
from collections import deque
from typing import Any

SIZES = {"DOUBLE": "d", "VECTOR6D": "6d", "VECTOR3D": "3d", "INT32": "i", "UINT32": "I", "UINT64": "Q", "VECTOR6INT32": "6i", "UINT8": "B", "BOOL": "?"}
SERVOJ, SERVO_STOP, STOP_SCRIPT = 11, 16, 255
PLAYING, STOPPED = 2, 1


def type_of(name: str) -> str:
    """The RTDE type of a variable."""
    if "double_register" in name:
        return "DOUBLE"
    if "int_register" in name or name in ("robot_mode", "safety_mode", "joint_mode"):
        return "VECTOR6INT32" if name == "joint_mode" else "INT32"
    if "bit_register" in name and "registers" not in name:
        return "BOOL"
    if name in ("runtime_state", "robot_status_bits", "safety_status_bits", "safety_status") or "bit_registers" in name:
        return "INT32" if name == "safety_status" else "UINT32"
    if "digital_input_bits" in name or "digital_output_bits" in name:
        return "UINT64"
    if "digital_output" in name or name == "speed_slider_mask" or name.endswith(("_mask", "_type")) or "tool_" in name and name.endswith("mode"):
        return "UINT32" if name == "speed_slider_mask" else "UINT8"
    if name in ("elbow_position", "elbow_velocity", "tool_accelerometer", "actual_tool_accelerometer", "payload_cog"):
        return "VECTOR3D"
    if name.startswith(("actual_q", "actual_current", "target_q", "target_current", "target_moment", "joint_", "actual_TCP_", "target_TCP_", "actual_joint_voltage", "ft_raw")):
        return "VECTOR6D"
    return "DOUBLE"


class Arm:
    """What the controller knows; a test changes it."""

    def __init__(self, q: list[float]) -> None:
        self.q = list(q)
        self.sent: list[list[float]] = []
        self.lag_rows = 4
        self.stuck = False
        self.speed_fraction = 1.0
        self.safety_mode = 1
        self.runtime_state = STOPPED
        self.ready = 0
        self.commands: list[int] = []
        self._told: deque[list[float]] = deque()

    def command(self, number: int, doubles: list[float]) -> None:
        if number == 0:
            self.ready = 1
            return
        self.commands.append(number)
        if number == SERVOJ:
            self.sent.append(doubles[:6])
            self._told.append(doubles[:6])
            if len(self._told) > self.lag_rows and not self.stuck:
                self.q = self._told.popleft()
            return
        if number == STOP_SCRIPT:
            self.runtime_state = STOPPED
        self.ready = 2

    def value(self, name: str) -> Any:
        known = {
            "actual_q": self.q,
            "target_q": self.q,
            "safety_mode": self.safety_mode,
            "robot_mode": 7,
            "runtime_state": self.runtime_state,
            "target_speed_fraction": self.speed_fraction,
            "speed_scaling": self.speed_fraction,
            "output_int_register_0": self.ready,
            "robot_status_bits": 3,
            "safety_status_bits": 1,
            "safety_status": 1,
            "timestamp": time.monotonic(),
        }
        if name in known:
            return known[name]
        code = SIZES[type_of(name)]
        return [0] * int(code[:-1]) if len(code) > 1 else 0


class Controller:
    """The three servers on one loopback address."""

    def __init__(self, host: str, arm: Arm) -> None:
        self.host, self.arm = host, arm
        self._closing = threading.Event()
        self._sockets: list[socket.socket] = []
        self._threads: list[threading.Thread] = []
        for port, serve in ((30004, self._rtde), (30003, self._script), (29999, self._dashboard)):
            listener = socket.create_server((host, port))
            listener.settimeout(0.1)
            self._sockets.append(listener)
            self._start(self._accept, listener, serve)

    def __enter__(self) -> Controller:
        return self

    def __exit__(self, *_: object) -> None:
        self._closing.set()
        for thread in self._threads:
            thread.join()
        for listener in self._sockets:
            listener.close()

    def _start(self, target: Any, *args: Any) -> None:
        thread = threading.Thread(target=target, args=args, daemon=True)
        self._threads.append(thread)
        thread.start()

    def _accept(self, listener: socket.socket, serve: Any) -> None:
        while not self._closing.is_set():
            try:
                connection, _ = listener.accept()
            except TimeoutError:
                continue
            connection.settimeout(0.1)
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._start(self._guarded, serve, connection)

    def _guarded(self, serve: Any, connection: socket.socket) -> None:
        with connection:
            try:
                serve(connection)
            except OSError:
                pass

    def _lines(self, connection: socket.socket, end: bytes) -> Any:
        text = b""
        while not self._closing.is_set():
            try:
                piece = connection.recv(65536)
            except TimeoutError:
                continue
            if not piece:
                return
            text += piece
            while end in text:
                line, text = text.split(end, 1)
                yield line

    def _dashboard(self, connection: socket.socket) -> None:
        connection.sendall(b"Connected: Universal Robots Dashboard Server\n")
        answers = {
            b"PolyscopeVersion": b"URSoftware 5.13.0.1 (Sep 01 2022)\n",
            b"get serial number": b"20225000000\n",
            b"is in remote control": b"true\n",
        }
        for line in self._lines(connection, b"\n"):
            connection.sendall(answers.get(line.strip(), b"done\n"))

    def _script(self, connection: socket.socket) -> None:
        for _ in self._lines(connection, b"\nend\n"):
            self.arm.runtime_state, self.arm.ready = PLAYING, 1

    def _rtde(self, connection: socket.socket) -> None:
        recipes: dict[int, list[str]] = {}
        outputs: list[str] = []
        period, sending, due = 0.008, False, time.monotonic()
        data = b""
        while not self._closing.is_set():
            if sending and time.monotonic() >= due:
                due += period
                values: list[Any] = []
                for name in outputs:
                    value = self.arm.value(name)
                    values += value if isinstance(value, list) else [value]
                code = ">B" + "".join(SIZES[type_of(n)] for n in outputs)
                connection.sendall(_frame(85, struct.pack(code, 1, *values)))
            connection.settimeout(max(1e-4, min(0.05, due - time.monotonic())) if sending else 0.05)
            try:
                piece = connection.recv(65536)
                if not piece:
                    return
                data += piece
            except TimeoutError:
                continue
            while len(data) >= 3:
                (size, kind) = struct.unpack(">HB", data[:3])
                if len(data) < size:
                    break
                body, data = data[3:size], data[size:]
                if kind == 86:
                    connection.sendall(_frame(86, b"\x01"))
                elif kind == 118:
                    connection.sendall(_frame(118, struct.pack(">4I", 5, 13, 0, 1)))
                elif kind == 79:
                    (rate,) = struct.unpack(">d", body[:8])
                    period, outputs = 1.0 / rate, body[8:].decode().strip("\0").split(",")
                    types = ",".join(type_of(n) for n in outputs)
                    connection.sendall(_frame(79, b"\x01" + types.encode()))
                elif kind == 73:
                    names = [n for n in body.decode().strip("\0").split(",") if n]
                    recipes[len(recipes) + 1] = names
                    types = ",".join(type_of(n) for n in names)
                    connection.sendall(_frame(73, bytes([len(recipes)]) + types.encode()))
                elif kind in (83, 80):
                    sending, due = kind == 83, time.monotonic()
                    connection.sendall(_frame(kind, b"\x01"))
                elif kind == 85:
                    names = recipes[body[0]]
                    values = list(struct.unpack(">" + "".join(SIZES[type_of(n)] for n in names), body[1:]))
                    doubles = [v for n, v in zip(names, values) if "double_register" in n]
                    if names[0] == "input_int_register_0":
                        self.arm.command(values[0], doubles)


def _frame(kind: int, body: bytes) -> bytes:
    return struct.pack(">HB", len(body) + 3, kind) + body


def _serve(host: str, q: list[float], pipe: Any) -> None:
    arm = Arm(q)
    try:
        with Controller(host, arm):
            pipe.send("up")
            for name, value in iter(pipe.recv, None):
                if value is None:
                    pipe.send(getattr(arm, name))
                else:
                    setattr(arm, name, value)
                    pipe.send(None)
    except OSError as error:
        pipe.send(error)


class Double:
    """A controller in a process of its own: the real client holds Python's lock while it connects."""

    def __init__(self, host: str, q: list[float]) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, there = context.Pipe()
        self._process = context.Process(target=_serve, args=(host, list(map(float, q)), there), daemon=True)
        self._process.start()
        if (said := self._pipe.recv()) != "up":
            raise said
        self.host = host

    def get(self, name: str) -> Any:
        self._pipe.send((name, None))
        return self._pipe.recv()

    def set(self, name: str, value: Any) -> None:
        self._pipe.send((name, value))
        self._pipe.recv()

    def __enter__(self) -> Double:
        return self

    def __exit__(self, *_: object) -> None:
        self._pipe.send(None)
        self._process.join(5)
