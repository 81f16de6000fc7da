/* The functions besides the vendor's: several boards by URI, validated handles, facts of a board. */
#include "check.h"

#include <limits.h>
#include <stdint.h>

static ecmsk_board *made_up(uintptr_t value) { return (ecmsk_board *)value; }

static void a_bad_handle_is_an_error(ecmsk_board *board)
{
    unsigned char buffer[512] = {0};
    ecmsk_stats stats;
    ecmsk_counters counters;
    char name[8];
    size_t needed;
    stats.size = sizeof stats;
    counters.size = sizeof counters;
    CHECK(ecmsk_read(board, buffer, sizeof buffer, 0) == ECMSK_ERROR_HANDLE);
    CHECK(ecmsk_write(board, buffer, sizeof buffer, 0) == ECMSK_ERROR_HANDLE);
    CHECK(ecmsk_get_stats(board, &stats) == ECMSK_ERROR_HANDLE);
    CHECK(ecmsk_get_counters(board, &counters) == ECMSK_ERROR_HANDLE);
    CHECK(ecmsk_get_link_name(board, name, sizeof name, &needed) == ECMSK_ERROR_HANDLE);
    CHECK(ecmsk_close(board) == ECMSK_ERROR_HANDLE);
    CHECK(last_error_has("no open board has the handle"));
}

static unsigned state_of(ecmsk_board *board)
{
    unsigned char report[512];
    CHECK(ecmsk_read(board, report, sizeof report, ECMSK_WAIT_LINK) == ECMSK_OK);
    return report[2];
}

static void set_state(ecmsk_board *board, unsigned wanted)
{
    int reads;
    /* All slaves are drives. */
    memset(command, 0, sizeof command);
    command[0].CMD = SET_AXIS;
    CHECK(ecmsk_write(board, (unsigned char *)command, sizeof command, ECMSK_WAIT_FOREVER) == ECMSK_OK);
    command[0].CMD = SET_STATE;
    command[0].Data1 = wanted;
    CHECK(ecmsk_write(board, (unsigned char *)command, sizeof command, ECMSK_WAIT_FOREVER) == ECMSK_OK);
    for (reads = 0; state_of(board) != wanted; reads++) {
        CHECK(reads < 20000);
    }
}

static void boards_of_their_own(void)
{
    ecmsk_board *one = NULL, *two = NULL;
    CHECK(ecmsk_open("sim:?slaves=drive", &one) == ECMSK_OK);
    CHECK(ecmsk_open("sim:?slaves=drive", &two) == ECMSK_OK);
    CHECK(one && two && one != two);
    set_state(one, STATE_OPERATIONAL);
    CHECK(state_of(one) == STATE_OPERATIONAL);
    CHECK(state_of(two) == STATE_PRE_OP);
    CHECK(ecmsk_close(one) == ECMSK_OK);
    a_bad_handle_is_an_error(one);
    CHECK(state_of(two) == STATE_PRE_OP);
    CHECK(ecmsk_close(two) == ECMSK_OK);
    a_bad_handle_is_an_error(two);
}

static void a_board_shared_by_name(void)
{
    static const char *const uri = "sim:?slaves=drive&name=shared";
    ecmsk_board *first = NULL, *second = made_up(5);
    CHECK(ecmsk_open(uri, &first) == ECMSK_OK);
    set_state(first, STATE_OPERATIONAL);
    CHECK(ecmsk_open(uri, &second) == ECMSK_ERROR_IN_USE);
    CHECK(second == NULL);
    CHECK(last_error_has("in use"));
    CHECK(ecmsk_close(first) == ECMSK_OK);
    CHECK(ecmsk_open(uri, &second) == ECMSK_OK);
    CHECK(state_of(second) == STATE_OPERATIONAL);
    CHECK(second != first);
    CHECK(ecmsk_close(second) == ECMSK_OK);
}

