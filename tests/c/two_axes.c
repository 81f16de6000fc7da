/* Two axes on a straight path by CSP, as programs do it: two frames, then reads until the FIFO has room again. */
#include "check.h"

#define AXES 2
#define STEPS 500

static unsigned fifo_free(void) { return response[0].Data2 & 0xFFFF; }

static bool all_on(void)
{
    int axis;
    for (axis = 1; axis <= AXES; axis++) {
        if ((response[axis].Parm & 0xFF) != 0x37) {
            return false;
        }
    }
    return true;
}

static void command_all(unsigned short id)
{
    int axis;
    memset(command, 0, sizeof command);
    for (axis = 1; axis <= AXES; axis++) {
        command[axis].CMD = id;
    }
}

int main(void)
{
    static const int end[AXES] = {100000, -50000};
    int step, axis, reads;

    CHECK(OpenECMUSB());
    declare_drives();
    go_to(STATE_OPERATIONAL);

    command_all(SV_ON);
    CHECK(write_command());
    for (reads = 0; reads < 5000 && !all_on(); reads++) {
        CHECK(read_response());
    }
    CHECK(all_on());

    for (step = 1; step <= STEPS; step++) {
        command_all(CSP);
        for (axis = 0; axis < AXES; axis++) {
            command[axis + 1].Data1 = (unsigned)(end[axis] / STEPS * step);
        }
        CHECK(write_command());
        if (step % 2 == 0) {
            do {
                CHECK(read_response());
            } while (fifo_free() <= 150);
        }
    }
    for (reads = 0; reads < 5000 && (int)response[1].Data1 != end[0]; reads++) {
        CHECK(read_response());
    }
    CHECK((int)response[1].Data1 == end[0]);

    CloseECMUSB();
    puts("ok");
    return 0;
}
