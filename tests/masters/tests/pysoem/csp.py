"""A drive is moved along a path in CSP with distributed clocks; another one is at rest meanwhile."""

from rig import *

network = Network()
network.start(2)
outputs = {"control": "H", "target": "i"}
inputs = {"status": "H", "position": "i", "torque": "h", "error": "H"}
mover, stander = (Axis(network, slave, outputs, inputs) for slave in network.slaves)
for axis in (mover, stander):
    sdo(axis.slave.sdo_write, MODE, 0, b"\x08")
    axis.put(target=axis.get("position"))
    axis.enable()
    expect(sdo(axis.slave.sdo_read, MODE_SHOWN, 0), b"\x08", "mode")

network.counters.clear()
begin, stood = mover.get("position"), stander.get("position")
for step in range(1, 501):
    mover.put(target=begin + 20 * step)
    network.cycle()
end = begin + 10_000
wait_for(lambda: abs(mover.get("position") - end) <= 1, "the drive is at its target", step=network.cycle)
network.cycles(50)
expect(abs(mover.get("position") - end) <= 1, True, "it stays there")
expect(abs(stander.get("position") - stood) <= 1, True, "the other one has stood")
expect(mover.state(), OPERATION_ENABLED, "state of the drive")
network.expect_counters(6, "working counters")
network.end()
