"""Firmware by FoE in bootstrap, another file in PreOP, and the errors of both."""

from rig import *

TIMEOUT_US = 1_000_000
OUT, IN, BOX = 0x1000, 0x1100, 256

network = Network()
network.scan(1)
slave = network.slaves[0]


def go(state):
    slave.state = state
    slave.write_state()
    wait_for(lambda: network.states() == [state], f"state {state}")


def refused(call, *arguments):
    try:
        return sdo(getattr(slave, call), *arguments)
    except Exception as error:
        return f"{type(error).__name__} {error}"


# In PreOP a file of parameters is written and read; firmware is only read.
for length in (0, 1, 115, 116, 117, 5000):
    data = bytes((3 * n + length) & 0xFF for n in range(length))
    slave.foe_write("parameters", 0, data, TIMEOUT_US)
    expect(slave.foe_read("parameters", 0, 8192, TIMEOUT_US)[:length], data, f"{length} bytes of parameters")
print(refused("foe_write", "firmware", 0, bytes(10), TIMEOUT_US))
print(refused("foe_read", "missing", 0, 100, TIMEOUT_US))

# Firmware in bootstrap, with the mailboxes of words 0x14 to 0x17 of the EEPROM.
expect(slave.eeprom_read(0x14) + slave.eeprom_read(0x16), struct.pack("<4H", OUT, BOX, IN, BOX), "mailboxes in bootstrap")
go(pysoem.INIT_STATE)
slave.amend_mbx("out", OUT, BOX)
slave.amend_mbx("in", IN, BOX)
go(pysoem.BOOT_STATE)
firmware = bytes((7 * n) & 0xFF for n in range(20_000))
slave.foe_write("firmware.bin", 0, firmware, TIMEOUT_US)
expect(slave.foe_read("firmware.bin", 0, 32_768, TIMEOUT_US)[:20_000], firmware, "firmware")
print(refused("sdo_read", 0x1018, 1))
go(pysoem.INIT_STATE)
network.end()
