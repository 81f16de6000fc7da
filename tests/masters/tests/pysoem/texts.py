"""A text in a manufacturer's object is read and written completely at any length; its output and its input are
mapped."""

from rig import *

network = Network()
network.scan(1)
[slave] = network.slaves
expect(sdo(slave.sdo_read, 0x2010, 0), b"twenty-four letters long", "the text of the file")
for text in (b"short", b"x" * 100, b"y" * 1000):
    sdo(slave.sdo_write, 0x2010, 0, text)
    expect(sdo(slave.sdo_read, 0x2010, 0, 2048), text, "the text that was written")


def map_own(position):
    for assignment, pdo, entries in [(0x1C12, 0x1600, [0x60400010, 0x20200010]), (0x1C13, 0x1A01, [0x60410010, 0x20210020])]:
        sdo(slave.sdo_write, assignment, 0, b"\x00")
        sdo(slave.sdo_write, pdo, 0, b"\x00")
        for sub, entry in enumerate(entries, 1):
            sdo(slave.sdo_write, pdo, sub, struct.pack("<I", entry))
        sdo(slave.sdo_write, pdo, 0, bytes([len(entries)]))
        sdo(slave.sdo_write, assignment, 1, struct.pack("<H", pdo))
        sdo(slave.sdo_write, assignment, 0, b"\x01")


slave.config_func = map_own
network.map()
expect((len(slave.output), len(slave.input)), (4, 6), "bytes of process data")
network.to_op()
slave.output = struct.pack("<HH", 0, 0x1234)
network.cycles(20)
expect(sdo(slave.sdo_read, 0x2020, 0), struct.pack("<H", 0x1234), "the output")
expect(struct.unpack_from("<xxi", slave.input)[0], -7, "the input")
network.end()
