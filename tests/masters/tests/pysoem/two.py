"""Another master on the same wire, which sends its own frames: it reads, and later it takes the slaves to Init."""

import socket
import threading

from rig import *

ETHERTYPE = 0x88A4
OTHER = bytes([0x10, 0x20, 0x30, 0x40, 0x50, 0x60])
# Beyond the indexes that SOEM uses.
FIRST_INDEX = 100
BRD, APRD, FPRD, BWR = 7, 1, 4, 8


class Other:
    """A master of single datagrams."""

    def __init__(self):
        self.socket = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(ETHERTYPE))
        self.socket.bind(("veth0", ETHERTYPE))
        self.socket.settimeout(5.0)
        self.index = FIRST_INDEX

    def ask(self, command, adp, ado, data):
        """Data and working counter of the answer."""
        self.index = FIRST_INDEX + (self.index + 1 - FIRST_INDEX) % 100
        datagram = struct.pack("<BBHHHH", command, self.index, adp, ado, len(data), 0) + data + bytes(2)
        frame = b"\xff" * 6 + OTHER + struct.pack(">H", ETHERTYPE) + struct.pack("<H", len(datagram) | 0x1000) + datagram
        self.socket.send(frame)
        while True:
            answer = self.socket.recv(1600)
            if answer[16:18] == bytes([command, self.index]) and answer[7:12] == OTHER[1:]:
                end = 26 + len(data)
                return answer[26:end], struct.unpack("<H", answer[end : end + 2])[0]


network = Network()
network.start(2)
other = Other()
asked = 0
stop = threading.Event()
wrong = []


def read():
    global asked
    while not stop.is_set():
        for command, adp, ado, length, counter in [
            (BRD, 0, 0x0130, 2, 2), (APRD, 0xFFFF, 0x0110, 2, 1), (FPRD, 0x1001, 0x0130, 6, 1), (FPRD, 0x1777, 0x0130, 2, 0)
        ]:
            data, found = other.ask(command, adp, ado, bytes(length))
            if found != counter:
                wrong.append((command, ado, found, data))
            asked += 1


reader = threading.Thread(target=read)
reader.start()
network.counters.clear()
network.cycles(500)
stop.set()
reader.join()
expect(wrong, [], "answers to the other master")
expect(asked > 100, True, "it has asked")
# SOEM occasionally takes a frame for lost while it receives those of others.
network.expect_counters(6, "working counters meanwhile")
expect(network.states(), [pysoem.OP_STATE] * 2, "states")

# The other master takes the slaves to Init, and this one notices and brings them back.
data, found = other.ask(BWR, 0, 0x0120, bytes([1, 0]))
expect(found, 2, "working counter")
expect(network.states(), [pysoem.INIT_STATE] * 2, "states")
for slave in network.slaves:
    wait_for(lambda: slave.reconfig(5000) & 0x0F == pysoem.SAFEOP_STATE, f"{slave.name} is in SafeOP", step=network.cycle)
network.to_op()
expect(network.counter(), 6, "working counter")
network.end()
