// An operator's panel for two axes: on, off, jog, home, alarms. In a program with windows `Tick` is the Tick event of a timer
// and `Press` the Click event of buttons; here a list of presses stands for the operator, and lines of text for the lamps.
using System;
using System.Collections.Generic;
using NEXTWUSB_dotNET;

enum Button { ServoOn, ServoOff, JogPlus, JogMinus, JogRelease, GoHome, Abort, Reset }

class Panel
{
    const int AXES = 2;
    const int TICK_CYCLES = 20;  // a timer of 20 ms, at a cycle of 1 ms
    const int JOG_SPEED = 400;   // counts a cycle
    const int ACCELERATION = 4;  // counts a cycle, every cycle

    enum Mode { Off, Ready, Searching, Alarm }

    struct Alarm
    {
        public int Tick, Axis, Code;
    }

    static readonly string[] NAMES = { "on", "off", "jog +", "jog -", "jog released", "home", "abort", "reset" };
    static readonly string[] LAMPS = { "off", "on", "searching home", "ALARM" };

    readonly Homing homing = new Homing { Method = 28, SwitchSpeed = 200000, ZeroSpeed = 20000, Acceleration = 10000000, Offset = 0 };
    readonly int[] wanted = new int[AXES]; // speed that the jog buttons ask for
    readonly int[] speed = new int[AXES];
    readonly int[] target = new int[AXES];
    readonly bool[] attained = new bool[AXES];
    readonly List<Alarm> alarms = new List<Alarm>();
    Mode mode = Mode.Off;
    bool homed = false;
    int shown = -1;

    // Ticks since the panel is open.
    public int Now { get; private set; }

    public void Open()
    {
        Ecm.StartUp(AXES);
    }

    public void Close()
    {
        Console.WriteLine("alarms: {0}", alarms.Count);
        foreach (Alarm alarm in alarms)
            Console.WriteLine("  tick {0}: axis {1}, 0x{2:X4}", alarm.Tick, alarm.Axis, alarm.Code);
        Ecm.StopAll();
        NEXTWUSB.CloseECMUSB();
        Console.WriteLine("panel closed, servos off, PreOP");
    }

    bool Stands { get { return speed[0] == 0 && speed[1] == 0; } }

    // Targets begin where the axes are.
    void TakePositions()
    {
        for (int i = 0; i < AXES; i++)
        {
            target[i] = Ecm.Position(i + 1);
            speed[i] = wanted[i] = 0;
        }
    }

    void EndSearch(Mode next)
    {
        for (int axis = 1; axis <= AXES; axis++)
            Homing.End(axis);
        TakePositions();
        mode = next;
    }

    // Whether the button may be pressed now; if so, what it does.
    bool Do(Button button, int axis)
    {
        if (button == Button.ServoOn && mode == Mode.Off)
            Ecm.Command(AXES, NEXTWUSB.SV_ON);
        else if (button == Button.ServoOff && (mode == Mode.Off || (mode == Mode.Ready && Stands)))
        {
            Ecm.Command(AXES, NEXTWUSB.SV_OFF);
            mode = Mode.Off;
        }
        else if ((button == Button.JogPlus || button == Button.JogMinus) && mode == Mode.Ready)
            wanted[axis - 1] = button == Button.JogPlus ? JOG_SPEED : -JOG_SPEED;
        else if (button == Button.JogRelease)
            wanted[axis - 1] = 0;
        else if (button == Button.GoHome && mode == Mode.Ready && Stands)
        {
            homed = false;
            for (int i = 0; i < AXES; i++)
            {
                homing.Prepare(i + 1);
                attained[i] = false;
            }
            Ecm.Command(AXES, NEXTWUSB.GO_HOME);
            mode = Mode.Searching;
        }
        else if (button == Button.Abort && mode == Mode.Searching)
        {
            Ecm.Command(AXES, NEXTWUSB.ABORT_HOME);
            EndSearch(Mode.Ready);
        }
        else if (button == Button.Reset && mode == Mode.Alarm)
            Ecm.Command(AXES, NEXTWUSB.ALM_CLR);
        else
            return false;
        return true;
    }

    public void Press(Button button, int axis)
    {
        bool allowed = Do(button, axis);
        string of = axis > 0 ? ", axis " + axis : "";
        Console.WriteLine("{0,4}  {1}{2}{3}", Now, NAMES[(int)button], of, allowed ? "" : ": not now");
    }

