/* Threads that are killed while they wait in the library, so that nothing of them is freed: every other thread reads
 * and writes, closes and opens, as if they had never existed. With the argument `cancel` threads are cancelled, which
 * stay in their calls until those end. With `receives` the system ends a thread in the call that takes bytes from a
 * server: the board is lost then. */
#define _GNU_SOURCE
#include "check.h"

#include <linux/filter.h>
#include <linux/seccomp.h>
#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <stddef.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <unistd.h>

enum { ROUNDS = 6, CYCLE_US = 32000 };

static volatile int reads;
static volatile pid_t number;
static bool by_cancel, by_receipt;

/* Ends the thread that it has interrupted, and nothing else. */
static void end_thread(int signal)
{
    (void)signal;
    syscall(SYS_exit, 0);
}

/* The system ends the calling thread, and nothing else, where it receives. */
static void end_where_it_receives(void)
{
    struct sock_filter steps[] = {
        BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(struct seccomp_data, nr)),
        BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, SYS_recvfrom, 0, 1),
        BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_KILL_THREAD),
        BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW),
    };
    struct sock_fprog program = {sizeof steps / sizeof *steps, steps};
    CHECK(prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0);
    CHECK(prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program) == 0);
}

static void *reader(void *buffer)
{
    number = (pid_t)syscall(SYS_gettid);
    if (by_receipt) {
        end_where_it_receives();
        reads = 1;
    }
    while (ECMUSBRead((unsigned char *)buffer, 512)) {
        reads++;
        pthread_testcancel();
    }
    return NULL;
}

static void pause_ms(unsigned ms) { usleep(ms * 1000); }

static bool is_gone(void) { return syscall(SYS_tgkill, getpid(), number, 0) != 0; }

/* Whether the thread sleeps. */
static bool sleeps(void)
{
    char name[64];
    char state = 0;
    FILE *file;
    snprintf(name, sizeof name, "/proc/self/task/%d/stat", (int)number);
    file = fopen(name, "r");
    if (file != NULL) {
        /* The name of the program, in brackets, has no blank. */
        if (fscanf(file, "%*d %*s %c", &state) != 1) {
            state = 0;
        }
        fclose(file);
    }
    return state == 'S';
}

static pthread_t start(unsigned char *buffer)
{
    pthread_t thread;
    reads = 0;
    CHECK(pthread_create(&thread, NULL, reader, buffer) == 0);
    while (reads == 0) {
        pause_ms(1);
    }
    if (by_receipt) {
        return thread;
    }
    /* It has just read a report and waits for the next one, which is far away: also on a machine that stalled
     * meanwhile. */
    while (!sleeps()) {
        sched_yield();
    }
    return thread;
}

static void open_board(void)
{
    int tries = 0;
    /* After a lost board the server stops its axes first. */
    while (!OpenECMUSB()) {
        CHECK(by_receipt && tries++ < 3000);
        pause_ms(10);
    }
    CHECK(master(SET_DC, 0, CYCLE_US, 0xFFFF));
    declare_drives();
    go_to(STATE_OPERATIONAL);
}

/* The program's next calls. */
static void goes_on(void)
{
    CHECK(write_command());
    CHECK(read_response());
    CHECK(write_command());
    CHECK(read_response());
}

int main(int count, char **arguments)
{
    static unsigned char buffers[2][512];
    int round;
    by_cancel = count > 1 && strcmp(arguments[1], "cancel") == 0;
    by_receipt = count > 1 && strcmp(arguments[1], "receives") == 0;

    signal(SIGUSR2, end_thread);
    open_board();
    for (round = 0; round < ROUNDS; round++) {
        /* One waiting thread, and in every second round a second one. */
        pthread_t first = start(buffers[0]);
        pid_t first_number = number;
        if (by_cancel) {
            /* It stays in its call, which does no harm, and ends with it. */
            CHECK(pthread_cancel(first) == 0);
        } else {
            CHECK(by_receipt || pthread_kill(first, SIGUSR2) == 0);
            while (!is_gone()) {
                pause_ms(1);
            }
            if (round % 2 == 1 && !by_receipt) {
                pthread_t second = start(buffers[1]);
                CHECK(number != first_number);
                CHECK(pthread_kill(second, SIGUSR2) == 0);
                while (!is_gone()) {
                    pause_ms(1);
                }
            }
        }
        if (by_receipt && round % 2 == 1) {
            CHECK(!read_response());
        } else if (round % 3 != 2 && !by_receipt) {
            goes_on();
        }
        if (round % 3 != 1 || by_receipt) {
            /* Close, and the next Open. */
            CloseECMUSB();
            if (by_cancel) {
                CHECK(pthread_join(first, NULL) == 0);
            }
            CHECK(!read_response());
            open_board();
            goes_on();
        }
    }
    CloseECMUSB();
    CHECK(!write_command());
    puts("ok");
    return 0;
}
