"""The arm's state from ``ur_rtde``, in a process of its own: ``receive.py HOST RATE_HZ``.

A client whose controller is gone can block, and holds Python's lock while it does; here nobody waits for it. Every new
state goes to standard output as one `STATE`; when the connection ends, so does the process, with the reason on standard
error. Units are the controller's: m, rad, s, N. It imports nothing of the package, so that it starts quickly.
"""

import os
import struct
import sys
import time

STATE = struct.Struct("<2d6d6d6dii2diIQ")
"""time.monotonic() of receipt; controller's clock; joints; tool centre point; force on it; safety mode; runtime state; speed
fraction, slider and scaling together; payload, kg; robot mode; status bits; digital outputs, a bit each."""
VARIABLES = ["timestamp", "actual_q", "actual_TCP_pose", "actual_TCP_force", "safety_mode", "runtime_state", "target_speed_fraction", "speed_scaling", "payload", "robot_status_bits", "safety_status_bits", "robot_mode", "actual_digital_output_bits"]  # fmt: skip
QUIET_S = 1.0
"""Without a new state for so long, the connection is looked at."""


def main(host: str, rate_hz: float) -> str:
    """Hands on states until the connection ends; why it did."""
    # the client prints to standard output: among the states it would shift all that follow
    states = os.dup(1)
    os.dup2(2, 1)
    import rtde_receive

    arm = rtde_receive.RTDEReceiveInterface(host, rate_hz, VARIABLES)
    last, heard = -1.0, time.monotonic()
    while True:
        clock_s, now = arm.getTimestamp(), time.monotonic()
        if clock_s != last:
            last, heard = clock_s, now
            fraction = min(arm.getTargetSpeedFraction(), arm.getSpeedScalingCombined())
            modes = (arm.getSafetyMode(), arm.getRuntimeState())
            place = (*arm.getActualQ(), *arm.getActualTCPPose(), *arm.getActualTCPForce())
            more = (arm.getRobotMode(), arm.getRobotStatus(), arm.getActualDigitalOutputBits())
            state = (now, clock_s, *place, *modes, fraction, arm.getPayload(), *more)
            try:
                os.write(states, STATE.pack(*state))
            except BlockingIOError:
                pass
        elif now - heard > QUIET_S and not arm.isConnected():
            return "the connection that brings the arm's state has ended"
        time.sleep(0.3 / rate_hz)


if __name__ == "__main__":
    try:
        why = main(sys.argv[1], float(sys.argv[2]))
    except BrokenPipeError:
        why = "nobody reads any more"
    except Exception as error:
        why = f"{error}"
    print(f"reason: {why}", file=sys.stderr, flush=True)
    # the client's own destructor may wait for a controller that is gone
    os._exit(1)
