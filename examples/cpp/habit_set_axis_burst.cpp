// A habit of programs: the whole configuration in one burst, no answer read. Then a loop that reads, compares the
// state, and else writes an all-zero frame, 1000 times at most.
#include "NEXTWUSBLib_12B.h"

#include "ecm.h"

const int AXES = 2;

// How many reads it took.
static int WaitFor(unsigned state)
{
    ClearCmd();
    for (int reads = 1; reads <= STATE_TRIES; reads++) {
        ReadResp();
        if (State() == state)
            return reads;
        WriteCmd();
    }
    Fail("the state does not come");
    return 0;
}

int main()
{
    if (!OpenECMUSB())
        Fail("OpenECMUSB");

    SetAxis(AXES, DRIVE); // five writes, 2 ms apart
    SetDc(1000);
    DriveMode(AXES, CSP_MODE);
    ClearCmd();
    cmdData[0].CMD = SET_STATE;
    cmdData[0].Data1 = STATE_OPERATIONAL;
    WriteCmd();
    std::printf("OP after %d reads\n", WaitFor(STATE_OPERATIONAL));

    ClearCmd();
    cmdData[0].CMD = SET_STATE;
    cmdData[0].Data1 = STATE_PRE_OP;
    WriteCmd();
    std::printf("PreOP after %d reads\n", WaitFor(STATE_PRE_OP));
    CloseECMUSB();
    return 0;
}
