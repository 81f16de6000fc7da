"""A drive with a fault sends an emergency, the axis is in Fault, and a fault reset ends it."""

from rig import *

network = Network()
network.start(2)
outputs = {"control": "H", "target": "i"}
inputs = {"status": "H", "position": "i", "torque": "h", "error": "H"}
axes = [Axis(network, slave, outputs, inputs) for slave in network.slaves]
for axis in axes:
    sdo(axis.slave.sdo_write, MODE, 0, b"\x08")
    axis.put(target=axis.get("position"))
    axis.enable()

fault("alarm 2 0x7500")
wait_for(lambda: axes[1].state() & FAULT, "the fault shows in the statusword", step=network.cycle)
expect(axes[1].get("error"), 0x7500, "error code")


def look():
    network.cycles(5)
    # SOEM fetches mail with an SDO.
    sdo(network.slaves[1].sdo_read, 0x1001, 0)


wait_for(lambda: (2, 0x7500) in network.emergencies, "the emergency", step=look)
expect([number for number, _ in network.emergencies if number == 1], [], "emergencies of the other drive")
expect(axes[0].state(), OPERATION_ENABLED, "the other drive goes on")
axes[1].put(target=axes[1].get("position"))
axes[1].enable()
wait_for(lambda: (2, 0) in network.emergencies, "the emergency that says that the error is gone", step=look)
expect(network.states(), [pysoem.OP_STATE] * 2, "states")
network.end()
