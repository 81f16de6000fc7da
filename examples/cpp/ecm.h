// What the programs of examples/cpp and examples/c have in common, in the style of the vendor's guide: one command frame,
// one response frame, and the steps of chapter 3. Include a vendor header first; C99 or C++98 is enough.
#ifndef ECM_H
#define ECM_H

#ifdef __cplusplus
#include <cstdio>
#include <cstdlib>
#include <cstring>
#elif !defined(_POSIX_C_SOURCE)
#define _POSIX_C_SOURCE 199309L // nanosleep
#endif
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifdef _WIN32
#ifdef __cplusplus
extern "C"
#endif
__declspec(dllimport) void __stdcall Sleep(unsigned long milliseconds);
static inline void SleepMs(unsigned ms) { Sleep(ms); }
#else
#include <time.h>
static inline void SleepMs(unsigned ms)
{
    struct timespec time;
    time.tv_sec = ms / 1000;
    time.tv_nsec = (long)(ms % 1000) * 1000000;
    nanosleep(&time, NULL);
}
#endif

static transData cmdData[DEF_MA_MAX];
static transData respData[DEF_MA_MAX];

enum {
    SDO_SLOT = DEF_MA_MAX - 1,
    MAX_SLAVES = DEF_MA_MAX - 2,
    SLAVES_PER_GROUP = 8,
    GROUPS = (MAX_SLAVES + SLAVES_PER_GROUP - 1) / SLAVES_PER_GROUP,

    FIFO_SIZE = 160,
    // While moving, a program writes on as soon as that many entries are free: a pre-fill of ten cycles.
    FIFO_MARK = 150,
    // Each costs a cycle of 1 ms: how long a program waits for a state, a drive, an SDO.
    STATE_TRIES = 1000,
    SERVO_TRIES = 2000,
    SDO_TRIES = 800
};

// The network as SetAxis told it: slaves 1 to `slaves`, all of one kind.
static int slaves = 0;
static unsigned slaveKind = None;

static inline void ClearCmd(void) { memset(cmdData, 0, sizeof(cmdData)); }

// What the last response says. In slot 0 the upper byte of Parm is the CRC.
static inline unsigned State(void) { return respData[0].Parm & 0xFF; }
static inline unsigned FifoFree(void) { return respData[0].Data2 & 0xFFFF; }
static inline unsigned FifoFull(void) { return respData[0].Data2 >> 16; }
static inline unsigned StatusWord(int axis) { return respData[axis].Parm; }
static inline int Position(int axis) { return (int)respData[axis].Data1; }
static inline bool IsOn(int axis) { return (StatusWord(axis) & 0xFF) == 0x37; }
static inline bool IsOff(int axis) { return (StatusWord(axis) & 1) == 0; }
static inline unsigned AlarmCode(int axis) { return respData[axis].Data2 >> 16; }
// By the alarm code, which an HSP has not, or by bit 3 of the statusword, Fault: a drive may give up one before the other.
static inline bool HasAlarm(int axis)
{
    return (StatusWord(axis) & 0x08) != 0 || (slaveKind != HSP && AlarmCode(axis) != 0);
}

// Stops all there is, whatever happened before: drops what waits in the FIFO, switches axes off (a drive brakes as its
// parameters say) and outputs too, and leaves OP. Used on the way out of an error, so it asks nothing of the board.
static inline void StopAll(void)
{
    ClearCmd();
    cmdData[0].CMD = SET_FIFO;
    cmdData[0].Parm = 1;
    for (int slave = 1; slave <= slaves; slave++)
        cmdData[slave].CMD = slaveKind == IO ? IO_WR : SV_OFF;
    bool alive = ECMUSBWrite((unsigned char *)cmdData, sizeof(cmdData));
    for (int i = 0; alive && i < SERVO_TRIES; i++) {
        int off = 0;
        alive = ECMUSBRead((unsigned char *)respData, sizeof(respData));
        for (int slave = 1; slave <= slaves; slave++)
            if (slaveKind == IO || IsOff(slave))
                off++;
        // Some cycles at least, so that the frame has been executed. 0x18 is OP with a slave that is lost.
        if ((off == slaves && i >= 10) || (State() & 0x0F) != STATE_OPERATIONAL)
            break;
    }
    ClearCmd();
    cmdData[0].CMD = SET_STATE;
    cmdData[0].Data1 = STATE_PRE_OP;
    alive = alive && ECMUSBWrite((unsigned char *)cmdData, sizeof(cmdData));
    for (int i = 0; alive && i < STATE_TRIES && State() != STATE_PRE_OP; i++)
        alive = ECMUSBRead((unsigned char *)respData, sizeof(respData));
}

static inline void Fail(const char *what)
{
    fprintf(stderr, "failed: %s\n", what);
    StopAll();
    CloseECMUSB();
    exit(1);
}

static inline void WriteCmd(void)
{
    if (!ECMUSBWrite((unsigned char *)cmdData, sizeof(cmdData)))
        Fail("ECMUSBWrite");
}

static inline void ReadResp(void)
{
    if (!ECMUSBRead((unsigned char *)respData, sizeof(respData)))
        Fail("ECMUSBRead");
}

// Read, compare, else write an all-zero frame.
static inline bool WaitState(unsigned state)
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

