"""Boards, axes, objects, streams: the package on simulated boards, with kind and with unkind input."""

import gc
import os
import signal
import subprocess
import sys
import threading
import time
import unittest
from pathlib import Path
from tempfile import TemporaryDirectory

import ecmsk
from ecmsk import Axis, Close, Config, Homing, HomingPhase, MasterState, Mode, Slave, errors

MACHINE = """
format = 1
link = "sim:?clock=virtual"
[axes]
X = { slave = 1, unit = "mm", per = 0.001, max = 5 }
Y = { slave = 2, unit = "mm", per = 0.001, homing = { method = 33 } }
"""


# A child is forked in the middle of a motion, also of another thread's call, and ends as any program does.
FORKS = """
import os, sys, threading, time
import ecmsk
from ecmsk import Config, MasterState, errors

link, leaves = sys.argv[1:]
ecm = ecmsk.open(link)
ecm.configure(Config.drives(1))
ecm.set_state(MasterState.OP)
ecm.servo_on(1)
ends = threading.Event()

def watch():
    while not ends.is_set():
        ecm.next_cycle()

watcher = threading.Thread(target=watch)
watcher.start()
with ecm, ecm.stream(16) as stream:
    for n in range(200):
        if n == 100:
            child = os.fork()
            if child == 0:
                closed = 0
                for call in (ecm.snapshot, lambda: stream.csp(1, 9999), stream.step, stream.stats, stream.finish, ecm.reset):
                    try:
                        call()
                    except errors.ClosedError as error:
                        closed += "open the board after the fork" in str(error)
                if closed == 6 and ecm.is_closed and leaves == "blocks":
                    sys.exit(7)
                if leaves == "handles":
                    del stream, ecm
                    os._exit(7)
                os._exit(closed)
            print("child", os.waitpid(child, 0)[1] >> 8)
        stream.csp(1, 10 * n)
        stream.step()
    print("at", 1000 < stream.snapshot().position(1) < 2100, "closed", ecm.is_closed)
    ends.set()
    watcher.join()
print("losses", stream.stats().losses, "closed", ecm.is_closed)
"""


def enabled(slaves="drive", config=None, **keys):
    ecm = ecmsk.sim(slaves, **keys)
    config = config or Config.drives(1)
    ecm.configure(config)
    ecm.set_state(MasterState.OP)
    ecm.servo_on(range(1, len(config.slaves) + 1))
    return ecm


class Boards(unittest.TestCase):
    def test_a_path_by_a_stream(self):
        with enabled("drive*2", Config.drives(2), close=Close.SERVO_OFF) as ecm:
            with ecm.stream(16, prefill=8) as stream:
                start = stream.snapshot().position(1)
                for n in range(500):
                    stream.csp(1, start + 10 * n)
                    stream.csp(2, 5 * n)
                    stream.step()
            stats = stream.stats()
            self.assertEqual((stats.frames, stats.underruns, stats.losses), (500, 0, 0))
            self.assertEqual(str(ecm.state()), "OP")
            self.assertEqual(ecm.state().state, MasterState.OP)
            self.assertTrue(ecm.snapshot().drive(1).is_enabled)
            self.assertGreater(ecm.snapshot().position(1), 4900)
            self.assertEqual(len(ecm.snapshot().frame), 512)
        self.assertTrue(ecm.is_closed)
        ecm.close()  # once more does nothing

    def test_velocity_torque_and_units(self):
        slaves = [
            Slave.drive(Axis(Mode.CSV)),
            Slave.drive(Axis(Mode.CST)),
            Slave.drive(Axis(counts_per_unit=1000.0, guard=20000)),
        ]
        with enabled("drive*3", Config(slaves)) as ecm, ecm.stream(8) as stream:
            for n in range(300):
                stream.csv(1, 2000)
                stream.cst(2, 50)
                stream.csp_units(3, 0.01 * n)
                stream.step()
            with self.assertRaises(errors.TooFarError) as raised:
                stream.csp_units(3, 1000.0)
            self.assertEqual(raised.exception.slave, 3)
            with self.assertRaises(errors.WrongModeError):
                stream.csp(1, 0)
            self.assertAlmostEqual(stream.snapshot().position_units(3), 3.0, delta=0.3)

    def test_objects_inputs_and_outputs(self):
        with ecmsk.sim("drive,io") as ecm:
            ecm.configure(Config([Slave.drive(), Slave.io()]))
            ecm.set_state(MasterState.OP)
            ecm.sdo_write(1, 0x6098, value=-1, type="i8")
            self.assertEqual(ecm.sdo_read(1, 0x6098, type="i8"), -1)
            with self.assertRaises(errors.SdoAbortedError) as raised:
                ecm.sdo_read(1, 0x5555, type="u32")
            self.assertEqual((raised.exception.slave, raised.exception.code), (1, 0x06020000))
            ecm.set_outputs(2, 0b1001)
            self.assertIsInstance(ecm.inputs(2), int)
            ecm.set_local_outputs(0x15)
            self.assertEqual(ecm.local_inputs() & ~0x3F, 0)
            with self.assertRaises(errors.WrongKindError):
                ecm.inputs(1)

    def test_homing(self):
        phases = []
        with enabled("drive*2", Config.drives(2)) as ecm:
            ecm.home_all([(1, Homing(33)), (2, Homing(34, offset=700))], lambda told: phases.append(told.phase))
            self.assertLess(abs(ecm.snapshot().position(2) - 700), 300)
        self.assertEqual(set(phases), {HomingPhase.PREPARING, HomingPhase.MOVING, HomingPhase.RESTORING})

    def test_reset_and_return(self):
        ecm = ecmsk.sim("drive", name="py-reset")
        link = ecm.link
        ecm.reset()
        with self.assertRaises(errors.ClosedError):
            ecm.reset()
        ecm, took = ecmsk.open_when_there(link, 30.0)
        self.assertGreater(took, 0)
        ecm.close()


