"""An ECM-SK from Python, by ctypes: the vendor's OpenECMUSB and CloseECMUSB, and from ecmsk.h calls that have a limit, say
why they failed, and know what became of every command. Slots of 12 bytes; the steps are those of ../../cpp/ecm.h.

The library is looked for as any other; LD_LIBRARY_PATH or ECMSK_LIBRARY (a file) say where it is. ECMSK_LINK names the board.
"""

import ctypes
import os
import struct
import sys
import time

SLOTS, SLOT = 42, struct.Struct("<HHII")
SDO_SLOT = SLOTS - 1
PRE_OP, OPERATIONAL = 2, 8
DRIVE, IO, NONE = 0, 1, 0xF
SET_STATE, SET_AXIS, SET_DC, SET_FIFO, DRIVE_MODE, SDO_RD, SDO_WR = 1, 2, 3, 5, 6, 7, 8
ALM_CLR, SV_ON, SV_OFF, IO_RD, IO_WR, CSP, GO_HOME, ABORT_HOME = 0x10, 0x11, 0x12, 0x13, 0x14, 0x15, 0x18, 0x19
LIO_RD, LIO_WR = 0x21, 0x22
CSP_MODE, HOMING_MODE, DC_SYNC = 8, 6, 1
FIFO_SIZE, FIFO_MARK = 160, 150
STATE_TRIES, SERVO_TRIES, SDO_TRIES = 1000, 2000, 800
TIMEOUT_MS = 5000


class EcmError(Exception):
    """A call that failed, in the words of the library, or a board that does not do what it is told."""


class Counters(ctypes.Structure):
    """ecmsk_counters of ecmsk.h: what became of the commands that arrived."""

    _fields_ = [
        ("size", ctypes.c_uint32),
        ("reserved", ctypes.c_uint32),
        ("frames", ctypes.c_uint64),
        ("reports", ctypes.c_uint64),
        ("rejected", ctypes.c_uint64 * 16),
        ("ignored_homing", ctypes.c_uint64),
        ("discarded_before_enabled", ctypes.c_uint64),
        ("cleared", ctypes.c_uint64),
        ("full", ctypes.c_uint64),
        ("crc", ctypes.c_uint64),
        ("incomplete", ctypes.c_uint64),
        ("executed", ctypes.c_uint64),
        ("idle_cycles", ctypes.c_uint64),
        ("while_booting", ctypes.c_uint64),
        ("for_lost", ctypes.c_uint64),
        ("modes_not_restored", ctypes.c_uint64),
        ("sdo_repeated", ctypes.c_uint64),
        ("sdo_aborted", ctypes.c_uint64),
        ("answers_lost", ctypes.c_uint64),
        ("outputs_lost", ctypes.c_uint64),
        ("cycles_left_out", ctypes.c_uint64),
        ("ring_broken", ctypes.c_uint64),
        ("inputs_held", ctypes.c_uint64),
        ("inputs_stale", ctypes.c_uint64),
    ]


def load():
    """The library, with the types of what is used here."""
    lib = ctypes.CDLL(os.environ.get("ECMSK_LIBRARY", "libNEXTWUSBLib.so.0"))
    board, data, size, limit = ctypes.c_void_p, ctypes.c_char_p, ctypes.c_size_t, ctypes.c_int64
    for name, result, arguments in [
        ("OpenECMUSB", ctypes.c_bool, []),
        ("CloseECMUSB", None, []),
        ("ecmsk_vendor_board", board, []),
        ("ecmsk_last_error", ctypes.c_char_p, []),
        ("ecmsk_write", ctypes.c_int32, [board, data, size, limit]),
        ("ecmsk_read", ctypes.c_int32, [board, data, size, limit]),
        ("ecmsk_get_counters", ctypes.c_int32, [board, ctypes.POINTER(Counters)]),
    ]:
        function = getattr(lib, name)
        function.restype, function.argtypes = result, arguments
    return lib


