// A pulse module (HSP) of two channels: both are moved by CSP, with outputs at places along the way, and its inputs are
// read. One slave, one slot, two axes: that takes slots of 16 bytes.
#include "NEXTWUSBLib_16B.h"

#include "ecm.h"

const int SLAVE = 1;
const int DISTANCE[2] = {100000, -60000}; // pulses
const int SPEED_LIMIT = 200;              // pulses a cycle of 1 ms: 200 kHz
const int ACCELERATION = 2;               // pulses a cycle, every cycle
const unsigned VALVE[2] = {0x0001, 0x0100}; // outputs that are on in the middle half of the way

// Both channels in one slot. Seen as bytes: 4..7 target 1, 8..9 outputs 1, 10..13 target 2, 14..15 outputs 2. Target 2 lies
// across two fields of transData: its lower half in the upper half of Data2, its upper half in the lower half of Data3.
static void PutCsp(const int *target, const unsigned *outputs)
{
    unsigned second = (unsigned)target[1];
    cmdData[SLAVE].CMD = CSP;
    cmdData[SLAVE].Data1 = (unsigned)target[0];
    cmdData[SLAVE].Data2 = (outputs[0] & 0xFFFF) | second << 16;
    cmdData[SLAVE].Data3 = second >> 16 | outputs[1] << 16;
}

// The response has position and inputs in the same places.
static int PositionOf(int channel)
{
    const transData &slot = respData[SLAVE];
    return (int)(channel == 0 ? slot.Data1 : slot.Data2 >> 16 | slot.Data3 << 16);
}

static unsigned InputsOf(int channel)
{
    return channel == 0 ? respData[SLAVE].Data2 & 0xFFFF : respData[SLAVE].Data3 >> 16;
}

// Moves both channels by their distances, forth or back, and tells when inputs change.
static void Move(int *target, int sign)
{
    int start[2] = {target[0], target[1]}, speed[2] = {0, 0};
    unsigned inputs[2] = {InputsOf(0), InputsOf(1)};
    bool moves = true;
    while (moves) {
        unsigned outputs[2];
        moves = false;
        for (int i = 0; i < 2; i++) {
            int way = sign * DISTANCE[i];
            int done = std::abs(target[i] - start[i]);
            speed[i] = NextSpeed(std::abs(way) - done, speed[i], SPEED_LIMIT, ACCELERATION);
            target[i] += way < 0 ? -speed[i] : speed[i];
            moves = moves || target[i] != start[i] + way;
            outputs[i] = 4 * done > std::abs(way) && 4 * done < 3 * std::abs(way) ? VALVE[i] : 0;
        }
        ClearCmd();
        PutCsp(target, outputs);
        WritePaced(FIFO_MARK);
        // The slot has the statusword of channel 1 only.
        if (HasAlarm(SLAVE) || !IsOn(SLAVE))
            Fail("the module is not on any more");
        for (int i = 0; i < 2; i++) {
            if (InputsOf(i) != inputs[i])
                std::printf("  channel %d at %d: inputs 0x%04X\n", i + 1, PositionOf(i), InputsOf(i));
            inputs[i] = InputsOf(i);
        }
    }
    // The last targets wait in the FIFO. Pulses follow at once.
    for (int i = 0; PositionOf(0) != target[0] || PositionOf(1) != target[1]; i++) {
        ReadResp();
        if (i == SERVO_TRIES)
            Fail("a channel does not arrive");
    }
    std::printf("channels at %d, %d\n", PositionOf(0), PositionOf(1));
}

int main()
{
    Connect(1, HSP);
    DriveMode(1, CSP_MODE);
    SetState(STATE_OPERATIONAL);
    Servo(1, SV_ON);
    std::printf("OP, both channels on, at %d, %d\n", PositionOf(0), PositionOf(1));

    int target[2] = {PositionOf(0), PositionOf(1)};
    Move(target, 1);
    Move(target, -1);

    // The objects of channel 2 are those of channel 1 plus 0x800.
    unsigned position[2];
    if (!SdoRead(SLAVE, 0x6064, 0, &position[0]) || !SdoRead(SLAVE, 0x6864, 0, &position[1]))
        Fail("SDO_RD");
    std::printf("0x6064: %d, 0x6864: %d; commands lost: %u\n", (int)position[0], (int)position[1], FifoFull());

    ShutDown(1);
    std::printf("both channels off, PreOP, closed\n");
    return 0;
}
