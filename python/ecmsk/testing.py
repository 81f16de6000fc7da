"""A simulated machine for tests: any program runs on it in virtual time, and assertions look at what was recorded.

The fixture ``machine`` of the plugin for pytest is a :class:`Machine`.
"""

from __future__ import annotations

import math
import os
import shutil
import signal
import socket
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any, Dict, List, Mapping, NamedTuple, Optional, Union

from . import sim_uri
from ._ecmsk import Close, Ecm, open
from .recordings import RecordedAxis, Recording

_Key = Union[str, int, float, None]

TOOL = "ECMSK_TOOL"
"""Variable of the environment that names the tool ``ecmsk``, if it is not on the path."""


def seconds(time: Union[str, float]) -> float:
    """A time in seconds, or as text with its unit: ``2``, ``"2 s"``, ``"50 ms"``."""
    if isinstance(time, str):
        for unit, factor in (("us", 1e-6), ("ms", 1e-3), ("s", 1.0)):
            if time.endswith(unit):
                try:
                    return float(time[: -len(unit)]) * factor
                except ValueError:
                    break
        raise ValueError(f"`{time}` is no time; write a number of seconds, or one with s, ms or us")
    return float(time)


class MachineAxis:
    """What a test asserts of one axis. Times count from the first report in OP."""

    def __init__(self, axis: RecordedAxis) -> None:
        self.recorded = axis

    def _name(self) -> str:
        return f"axis {self.recorded.name or self.recorded.slave}"

    def reached(self, position: float, *, within: Union[str, float, None] = None, tolerance: float = 100) -> None:
        """The axis was at that position, counts, at some time, or no later than ``within``."""
        limit = math.inf if within is None else seconds(within)
        times, positions = self.recorded.values("time_ns"), self.recorded.values("position")
        nearest, nearest_at = math.inf, 0.0
        for at_ns, at in zip(times, positions):
            after = (at_ns - times[0]) / 1e9
            if abs(at - position) <= tolerance:
                assert after <= limit, (
                    f"{self._name()} reached {position} counts after {after:.3f} s, not within {limit:g} s"
                )
                return
            if abs(at - position) < abs(nearest - position):
                nearest, nearest_at = at, after
        raise AssertionError(
            f"{self._name()} did not reach {position} counts (+-{tolerance}); "
            f"nearest was {nearest}, after {nearest_at:.3f} s"
        )

    def ended_at(self, position: float, *, tolerance: float = 100) -> None:
        """The axis was at that position, counts, in the last report."""
        last = self.recorded.values("position")[-1]
        assert abs(last - position) <= tolerance, (
            f"{self._name()} ended at {last} counts, not at {position} (+-{tolerance})"
        )

    def following_error_below(self, counts: float) -> None:
        """The position was never that far from the executed target. An axis that had no target fails, too."""
        worst, worst_at, has_target = 0.0, 0.0, False
        times, positions = self.recorded.values("time_ns"), self.recorded.values("position")
        for at_ns, position, target in zip(times, positions, self.recorded.values("target")):
            if math.isnan(target):
                continue
            has_target = True
            # A position wraps at 32 bits, as its counter does.
            behind = abs((target - position + 2**31) % 2**32 - 2**31)
            if behind > worst:
                worst, worst_at = behind, (at_ns - times[0]) / 1e9
        assert has_target, f"{self._name()} has executed no target, so that it had no following error"
        assert worst < counts, f"{self._name()} was {worst:.0f} counts behind its target after {worst_at:.3f} s"


class Happened(NamedTuple):
    """When a fault happened: both count from the opening of the board, in its time."""

    cycle: int
    seconds: float


