"""Recordings, and the machine of the plugin for pytest as far as it needs no pytest."""

import importlib.util
import math
import os
import socket
import sys
import unittest
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest import mock

import ecmsk
from ecmsk import Config, MasterState, errors
from ecmsk.testing import Machine, seconds

MACHINE = 'format = 1\n[axes]\nX = { slave = 1, unit = "mm", per = 0.001 }\n'

# Waits until drive 2 has an alarm.
PROGRAM = """
import sys, ecmsk
with ecmsk.open(sys.argv[1] + "&record=" + sys.argv[2]) as ecm:
    ecm.configure(ecmsk.Config.drives(2))
    ecm.set_state(ecmsk.MasterState.OP)
    while ecm.snapshot().drive(2).error_code == 0:
        ecm.next_cycle()
    print("alarm")
"""


def drive(ecm, counts=10, cycles=1000, pause=None):
    """Moves both axes, axis 2 half as far. Before cycle `pause` the program is late by more than its reserve."""
    ecm.configure(Config.drives(2))
    ecm.set_state(MasterState.OP)
    ecm.servo_on([1, 2])
    with ecm.stream(8) as stream:
        for n in range(1, cycles + 1):
            if n == pause:
                for _ in range(20):
                    ecm.next_cycle()
            stream.csp(1, counts * n)
            stream.csp(2, counts * n // 2)
            stream.step()


class Folder(unittest.TestCase):
    def setUp(self):
        folder = TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)


class Recordings(Folder):
    def recorded(self, **keys):
        file = self.folder / "run.pcapng"
        with ecmsk.sim("drive*2", record=str(file), **keys) as ecm:
            drive(ecm)
        return file

    def test_what_axes_did(self):
        run = ecmsk.recording(self.recorded())
        self.assertEqual((run.slot_size, run.slaves, run.alarms, run.gaps, run.lacks), (12, [1, 2], [], 0, None))
        self.assertEqual(run.summary, [])
        self.assertTrue(run.link.startswith("sim:?"))
        axis = run.axis(1)
        columns = {name: axis.values(name) for name in ("time_ns", "position", "target", "statusword")}
        self.assertEqual(len({len(column) for column in columns.values()}), 1)
        times = list(columns["time_ns"])
        self.assertEqual(times, sorted(times))
        self.assertGreater(columns["position"][-1], 9900)
        behind = [t - p for t, p in zip(columns["target"], columns["position"]) if not math.isnan(t)]
        self.assertGreater(len(behind), 900)
        self.assertLess(max(map(abs, behind)), 1000)
        self.assertGreater(run.axis(2).values("position")[-1], 4900)
        with self.assertRaisesRegex(ValueError, "no `speed`; it has time_ns"):
            axis.values("speed")

    def test_frames_are_all_there(self):
        run = ecmsk.recording(self.recorded())
        frames = list(run.frames())
        self.assertEqual(len(frames), run.frame_count)
        self.assertEqual({len(frame.data) for frame in frames}, {512})
        self.assertEqual({frame.is_command for frame in frames}, {True, False})
        self.assertAlmostEqual(frames[-1].time_ns / 1e9, run.duration, delta=0.01)

    def test_names_and_units(self):
        machine = self.folder / "machine.toml"
        machine.write_text(MACHINE)
        run = ecmsk.recording(self.recorded(), machine)
        axis = run.axis("x")
        self.assertEqual((axis.slave, axis.name, axis.unit, axis.counts_per_unit), (1, "X", "mm", 1000.0))
        with self.assertRaises(errors.NoSuchAxisError):
            run.axis("Y")
        with self.assertRaisesRegex(errors.NoSuchAxisError, r"no axis 3 in OP; it has \[1, 2\]"):
            run.axis(3)

    def test_files_that_are_none(self):
        with self.assertRaisesRegex(errors.RecordingError, "none.pcapng"):
            ecmsk.recording(self.folder / "none.pcapng")
        wrong = self.folder / "wrong.pcapng"
        for content in (b"", b"no recording", bytes(4096)):
            wrong.write_bytes(content)
            with self.assertRaises(errors.RecordingError):
                ecmsk.recording(wrong)

    def test_a_file_that_was_cut(self):
        file = self.recorded()
        whole = ecmsk.recording(file)
        self.assertIsNone(whole.lacks)
        file.write_bytes(file.read_bytes()[:-5000])
        cut = ecmsk.recording(file)
        self.assertIsNotNone(cut.lacks)
        self.assertLess(cut.frame_count, whole.frame_count)
        self.assertGreater(cut.frame_count, whole.frame_count - 100)

    def test_arrays_need_numpy(self):
        run = ecmsk.recording(self.recorded())
        with mock.patch.dict(sys.modules, {"numpy": None}):
            with self.assertRaisesRegex(ecmsk.EcmError, "pip install numpy"):
                run.axis(1).position

    @unittest.skipUnless(importlib.util.find_spec("numpy"), "NumPy is not installed")
    def test_arrays(self):
        import numpy

        axis = ecmsk.recording(self.recorded()).axis(1)
        self.assertEqual(axis.position.dtype, numpy.int32)
        self.assertEqual(list(axis.position), list(axis.values("position")))
        self.assertLess(numpy.nanmax(numpy.abs(axis.following_error)), 1000)
        self.assertEqual(len(axis.time), len(axis.torque))


