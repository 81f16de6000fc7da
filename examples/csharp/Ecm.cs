// What the programs of this folder have in common: the steps of chapter 3 of the vendor's guide on cmdData and respData.
using System;
using System.Threading;
#if SLOTS_OF_16_BYTES
using NEXTWUSB_dotNET_16B;
#else
using NEXTWUSB_dotNET;
#endif

// Why a program ends early.
class Failure : Exception
{
    public Failure(string what) : base(what) { }
}

static class Ecm
{
    public const int SDO_SLOT = NEXTWUSB.DEF_MA_MAX - 1;
    public const int MAX_SLAVES = NEXTWUSB.DEF_MA_MAX - 2;
    const int SLAVES_PER_GROUP = 8;
    const int GROUPS = (MAX_SLAVES + SLAVES_PER_GROUP - 1) / SLAVES_PER_GROUP;

    public const int FIFO_SIZE = 160;
    // While moving, a program writes on as soon as that many entries are free: a pre-fill of ten cycles.
    public const int FIFO_MARK = 150;
    // Each costs a cycle of 1 ms: how long a program waits for a state, a drive, an SDO.
    const int STATE_TRIES = 1000;
    const int SERVO_TRIES = 2000;
    const int SDO_TRIES = 800;

    // Slaves 1 to `slaves` of the network, all of them drives.
    static int slaves = 0;
    static int frames = 0;

    // What the last response says. In slot 0 the upper byte of Parm is the CRC.
    public static int State() { return NEXTWUSB.respData[0].Parm & 0xFF; }
    public static int FifoFree() { return (int)(NEXTWUSB.respData[0].Data2 & 0xFFFF); }
    public static int FifoFull() { return (int)(NEXTWUSB.respData[0].Data2 >> 16); }
    public static int StatusWord(int axis) { return NEXTWUSB.respData[axis].Parm; }
    public static int Position(int axis) { return unchecked((int)NEXTWUSB.respData[axis].Data1); }
    public static bool IsOn(int axis) { return (StatusWord(axis) & 0xFF) == 0x37; }
    public static bool IsOff(int axis) { return (StatusWord(axis) & 1) == 0; }
    public static int AlarmCode(int axis) { return (int)(NEXTWUSB.respData[axis].Data2 >> 16); }
    // By the alarm code or by bit 3 of the statusword, Fault: a drive may give up one before the other.
    public static bool HasAlarm(int axis) { return (StatusWord(axis) & 0x08) != 0 || AlarmCode(axis) != 0; }

    // Runs a program. However it ends, the axes are off and the network is in PreOP then.
    public static int Run(Action program)
    {
        try
        {
            return Stopped(program);
        }
        catch (DllNotFoundException missing)
        {
            Console.Error.WriteLine("failed: " + missing.Message);
            return 1;
        }
    }

    static int Stopped(Action program)
    {
        try
        {
            program();
            return 0;
        }
        catch (Failure failure)
        {
            Console.Error.WriteLine("failed: " + failure.Message);
            StopAll();
            return 1;
        }
        finally
        {
            NEXTWUSB.CloseECMUSB();
        }
    }

    // Stops all there is, whatever happened before: drops what waits in the FIFO, switches axes off (a drive brakes as its
    // parameters say), and leaves OP. Used on the way out of an error, so it asks nothing of the board.
    public static void StopAll()
    {
        NEXTWUSB.ClearCmdData();
        NEXTWUSB.cmdData[0].CMD = NEXTWUSB.SET_FIFO;
        NEXTWUSB.cmdData[0].Parm = 1;
        for (int slave = 1; slave <= slaves; slave++)
            NEXTWUSB.cmdData[slave].CMD = NEXTWUSB.SV_OFF;
        bool alive = NEXTWUSB.ECMUSBWrite();
        for (int i = 0; alive && i < SERVO_TRIES; i++)
        {
            int off = 0;
            alive = NEXTWUSB.ECMUSBRead();
            for (int slave = 1; slave <= slaves; slave++)
                if (IsOff(slave))
                    off++;
            // Some cycles at least, so that the frame has been executed. 0x18 is OP with a slave that is lost.
            if ((off == slaves && i >= 10) || (State() & 0x0F) != NEXTWUSB.STATE_OPERATIONAL)
                break;
        }
        NEXTWUSB.ClearCmdData();
        NEXTWUSB.cmdData[0].CMD = NEXTWUSB.SET_STATE;
        NEXTWUSB.cmdData[0].Data1 = NEXTWUSB.STATE_PRE_OP;
        alive = alive && NEXTWUSB.ECMUSBWrite();
        for (int i = 0; alive && i < STATE_TRIES && State() != NEXTWUSB.STATE_PRE_OP; i++)
            alive = NEXTWUSB.ECMUSBRead();
    }

