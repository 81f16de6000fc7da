// One axis moves: servo on, then a target for every cycle, from where the axis is.
#include "NEXTWUSBLib_12B.h"

#include "../cpp/ecm.h"

int main()
{
    StartUp(1);
    Servo(1, SV_ON);

    int target[1] = {Position(1)};
    int remaining = 50000, speed = 0; // counts, counts a cycle
    while (remaining > 0) {
        speed = NextSpeed(remaining, speed, 500, 5);
        remaining -= speed;
        target[0] += speed;
        // Two frames, then responses until 150 entries of the FIFO are free again.
        Csp(1, target, FIFO_MARK);
    }
    if (!Settle(1, target, 10))
        Fail("the axis does not arrive");
    std::printf("arrived at %d, commands lost: %u\n", target[0], FifoFull());
    ShutDown(1);
    return 0;
}