class Machines(Folder):
    def test_what_is_asserted_holds(self):
        machine = Machine(self.folder, "drive*2")
        drive(machine.open())
        machine.axis(1).reached(10000, within="3 s")
        machine.axis(2).ended_at(5000)
        machine.axis(1).following_error_below(1000)
        machine.no_alarm()
        machine.no_gap()
        machine.nothing_went_wrong()

    def test_what_does_not_hold_fails_with_its_reason(self):
        machine = Machine(self.folder, "drive*2")
        drive(machine.open())
        for check, said in [
            (lambda: machine.axis(1).reached(20000), r"did not reach 20000 counts .*nearest was \d+, after"),
            (lambda: machine.axis(1).reached(9000, within="1 ms"), "not within 0.001 s"),
            (lambda: machine.axis(2).ended_at(0), "axis 2 ended at"),
            (lambda: machine.axis(1).following_error_below(1), "counts behind its target after"),
        ]:
            with self.assertRaisesRegex(AssertionError, said):
                check()

    def test_faults_while_it_runs(self):
        machine = Machine(self.folder, "drive*2")
        machine.at("0.5 s", "alarm 1 0x7500")
        with self.assertRaises(errors.AlarmError) as raised:
            drive(machine.open(), cycles=3000)
        self.assertEqual((raised.exception.slave, raised.exception.code), (1, 0x7500))
        with self.assertRaisesRegex(AssertionError, "slave 1: 0x7500, 1x"):
            machine.no_alarm()

    @unittest.skipUnless(hasattr(socket, "AF_UNIX"), "Unix sockets")
    def test_a_fault_now(self):
        machine = Machine(self.folder, "drive*2")
        with self.assertRaisesRegex(AssertionError, "nothing runs on the machine"):
            machine.fault("heal")
        ecm = machine.open()
        with self.assertRaisesRegex(ValueError, "column 7: `9` is no slave of this network"):
            machine.fault("alarm 9 0x7500")
        ecm.configure(Config.drives(2))
        ecm.set_state(MasterState.OP)
        self.assertIsNone(machine.fault("alarm 2 0x7500"))
        ecm.servo_on(1)
        with self.assertRaisesRegex(AssertionError, "alarms: slave 2: 0x7500, 1x"):
            machine.no_alarm()

    @unittest.skipUnless(hasattr(socket, "AF_UNIX"), "Unix sockets")
    def test_a_fault_while_a_program_runs(self):
        # The program of this test opens the board itself, in the place of `ecmsk exec`.
        tool = self.folder / "ecmsk"
        tool.write_text(f'#!/bin/sh\nexec "{sys.executable}" "$7" "$3" "$5"\n')
        tool.chmod(0o755)
        program = self.folder / "program.py"
        program.write_text(PROGRAM)
        machine = Machine(self.folder, "drive*2", clock="real")
        with mock.patch.dict(os.environ, {"ECMSK_TOOL": str(tool)}):
            running = machine.start(program)
            happened = machine.fault("alarm 2 0x7500", timeout=60)
            self.assertAlmostEqual(happened.seconds, (happened.cycle + 1) / 1000, delta=0.002)
            with self.assertRaisesRegex(AssertionError, "the program still runs"):
                machine.no_alarm()
            self.assertEqual(running.wait(timeout=120).stdout, "alarm\n")
            machine.start(program)
            machine._close()

    @unittest.skipUnless(hasattr(socket, "AF_UNIX"), "Unix sockets")
    def test_a_program_that_nothing_waits_for_and_fails(self):
        tool = self.folder / "ecmsk"
        tool.write_text("#!/bin/sh\necho it is broken >&2\nexit 3\n")
        tool.chmod(0o755)
        machine = Machine(self.folder)
        with mock.patch.dict(os.environ, {"ECMSK_TOOL": str(tool)}):
            for end in (lambda: machine.no_alarm(), machine._close):
                machine.start("./program")._process.wait(timeout=60)
                with self.assertRaisesRegex(AssertionError, "ended with exit code 3\nit is broken"):
                    end()
            # What the test has waited for, it has judged itself.
            machine.start("./program").wait(check=False)
            machine._close()

    def test_a_gap_is_found(self):
        machine = Machine(self.folder, "drive*2")
        drive(machine.open(), pause=500)
        with self.assertRaisesRegex(AssertionError, "gaps in a motion"):
            machine.no_gap()
        with self.assertRaisesRegex(AssertionError, "gap"):
            machine.nothing_went_wrong()

    def test_words_that_are_wrong(self):
        machine = Machine(self.folder)
        with self.assertRaisesRegex(AssertionError, "nothing has run"):
            machine.no_alarm()
        machine.at(1, "alarm 9 0x7500")
        with self.assertRaisesRegex(errors.LinkError, "no slave of this network"):
            machine.open()
        for word in ("soon", "1 h", "x s"):
            with self.assertRaisesRegex(ValueError, "is no time"):
                seconds(word)
        self.assertEqual((seconds("50 ms"), seconds("2s"), seconds(3)), (0.05, 2.0, 3.0))
        with mock.patch.dict(os.environ, {"PATH": ""}, clear=True):
            with self.assertRaisesRegex(FileNotFoundError, "ECMSK_TOOL"):
                Machine(self.folder).run("./nothing")


if __name__ == "__main__":
    unittest.main()