    // What the last report says.
    void Look()
    {
        int on = 0, found = 0;
        bool alarm = false, error = false;
        for (int i = 0; i < AXES; i++)
        {
            int axis = i + 1;
            if (Ecm.IsOn(axis))
                on++;
            alarm |= Ecm.HasAlarm(axis);
            if (mode == Mode.Searching)
            {
                attained[i] |= Homing.Attained(axis);
                error |= !attained[i] && Homing.Error(axis);
                if (attained[i])
                    found++;
            }
            if (Ecm.HasAlarm(axis) && mode != Mode.Alarm)
                alarms.Add(new Alarm { Tick = Now, Axis = axis, Code = Ecm.AlarmCode(axis) });
        }
        if (Ecm.State() != NEXTWUSB.STATE_OPERATIONAL)
            throw new Failure("the network is not in OP any more");
        if (mode == Mode.Searching && (alarm || error || on < AXES))
        {
            Ecm.Command(AXES, NEXTWUSB.ABORT_HOME);
            EndSearch(alarm ? Mode.Alarm : Mode.Ready);
        }
        else if (mode == Mode.Searching && found == AXES)
        {
            homed = true;
            EndSearch(Mode.Ready);
        }
        else if (mode != Mode.Alarm && alarm)
        {
            wanted[0] = wanted[1] = 0;
            mode = Mode.Alarm;
        }
        else if (mode == Mode.Alarm && !alarm && Stands)
            mode = Mode.Off;
        else if (mode == Mode.Ready && on < AXES)
            mode = Mode.Off;
        else if (mode == Mode.Off && on == AXES)
        {
            TakePositions();
            mode = Mode.Ready;
        }
    }

    // One cycle of axes that are on: speeds follow the buttons by a ramp. An axis with an alarm keeps where it is.
    void Move()
    {
        for (int i = 0; i < AXES; i++)
        {
            if (Ecm.HasAlarm(i + 1))
            {
                speed[i] = 0;
                target[i] = Ecm.Position(i + 1);
            }
            else if (speed[i] < wanted[i])
                speed[i] += ACCELERATION;
            else if (speed[i] > wanted[i])
                speed[i] -= ACCELERATION;
            target[i] += speed[i];
        }
        Ecm.Csp(target, Ecm.FIFO_MARK);
    }

    void ShowLamps()
    {
        int lamps = (int)mode | (homed ? 4 : 0) | (Stands ? 0 : 8);
        if (lamps != shown)
            Console.WriteLine("{0,4}  [{1}{2}{3}]  {4}, {5}", Now, LAMPS[(int)mode], homed ? ", homed" : "",
                Stands ? "" : ", moving", Ecm.Position(1), Ecm.Position(2));
        shown = lamps;
    }

    public void Tick()
    {
        for (int cycle = 0; cycle < TICK_CYCLES; cycle++)
        {
            if (mode == Mode.Ready || !Stands)
                Move();
            else
                Ecm.ReadResp();
            Look();
        }
        ShowLamps();
        Now++;
    }
}

static class Program
{
    struct Pressed
    {
        public readonly int Tick, Axis;
        public readonly Button Button;

        public Pressed(int tick, Button button, int axis)
        {
            Tick = tick;
            Button = button;
            Axis = axis;
        }
    }

    static readonly Pressed[] OPERATOR = {
        new Pressed(0, Button.JogPlus, 1), new Pressed(1, Button.ServoOn, 0), new Pressed(6, Button.JogPlus, 1),
        new Pressed(14, Button.JogRelease, 1), new Pressed(22, Button.JogMinus, 1), new Pressed(24, Button.JogPlus, 2),
        new Pressed(45, Button.JogPlus, 1), new Pressed(50, Button.Reset, 0), new Pressed(60, Button.ServoOn, 0),
        new Pressed(70, Button.GoHome, 0), new Pressed(72, Button.JogPlus, 1), new Pressed(73, Button.Abort, 0),
        new Pressed(80, Button.GoHome, 0), new Pressed(140, Button.JogMinus, 2), new Pressed(150, Button.JogRelease, 2),
        new Pressed(160, Button.ServoOff, 0),
    };

    static int Main()
    {
        return Ecm.Run(() =>
        {
            var panel = new Panel();
            panel.Open();
            int next = 0;
            while (panel.Now < 180)
            {
                for (; next < OPERATOR.Length && OPERATOR[next].Tick == panel.Now; next++)
                    panel.Press(OPERATOR[next].Button, OPERATOR[next].Axis);
                panel.Tick();
            }
            panel.Close();
        });
    }
}