class Machines(unittest.TestCase):
    def setUp(self):
        folder = TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.file = Path(folder.name, "machine.toml")
        self.file.write_text(MACHINE)

    def test_axes_by_name(self):
        with ecmsk.open_machine(self.file) as ecm:
            ecm.configure()
            ecm.set_state(MasterState.OP)
            ecm.servo_on(["X", 2])
            ecm.home("y")
            with self.assertRaisesRegex(errors.SettingError, "no method was given"):
                ecm.home("X")
            with ecm.stream(20) as stream:
                for n in range(1, 501):
                    stream.csp_units("X", 0.01 * n)
                    stream.step()
                with self.assertRaisesRegex(errors.SoftLimitError, "beyond its soft limits") as raised:
                    stream.csp_units("X", 5.01)
                self.assertEqual(raised.exception.slave, 1)
            self.assertAlmostEqual(ecm.snapshot().position_units("X"), 5.0, delta=0.01)
            with self.assertRaisesRegex(errors.NoSuchAxisError, "machine.toml has no axis `Z`; it has X, Y"):
                ecm.servo_off("Z")
        self.assertEqual(repr(Config.of_machine(self.file)), "<Config drive,drive, 1000 us>")

    def test_a_file_that_is_wrong(self):
        for text, said in [("format = 2", "format"), ("[axes]\nX = {}", "line"), ("format = 1\n[axes]\nX = { slave = 1 }", "link")]:
            self.file.write_text(text)
            with self.assertRaisesRegex(errors.MachineFileError, said):
                ecmsk.open_machine(self.file)
        with self.assertRaisesRegex(errors.MachineFileError, "none.toml"):
            ecmsk.open_machine(self.file.with_name("none.toml"))


