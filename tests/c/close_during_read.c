/* Close while another thread reads: the read returns false. The cycle is half a second, so that the reader is blocked
 * whenever the program closes. */
#include "check.h"

#include <pthread.h>
#include <sched.h>

static volatile int reading;

static void *reader(void *unused)
{
    static transData mine[DEF_MA_MAX];
    (void)unused;
    reading = 1;
    while (ECMUSBRead((unsigned char *)mine, sizeof mine)) {
    }
    CHECK(last_error_has("closed") || last_error_has("call OpenECMUSB first"));
    return NULL;
}

int main(void)
{
    int round;

    CHECK(OpenECMUSB());
    CHECK(master(SET_DC, 0, 512000, 0xFFFF));
    declare_drives();
    go_to(STATE_OPERATIONAL);
    for (round = 0; round < 30; round++) {
        pthread_t thread;
        reading = 0;
        CHECK(pthread_create(&thread, NULL, reader, NULL) == 0);
        while (!reading) {
            sched_yield();
        }
        CloseECMUSB();
        CHECK(pthread_join(thread, NULL) == 0);
        CHECK(OpenECMUSB());
    }
    puts("ok");
    return 0;
}
