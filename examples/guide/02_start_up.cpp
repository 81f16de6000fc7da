// From PreOP to OP: what is on the cable, the cycle, the mode of each drive. Then what happens if the cable is another one.
#include "NEXTWUSBLib_12B.h"

#include <cstdio>
#include <cstring>

static transData cmdData[DEF_MA_MAX];
static transData respData[DEF_MA_MAX];

// Sends the frame, reads a response, and makes the next frame empty.
static void Exchange()
{
    ECMUSBWrite((unsigned char *)cmdData, sizeof(cmdData));
    ECMUSBRead((unsigned char *)respData, sizeof(respData));
    std::memset(cmdData, 0, sizeof(cmdData));
}

// Asks for a state, waits for it a second at most, and gives what is reached.
static unsigned GoTo(unsigned state)
{
    cmdData[0].CMD = SET_STATE;
    cmdData[0].Data1 = state;
    Exchange();
    for (int i = 0; i < 1000 && (respData[0].Parm & 0xFF) != state; i++)
        Exchange();
    return respData[0].Parm & 0xFF;
}

// The kinds of slaves 1 to 8, four bits each, the first one in the lowest: 0 DRIVE, 1 IO, 2 HSP, 3 STEP, F None.
static void Declare(unsigned kinds)
{
    for (unsigned short group = 0; group < 5; group++) {
        cmdData[0].CMD = SET_AXIS;
        cmdData[0].Parm = group;
        cmdData[0].Data1 = group == 0 ? kinds : 0xFFFFFFFF;
        Exchange();
    }
}

int main()
{
    if (!OpenECMUSB())
        return 1;
    unsigned state = GoTo(STATE_PRE_OP);
    std::printf("PreOP: state 0x%02X\n", state);
    Declare(0xFFFFF100); // two drives and an IO slave
    cmdData[0].CMD = SET_DC;
    cmdData[0].Data1 = 1000;   // cycle, microseconds
    cmdData[0].Data2 = 0xFFFF; // the board chooses the shift
    Exchange();
    for (int axis = 1; axis <= 2; axis++) {
        cmdData[axis].CMD = DRIVE_MODE;
        cmdData[axis].Data1 = CSP_MODE;
        cmdData[axis].Data2 = DCSYNC;
    }
    Exchange();
    state = GoTo(STATE_OPERATIONAL);
    std::printf("OP: state 0x%02X, FIFO free %u\n", state, respData[0].Data2 & 0xFFFF);

    GoTo(STATE_PRE_OP);
    Declare(0xFFFFFF10); // a drive and an IO slave: but slave 2 is a drive, and there is a slave 3
    state = GoTo(STATE_OPERATIONAL);
    std::printf("another cable: state 0x%02X\n", state);
    GoTo(STATE_PRE_OP);
    CloseECMUSB();
    return 0;
}
