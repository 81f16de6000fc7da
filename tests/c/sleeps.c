/* One thread that paces itself by the clock of the system, as old programs do: in each pass of its loop it sleeps a
 * millisecond and reads a report. It moves an axis back and forth by CSP, until 20 s have passed by the clock, and prints
 * where it has come to rest. With the argument "by-calls" it sleeps and looks at the clock nowhere. On standard error it
 * prints how often it has slept, and for how long it has run. */
#define _XOPEN_SOURCE 600
#include "check.h"

#include <time.h>
#include <unistd.h>

#define MOVES 10
#define STEPS 1000
#define COUNTS_A_STEP 20

static bool by_calls;
static long sleeps;

static double now(void)
{
    struct timespec time;
    CHECK(clock_gettime(CLOCK_MONOTONIC, &time) == 0);
    return (double)time.tv_sec + (double)time.tv_nsec * 1e-9;
}

static void pass(void)
{
    if (!by_calls) {
        CHECK(usleep(1000) == 0);
        sleeps++;
    }
    CHECK(read_response());
}

static bool is_on(void) { return (response[1].Parm & 0xFF) == 0x37; }

int main(int count, char **arguments)
{
    double began;
    int move, step, target = 0, passes;

    by_calls = count > 1 && strcmp(arguments[1], "by-calls") == 0;
    CHECK(OpenECMUSB());
    declare_drives();
    go_to(STATE_OPERATIONAL);
    memset(command, 0, sizeof command);
    command[1].CMD = SV_ON;
    CHECK(write_command());
    for (passes = 0; passes < 5000 && !is_on(); passes++) {
        pass();
    }
    CHECK(is_on());

    began = now();
    for (move = 0; move < MOVES; move++) {
        for (step = 0; step < STEPS; step++) {
            target += move % 2 == 0 ? COUNTS_A_STEP : -COUNTS_A_STEP / 2;
            memset(command, 0, sizeof command);
            command[1].CMD = CSP;
            command[1].Data1 = (unsigned)target;
            CHECK(write_command());
            pass();
        }
        /* A second of rest. */
        for (passes = 0; passes < 1000; passes++) {
            pass();
        }
        printf("move %d: at %d\n", move, (int)response[1].Data1);
    }
    if (!by_calls) {
        CHECK(now() - began >= MOVES * (STEPS + 1000) * 0.001);
        fprintf(stderr, "%ld sleeps, %.6f s\n", sleeps, now() - began);
    }
    CloseECMUSB();
    puts("ok");
    return 0;
}
