"""A master of one's own: every slave goes to OP with distributed clocks, and DP3CLs are moved along a path.

pip install pysoem; docs/SLAVES.md says how to have slaves without a machine. python3 own_master.py INTERFACE
"""

import struct
import sys
import time

import pysoem

CYCLE_NS = 2_000_000

master = pysoem.Master()
master.open(sys.argv[1])
print(master.config_init(), "slaves:", ", ".join(slave.name for slave in master.slaves))
for slave in master.slaves:
    slave.set_watchdog("processdata", 1000)
master.config_map()
master.config_dc()
for slave in master.slaves:
    slave.dc_sync(True, CYCLE_NS)
    slave.sdo_write(0x6060, 0, b"\x08")  # CSP


def cycle(control, targets):
    """Sends controlword, target and the word for touch probes; gives the statuswords and the positions."""
    for slave, target in zip(master.slaves, targets):
        slave.output = struct.pack("<HiH", control, target, 0)
    master.send_processdata()
    if master.receive_processdata(10_000) < master.expected_wkc:
        print("a slave did not answer")
    time.sleep(CYCLE_NS / 1e9)
    return zip(*[struct.unpack_from("<xxHbi", slave.input)[::2] for slave in master.slaves])


targets = [0] * len(master.slaves)
_, targets = cycle(0, targets)
master.state = pysoem.OP_STATE
master.write_state()
while not all(slave.state == pysoem.OP_STATE for slave in master.slaves):
    cycle(0, targets)
    master.read_state()
for control in (0x80, 0x06, 0x07, 0x0F):  # fault reset, then up to Operation enabled
    for _ in range(100):
        _, positions = cycle(control, targets)
for step in range(1, 501):
    statuswords, positions = cycle(0x0F, [target + 10 * step for target in targets])
print("statuswords", *map(hex, statuswords), "positions", *positions)
for _ in range(100):
    cycle(0, positions)  # off first: a DP3CL that is enabled when OP is left has an alarm
master.state = pysoem.INIT_STATE
master.write_state()
