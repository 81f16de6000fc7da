// A drive has an alarm on its way. The program notices, clears it, switches on again and goes on from where the axis is.
#include "NEXTWUSBLib_12B.h"

#include "../cpp/ecm.h"

static bool Clear(int axis)
{
    for (int i = 0; i < SERVO_TRIES; i++) {
        ClearCmd();
        cmdData[axis].CMD = ALM_CLR;
        WriteCmd();
        ReadResp();
        if (!HasAlarm(axis))
            return true; // some alarms stay until their cause is gone
    }
    return false;
}

int main()
{
    StartUp(2);
    Servo(2, SV_ON);
    const int end = Position(1) + 100000;
    int target[2] = {Position(1), Position(2)};
    while (target[0] < end) {
        target[0] += 50;
        Csp(2, target, FIFO_MARK);
        if (!HasAlarm(1))
            continue;
        std::printf("alarm 0x%04X on axis 1\n", AlarmCode(1));
        // What waits in the FIFO was for an axis that moved.
        ClearCmd();
        cmdData[0].CMD = SET_FIFO;
        cmdData[0].Parm = 1;
        WriteCmd();
        if (!Clear(1))
            Fail("the alarm stays");
        Servo(2, SV_ON);
        target[0] = Position(1);
        std::printf("cleared, the axis is on again\n");
    }
    if (!Settle(2, target, 100))
        Fail("an axis does not arrive");
    std::printf("arrived: %s\n", target[0] >= end ? "yes" : "no");
    ShutDown(2);
    return 0;
}
