/* Waits beyond those of waits.c: sets for select that are no larger than they need be, a descriptor that has hung up, waits
 * without an end, and waits that are longer than a board can pass while another thread has something to do. */
#define _GNU_SOURCE
#include "check.h"

#include <errno.h>
#include <limits.h>
#include <pthread.h>
#include <signal.h>
#include <sys/select.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#define DAY 86400
/* Nearly ten years, the longest wait that has an end. */
#define LONG 300000000

static long second(void)
{
    struct timespec time;
    CHECK(clock_gettime(CLOCK_MONOTONIC, &time) == 0);
    return time.tv_sec;
}

static void *change_later(void *word)
{
    CHECK(usleep(5000) == 0);
    *(volatile unsigned long *)word = 7;
    return NULL;
}

static void *sleep_for_ever(void *unused)
{
    struct timespec longest = {LONG_MAX, 0};
    (void)unused;
    nanosleep(&longest, NULL);
    return NULL;
}

static void *sleep_a_day(void *unused)
{
    (void)unused;
    sleep(DAY);
    return NULL;
}

static void on_alarm(int signal) { (void)signal; }

/* A read that ends after some real time, by a signal, while another thread sleeps. */
static void read_beside(void *(*sleeps)(void *), int from)
{
    struct itimerval every = {{0, 50000}, {0, 50000}}, never = {{0, 0}, {0, 0}};
    pthread_t thread;
    sigset_t alarm;
    char byte;

    sigemptyset(&alarm);
    sigaddset(&alarm, SIGALRM);
    CHECK(pthread_sigmask(SIG_BLOCK, &alarm, NULL) == 0);
    CHECK(pthread_create(&thread, NULL, sleeps, NULL) == 0);
    CHECK(pthread_sigmask(SIG_UNBLOCK, &alarm, NULL) == 0);
    CHECK(setitimer(ITIMER_REAL, &every, NULL) == 0);
    CHECK(read(from, &byte, 1) == -1 && errno == EINTR);
    CHECK(setitimer(ITIMER_REAL, &never, NULL) == 0);
    /* The thread comes back to the library, in which the other one may be passing its day. */
    usleep(1000);
    CHECK(pthread_cancel(thread) == 0);
    CHECK(pthread_join(thread, NULL) == 0);
}

int main(void)
{
    /* As a program that allocates a set by the number of its descriptors; the word behind it is another thread's. */
    unsigned long *words = calloc(2, sizeof *words);
    struct sigaction action;
    struct timeval limit = {0, 10000};
    pthread_t thread;
    int ends[2], hung_up[2], number;
    long began;

    CHECK(words != NULL && pipe(ends) == 0 && pipe(hung_up) == 0);
    CHECK(ends[0] < 64 && hung_up[0] < 64 && sizeof *words == 8);
    words[0] = 1ul << ends[0];
    CHECK(pthread_create(&thread, NULL, change_later, words + 1) == 0);
    CHECK(select(ends[0] + 1, (fd_set *)words, NULL, NULL, &limit) == 0);
    CHECK(pthread_join(thread, NULL) == 0);
    CHECK(words[0] == 0 && words[1] == 7);
    puts("a small set");

    CHECK(close(hung_up[1]) == 0);
    words[0] = 1ul << hung_up[0];
    limit.tv_usec = 10000;
    CHECK(select(hung_up[0] + 1, NULL, NULL, (fd_set *)words, &limit) == 0);
    puts("hung up");

    memset(&action, 0, sizeof action);
    action.sa_handler = on_alarm;
    CHECK(sigaction(SIGALRM, &action, NULL) == 0);
    began = second();
    read_beside(sleep_for_ever, ends[0]);
    CHECK(second() - began <= 1);
    puts("for ever");

    CHECK(OpenECMUSB());
    declare_drives();
    go_to(STATE_OPERATIONAL);
    began = second();
    read_beside(sleep_a_day, ends[0]);
    CHECK(second() - began < DAY);
    CloseECMUSB();
    puts("a day");

    /* The clock stops at its end, after 584 years. */
    for (number = 0; number < 70; number++) {
        began = second();
        CHECK(sleep(LONG) == 0);
        CHECK(second() >= began && time(NULL) > 0);
    }
    puts("ok");
    return 0;
}
