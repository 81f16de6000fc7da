"""Shared by the programs of this folder: a master on veth0, cyclic process data, and CiA 402."""

import struct
import time

import pysoem

CYCLE_S = 0.002
DC_CYCLE_NS = 2_000_000
# The machine may be busy with other tests.
WATCHDOG_MS = 2000

# SOEM's result for a frame that has not returned in time, as on a busy machine.
LATE = -1

CONTROLWORD, STATUSWORD, MODE, MODE_SHOWN = 0x6040, 0x6041, 0x6060, 0x6061
OPERATION_ENABLED, FAULT, TARGET_REACHED = 0x27, 0x08, 0x400
MASK = 0x6F


def expect(found, wanted, what):
    """Ends the program if a condition is false."""
    if found != wanted:
        raise AssertionError(f"{what}: {found!r}, and not {wanted!r}")


def fault(line):
    """Executes a line of a script on the slaves."""
    print(f"fault: {line}", flush=True)
    input()


def wait_for(condition, what, seconds=10.0, step=lambda: time.sleep(CYCLE_S)):
    """Calls `step` until `condition` holds."""
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            raise AssertionError(f"not within {seconds} s: {what}")
        step()


def sdo(call, *arguments):
    """Sends an SDO. If the frames of a busy machine come too late for SOEM to send it, it is sent again."""
    for _ in range(10):
        begin = time.monotonic()
        try:
            return call(*arguments)
        except pysoem.WkcError:
            # SOEM waits 20 ms until it has sent a request, and 700 ms for the answer. A slave that does not answer fails.
            if time.monotonic() - begin > 0.6:
                raise
    raise AssertionError(f"no SDO was sent within ten tries: {arguments}")


class Network:
    """The slaves behind an interface, with their process data."""

    def __init__(self, interface="veth0"):
        self.master = pysoem.Master()
        self.master.open(interface)
        self.emergencies = []
        self.counters = []

    def scan(self, count):
        expect(self.master.config_init(), count, "slaves found")
        self.slaves = self.master.slaves
        for number, slave in enumerate(self.slaves, 1):
            slave.add_emergency_callback(lambda emergency, number=number: self.emergencies.append((number, emergency.error_code)))

    def map(self, with_dc=True, watchdog_ms=WATCHDOG_MS):
        """From PreOP to SafeOP."""
        for slave in self.slaves:
            slave.set_watchdog("processdata", watchdog_ms)
        self.master.config_map()
        if with_dc:
            expect(self.master.config_dc(), True, "distributed clocks")
            for slave in self.slaves:
                slave.dc_sync(True, DC_CYCLE_NS)
        self.master.state_check(pysoem.SAFEOP_STATE, 5_000_000)
        expect(self.states(), [pysoem.SAFEOP_STATE] * len(self.slaves), "states after config_map")

    def start(self, count, with_dc=True, watchdog_ms=WATCHDOG_MS):
        """From Init to OP."""
        self.scan(count)
        self.map(with_dc, watchdog_ms)
        self.to_op()

    def to_op(self):
        self.cycle()
        self.master.state = pysoem.OP_STATE
        self.master.write_state()
        everywhere = [pysoem.OP_STATE] * len(self.slaves)
        wait_for(lambda: self.states() == everywhere, "OP", step=self.cycles)

    def states(self):
        self.master.read_state()
        return [slave.state for slave in self.slaves]

    def cycle(self):
        self.master.send_processdata()
        counter = self.master.receive_processdata(50_000)
        self.counters.append(counter)
        time.sleep(CYCLE_S)
        return counter

    def counter(self):
        """The working counter of the next frame that comes back in time."""
        return next((counter for counter in (self.cycle() for _ in range(100)) if counter != LATE), LATE)

    def expect_counters(self, wanted, what):
        """All frames that came back in time have that working counter."""
        expect(set(self.counters) - {LATE}, {wanted}, what)

    def cycles(self, count=10):
        for _ in range(count):
            self.cycle()

    def end(self):
        self.master.state = pysoem.INIT_STATE
        self.master.write_state()
        self.master.close()


class Axis:
    """A drive by CiA 402, whose process data begin with the given fields."""

    def __init__(self, network, slave, outputs, inputs):
        self.network, self.slave = network, slave
        self.outputs, self.inputs = outputs, inputs
        self.values = dict.fromkeys(outputs, 0)

    def put(self, **values):
        self.values.update(values)
        form = "<" + "".join(self.outputs.values())
        data = struct.pack(form, *self.values.values())
        expect(len(data), len(self.slave.output), "bytes of outputs")
        self.slave.output = data

    def get(self, name):
        form = "<" + "".join(self.inputs.values())
        expect(struct.calcsize(form), len(self.slave.input), "bytes of inputs")
        return dict(zip(self.inputs, struct.unpack(form, self.slave.input)))[name]

    def state(self):
        return self.get("status") & MASK

    def enable(self):
        """Up to Operation enabled, out of Fault too."""
        self.put(control=0x80)
        self.network.cycles()
        for word, wanted in [(0x06, 0x21), (0x07, 0x23), (0x0F, OPERATION_ENABLED)]:
            self.put(control=word)
            wait_for(lambda: self.state() == wanted, f"state 0x{wanted:02X} of {self.slave.name}", step=self.network.cycle)