class _Control:
    """The control socket of a simulated board, which `ecmsk fault` uses, too: events in the words of ``at``."""

    def __init__(self) -> None:
        if not hasattr(socket, "AF_UNIX"):
            raise OSError("faults while a program runs need Unix sockets; use `at`")
        # In a folder of its own with a short name: the path of a socket has at most 107 bytes.
        self.folder = tempfile.mkdtemp(prefix="ecmsk-")
        self.path = os.path.join(self.folder, "control")
        self._waiting: List[socket.socket] = []

    def close(self) -> None:
        for connection in self._waiting:
            connection.close()
        shutil.rmtree(self.folder, ignore_errors=True)

    def _connect(self, timeout: float) -> socket.socket:
        end = time.monotonic() + timeout
        while True:
            connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            try:
                connection.settimeout(timeout)
                connection.connect(self.path)
                return connection
            except (FileNotFoundError, ConnectionRefusedError):
                connection.close()
                if time.monotonic() > end:
                    raise AssertionError(f"the program has opened no board within {timeout:g} s") from None
                time.sleep(0.01)

    def send(self, event: str, timeout: float, is_waited: bool) -> Optional[Happened]:
        connection = self._connect(timeout)
        answers = connection.makefile("r", encoding="utf-8", errors="replace")
        try:
            connection.sendall((" ".join(event.split()) + "\n").encode())
            answer = answers.readline().split(maxsplit=1)
            if answer[:1] == ["wrong"]:
                raise ValueError(answer[1].strip())
            if not is_waited:
                # Closing it would take the event back.
                self._waiting.append(connection)
                return None
            answer = answers.readline().split(maxsplit=1)
            if answer[:1] == ["done"]:
                cycle, at_ns = answer[1].split()
                return Happened(int(cycle), int(at_ns) / 1e9)
            raise AssertionError(answer[1].strip() if len(answer) > 1 else "the board was closed before it happened")
        except socket.timeout:
            raise AssertionError(f"no cycle of the board began within {timeout:g} s") from None
        finally:
            answers.close()
            if connection not in self._waiting:
                connection.close()


class Program:
    """A program that runs on a machine: what :meth:`Machine.start` returns."""

    def __init__(self, words: List[str], process: "subprocess.Popen[str]") -> None:
        self._words = words
        self._process = process
        self._is_waited_for = False

    def wait(self, timeout: float = 60.0, check: bool = True) -> "subprocess.CompletedProcess[str]":
        """Waits for the end of the program, at most ``timeout`` seconds of real time. With ``check`` a program that fails
        fails the test, with what it has printed.
        """
        self._is_waited_for = True
        ended = _wait(self._process, timeout)
        if check and ended.returncode != 0:
            raise AssertionError(
                f"{self._words[0]} ended with exit code {ended.returncode}\n{ended.stdout}{ended.stderr}"
            )
        return ended

    def _end(self) -> None:
        """Ends the program if it still runs. One that has failed by itself, and that nothing has waited for, fails the test."""
        if self._process.poll() is None:
            _kill(self._process)
            self._process.communicate()
        elif not self._is_waited_for:
            self.wait()


