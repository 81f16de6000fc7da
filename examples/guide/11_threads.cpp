// One thread writes, another one reads: each array belongs to one of them alone.
#include "NEXTWUSBLib_12B.h"

#include "../cpp/ecm.h"

#include <atomic>
#include <thread>

static std::atomic<unsigned> freeEntries(FIFO_SIZE);
static std::atomic<int> position(0);
static std::atomic<bool> stop(false);

// respData is this thread's while it runs.
static void Reader()
{
    while (!stop) {
        ReadResp();
        freeEntries = FifoFree();
        position = Position(1);
    }
}

int main()
{
    StartUp(1);
    Servo(1, SV_ON);
    int target[1] = {Position(1)};
    const int end = target[0] + 20000;
    std::thread reader(Reader);
    ClearCmd();
    while (target[0] < end) {
        if (freeEntries < FIFO_MARK) {
            std::this_thread::yield();
            continue;
        }
        target[0] += 10;
        cmdData[1].CMD = CSP;
        cmdData[1].Data1 = (unsigned)target[0];
        WriteCmd();
        freeEntries--;
    }
    stop = true;
    reader.join();
    if (!Settle(1, target, 100))
        Fail("the axis does not arrive");
    std::printf("arrived, commands lost: %u\n", FifoFull());
    ShutDown(1);
    return 0;
}
