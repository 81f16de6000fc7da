"""Types of what is written in Rust. What each call does, waits for and raises is in the documentation of
``ecmsk::ecm``; the names are the same."""

from os import PathLike
from pathlib import Path
from types import TracebackType
from typing import Callable, Dict, Iterable, List, Literal, Optional, Sequence, Tuple, Type, Union

_AxisName = Union[int, str]
_Axes = Union[int, str, Iterable[_AxisName]]
_ObjectType = Literal["u8", "i8", "u16", "i16", "u32", "i32"]
_Path = Union[str, "PathLike[str]"]

class MasterState:
    """A state of the network."""

    INIT: MasterState
    PREOP: MasterState
    SAFEOP: MasterState
    OP: MasterState
    def __int__(self) -> int: ...

class Close:
    """What happens to the axes when a board is closed."""

    HOLD: Close
    """Moving axes are brought to a standstill and stay enabled, so that a vertical axis does not drop."""
    SERVO_OFF: Close
    """As ``HOLD``; then the axes are switched off."""
    LEAVE: Close
    """Nothing is sent: the board goes on executing the entries of its FIFO."""

class Mode:
    """The mode of operation of an axis."""

    CSP: Mode
    CSV: Mode
    CST: Mode

class DriveSync:
    """How a drive is synchronized with the cycle: by distributed clocks, or on its own clock."""

    FREE_RUN: DriveSync
    DC_SYNC: DriveSync

class Axis:
    """The settings of an axis.

    ``counts_per_unit`` is the scale of ``csp_units`` and ``position_units``. ``guard`` is the largest allowed distance of a
    target from the actual position in counts; ``None`` switches it off. An axis that moves at most ``standstill`` counts
    within 8 cycles counts as stationary.
    """

    def __init__(
        self,
        mode: Mode = ...,
        *,
        counts_per_unit: float = 1.0,
        guard: Optional[int] = 131072,
        standstill: int = 16,
        sync: DriveSync = ...,
    ) -> None: ...

class Slave:
    """One slave of the network."""

    @staticmethod
    def drive(axis: Optional[Axis] = None) -> Slave: ...
    @staticmethod
    def step(axis: Optional[Axis] = None) -> Slave: ...
    @staticmethod
    def hsp(axis: Optional[Axis] = None) -> Slave: ...
    @staticmethod
    def io() -> Slave: ...
    @staticmethod
    def unused() -> Slave: ...

class Config:
    """The configuration of the network: its slaves in their order, and the EtherCAT cycle in microseconds."""

    def __init__(self, slaves: Sequence[Slave], *, cycle_us: int = 1000) -> None: ...
    @staticmethod
    def drives(count: int) -> Config:
        """That many drives in CSP."""
    @staticmethod
    def of_machine(file: _Path) -> Config:
        """The network of a machine file."""
    @property
    def slaves(self) -> List[Slave]: ...
    @property
    def cycle_us(self) -> int: ...

class Stats:
    """Counters since a board was opened."""

    @property
    def written(self) -> int: ...
    @property
    def reports(self) -> int: ...
    @property
    def bad_crc(self) -> int: ...
    @property
    def reports_lost(self) -> int: ...
    @property
    def stale(self) -> int: ...
    @property
    def error_byte_changes(self) -> int: ...
    @property
    def losses(self) -> int: ...
    @property
    def underruns(self) -> int: ...
    @property
    def slaves_failed(self) -> int: ...

class State:
    """The state byte of the network; ``str()`` gives it in words."""

    @property
    def state(self) -> Optional[MasterState]: ...
    @property
    def is_failed(self) -> bool: ...
    @property
    def explanation(self) -> Optional[str]: ...

class Drive:
    """What a drive or a stepper reports."""

    @property
    def statusword(self) -> int: ...
    @property
    def is_enabled(self) -> bool: ...
    @property
    def position(self) -> int:
        """Actual position, counts."""
    @property
    def torque(self) -> int:
        """Actual torque, 0.1 % of the rated torque."""
    @property
    def error_code(self) -> int: ...

class Snapshot:
    """A decoded report: the board and all slaves in the same cycle."""

    @property
    def state(self) -> State: ...
    @property
    def at_ns(self) -> int:
        """When the report was made, on the link's clock."""
    @property
    def sequence(self) -> int:
        """The number of the report; a gap means that reports were dropped."""
    @property
    def fifo_free(self) -> int: ...
    @property
    def full_count(self) -> int: ...
    @property
    def slaves(self) -> int:
        """The number of configured slaves."""
    @property
    def frame(self) -> bytes:
        """The raw bytes of the report."""
    def position(self, axis: _AxisName) -> Optional[int]:
        """The actual position of a slave's first axis, counts; ``None`` if it has no axis."""
    def position_units(self, axis: _AxisName) -> Optional[float]:
        """The actual position of a slave's first axis, in its units."""
    def drive(self, axis: _AxisName) -> Optional[Drive]:
        """The slot of a drive or a stepper; ``None`` if the slave is neither."""

