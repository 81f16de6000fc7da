// A habit of programs: one thread reads all the time, another one writes. The writer waits for a new response, then
// writes one frame, or two while the FIFO has many free entries.
#include "NEXTWUSBLib_12B.h"

#include "ecm.h"

#include <atomic>
#include <condition_variable>
#include <mutex>
#include <thread>

const int AXES = 1;
const int FRAMES = 2000;
const int COUNTS_A_FRAME = 50;
const int WINDOW = 100; // counts

static std::mutex guard;
static std::condition_variable news;
static bool fresh = false;
static unsigned free_entries = FIFO_SIZE;
static std::atomic<bool> stop(false);

// respData is this thread's alone while it runs, cmdData the writer's.
static void Reader()
{
    while (!stop) {
        ReadResp();
        std::lock_guard<std::mutex> lock(guard);
        fresh = true;
        free_entries = FifoFree();
        news.notify_one();
    }
}

int main()
{
    StartUp(AXES);
    Servo(AXES, SV_ON);
    const int start = Position(1);
    int target[AXES] = {start};

    std::thread reader(Reader);
    ClearCmd();
    cmdData[1].CMD = CSP;
    int frame = 0;
    while (frame < FRAMES) {
        int burst;
        {
            std::unique_lock<std::mutex> lock(guard);
            while (!fresh)
                news.wait(lock);
            fresh = false;
            burst = free_entries > FIFO_MARK ? 2 : 1;
        }
        for (; burst > 0 && frame < FRAMES; burst--, frame++) {
            target[0] += COUNTS_A_FRAME;
            cmdData[1].Data1 = (unsigned)target[0];
            WriteCmd();
        }
    }
    stop = true;
    reader.join();

    if (!Settle(AXES, target, WINDOW))
        Fail("the axis does not arrive");
    std::printf("moved by %d, commands lost: %u\n", target[0] - start, FifoFull());
    ShutDown(AXES);
    return 0;
}
