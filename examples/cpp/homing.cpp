// Homing: axis 1 by its home switch and index pulse, axis 2 by its limit switch; then a move by CSP; then a homing that
// fails, because the drive does not know the method. Slots of 12 bytes.
#include "NEXTWUSBLib_12B.h"

#include "ecm.h"
#include "homing.h"

const int AXES = 2;
const int WINDOW = 100; // counts

static const Homing HOMING[AXES] = {
    // By the home switch, its edge on the positive side, and the index pulse before it.
    {7, 300000, 30000, 10000000, 0},
    // By the negative limit switch; the switch shall be at -20000.
    {17, 1500000, 50000, 10000000, -20000},
};
// There is no method 36.
static const Homing UNKNOWN[AXES] = {{36, 300000, 30000, 10000000, 0}, {36, 300000, 30000, 10000000, 0}};

static void Print(const char *what)
{
    std::printf("%s: axis 1 at %d, axis 2 at %d\n", what, Position(1), Position(2));
    std::fflush(stdout);
}

// Both axes to 0, 0, by CSP. Homing has moved the coordinates: a target starts at the position of now.
static void GoToZero()
{
    int target[AXES], speed[AXES] = {0, 0};
    ReadResp();
    for (int axis = 0; axis < AXES; axis++)
        target[axis] = Position(axis + 1);
    while (target[0] != 0 || target[1] != 0) {
        for (int axis = 0; axis < AXES; axis++) {
            int direction = target[axis] > 0 ? -1 : 1;
            speed[axis] = NextSpeed(std::abs(target[axis]), speed[axis], 500, 10);
            target[axis] += direction * speed[axis];
        }
        Csp(AXES, target, FIFO_MARK);
        for (int axis = 1; axis <= AXES; axis++)
            if (HasAlarm(axis))
                Fail("an axis has an alarm");
    }
    if (!Settle(AXES, target, WINDOW))
        Fail("an axis does not arrive");
}

int main()
{
    StartUp(AXES);
    Servo(AXES, SV_ON);
    Print("on");

    if (!Home(AXES, HOMING))
        Fail("homing");
    Print("home found");
    GoToZero();
    std::printf("both axes at 0 by CSP\n");

    if (Home(AXES, UNKNOWN))
        Fail("a drive homes by a method that there is not");
    std::printf("homing error (bit 13), homing ended by ABORT_HOME\n");
    // Where home is stays as it was, and the axes can be moved as before.
    GoToZero();
    std::printf("both axes still know where 0 is; commands lost: %u\n", FifoFull());

    ShutDown(AXES);
    std::printf("servos off, PreOP, closed\n");
    return 0;
}
