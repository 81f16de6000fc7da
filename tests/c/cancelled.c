/* Threads that are cancelled in the library: the pending call completes, and the thread ends after it, where the
 * program itself waits or tests (pthread_testcancel). The next thread finds the board in a valid state. */
#include "check.h"

#include <pthread.h>
#include <sched.h>

static volatile int reading, ended, went_on;

/* Cancelled before its first call: every call completes, also one that opens or closes a board. */
static void *cancelled_before(void *unused)
{
    (void)unused;
    CHECK(pthread_cancel(pthread_self()) == 0);
    CHECK(OpenECMUSB());
    CHECK(write_command());
    CHECK(read_response());
    CHECK(!ECMUSBRead(NULL, sizeof response));
    CloseECMUSB();
    CHECK(OpenECMUSB());
    ended = 1;
    pthread_testcancel();
    went_on = 1;
    return NULL;
}

/* Cancelled while it waits for a report. */
static void *cancelled_in_a_read(void *unused)
{
    (void)unused;
    reading = 1;
    while (!went_on) {
        ended = read_response();
        CHECK(ended);
        pthread_testcancel();
    }
    return NULL;
}

static void run(void *(*thread)(void *))
{
    pthread_t id;
    void *result;

    reading = ended = went_on = 0;
    CHECK(pthread_create(&id, NULL, thread, NULL) == 0);
    if (thread == cancelled_in_a_read) {
        while (!reading) {
            sched_yield();
        }
        CHECK(pthread_cancel(id) == 0);
    }
    CHECK(pthread_join(id, &result) == 0);
    CHECK(result == PTHREAD_CANCELED && ended && !went_on);
    CHECK(write_command() && read_response());
}

int main(void)
{
    int round;

    for (round = 0; round < 5; round++) {
        run(cancelled_before);
    }
    for (round = 0; round < 100; round++) {
        run(cancelled_in_a_read);
    }
    CloseECMUSB();
    puts("ok");
    return 0;
}