class UnkindInput(unittest.TestCase):
    def test_links_that_open_nothing(self):
        for link, kind in [
            ("lathe:", errors.UriError),
            ("sim:?slaves=none&clock=virtual", errors.NoBoardError),
            ("sim:?script=/nothing/there", errors.LinkError),
        ]:
            with self.assertRaises(kind) as raised:
                ecmsk.open(link)
            self.assertIsInstance(raised.exception, ecmsk.EcmError)
        with self.assertRaisesRegex(TypeError, "no option `slots`"):
            ecmsk.open("sim:", slots=12)
        with self.assertRaisesRegex(ValueError, "slot is 13"):
            ecmsk.open("sim:", slot=13)
        with self.assertRaisesRegex(errors.SettingError, "ramp"):
            ecmsk.open("sim:?clock=virtual", ramp=5.0)
        with self.assertRaisesRegex(ValueError, "read_limit is NaN"):
            ecmsk.open("sim:", read_limit=float("nan"))

    def test_values_of_wrong_types(self):
        with enabled() as ecm, ecm.stream(8) as stream:
            for axis in (1.5, None, True, b"X", [1]):
                with self.assertRaisesRegex(TypeError, "an axis is the number of its slave or its name"):
                    stream.csp(axis, 0)
            for axis in (-1, 256, 1 << 80):
                with self.assertRaisesRegex(ValueError, "is no slave"):
                    stream.csp(axis, 0)
            for axis in (0, 2, 255):
                with self.assertRaises(errors.NoSuchSlaveError):
                    stream.csp(axis, 0)
            with self.assertRaisesRegex(errors.NoSuchAxisError, "there is no machine file"):
                stream.csp("X", 0)
            for target in (1 << 31, "1", 1.5):
                with self.assertRaises((OverflowError, TypeError)):
                    stream.csp(1, target)
            with self.assertRaises(errors.OutOfRangeError):
                stream.csp_units(1, float("inf"))
            with self.assertRaises(TypeError):
                ecm.set_state("OP")
            with self.assertRaises(OverflowError):
                ecm.sdo_write(1, 0x6098, value=300, type="i8")
            with self.assertRaisesRegex(ValueError, "`f32` is no type of an object"):
                ecm.sdo_read(1, 0x6098, type="f32")
            with self.assertRaises(errors.SettingError):
                ecm.set_local_outputs(0xFF)
            with self.assertRaises(TypeError):
                ecm.home(1, Homing(33), 7)
        with self.assertRaises(errors.ConfigError):
            ecmsk.sim("drive").configure(Config([Slave.step(Axis(Mode.CSV))]))
        with self.assertRaisesRegex(errors.ConfigError, "no machine file"):
            ecmsk.sim("drive").configure()

    def test_a_board_that_is_closed(self):
        ecm = enabled()
        stream = ecm.stream(8)
        ecm.close()
        for call in (ecm.snapshot, ecm.next_cycle, lambda: ecm.servo_on(1), lambda: ecm.stream(8), ecm.reset):
            with self.assertRaises(errors.ClosedError):
                call()
        with self.assertRaises(errors.ClosedError):
            stream.step()
        self.assertEqual(stream.finish().frames, 0)

    def test_one_stream_at_a_time(self):
        with enabled() as ecm:
            first = ecm.stream(8)
            with self.assertRaises(errors.BusyError):
                ecm.stream(8)
            first.finish()
            second = ecm.stream(8)
            with self.assertRaisesRegex(errors.ClosedError, "the stream has ended"):
                first.csp(1, 0)
            second.step()
            del second
            gc.collect()
            ecm.stream(8).finish()


@unittest.skipUnless(hasattr(os, "fork"), "the system has no fork")
class Forks(unittest.TestCase):
    def test_a_child_leaves_the_board_to_its_parent(self):
        for leaves in ("blocks", "handles"):
            with self.subTest(leaves=leaves), TemporaryDirectory() as folder:
                link = f"sim:?slaves=drive&clock=real&record={folder}/run.ecmrec"
                ended = subprocess.run(
                    [sys.executable, "-c", FORKS, link, leaves], capture_output=True, text=True, timeout=120
                )
                self.assertEqual(ended.stderr, "")
                self.assertEqual(ended.stdout, "child 7\nat True closed False\nlosses 0 closed True\n")
                self.assertIsNone(ecmsk.recording(f"{folder}/run.ecmrec").lacks)


