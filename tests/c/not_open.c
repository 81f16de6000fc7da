/* Reads and writes while nothing is open: false at once, no crash. */
#include "check.h"

static void nothing_works(const char *why)
{
    unsigned char buffer[512];
    CHECK(!ECMUSBRead(buffer, sizeof buffer));
    CHECK(last_error_has(why));
    CHECK(!ECMUSBWrite(buffer, sizeof buffer));
    CHECK(last_error_has(why));
    memset(buffer, 0xA5, sizeof buffer);
    CHECK(!ECMUSBRead(buffer, 0));
    CHECK(!ECMUSBWrite(buffer, 0));
    CHECK(!ECMUSBRead(NULL, 504));
    CHECK(!ECMUSBWrite(NULL, 504));
    CHECK(is_filled_with(buffer, sizeof buffer, 0xA5));
}

int main(void)
{
    CHECK(ecmsk_last_error()[0] == 0);
    nothing_works("call OpenECMUSB first");
    CloseECMUSB();
    CloseECMUSB();
    nothing_works("call OpenECMUSB first");

    CHECK(OpenECMUSB());
    CHECK(read_response());
    CloseECMUSB();
    nothing_works("call OpenECMUSB first");
    CloseECMUSB();
    nothing_works("call OpenECMUSB first");

    CHECK(OpenECMUSB());
    CHECK(read_response());
    CHECK(write_command());
    puts("ok");
    return 0;
}
