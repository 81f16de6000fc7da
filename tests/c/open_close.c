/* Open twice, close twice, open again: the board goes on, and is found again unchanged. */
#include "check.h"

int main(void)
{
    int round;

    CHECK(OpenECMUSB());
    CHECK(OpenECMUSB());
    CHECK(read_response());
    CHECK(state() == STATE_PRE_OP);
    declare_drives();
    go_to(STATE_OPERATIONAL);

    /* It goes on working: a second Open does not restart anything. */
    CHECK(OpenECMUSB());
    CHECK(read_response());
    CHECK(state() == STATE_OPERATIONAL);

    CloseECMUSB();
    CloseECMUSB();
    CHECK(!read_response());
    CHECK(OpenECMUSB());
    CHECK(read_response());
    CHECK(state() == STATE_OPERATIONAL);

    for (round = 0; round < 100; round++) {
        CloseECMUSB();
        CHECK(OpenECMUSB());
        CHECK(write_command());
        CHECK(read_response());
    }
    go_to(STATE_PRE_OP);
    puts("ok");
    return 0;
}