    public static void WriteCmd()
    {
        if (!NEXTWUSB.ECMUSBWrite())
            throw new Failure("ECMUSBWrite: " + NEXTWUSBDiagnostics.LastError);
    }

    public static void ReadResp()
    {
        if (!NEXTWUSB.ECMUSBRead())
            throw new Failure("ECMUSBRead: " + NEXTWUSBDiagnostics.LastError);
    }

    public static void SetState(int state)
    {
        NEXTWUSB.ClearCmdData();
        NEXTWUSB.cmdData[0].CMD = NEXTWUSB.SET_STATE;
        NEXTWUSB.cmdData[0].Data1 = (uint)state;
        WriteCmd();
        // Read, compare, else write an all-zero frame.
        NEXTWUSB.ClearCmdData();
        for (int i = 0; i < STATE_TRIES; i++)
        {
            ReadResp();
            if (State() == state)
                return;
            WriteCmd();
        }
        throw new Failure(string.Format("SET_STATE: state 0x{0:X2} instead of 0x{1:X2}", State(), state));
    }

    // Slaves 1 to `count` are drives, the rest of the slots is empty.
    static void SetAxis(int count)
    {
        slaves = count;
        for (int group = 0; group < GROUPS; group++)
        {
            NEXTWUSB.ClearCmdData();
            NEXTWUSB.cmdData[0].CMD = NEXTWUSB.SET_AXIS;
            NEXTWUSB.cmdData[0].Parm = (ushort)group;
            uint kinds = 0;
            for (int i = SLAVES_PER_GROUP - 1; i >= 0; i--)
                kinds = kinds << 4 | (ushort)(group * SLAVES_PER_GROUP + i + 1 <= count ? NEXTWUSB.DRIVE : NEXTWUSB.None);
            NEXTWUSB.cmdData[0].Data1 = kinds;
            WriteCmd();
            Thread.Sleep(2);
        }
    }

    // From OpenECMUSB to OP, with `axes` drives in CSP and a cycle of 1 ms.
    public static void StartUp(int axes)
    {
        if (!NEXTWUSB.OpenECMUSB())
            throw new Failure("OpenECMUSB: " + NEXTWUSBDiagnostics.LastError);
        ReadResp();
        SetState(NEXTWUSB.STATE_PRE_OP);
        SetAxis(axes);
        NEXTWUSB.ClearCmdData();
        NEXTWUSB.cmdData[0].CMD = NEXTWUSB.SET_DC;
        NEXTWUSB.cmdData[0].Data1 = 1000;
        NEXTWUSB.cmdData[0].Data2 = 0xFFFF;
        WriteCmd();
        NEXTWUSB.ClearCmdData();
        for (int axis = 1; axis <= axes; axis++)
        {
            NEXTWUSB.cmdData[axis].CMD = NEXTWUSB.DRIVE_MODE;
            NEXTWUSB.cmdData[axis].Data1 = NEXTWUSB.CSP_MODE;
            NEXTWUSB.cmdData[axis].Data2 = NEXTWUSB.DCSYNC;
        }
        WriteCmd();
        SetState(NEXTWUSB.STATE_OPERATIONAL);
    }

    // One command for every axis.
    public static void Command(int axes, ushort command)
    {
        NEXTWUSB.ClearCmdData();
        for (int axis = 1; axis <= axes; axis++)
            NEXTWUSB.cmdData[axis].CMD = command;
        WriteCmd();
        NEXTWUSB.ClearCmdData();
    }

