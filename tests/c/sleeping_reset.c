/* Resets the board, sleeps as long as it takes to start up, and opens it once. */
#include "check.h"

#include <unistd.h>

int main(void)
{
    CHECK(OpenECMUSB());
    declare_drives();
    go_to(STATE_OPERATIONAL);
    CHECK(master(SW_RESET, 0, 0, 0));
    CHECK(!read_response());
    CloseECMUSB();
    sleep(3);
    CHECK(OpenECMUSB());
    CHECK(read_response());
    CHECK(state() == STATE_PRE_OP);
    CloseECMUSB();
    puts("ok");
    return 0;
}
