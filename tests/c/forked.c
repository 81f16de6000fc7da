/* The child of a program with an open board has no board: every call returns false at once, and the parent's board
 * goes on. A child that was forked before Open, or after Close, may open its own. */
#define _DEFAULT_SOURCE
#include "check.h"

#include <sys/wait.h>
#include <unistd.h>

static void child_with(bool a_board)
{
    int status = -1;
    pid_t child = fork();
    CHECK(child >= 0);
    if (child == 0) {
        alarm(20);
        if (a_board) {
            CHECK(!read_response());
            CHECK(!write_command());
            CHECK(!OpenECMUSB());
            CHECK(strstr(ecmsk_last_error(), "forked") != NULL);
            CloseECMUSB();
        } else {
            CHECK(OpenECMUSB());
            CHECK(read_response());
            CloseECMUSB();
        }
        exit(0);
    }
    CHECK(waitpid(child, &status, 0) == child);
    CHECK(WIFEXITED(status) && WEXITSTATUS(status) == 0);
}

int main(void)
{
    child_with(false);
    CHECK(OpenECMUSB());
    CHECK(read_response());
    child_with(true);
    CHECK(write_command());
    CHECK(read_response());
    CloseECMUSB();
    puts("ok");
    return 0;
}
