"""A drive that is set to SYNC0 refuses OP without it, with 0x30, and goes to OP with it."""

from rig import *

INVALID_DC_SYNC = 0x30

network = Network()
for with_dc in (False, True):
    network.scan(1)
    [slave] = network.slaves
    for index in (0x1C32, 0x1C33):
        sdo(slave.sdo_write, index, 1, struct.pack("<H", 2))
    network.map(with_dc)
    if with_dc:
        network.to_op()
        continue
    network.cycle()
    network.master.state = pysoem.OP_STATE
    network.master.write_state()
    error = pysoem.SAFEOP_STATE + pysoem.STATE_ERROR
    wait_for(lambda: network.states() == [error], "the drive refuses OP", step=network.cycle)
    expect(slave.al_status, INVALID_DC_SYNC, "AL status code")
    network.master.state = pysoem.INIT_STATE
    network.master.write_state()
    network.master.state_check(pysoem.INIT_STATE, 5_000_000)
network.end()
