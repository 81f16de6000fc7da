/* Velocity and torque instead of positions: axis 1 in CSV, axis 2 in CST, both along ramps. Slots of 12 bytes.
 *
 * An empty FIFO repeats the last process data: an axis in CSV runs on for ever, one in CST may get faster and faster.
 * Never stop writing before velocity and torque are 0. */
#include "NEXTWUSBLib_12B.h"

#include "../cpp/ecm.h"

enum {
    AXES = 2,
    VELOCITY = 500000,    /* of axis 1, counts/s */
    VELOCITY_STEP = 2000, /* counts/s, every cycle of 1 ms */
    TORQUE = 60,          /* of axis 2, 0.1 % of rated */
    TORQUE_STEP = 2,      /* 0.1 % of rated, every cycle */
    SPEED_LIMIT = 400,    /* of axis 2, counts a cycle: at that speed the torque is taken back */
    HOLD = 200,           /* cycles at full velocity, and at full torque at most */
    BRAKE_TRIES = 2000
};

static int velocity, torque;
static int speed; /* of axis 2, counts a cycle: the mean of the last eight reports */

/* How fast axis 2 turns nobody tells: it is the change of its position. */
static void Measure(void)
{
    static int before[8], n = 0;
    int now = Position(2);
    speed = n < 8 ? 0 : (now - before[n % 8]) / 8;
    before[n % 8] = now;
    n++;
}

/* One cycle: a velocity for axis 1, a torque for axis 2. A report for each, so that the axis is watched all the time. */
static void Cycle(void)
{
    ClearCmd();
    cmdData[1].CMD = CSV;
    cmdData[1].Data1 = (unsigned)velocity;
    cmdData[2].CMD = CST;
    cmdData[2].Data1 = (unsigned)torque & 0xFFFF;
    WriteCmd();
    do {
        ReadResp();
        if (State() != STATE_OPERATIONAL)
            Fail("the network is not in OP any more");
        for (int axis = 1; axis <= AXES; axis++)
            if (HasAlarm(axis) || !IsOn(axis))
                Fail("an axis is not on any more");
        Measure();
    } while (FifoFree() < FIFO_MARK);
}

/* Towards `wanted`, a step at most. */
static int Ramp(int value, int wanted, int step)
{
    if (value < wanted)
        return value + step < wanted ? value + step : wanted;
    return value - step > wanted ? value - step : wanted;
}

static void VelocityTo(int wanted)
{
    while (velocity != wanted) {
        velocity = Ramp(velocity, wanted, VELOCITY_STEP);
        Cycle();
    }
    for (int i = 0; i < HOLD; i++)
        Cycle();
    printf("axis 1 at velocity %d: position %d\n", velocity, Position(1));
}

/* Torque until the axis is fast enough, for a while at most; then against its motion until it stands. */
static void Push(int wanted)
{
    int sign = wanted < 0 ? -1 : 1;
    int fastest = 0;
    for (int i = 0; i < HOLD && speed * sign < SPEED_LIMIT; i++) {
        torque = Ramp(torque, wanted, TORQUE_STEP);
        Cycle();
    }
    fastest = speed;
    for (int i = 0; speed * sign > 1; i++) {
        if (i == BRAKE_TRIES)
            Fail("axis 2 does not stop");
        /* The slower, the softer. */
        torque = Ramp(torque, speed * sign > 40 ? -wanted : -sign * TORQUE / 4, 4 * TORQUE_STEP);
        Cycle();
    }
    while (torque != 0) {
        torque = Ramp(torque, 0, 4 * TORQUE_STEP);
        Cycle();
    }
    printf("axis 2 pushed by %d.%d %%: %d counts/ms, stands at %d\n", wanted / 10, abs(wanted % 10), fastest, Position(2));
}

int main(void)
{
    Connect(AXES, DRIVE);
    ClearCmd();
    cmdData[1].CMD = DRIVE_MODE;
    cmdData[1].Data1 = CSV_MODE;
    cmdData[1].Data2 = DCSYNC;
    cmdData[2].CMD = DRIVE_MODE;
    cmdData[2].Data1 = CST_MODE;
    cmdData[2].Data2 = DCSYNC;
    WriteCmd();
    SetState(STATE_OPERATIONAL);

    for (int axis = 1; axis <= AXES; axis++) {
        unsigned mode = 0;
        if (!SdoRead(axis, 0x6061, 0, &mode))
            Fail("SDO_RD");
        printf("axis %d: mode of operation %u\n", axis, mode);
    }
    Servo(AXES, SV_ON);

    VelocityTo(VELOCITY);
    VelocityTo(-VELOCITY / 2);
    VelocityTo(0);
    Push(TORQUE);
    Push(-TORQUE);
    printf("commands lost: %u\n", FifoFull());

    ShutDown(AXES);
    printf("servos off, PreOP, closed\n");
    return 0;
}
