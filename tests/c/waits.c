/* Every way to wait that the library for --clock virtual stands in front of, without a board: how far each sets the clocks
 * on, in milliseconds. A day passes in it. */
#define _GNU_SOURCE
#include <errno.h>
#include <poll.h>
#include <pthread.h>
#include <semaphore.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/epoll.h>
#include <sys/select.h>
#include <sys/time.h>
#include <sys/times.h>
#include <threads.h>
#include <time.h>
#include <unistd.h>

#define CHECK(holds)                                              \
    do {                                                          \
        if (!(holds)) {                                           \
            fprintf(stderr, "%s:%d: %s\n", __FILE__, __LINE__, #holds); \
            exit(1);                                              \
        }                                                         \
    } while (0)

static long long now_ns(clockid_t clock)
{
    struct timespec time;
    CHECK(clock_gettime(clock, &time) == 0);
    return time.tv_sec * 1000000000LL + time.tv_nsec;
}

static long long began;

/* Prints how long it has been since the last call. */
static void took(const char *what)
{
    long long now = now_ns(CLOCK_MONOTONIC);
    printf("%s: %lld ms\n", what, (now - began) / 1000000);
    began = now_ns(CLOCK_MONOTONIC);
}

static struct timespec in_ms(clockid_t clock, long ms)
{
    long long time = now_ns(clock) + ms * 1000000LL;
    struct timespec at = {time / 1000000000, time % 1000000000};
    return at;
}

/* time() and gettimeofday() show the same second. */
static time_t clock_second(void)
{
    struct timeval now;
    time_t second = time(NULL);
    CHECK(gettimeofday(&now, NULL) == 0);
    CHECK(now.tv_sec == second || now.tv_sec == second + 1);
    return second;
}

static int pipe_ends[2];

static void *write_later(void *unused)
{
    (void)unused;
    CHECK(usleep(30000) == 0);
    CHECK(write(pipe_ends[1], "x", 1) == 1);
    return NULL;
}

static void *hold(void *mutex)
{
    pthread_mutex_lock(mutex);
    CHECK(usleep(30000) == 0);
    pthread_mutex_unlock(mutex);
    return NULL;
}

static volatile int is_set;

static void *set_later(void *unused)
{
    (void)unused;
    CHECK(usleep(30000) == 0);
    is_set = 1;
    return NULL;
}

static void *wait_for_ever(void *condition)
{
    pthread_mutex_t mutex = PTHREAD_MUTEX_INITIALIZER;
    pthread_mutex_lock(&mutex);
    while (pthread_cond_wait(condition, &mutex) == 0) {
    }
    return NULL;
}

static volatile int is_computed;

/* Uses the processor for 10 ms. */
static int compute(void *seven)
{
    long long began_ns = now_ns(CLOCK_THREAD_CPUTIME_ID);
    while (now_ns(CLOCK_THREAD_CPUTIME_ID) - began_ns < 10000000) {
    }
    is_computed = 1;
    return *(int *)seven;
}

int main(void)
{
    struct timespec time = {0, 5000000};
    struct timeval limit = {0, 7000};
    struct pollfd descriptor;
    struct epoll_event event;
    pthread_mutex_t mutex = PTHREAD_MUTEX_INITIALIZER;
    pthread_cond_t condition = PTHREAD_COND_INITIALIZER, monotonic, never = PTHREAD_COND_INITIALIZER;
    pthread_condattr_t attributes;
    pthread_t thread;
    mtx_t c11_mutex;
    cnd_t c11_condition;
    sem_t semaphore;
    fd_set reads;
    char byte;
    void *result;
    int epoll;
    time_t second;
    struct tms processor;
    clock_t tick;
    thrd_t c11_thread;
    int seven = 7, got = 0;

    CHECK(pipe(pipe_ends) == 0);
    CHECK(sem_init(&semaphore, 0, 0) == 0);
    CHECK(pthread_condattr_init(&attributes) == 0);
    CHECK(pthread_condattr_setclock(&attributes, CLOCK_MONOTONIC) == 0);
    CHECK(pthread_cond_init(&monotonic, &attributes) == 0);
    CHECK(mtx_init(&c11_mutex, mtx_plain) == thrd_success && cnd_init(&c11_condition) == thrd_success);
    descriptor.fd = pipe_ends[0];
    descriptor.events = POLLIN;
    CHECK((epoll = epoll_create1(0)) >= 0);
    event.events = EPOLLIN;
    CHECK(epoll_ctl(epoll, EPOLL_CTL_ADD, pipe_ends[0], &event) == 0);

    began = now_ns(CLOCK_MONOTONIC);
    CHECK(nanosleep(&time, NULL) == 0);
    took("nanosleep");
    CHECK(clock_nanosleep(CLOCK_REALTIME, 0, &time, NULL) == 0);
    took("clock_nanosleep");
    time = in_ms(CLOCK_REALTIME, 6);
    CHECK(clock_nanosleep(CLOCK_REALTIME, TIMER_ABSTIME, &time, NULL) == 0);
    took("clock_nanosleep until");
    CHECK(usleep(8000) == 0);
    took("usleep");
    CHECK(sleep(86400) == 0);
    took("sleep");
    time.tv_sec = 0;
    time.tv_nsec = 9000000;
    CHECK(thrd_sleep(&time, NULL) == 0);
    took("thrd_sleep");
    CHECK(poll(&descriptor, 1, 10) == 0);
    took("poll");
    CHECK(ppoll(&descriptor, 1, &time, NULL) == 0);
    took("ppoll");
    CHECK(select(0, NULL, NULL, NULL, &limit) == 0 && limit.tv_sec == 0 && limit.tv_usec == 0);
    took("select");
    FD_ZERO(&reads);
    FD_SET(pipe_ends[0], &reads);
    CHECK(pselect(pipe_ends[0] + 1, &reads, NULL, NULL, &time, NULL) == 0 && !FD_ISSET(pipe_ends[0], &reads));
    took("pselect");
    CHECK(epoll_wait(epoll, &event, 1, 11) == 0);
    took("epoll_wait");
    CHECK(epoll_pwait(epoll, &event, 1, 12, NULL) == 0);
    took("epoll_pwait");
    pthread_mutex_lock(&mutex);
    time = in_ms(CLOCK_REALTIME, 13);
    CHECK(pthread_cond_timedwait(&condition, &mutex, &time) == ETIMEDOUT);
    took("pthread_cond_timedwait");
    time = in_ms(CLOCK_MONOTONIC, 14);
    CHECK(pthread_cond_timedwait(&monotonic, &mutex, &time) == ETIMEDOUT);
    took("on another clock");
    time = in_ms(CLOCK_MONOTONIC, 15);
    CHECK(pthread_cond_clockwait(&condition, &mutex, CLOCK_MONOTONIC, &time) == ETIMEDOUT);
    took("pthread_cond_clockwait");
    pthread_mutex_unlock(&mutex);
    mtx_lock(&c11_mutex);
    time = in_ms(CLOCK_REALTIME, 16);
    CHECK(cnd_timedwait(&c11_condition, &c11_mutex, &time) == thrd_timedout);
    took("cnd_timedwait");
    mtx_unlock(&c11_mutex);
    time = in_ms(CLOCK_REALTIME, 17);
    CHECK(sem_timedwait(&semaphore, &time) == -1 && errno == ETIMEDOUT);
    took("sem_timedwait");
    time = in_ms(CLOCK_MONOTONIC, 18);
    CHECK(sem_clockwait(&semaphore, CLOCK_MONOTONIC, &time) == -1 && errno == ETIMEDOUT);
    took("sem_clockwait");

    /* A lock that another thread holds for 30 ms: after 19 ms it is not free, and later it is. */
    CHECK(pthread_create(&thread, NULL, hold, &mutex) == 0);
    CHECK(usleep(1000) == 0);
    time = in_ms(CLOCK_REALTIME, 19);
    CHECK(pthread_mutex_timedlock(&mutex, &time) == ETIMEDOUT);
    took("pthread_mutex_timedlock");
    time = in_ms(CLOCK_MONOTONIC, 60000);
    CHECK(pthread_mutex_clocklock(&mutex, CLOCK_MONOTONIC, &time) == 0);
    CHECK(pthread_join(thread, NULL) == 0);
    pthread_mutex_unlock(&mutex);
    took("and a lock that comes");

    /* What another thread of the program does ends a wait. */
    CHECK(pthread_create(&thread, NULL, write_later, NULL) == 0);
    CHECK(poll(&descriptor, 1, 60000) == 1 && read(pipe_ends[0], &byte, 1) == 1);
    CHECK(pthread_join(thread, NULL) == 0);
    took("poll for a thread");
    /* A read is blocked in the kernel: the other thread's time goes on. */
    CHECK(pthread_create(&thread, NULL, write_later, NULL) == 0);
    CHECK(read(pipe_ends[0], &byte, 1) == 1);
    CHECK(pthread_join(thread, NULL) == 0);
    took("read");
    /* A loop without a call: the other thread's time goes on as it does for the loop. */
    CHECK(pthread_create(&thread, NULL, set_later, NULL) == 0);
    while (!is_set) {
    }
    CHECK(pthread_join(thread, NULL) == 0);
    took("a loop");
    /* A thread of C11 computes: no deadline comes before it has ended. */
    CHECK(thrd_create(&c11_thread, compute, &seven) == thrd_success);
    CHECK(sleep(10) == 0 && is_computed);
    CHECK(thrd_join(c11_thread, &got) == thrd_success && got == 7);
    took("thrd_create");
    tick = times(&processor);
    CHECK(sleep(10) == 0);
    tick = times(&processor) - tick;
    CHECK(tick >= 10 * sysconf(_SC_CLK_TCK) && tick <= 10 * sysconf(_SC_CLK_TCK) + 1);
    took("times");
    /* A thread that waits for ever can be cancelled. */
    CHECK(pthread_create(&thread, NULL, wait_for_ever, &never) == 0);
    CHECK(usleep(20000) == 0);
    CHECK(pthread_cancel(thread) == 0);
    CHECK(pthread_join(thread, &result) == 0 && result == PTHREAD_CANCELED);
    took("pthread_cancel");

    /* A loop that reads clocks alone ends, too: in the second that begins next. */
    for (second = clock_second(); clock_second() == second;) {
    }
    puts("ok");
    return 0;
}
