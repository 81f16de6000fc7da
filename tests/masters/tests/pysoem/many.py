"""40 drives, whose process data take several frames."""

from rig import *

COUNT = 40
# As many as a PDO takes, some of them twice: 46 bytes for each drive.
INPUTS = [0x60410010] + 2 * [0x60640020, 0x606C0020, 0x60F40020, 0x60620020, 0x60FD0020] + [0x60640020]
network = Network()
network.scan(COUNT)


def map_more(position):
    slave = network.slaves[position]
    sdo(slave.sdo_write, 0x1C13, 0, b"\x00")
    sdo(slave.sdo_write, 0x1A00, 0, b"\x00")
    for sub, entry in enumerate(INPUTS, 1):
        sdo(slave.sdo_write, 0x1A00, sub, struct.pack("<I", entry))
    sdo(slave.sdo_write, 0x1A00, 0, bytes([len(INPUTS)]))
    sdo(slave.sdo_write, 0x1C13, 0, b"\x01")


for position, slave in enumerate(network.slaves):
    slave.config_func = map_more
network.map()
size = sum(len(slave.output) + len(slave.input) for slave in network.slaves)
expect(size, COUNT * (6 + 46), "bytes of process data, of which a frame has 1486 at most")
expect(network.master.expected_wkc, 3 * COUNT, "expected working counter")
network.to_op()
network.counters.clear()
network.cycles(200)
network.expect_counters(3 * COUNT, "working counters")
# Each slave has its own image.
for number, slave in enumerate(network.slaves):
    sdo(slave.sdo_write, MODE, 0, b"\x08")
    slave.output = struct.pack("<Hi", 0x06, number)
network.cycles(20)
for slave in network.slaves:
    expect(struct.unpack_from("<H", slave.input)[0] & MASK, 0x21, f"state of {slave.name}")
network.end()
