"""A master that stops: the slaves leave OP with the watchdog's code, and return on request."""

from rig import *

network = Network()
network.start(2, watchdog_ms=100)
expect(network.states(), [pysoem.OP_STATE] * 2, "states")
# No process data.
wait_for(lambda: network.states() == [pysoem.SAFEOP_STATE | pysoem.STATE_ERROR] * 2, "the slaves leave OP")
expect([slave.al_status for slave in network.slaves], [0x1B] * 2, "AL status codes")
expect(pysoem.al_status_code_to_string(0x1B), "Sync manager watchdog", "what SOEM calls it")
for slave in network.slaves:
    slave.state = pysoem.SAFEOP_STATE + pysoem.STATE_ACK
    slave.write_state()
wait_for(lambda: network.states() == [pysoem.SAFEOP_STATE] * 2, "acknowledged")
expect([slave.al_status for slave in network.slaves], [0] * 2, "AL status codes")
for slave in network.slaves:
    slave.set_watchdog("processdata", WATCHDOG_MS)
network.to_op()

# Without the watchdog they stay in OP.
for slave in network.slaves:
    slave.set_watchdog("processdata", 0)
time.sleep(0.5)
expect(network.states(), [pysoem.OP_STATE] * 2, "states without the watchdog")
network.end()