static void facts(ecmsk_board *board)
{
    struct {
        ecmsk_stats stats;
        unsigned char later[64];
    } newer;
    ecmsk_stats stats;
    ecmsk_counters counters;
    char name[200], cut[5];
    size_t needed = 0, i;
    unsigned kind;

    /* A program built with an older, shorter structure gets the part that fits. */
    memset(&stats, 0xA5, sizeof stats);
    stats.size = 16;
    CHECK(ecmsk_get_stats(board, &stats) == ECMSK_OK);
    CHECK(stats.size == 16 && stats.reserved == 0);
    CHECK(is_filled_with((unsigned char *)&stats + 16, sizeof stats - 16, 0xA5));
    /* One built with a newer, longer structure sees by `size` how much is filled in. */
    memset(&newer, 0xA5, sizeof newer);
    newer.stats.size = sizeof newer;
    CHECK(ecmsk_get_stats(board, &newer.stats) == ECMSK_OK);
    CHECK(newer.stats.size == sizeof stats);
    CHECK(is_filled_with(newer.later, sizeof newer.later, 0xA5));
    for (stats.size = 0; stats.size < 8; stats.size++) {
        unsigned size = stats.size;
        CHECK(ecmsk_get_stats(board, &stats) == ECMSK_ERROR_ARGUMENT);
        CHECK(stats.size == size);
    }
    CHECK(last_error_has("sizeof"));
    CHECK(ecmsk_get_stats(board, NULL) == ECMSK_ERROR_ARGUMENT);
    CHECK(ecmsk_get_counters(board, NULL) == ECMSK_ERROR_ARGUMENT);

    /* Counters change with events: a frame with an undocumented command. */
    counters.size = sizeof counters;
    CHECK(ecmsk_get_counters(board, &counters) == ECMSK_OK);
    CHECK(counters.size == sizeof counters);
    {
        unsigned long long frames = counters.frames, rejected = 0;
        memset(command, 0, sizeof command);
        command[0].CMD = 0x77;
        CHECK(ecmsk_write(board, (unsigned char *)command, sizeof command, ECMSK_WAIT_LINK) == ECMSK_OK);
        /* If a thread runs the board, it shows its counters a cycle later. */
        for (i = 0; i < 1000 && counters.frames == frames; i++) {
            state_of(board);
            counters.size = sizeof counters;
            CHECK(ecmsk_get_counters(board, &counters) == ECMSK_OK);
        }
        CHECK(counters.frames == frames + 1);
        for (kind = 0; kind < ECMSK_REJECT_KINDS; kind++) {
            if (ecmsk_reject_name(kind) && strcmp(ecmsk_reject_name(kind), "unknown_id") == 0) {
                rejected = counters.rejected[kind];
            }
        }
        CHECK(rejected == 1);
    }
    CHECK(ecmsk_reject_name(ECMSK_REJECT_KINDS) == NULL);
    CHECK(ecmsk_reject_name(UINT_MAX) == NULL);

    CHECK(ecmsk_get_link_name(board, name, sizeof name, &needed) == ECMSK_OK);
    CHECK(needed == strlen(name) + 1);
    CHECK(strncmp(name, "sim:", 4) == 0);
    CHECK(ecmsk_get_link_name(board, NULL, 0, &needed) == ECMSK_OK);
    CHECK(needed == strlen(name) + 1);
    CHECK(ecmsk_get_link_name(board, NULL, 0, NULL) == ECMSK_OK);
    CHECK(ecmsk_get_link_name(board, NULL, 1, NULL) == ECMSK_ERROR_ARGUMENT);
    for (i = 1; i <= sizeof cut; i++) {
        memset(cut, 0x7F, sizeof cut);
        CHECK(ecmsk_get_link_name(board, cut, i, NULL) == ECMSK_OK);
        CHECK(strlen(cut) == i - 1 && strncmp(cut, name, i - 1) == 0);
    }
}

