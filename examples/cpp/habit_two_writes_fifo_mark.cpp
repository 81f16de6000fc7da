// A habit of programs: a thread of its own that writes two frames, then reads until the FIFO has 150 free entries while
// there is something to move, or all 160 when idle, over and over.
#include "NEXTWUSBLib_12B.h"

#include "ecm.h"

#include <atomic>
#include <thread>

const int AXES = 1;
const int DISTANCE = 300000;  // counts
const int SPEED_LIMIT = 1000; // counts a cycle of 1 ms
const int ACCELERATION = 20;  // counts a cycle, every cycle
const int WINDOW = 100;       // counts

static std::atomic<bool> idle(false);
static std::atomic<bool> stop(false);
static int target[AXES];
static unsigned lowest_free = FIFO_SIZE;
static int frames = 0;

static void WriteFrame(bool moving)
{
    ClearCmd();
    if (moving) {
        cmdData[1].CMD = CSP;
        cmdData[1].Data1 = (unsigned)target[0];
    }
    WriteCmd();
    frames++;
}

static void Exchange()
{
    int remaining = DISTANCE;
    int speed = 0;
    while (!stop) {
        bool moving = remaining > 0;
        for (int i = 0; i < 2; i++) {
            if (remaining > 0) {
                speed = NextSpeed(remaining, speed, SPEED_LIMIT, ACCELERATION);
                remaining -= speed;
                target[0] += speed;
            }
            WriteFrame(moving);
        }
        do {
            ReadResp();
            if (FifoFree() < lowest_free)
                lowest_free = FifoFree();
        } while (FifoFree() < (moving ? FIFO_MARK : FIFO_SIZE));
        idle = !moving && std::abs(Position(1) - target[0]) <= WINDOW;
    }
}

int main()
{
    StartUp(AXES);
    Servo(AXES, SV_ON);
    target[0] = Position(1);

    std::thread exchange(Exchange);
    while (!idle)
        SleepMs(1);
    stop = true;
    exchange.join();

    std::printf("moved to %d, commands lost: %u\n", target[0], FifoFull());
    std::printf("FIFO kept above %u: %s\n", FIFO_MARK - 20, lowest_free > FIFO_MARK - 20 ? "yes" : "no");
    ShutDown(AXES);
    return 0;
}
