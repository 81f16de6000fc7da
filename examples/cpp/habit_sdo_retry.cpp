// A habit of programs: an SDO request is written once; then all-zero frames are written and responses read until CMD,
// Parm, Data1 and Data2 of the SDO slot match. After 800 tries the request is written again.
#include "NEXTWUSBLib_12B.h"

#include "ecm.h"

const int AXES = 1;
const int ATTEMPTS = 2;

// Reads that it took, 0 if no answer came.
static int Transfer(unsigned short command, unsigned short parm, unsigned object, unsigned *value)
{
    int reads = 0;
    for (int attempt = 0; attempt < ATTEMPTS; attempt++) {
        ClearCmd();
        cmdData[SDO_SLOT].CMD = command;
        cmdData[SDO_SLOT].Parm = parm;
        cmdData[SDO_SLOT].Data1 = object;
        cmdData[SDO_SLOT].Data2 = *value;
        WriteCmd();
        ClearCmd();
        for (int i = 0; i < SDO_TRIES; i++) {
            ReadResp();
            reads++;
            if ((respData[SDO_SLOT].CMD & 0xFF) == command && respData[SDO_SLOT].Parm == (parm & 0xFF) &&
                respData[SDO_SLOT].Data1 == object && (command == SDO_RD || respData[SDO_SLOT].Data2 == *value)) {
                *value = respData[SDO_SLOT].Data2;
                return reads;
            }
            WriteCmd();
        }
    }
    return 0;
}

static void Read(int slave, unsigned index, unsigned subindex)
{
    unsigned value = 0;
    int reads = Transfer(SDO_RD, (unsigned short)slave, index << 16 | subindex, &value);
    if (reads)
        std::printf("read 0x%04X:%u of slave %d: 0x%X after %d reads\n", index, subindex, slave, value, reads);
    else
        // What stands in the slot tells why: an abort has bit 15 of Parm set and its code in Data2.
        std::printf("read 0x%04X:%u of slave %d: no answer; Parm 0x%04X, Data2 0x%08X\n", index, subindex, slave,
                    respData[SDO_SLOT].Parm, respData[SDO_SLOT].Data2);
}

static void Write(int slave, unsigned index, unsigned subindex, int size, unsigned value)
{
    int reads = Transfer(SDO_WR, (unsigned short)(size << 8 | slave), index << 16 | subindex, &value);
    if (reads)
        std::printf("wrote 0x%04X:%u of slave %d: 0x%X after %d reads\n", index, subindex, slave, value, reads);
    else
        std::printf("wrote 0x%04X:%u of slave %d: no answer; Parm 0x%04X, Data2 0x%08X\n", index, subindex, slave,
                    respData[SDO_SLOT].Parm, respData[SDO_SLOT].Data2);
}

static void ReadAndWrite()
{
    Read(1, 0x1000, 0);
    Write(1, 0x6083, 0, 4, 5000000);
    Read(1, 0x6083, 0);
    // The same request again: the old answer matches at once.
    Read(1, 0x6083, 0);
    Read(1, 0x5FFF, 0);
    Write(1, 0x6083, 0, 2, 1000);
    Read(1, 0x6083, 0);
}

int main()
{
    if (!OpenECMUSB())
        Fail("OpenECMUSB");
    ReadResp();
    SetState(STATE_PRE_OP);
    std::printf("in PreOP\n");
    ReadAndWrite();
    SetAxis(AXES, DRIVE);
    SetDc(1000);
    DriveMode(AXES, CSP_MODE);
    SetState(STATE_OPERATIONAL);
    std::printf("in OP\n");
    ReadAndWrite();
    SetState(STATE_PRE_OP);
    CloseECMUSB();
    return 0;
}
