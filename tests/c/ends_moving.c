/* A program that ends while axis 1 turns in CSV. Argument: how. close: it closes the board first; return, fails, exit,
 * abort: it does not; waits: it ends by nothing at all, until somebody kills it. */
#define _DEFAULT_SOURCE
#include "check.h"

#include <unistd.h>

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
        for (;;) {
            pause();
        }
    }
    return 0;
}
