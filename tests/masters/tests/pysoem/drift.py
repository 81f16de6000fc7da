"""Crystals that drift by up to 100 ppm: the reference clock's time, sent in each cycle, keeps all clocks
synchronous."""

from rig import *

LIMIT_NS = 1_000

network = Network()
network.start(3)


def differences():
    # 0x092C: a magnitude in 31 bits.
    return [struct.unpack("<I", slave._fprd(0x092C, 4))[0] & 0x7FFFFFFF for slave in network.slaves]


def are_together():
    network.cycles(50)
    return max(differences()) < LIMIT_NS


wait_for(are_together, "the clocks are together", seconds=30.0)
expect(network.states(), [pysoem.OP_STATE] * 3, "states")
# Without it they diverge: by 100 ppm from one to the next.
for slave in network.slaves:
    slave.set_watchdog("processdata", 0)
time.sleep(1.0)
network.cycle()
apart = differences()
expect(apart[1] > 90_000 and apart[2] > 190_000, True, f"the clocks have parted: {apart}")
wait_for(are_together, "the clocks are together again", seconds=30.0)
network.end()