    // SV_ON or SV_OFF for every axis, then all-zero frames until every axis is on, or off.
    public static void Servo(int axes, ushort command)
    {
        Command(axes, command);
        for (int i = 0; i < SERVO_TRIES; i++)
        {
            int done = 0;
            ReadResp();
            for (int axis = 1; axis <= axes; axis++)
            {
                if (HasAlarm(axis))
                    throw new Failure(string.Format("servo: axis {0}: alarm 0x{1:X4}", axis, AlarmCode(axis)));
                if (command == NEXTWUSB.SV_ON ? IsOn(axis) : IsOff(axis))
                    done++;
            }
            if (done == axes)
                return;
            WriteCmd();
        }
        throw new Failure(command == NEXTWUSB.SV_ON ? "SV_ON" : "SV_OFF");
    }

    // SDOs: the request once, then all-zero frames until the answer to it stands in the SDO slot; after 800 tries the
    // request again.
    static uint Sdo(ushort command, ushort parm, uint index, uint subindex, uint value)
    {
        uint address = index << 16 | subindex;
        for (int attempt = 0; attempt < 3; attempt++)
        {
            NEXTWUSB.ClearCmdData();
            NEXTWUSB.cmdData[SDO_SLOT].CMD = command;
            NEXTWUSB.cmdData[SDO_SLOT].Parm = parm;
            NEXTWUSB.cmdData[SDO_SLOT].Data1 = address;
            NEXTWUSB.cmdData[SDO_SLOT].Data2 = value;
            WriteCmd();
            NEXTWUSB.ClearCmdData();
            for (int i = 0; i < SDO_TRIES; i++)
            {
                ReadResp();
                NEXTWUSB.transData answer = NEXTWUSB.respData[SDO_SLOT];
                if ((answer.CMD & 0xFF) == command && answer.Parm == (parm & 0xFF) && answer.Data1 == address
                    && (command == NEXTWUSB.SDO_RD || answer.Data2 == value))
                    return answer.Data2;
                WriteCmd();
            }
        }
        throw new Failure(string.Format("SDO 0x{0:X4}:{1} of slave {2}", index, subindex, parm & 0xFF));
    }

    public static uint SdoRead(int slave, uint index, uint subindex)
    {
        return Sdo(NEXTWUSB.SDO_RD, (ushort)slave, index, subindex, 0);
    }

    public static void SdoWrite(int slave, uint index, uint subindex, int size, uint value)
    {
        Sdo(NEXTWUSB.SDO_WR, (ushort)(size << 8 | slave), index, subindex, value);
    }

    // Writes a target for every axis, and after every second frame reads until the FIFO has `mark` free entries.
    public static void Csp(int[] targets, int mark)
    {
        NEXTWUSB.ClearCmdData();
        for (int axis = 1; axis <= targets.Length; axis++)
        {
            NEXTWUSB.cmdData[axis].CMD = NEXTWUSB.CSP;
            NEXTWUSB.cmdData[axis].Data1 = unchecked((uint)targets[axis - 1]);
        }
        WriteCmd();
        if (++frames % 2 != 0)
            return;
        do
        {
            ReadResp();
            if (State() != NEXTWUSB.STATE_OPERATIONAL)
                throw new Failure("the network is not in OP any more");
        } while (FifoFree() < mark);
    }

    // Lets the FIFO run empty and the axes arrive, to within `window` counts.
    public static void Settle(int[] targets, int window)
    {
        for (int i = 0; i < SERVO_TRIES; i++)
        {
            int there = 0;
            ReadResp();
            for (int axis = 1; axis <= targets.Length; axis++)
                if (Math.Abs(Position(axis) - targets[axis - 1]) <= window)
                    there++;
            if (there == targets.Length && FifoFree() == FIFO_SIZE)
                return;
        }
        throw new Failure("an axis does not arrive");
    }

    // The speed, in counts a cycle, of the next cycle on the way to a point `remaining` counts ahead: it rises and falls by
    // `acceleration` a cycle and ends with 0 at the point.
    public static int NextSpeed(int remaining, int speed, int limit, int acceleration)
    {
        for (int next = speed + acceleration; next >= acceleration; next -= acceleration)
        {
            // Braking from `next`: next - a, next - 2a, ..., a.
            int braking = next / acceleration * (next - acceleration) / 2;
            if (next <= limit && next + braking <= remaining)
                return next;
        }
        return remaining;
    }

    public static void ShutDown(int axes)
    {
        Servo(axes, NEXTWUSB.SV_OFF);
        SetState(NEXTWUSB.STATE_PRE_OP);
        NEXTWUSB.CloseECMUSB();
    }
}
