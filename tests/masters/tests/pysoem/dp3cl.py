"""A DP3CL is homed and moved by profiles, with its process data at power-on."""

from rig import *

HOMING, PROFILE_POSITION, CSP = 6, 1, 8
HOMING_METHOD, SPEEDS, PROFILE_VELOCITY, ACCELERATION, DECELERATION = 0x6098, 0x6099, 0x6081, 0x6083, 0x6084
ATTAINED, NEW_SET_POINT, IMMEDIATELY = 0x1000, 0x10, 0x20

network = Network()
network.start(2)
outputs = {"control": "H", "target": "i", "probe": "H"}
inputs = {"error": "H", "status": "H", "mode": "b", "position": "i", "probe_status": "H", "probe_position": "i", "inputs": "I"}
axes = [Axis(network, slave, outputs, inputs) for slave in network.slaves]
axis, other = axes
expect([slave.man for slave in network.slaves], [0x0556] * 2, "vendor")


def use(mode):
    sdo(axis.slave.sdo_write, MODE, 0, struct.pack("b", mode))
    wait_for(lambda: axis.get("mode") == mode, f"mode {mode}", step=network.cycle)


def settle(bit, what):
    wait_for(lambda: axis.get("status") & bit, what, seconds=30.0, step=network.cycle)


# Homing on the negative limit switch, and then at the present position.
for method, speed in ((17, 20_000), (37, 20_000)):
    use(HOMING)
    sdo(axis.slave.sdo_write, HOMING_METHOD, 0, struct.pack("b", method))
    for sub in (1, 2):
        sdo(axis.slave.sdo_write, SPEEDS, sub, struct.pack("<I", speed))
    axis.put(control=0, target=0)
    axis.enable()
    axis.put(control=0x1F)
    # First the status of the previous homing must disappear.
    network.cycles()
    settle(ATTAINED, f"homing by method {method}")
    expect(axis.get("status") & 0x2000, 0, "homing error")
expect(axis.get("position"), 0, "position where it stands")

# Profile positions, absolute.
axis.put(control=0x0F)
network.cycles()
use(PROFILE_POSITION)
sdo(axis.slave.sdo_write, PROFILE_VELOCITY, 0, struct.pack("<I", 20_000))
for index in (ACCELERATION, DECELERATION):
    sdo(axis.slave.sdo_write, index, 0, struct.pack("<I", 200_000))
for target in (5_000, 12_000, 3_000):
    axis.put(control=0x0F | IMMEDIATELY, target=target)
    network.cycles()
    axis.put(control=0x0F | IMMEDIATELY | NEW_SET_POINT)
    settle(0x1000, "the set point is taken")
    axis.put(control=0x0F | IMMEDIATELY)
    wait_for(lambda: axis.get("position") == target, f"position {target}", seconds=30.0, step=network.cycle)
    settle(TARGET_REACHED, "target reached")

# Along a path.
begin = axis.get("position")
axis.put(target=begin, control=0x0F)
use(CSP)
for step in range(1, 201):
    axis.put(target=begin + 10 * step)
    network.cycle()
wait_for(lambda: axis.get("position") == begin + 2_000, "the end of the path", step=network.cycle)
expect(axis.state(), OPERATION_ENABLED, "state")
expect(other.get("position"), 0, "the other one has stood")
network.end()
