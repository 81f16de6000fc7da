/* A program that ends while axis 1 turns in CSV. Argument: how. close: it closes the board first; return, fails,
 * exit, abort: it does not; waits: it does not end until it is killed; forks, clones: the same, with a child that lives
 * for two minutes; handler: a handler of SIGUSR1 that has interrupted a read never returns, and says `stuck`;
 * handler-writes: the same after a write of its own. */
#define _GNU_SOURCE
#include "check.h"

#include <signal.h>
#include <sys/syscall.h>
#include <unistd.h>

static volatile sig_atomic_t reads, writes;

static void handler(int signal)
{
    (void)signal;
    if (reads) {
        CHECK(!writes || write_command());
        CHECK(write(STDOUT_FILENO, "stuck\n", 6) == 6);
        for (;;) {
            pause();
        }
    }
}

static void wait_for_ever(void)
{
    for (;;) {
        pause();
    }
}

int main(int count, char **arguments)
{
    const char *how = count > 1 ? arguments[1] : "";
    int i;

    CHECK(OpenECMUSB());
    CHECK(master(SET_AXIS, 0, 0xFFFFFFF0, 0));
    memset(command, 0, sizeof command);
    command[1].CMD = DRIVE_MODE;
    command[1].Data1 = CSV_MODE;
    command[1].Data2 = DCSYNC;
    CHECK(write_command());
    go_to(STATE_OPERATIONAL);
    memset(command, 0, sizeof command);
    command[1].CMD = SV_ON;
    CHECK(write_command());
    for (i = 0; i < 5000 && (response[1].Parm & 0xFF) != 0x37; i++) {
        CHECK(read_response());
    }
    memset(command, 0, sizeof command);
    command[1].CMD = CSV;
    command[1].Data1 = 100000;
    for (i = 0; i < 100; i++) {
        CHECK(write_command());
        CHECK(read_response());
    }
    puts("moving");
    fflush(stdout);
    if (strcmp(how, "close") == 0) {
        CloseECMUSB();
    } else if (strcmp(how, "fails") == 0) {
        return 1;
    } else if (strcmp(how, "exit") == 0) {
        exit(3);
    } else if (strcmp(how, "abort") == 0) {
        abort();
    } else if (strcmp(how, "waits") == 0) {
        wait_for_ever();
    } else if (strcmp(how, "forks") == 0 || strcmp(how, "clones") == 0) {
        long child = strcmp(how, "forks") == 0 ? fork() : syscall(SYS_clone, SIGCHLD, NULL, NULL, NULL, NULL);
        CHECK(child >= 0);
        if (child == 0) {
            alarm(120);
        } else {
            puts("forked");
            fflush(stdout);
        }
        wait_for_ever();
    } else if (strncmp(how, "handler", 7) == 0) {
        writes = strcmp(how, "handler-writes") == 0;
        signal(SIGUSR1, handler);
        puts("reads");
        fflush(stdout);
        for (;;) {
            reads = 1;
            CHECK(read_response());
            reads = 0;
        }
    }
    return 0;
}
