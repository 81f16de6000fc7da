/* Two threads read one board: each report goes to exactly one of them, and none is lost. The FIFO has targets that each
 * have an index of their own, and the report of the cycle in which the board executes one has that index. Argument: "exact"
 * if the board executes one in each cycle, as it does on the virtual clock. */
#include "check.h"

#include <pthread.h>
#include <sched.h>

enum { TARGETS = 150, AHEAD = 8 };

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static unsigned seen[256];
static unsigned reads[2];
static int is_done;

/* Neither thread goes far ahead of the other one, so that both are reading all the time. */
static int may_read(int me)
{
    int may;
    pthread_mutex_lock(&lock);
    may = is_done || reads[me] <= reads[1 - me] + AHEAD;
    pthread_mutex_unlock(&lock);
    return may;
}

static void *reader(void *number)
{
    int me = *(int *)number, ends = 0;
    static transData frames[2][DEF_MA_MAX];
    while (!ends) {
        unsigned index;
        while (!may_read(me)) {
            sched_yield();
        }
        CHECK(ECMUSBRead((unsigned char *)frames[me], sizeof frames[me]));
        CHECK((frames[me][0].Parm & 0xFF) == STATE_OPERATIONAL);
        index = frames[me][1].CMD >> 8;
        pthread_mutex_lock(&lock);
        reads[me]++;
        seen[index]++;
        is_done |= index == TARGETS;
        ends = is_done;
        pthread_mutex_unlock(&lock);
    }
    return NULL;
}

int main(int argc, char **argv)
{
    pthread_t threads[2];
    int numbers[2] = {0, 1};
    ecmsk_stats before, after;
    unsigned index;
    int i;

    CHECK(OpenECMUSB());
    declare_drives();
    go_to(STATE_OPERATIONAL);
    memset(command, 0, sizeof command);
    command[1].CMD = SV_ON;
    CHECK(write_command());
    for (i = 0; i < 200; i++) {
        CHECK(read_response());
    }
    before.size = after.size = sizeof before;
    CHECK(ecmsk_get_stats(ecmsk_vendor_board(), &before) == ECMSK_OK);
    for (index = 1; index <= TARGETS; index++) {
        memset(command, 0, sizeof command);
        command[1].CMD = (unsigned short)(CSP | index << 8);
        command[1].Data1 = 10 * index;
        CHECK(write_command());
    }
    for (i = 0; i < 2; i++) {
        CHECK(pthread_create(&threads[i], NULL, reader, &numbers[i]) == 0);
    }
    for (i = 0; i < 2; i++) {
        CHECK(pthread_join(threads[i], NULL) == 0);
    }
    CHECK(ecmsk_get_stats(ecmsk_vendor_board(), &after) == ECMSK_OK);
    CHECK(after.read - before.read == reads[0] + reads[1]);
    if (argc > 1 && strcmp(argv[1], "exact") == 0) {
        CHECK(after.reports_dropped == before.reports_dropped);
        for (index = 1; index < TARGETS; index++) {
            if (seen[index] != 1) {
                fprintf(stderr, "the report of target %u was read %u times\n", index, seen[index]);
                return 1;
            }
        }
        CHECK(reads[0] > TARGETS / 3 && reads[1] > TARGETS / 3);
    }
    CHECK(reads[0] > 0 && reads[1] > 0);
    puts("ok");
    return 0;
}
