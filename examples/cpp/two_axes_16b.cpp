// Two axes on a circle: start-up, SDOs, servo on, a path by CSP, servo off. Slots of 16 bytes.
#include "NEXTWUSBLib_16B.h"

#include "ecm.h"

const int AXES = 2;
const int RADIUS = 60000;         // counts
const int STEPS = 8 * RADIUS;     // single counts, along x or y, of one turn
const int SPEED_LIMIT = 1500;     // steps a cycle of 1 ms
const int ACCELERATION = 30;      // steps a cycle, every cycle
const int WINDOW = 100;           // counts

// A point on the circle around 0, 0, and how far it is off it: x * x + y * y - RADIUS * RADIUS.
struct Point {
    int x, y, off;
};

// One count further, counter-clockwise: along x or along y, whatever stays closer to the circle.
static void Step(Point *point)
{
    int dx = point->y > 0 ? -1 : point->y < 0 ? 1 : 0;
    int dy = point->x > 0 ? 1 : point->x < 0 ? -1 : 0;
    int offX = point->off + 2 * point->x * dx + 1;
    int offY = point->off + 2 * point->y * dy + 1;
    if (dx != 0 && (dy == 0 || std::abs(offX) < std::abs(offY))) {
        point->x += dx;
        point->off = offX;
    } else {
        point->y += dy;
        point->off = offY;
    }
}

int main()
{
    StartUp(AXES);
    std::printf("OP with %d axes, FIFO free %u\n", AXES, FifoFree());

    for (int slave = 1; slave <= AXES; slave++) {
        unsigned deviceType = 0, mode = 0;
        if (!SdoRead(slave, 0x1000, 0, &deviceType) || !SdoRead(slave, 0x6061, 0, &mode))
            Fail("SDO_RD");
        std::printf("slave %d: device type 0x%08X, mode of operation %u\n", slave, deviceType, mode);
    }

    Servo(AXES, SV_ON);
    int centre[AXES], target[AXES];
    for (int axis = 0; axis < AXES; axis++) {
        target[axis] = Position(axis + 1);
        centre[axis] = target[axis];
        std::printf("axis %d on, statusword ..%02X, position %d\n", axis + 1, StatusWord(axis + 1) & 0xFF, target[axis]);
    }
    centre[0] -= RADIUS;

    Point point = {RADIUS, 0, 0};
    int done = 0, speed = 0, cycles = 0, quarter = 0;
    while (done < STEPS) {
        speed = NextSpeed(STEPS - done, speed, SPEED_LIMIT, ACCELERATION);
        for (int i = 0; i < speed; i++)
            Step(&point);
        done += speed;
        target[0] = centre[0] + point.x;
        target[1] = centre[1] + point.y;
        Csp(AXES, target, FIFO_MARK);
        cycles++;
        if (done >= (quarter + 1) * (STEPS / 4)) {
            quarter++;
            std::printf("quarter %d: target %d, %d after %d cycles\n", quarter, target[0], target[1], cycles);
            std::fflush(stdout);
        }
    }
    if (!Settle(AXES, target, WINDOW))
        Fail("an axis does not arrive");
    std::printf("circle closed at %d, %d; commands lost: %u\n", target[0], target[1], FifoFull());

    ShutDown(AXES);
    std::printf("servos off, PreOP, closed\n");
    return 0;
}
