/* Writes two frames whose bytes mean nothing to a board: in the first byte 3, the place of the CRC, is 0, in the second it
 * is wrong. */
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
