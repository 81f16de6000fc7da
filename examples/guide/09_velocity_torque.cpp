// Axis 1 by velocity (CSV), axis 2 by torque (CST). An empty FIFO repeats the last command: what turns goes on turning, so a
// program writes on until both are 0.
#include "NEXTWUSBLib_12B.h"

#include "../cpp/ecm.h"

static void Cycle(int velocity, int torque)
{
    ClearCmd();
    cmdData[1].CMD = CSV;
    cmdData[1].Data1 = (unsigned)velocity;        // as the drive scales 0x60FF: here counts/s
    cmdData[2].CMD = CST;
    cmdData[2].Data1 = (unsigned)torque & 0xFFFF; // 0.1 % of rated
    WritePaced(FIFO_MARK);
    if (HasAlarm(1) || HasAlarm(2))
        Fail("alarm");
}

int main()
{
    Connect(2, DRIVE);
    ClearCmd();
    for (int axis = 1; axis <= 2; axis++) {
        cmdData[axis].CMD = DRIVE_MODE;
        cmdData[axis].Data1 = axis == 1 ? CSV_MODE : CST_MODE;
        cmdData[axis].Data2 = DCSYNC;
    }
    WriteCmd();
    SetState(STATE_OPERATIONAL);
    Servo(2, SV_ON);
    int start[2] = {Position(1), Position(2)};

    for (int i = 0; i <= 100; i++)
        Cycle(1000 * i, 0); // up
    for (int i = 0; i < 500; i++)
        Cycle(100000, i < 50 ? 50 : 0); // a push of 5 %
    for (int i = 100; i >= 0; i--)
        Cycle(1000 * i, 0); // down
    for (int i = 0; i < 500; i++)
        Cycle(0, 0);
    std::printf("axis 1 turned: %s, axis 2 was pushed: %s\n", Position(1) - start[0] > 50000 ? "yes" : "no",
                Position(2) > start[1] ? "yes" : "no");
    ShutDown(2);
    return 0;
}
