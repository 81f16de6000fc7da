"""The same tests for programs in three languages: one in C++, one in C#, one in Python, each with two axes.

``TWO_AXES_CPP`` and ``TWO_AXES_CSHARP`` name the compiled programs ``examples/cpp/two_axes_12b.cpp`` and
``examples/csharp/TwoAxes12B.cs``. A program that is not named is left out.
"""

import os
import sys
from pathlib import Path
from typing import List

import pytest

from ecmsk.testing import Machine

# Where axis 1 of each program goes on its way, in counts.
GOALS = {"C++": 400_000, "C#": 400_000, "Python": 32_768}


def command(language: str) -> List[str]:
    """The words that start the program in this language."""
    if language == "Python":
        return [sys.executable, str(Path(__file__).with_name("two_axes.py"))]
    variable = {"C++": "TWO_AXES_CPP", "C#": "TWO_AXES_CSHARP"}[language]
    if variable not in os.environ:
        pytest.skip(f"{variable} names no program")
    return (["mono"] if language == "C#" else []) + [os.environ[variable]]


@pytest.mark.machine(slaves="drive*2")
@pytest.mark.parametrize("language", GOALS)
def test_the_axes_arrive(machine: Machine, language: str) -> None:
    machine.run(*command(language))
    machine.axis(1).reached(GOALS[language], within="3 s", tolerance=500)
    machine.axis(1).following_error_below(3000)
    machine.no_alarm()
    machine.no_gap()


@pytest.mark.machine(slaves="drive*2")
@pytest.mark.parametrize("language", GOALS)
def test_an_alarm_on_the_way_ends_the_program(machine: Machine, language: str) -> None:
    machine.at("1 s", "alarm 1 0x7500")
    assert machine.run(*command(language), check=False).returncode != 0
    with pytest.raises(AssertionError, match="slave 1: 0x7500"):
        machine.no_alarm()


@pytest.mark.machine(slaves="drive*2")
@pytest.mark.parametrize("language", GOALS)
def test_a_cut_cable_ends_the_program(machine: Machine, language: str) -> None:
    machine.at("1 s", "cut 2")  # before slave 2
    assert machine.run(*command(language), check=False).returncode != 0
    with pytest.raises(AssertionError, match="a slave has left OP"):
        machine.nothing_went_wrong()