class Machine:
    """A simulated machine. Set it up, let something run on it, then assert.

    ``machine.slaves`` lists its slaves, ``machine.keys`` further keys of the link ``sim:``.
    """

    def __init__(self, folder: Path, slaves: str = "drive", **keys: _Key) -> None:
        self.folder = folder
        self.slaves = slaves
        self.keys: Dict[str, _Key] = dict(keys)
        self._events: List[str] = []
        self._runs = 0
        self._recording: Optional[Recording] = None
        self._board: Optional[Ecm] = None
        self._control: Optional[_Control] = None
        self._program: Optional[Program] = None

    def at(self, time: Union[str, float], event: str) -> None:
        """Makes something happen while a program runs: ``machine.at("1 s", "alarm 1 0x7500")``.

        The time counts from the opening of the board, in its time. ``ecmsk link help`` lists the events.
        """
        self._events.append(f"at {seconds(time) * 1e6:.0f}us {event}")

    def fault(self, event: str, *, timeout: float = 10.0) -> Optional[Happened]:
        """Makes something happen now: ``machine.fault("alarm 1 0x7500")``, in the words of :meth:`at`.

        While a program of :meth:`start` runs, the call waits until it has opened the board and until the fault has happened,
        at the beginning of a cycle, and returns when that was. On a board of :meth:`open` the fault happens in the next
        cycle that the test lets pass, and the call returns ``None``.
        """
        if self._control is None:
            raise AssertionError("nothing runs on the machine; call `start` or `open` before")
        return self._control.send(event, timeout, self._program is not None)

    def _next_run(self) -> Path:
        self._close()
        self._recording = None
        self._runs += 1
        return self.folder / f"run-{self._runs}.pcapng"

    def _link(self, **keys: _Key) -> str:
        given: Dict[str, Any] = {"clock": "virtual", **self.keys, **keys}
        if self._control is not None:
            given.setdefault("control", self._control.path)
        if self._events:
            if "script" in self.keys:
                raise ValueError("the machine has a script and events of `at`; put the events into the script")
            script = self.folder / "events.ecmscript"
            script.write_text("\n".join(self._events) + "\n")
            given["script"] = str(script)
        slaves = None if given.get("machine") else self.slaves
        return sim_uri(slaves, **given)

    @property
    def _recorded(self) -> Path:
        return self.folder / f"run-{self._runs}.pcapng"

    def open(self, *, close: Close = Close.HOLD) -> Ecm:
        """Opens the machine in this process, for a test that is a program itself."""
        file = self._next_run()
        if hasattr(socket, "AF_UNIX"):
            self._control = _Control()
        self._board = open(self._link(record=str(file)), close=close)
        return self._board

    def run(
        self,
        *program: Union[str, "os.PathLike[str]"],
        timeout: float = 60.0,
        env: Optional[Mapping[str, str]] = None,
        check: bool = True,
    ) -> "subprocess.CompletedProcess[str]":
        """Runs a program on the machine by ``ecmsk exec``: one that uses NEXTWUSBLib, whatever its language, or one that
        opens the link in ``ECMSK_LINK``. With ``check`` a program that fails fails the test, with what it has printed.
        ``timeout`` is in seconds of real time; after it the program is ended by force.
        """
        return self._start(self._next_run(), program, env).wait(timeout, check)

    def start(
        self, *program: Union[str, "os.PathLike[str]"], env: Optional[Mapping[str, str]] = None
    ) -> Program:
        """Starts a program as :meth:`run` does, and does not wait for its end: :meth:`fault` makes something happen
        meanwhile. A program that still runs at the end of the test is ended by force; one that has ended fails the test if it
        has failed, also if nothing waits for it.
        """
        file = self._next_run()
        self._control = _Control()
        self._program = self._start(file, program, env)
        return self._program

    def _start(self, file: Path, program: Any, env: Optional[Mapping[str, str]]) -> Program:
        words = [os.fspath(word) for word in program]
        command = [str(tool()), "exec", "--link", self._link(), "--record", str(file), "--", *words]
        return Program(words, _popen(command, {**os.environ, **(env or {})}))

    def _close(self) -> None:
        program, self._program = self._program, None
        try:
            if program is not None:
                program._end()
        finally:
            self._close_board()

    def _close_board(self) -> None:
        if self._board is not None:
            self._board.close()
            self._board = None
        if self._control is not None:
            self._control.close()
            self._control = None

    @property
    def recording(self) -> Recording:
        """What was recorded of the last run. A board of ``open`` is closed first."""
        if self._program is not None and self._program._process.poll() is None:
            raise AssertionError("the program still runs; wait for its end before")
        self._close()
        if self._recording is None:
            if not self._recorded.exists():
                raise AssertionError("nothing has run on the machine yet, or the program has not opened its board")
            machine = self.keys.get("machine")
            self._recording = Recording(self._recorded, str(machine) if machine else None)
        return self._recording

    def axis(self, axis: Union[int, str]) -> MachineAxis:
        """An axis, by the number of its slave, or by its name with the key ``machine``."""
        return MachineAxis(self.recording.axis(axis))

    def no_alarm(self) -> None:
        """No slave had an alarm."""
        alarms = [f"slave {slave}: 0x{code:04X}, {times}x" for slave, code, times in self.recording.alarms]
        assert not alarms, f"alarms: {'; '.join(alarms)}"

    def no_gap(self) -> None:
        """The FIFO never ran empty while an axis was moving."""
        assert self.recording.gaps == 0, f"{self.recording.gaps} gaps in a motion"

    def nothing_went_wrong(self) -> None:
        """The summary of the run is empty, and the recording whole."""
        problems = self.recording.summary + ([self.recording.lacks] if self.recording.lacks else [])
        assert not problems, "\n".join(problems)


def tool() -> Path:
    """The tool ``ecmsk``: what ECMSK_TOOL names, or the one on the path."""
    found = os.environ.get(TOOL) or shutil.which("ecmsk")
    if not found:
        raise FileNotFoundError(f"the tool `ecmsk` is not on the path; install it, or name it with {TOOL}")
    return Path(found)


def _popen(command: List[str], env: Mapping[str, str]) -> "subprocess.Popen[str]":
    # In a session of its own, so that the program can be ended together with the tool that waits for it.
    return subprocess.Popen(
        command,
        env=env,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def _kill(process: "subprocess.Popen[str]") -> None:
    if hasattr(os, "killpg"):
        os.killpg(process.pid, signal.SIGKILL)
    else:
        process.kill()


def _wait(process: "subprocess.Popen[str]", timeout: float) -> "subprocess.CompletedProcess[str]":
    try:
        out, err = process.communicate(timeout=timeout)
    except BaseException as error:
        _kill(process)
        out, err = process.communicate()
        if isinstance(error, subprocess.TimeoutExpired):
            raise AssertionError(f"the program did not end within {timeout:g} s\n{out}{err}") from None
        raise
    return subprocess.CompletedProcess(process.args, process.returncode, out, err)
