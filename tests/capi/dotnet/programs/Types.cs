// Each member of the vendor's class, used in ways that only its exact type allows: that it compiles is half of the test. Types.vb is the
// same in VB.NET.
using System;
using System.Collections.Generic;
#if SLOTS_OF_16_BYTES
using NEXTWUSB_dotNET_16B;
#else
using NEXTWUSB_dotNET_12B;
#endif

static class Types
{
    // Constants of their own types, as of a program that renames them.
    const int SLOTS = NEXTWUSB.DEF_MA_MAX;
    const ushort CRC_SWITCH = NEXTWUSB.SDO_EX;
    const uint MODE = NEXTWUSB.CSP_MODE;
    const short EMPTY = NEXTWUSB.None;

    enum Command : ushort { On = NEXTWUSB.SV_ON, Off = NEXTWUSB.SV_OFF }
    enum Mode : uint { Position = NEXTWUSB.CSP_MODE, Velocity = NEXTWUSB.CSV_MODE, Torque = NEXTWUSB.CST_MODE }
    enum Kind : short { Drive = NEXTWUSB.DRIVE, Step = NEXTWUSB.STEP }

    static void Told<T>(string name, T value)
    {
        Console.WriteLine("{0} {1} {2}", name, typeof(T).Name, value);
    }

    static void Constants()
    {
        Told("DEF_MA_MAX", NEXTWUSB.DEF_MA_MAX);
        Told("STATE_INIT", NEXTWUSB.STATE_INIT);
        Told("STATE_PRE_OP", NEXTWUSB.STATE_PRE_OP);
        Told("STATE_SAFE_OP", NEXTWUSB.STATE_SAFE_OP);
        Told("STATE_OPERATIONAL", NEXTWUSB.STATE_OPERATIONAL);
        Told("GET_STATUS", NEXTWUSB.GET_STATUS);
        Told("SET_STATE", NEXTWUSB.SET_STATE);
        Told("SET_AXIS", NEXTWUSB.SET_AXIS);
        Told("SET_DC", NEXTWUSB.SET_DC);
        Told("SDO_EX", NEXTWUSB.SDO_EX);
        Told("SDO_FIFO", NEXTWUSB.SDO_FIFO);
        Told("DRIVE_MODE", NEXTWUSB.DRIVE_MODE);
        Told("SDO_RD", NEXTWUSB.SDO_RD);
        Told("SDO_WR", NEXTWUSB.SDO_WR);
        Told("ALM_CLR", NEXTWUSB.ALM_CLR);
        Told("SV_ON", NEXTWUSB.SV_ON);
        Told("SV_OFF", NEXTWUSB.SV_OFF);
        Told("IO_RD", NEXTWUSB.IO_RD);
        Told("IO_WR", NEXTWUSB.IO_WR);
        Told("CSP", NEXTWUSB.CSP);
        Told("CSV", NEXTWUSB.CSV);
        Told("CST", NEXTWUSB.CST);
        Told("GO_HOME", NEXTWUSB.GO_HOME);
        Told("ABORT_HOME", NEXTWUSB.ABORT_HOME);
        Told("LIO_RD", NEXTWUSB.LIO_RD);
        Told("LIO_WR", NEXTWUSB.LIO_WR);
        Told("SW_RESET", NEXTWUSB.SW_RESET);
        Told("HOMING_MODE", NEXTWUSB.HOMING_MODE);
        Told("CSP_MODE", NEXTWUSB.CSP_MODE);
        Told("CSV_MODE", NEXTWUSB.CSV_MODE);
        Told("CST_MODE", NEXTWUSB.CST_MODE);
        Told("FREERUN", NEXTWUSB.FREERUN);
        Told("DCSYNC", NEXTWUSB.DCSYNC);
        Told("DRIVE", NEXTWUSB.DRIVE);
        Told("IO", NEXTWUSB.IO);
        Told("HSP", NEXTWUSB.HSP);
        Told("STEP", NEXTWUSB.STEP);
        Told("None", NEXTWUSB.None);
    }

    static void Put(int axis, ushort command, uint data)
    {
        Put(ref NEXTWUSB.cmdData[axis], command, data);
    }

    static void Put(ref NEXTWUSB.transData slot, ushort command = NEXTWUSB.GET_STATUS, uint data = NEXTWUSB.FREERUN)
    {
        slot.CMD = command;
        slot.Data1 = data;
    }

    static string Named(ushort command)
    {
        switch (command)
        {
            case NEXTWUSB.SV_ON: return "SV_ON";
            case NEXTWUSB.SV_OFF: return "SV_OFF";
            case NEXTWUSB.DRIVE_MODE: return "DRIVE_MODE";
            default: return "another";
        }
    }

    static string Named(uint mode)
    {
        switch (mode)
        {
            case NEXTWUSB.CSP_MODE: return "CSP";
            case NEXTWUSB.CSV_MODE: return "CSV";
            default: return "another";
        }
    }

    static string Named(short kind)
    {
        switch (kind)
        {
            case NEXTWUSB.DRIVE: return "drive";
            case NEXTWUSB.IO: return "io";
            default: return "another";
        }
    }

