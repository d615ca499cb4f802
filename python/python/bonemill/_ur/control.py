"""Orders through ``ur_rtde``, in a process of its own: ``control.py arm HOST PERIOD_S LOOKAHEAD_S GAIN WATCHDOG_HZ`` moves the
arm, ``control.py spindle HOST OUTPUT`` switches the spindle, which goes off though the arm's client hangs.

Orders come on standard input as `ORDER`, each answered on standard output by `ANSWER`. A target that a newer one follows is not
sent, so that a stop waits for one of them at most. When standard input ends, arm and spindle are stopped. Blocking calls block this
process alone; whoever started it kills it, and the controller's watchdog stops the arm.
"""

import contextlib
import os
import select
import struct
import sys
from typing import Any

ORDER = struct.Struct("<i6d")
"""What, and six values."""
ANSWER = struct.Struct("<ii200s")
"""What it answers; 0 taken, 1 not taken, 2 failed; why, as UTF-8."""
CONNECTION, START, TARGET, STOP, SPINDLE, END = range(6)
"""What is ordered; `CONNECTION` is no order: it is answered when the controller closes the connection."""
STOP_RAD_S2 = 10.0
"""Slowing of servoStop."""


class Arm:
    """The client's interface for motion, made when the first order asks for it."""

    at_the_end = (STOP, END)
    connection: int | None = None

    def __init__(self, host: str, period_s: str, lookahead_s: str, gain: str, watchdog_hz: str) -> None:
        self.host, self.period_s = host, float(period_s)
        self.lookahead_s, self.gain, self.watchdog_hz = float(lookahead_s), float(gain), float(watchdog_hz)

    def obey(self, what: int, values: tuple[float, ...]) -> bool:
        if what == START:
            import rtde_control

            self.client = rtde_control.RTDEControlInterface(self.host, 1.0 / self.period_s)
            # every target that is sent counts as a sign of life
            return bool(self.client.setWatchdog(self.watchdog_hz))
        if what == TARGET:
            # speed and acceleration are not used by servoJ
            return bool(self.client.servoJ(list(values), 0.5, 0.5, self.period_s, self.lookahead_s, self.gain))
        if what == STOP:
            return bool(self.client.servoStop(STOP_RAD_S2))
        if hasattr(self, "client"):
            self.client.stopScript()
        return True


class Spindle:
    """The client's interface for outputs, made when the first order asks for it."""

    at_the_end = (SPINDLE,)
    connection: int | None = None
    """The socket: the client does not notice that the controller has closed it, and its orders then count as taken."""

    def __init__(self, host: str, output: str) -> None:
        self.host, self.output = host, int(output)
        self.kept: list[Any] = []

    def obey(self, what: int, values: tuple[float, ...]) -> bool:
        if what == START:
            self.connect()
        if what == SPINDLE:
            if self.connection is None and values[0] < 0.5:
                # closed by the controller: off goes by a new one
                self.connect()
            return bool(self.client.setStandardDigitalOut(self.output, values[0] > 0.5))
        return True

    def connect(self) -> None:
        import rtde_io

        before = sockets()
        # the destructor of one whose connection is closed ends the process
        self.kept.append(rtde_io.RTDEIOInterface(self.host))
        self.client = self.kept[-1]
        self.connection = max(sockets() - before, default=None)


def sockets() -> set[int]:
    """The numbers of this process's sockets."""
    found = set()
    for name in os.listdir("/proc/self/fd"):
        with contextlib.suppress(OSError):
            if os.readlink(f"/proc/self/fd/{name}").startswith("socket:"):
                found.add(int(name))
    return found


def wait(controlled: Arm | Spindle) -> bool:
    """Waits for an order; False: the controller has closed the connection."""
    looked_at = select.poll()
    looked_at.register(0, select.POLLIN)
    if controlled.connection is not None:
        looked_at.register(controlled.connection, select.POLLRDHUP)
    ready = dict(looked_at.poll())
    if controlled.connection in ready:
        controlled.connection = None
        return False
    return True


def main(controlled: Arm | Spindle) -> None:
    # the client prints to standard output: among the answers it would shift all that follow
    answers = os.dup(1)
    os.dup2(2, 1)
    data = b""
    while True:
        if not wait(controlled):
            os.write(answers, ANSWER.pack(CONNECTION, 2, b"the controller closed the spindle's connection"))
            continue
        piece = os.read(0, 1 << 16)
        if not piece:
            if hasattr(controlled, "client"):
                for what in controlled.at_the_end:
                    with contextlib.suppress(Exception):
                        controlled.obey(what, (0.0,))
            return
        data += piece
        whole = len(data) // ORDER.size * ORDER.size
        orders = [(o[0], o[1:]) for o in ORDER.iter_unpack(data[:whole])]
        data = data[whole:]
        for n, (what, values) in enumerate(orders):
            is_old = what == TARGET and n + 1 < len(orders) and orders[n + 1][0] == TARGET
            try:
                status, why = (0, "") if is_old or controlled.obey(what, values) else (1, "")
            except Exception as error:
                status, why = 2, str(error)
            os.write(answers, ANSWER.pack(what, status, why.encode()[:200]))
            if what == END:
                return


if __name__ == "__main__":
    role, *given = sys.argv[1:]
    main(Arm(*given) if role == "arm" else Spindle(*given))
    # the client's own destructor may wait for a controller that is gone
    os._exit(0)
