/* After a failed read the buffer is as with the vendor's library: it holds the last transferred frame of either
 * direction, in the requested length, and no byte beyond is written. */
#include "check.h"

enum { FRAME = 512 };

static unsigned char last[FRAME];

/* Reads of every length fail and return the last frame. */
static void reads_leave_the_last_frame(void)
{
    static const unsigned long lengths[] = {1, 2, 3, 11, 12, 503, 504, 505, 511, 512, 513, 600, 0x7FFFFFFF};
    unsigned char buffer[FRAME + 100];
    size_t i;
    for (i = 0; i < sizeof lengths / sizeof lengths[0]; i++) {
        size_t counts = lengths[i] < FRAME ? lengths[i] : FRAME;
        memset(buffer, 0xA5, sizeof buffer);
        CHECK(!ECMUSBRead(buffer, lengths[i]));
        CHECK(memcmp(buffer, last, counts) == 0);
        CHECK(is_filled_with(buffer + counts, sizeof buffer - counts, 0xA5));
    }
    /* No buffer, no frame. */
    memset(buffer, 0xA5, sizeof buffer);
    CHECK(!ECMUSBRead(buffer, 0));
    CHECK(is_filled_with(buffer, sizeof buffer, 0xA5));
    CHECK(!ECMUSBRead(NULL, FRAME));
}

static bool writes(unsigned char with, unsigned long length)
{
    unsigned char frame[FRAME];
    memset(frame, 0, sizeof frame);
    /* The command of slot 1 and the bytes after the slots: without a meaning. */
    memset(frame + 16, with, 8);
    memset(frame + 504, with, 8);
    memcpy(last, frame, length);
    memset(last + length, 0, FRAME - length);
    return ECMUSBWrite(frame, length);
}

static void reads(void)
{
    CHECK(ECMUSBRead(last, sizeof last));
}

int main(void)
{
    int tries;

    /* No frame was transferred: 0. */
    reads_leave_the_last_frame();
    CHECK(OpenECMUSB());
    CloseECMUSB();
    reads_leave_the_last_frame();

    /* Written last. */
    CHECK(OpenECMUSB());
    reads();
    CHECK(writes(0x11, 512));
    CloseECMUSB();
    reads_leave_the_last_frame();
    CHECK(OpenECMUSB());
    CHECK(writes(0x12, 504));
    CloseECMUSB();
    reads_leave_the_last_frame();

    /* Read last. */
    CHECK(OpenECMUSB());
    CHECK(writes(0x13, 512));
    reads();
    CloseECMUSB();
    reads_leave_the_last_frame();

    /* A write that fails counts, too. */
    CHECK(!writes(0x14, 512));
    reads_leave_the_last_frame();
    CHECK(!ECMUSBWrite(NULL, FRAME));
    CHECK(!ECMUSBWrite(last, 0));
    reads_leave_the_last_frame();

    /* The board is lost: a program that checks the state byte instead of the result does not see OP forever. */
    CHECK(OpenECMUSB());
    declare_drives();
    go_to(STATE_OPERATIONAL);
    CHECK(master(SW_RESET, 0, 0, 0));
    memcpy(last, command, sizeof command);
    memset(last + sizeof command, 0, FRAME - sizeof command);
    for (tries = 0; tries < 2000; tries++) {
        unsigned char report[FRAME];
        if (!ECMUSBRead(report, sizeof report)) {
            break;
        }
        memcpy(last, report, sizeof last);
    }
    CHECK(tries < 2000);
    reads_leave_the_last_frame();
    CHECK(!master(GET_STATUS, 0, 0, 0));
    response[0].Parm = STATE_OPERATIONAL;
    CHECK(!read_response());
    CHECK(state() == 0);
    puts("ok");
    return 0;
}
