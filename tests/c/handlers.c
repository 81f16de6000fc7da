/* Signal handlers beside sleeps of --clock virtual: they exchange frames and close the board while a sleep, or a wait for
 * descriptors with a mask, is interrupted anywhere; they end such waits; one that is blocked keeps nobody from sleeping. */
#define _GNU_SOURCE
#include "check.h"

#include <errno.h>
#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#define CALLS 300

static volatile sig_atomic_t calls, is_blocked, is_let_go;

static void exchange(int signal)
{
    (void)signal;
    if (write_command() && read_response()) {
        calls++;
    }
}

static void close_board(int signal)
{
    (void)signal;
    CloseECMUSB();
    calls = 0;
}

static void block(int signal)
{
    (void)signal;
    is_blocked = 1;
    while (!is_let_go) {
        pause();
    }
}

static void nothing(int signal) { (void)signal; }

static void on(int signal, void (*handler)(int))
{
    struct sigaction action;
    memset(&action, 0, sizeof action);
    action.sa_handler = handler;
    CHECK(sigaction(signal, &action, NULL) == 0);
}

/* Sends SIGUSR1 every millisecond of the real clock. */
static timer_t begin_signals(void)
{
    struct sigevent event;
    struct itimerspec every = {{0, 1000000}, {0, 1000000}};
    timer_t timer;
    memset(&event, 0, sizeof event);
    event.sigev_notify = SIGEV_SIGNAL;
    event.sigev_signo = SIGUSR1;
    CHECK(timer_create(CLOCK_MONOTONIC, &event, &timer) == 0);
    CHECK(timer_settime(timer, 0, &every, NULL) == 0);
    return timer;
}

static void *sleep_on(void *unused)
{
    for (;;) {
        usleep(1000);
    }
    return unused;
}

int main(void)
{
    struct timespec millisecond = {0, 1000000}, longest = {1L << 40, 0};
    sigset_t usr1, none;
    timer_t timer;
    pthread_t thread;
    int interrupted, i;

    /* On the real clock: ends the program if it hangs. */
    alarm(120);
    CHECK(sigemptyset(&none) == 0 && sigemptyset(&usr1) == 0 && sigaddset(&usr1, SIGUSR1) == 0);
    CHECK(OpenECMUSB());

    on(SIGUSR1, exchange);
    timer = begin_signals();
    while (calls < CALLS) {
        usleep(1000);
    }
    puts("frames in sleeps");

    CHECK(pthread_sigmask(SIG_BLOCK, &usr1, NULL) == 0);
    for (calls = 0, interrupted = 0; calls < CALLS;) {
        int before = calls, result = ppoll(NULL, 0, &millisecond, &none);
        CHECK(result == 0 || errno == EINTR);
        CHECK(result == 0 || calls > before);
        interrupted += result != 0;
    }
    CHECK(interrupted > 0);
    puts("frames in ppoll");
    CHECK(pthread_sigmask(SIG_UNBLOCK, &usr1, NULL) == 0);

    for (i = 0; i < 20; i++) {
        CHECK(nanosleep(&longest, NULL) == -1 && errno == EINTR);
    }
    puts("sleeps end");

    on(SIGUSR1, close_board);
    for (calls = 1; calls;) {
        usleep(1000);
    }
    CHECK(timer_delete(timer) == 0);
    puts("closed");

    on(SIGUSR1, block);
    on(SIGUSR2, nothing);
    CHECK(pthread_create(&thread, NULL, sleep_on, NULL) == 0);
    sleep(1);
    CHECK(pthread_kill(thread, SIGUSR1) == 0);
    while (!is_blocked) {
    }
    /* If that thread did not count as waiting, these would take the real time. */
    alarm(100);
    for (i = 0; i < 2000; i++) {
        usleep(100000);
    }
    is_let_go = 1;
    CHECK(pthread_kill(thread, SIGUSR2) == 0);
    puts("beside a handler\nok");
    return 0;
}
