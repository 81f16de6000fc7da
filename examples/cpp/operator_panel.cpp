// An operator's panel for two axes: on, off, jog, home, alarms. A program with a window has a timer that calls Tick and
// buttons that call Press; here a list of presses stands for the operator, and lines of text for the lamps.
#include "NEXTWUSBLib_12B.h"

#include "ecm.h"
#include "homing.h"

const int AXES = 2;
const int TICK_CYCLES = 20;  // a timer of 20 ms, at a cycle of 1 ms
const int JOG_SPEED = 400;   // counts a cycle
const int ACCELERATION = 4;  // counts a cycle, every cycle
const int MAX_ALARMS = 16;

static const Homing HOMING[AXES] = {{28, 200000, 20000, 10000000, 0}, {28, 200000, 20000, 10000000, 0}};

enum Button { SERVO_ON, SERVO_OFF, JOG_PLUS, JOG_MINUS, JOG_RELEASE, GO_HOME_ALL, ABORT, RESET };
static const char *const NAMES[] = {"on", "off", "jog +", "jog -", "jog released", "home", "abort", "reset"};
enum Mode { OFF, READY, SEARCHING, ALARM };

static Mode mode = OFF;
static int wanted[AXES], speed[AXES], target[AXES]; // wanted: speed that the jog buttons ask for
static bool attained[AXES], homed = false;

struct Alarm {
    int tick, axis;
    unsigned code;
};
static Alarm alarms[MAX_ALARMS];
static int alarmCount = 0;
static int now = 0; // ticks since the panel is open

static bool Stands() { return speed[0] == 0 && speed[1] == 0; }

// Targets begin where the axes are.
static void TakePositions()
{
    for (int i = 0; i < AXES; i++) {
        target[i] = Position(i + 1);
        speed[i] = wanted[i] = 0;
    }
}

static void EndSearch(Mode next)
{
    for (int axis = 1; axis <= AXES; axis++)
        EndHoming(axis);
    TakePositions();
    mode = next;
}

static void Press(Button button, int axis)
{
    bool allowed = true;
    if (button == SERVO_ON && mode == OFF)
        Command(AXES, SV_ON);
    else if (button == SERVO_OFF && (mode == OFF || (mode == READY && Stands()))) {
        Command(AXES, SV_OFF);
        mode = OFF;
    } else if ((button == JOG_PLUS || button == JOG_MINUS) && mode == READY)
        wanted[axis - 1] = button == JOG_PLUS ? JOG_SPEED : -JOG_SPEED;
    else if (button == JOG_RELEASE)
        wanted[axis - 1] = 0;
    else if (button == GO_HOME_ALL && mode == READY && Stands()) {
        homed = false;
        for (int i = 0; i < AXES; i++) {
            PrepareHoming(i + 1, HOMING[i]);
            attained[i] = false;
        }
        Command(AXES, GO_HOME);
        mode = SEARCHING;
    } else if (button == ABORT && mode == SEARCHING) {
        Command(AXES, ABORT_HOME);
        EndSearch(READY);
    } else if (button == RESET && mode == ALARM)
        Command(AXES, ALM_CLR);
    else
        allowed = false;
    std::printf("%4d  %s", now, NAMES[button]);
    if (axis > 0)
        std::printf(", axis %d", axis);
    std::printf(allowed ? "\n" : ": not now\n");
}

// What the last report says.
static void Look()
{
    int on = 0, found = 0;
    bool alarm = false, error = false;
    for (int i = 0; i < AXES; i++) {
        on += IsOn(i + 1);
        alarm = alarm || HasAlarm(i + 1);
        if (mode == SEARCHING) {
            attained[i] = attained[i] || HomeAttained(i + 1);
            error = error || (!attained[i] && HomeError(i + 1));
            found += attained[i];
        }
        if (HasAlarm(i + 1) && mode != ALARM && alarmCount < MAX_ALARMS) {
            Alarm entry = {now, i + 1, AlarmCode(i + 1)};
            alarms[alarmCount++] = entry;
        }
    }
    if (State() != STATE_OPERATIONAL)
        Fail("the network is not in OP any more");
    if (mode == SEARCHING && (alarm || error || on < AXES)) {
        Command(AXES, ABORT_HOME);
        EndSearch(alarm ? ALARM : READY);
    } else if (mode == SEARCHING && found == AXES) {
        homed = true;
        EndSearch(READY);
    } else if (mode != ALARM && alarm) {
        wanted[0] = wanted[1] = 0;
        mode = ALARM;
    } else if (mode == ALARM && !alarm && Stands())
        mode = OFF;
    else if (mode == READY && on < AXES)
        mode = OFF;
    else if (mode == OFF && on == AXES) {
        TakePositions();
        mode = READY;
    }
}

// One cycle of axes that are on: speeds follow the buttons by a ramp. An axis with an alarm keeps where it is.
static void Move()
{
    for (int i = 0; i < AXES; i++) {
        if (HasAlarm(i + 1)) {
            speed[i] = 0;
            target[i] = Position(i + 1);
        } else if (speed[i] < wanted[i])
            speed[i] += ACCELERATION;
        else if (speed[i] > wanted[i])
            speed[i] -= ACCELERATION;
        target[i] += speed[i];
    }
    Csp(AXES, target, FIFO_MARK);
}

static void ShowLamps()
{
    static const char *const TEXTS[] = {"off", "on", "searching home", "ALARM"};
    static int shown = -1;
    int lamps = mode | (homed ? 4 : 0) | (Stands() ? 0 : 8);
    if (lamps != shown)
        std::printf("%4d  [%s%s%s]  %d, %d\n", now, TEXTS[mode], homed ? ", homed" : "", Stands() ? "" : ", moving",
                    Position(1), Position(2));
    shown = lamps;
}

static void Tick()
{
    for (int cycle = 0; cycle < TICK_CYCLES; cycle++) {
        if (mode == READY || !Stands())
            Move();
        else
            ReadResp();
        Look();
    }
    ShowLamps();
    now++;
}

struct Pressed {
    int tick;
    Button button;
    int axis;
};

int main()
{
    static const Pressed OPERATOR[] = {
        {0, JOG_PLUS, 1},   {1, SERVO_ON, 0},    {6, JOG_PLUS, 1},      {14, JOG_RELEASE, 1}, {22, JOG_MINUS, 1},
        {24, JOG_PLUS, 2},  {45, JOG_PLUS, 1},   {50, RESET, 0},        {60, SERVO_ON, 0},    {70, GO_HOME_ALL, 0},
        {72, JOG_PLUS, 1},  {73, ABORT, 0},      {80, GO_HOME_ALL, 0},  {140, JOG_MINUS, 2},  {150, JOG_RELEASE, 2},
        {160, SERVO_OFF, 0},
    };
    const int presses = sizeof(OPERATOR) / sizeof(OPERATOR[0]);

    StartUp(AXES);
    for (int next = 0; now < 180;) {
        for (; next < presses && OPERATOR[next].tick == now; next++)
            Press(OPERATOR[next].button, OPERATOR[next].axis);
        Tick();
    }

    std::printf("alarms: %d\n", alarmCount);
    for (int i = 0; i < alarmCount; i++)
        std::printf("  tick %d: axis %d, 0x%04X\n", alarms[i].tick, alarms[i].axis, alarms[i].code);
    StopAll();
    CloseECMUSB();
    std::printf("panel closed, servos off, PreOP\n");
    return 0;
}
