"""SDOs of 1 to 300 bytes, by complete access, and what they are refused with."""

from rig import *

TEST_MEMORY = 0x4FFF

network = Network()
network.scan(2)
drive, stepper = network.slaves

for length in list(range(1, 20)) + [107, 108, 109, 110, 111, 112, 113, 114, 115, 116, 117, 118, 119, 120, 200, 255, 256, 299, 300]:
    data = bytes((length + 7 * n) & 0xFF for n in range(length))
    drive.sdo_write(TEST_MEMORY, 0, data)
    expect(drive.sdo_read(TEST_MEMORY, 0, 512), data, f"{length} bytes")

# Complete access: sub-index 0 takes 16 bits.
identity = [drive.sdo_read(0x1018, sub) for sub in range(1, 5)]
expect(drive.sdo_read(0x1018, 0, 64, True), b"\x04\x00" + b"".join(identity), "0x1018 by complete access")
mapping = drive.sdo_read(0x1600, 0, 64, True)
drive.sdo_write(0x1600, 0, b"\x00")
drive.sdo_write(0x1600, 0, mapping, True)
expect(drive.sdo_read(0x1600, 0, 64, True), mapping, "0x1600 by complete access")


def refused(slave, code, call, *arguments):
    try:
        getattr(slave, call)(*arguments)
    except pysoem.SdoError as error:
        expect(error.abort_code, code, f"abort code of {call} {arguments}")
        return
    raise AssertionError(f"{call} {arguments} was not refused")


refused(drive, 0x06020000, "sdo_read", 0x5123, 0)
refused(drive, 0x06020000, "sdo_write", 0x5123, 0, b"\x01")
refused(drive, 0x06090011, "sdo_read", 0x1018, 9)
refused(drive, 0x06010002, "sdo_write", 0x1018, 1, bytes(4))
refused(drive, 0x06070012, "sdo_write", MODE, 0, bytes(4))
refused(drive, 0x06070013, "sdo_write", 0x607A, 0, bytes(2))
refused(stepper, 0x06010000, "sdo_read", 0x1018, 0, 64, True)

# A script's own code, for one object and for all.
fault("sdo-abort 1 0x1018:1 0x08000022")
refused(drive, 0x08000022, "sdo_read", 0x1018, 1)
expect(drive.sdo_read(0x1018, 2), identity[1], "another sub-index")
fault("sdo-abort 1 0x06040043")
refused(drive, 0x06040043, "sdo_read", 0x1018, 2)
fault("end sdo-abort 1")
expect(drive.sdo_read(0x1018, 1), identity[0], "0x1018:1 again")
network.end()
