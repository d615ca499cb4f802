"""Orders to the arm through ``ur_rtde``, in a process of its own: ``control.py HOST PERIOD_S LOOKAHEAD_S GAIN WATCHDOG_HZ OUTPUT``.

Orders come on standard input as `ORDER`, each answered on standard output by `ANSWER`. A target that a newer one follows is not
sent, so that a stop waits for one of them at most. When standard input ends, the arm is stopped. Blocking calls block this
process alone; whoever started it kills it, and the controller's watchdog stops the arm.
"""

import contextlib
import os
import struct
import sys

ORDER = struct.Struct("<i6d")
"""What, and six values."""
ANSWER = struct.Struct("<ii200s")
"""What it answers; 0 taken, 1 not taken, 2 failed; why, as UTF-8."""
START, TARGET, STOP, SPINDLE, END = range(1, 6)
STOP_RAD_S2 = 10.0
"""Slowing of servoStop."""


class Control:
    """The client's interfaces, made when the first order asks for them."""

    def __init__(self, host: str, period_s: float, lookahead_s: float, gain: float, watchdog_hz: float, output: int) -> None:
        self.host, self.period_s, self.output = host, period_s, output
        self.lookahead_s, self.gain, self.watchdog_hz = lookahead_s, gain, watchdog_hz

    def start(self) -> bool:
        import rtde_control
        import rtde_io

        self.io = rtde_io.RTDEIOInterface(self.host)
        self.arm = rtde_control.RTDEControlInterface(self.host, 1.0 / self.period_s)
        # every target that is sent counts as a sign of life
        return bool(self.arm.setWatchdog(self.watchdog_hz))

    def obey(self, what: int, values: tuple[float, ...]) -> bool:
        if what == START:
            return self.start()
        if what == TARGET:
            # speed and acceleration are not used by servoJ
            return bool(self.arm.servoJ(list(values), 0.5, 0.5, self.period_s, self.lookahead_s, self.gain))
        if what == STOP:
            return bool(self.arm.servoStop(STOP_RAD_S2))
        if what == SPINDLE:
            return bool(self.io.setStandardDigitalOut(self.output, values[0] > 0.5))
        if hasattr(self, "arm"):
            self.arm.stopScript()
        return True


def main(control: Control) -> None:
    # the client prints to standard output: among the answers it would shift all that follow
    answers = os.dup(1)
    os.dup2(2, 1)
    data = b""
    while True:
        piece = os.read(0, 1 << 16)
        if not piece:
            if hasattr(control, "arm"):
                for what in (STOP, SPINDLE, END):
                    with contextlib.suppress(Exception):
                        control.obey(what, (0.0,))
            return
        data += piece
        whole = len(data) // ORDER.size * ORDER.size
        orders = [(o[0], o[1:]) for o in ORDER.iter_unpack(data[:whole])]
        data = data[whole:]
        for n, (what, values) in enumerate(orders):
            is_old = what == TARGET and n + 1 < len(orders) and orders[n + 1][0] == TARGET
            try:
                status, why = (0, "") if is_old or control.obey(what, values) else (1, "")
            except Exception as error:
                status, why = 2, str(error)
            os.write(answers, ANSWER.pack(what, status, why.encode()[:200]))
            if what == END:
                return


if __name__ == "__main__":
    host, *numbers = sys.argv[1:]
    period_s, lookahead_s, gain, watchdog_hz = map(float, numbers[:4])
    main(Control(host, period_s, lookahead_s, gain, watchdog_hz, int(numbers[4])))
    # the client's own destructor may wait for a controller that is gone
    os._exit(0)
