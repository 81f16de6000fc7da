// What the programs in this folder have in common, in the style of the vendor's guide: one command frame, one response
// frame, and the steps of chapter 3. Include a vendor header first; C++98 is enough.
#ifndef ECM_H
#define ECM_H

#include <cstdio>
#include <cstdlib>
#include <cstring>

#ifdef _WIN32
extern "C" __declspec(dllimport) void __stdcall Sleep(unsigned long milliseconds);
inline void SleepMs(unsigned ms) { Sleep(ms); }
#else
#include <unistd.h>
inline void SleepMs(unsigned ms) { usleep(ms * 1000); }
#endif

static transData cmdData[DEF_MA_MAX];
static transData respData[DEF_MA_MAX];

const int SDO_SLOT = DEF_MA_MAX - 1;
const int MAX_SLAVES = DEF_MA_MAX - 2;
const int SLAVES_PER_GROUP = 8;
const int GROUPS = (MAX_SLAVES + SLAVES_PER_GROUP - 1) / SLAVES_PER_GROUP;

const unsigned FIFO_SIZE = 160;
// While moving, a program writes on as soon as that many entries are free: a pre-fill of ten cycles.
const unsigned FIFO_MARK = 150;
// Each costs a cycle of 1 ms: how long a program waits for a state, a drive, an SDO.
const int STATE_TRIES = 1000;
const int SERVO_TRIES = 2000;
const int SDO_TRIES = 800;

inline void Fail(const char *what)
{
    std::fprintf(stderr, "failed: %s\n", what);
    CloseECMUSB();
    std::exit(1);
}

inline void ClearCmd() { std::memset(cmdData, 0, sizeof(cmdData)); }

inline void WriteCmd()
{
    if (!ECMUSBWrite((unsigned char *)cmdData, sizeof(cmdData)))
        Fail("ECMUSBWrite");
}

inline void ReadResp()
{
    if (!ECMUSBRead((unsigned char *)respData, sizeof(respData)))
        Fail("ECMUSBRead");
}

// What the last response says. In slot 0 the upper byte of Parm is the CRC.
inline unsigned State() { return respData[0].Parm & 0xFF; }
inline unsigned FifoFree() { return respData[0].Data2 & 0xFFFF; }
inline unsigned FifoFull() { return respData[0].Data2 >> 16; }
inline unsigned StatusWord(int axis) { return respData[axis].Parm; }
inline unsigned AlarmCode(int axis) { return respData[axis].Data2 >> 16; }
inline int Position(int axis) { return (int)respData[axis].Data1; }
inline bool IsOn(int axis) { return (StatusWord(axis) & 0xFF) == 0x37; }
inline bool IsOff(int axis) { return (StatusWord(axis) & 1) == 0; }

// Read, compare, else write an all-zero frame.
inline bool WaitState(unsigned state)
{
    ClearCmd();
    for (int i = 0; i < STATE_TRIES; i++) {
        ReadResp();
        if (State() == state)
            return true;
        WriteCmd();
    }
    return false;
}

inline void SetState(unsigned state)
{
    ClearCmd();
    cmdData[0].CMD = SET_STATE;
    cmdData[0].Data1 = state;
    WriteCmd();
    if (!WaitState(state)) {
        std::fprintf(stderr, "state 0x%02X instead of 0x%02X\n", State(), state);
        Fail("SET_STATE");
    }
}

// Slaves 1 to `axes` are drives, the rest of the slots is empty.
inline void SetAxis(int axes)
{
    for (int group = 0; group < GROUPS; group++) {
        ClearCmd();
        cmdData[0].CMD = SET_AXIS;
        cmdData[0].Parm = (unsigned short)group;
        for (int i = SLAVES_PER_GROUP - 1; i >= 0; i--) {
            int slave = group * SLAVES_PER_GROUP + i + 1;
            cmdData[0].Data1 = cmdData[0].Data1 << 4 | (slave <= axes ? DRIVE : None);
        }
        WriteCmd();
        SleepMs(2);
    }
}

inline void SetDc(unsigned cycleUs)
{
    ClearCmd();
    cmdData[0].CMD = SET_DC;
    cmdData[0].Data1 = cycleUs;
    cmdData[0].Data2 = 0xFFFF;
    WriteCmd();
}

inline void DriveMode(int axes, unsigned mode)
{
    ClearCmd();
    for (int axis = 1; axis <= axes; axis++) {
        cmdData[axis].CMD = DRIVE_MODE;
        cmdData[axis].Data1 = mode;
        cmdData[axis].Data2 = DCSYNC;
    }
    WriteCmd();
}

