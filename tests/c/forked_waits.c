/* Condition variables that a child of fork has from its parent, under --clock virtual: one on the monotonic clock, and one that
 * both processes share. */
#define _GNU_SOURCE
#include <errno.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#define CHECK(holds)                                              \
    do {                                                          \
        if (!(holds)) {                                           \
            fprintf(stderr, "%s:%d: %s\n", __FILE__, __LINE__, #holds); \
            exit(1);                                              \
        }                                                         \
    } while (0)

struct shared {
    pthread_cond_t condition;
    pthread_mutex_t mutex;
    int is_waiting, is_over;
};

static pthread_cond_t monotonic;
static pthread_mutex_t mutex = PTHREAD_MUTEX_INITIALIZER;

static void wait_500_ms(void)
{
    struct timespec until, now;
    CHECK(clock_gettime(CLOCK_MONOTONIC, &until) == 0);
    long began = until.tv_sec * 1000 + until.tv_nsec / 1000000;
    until.tv_sec += (until.tv_nsec + 500000000) / 1000000000;
    until.tv_nsec = (until.tv_nsec + 500000000) % 1000000000;
    pthread_mutex_lock(&mutex);
    CHECK(pthread_cond_timedwait(&monotonic, &mutex, &until) == ETIMEDOUT);
    pthread_mutex_unlock(&mutex);
    CHECK(clock_gettime(CLOCK_MONOTONIC, &now) == 0);
    printf("%ld ms\n", now.tv_sec * 1000 + now.tv_nsec / 1000000 - began);
    fflush(stdout);
}

int main(void)
{
    struct shared *shared = mmap(NULL, sizeof *shared, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    pthread_condattr_t condition;
    pthread_mutexattr_t lock;
    pid_t child;
    int status, is_waiting;

    CHECK(shared != MAP_FAILED);
    CHECK(pthread_condattr_init(&condition) == 0 && pthread_mutexattr_init(&lock) == 0);
    CHECK(pthread_condattr_setclock(&condition, CLOCK_MONOTONIC) == 0);
    CHECK(pthread_cond_init(&monotonic, &condition) == 0);
    CHECK(pthread_condattr_setpshared(&condition, PTHREAD_PROCESS_SHARED) == 0);
    CHECK(pthread_mutexattr_setpshared(&lock, PTHREAD_PROCESS_SHARED) == 0);
    CHECK(pthread_cond_init(&shared->condition, &condition) == 0 && pthread_mutex_init(&shared->mutex, &lock) == 0);

    wait_500_ms();
    CHECK((child = fork()) >= 0);
    if (child == 0) {
        /* On the real clock: ends the child if nothing wakes it. */
        alarm(60);
        wait_500_ms();
        pthread_mutex_lock(&shared->mutex);
        shared->is_waiting = 1;
        while (!shared->is_over) {
            CHECK(pthread_cond_wait(&shared->condition, &shared->mutex) == 0);
        }
        pthread_mutex_unlock(&shared->mutex);
        puts("woken");
        return 0;
    }
    for (is_waiting = 0; !is_waiting && waitpid(child, &status, WNOHANG) == 0;) {
        pthread_mutex_lock(&shared->mutex);
        is_waiting = shared->is_waiting;
        shared->is_over = is_waiting;
        pthread_mutex_unlock(&shared->mutex);
    }
    CHECK(is_waiting && pthread_cond_signal(&shared->condition) == 0);
    CHECK(waitpid(child, &status, 0) == child && WIFEXITED(status) && WEXITSTATUS(status) == 0);
    puts("ok");
    return 0;
}
