"""A UR controller as far as ``ur_rtde`` sees one: RTDE, script and dashboard ports on an address of its own.

It speaks the protocol and moves an `Arm`; nothing of the arm's script is run. One loop does all: it reads what came,
moves the arm, and sends the state at each connection's rate. What may go wrong is in `ur_faults`; when it starts is said
in rows, so that a fault comes at the same place of a plan on any machine.
"""

from __future__ import annotations

import gc
import multiprocessing
import random
import select
import socket
import struct
import sys
import time
from typing import Any

import numpy as np
from ur_arm import GET_TCP_OFFSET, SERVO_STOP, SERVOJ, STOP_SCRIPT, Arm
from ur_faults import FAULTS, cured
from ur_wire import FOREVER_S, Connection, Weather

__all__ = ["SERVOJ", "SERVO_STOP", "STOP_SCRIPT", "Arm", "Double"]

SIZES = {"DOUBLE": "d", "VECTOR6D": "6d", "VECTOR3D": "3d", "INT32": "i", "UINT32": "I", "UINT64": "Q", "VECTOR6INT32": "6i", "UINT8": "B", "BOOL": "?"}  # fmt: skip
PORTS = {30004: "receive", 30003: "script", 29999: "dashboard"}
VERSION, CONTROLLER, OUTPUTS, INPUTS, START, PAUSE, DATA = 86, 118, 79, 73, 83, 80, 85
TICK_S = 0.002
DASHBOARD = {
    b"PolyscopeVersion": b"URSoftware 5.13.0.1 (Sep 01 2022)",
    b"get serial number": b"20225000000",
    b"get robot model": b"UR5",
    b"is in remote control": b"true",
    b"robotmode": b"Robotmode: RUNNING",
    b"safetystatus": b"Safetystatus: NORMAL",
}


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
    if name.startswith(("actual_q", "actual_current", "target_q", "target_current", "target_moment", "joint_", "actual_TCP_", "target_TCP_", "actual_joint_voltage", "ft_raw", "tcp_offset")):
        return "VECTOR6D"
    return "DOUBLE"


