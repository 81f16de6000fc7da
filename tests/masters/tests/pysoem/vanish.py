"""Slaves that are lost and return: a cut cable, and a slave that loses its power."""

from rig import *

network = Network()
network.start(3, with_dc=False)
slaves = network.slaves
expect(network.counter(), 9, "working counter")

fault("cut 3")
wait_for(lambda: network.cycle() == 6, "the working counter without slave 3")
expect(network.states()[:2], [pysoem.OP_STATE] * 2, "the others are in OP")
expect(slaves[2].state, 0, "slave 3 does not answer")
fault("heal")
# Its watchdog may have expired meanwhile.
def back():
    network.cycles()
    if network.states()[2] == pysoem.SAFEOP_STATE | pysoem.STATE_ERROR:
        slaves[2].state = pysoem.SAFEOP_STATE + pysoem.STATE_ACK
        slaves[2].write_state()
    elif slaves[2].state == pysoem.SAFEOP_STATE:
        slaves[2].state = pysoem.OP_STATE
        slaves[2].write_state()


wait_for(lambda: network.states() == [pysoem.OP_STATE] * 3 and network.cycle() == 9, "all in OP", step=back)

# Without power it loses its address and its state.
fault("lose 2")
wait_for(lambda: network.cycle() == 6, "the working counter without slave 2")
expect([network.states()[n] for n in (0, 2)], [pysoem.OP_STATE] * 2, "the others are in OP")
expect(slaves[1].state, 0, "slave 2 does not answer")
fault("find 2")


def recover():
    network.cycles(2)
    # 0: it was not found.
    return slaves[1].recover(5000)


wait_for(lambda: recover() > 0, "slave 2 has its address again", step=network.cycle)
wait_for(lambda: slaves[1].reconfig(5000) & 0x0F == pysoem.SAFEOP_STATE, "slave 2 is in SafeOP", step=network.cycle)
slaves[1].state = pysoem.OP_STATE
slaves[1].write_state()
wait_for(lambda: network.states() == [pysoem.OP_STATE] * 3, "all in OP", step=network.cycles)
expect(network.counter(), 9, "working counter")
network.end()
