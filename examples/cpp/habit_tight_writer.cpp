// A habit of programs: CSP frames in a tight loop without one read. They come faster than the cycle takes them: the FIFO
// fills up, then frames are lost and counted.
#include "NEXTWUSBLib_12B.h"

#include "ecm.h"

const int AXES = 1;
const int FRAMES = 1000;
const int KEPT_BY_THE_HOST = 32; // responses that nobody reads: the newest are kept
const int WINDOW = 100;          // counts

int main()
{
    StartUp(AXES);
    Servo(AXES, SV_ON);
    int target[AXES] = {Position(1)};

    ClearCmd();
    cmdData[1].CMD = CSP;
    for (int i = 0; i < FRAMES; i++) {
        target[0]++;
        cmdData[1].Data1 = (unsigned)target[0];
        WriteCmd();
    }
    std::printf("%d frames written\n", FRAMES);

    for (int i = 0; i < KEPT_BY_THE_HOST; i++)
        ReadResp();
    std::printf("FIFO free %u, commands lost %u\n", FifoFree(), FifoFull());
    while (FifoFree() < FIFO_SIZE)
        ReadResp();
    std::printf("FIFO free %u, commands lost %u\n", FifoFree(), FifoFull());

    // What was lost may have been the end of the way.
    Csp(AXES, target, FIFO_MARK);
    if (!Settle(AXES, target, WINDOW))
        Fail("the axis does not arrive");
    std::printf("at %d\n", target[0]);
    ShutDown(AXES);
    return 0;
}