// From OpenECMUSB to OP, with `axes` drives in CSP and a cycle of 1 ms.
inline void StartUp(int axes)
{
    if (!OpenECMUSB())
        Fail("OpenECMUSB");
    ReadResp();
    SetState(STATE_PRE_OP);
    SetAxis(axes);
    SetDc(1000);
    DriveMode(axes, CSP_MODE);
    SetState(STATE_OPERATIONAL);
}

// One command for every axis, then all-zero frames until every axis is on, or off.
inline void Servo(int axes, unsigned short command)
{
    ClearCmd();
    for (int axis = 1; axis <= axes; axis++)
        cmdData[axis].CMD = command;
    WriteCmd();
    ClearCmd();
    for (int i = 0; i < SERVO_TRIES; i++) {
        int done = 0;
        ReadResp();
        for (int axis = 1; axis <= axes; axis++) {
            if (AlarmCode(axis) != 0) {
                std::fprintf(stderr, "axis %d: alarm 0x%04X\n", axis, AlarmCode(axis));
                Fail("servo");
            }
            if (command == SV_ON ? IsOn(axis) : IsOff(axis))
                done++;
        }
        if (done == axes)
            return;
        WriteCmd();
    }
    Fail(command == SV_ON ? "SV_ON" : "SV_OFF");
}

// SDOs: the request once, then all-zero frames until the answer to it stands in the SDO slot; after 800 tries the
// request again.
inline bool Sdo(unsigned short command, unsigned short parm, unsigned object, unsigned *value)
{
    for (int attempt = 0; attempt < 3; attempt++) {
        ClearCmd();
        cmdData[SDO_SLOT].CMD = command;
        cmdData[SDO_SLOT].Parm = parm;
        cmdData[SDO_SLOT].Data1 = object;
        cmdData[SDO_SLOT].Data2 = *value;
        WriteCmd();
        ClearCmd();
        for (int i = 0; i < SDO_TRIES; i++) {
            ReadResp();
            const transData &answer = respData[SDO_SLOT];
            if ((answer.CMD & 0xFF) == command && answer.Parm == (parm & 0xFF) && answer.Data1 == object &&
                (command == SDO_RD || answer.Data2 == *value)) {
                *value = answer.Data2;
                return true;
            }
            WriteCmd();
        }
    }
    return false;
}

inline bool SdoRead(int slave, unsigned index, unsigned subindex, unsigned *value)
{
    *value = 0;
    return Sdo(SDO_RD, (unsigned short)slave, index << 16 | subindex, value);
}

inline bool SdoWrite(int slave, unsigned index, unsigned subindex, unsigned size, unsigned value)
{
    return Sdo(SDO_WR, (unsigned short)(size << 8 | (unsigned)slave), index << 16 | subindex, &value);
}

// Writes a target for every axis, and after every second frame reads until the FIFO has `mark` free entries.
inline void Csp(int axes, const int *targets, unsigned mark)
{
    static unsigned frames = 0;
    ClearCmd();
    for (int axis = 1; axis <= axes; axis++) {
        cmdData[axis].CMD = CSP;
        cmdData[axis].Data1 = (unsigned)targets[axis - 1];
    }
    WriteCmd();
    if (++frames % 2 == 0) {
        do
            ReadResp();
        while (FifoFree() < mark);
    }
}

// Lets the FIFO run empty and the axes arrive, to within `window` counts.
inline bool Settle(int axes, const int *targets, int window)
{
    for (int i = 0; i < SERVO_TRIES; i++) {
        int there = 0;
        ReadResp();
        for (int axis = 1; axis <= axes; axis++)
            if (std::abs(Position(axis) - targets[axis - 1]) <= window)
                there++;
        if (there == axes && FifoFree() == FIFO_SIZE)
            return true;
    }
    return false;
}

inline void ShutDown(int axes)
{
    Servo(axes, SV_OFF);
    SetState(STATE_PRE_OP);
    CloseECMUSB();
}

// The speed, in counts a cycle, of the next cycle on the way to a point `remaining` counts ahead: it rises and falls by
// `acceleration` a cycle and ends with 0 at the point.
inline int NextSpeed(int remaining, int speed, int limit, int acceleration)
{
    for (int next = speed + acceleration; next >= acceleration; next -= acceleration) {
        // Braking from `next`: next - a, next - 2a, ..., a.
        int braking = next / acceleration * (next - acceleration) / 2;
        if (next <= limit && next + braking <= remaining)
            return next;
    }
    return remaining;
}

#endif
