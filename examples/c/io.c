/* An IO slave and the board's own inputs and outputs: IO_WR, IO_RD, LIO_RD, LIO_WR. A light runs along the 16 outputs of
 * the slave; what its inputs show is read back. Then all outputs are off. Slots of 12 bytes. */
#include "NEXTWUSBLib_12B.h"

#include "../cpp/ecm.h"

enum {
    SLAVE = 1,
    OUTPUTS = 16,
    CYCLES = 20, /* how long a light is on: cycles of 1 ms */
    ANSWER_TRIES = 100
};

/* Writes a command for the slave, then reads until the FIFO is empty and the slot answers that command. What the answer
 * says is the inputs for IO_RD, and the outputs for IO_WR. */
static unsigned Ask(unsigned short command, unsigned data)
{
    ClearCmd();
    cmdData[SLAVE].CMD = command;
    cmdData[SLAVE].Data1 = data;
    WriteCmd();
    for (int i = 0; i < ANSWER_TRIES; i++) {
        ReadResp();
        if (State() != STATE_OPERATIONAL)
            Fail("the network is not in OP any more");
        if (FifoFree() == FIFO_SIZE && (respData[SLAVE].CMD & 0xFF) == command)
            return respData[SLAVE].Data1;
    }
    Fail("no answer of the IO slave");
    return 0;
}

/* The command has run once its entry has left the FIFO. What is read first may be older than the command. */
static unsigned Local(unsigned short command, unsigned outputs)
{
    ClearCmd();
    cmdData[0].CMD = command;
    cmdData[0].Data1 = outputs;
    WriteCmd();
    for (int i = 0; i < 4 || FifoFree() < FIFO_SIZE; i++) {
        ReadResp();
        if (i == ANSWER_TRIES || State() != STATE_OPERATIONAL)
            Fail("no answer of the board's own inputs and outputs");
    }
    return respData[0].Data1 & 0x3F;
}

int main(void)
{
    Connect(1, IO);
    SetState(STATE_OPERATIONAL);
    printf("OP with an IO slave\n");

    for (int output = 0; output < OUTPUTS; output++) {
        Ask(IO_WR, 1u << output);
        /* Outputs hold while nothing is written. */
        for (int i = 0; i < CYCLES; i++)
            ReadResp();
        unsigned inputs = Ask(IO_RD, 0);
        printf("output %2d on: inputs 0x%04X\n", output, inputs);
    }
    Ask(IO_WR, 0);
    printf("outputs off: inputs 0x%04X\n", Ask(IO_RD, 0));

    Local(LIO_WR, 0x15);
    printf("the board's outputs 0, 2 and 4 on; its inputs: 0x%02X\n", Local(LIO_RD, 0));
    Local(LIO_WR, 0);

    SetState(STATE_PRE_OP);
    CloseECMUSB();
    printf("all outputs off, PreOP, closed\n");
    return 0;
}
