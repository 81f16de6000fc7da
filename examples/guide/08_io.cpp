// An IO slave: 16 outputs, 16 inputs. Its outputs stay as they are until the next IO_WR.
#include "NEXTWUSBLib_12B.h"

#include "../cpp/ecm.h"

// Writes a command for slave 1 and waits until it is the one that was answered.
static unsigned Ask(unsigned short command, unsigned outputs)
{
    ClearCmd();
    cmdData[1].CMD = command;
    cmdData[1].Data1 = outputs;
    WriteCmd();
    for (int i = 0; i < 100; i++) {
        ReadResp();
        if (FifoFree() == FIFO_SIZE && (respData[1].CMD & 0xFF) == command)
            return respData[1].Data1;
    }
    Fail("no answer of the IO slave");
    return 0;
}

int main()
{
    Connect(1, IO);
    SetState(STATE_OPERATIONAL);
    Ask(IO_WR, 0x8001); // outputs 0 and 15
    // The simulated slave has its outputs wired to its inputs.
    std::printf("inputs 0x%04X\n", Ask(IO_RD, 0));
    Ask(IO_WR, 0);
    std::printf("inputs 0x%04X\n", Ask(IO_RD, 0));
    SetState(STATE_PRE_OP);
    CloseECMUSB();
    return 0;
}
