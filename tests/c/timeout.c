/* With `read_timeout_ms` a read returns false after that time, with the last transferred frame. The cycle is half a
 * second, the limit shorter. */
#include "check.h"

int main(void)
{
    unsigned char buffer[512], last[512];
    int reports = 0, timeouts = 0, reads;

    CHECK(OpenECMUSB());
    CHECK(master(SET_DC, 0, 512000, 0xFFFF));
    declare_drives();
    CHECK(master(SET_STATE, 0, STATE_OPERATIONAL, 0));
    for (reads = 0; state() != STATE_OPERATIONAL; reads++) {
        CHECK(reads < 20000);
        read_response();
    }
    while (reports < 2) {
        memset(buffer, 0xA5, sizeof buffer);
        if (ECMUSBRead(buffer, sizeof buffer)) {
            reports++;
            CHECK(buffer[2] == STATE_OPERATIONAL);
            memcpy(last, buffer, sizeof last);
        } else {
            timeouts++;
            CHECK(last_error_has("timed out"));
            CHECK(reports == 0 || memcmp(buffer, last, sizeof last) == 0);
        }
    }
    CHECK(timeouts > 0);
    puts("ok");
    return 0;
}