    static void Uses(bool on, bool velocity)
    {
        NEXTWUSB.cmdData[1].CMD = on ? NEXTWUSB.SV_ON : NEXTWUSB.SV_OFF;
        NEXTWUSB.cmdData[1].Data1 = velocity ? NEXTWUSB.CSV_MODE : NEXTWUSB.CSP_MODE;
        NEXTWUSB.cmdData[1].Data2 = NEXTWUSB.DCSYNC;
        var mode = NEXTWUSB.CSP_MODE;
        Put(2, NEXTWUSB.DRIVE_MODE, mode);
        Put(3, (ushort)Command.Off, (uint)Mode.Torque);
        Put(ref NEXTWUSB.cmdData[4]);
        short kind = on == velocity ? NEXTWUSB.IO : NEXTWUSB.DRIVE;
        short[] kinds = { NEXTWUSB.DRIVE, NEXTWUSB.IO, NEXTWUSB.HSP, NEXTWUSB.STEP, EMPTY };
        uint nibbles = 0;
        foreach (short one in kinds)
            nibbles = nibbles << 4 | (ushort)one;
        NEXTWUSB.cmdData[0].CMD = NEXTWUSB.SET_STATE;
        NEXTWUSB.cmdData[0].Data1 = NEXTWUSB.STATE_PRE_OP;
        var names = new Dictionary<ushort, string> { { NEXTWUSB.SV_ON, "on" }, { NEXTWUSB.SV_OFF, "off" } };
        var modes = new List<uint> { NEXTWUSB.CSP_MODE, NEXTWUSB.CSV_MODE, MODE };
        Console.WriteLine("{0} {1} {2} {3} {4} {5}", Named(NEXTWUSB.cmdData[1].CMD), Named(NEXTWUSB.cmdData[1].Data1),
            Named(NEXTWUSB.cmdData[2].CMD), Named(kind), names[NEXTWUSB.cmdData[1].CMD], modes.IndexOf(mode));
        Console.WriteLine("{0:X} {1} {2} {3} {4}", nibbles, SLOTS == NEXTWUSB.cmdData.Length, CRC_SWITCH, Kind.Step,
            NEXTWUSB.cmdData[3].Data1);
    }

    // Neither array is readonly.
    static void Swap(ref NEXTWUSB.transData[] one, ref NEXTWUSB.transData[] other)
    {
        NEXTWUSB.transData[] kept = one;
        one = other;
        other = kept;
    }

    static void Calls()
    {
        Func<bool> open = NEXTWUSB.OpenECMUSB, write = NEXTWUSB.ECMUSBWrite, read = NEXTWUSB.ECMUSBRead;
        Func<bool> check = NEXTWUSB.checkCRCValue;
        Action close = NEXTWUSB.CloseECMUSB, clear = NEXTWUSB.ClearCmdData;
        Func<byte[], byte> crc = CRC8.CRC;
        Func<byte[], int, int, byte> part = CRC8.CRC;
        Console.WriteLine("CRC {0:X2} {1:X2} {2}", crc(new byte[] { 1, 2, 3 }), part(new byte[] { 0, 1, 2, 3 }, 1, 3), check());
        Console.WriteLine("open {0}", open());
        clear();
        NEXTWUSB.cmdData[0].CMD = NEXTWUSB.GET_STATUS;
        Console.WriteLine("write {0}, read {1}, state {2}, CRC {3}", write(), read(), NEXTWUSB.respData[0].Parm & 0xFF, check());
        Swap(ref NEXTWUSB.cmdData, ref NEXTWUSB.respData);
        Console.WriteLine("swapped {0}", NEXTWUSB.cmdData[0].Parm & 0xFF);
        Swap(ref NEXTWUSB.cmdData, ref NEXTWUSB.respData);
        close();
        Console.WriteLine("closed: write {0}, read {1}", write(), read());
    }

#if SLOTS_OF_16_BYTES
    static void Channels()
    {
        NEXTWUSB.transData slot = new NEXTWUSB.transData { CMD = NEXTWUSB.CSP, Parm = 7 };
        slot.Data1 = 0x11223344;
        slot.Data2 = 0xAABB5566;
        slot.Data3 = 0x7788CCDD;
        NEXTWUSB.CSCHSP channels = (NEXTWUSB.CSCHSP)slot;
        Console.WriteLine("{0:X} {1} {2:X} {3:X} {4:X} {5:X}", channels.CMD, channels.Parm, channels.Pulse1, channels.InOut1,
            channels.Pulse2, channels.InOut2);
        channels.Pulse2 += 1;
        NEXTWUSB.cmdData[1] = (NEXTWUSB.transData)channels;
        slot = NEXTWUSB.cmdData[1];
        Console.WriteLine("{0:X} {1} {2:X} {3:X} {4:X}", slot.CMD, slot.Parm, slot.Data1, slot.Data2, slot.Data3);
    }
#endif

    static void Main()
    {
        Constants();
        Uses(true, false);
        Uses(false, true);
#if SLOTS_OF_16_BYTES
        Channels();
#endif
        Calls();
    }
}
