// A frame is an array of slots: 0 for the board itself, 1 to 40 for the slaves in the order of the cable, 41 for SDOs.
#include "NEXTWUSBLib_12B.h"

#include <cstdio>
#include <cstring>

static transData cmdData[DEF_MA_MAX];
static transData respData[DEF_MA_MAX];

int main()
{
    if (!OpenECMUSB())
        return 1;
    // Zeros are GET_STATUS in every slot: they ask for nothing.
    std::memset(cmdData, 0, sizeof(cmdData));
    bool well = ECMUSBWrite((unsigned char *)cmdData, sizeof(cmdData)) &&
                ECMUSBRead((unsigned char *)respData, sizeof(respData));
    std::printf("%d slots of %u bytes\n", DEF_MA_MAX, (unsigned)sizeof(transData));
    if (well)
        std::printf("state %u\n", respData[0].Parm & 0xFF); // the upper byte is the CRC
    CloseECMUSB();
    return well ? 0 : 1;
}
