/* Three threads: one has the cycle and sleeps to absolute times, one is the operator's and sleeps and waits for conditions
 * with a limit, and main waits for both. It prints when things happened, by the program's own clock, in milliseconds. */
#define _XOPEN_SOURCE 600
#include "check.h"

#include <errno.h>
#include <pthread.h>
#include <semaphore.h>
#include <time.h>
#include <unistd.h>

#define CYCLES 3000

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static pthread_cond_t changed = PTHREAD_COND_INITIALIZER;
static sem_t ended;
static int half_way;
static struct timespec began;

static long milliseconds(void)
{
    struct timespec time;
    CHECK(clock_gettime(CLOCK_MONOTONIC, &time) == 0);
    return (time.tv_sec - began.tv_sec) * 1000 + (time.tv_nsec - began.tv_nsec) / 1000000;
}

static struct timespec in_ms(clockid_t clock, long ms)
{
    struct timespec time;
    CHECK(clock_gettime(clock, &time) == 0);
    time.tv_sec += ms / 1000;
    time.tv_nsec += ms % 1000 * 1000000;
    if (time.tv_nsec >= 1000000000) {
        time.tv_nsec -= 1000000000;
        time.tv_sec++;
    }
    return time;
}

static void *cycles(void *unused)
{
    struct timespec next = in_ms(CLOCK_MONOTONIC, 0);
    int cycle;
    (void)unused;
    for (cycle = 1; cycle <= CYCLES; cycle++) {
        next.tv_nsec += 1000000;
        if (next.tv_nsec >= 1000000000) {
            next.tv_nsec -= 1000000000;
            next.tv_sec++;
        }
        CHECK(clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &next, NULL) == 0);
        CHECK(read_response());
        if (cycle == CYCLES / 2) {
            pthread_mutex_lock(&lock);
            half_way = 1;
            pthread_cond_signal(&changed);
            pthread_mutex_unlock(&lock);
        }
    }
    CHECK(sem_post(&ended) == 0);
    return NULL;
}

static void *operator(void *unused)
{
    struct timespec limit;
    int error = 0;
    (void)unused;
    CHECK(sleep(1) == 0);
    printf("slept: %ld\n", milliseconds() / 100);
    /* Nobody signals it within 250 ms. */
    limit = in_ms(CLOCK_REALTIME, 250);
    pthread_mutex_lock(&lock);
    while (error == 0 && !half_way) {
        error = pthread_cond_timedwait(&changed, &lock, &limit);
    }
    CHECK(error == ETIMEDOUT);
    printf("not yet half way: %ld\n", milliseconds() / 10);
    /* The cycle signals it long before this limit. */
    limit = in_ms(CLOCK_REALTIME, 60000);
    for (error = 0; error == 0 && !half_way;) {
        error = pthread_cond_timedwait(&changed, &lock, &limit);
    }
    CHECK(error == 0 && half_way);
    pthread_mutex_unlock(&lock);
    printf("half way: %ld\n", milliseconds() / 10);
    limit = in_ms(CLOCK_REALTIME, 500);
    CHECK(sem_timedwait(&ended, &limit) == -1 && errno == ETIMEDOUT);
    printf("not yet the end: %ld\n", milliseconds() / 10);
    limit = in_ms(CLOCK_REALTIME, 60000);
    CHECK(sem_timedwait(&ended, &limit) == 0);
    printf("the end: %ld\n", milliseconds() / 10);
    return NULL;
}

int main(void)
{
    pthread_t threads[2];
    CHECK(OpenECMUSB());
    declare_drives();
    go_to(STATE_OPERATIONAL);
    CHECK(sem_init(&ended, 0, 0) == 0);
    began = in_ms(CLOCK_MONOTONIC, 0);
    CHECK(pthread_create(&threads[0], NULL, cycles, NULL) == 0);
    CHECK(pthread_create(&threads[1], NULL, operator, NULL) == 0);
    CHECK(pthread_join(threads[0], NULL) == 0);
    CHECK(pthread_join(threads[1], NULL) == 0);
    CloseECMUSB();
    puts("ok");
    return 0;
}
