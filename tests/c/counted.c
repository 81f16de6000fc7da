/* Axis 1 moves to 2500 by CSP, and every frame is accounted for. Argument: tcp: the board is served, and has no
 * counters. */
#include "check.h"

#define STEPS 50
#define END 2500
/* The drive comes to rest in fewer cycles. */
#define REST 50

static unsigned long accepted;

static void write_counted(void)
{
    CHECK(write_command());
    accepted++;
}

int main(int count, char **arguments)
{
    bool is_served = count > 1 && strcmp(arguments[1], "tcp") == 0;
    ecmsk_counters counters = {.size = sizeof counters};
    ecmsk_stats stats = {.size = sizeof stats};
    int step, reads;

    CHECK(OpenECMUSB());
    declare_drives();
    go_to(STATE_OPERATIONAL);
    accepted = 2;

    memset(command, 0, sizeof command);
    command[1].CMD = SV_ON;
    write_counted();
    for (reads = 0; reads < 5000 && (response[1].Parm & 0xFF) != 0x37; reads++) {
        CHECK(read_response());
    }
    CHECK((response[1].Parm & 0xFF) == 0x37);

    memset(command, 0, sizeof command);
    command[1].CMD = CSP;
    for (step = 1; step <= STEPS; step++) {
        command[1].Data1 = (unsigned)(END / STEPS * step);
        write_counted();
        do {
            CHECK(read_response());
        } while ((response[0].Data2 & 0xFFFF) < 150);
    }
    for (reads = 0; reads < 5000 && (int)response[1].Data1 != END; reads++) {
        CHECK(read_response());
    }
    for (reads = 0; reads < REST; reads++) {
        CHECK(read_response());
    }
    CHECK((int)response[1].Data1 == END);

    CHECK(ecmsk_get_stats(ecmsk_vendor_board(), &stats) == ECMSK_OK);
    CHECK(stats.written == accepted && stats.write_errors == 0 && stats.read_errors == 0);
    if (!is_served) {
        CHECK(ecmsk_get_counters(ecmsk_vendor_board(), &counters) == ECMSK_OK);
        CHECK(counters.frames == accepted && counters.full == 0 && counters.cleared == 0 && counters.crc == 0);
    }
    CloseECMUSB();
    CHECK(printf("ok %lu\n", accepted) > 0 && fflush(stdout) == 0);
    return 0;
}
