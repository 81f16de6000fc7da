// Two axes are homed and go round a square. A drive has an alarm on the way: the program notices, brakes the other axis,
// clears the alarm, switches on again and goes on. An alarm that stays is told, and everything is switched off.
#include "NEXTWUSBLib_12B.h"

#include "ecm.h"
#include "homing.h"

const int AXES = 2;
const int SIDE = 1000000;     // counts
const int SPEED_LIMIT = 2500; // counts a cycle of 1 ms
const int ACCELERATION = 20;  // counts a cycle, every cycle
const int WINDOW = 100;       // counts
const int CLEAR_TRIES = 3;
const int CLEAR_CYCLES = 300; // how long a drive may take for ALM_CLR

static int target[AXES], speed[AXES];

// Both axes by their negative limit switches, which are 0.
static const Homing HOMING[AXES] = {{17, 1500000, 100000, 40000000, 0}, {17, 1200000, 100000, 40000000, 0}};

static bool AnyAlarm()
{
    for (int axis = 1; axis <= AXES; axis++)
        if (HasAlarm(axis))
            return true;
    return false;
}

// Moves both axes to a point, each as fast as it may. False: a drive has an alarm, and the axes are on their way.
static bool GoTo(const int *goal)
{
    while (target[0] != goal[0] || target[1] != goal[1]) {
        for (int i = 0; i < AXES; i++) {
            int direction = goal[i] < target[i] ? -1 : 1;
            int magnitude = NextSpeed(std::abs(goal[i] - target[i]), std::abs(speed[i]), SPEED_LIMIT, ACCELERATION);
            speed[i] = direction * magnitude;
            target[i] += speed[i];
        }
        Csp(AXES, target, FIFO_MARK);
        if (AnyAlarm())
            return false;
    }
    speed[0] = speed[1] = 0;
    if (!Settle(AXES, target, WINDOW) && !AnyAlarm())
        Fail("an axis does not arrive");
    return !AnyAlarm();
}

// The drive with the alarm brakes by itself, and its target goes with it. The other axis is braked here.
static void Brake()
{
    while (speed[0] != 0 || speed[1] != 0) {
        for (int i = 0; i < AXES; i++) {
            if (HasAlarm(i + 1)) {
                speed[i] = 0;
                target[i] = Position(i + 1);
                continue;
            }
            int slower = std::abs(speed[i]) > ACCELERATION ? std::abs(speed[i]) - ACCELERATION : 0;
            speed[i] = speed[i] < 0 ? -slower : slower;
            target[i] += speed[i];
        }
        Csp(AXES, target, FIFO_MARK);
    }
    do
        ReadResp();
    while (State() == STATE_OPERATIONAL && FifoFree() < FIFO_SIZE);
}

// ALM_CLR until no drive has an alarm any more. False: one keeps it.
static bool ClearAlarms()
{
    for (int attempt = 0; attempt < CLEAR_TRIES; attempt++) {
        Command(AXES, ALM_CLR);
        for (int i = 0; i < CLEAR_CYCLES; i++) {
            ReadResp();
            if (!AnyAlarm())
                return true;
        }
    }
    return false;
}

static bool Recover()
{
    Brake();
    for (int axis = 1; axis <= AXES; axis++)
        if (HasAlarm(axis))
            std::printf("  axis %d: alarm 0x%04X, stopped at %d, %d\n", axis, AlarmCode(axis), Position(1), Position(2));
    if (!ClearAlarms())
        return false;
    Servo(AXES, SV_ON);
    for (int i = 0; i < AXES; i++)
        target[i] = Position(i + 1);
    std::printf("  cleared, on again\n");
    std::fflush(stdout);
    return true;
}

int main()
{
    static const int path[][AXES] = {{0, 0}, {SIDE, 0}, {SIDE, SIDE}, {0, SIDE}, {0, 0}};

    StartUp(AXES);
    Servo(AXES, SV_ON);
    std::printf("two axes on, at %d, %d\n", Position(1), Position(2));
    std::fflush(stdout);
    if (!Home(AXES, HOMING))
        Fail("homing");
    for (int i = 0; i < AXES; i++)
        target[i] = Position(i + 1);
    std::printf("home found, at %d, %d\n", target[0], target[1]);
    std::fflush(stdout);

    for (int corner = 0; corner < 5; corner++) {
        while (!GoTo(path[corner])) {
            if (!Recover()) {
                for (int axis = 1; axis <= AXES; axis++)
                    if (HasAlarm(axis))
                        std::printf("axis %d keeps alarm 0x%04X after %d ALM_CLR: look into the drive's manual\n", axis,
                                    AlarmCode(axis), CLEAR_TRIES);
                StopAll();
                CloseECMUSB();
                std::printf("servos off, PreOP, closed; the path is not done\n");
                return 1;
            }
        }
        std::printf("corner %d of the square: at %d, %d\n", corner % 4 + 1, target[0], target[1]);
        std::fflush(stdout);
    }
    std::printf("commands lost: %u\n", FifoFull());

    ShutDown(AXES);
    std::printf("servos off, PreOP, closed\n");
    return 0;
}
