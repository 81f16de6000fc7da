/* A program that waits 2.5 s after it has opened its board, then goes to OP and reads reports for 3 s. With the argument
 * "again" it closes the board after the first of these 2.5 s, without a frame, and opens it again. */
#define _XOPEN_SOURCE 600
#include "check.h"

#include <unistd.h>

static void wait_ms(int ms)
{
    for (; ms > 0; ms -= 100) {
        CHECK(usleep(100000) == 0);
    }
}

int main(int count, char **arguments)
{
    int passes;

    CHECK(OpenECMUSB());
    wait_ms(1000);
    if (count > 1 && strcmp(arguments[1], "again") == 0) {
        CloseECMUSB();
        CHECK(OpenECMUSB());
    }
    wait_ms(1500);
    declare_drives();
    go_to(STATE_OPERATIONAL);
    for (passes = 0; passes < 3000; passes++) {
        CHECK(usleep(1000) == 0);
        CHECK(read_response());
    }
    CloseECMUSB();
    return 0;
}
