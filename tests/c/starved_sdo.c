/* SDO requests of a slow program: between two reads the board makes more reports than are kept. It writes a request
 * once, then all-zero frames, and reads until the SDO slot has the answer, 800 reads at most, as programs do. */
#include "check.h"

enum { SDO_SLOT = 41, TRIES = 800, ROUNDS = 40, BETWEEN = 400 };

/* The board's time passes by writes: 125 us each. */
static void falls_behind(void)
{
    static transData nothing[DEF_MA_MAX];
    int i;
    for (i = 0; i < BETWEEN; i++) {
        CHECK(ECMUSBWrite((unsigned char *)nothing, sizeof nothing));
    }
}

static void request(unsigned short id, unsigned short parm, unsigned object, unsigned value)
{
    static transData sdo[DEF_MA_MAX];
    int tries;
    memset(sdo, 0, sizeof sdo);
    sdo[SDO_SLOT].CMD = id;
    sdo[SDO_SLOT].Parm = parm;
    sdo[SDO_SLOT].Data1 = object;
    sdo[SDO_SLOT].Data2 = value;
    CHECK(ECMUSBWrite((unsigned char *)sdo, sizeof sdo));
    for (tries = 0; tries < TRIES; tries++) {
        falls_behind();
        CHECK(read_response());
        if (response[SDO_SLOT].CMD == id && response[SDO_SLOT].Parm == (parm & 0xFF)
            && response[SDO_SLOT].Data1 == object && response[SDO_SLOT].Data2 == value) {
            return;
        }
    }
    fprintf(stderr, "no answer to %u of %08X = %u\n", id, object, value);
    exit(1);
}

int main(void)
{
    ecmsk_stats stats;
    unsigned round;

    CHECK(OpenECMUSB());
    declare_drives();
    go_to(STATE_PRE_OP);
    for (round = 0; round < ROUNDS; round++) {
        /* Profile velocity, 4 bytes. */
        request(SDO_WR, 0x0401, 0x60810000, 1000 + round);
        request(SDO_RD, 0x0001, 0x60810000, 1000 + round);
    }
    stats.size = sizeof stats;
    CHECK(ecmsk_get_stats(ecmsk_vendor_board(), &stats) == ECMSK_OK);
    CHECK(stats.reports_dropped > 1000);
    CloseECMUSB();
    puts("ok");
    return 0;
}
