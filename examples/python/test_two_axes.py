"""Tests of programs on a simulated machine, in virtual time: ``pytest test_two_axes.py``.

The program may be in any language, if it uses NEXTWUSBLib or opens the link in ECMSK_LINK.
"""

import sys
from pathlib import Path

import pytest

from ecmsk.testing import Machine

PROGRAM = Path(__file__).with_name("two_axes.py")
# 90 degrees of a 17-bit encoder.
GOAL = 32768


@pytest.mark.machine(slaves="drive*2")
def test_both_axes_arrive(machine: Machine) -> None:
    machine.run(sys.executable, PROGRAM)
    machine.axis(1).reached(GOAL, within="3 s")
    machine.axis(2).ended_at(-GOAL / 2)
    machine.axis(1).following_error_below(1000)
    machine.no_gap()
    machine.nothing_went_wrong()


@pytest.mark.machine(slaves="drive*2")
def test_an_alarm_on_the_way_is_reported(machine: Machine) -> None:
    machine.at("1.5 s", "alarm 1 0x7500")
    ended = machine.run(sys.executable, PROGRAM, check=False)
    assert ended.returncode == 1
    assert "slave 1 has alarm 0x7500" in ended.stderr
    with pytest.raises(AssertionError, match="slave 1: 0x7500"):
        machine.no_alarm()