class Waits(unittest.TestCase):
    def test_threads_share_a_board(self):
        with ecmsk.sim("drive,io") as ecm:
            ecm.configure(Config([Slave.drive(), Slave.io()]))
            ecm.set_state(MasterState.OP)
            ecm.servo_on(1)
            failed = []

            def read():
                try:
                    for _ in range(20):
                        self.assertEqual(ecm.sdo_read(1, 0x6098, type="i8"), ecm.sdo_read(1, 0x6098, type="i8"))
                        ecm.inputs(2)
                except Exception as error:
                    failed.append(error)

            threads = [threading.Thread(target=read) for _ in range(2)]
            with ecm.stream(16) as stream:
                for thread in threads:
                    thread.start()
                n = 0
                while any(thread.is_alive() for thread in threads):
                    stream.csp(1, 5 * min(n, 1000))
                    stream.step()
                    n += 1
            self.assertEqual((failed, stream.stats().losses), ([], 0))

    def test_closing_ends_the_calls_of_other_threads(self):
        ecm = enabled()
        ended = []

        def home():
            try:
                # It looks for a switch that is far away.
                ecm.home(1, Homing(17, switch_speed=1, limit=1e6))
            except ecmsk.EcmError as error:
                ended.append(type(error))

        thread = threading.Thread(target=home)
        thread.start()
        time.sleep(0.1)
        ecm.close()
        thread.join()
        self.assertEqual(ended, [errors.ClosedError])

    def test_an_exception_in_the_own_function_aborts_the_homing(self):
        def tell(told):
            if told.phase == HomingPhase.MOVING:
                raise RuntimeError("enough")

        with enabled() as ecm:
            with self.assertRaisesRegex(RuntimeError, "enough"):
                ecm.home(1, Homing(17), tell)
            self.assertEqual(ecm.sdo_read(1, 0x6060, type="i8"), 8)
            with ecm.stream(8) as stream:
                stream.csp(1, stream.snapshot().position(1))
                stream.step()

    def test_a_function_of_the_program_does_not_close_the_board(self):
        with enabled() as ecm:
            with self.assertRaisesRegex(errors.BusyError, "raise an exception here"):
                ecm.home(1, Homing(17), lambda told: ecm.close())
            self.assertFalse(ecm.is_closed)


@unittest.skipUnless(hasattr(signal, "setitimer"), "the system has no timer that sends a signal")
class Signals(unittest.TestCase):
    """A signal comes during a wait, as from Ctrl-C."""

    def setUp(self):
        def interrupt(number, frame):
            raise KeyboardInterrupt

        self.addCleanup(signal.signal, signal.SIGALRM, signal.signal(signal.SIGALRM, interrupt))
        self.addCleanup(signal.setitimer, signal.ITIMER_REAL, 0)

    def test_homing_is_aborted_and_the_board_goes_on(self):
        with enabled() as ecm:
            signal.setitimer(signal.ITIMER_REAL, 0.1)
            with self.assertRaises(KeyboardInterrupt):
                ecm.home(1, Homing(17, switch_speed=1, limit=1e6))
            before = ecm.next_cycle().position(1)
            for _ in range(100):
                ecm.next_cycle()
            self.assertLess(abs(ecm.snapshot().position(1) - before), 50)
            self.assertEqual(ecm.sdo_read(1, 0x6060, type="i8"), 8)

    def test_a_stream_ends_before_the_exception(self):
        with enabled() as ecm:
            stream = ecm.stream(16)
            signal.setitimer(signal.ITIMER_REAL, 0.1)
            with self.assertRaises(KeyboardInterrupt):
                n = 0
                while True:
                    stream.csp(1, n)
                    stream.step()
                    n += 10
            self.assertEqual(stream.stats().underruns, 0)
            # It may have come between two steps.
            stream.finish()
            before = ecm.next_cycle().position(1)
            for _ in range(100):
                ecm.next_cycle()
            self.assertLess(abs(ecm.snapshot().position(1) - before), 50)

    def test_a_wait_for_a_silent_board_ends(self):
        with TemporaryDirectory() as folder:
            script = Path(folder, "silent.ecmscript")
            script.write_text("at 50ms silent\n")
            with ecmsk.open(f"sim:?slaves=drive&script={script}", read_limit=3600.0) as ecm:
                signal.setitimer(signal.ITIMER_REAL, 0.2)
                with self.assertRaises(KeyboardInterrupt):
                    while True:
                        ecm.next_cycle(3600.0)

    def test_a_handler_may_use_the_board(self):
        with enabled() as ecm:
            seen = []
            signal.signal(signal.SIGALRM, lambda number, frame: (seen.append(ecm.state().state), ecm.abort_homing()))
            signal.setitimer(signal.ITIMER_REAL, 0.1)
            with self.assertRaises(errors.HomingFailedError):
                ecm.home(1, Homing(17, switch_speed=1, limit=1e6))
            self.assertEqual(seen, [MasterState.OP])


if __name__ == "__main__":
    unittest.main()
