// Two axes on a square: start-up, SDOs, servo on, a path by CSP, servo off. Slots of 12 bytes.
#include "NEXTWUSBLib_12B.h"

#include "ecm.h"

const int AXES = 2;
const int SIDE = 400000;      // counts
const int SPEED_LIMIT = 2000; // counts a cycle of 1 ms
const int ACCELERATION = 40;  // counts a cycle, every cycle
const int WINDOW = 100;       // counts

static int target[AXES];

// Moves one axis by `distance` counts, faster and slower at a constant acceleration. The other one stands.
static int MoveBy(int axis, int distance)
{
    int direction = distance < 0 ? -1 : 1;
    int remaining = distance * direction;
    int speed = 0;
    int cycles = 0;
    while (remaining > 0) {
        speed = NextSpeed(remaining, speed, SPEED_LIMIT, ACCELERATION);
        remaining -= speed;
        target[axis] += direction * speed;
        Csp(AXES, target, FIFO_MARK);
        cycles++;
    }
    return cycles;
}

int main()
{
    static const int path[][2] = {{0, SIDE}, {1, SIDE}, {0, -SIDE}, {1, -SIDE}};

    StartUp(AXES);
    std::printf("OP with %d axes, FIFO free %u\n", AXES, FifoFree());

    for (int slave = 1; slave <= AXES; slave++) {
        unsigned deviceType = 0, mode = 0;
        if (!SdoRead(slave, 0x1000, 0, &deviceType) || !SdoRead(slave, 0x6061, 0, &mode))
            Fail("SDO_RD");
        // Deceleration of a quick stop, as an example of a parameter.
        if (!SdoWrite(slave, 0x6085, 0, 4, 20000000))
            Fail("SDO_WR");
        std::printf("slave %d: device type 0x%08X, mode of operation %u\n", slave, deviceType, mode);
    }

    Servo(AXES, SV_ON);
    for (int axis = 1; axis <= AXES; axis++) {
        target[axis - 1] = Position(axis);
        std::printf("axis %d on, statusword ..%02X, position %d\n", axis, StatusWord(axis) & 0xFF, Position(axis));
    }

    int cycles = 0;
    for (int i = 0; i < 4; i++) {
        cycles += MoveBy(path[i][0], path[i][1]);
        if (!Settle(AXES, target, WINDOW))
            Fail("an axis does not arrive");
        std::printf("side %d: at %d, %d after %d cycles\n", i + 1, target[0], target[1], cycles);
        std::fflush(stdout);
    }
    std::printf("commands lost: %u\n", FifoFull());

    ShutDown(AXES);
    std::printf("servos off, PreOP, closed\n");
    return 0;
}