class Controller:
    """The three servers on one loopback address, and the arm."""

    def __init__(self, host: str, q: list[float]) -> None:
        self.host, self.dice = host, random.Random(0)
        self.arm = Arm(q, time.monotonic())
        self.weather = {role: Weather() for role in ("control", "receive", "io", "script", "dashboard")}
        self.connections: list[Connection] = []
        self.listeners: dict[socket.socket, str] = {}
        self.frozen: dict[str, Any] | None = None
        """The last outputs, while they do not change."""
        self.came_s: list[float] = []
        """When each servoj row arrived."""
        self.record: list[tuple[float, ...]] = []
        """A tick a row: time, s; six joints, rad; rows that arrived; whether a fault has begun."""
        self.fault_s = FOREVER_S
        """When the fault began, on the clock of `record`."""
        self._fault: tuple[str, int] | None = None
        self._later: list[tuple[float, Any]] = []
        self._began = False
        self.listen()

    def listen(self) -> None:
        for port, role in PORTS.items():
            if role in self.listeners.values():
                continue
            try:
                listener = socket.create_server((self.host, port))
            except OSError:
                if not self._began:
                    raise
                # an old connection still holds the port
                self.later(0.2, self.listen)
                continue
            listener.setblocking(False)
            self.listeners[listener] = role
        self._began = True

    def deafen(self) -> None:
        """Nobody connects any more."""
        for listener in self.listeners:
            listener.close()
        self.listeners.clear()

    def arrange(self, name: str, row: int) -> None:
        """Lets a fault begin when so many rows have arrived."""
        self._fault = (name, row)

    def mark(self) -> float:
        """A fault on the client's side begins now."""
        self.fault_s = time.monotonic()
        return self.fault_s

    def cured(self) -> None:
        cured(self)

    def rows(self) -> int:
        return len(self.arm.sent)

    def times(self) -> list[float]:
        return self.came_s

    def later(self, seconds: float, what: Any) -> None:
        self._later.append((time.monotonic() + seconds, what))

    def cut(self, *roles: str) -> None:
        for connection in self.connections:
            if connection.role in roles:
                connection.cut()

    def hang_up(self, *roles: str) -> None:
        """Ends connections in order, with a FIN."""
        for connection in self.connections:
            if connection.role in roles:
                connection.close()

    def run(self, pipe: Any) -> None:
        """Serves until the pipe says None."""
        due_s = time.monotonic()
        while True:
            sockets: list[Any] = [c.socket for c in self.connections if not c.closed]
            wait_s = max(0.0, due_s - time.monotonic())
            readable, _, _ = select.select([*sockets, *self.listeners, pipe], [], [], wait_s)
            now_s = time.monotonic()
            if pipe in readable and not self._told(pipe):
                return
            for listener in [found for found in self.listeners if found in readable]:
                self._accept(listener)
            for connection in self.connections:
                if connection.socket in readable and not connection.closed:
                    self._read(connection, now_s)
            self._deliver(now_s)
            if now_s >= due_s:
                self._tick(now_s)
                due_s = max(due_s + TICK_S, now_s)
            for connection in self.connections:
                if not connection.closed:
                    connection.flush(now_s)
            self.connections = [c for c in self.connections if not c.closed]

    def _told(self, pipe: Any) -> bool:
        try:
            asked = pipe.recv()
        except EOFError:
            return False
        if asked is None:
            return False
        match asked:
            case ("get", name):
                pipe.send(getattr(self.arm, name) if hasattr(self.arm, name) else getattr(self, name))
            case ("set", name, value):
                setattr(self.arm, name, value)
                pipe.send(None)
            case ("call", name, *values):
                pipe.send(getattr(self, name)(*values))
        return True

    def rest(self) -> tuple[Any, float]:
        """The record, and when the fault began."""
        return np.array(self.record).reshape(-1, 8), self.fault_s

    def _tick(self, now_s: float) -> None:
        self.arm.advance(now_s)
        rows = len(self.arm.sent)
        if self._fault is not None and rows >= self._fault[1]:
            name, self._fault, self.fault_s = self._fault[0], None, now_s
            FAULTS[name](self)
        for due_s, what in [entry for entry in self._later if entry[0] <= now_s]:
            self._later.remove((due_s, what))
            what()
        if rows:
            self.record.append((now_s, *self.arm.true_q, rows))
        for connection in self.connections:
            if now_s >= connection.due_s - 0.5 * TICK_S and not connection.closed:
                connection.due_s = max(connection.due_s + connection.period_s, now_s)
                connection.outbound.put(now_s, self._state(connection), data=True)

    def _state(self, connection: Connection) -> bytes:
        values: list[Any] = []
        for name in connection.outputs:
            value = self.frozen.get(name) if self.frozen is not None and name in self.frozen else self.arm.value(name)
            if value is None:
                code = SIZES[type_of(name)]
                value = [0] * int(code[:-1]) if len(code) > 1 else 0
            values += value if isinstance(value, list) else [value]
        return _frame(DATA, struct.pack(connection.code, 1, *values))

    def freeze(self) -> None:
        """From now on every state that is sent is this one."""
        names = {name for c in self.connections for name in c.outputs if not name.startswith("output_")}
        self.frozen = {name: value for name in names if (value := self.arm.value(name)) is not None}

    def _accept(self, listener: socket.socket) -> None:
        try:
            connection, _ = listener.accept()
            connection.setblocking(False)
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        except OSError:
            # the client has gone again
            return
        role = self.listeners[listener]
        made = Connection(connection, role, self.weather[role], self.dice)
        if role == "dashboard":
            made.outbound.put(time.monotonic(), b"Connected: Universal Robots Dashboard Server\n", data=False)
        self.connections.append(made)

    def _read(self, connection: Connection, now_s: float) -> None:
        try:
            piece = connection.socket.recv(65536)
        except BlockingIOError:
            return
        except OSError:
            piece = b""
        if not piece:
            connection.close()
        elif not connection.weather.deaf:
            connection.text += piece
            for message in self._messages(connection):
                data = connection.role in ("control", "receive", "io") and message[2] == DATA
                connection.inbound.put(now_s, message, data=data)

    def _messages(self, connection: Connection) -> list[bytes]:
        found = []
        if connection.role in ("script", "dashboard"):
            end = b"\nend\n" if connection.role == "script" else b"\n"
            *found, connection.text = connection.text.split(end)
            return found
        while len(connection.text) >= 3:
            size = struct.unpack(">H", connection.text[:2])[0]
            if size < 3 or len(connection.text) < size:
                break
            found.append(connection.text[:size])
            connection.text = connection.text[size:]
        return found

    def _deliver(self, now_s: float) -> None:
        for connection in self.connections:
            for message in connection.inbound.due(now_s):
                if connection.role == "script":
                    self.arm.start_program()
                elif connection.role == "dashboard":
                    answer = (DASHBOARD | self.arm.dashboard).get(message.strip(), b"done") + b"\n"
                    connection.outbound.put(now_s, answer, data=False)
                else:
                    self._rtde(connection, message[2], message[3:], now_s)

    def _rtde(self, connection: Connection, kind: int, body: bytes, now_s: float) -> None:
        def answer(payload: bytes) -> None:
            connection.outbound.put(now_s, _frame(kind, payload), data=False)

        if kind == VERSION:
            answer(b"\x01")
        elif kind == CONTROLLER:
            answer(struct.pack(">4I", 5, 13, 0, 1))
        elif kind == OUTPUTS:
            names = body[8:].decode().strip("\0").split(",")
            connection.period_s, connection.outputs = max(1.0 / struct.unpack(">d", body[:8])[0], self.arm.least_period_s), names
            connection.code = ">B" + "".join(SIZES[type_of(n)] for n in names)
            answer(b"\x01" + ",".join(map(type_of, names)).encode())
        elif kind == INPUTS:
            names = [n for n in body.decode().strip("\0").split(",") if n]
            connection.recipes[len(connection.recipes) + 1] = names
            if connection.role == "receive":
                connection.role = "control" if names[0] == "input_int_register_0" else "io"
                connection.into(self.weather[connection.role])
            answer(bytes([len(connection.recipes)]) + ",".join(map(type_of, names)).encode())
        elif kind in (START, PAUSE):
            connection.due_s = now_s if kind == START else FOREVER_S
            answer(b"\x01")
        elif kind == DATA:
            self._input(connection, body, now_s)

    def _input(self, connection: Connection, body: bytes, now_s: float) -> None:
        if (names := connection.recipes.get(body[0])) is None:
            # a client that connected again and did not say what it sends
            return
        values = dict(zip(names, struct.unpack(">" + "".join(SIZES[type_of(n)] for n in names), body[1:])))
        doubles = [v for n, v in values.items() if "double_register" in n]
        self.arm.hear(now_s)
        if names[0] == "input_int_register_0":
            self.arm.command(values[names[0]], doubles)
            if len(self.arm.sent) > len(self.came_s):
                self.came_s.append(now_s)
            if values[names[0]] == GET_TCP_OFFSET:
                offset = self.arm.values.get("tcp_offset", [0.0] * 6)
                self.arm.values |= {f"output_double_register_{n}": v for n, v in enumerate(offset)}
        elif "standard_digital_output_mask" in values:
            mask = values["standard_digital_output_mask"]
            self.arm.switch(mask, values["standard_digital_output"])


