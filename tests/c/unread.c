/* Unread reports: the newest 32 are kept, the others counted, and the oldest is read first. */
#include "check.h"

static ecmsk_stats stats(void)
{
    ecmsk_stats stats;
    stats.size = sizeof stats;
    CHECK(ecmsk_get_stats(ecmsk_vendor_board(), &stats) == ECMSK_OK);
    return stats;
}

static unsigned long long reports_made(void)
{
    ecmsk_counters counters;
    counters.size = sizeof counters;
    CHECK(ecmsk_get_counters(ecmsk_vendor_board(), &counters) == ECMSK_OK);
    return counters.reports;
}

int main(void)
{
    unsigned long long first, made;
    int i;

    CHECK(OpenECMUSB());
    first = reports_made();
    for (i = 0; i < 400; i++) {
        CHECK(write_command());
    }
    made = reports_made() - first;
    CHECK(made > 32);
    CHECK(stats().reports_dropped == made - 32);
    for (i = 0; i < 32; i++) {
        CHECK(read_response());
        CHECK(reports_made() - first == made);
    }
    /* The queue is empty: the next read waits for a new report. */
    CHECK(read_response());
    CHECK(reports_made() - first == made + 1);
    CHECK(stats().read == 33);
    CHECK(stats().written == 400);

    /* Old reports first: the earlier state, then the one requested meanwhile. */
    for (i = 0; i < 400; i++) {
        CHECK(write_command());
    }
    CHECK(master(SET_STATE, 0, STATE_INIT, 0));
    memset(command, 0, sizeof command);
    for (i = 0; i < 200; i++) {
        CHECK(write_command());
    }
    CHECK(read_response());
    CHECK(state() == STATE_PRE_OP);
    for (i = 1; i < 32; i++) {
        CHECK(read_response());
    }
    CHECK(state() == STATE_INIT);
    puts("ok");
    return 0;
}
