"""SDOs of 1 to 300 bytes, by complete access, and their aborts."""

from rig import *

TEST_MEMORY = 0x4FFF

network = Network()
network.scan(2)
drive, stepper = network.slaves

# Expedited up to 4 bytes, normal up to 112, beyond that segments of up to 119 bytes.
for length in range(1, 301):
    data = bytes((length + 7 * n) & 0xFF for n in range(length))
    sdo(drive.sdo_write, TEST_MEMORY, 0, data)
    expect(sdo(drive.sdo_read, TEST_MEMORY, 0, 512), data, f"{length} bytes")

# Complete access: sub-index 0 takes 16 bits.
identity = [sdo(drive.sdo_read, 0x1018, sub) for sub in range(1, 5)]
expect(sdo(drive.sdo_read, 0x1018, 0, 64, True), b"\x04\x00" + b"".join(identity), "0x1018 by complete access")
mapping = sdo(drive.sdo_read, 0x1600, 0, 64, True)
sdo(drive.sdo_write, 0x1600, 0, b"\x00")
sdo(drive.sdo_write, 0x1600, 0, mapping, True)
expect(sdo(drive.sdo_read, 0x1600, 0, 64, True), mapping, "0x1600 by complete access")


# Another object both ways, and from sub-index 1 on, without the padded sub-index 0.
limits = struct.pack("<HII", 2, 0xFFFFFF00, 0x00000100)
sdo(drive.sdo_write, 0x607D, 0, limits, True)
expect(sdo(drive.sdo_read, 0x607D, 0, 64, True), limits, "0x607D by complete access")
expect(sdo(drive.sdo_read, 0x607D, 1, 64, True), limits[2:], "0x607D from sub-index 1 on")
expect([sdo(drive.sdo_read, 0x607D, sub) for sub in (1, 2)], [limits[2:6], limits[6:]], "0x607D entry by entry")
assignment = sdo(drive.sdo_read, 0x1C13, 0, 64, True)
expect(assignment, b"\x01\x00\x00\x1A", "0x1C13 by complete access")
sdo(drive.sdo_write, 0x1C13, 0, b"\x00\x00", True)
expect(sdo(drive.sdo_read, 0x1C13, 0), b"\x00", "0x1C13:0")
sdo(drive.sdo_write, 0x1C13, 0, assignment, True)
expect(sdo(drive.sdo_read, 0x1C13, 0, 64, True), assignment, "0x1C13 by complete access")


def refused(slave, code, call, *arguments):
    try:
        sdo(getattr(slave, call), *arguments)
    except pysoem.SdoError as error:
        expect(error.abort_code, code, f"abort code of {call} {arguments}")
        return
    raise AssertionError(f"{call} {arguments} was not refused")


# A script's own code, for one object and for all.
fault("sdo-abort 1 0x1018:1 0x08000022")
refused(drive, 0x08000022, "sdo_read", 0x1018, 1)
expect(sdo(drive.sdo_read, 0x1018, 2), identity[1], "another sub-index")
fault("sdo-abort 1 0x06040043")
refused(drive, 0x06040043, "sdo_read", 0x1018, 2)
fault("end sdo-abort 1")
expect(sdo(drive.sdo_read, 0x1018, 1), identity[0], "0x1018:1 again")
network.end()
