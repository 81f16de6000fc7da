/* Loop.cs in C: the same calls on the same library. Argument `copies`: also what the assembly does beside them for its user, a
 * copy of every frame and its CRC-8, both ways. */
#define _POSIX_C_SOURCE 199309L
#include "NEXTWUSBLib.h"

#include <stdio.h>
#include <string.h>
#include <time.h>

enum { LENGTH = DEF_MA_MAX * sizeof(transData), TABLE = 256 };

static transData cmdData[DEF_MA_MAX], respData[DEF_MA_MAX];
static unsigned char tables[8 * TABLE];

static void make_tables(void)
{
    for (int value = 0; value < TABLE; value++) {
        unsigned crc = (unsigned)value;
        for (int bit = 0; bit < 8; bit++)
            crc = (crc & 0x80) != 0 ? (crc << 1 ^ 0x07) & 0xFF : crc << 1;
        tables[value] = (unsigned char)crc;
    }
    for (int i = TABLE; i < 8 * TABLE; i++)
        tables[i] = tables[tables[i - TABLE]];
}

static unsigned char crc8(const unsigned char *bytes)
{
    unsigned crc = 0x5A;
    for (const unsigned char *end = bytes + LENGTH; bytes < end; bytes += 8)
        crc = tables[7 * TABLE + (bytes[0] ^ crc)] ^ tables[6 * TABLE + bytes[1]] ^ tables[5 * TABLE + bytes[2]] ^
              tables[4 * TABLE + bytes[3]] ^ tables[3 * TABLE + bytes[4]] ^ tables[2 * TABLE + bytes[5]] ^
              tables[TABLE + bytes[6]] ^ tables[bytes[7]];
    return (unsigned char)crc;
}

static bool write_copy(void)
{
    unsigned char frame[LENGTH];
    memcpy(frame, cmdData, LENGTH);
    frame[3] = 0;
    frame[3] = crc8(frame);
    return ECMUSBWrite(frame, LENGTH);
}

static bool read_copy(void)
{
    unsigned char frame[LENGTH];
    if (!ECMUSBRead(frame, LENGTH))
        return false;
    unsigned char crc = frame[3];
    frame[3] = 0;
    if (crc != 0 && crc != crc8(frame))
        return false;
    frame[3] = crc;
    memcpy(respData, frame, LENGTH);
    return true;
}

static double now(void)
{
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return (double)time.tv_sec * 1e9 + (double)time.tv_nsec;
}

int main(int count, char **arguments)
{
    bool copies = count > 1 && strcmp(arguments[1], "copies") == 0;
    int rounds;
    make_tables();
    if (!OpenECMUSB())
        return 1;
    while (scanf("%d", &rounds) == 1) {
        double start = now();
        for (int i = 0; i < rounds; i++) {
            cmdData[1].Data1 = (unsigned)i;
            bool both = copies ? write_copy() && read_copy()
                               : ECMUSBWrite((unsigned char *)cmdData, LENGTH) && ECMUSBRead((unsigned char *)respData, LENGTH);
            if (!both)
                return 1;
        }
        printf("%.1f\n", (now() - start) / rounds);
        fflush(stdout);
    }
    return 0;
}
