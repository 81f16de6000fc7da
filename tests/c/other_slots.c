/* A program of 12-byte slots, to be run on a board of 16-byte ones. */
#include "check.h"

int main(void)
{
    int i;
    CHECK(OpenECMUSB());
    for (i = 0; i < 3; i++) {
        CHECK(write_command());
        CHECK(read_response());
    }
    CloseECMUSB();
    puts("ok");
    return 0;
}
