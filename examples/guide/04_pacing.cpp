// Too fast and too slow. A full FIFO loses what comes, and counts it; an empty one repeats the last target.
#include "NEXTWUSBLib_12B.h"

#include "../cpp/ecm.h"

static int target[1];

int main()
{
    StartUp(1);
    Servo(1, SV_ON);
    target[0] = Position(1);

    // Frames in a tight loop: the board executes one a millisecond, and 160 wait at most.
    ClearCmd();
    for (int i = 0; i < 400; i++) {
        cmdData[1].CMD = CSP;
        cmdData[1].Data1 = (unsigned)target[0];
        WriteCmd();
    }
    // Old responses wait too: read until the newest.
    for (int i = 0; i < 40; i++)
        ReadResp();
    std::printf("too fast: %s\n", FifoFull() > 0 ? "commands were lost" : "nothing was lost");

    // What waits can be dropped; how many were lost stays.
    ClearCmd();
    cmdData[0].CMD = SET_FIFO;
    cmdData[0].Parm = 1;
    WriteCmd();
    if (!Settle(1, target, 10))
        Fail("the FIFO does not run empty");
    unsigned lost = FifoFull();

    // At the pace of the FIFO nothing is lost.
    for (int i = 0; i < 1000; i++) {
        target[0] += 10;
        Csp(1, target, FIFO_MARK);
    }
    Settle(1, target, 10);
    std::printf("at the pace of the FIFO: %u lost\n", FifoFull() - lost);
    ShutDown(1);
    return 0;
}
