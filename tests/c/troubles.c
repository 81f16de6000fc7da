/* Failures in a program's run: inputs that change, a following error, a homing error, a lost slave. The program does
 * not know of the script. */
#include "check.h"

static void until(bool (*holds)(void))
{
    int reads;
    for (reads = 0; reads < 30000; reads++) {
        CHECK(read_response());
        if (holds()) {
            return;
        }
    }
    CHECK(!"it never came");
}

static void slave_command(int slave, unsigned short id, int data1)
{
    memset(command, 0, sizeof command);
    command[slave].CMD = id;
    command[slave].Data1 = (unsigned)data1;
    CHECK(write_command());
}

static bool input_is_on(void) { return (response[3].Data1 & 0xFFFF) != 0; }
static bool input_is_off(void) { return (response[3].Data1 & 0xFFFF) == 0; }
static bool first_is_on(void) { return (response[1].Parm & 0x6F) == 0x27; }
static bool second_is_on(void) { return (response[2].Parm & 0x6F) == 0x27; }
static bool in_fault(void) { return (response[1].Parm & 0x4F) == 0x08; }
static bool no_fault(void) { return (response[1].Parm & 0x4F) == 0x40; }
static bool homing_error(void) { return (response[2].Parm & 0x2000) != 0; }
static bool homing_failed_is_past(void) { return (response[2].Parm & 0x2000) == 0; }
static bool failed(void) { return (state() & 0x10) != 0; }
static bool in_op(void) { return state() == STATE_OPERATIONAL; }
static bool sdo_done(void) { return (response[DEF_MA_MAX - 1].CMD & 0xFF) == SDO_WR; }

static void write_byte(unsigned slave, unsigned index, unsigned value)
{
    memset(command, 0, sizeof command);
    command[DEF_MA_MAX - 1].CMD = SDO_WR;
    command[DEF_MA_MAX - 1].Parm = (unsigned short)(slave | 1 << 8);
    command[DEF_MA_MAX - 1].Data1 = index << 16;
    command[DEF_MA_MAX - 1].Data2 = value;
    CHECK(write_command());
    until(sdo_done);
}

int main(void)
{
    int target;
    CHECK(OpenECMUSB());
    /* Two drives and an IO slave. */
    CHECK(master(SET_AXIS, 0, 0xFFFFF100, 0));
    go_to(STATE_OPERATIONAL);
    slave_command(1, SV_ON, 0);
    until(first_is_on);
    slave_command(2, SV_ON, 0);
    until(second_is_on);

    slave_command(3, IO_RD, 0);
    until(input_is_on);
    printf("inputs %04X\n", (unsigned)(response[3].Data1 & 0xFFFF));
    until(input_is_off);
    printf("inputs %04X\n", (unsigned)(response[3].Data1 & 0xFFFF));

    for (target = (int)response[1].Data1; (response[1].Data2 >> 16) == 0; target += 500) {
        slave_command(1, CSP, target);
        CHECK(read_response());
    }
    CHECK(response[1].Data2 >> 16 == 0x8611);
    puts("following error");
    until(in_fault);
    slave_command(1, ALM_CLR, 0);
    until(no_fault);
    slave_command(1, SV_ON, 0);
    until(first_is_on);
    puts("on again");

    write_byte(2, 0x6060, HOMING_MODE);
    write_byte(2, 0x6098, 17);
    {
        int reads;
        for (reads = 0; reads < 5000; reads++) {
            CHECK(read_response());
        }
    }
    slave_command(2, GO_HOME, 0);
    until(homing_error);
    puts("homing error");
    until(homing_failed_is_past);

    until(failed);
    puts("lost");
    {
        int reads;
        for (reads = 0; reads < 1500; reads++) {
            CHECK(read_response());
        }
    }
    CHECK(master(SET_STATE, 0, STATE_OPERATIONAL, 0));
    until(in_op);
    slave_command(2, SV_ON, 0);
    until(second_is_on);
    puts("back");
    CloseECMUSB();
    return 0;
}
