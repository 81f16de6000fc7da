/* SW_RESET drops the connection: every call returns false until Open, which needs no Close before it. */
#include "check.h"

int main(void)
{
    unsigned char buffer[512];
    int tries;

    CHECK(OpenECMUSB());
    declare_drives();
    go_to(STATE_OPERATIONAL);
    CHECK(master(SW_RESET, 0, 0, 0));
    for (tries = 0; tries < 2000 && ECMUSBRead(buffer, sizeof buffer); tries++) {
    }
    CHECK(tries < 2000);
    CHECK(last_error_has("open it again"));
    CHECK(!write_command());
    CHECK(!ECMUSBRead(buffer, sizeof buffer));

    for (tries = 0; !OpenECMUSB(); tries++) {
        CHECK(tries < 1000000);
    }
    CHECK(read_response());
    CHECK(state() == STATE_PRE_OP);
    declare_drives();
    go_to(STATE_OPERATIONAL);

    /* The same without a single call between the reset and Open. */
    CHECK(master(SW_RESET, 0, 0, 0));
    for (tries = 0; tries < 1000000; tries++) {
        if (OpenECMUSB() && read_response() && state() == STATE_PRE_OP) {
            break;
        }
    }
    CHECK(tries < 1000000);
    CHECK(write_command());
    puts("ok");
    return 0;
}
