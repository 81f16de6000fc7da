"""Two axes: configure, switch on, move both by a smooth profile, stop, switch off.

Run it with ``python3 two_axes.py``, or name the board: ``python3 two_axes.py 'sim:?slaves=drive*2'``.
"""

import os
import sys

import ecmsk
from ecmsk import Axis, Close, Config, MasterState, Slave

# Without a board of one's own: two simulated drives, on virtual time.
DEFAULT_LINK = "sim:?slaves=drive*2&clock=virtual"
# Frames that the program may be ahead of the board, so that a stutter of its own does no harm.
AHEAD = 20
# Cycles of 1 ms that the motion takes.
CYCLES = 2000
# How far the axes go, in degrees.
WAY = {1: 90.0, 2: -45.0}


def smooth(t: float) -> float:
    """0 to 1, without a step in speed or acceleration."""
    return t * t * t * (10.0 - 15.0 * t + 6.0 * t * t)


def run(link: str) -> None:
    # A 17-bit encoder on the axis itself: positions below are in degrees.
    axis = Axis(counts_per_unit=131_072.0 / 360.0)
    with ecmsk.open(link, close=Close.SERVO_OFF) as ecm:
        ecm.configure(Config([Slave.drive(axis)] * 2))
        ecm.set_state(MasterState.OP)
        ecm.servo_on(WAY)
        print("on")

        start = ecm.snapshot()
        with ecm.stream(AHEAD) as stream:
            for n in range(1, CYCLES + 1):
                for slave, way in WAY.items():
                    stream.csp_units(slave, (start.position_units(slave) or 0.0) + way * smooth(n / CYCLES))
                stream.step()

        end, done = ecm.snapshot(), stream.stats()
        for slave in WAY:
            print(f"axis {slave}: {end.position_units(slave):.1f} degrees")
        print(f"{done.frames} frames, {done.underruns} underruns, {done.losses} losses")


if __name__ == "__main__":
    try:
        run(sys.argv[1] if len(sys.argv) > 1 else os.environ.get("ECMSK_LINK", DEFAULT_LINK))
    except ecmsk.EcmError as error:
        sys.exit(str(error))
