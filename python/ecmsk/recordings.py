"""Recordings: their frames, what went wrong in the run, and what each axis did, as NumPy arrays.

NumPy is needed for the arrays alone. Without it :meth:`RecordedAxis.values` gives the same numbers as a memoryview.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any, Dict, Iterator, List, NamedTuple, Optional, Sequence, Union

from ._ecmsk import RecordedRun
from .errors import EcmError

if TYPE_CHECKING:
    import numpy as np

_Path = Union[str, "os.PathLike[str]"]
# Format of a memoryview, type of an array.
_COLUMNS = {
    "time_ns": ("q", "int64"),
    "position": ("i", "int32"),
    "torque": ("h", "int16"),
    "statusword": ("H", "uint16"),
    "error_code": ("H", "uint16"),
    "target": ("d", "float64"),
}


class RecordedFrame(NamedTuple):
    """A frame of a recording."""

    time_ns: int
    """Nanoseconds since the first frame."""
    is_command: bool
    """Whether it went to the board; otherwise it is a report."""
    data: bytes


class RecordedAlarm(NamedTuple):
    """An alarm of a slave, and how often it began."""

    slave: int
    code: int
    times: int


class RecordedAxis:
    """What an axis did while the network was in OP: one value for each report."""

    def __init__(self, run: RecordedRun, axis: Union[int, str]) -> None:
        self._run = run
        self.slave, self.name, self.unit, self.counts_per_unit = run.axis(axis)

    def values(self, column: str) -> Sequence[float]:
        """A column without NumPy: ``time_ns``, ``position``, ``target``, ``torque``, ``statusword``, ``error_code``."""
        if column not in _COLUMNS:
            raise ValueError(f"a recorded axis has no `{column}`; it has {', '.join(_COLUMNS)}")
        view: Any = memoryview(self._run.column(self.slave, column) or b"")
        numbers: Sequence[float] = view.cast(_COLUMNS[column][0])
        return numbers

    def _array(self, column: str) -> np.ndarray[Any, Any]:
        try:
            import numpy
        except ImportError as error:
            raise EcmError(
                "arrays need NumPy, which is not installed: pip install numpy; or take RecordedAxis.values"
            ) from error
        data = self._run.column(self.slave, column) or b""
        array: np.ndarray[Any, Any] = numpy.frombuffer(data, dtype=_COLUMNS[column][1])
        return array

    @property
    def time(self) -> np.ndarray[Any, Any]:
        """When each report was made, seconds since the first frame of the recording."""
        seconds: np.ndarray[Any, Any] = self._array("time_ns") / 1e9
        return seconds

    @property
    def position(self) -> np.ndarray[Any, Any]:
        """Actual position, counts."""
        return self._array("position")

    @property
    def position_units(self) -> np.ndarray[Any, Any]:
        """Actual position in the unit of the machine file; counts without one."""
        units: np.ndarray[Any, Any] = self._array("position") / self.counts_per_unit
        return units

    @property
    def target(self) -> np.ndarray[Any, Any]:
        """The executed target position in counts; NaN while none is in force."""
        return self._array("target")

    @property
    def following_error(self) -> np.ndarray[Any, Any]:
        """Target minus actual position, counts; NaN while no target is in force."""
        error: np.ndarray[Any, Any] = self.target - self.position
        return error

    @property
    def torque(self) -> np.ndarray[Any, Any]:
        """Actual torque, 0.1 % of the rated torque."""
        return self._array("torque")

    @property
    def statusword(self) -> np.ndarray[Any, Any]:
        return self._array("statusword")

    @property
    def error_code(self) -> np.ndarray[Any, Any]:
        """Error code (0x603F); 0 means no error."""
        return self._array("error_code")

    def __repr__(self) -> str:
        return f"<RecordedAxis {self.name or self.slave}>"


class Recording:
    """A recording of ecmsk, or a capture of a board's USB traffic; read whole when it is made."""

    def __init__(self, path: _Path, machine: Optional[_Path] = None) -> None:
        self._run = RecordedRun(path, machine)

    @property
    def slot_size(self) -> int:
        return self._run.slot_size

    @property
    def link(self) -> Optional[str]:
        """The link that was recorded; ``None`` for a capture."""
        return self._run.link

    @property
    def frame_count(self) -> int:
        return self._run.frame_count

    @property
    def duration(self) -> float:
        """Seconds from the first frame to the last."""
        return self._run.duration

    @property
    def lacks(self) -> Optional[str]:
        """What is missing in the recording, in words; ``None`` if nothing is known to be missing."""
        return self._run.lacks

    @property
    def summary(self) -> List[str]:
        """What went wrong, one line for each problem; empty if nothing did."""
        return self._run.summary

    @property
    def counts(self) -> Dict[str, int]:
        """The counts of the summary that are not 0, by their names."""
        return self._run.counts

    @property
    def alarms(self) -> List[RecordedAlarm]:
        return [RecordedAlarm(*alarm) for alarm in self._run.alarms]

    @property
    def gaps(self) -> int:
        """Gaps in a motion: the FIFO ran empty while an axis was moving."""
        return self._run.gaps

    @property
    def slaves(self) -> List[int]:
        """The slaves that are axes and were in OP."""
        return self._run.slaves

    def axis(self, axis: Union[int, str]) -> RecordedAxis:
        """What an axis did, by the number of its slave, or by its name if there is a machine file."""
        return RecordedAxis(self._run, axis)

    def frames(self) -> Iterator[RecordedFrame]:
        """The frames, in the order of the file, which is read once more for them."""
        return (RecordedFrame(*frame) for frame in self._run.frames())

    def __repr__(self) -> str:
        return repr(self._run)


def recording(path: _Path, machine: Optional[_Path] = None) -> Recording:
    """Reads a recording. With a machine file its axes have names and units."""
    return Recording(path, machine)
