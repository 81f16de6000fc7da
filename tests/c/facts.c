/* Counters and statistics of failures: a mode that cannot be written back after homing, commands for a lost slave,
 * frames that a link loses or duplicates. */
#include "check.h"

static ecmsk_counters counters_now(void)
{
    ecmsk_counters counters;
    counters.size = sizeof counters;
    CHECK(ecmsk_get_counters(ecmsk_vendor_board(), &counters) == ECMSK_OK);
    CHECK(counters.size == sizeof counters);
    return counters;
}

static void read_for(int reads)
{
    while (reads-- > 0) {
        CHECK(read_response());
    }
}

static void slave_command(int slave, unsigned short id)
{
    memset(command, 0, sizeof command);
    command[slave].CMD = id;
    CHECK(write_command());
}

/* One byte of an object of slave 1, by SDO. */
static void write_byte(unsigned index, unsigned value)
{
    memset(command, 0, sizeof command);
    command[DEF_MA_MAX - 1].CMD = SDO_WR;
    command[DEF_MA_MAX - 1].Parm = 1 | 1 << 8;
    command[DEF_MA_MAX - 1].Data1 = index << 16;
    command[DEF_MA_MAX - 1].Data2 = value;
    CHECK(write_command());
    read_for(100);
}

static ecmsk_stats stats_of(ecmsk_board *board)
{
    ecmsk_stats stats;
    stats.size = sizeof stats;
    CHECK(ecmsk_get_stats(board, &stats) == ECMSK_OK);
    CHECK(stats.size == sizeof stats);
    return stats;
}

static void faults(void)
{
    static const char *const uri = "sim:?slaves=drive&clock=virtual&fault.drop.write=1&fault.duplicate.read=1"
                                   "&fault.disconnect_after=12";
    unsigned char frame[512];
    ecmsk_board *board = NULL;
    ecmsk_stats stats;
    int i;
    CHECK(ecmsk_open(uri, &board) == ECMSK_OK);
    memset(frame, 0, sizeof frame);
    for (i = 0; i < 3; i++) {
        CHECK(ecmsk_write(board, frame, sizeof frame, ECMSK_WAIT_LINK) == ECMSK_OK);
    }
    for (i = 0; i < 8; i++) {
        CHECK(ecmsk_read(board, frame, sizeof frame, ECMSK_WAIT_LINK) == ECMSK_OK);
    }
    stats = stats_of(board);
    CHECK(stats.write_faults.dropped == 3 && stats.write_faults.duplicated == 0);
    CHECK(stats.read_faults.duplicated == 4 && stats.read_faults.dropped == 0);
    CHECK(stats.write_faults.corrupted == 0 && stats.read_faults.corrupted == 0);
    CHECK(stats.write_faults.delayed == 0 && stats.read_faults.delayed == 0);
    CHECK(stats.disconnected == 0);
    /* A program with the first version of the structure gets that part. */
    stats.size = 56;
    stats.disconnected = 77;
    CHECK(ecmsk_get_stats(board, &stats) == ECMSK_OK);
    CHECK(stats.size == 56 && stats.disconnected == 77);
    for (i = 0; i < 3 && ecmsk_write(board, frame, sizeof frame, ECMSK_WAIT_LINK) == ECMSK_OK; i++) {
    }
    CHECK(i < 3);
    CHECK(stats_of(board).disconnected == 1);
    CHECK(ecmsk_close(board) == ECMSK_OK);
}

int main(void)
{
    CHECK(OpenECMUSB());
    declare_drives();
    go_to(STATE_OPERATIONAL);
    slave_command(1, SV_ON);
    read_for(1000);
    CHECK((response[1].Parm & 0xFF) == 0x37);
    write_byte(0x6060, HOMING_MODE);
    write_byte(0x6098, 35);
    CHECK(counters_now().modes_not_restored == 0);
    /* At 3 s the drive begins to refuse any mode. */
    read_for(2500);
    slave_command(1, GO_HOME);
    read_for(500);
    CHECK((response[1].Parm & 0x1400) == 0x1400);
    CHECK(counters_now().modes_not_restored == 1);
    CHECK(counters_now().for_lost == 0);
    /* At 6 s slave 2 falls silent. */
    while (state() == STATE_OPERATIONAL) {
        read_for(1);
    }
    CHECK(state() & 0x10);
    slave_command(2, SV_ON);
    read_for(10);
    CHECK(counters_now().for_lost == 1);
    CHECK(stats_of(ecmsk_vendor_board()).write_faults.dropped == 0);
    CloseECMUSB();
    faults();
    puts("ok");
    return 0;
}
