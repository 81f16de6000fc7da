/* A program that exchanges frames in OP until its board is lost: a read ends, and so does each call after it. */
#include "check.h"

int main(void)
{
    int i;

    CHECK(OpenECMUSB());
    CHECK(master(SET_AXIS, 0, 0xFFFFFFF0, 0));
    go_to(STATE_OPERATIONAL);
    puts("running");
    fflush(stdout);
    while (read_response()) {
    }
    CHECK(last_error_has("was pulled, or deleted") && last_error_has("ip link"));
    memset(command, 0, sizeof command);
    for (i = 0; i < 3; i++) {
        CHECK(!write_command() && last_error_has("is gone"));
        CHECK(!read_response() && last_error_has("is gone"));
    }
    CloseECMUSB();
    puts("ok");
    return 0;
}
