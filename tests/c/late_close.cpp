// A program whose global object brings the machine to rest and closes the board in its destructor, as many do. It is
// made before the board is opened. With an argument it forgets to close.
#include "NEXTWUSBLib_12B.h"

#include <cstdio>
#include <cstdlib>

static unsigned char frame[504];
static bool forgetful;

struct Machine {
    Machine() {}
    ~Machine()
    {
        for (int i = 0; i < 20; i++) {
            if (!ECMUSBWrite(frame, sizeof frame) || !ECMUSBRead(frame, sizeof frame)) {
                std::puts("no board at the end");
                std::_Exit(1);
            }
        }
        if (!forgetful) {
            CloseECMUSB();
        }
        std::puts("ok");
        std::fflush(stdout);
    }
};

static Machine machine;

int main(int count, char **)
{
    forgetful = count > 1;
    return OpenECMUSB() && ECMUSBRead(frame, sizeof frame) && ECMUSBWrite(frame, sizeof frame) ? 0 : 1;
}
