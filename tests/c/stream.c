#define _POSIX_C_SOURCE 199309L
/* A program that ignores answers, as many do. Arguments: axes, frames of targets, and a variation. */
#include "check.h"

#include <signal.h>
#include <time.h>

static int axes;

static void command_all(unsigned short id, unsigned target)
{
    int axis;
    memset(command, 0, sizeof command);
    for (axis = 1; axis <= axes; axis++) {
        command[axis].CMD = id;
        command[axis].Data1 = target;
    }
    write_command();
}

static void read_some(int reads)
{
    while (reads-- > 0) {
        read_response();
    }
}

int main(int argc, char **argv)
{
    const char *how = argc > 3 ? argv[3] : "";
    int i, frames = argc > 2 ? atoi(argv[2]) : 0;
    axes = argc > 1 ? atoi(argv[1]) : 0;
    if (!OpenECMUSB()) {
        puts("no board");
        return 3;
    }
    if (strcmp(how, "undeclared") != 0) {
        master(SET_AXIS, 0, 0, 0);
    }
    master(SET_STATE, 0, STATE_OPERATIONAL, 0);
    if (strncmp(how, "hasty", 5) == 0) {
        read_some(5);
        if (strcmp(how, "hasty_and_tidy") == 0) {
            master(SET_STATE, 0, STATE_INIT, 0);
            read_some(5);
        }
        puts("gave up");
        CloseECMUSB();
        return 1;
    }
    for (i = 0; i < 4000 && state() != STATE_OPERATIONAL && (state() & 0x10) == 0; i++) {
        read_response();
    }
    command_all(SV_ON, 0);
    read_some(100);
    for (i = 0; i < frames; i++) {
        command_all(CSP, 10 * i);
        if (strcmp(how, "flood") != 0) {
            read_response();
        }
        if (i == frames / 2 && strcmp(how, "gap") == 0) {
            read_some(20);
        }
    }
    if (strcmp(how, "flood") == 0) {
        /* Now the answers show the result. */
        read_some(300);
    }
    puts("done");
    fflush(stdout);
    if (strcmp(how, "killed") == 0) {
        /* The library writes its state several times a second. */
        struct timespec second = {1, 0};
        nanosleep(&second, NULL);
        raise(SIGKILL);
    }
    CloseECMUSB();
    return 0;
}