static inline void SetState(unsigned state)
{
    ClearCmd();
    cmdData[0].CMD = SET_STATE;
    cmdData[0].Data1 = state;
    WriteCmd();
    if (!WaitState(state)) {
        fprintf(stderr, "state 0x%02X instead of 0x%02X\n", State(), state);
        Fail("SET_STATE");
    }
}

// Slaves 1 to `count` are of that kind, the rest of the slots is empty.
static inline void SetAxis(int count, unsigned kind)
{
    slaves = count;
    slaveKind = kind;
    for (int group = 0; group < GROUPS; group++) {
        ClearCmd();
        cmdData[0].CMD = SET_AXIS;
        cmdData[0].Parm = (unsigned short)group;
        for (int i = SLAVES_PER_GROUP - 1; i >= 0; i--) {
            int slave = group * SLAVES_PER_GROUP + i + 1;
            cmdData[0].Data1 = cmdData[0].Data1 << 4 | (slave <= count ? kind : None);
        }
        WriteCmd();
        SleepMs(2);
    }
}

static inline void SetDc(unsigned cycleUs)
{
    ClearCmd();
    cmdData[0].CMD = SET_DC;
    cmdData[0].Data1 = cycleUs;
    cmdData[0].Data2 = 0xFFFF;
    WriteCmd();
}

static inline void DriveMode(int axes, unsigned mode)
{
    ClearCmd();
    for (int axis = 1; axis <= axes; axis++) {
        cmdData[axis].CMD = DRIVE_MODE;
        cmdData[axis].Data1 = mode;
        cmdData[axis].Data2 = DCSYNC;
    }
    WriteCmd();
}

// From OpenECMUSB to PreOP, with the slaves told and a cycle of 1 ms.
static inline void Connect(int count, unsigned kind)
{
    if (!OpenECMUSB())
        Fail("OpenECMUSB");
    ReadResp();
    SetState(STATE_PRE_OP);
    SetAxis(count, kind);
    SetDc(1000);
}

// From OpenECMUSB to OP, with `axes` drives in CSP.
static inline void StartUp(int axes)
{
    Connect(axes, DRIVE);
    DriveMode(axes, CSP_MODE);
    SetState(STATE_OPERATIONAL);
}

// One command for every axis.
static inline void Command(int axes, unsigned short command)
{
    ClearCmd();
    for (int axis = 1; axis <= axes; axis++)
        cmdData[axis].CMD = command;
    WriteCmd();
    ClearCmd();
}

// SV_ON or SV_OFF for every axis, then all-zero frames until every axis is on, or off.
static inline void Servo(int axes, unsigned short command)
{
    Command(axes, command);
    for (int i = 0; i < SERVO_TRIES; i++) {
        int done = 0;
        ReadResp();
        for (int axis = 1; axis <= axes; axis++) {
            if (HasAlarm(axis)) {
                fprintf(stderr, "axis %d: alarm 0x%04X\n", axis, AlarmCode(axis));
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
static inline bool Sdo(unsigned short command, unsigned short parm, unsigned object, unsigned *value)
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
            transData answer = respData[SDO_SLOT];
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

static inline bool SdoRead(int slave, unsigned index, unsigned subindex, unsigned *value)
{
    *value = 0;
    return Sdo(SDO_RD, (unsigned short)slave, index << 16 | subindex, value);
}

static inline bool SdoWrite(int slave, unsigned index, unsigned subindex, unsigned size, unsigned value)
{
    return Sdo(SDO_WR, (unsigned short)(size << 8 | (unsigned)slave), index << 16 | subindex, &value);
}

// Writes the frame in cmdData, and after every second frame reads until the FIFO has `mark` free entries.
static inline void WritePaced(unsigned mark)
{
    static unsigned frames = 0;
    WriteCmd();
    if (++frames % 2 == 0) {
        do {
            ReadResp();
            if (State() != STATE_OPERATIONAL)
                Fail("the network is not in OP any more");
        } while (FifoFree() < mark);
    }
}

// Writes a target for every axis, at the pace of the FIFO.
static inline void Csp(int axes, const int *targets, unsigned mark)
{
    ClearCmd();
    for (int axis = 1; axis <= axes; axis++) {
        cmdData[axis].CMD = CSP;
        cmdData[axis].Data1 = (unsigned)targets[axis - 1];
    }
    WritePaced(mark);
}

// Lets the FIFO run empty and the axes arrive, to within `window` counts.
static inline bool Settle(int axes, const int *targets, int window)
{
    for (int i = 0; i < SERVO_TRIES; i++) {
        int there = 0;
        ReadResp();
        for (int axis = 1; axis <= axes; axis++)
            if (abs(Position(axis) - targets[axis - 1]) <= window)
                there++;
        if (there == axes && FifoFree() == FIFO_SIZE)
            return true;
    }
    return false;
}

static inline void ShutDown(int axes)
{
    Servo(axes, SV_OFF);
    SetState(STATE_PRE_OP);
    CloseECMUSB();
}

// The speed, in counts a cycle, of the next cycle on the way to a point `remaining` counts ahead: it rises and falls by
// `acceleration` a cycle and ends with 0 at the point.
static inline int NextSpeed(int remaining, int speed, int limit, int acceleration)
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
