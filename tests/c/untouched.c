/* Writes two frames whose bytes mean nothing to a board: byte 3, the CRC, is 0 in the first one and wrong in the
 * second one. */
#include "check.h"

int main(void)
{
    unsigned char bytes[512];
    unsigned i, crc;

    CHECK(OpenECMUSB());
    for (crc = 0; crc < 2; crc++) {
        for (i = 0; i < sizeof bytes; i++) {
            bytes[i] = (unsigned char)(0x80 + i * 7);
        }
        bytes[3] = crc ? 0xEE : 0;
        CHECK(ECMUSBWrite(bytes, sizeof bytes));
    }
    CloseECMUSB();
    puts("ok");
    return 0;
}
