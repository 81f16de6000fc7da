"""The native API of ecmsk in Python: an ECM-SK board over any link, simulated machines, recordings.

>>> import ecmsk
>>> with ecmsk.sim("drive*2") as ecm:
...     ecm.configure(ecmsk.Config.drives(2))
...     ecm.set_state(ecmsk.MasterState.OP)
...     ecm.servo_on([1, 2])
...     with ecm.stream(16) as stream:
...         for n in range(1000):
...             stream.csp(1, 10 * n)
...             stream.step()

Calls that wait release Python's lock, so that other threads run, and Ctrl-C ends them: what moves is stopped first.
"""

from __future__ import annotations

import atexit
import os
from typing import Any, Optional, Union
from urllib.parse import quote

from . import errors
from ._ecmsk import (
    Axis,
    Close,
    Config,
    Drive,
    DriveSync,
    Ecm,
    Homing,
    HomingPhase,
    HomingProgress,
    MasterState,
    Mode,
    Slave,
    Snapshot,
    State,
    Stats,
    Stream,
    StreamStats,
    close_all,
    forked,
    open,
    open_machine,
    open_when_there,
)
from .errors import EcmError
from .recordings import RecordedAlarm, RecordedAxis, RecordedFrame, Recording, recording

__all__ = [
    "Axis",
    "Close",
    "Config",
    "Drive",
    "DriveSync",
    "Ecm",
    "EcmError",
    "Homing",
    "HomingPhase",
    "HomingProgress",
    "MasterState",
    "Mode",
    "RecordedAlarm",
    "RecordedAxis",
    "RecordedFrame",
    "Recording",
    "Slave",
    "Snapshot",
    "State",
    "Stats",
    "Stream",
    "StreamStats",
    "errors",
    "open",
    "open_machine",
    "open_when_there",
    "recording",
    "sim",
]

# A board that a program leaves open is closed while its threads and its streams are still there.
atexit.register(close_all)
# The boards of a parent process are left to it.
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=forked)


def sim(
    slaves: Optional[str] = "drive",
    *,
    clock: str = "virtual",
    close: Close = Close.HOLD,
    **keys: Union[str, int, float, None],
) -> Ecm:
    """Opens a simulated board with these slaves: ``ecmsk.sim("drive*2,io")``.

    Time is virtual: it passes only inside calls, every run is the same, and an hour takes seconds. ``clock="real"``
    simulates in real time. Other keywords are keys of the link ``sim:`` (``ecmsk link help`` lists them), for example
    ``script="alarm.ecmscript"``, ``record="run.pcapng"``, ``slot=16``; a dot in a key is written as ``__``. With
    ``machine="machine.toml"`` and ``slaves=None`` the slaves are those of a machine file.
    """
    return open(sim_uri(slaves, clock=clock, **keys), close=close)


def sim_uri(slaves: Optional[str], **keys: Union[str, int, float, None]) -> str:
    """The URI of a simulated board."""
    given: dict[str, Any] = {"slaves": slaves, **keys}
    pairs = [(key.replace("__", "."), value) for key, value in given.items() if value is not None]
    return "sim:?" + "&".join(f"{key}={quote(str(value), safe='*,:/.-')}" for key, value in pairs)
