// A habit of programs: one read right after OpenECMUSB, before anything was written.
#include "NEXTWUSBLib.h"

#include "ecm.h"

int main()
{
    if (!OpenECMUSB())
        Fail("OpenECMUSB");
    ReadResp();
    std::printf("first response: id 0x%02X, state %u\n", respData[0].CMD & 0xFF, State());
    CloseECMUSB();
    return State() == STATE_PRE_OP ? 0 : 1;
}
