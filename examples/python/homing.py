"""Homing: axis 1 by its home switch and index pulse, axis 2 by its limit switch, both at once; then a homing that fails,
because the drive does not know the method."""

import os
from typing import Dict

import ecmsk
from ecmsk import Config, Homing, HomingPhase, HomingProgress, MasterState, errors

phases: Dict[int, HomingPhase] = {}


def tell(progress: HomingProgress) -> None:
    if phases.get(progress.slave) != progress.phase:
        phases[progress.slave] = progress.phase
        print(f"axis {progress.slave}: {progress.phase}, at {progress.position}")


with ecmsk.open(os.environ.get("ECMSK_LINK", "sim:?slaves=drive*2&clock=virtual")) as ecm:
    ecm.configure(Config.drives(2))
    ecm.set_state(MasterState.OP)
    ecm.servo_on([1, 2])

    # By the home switch, its edge on the positive side, and the index pulse before it; by the negative limit switch,
    # which shall be at -20000.
    first = Homing(7, switch_speed=300_000, zero_speed=30_000, acceleration=10_000_000, offset=0)
    second = Homing(17, switch_speed=1_500_000, zero_speed=50_000, acceleration=10_000_000, offset=-20_000)
    ecm.home_all([(1, first), (2, second)], tell)
    now = ecm.snapshot()
    print(f"home found: at {now.position(1)} and {now.position(2)}")

    try:
        ecm.home(1, Homing(36))
    except errors.HomingFailedError as error:
        print(error)
