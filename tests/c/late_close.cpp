// A program whose global object closes the board in its destructor, as many do: that runs after the library's own end of
// the process, and finds a board that is closed.
#include "NEXTWUSBLib_12B.h"

#include <cstdio>
#include <cstdlib>

static unsigned char frame[504];

struct Machine {
    Machine() {}
    ~Machine()
    {
        if (ECMUSBWrite(frame, sizeof frame) || ECMUSBRead(frame, sizeof frame)) {
            std::puts("a board after the end");
            std::_Exit(1);
        }
        CloseECMUSB();
        std::puts("ok");
        std::fflush(stdout);
    }
};

static Machine machine;

int main()
{
    return OpenECMUSB() && ECMUSBRead(frame, sizeof frame) && ECMUSBWrite(frame, sizeof frame) ? 0 : 1;
}