class Homing:
    """The objects of homing, which are written before it begins; one that is ``None`` keeps the value of the drive.

    ``method`` is 0x6098, ``switch_speed`` and ``zero_speed`` 0x6099:1 and :2, ``acceleration`` 0x609A, ``offset`` 0x607C in
    counts. After ``limit`` seconds homing is aborted.
    """

    def __init__(
        self,
        method: int,
        *,
        switch_speed: Optional[int] = None,
        zero_speed: Optional[int] = None,
        acceleration: Optional[int] = None,
        offset: Optional[int] = None,
        limit: float = 60.0,
    ) -> None: ...

class HomingPhase:
    """The phase of the homing of an axis."""

    PREPARING: HomingPhase
    MOVING: HomingPhase
    RESTORING: HomingPhase

class HomingProgress:
    """The progress of an axis that is being homed."""

    @property
    def slave(self) -> int: ...
    @property
    def phase(self) -> HomingPhase: ...
    @property
    def position(self) -> int: ...
    @property
    def statusword(self) -> int: ...
    @property
    def elapsed(self) -> float: ...

class StreamStats:
    """Counters of a stream."""

    @property
    def frames(self) -> int: ...
    @property
    def underruns(self) -> int:
        """Cycles that found the FIFO empty; each is a gap in the motion."""
    @property
    def losses(self) -> int: ...

class Stream:
    """A stream of targets for all axes, one frame for each step.

    Set targets, then call ``step``, which sends them and waits at the pace of the board. Leaving its ``with`` block ends
    the stream as ``finish`` does: the axes come to a standstill and stay enabled.
    """

    def csp(self, axis: _AxisName, target: int) -> None:
        """Sets the next target position in CSP, counts."""
    def csp_units(self, axis: _AxisName, units: float) -> None:
        """Sets the next target position in CSP, in the units of the axis."""
    def csv(self, axis: _AxisName, velocity: int) -> None:
        """Sets the next target velocity in CSV, in the drive's units."""
    def cst(self, axis: _AxisName, torque: int) -> None:
        """Sets the next target torque in CST, 0.1 % of the rated torque."""
    def csp_hsp(self, axis: _AxisName, first: Tuple[int, int], second: Tuple[int, int]) -> None:
        """Sets the next target and outputs of both channels of a pulse module in CSP."""
    def csv_hsp(self, axis: _AxisName, first: Tuple[int, int], second: Tuple[int, int]) -> None:
        """Sets the next velocity and outputs of both channels of a pulse module in CSV."""
    def step(self) -> StreamStats:
        """Writes the next frame once fewer than ``depth`` frames wait in the board's FIFO."""
    def snapshot(self) -> Snapshot:
        """The newest report."""
    def stats(self) -> StreamStats:
        """The counters of the stream so far, also after its end."""
    def finish(self) -> StreamStats:
        """Ends the stream within 2 s. It may be called again, and then gives the same counters."""
    def __enter__(self) -> Stream: ...
    def __exit__(
        self,
        kind: Optional[Type[BaseException]] = None,
        value: Optional[BaseException] = None,
        traceback: Optional[TracebackType] = None,
    ) -> None: ...

