"""An IO slave and the board's own inputs and outputs: a light runs along the 16 outputs of the slave, what its inputs show
is read back. Prints what ../../c/io.c prints. (Not called io.py: Python has a module of that name.)"""

import ecm

SLAVE = 1


def ask(board, command, data=0):
    """Writes a command, then reads until the FIFO is empty and the slot answers that command."""
    board.put(SLAVE, command, data1=data)
    board.write()
    for _ in range(100):
        board.read()
        if board.state() != ecm.OPERATIONAL:
            raise ecm.EcmError("the network is not in OP any more")
        if board.fifo_free() == ecm.FIFO_SIZE and board.slot(SLAVE)[0] & 0xFF == command:
            return board.slot(SLAVE)[2]
    raise ecm.EcmError("no answer of the IO slave")


def local(board, command, outputs=0):
    """The command has run once its entry has left the FIFO, and in the report after that is the answer."""
    board.put(0, command, data1=outputs)
    board.write()
    for _ in range(4):
        board.read()
    return board.slot(0)[2] & 0x3F


def main():
    with ecm.Ecm(1, ecm.IO) as board:
        board.start_up()
        print("OP with an IO slave")
        for output in range(16):
            ask(board, ecm.IO_WR, 1 << output)
            for _ in range(20):
                board.read()
            print(f"output {output:2} on: inputs 0x{ask(board, ecm.IO_RD):04X}")
        ask(board, ecm.IO_WR, 0)
        print(f"outputs off: inputs 0x{ask(board, ecm.IO_RD):04X}")
        local(board, ecm.LIO_WR, 0x15)
        print(f"the board's outputs 0, 2 and 4 on; its inputs: 0x{local(board, ecm.LIO_RD):02X}")
        local(board, ecm.LIO_WR, 0)
        board.shut_down()
    print("all outputs off, PreOP, closed")


ecm.run(main)
