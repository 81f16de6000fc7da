// Objects of a drive, by the SDO slot: one transfer at a time, and an answer takes some cycles.
#include "NEXTWUSBLib_12B.h"

#include "../cpp/ecm.h"

int main()
{
    Connect(2, DRIVE); // PreOP is enough for SDOs
    for (int slave = 1; slave <= 2; slave++) {
        unsigned type = 0, ramp = 0;
        // Index, subindex. The answer is known by its slave and its object.
        if (!SdoRead(slave, 0x1000, 0, &type))
            Fail("SDO_RD of 0x1000");
        // A write says the object's size too, 1, 2 or 4 bytes.
        if (!SdoWrite(slave, 0x6085, 0, 4, 20000000) || !SdoRead(slave, 0x6085, 0, &ramp))
            Fail("0x6085");
        std::printf("slave %d: device type 0x%08X, quick stop %u counts/s^2\n", slave, type, ramp);
    }
    SetState(STATE_PRE_OP);
    CloseECMUSB();
    return 0;
}
