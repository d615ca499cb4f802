"""``python -m bonemill`` with what may go wrong on the user's own machine: ``fault_client.py MOST_BYTES ARGUMENTS…``.

SIGUSR1 sets the wall clock an hour ahead and SIGUSR2 the monotonic clocks two seconds back, as Python code sees them; no
file may grow beyond MOST_BYTES (0: any size), which is how a full disk looks to who writes.
"""

import resource
import signal
import sys
import time


def _shift(seconds: float, *names: str) -> None:
    for name in names:
        honest = getattr(time, name)
        setattr(time, name, lambda honest=honest: honest() + shifts[names[0]])
    shifts[names[0]] = 0.0
    jumps[names[0]] = seconds


shifts: dict[str, float] = {}
jumps: dict[str, float] = {}
_shift(3600.0, "time")
_shift(-2.0, "perf_counter", "monotonic")
signal.signal(signal.SIGUSR1, lambda *_: shifts.update(time=jumps["time"]))
signal.signal(signal.SIGUSR2, lambda *_: shifts.update(perf_counter=jumps["perf_counter"]))

if __name__ == "__main__":
    if (most := int(sys.argv[1])) > 0:
        resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))
    from bonemill.__main__ import main

    sys.exit(main(sys.argv[2:]))