class Ecm:
    """A handle of an open board, which threads may share.

    Axes are numbers of slaves, or names if the board was opened by a machine file. Times are in seconds. Leaving its
    ``with`` block closes the board, as the option ``close`` says.
    """

    @property
    def link(self) -> str:
        """The URI of the link in its normal form."""
    @property
    def is_virtual(self) -> bool:
        """Whether time passes only inside calls."""
    @property
    def is_closed(self) -> bool: ...
    def slot_size(self) -> int:
        """The slot size of the board, 12 or 16 bytes."""
    def snapshot(self) -> Snapshot:
        """The newest report, without waiting for another one."""
    def next_cycle(self, limit: float = 1.0) -> Snapshot:
        """Waits for the next report."""
    def state(self) -> State:
        """The state of the network in the newest report."""
    def stats(self) -> Stats:
        """Counters since the board was opened."""
    def take_news(self) -> List[str]:
        """Events for a log since the last call."""
    def set_crc(self, *, check_commands: bool, fill_responses: bool) -> None:
        """Switches the CRCs of both directions; the board applies it at its next start."""
    def clear_fifo(self) -> None:
        """Discards what waits in the board's FIFO: axes in CSP stop at once and without a ramp."""
    def configure(self, config: Optional[Config] = None) -> None:
        """Sends the configuration of the network, in PreOP; without one that of the machine file."""
    def adopt(self, config: Optional[Config] = None) -> None:
        """Takes over a board that is configured already. Nothing is sent."""
    def set_state(self, state: MasterState, limit: Optional[float] = None) -> None:
        """Changes the state of the network and waits until it is reached."""
    def servo_on(self, axes: _Axes) -> None:
        """Switches axes on and waits until all are in Operation enabled."""
    def servo_off(self, axes: _Axes) -> None:
        """Switches axes off. A vertical axis without a brake drops."""
    def clear_alarm(self, axes: _Axes) -> None:
        """Resets the alarms of axes. They are off after it."""
    def sdo_read(self, slave: _AxisName, index: int, sub: int = 0, *, type: _ObjectType) -> int:
        """Reads an object of a slave."""
    def sdo_write(self, slave: _AxisName, index: int, sub: int = 0, *, value: int, type: _ObjectType) -> None:
        """Writes an object of a slave, with the size of the type."""
    def inputs(self, slave: _AxisName) -> int:
        """The 16 inputs of an IO slave, in OP."""
    def set_outputs(self, slave: _AxisName, bits: int) -> None:
        """Sets the 16 outputs of an IO slave, in OP."""
    def local_inputs(self) -> int:
        """The six inputs of the board itself."""
    def set_local_outputs(self, bits: int) -> None:
        """Sets the six outputs of the board itself."""
    def home(
        self,
        axis: _AxisName,
        homing: Optional[Homing] = None,
        progress: Optional[Callable[[HomingProgress], object]] = None,
    ) -> None:
        """Homes an axis that is on; without ``homing`` as the machine file says. An exception in ``progress`` aborts it."""
    def home_all(
        self,
        axes: Sequence[Tuple[_AxisName, Homing]],
        progress: Optional[Callable[[HomingProgress], object]] = None,
    ) -> None:
        """Homes several axes together. If one fails, the homing of the others is aborted."""
    def abort_homing(self) -> None:
        """Aborts the homing of all slaves, from another thread or from ``progress``."""
    def stream(self, depth: int, *, prefill: Optional[int] = None) -> Stream:
        """Begins a stream that keeps up to ``depth`` frames waiting in the board's FIFO; with ``prefill`` nothing moves
        before that many wait."""
    def close(self, how: Optional[Close] = None) -> None:
        """Closes the board within 2 s. Calls of other threads end with ``errors.ClosedError``."""
    def reset(self) -> None:
        """Restarts the board, which closes it. ``open_when_there`` opens it again."""
    def __enter__(self) -> Ecm: ...
    def __exit__(
        self,
        kind: Optional[Type[BaseException]] = None,
        value: Optional[BaseException] = None,
        traceback: Optional[TracebackType] = None,
    ) -> None: ...

def open(
    uri: str,
    *,
    slot: Optional[int] = None,
    strict_crc: bool = False,
    guard: bool = True,
    read_limit: float = 1.0,
    write_limit: float = 1.0,
    state_limit: float = 30.0,
    sdo_limit: float = 3.0,
    servo_limit: float = 5.0,
    close: Close = ...,
    ramp: float = 0.25,
) -> Ecm:
    """Opens the board at a link URI and leaves it in its present state. Nothing is sent."""

def open_machine(
    file: _Path,
    link: Optional[str] = None,
    *,
    slot: Optional[int] = None,
    strict_crc: bool = False,
    guard: bool = True,
    read_limit: float = 1.0,
    write_limit: float = 1.0,
    state_limit: float = 30.0,
    sdo_limit: float = 3.0,
    servo_limit: float = 5.0,
    close: Close = ...,
    ramp: float = 0.25,
) -> Ecm:
    """Opens the board of a machine file, or the one at ``link`` or ``ECMSK_LINK``. Its axes then have names and units."""

def open_when_there(
    uri: str,
    limit: float,
    *,
    slot: Optional[int] = None,
    strict_crc: bool = False,
    guard: bool = True,
    read_limit: float = 1.0,
    write_limit: float = 1.0,
    state_limit: float = 30.0,
    sdo_limit: float = 3.0,
    servo_limit: float = 5.0,
    close: Close = ...,
    ramp: float = 0.25,
) -> Tuple[Ecm, float]:
    """Opens a board as soon as it is available, and says how many seconds that took."""

def forked() -> None:
    """In a child of fork: closes its copies of the connections and USB devices of its parent's boards."""

def close_all() -> None:
    """Closes all boards of this process that are open: at the end of the program."""

class RecordedFrames:
    def __iter__(self) -> RecordedFrames: ...
    def __next__(self) -> Tuple[int, bool, bytes]: ...

class RecordedRun:
    """What ``ecmsk.Recording`` is made of."""

    def __init__(self, path: _Path, machine: Optional[_Path] = None) -> None: ...
    @property
    def path(self) -> Path: ...
    @property
    def slot_size(self) -> int: ...
    @property
    def link(self) -> Optional[str]: ...
    @property
    def frame_count(self) -> int: ...
    @property
    def duration(self) -> float: ...
    @property
    def lacks(self) -> Optional[str]: ...
    @property
    def gaps(self) -> int: ...
    @property
    def summary(self) -> List[str]: ...
    @property
    def counts(self) -> Dict[str, int]: ...
    @property
    def alarms(self) -> List[Tuple[int, int, int]]: ...
    @property
    def slaves(self) -> List[int]: ...
    def axis(self, axis: _AxisName) -> Tuple[int, Optional[str], Optional[str], float]: ...
    def column(self, slave: int, name: str) -> Optional[bytes]: ...
    def frames(self) -> RecordedFrames: ...
