// Homing as programs for the ECM-SK do it: parameters by SDO, GO_HOME, bits 10, 12 and 13 of the statusword. Include
// ecm.h first.
#ifndef HOMING_H
#define HOMING_H

const int HOMING_TRIES = 30000; // cycles of 1 ms: how long an axis may look for its home

struct Homing {
    int method;                   // 0x6098
    unsigned switchSpeed;         // 0x6099:1, counts/s
    unsigned zeroSpeed;           // 0x6099:2, counts/s
    unsigned acceleration;        // 0x609A, counts/s^2
    int offset;                   // 0x607C: the position at home, counts
};

inline bool HomeAttained(int axis) { return (StatusWord(axis) & 0x1400) == 0x1400; }
inline bool HomeError(int axis) { return (StatusWord(axis) & 0x2000) != 0; }

// Parameters and mode 6. Then waits until the statusword is that of mode 6: bit 12 means something else in CSP.
inline void PrepareHoming(int axis, const Homing &homing)
{
    if (!SdoWrite(axis, 0x6098, 0, 1, homing.method & 0xFF) || !SdoWrite(axis, 0x6099, 1, 4, homing.switchSpeed) ||
        !SdoWrite(axis, 0x6099, 2, 4, homing.zeroSpeed) || !SdoWrite(axis, 0x609A, 0, 4, homing.acceleration) ||
        !SdoWrite(axis, 0x607C, 0, 4, (unsigned)homing.offset) || !SdoWrite(axis, 0x6060, 0, 1, HOMING_MODE))
        Fail("SDO_WR before homing");
    unsigned mode = 0;
    for (int i = 0; mode != HOMING_MODE || (StatusWord(axis) & 0x3000) != 0; i++)
        if (i == 100 || !SdoRead(axis, 0x6061, 0, &mode))
            Fail("the drive does not enter homing mode");
}

// Back to CSP, whether the board goes back by itself (firmware 1.7) or not.
inline void EndHoming(int axis)
{
    if (!SdoWrite(axis, 0x6060, 0, 1, CSP_MODE))
        Fail("SDO_WR after homing");
    unsigned mode = 0;
    for (int i = 0; mode != CSP_MODE; i++)
        if (i == 100 || !SdoRead(axis, 0x6061, 0, &mode))
            Fail("the drive does not return to CSP");
}

// Homes axes 1 to `axes` together. False if the search of one ends with an error: all searches are ended then.
inline bool Home(int axes, const Homing *homing)
{
    for (int axis = 1; axis <= axes; axis++)
        PrepareHoming(axis, homing[axis - 1]);
    // All in one frame: the board starts no homing while another one is under way.
    Command(axes, GO_HOME);

    bool attained[MAX_SLAVES + 1] = {false};
    bool error = false;
    int done = 0;
    for (int i = 0; done < axes && !error; i++) {
        ReadResp();
        for (int axis = 1; axis <= axes; axis++) {
            if (HasAlarm(axis) || IsOff(axis) || State() != STATE_OPERATIONAL)
                Fail("an axis stops during homing");
            // Once seen is enough: with its mode back in CSP the bits of an axis mean something else.
            if (!attained[axis] && HomeAttained(axis)) {
                attained[axis] = true;
                done++;
            }
            error = error || (!attained[axis] && HomeError(axis));
        }
        error = error || i == HOMING_TRIES;
    }
    if (error)
        Command(axes, ABORT_HOME);
    for (int axis = 1; axis <= axes; axis++)
        EndHoming(axis);
    return !error;
}

#endif
