"""Two drives from Init to OP with distributed clocks."""

from rig import *

ECMS = 0x45434D53

network = Network()
network.scan(2)
for slave in network.slaves:
    # The words of the EEPROM, as read by SOEM, agree with object 0x1018.
    expect((slave.man, slave.id, slave.rev), (ECMS, 0x53455256, 0x10000), "identity by the EEPROM")
    expect(slave.name, sdo(slave.sdo_read, 0x1008, 0).decode(), "name")
    identity = [struct.unpack("<I", sdo(slave.sdo_read, 0x1018, sub))[0] for sub in (1, 2, 3)]
    expect(identity, [slave.man, slave.id, slave.rev], "identity by SDO")
    expect(slave.eeprom_read(0x08), struct.pack("<I", ECMS), "word 8 of the EEPROM")
    expect(slave.eeprom_read(0x0A), struct.pack("<I", slave.id), "word 10 of the EEPROM")
    expect([o.index for o in slave.od if o.index in (0x6040, 0x6041, 0x607A)], [0x6040, 0x6041, 0x607A], "dictionary")
expect(network.states(), [pysoem.PREOP_STATE] * 2, "states after config_init")
network.map()
expect([(len(slave.output), len(slave.input)) for slave in network.slaves], [(6, 10)] * 2, "process data")
expect(network.master.expected_wkc, 6, "expected working counter")
network.to_op()
network.counters.clear()
network.cycles(500)
network.expect_counters(6, "working counters in OP")
expect(network.states(), [pysoem.OP_STATE] * 2, "states")
before = network.master.dc_time
network.cycle()
wait_for(lambda: network.master.dc_time > before, "the time of the reference clock passes", step=network.cycle)
network.end()
