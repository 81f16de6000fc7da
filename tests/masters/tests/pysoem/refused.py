"""States that slaves refuse, with the AL status code."""

from rig import *


def state_of(slave):
    network.states()
    return slave.state, slave.al_status


network = Network()
network.scan(2)
first, second = network.slaves
ERROR = pysoem.STATE_ERROR

# OP is not reached from PreOP in one step.
first.state = pysoem.OP_STATE
first.write_state()
wait_for(lambda: state_of(first) == (pysoem.PREOP_STATE | ERROR, 0x11), "PreOP with code 0x0011")
first.state = pysoem.PREOP_STATE + pysoem.STATE_ACK
first.write_state()
wait_for(lambda: state_of(first) == (pysoem.PREOP_STATE, 0), "acknowledged")

# A mapping that is shorter than its sync manager.
network.master.config_map()
network.master.state = pysoem.PREOP_STATE
network.master.write_state()
wait_for(lambda: network.states() == [pysoem.PREOP_STATE] * 2, "PreOP")
sdo(first.sdo_write, 0x1C12, 0, b"\x00")
first.state = pysoem.SAFEOP_STATE
first.write_state()
wait_for(lambda: state_of(first) == (pysoem.PREOP_STATE | ERROR, 0x1D), "PreOP with code 0x001D")
sdo(first.sdo_write, 0x1C12, 0, b"\x01")
first.state = pysoem.PREOP_STATE + pysoem.STATE_ACK
first.write_state()
wait_for(lambda: state_of(first) == (pysoem.PREOP_STATE, 0), "acknowledged")

# A script's own code.
fault("refuse 2 safeop 0x8001")
network.master.state = pysoem.SAFEOP_STATE
network.master.write_state()
wait_for(lambda: state_of(second) == (pysoem.PREOP_STATE | ERROR, 0x8001), "PreOP with code 0x8001")
expect(state_of(first), (pysoem.SAFEOP_STATE, 0), "the other one")
fault("end refuse 2")
second.state = pysoem.SAFEOP_STATE + pysoem.STATE_ACK
second.write_state()
wait_for(lambda: state_of(second) == (pysoem.SAFEOP_STATE, 0), "SafeOP")
network.to_op()
network.end()