class Ecm:
    """A board with `count` slaves of one kind. As a context it stops everything when its block ends with an error."""

    def __init__(self, count, kind):
        self.lib = load()
        self.count, self.kind = count, kind
        self.frames = 0
        self.commands = bytearray(SLOTS * SLOT.size)
        self.report = ctypes.create_string_buffer(SLOTS * SLOT.size)
        if not self.lib.OpenECMUSB():
            raise EcmError(self.lib.ecmsk_last_error().decode())
        self.board = self.lib.ecmsk_vendor_board()

    def __enter__(self):
        self.connect()
        return self

    def __exit__(self, kind, error, trace):
        if kind is not None:
            try:
                self.stop_all()
            except EcmError as second:
                print(f"stopping: {second}", file=sys.stderr)
        self.lib.CloseECMUSB()

    # One frame out, one report in.

    def put(self, slot, command, parm=0, data1=0, data2=0):
        SLOT.pack_into(self.commands, slot * SLOT.size, command, parm, data1 & 0xFFFFFFFF, data2 & 0xFFFFFFFF)

    def write(self, keep=False):
        """Writes the frame, which is empty then; with `keep` it is not."""
        self.check(self.lib.ecmsk_write(self.board, bytes(self.commands), len(self.commands), TIMEOUT_MS))
        if not keep:
            self.commands = bytearray(len(self.commands))

    def read(self):
        self.check(self.lib.ecmsk_read(self.board, self.report, len(self.report), TIMEOUT_MS))

    def check(self, result):
        if result != 0:
            raise EcmError(self.lib.ecmsk_last_error().decode())

    # What the last report says. In slot 0 the upper byte of Parm is the CRC.

    def slot(self, slot):
        return SLOT.unpack_from(self.report, slot * SLOT.size)

    def state(self):
        return self.slot(0)[1] & 0xFF

    def fifo_free(self):
        return self.slot(0)[3] & 0xFFFF

    def fifo_full(self):
        return self.slot(0)[3] >> 16

    def statusword(self, axis):
        return self.slot(axis)[1]

    def position(self, axis):
        return ctypes.c_int32(self.slot(axis)[2]).value

    def alarm_code(self, axis):
        return self.slot(axis)[3] >> 16

    def has_alarm(self, axis):
        return self.statusword(axis) & 0x08 != 0 or self.alarm_code(axis) != 0

    def is_on(self, axis):
        return self.statusword(axis) & 0xFF == 0x37

    def is_off(self, axis):
        return self.statusword(axis) & 1 == 0

    def axes(self):
        return range(1, self.count + 1)

    def counters(self):
        counters = Counters(size=ctypes.sizeof(Counters))
        self.check(self.lib.ecmsk_get_counters(self.board, ctypes.byref(counters)))
        return counters

    # The steps of chapter 3 of the guide.

    def set_state(self, state):
        self.put(0, SET_STATE, data1=state)
        self.write()
        for _ in range(STATE_TRIES):
            self.read()
            if self.state() == state:
                return
            self.write()
        raise EcmError(f"state 0x{self.state():02X} instead of 0x{state:02X}")

    def connect(self):
        """To PreOP, with the slaves told and a cycle of 1 ms."""
        self.read()
        self.set_state(PRE_OP)
        for group in range(5):
            kinds = [self.kind if group * 8 + i < self.count else NONE for i in range(8)]
            self.put(0, SET_AXIS, group, sum(kind << 4 * i for i, kind in enumerate(kinds)))
            self.write()
            time.sleep(0.002)
        self.put(0, SET_DC, data1=1000, data2=0xFFFF)
        self.write()

    def start_up(self):
        """To OP, drives in CSP."""
        if self.kind == DRIVE:
            for axis in self.axes():
                self.put(axis, DRIVE_MODE, data1=CSP_MODE, data2=DC_SYNC)
            self.write()
        self.set_state(OPERATIONAL)

    def command(self, command):
        for axis in self.axes():
            self.put(axis, command)
        self.write()

    def servo(self, on):
        self.command(SV_ON if on else SV_OFF)
        for _ in range(SERVO_TRIES):
            self.read()
            for axis in self.axes():
                if self.has_alarm(axis):
                    raise EcmError(f"axis {axis}: alarm 0x{self.alarm_code(axis):04X}")
            if all(self.is_on(axis) if on else self.is_off(axis) for axis in self.axes()):
                return
            self.write()
        raise EcmError("SV_ON" if on else "SV_OFF")

    def shut_down(self):
        if self.kind == DRIVE:
            self.servo(on=False)
        self.set_state(PRE_OP)

    def stop_all(self):
        """Drops what waits, switches off, leaves OP: the way out of an error, which asks nothing of the board."""
        self.put(0, SET_FIFO, 1)
        for slave in self.axes():
            self.put(slave, IO_WR if self.kind == IO else SV_OFF)
        self.write()
        for i in range(SERVO_TRIES):
            self.read()
            off = self.kind == IO or all(self.is_off(axis) for axis in self.axes())
            if (off and i >= 10) or self.state() & 0x0F != OPERATIONAL:
                break
        self.put(0, SET_STATE, data1=PRE_OP)
        self.write()
        for _ in range(STATE_TRIES):
            if self.state() == PRE_OP:
                break
            self.read()

    def sdo(self, command, parm, index, subindex, value):
        """The request once, then empty frames until its answer is there; after 800 tries the request again."""
        address = index << 16 | subindex
        for _ in range(3):
            self.put(SDO_SLOT, command, parm, address, value)
            self.write()
            for _ in range(SDO_TRIES):
                self.read()
                id, slave, object, answer = self.slot(SDO_SLOT)
                same = (id & 0xFF, slave, object) == (command, parm & 0xFF, address)
                if same and (command == SDO_RD or answer == value & 0xFFFFFFFF):
                    return answer
                self.write()
        raise EcmError(f"no answer for 0x{index:04X}:{subindex} of slave {parm & 0xFF}")

    def sdo_read(self, slave, index, subindex=0):
        return self.sdo(SDO_RD, slave, index, subindex, 0)

    def sdo_write(self, slave, index, value, size, subindex=0):
        self.sdo(SDO_WR, size << 8 | slave, index, subindex, value & 0xFFFFFFFF >> 8 * (4 - size))

    def csp(self, targets):
        """A target for every axis, at the pace of the FIFO: after every second frame it reads until there is room."""
        for axis, target in zip(self.axes(), targets):
            self.put(axis, CSP, data1=target)
        self.write()
        self.frames += 1
        if self.frames % 2 == 0:
            self.read()
            while self.fifo_free() < FIFO_MARK:
                self.read()
            if self.state() != OPERATIONAL:
                raise EcmError("the network is not in OP any more")

    def settle(self, targets, window=100):
        """Lets the FIFO run empty and the axes arrive."""
        for _ in range(SERVO_TRIES):
            self.read()
            there = all(abs(self.position(axis) - target) <= window for axis, target in zip(self.axes(), targets))
            if there and self.fifo_free() == FIFO_SIZE:
                return
        raise EcmError("an axis does not arrive")


def next_speed(remaining, speed, limit, acceleration):
    """Counts of the next cycle on the way to a point `remaining` counts ahead, where the speed is 0."""
    for following in range(speed + acceleration, acceleration - 1, -acceleration):
        braking = following // acceleration * (following - acceleration) // 2
        if following <= limit and following + braking <= remaining:
            return following
    return remaining


def run(main):
    """Runs a program; one that fails says why and ends with code 1."""
    try:
        main()
    except (EcmError, OSError) as error:
        sys.exit(f"failed: {error}")