def _frame(kind: int, body: bytes) -> bytes:
    return struct.pack(">HB", len(body) + 3, kind) + body


def _serve(host: str, q: list[float], pipe: Any) -> None:
    gc.disable()
    sys.setswitchinterval(1e-3)
    try:
        controller = Controller(host, q)
    except OSError as error:
        pipe.send(error)
        return
    pipe.send("up")
    controller.run(pipe)


class Double:
    """A controller in a process of its own: the real client holds Python's lock while it connects."""

    def __init__(self, host: str, q: Any) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, there = context.Pipe()
        self._process = context.Process(target=_serve, args=(host, list(map(float, q)), there), daemon=True)
        self._process.start()
        if (said := self._pipe.recv()) != "up":
            raise said
        self.host = host

    def get(self, name: str) -> Any:
        return self._ask("get", name)

    def set(self, name: str, value: Any) -> None:
        self._ask("set", name, value)

    def call(self, name: str, *values: Any) -> Any:
        """Calls a method of the `Controller`."""
        return self._ask("call", name, *values)

    def _ask(self, *message: Any) -> Any:
        self._pipe.send(message)
        return self._pipe.recv()

    def __enter__(self) -> Double:
        return self

    def __exit__(self, *_: object) -> None:
        try:
            self._pipe.send(None)
        except BrokenPipeError:
            pass
        self._process.join(5)
