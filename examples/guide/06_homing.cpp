// Two axes look for their home at the same time, then they go to 0.
#include "NEXTWUSBLib_12B.h"

#include "../cpp/ecm.h"
#include "../cpp/homing.h"

int main()
{
    StartUp(2);
    Servo(2, SV_ON);

    // Method 17: the negative limit switch; 1 the same and then the index pulse. Speeds in counts/s.
    static const Homing homing[2] = {{17, 100000, 20000, 2000000, 0}, {1, 100000, 20000, 2000000, 0}};
    if (!Home(2, homing))
        Fail("no home");
    std::printf("both axes are home\n");

    // From where they stand, slowly: a first target far away would be a jump.
    int target[2] = {Position(1), Position(2)};
    while (target[0] != 0 || target[1] != 0) {
        for (int i = 0; i < 2; i++)
            target[i] -= target[i] > 20 ? 20 : target[i] < -20 ? -20 : target[i];
        Csp(2, target, FIFO_MARK);
    }
    if (!Settle(2, target, 10))
        Fail("an axis does not arrive");
    std::printf("both axes are at 0\n");
    ShutDown(2);
    return 0;
}
