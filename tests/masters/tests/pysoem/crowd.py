"""More slaves than a board has, all in OP; terminals among them reach it without outputs."""

from rig import *

COUNT = 100
network = Network()
network.scan(COUNT)
network.map(with_dc=False)
network.master.state = pysoem.OP_STATE
network.master.write_state()
wait_for(lambda: network.states() == [pysoem.OP_STATE] * COUNT, "OP without outputs", step=lambda: time.sleep(0.05))
network.counters.clear()
network.cycles(100)
network.expect_counters(3 * COUNT, "working counters")
network.end()
