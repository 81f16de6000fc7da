// A pulse module (HSP) is an axis without a torque: in its place there are 16 inputs in the response, outputs in the command.
#include "NEXTWUSBLib_12B.h"

#include "../cpp/ecm.h"

int main()
{
    Connect(1, HSP);
    DriveMode(1, CSP_MODE); // CSP is what a pulse module is for
    SetState(STATE_OPERATIONAL);
    Servo(1, SV_ON);

    int target = Position(1), remaining = 20000, speed = 0;
    while (remaining > 0) {
        speed = NextSpeed(remaining, speed, 200, 2); // pulses a cycle of 1 ms
        remaining -= speed;
        target += speed;
        ClearCmd();
        cmdData[1].CMD = CSP;
        cmdData[1].Data1 = (unsigned)target;
        cmdData[1].Data2 = remaining < 10000 ? 0x0001 : 0; // output 0 is on in the second half
        WritePaced(FIFO_MARK);
    }
    int end[1] = {target};
    if (!Settle(1, end, 0))
        Fail("the pulses do not end");
    std::printf("at %d, commands lost: %u\n", Position(1), FifoFull());
    ShutDown(1);
    return 0;
}