static void timeouts(ecmsk_board *board)
{
    static const int64_t good[] = {ECMSK_WAIT_FOREVER, ECMSK_WAIT_LINK, 1, 1000, INT64_MAX};
    unsigned char report[512];
    size_t i;
    for (i = 0; i < sizeof good / sizeof good[0]; i++) {
        CHECK(ecmsk_read(board, report, sizeof report, good[i]) == ECMSK_OK || good[i] == 1);
        memset(report, 0, sizeof report);
        CHECK(ecmsk_write(board, report, sizeof report, good[i]) == ECMSK_OK);
    }
    CHECK(ecmsk_read(board, report, sizeof report, -3) == ECMSK_ERROR_ARGUMENT);
    CHECK(ecmsk_write(board, report, sizeof report, INT64_MIN) == ECMSK_ERROR_ARGUMENT);
    CHECK(last_error_has("ECMSK_WAIT_FOREVER"));
    /* Without waiting: an available report, or a timeout that leaves the buffer unchanged. */
    for (i = 0; i < 100; i++) {
        ecmsk_result result;
        memset(report, 0xA5, sizeof report);
        result = ecmsk_read(board, report, sizeof report, 0);
        CHECK(result == ECMSK_OK || result == ECMSK_ERROR_TIMEOUT);
        CHECK(result == ECMSK_OK || is_filled_with(report, sizeof report, 0xA5));
        if (result == ECMSK_ERROR_TIMEOUT) {
            break;
        }
    }
    CHECK(i < 100);
    CHECK(ecmsk_read(board, NULL, 512, 0) == ECMSK_ERROR_ARGUMENT);
    CHECK(ecmsk_read(board, report, 0, 0) == ECMSK_ERROR_ARGUMENT);
    CHECK(ecmsk_write(board, NULL, 512, 0) == ECMSK_ERROR_ARGUMENT);
    CHECK(ecmsk_write(board, report, 0, 0) == ECMSK_ERROR_ARGUMENT);
}

int main(void)
{
    static const uintptr_t handles[] = {0, 2, 3, 15, 16, 17, 4096, (uintptr_t)-1, (uintptr_t)-2};
    ecmsk_board *board = made_up(5);
    unsigned char buffer[512] = {0};
    size_t i;

    CHECK(strchr(ecmsk_version(), '.') != NULL);
    for (i = 0; i < sizeof handles / sizeof handles[0]; i++) {
        a_bad_handle_is_an_error(made_up(handles[i]));
    }
    a_bad_handle_is_an_error((ecmsk_board *)buffer);

    CHECK(ecmsk_open(NULL, &board) == ECMSK_ERROR_ARGUMENT);
    CHECK(board == NULL);
    CHECK(ecmsk_open("sim:", NULL) == ECMSK_ERROR_ARGUMENT);
    CHECK(ecmsk_open("sim:?slaves=drive&nonsense=1", &board) == ECMSK_ERROR_ARGUMENT);
    CHECK(last_error_has("nonsense"));
    CHECK(ecmsk_open("", &board) == ECMSK_ERROR_ARGUMENT);
    CHECK(ecmsk_open("\xFF\xFE", &board) == ECMSK_ERROR_ARGUMENT);
    CHECK(last_error_has("UTF-8"));
    CHECK(ecmsk_open("can:eth1", &board) == ECMSK_ERROR_ARGUMENT);
    CHECK(last_error_has("`can`"));
    CHECK(board == NULL);

    boards_of_their_own();
    a_board_shared_by_name();

    CHECK(ecmsk_open("sim:?slaves=drive", &board) == ECMSK_OK);
    facts(board);
    timeouts(board);
    CHECK(ecmsk_close(board) == ECMSK_OK);
    CHECK(ecmsk_close(board) == ECMSK_ERROR_HANDLE);

    /* The board of OpenECMUSB also has a handle. */
    board = ecmsk_vendor_board();
    CHECK(ecmsk_read(board, buffer, sizeof buffer, 0) == ECMSK_ERROR_CLOSED);
    CHECK(OpenECMUSB());
    facts(board);
    timeouts(board);
    CHECK(ecmsk_close(board) == ECMSK_OK);
    CHECK(!read_response());
    CHECK(ecmsk_close(board) == ECMSK_OK);
    puts("ok");
    return 0;
}
