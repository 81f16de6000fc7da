"""Each abort code of a slave: by its real cause if a master can produce it, and each by a script."""

from rig import *

PADDING = 0x000000FF
TEST_MEMORY, WRITE_ONLY_OBJECT = 0x4FFF, 0x2100

network = Network()
network.scan(2)
drive, stepper = network.slaves


def code_of(slave, call, *arguments):
    """The abort code of a call; None: it was not refused."""
    try:
        sdo(getattr(slave, call), *arguments)
    except pysoem.SdoError as error:
        expect(error.desc != "", True, "SOEM knows what it means")
        return error.abort_code
    return None


def entries(*items):
    return struct.pack("<BB", len(items), 0) + struct.pack(f"<{len(items)}I", *items)


found = set()


def aborted(code, slave, call, *arguments):
    found_code = code_of(slave, call, *arguments)
    expect(hex(found_code or 0), hex(code), f"{call} of 0x{arguments[0]:04X}:{arguments[1]}")
    found.add(code)


aborted(0x05040005, drive, "sdo_write", TEST_MEMORY, 0, bytes(0x10001))
aborted(0x06010000, stepper, "sdo_read", 0x1018, 0, 64, True)
aborted(0x06010001, drive, "sdo_read", WRITE_ONLY_OBJECT, 0)
aborted(0x06010002, drive, "sdo_write", 0x1018, 1, bytes(4))
aborted(0x06010003, drive, "sdo_write", 0x1600, 1, struct.pack("<I", 0x60400010))
aborted(0x06010004, drive, "sdo_read", TEST_MEMORY, 0, 64, True)
aborted(0x06020000, drive, "sdo_read", 0x5123, 0)
aborted(0x06040041, drive, "sdo_write", 0x1600, 0, entries(0x60410010), True)
aborted(0x06040042, drive, "sdo_write", 0x1600, 0, entries(PADDING, PADDING, PADDING), True)
aborted(0x06040043, drive, "sdo_write", 0x1C12, 0, struct.pack("<BBHH", 2, 0, 0x1600, 0x1600), True)
aborted(0x06070010, drive, "sdo_write", 0x1600, 0, entries(0x60400010) + bytes(1), True)
aborted(0x06070012, drive, "sdo_write", MODE, 0, bytes(4))
aborted(0x06070013, drive, "sdo_write", 0x607A, 0, bytes(2))
aborted(0x06090011, drive, "sdo_read", 0x1018, 9)
aborted(0x06090030, stepper, "sdo_write", 0x6098, 0, bytes([15]))
aborted(0x06090031, stepper, "sdo_write", 0x2001, 0, struct.pack("<H", 51201))
aborted(0x06090032, stepper, "sdo_write", 0x2001, 0, struct.pack("<H", 199))
network.map(with_dc=False)
aborted(0x08000022, drive, "sdo_write", 0x1C12, 0, bytes(1))

# Codes caused by messages that SOEM does not send (a wrong toggle bit, an unknown command; a slave in Init does not answer), and codes
# that no device here returns.
others = [
    0x05030000, 0x05040000, 0x05040001, 0x06010005, 0x06010006, 0x06040047, 0x06060000, 0x06090033, 0x06090036, 0x08000000,
    0x08000020, 0x08000021, 0x08000023, 0x08000024,
]
expect(sorted(found & set(others)), [], "codes of both kinds")
for code in sorted(found) + others:
    for slave, number in ((drive, 1), (stepper, 2)):
        fault(f"sdo-abort {number} 0x{code:08X}")
        expect(code_of(slave, "sdo_read", 0x1018, 1), code, "abort code of a read")
        expect(code_of(slave, "sdo_write", 0x6065, 0, bytes(4)), code, "abort code of a write")
        # Longer than a mailbox: the value is refused after its last segment.
        if slave is drive:
            expect(code_of(slave, "sdo_write", TEST_MEMORY, 0, bytes(200)), code, "abort code of segments")
        fault(f"end sdo-abort {number}")
expect(code_of(drive, "sdo_read", 0x1018, 1), None, "abort code of a read")
network.end()
