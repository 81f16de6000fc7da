// One frame out, one response in; what they look like on the way the test sees in a recording.
using System;
#if SLOTS_OF_16_BYTES
using NEXTWUSB_dotNET_16B;
#else
using NEXTWUSB_dotNET_12B;
#endif

static class Frames
{
    static int Main(string[] arguments)
    {
        if (!NEXTWUSB.OpenECMUSB())
            return Fails("OpenECMUSB");
        // Every bit of the frame counts.
        NEXTWUSB.cmdData[0].CMD = NEXTWUSB.GET_STATUS;
        NEXTWUSB.cmdData[0].Parm = 0xA500;
        for (int slot = 1; slot < NEXTWUSB.DEF_MA_MAX; slot++)
        {
            NEXTWUSB.cmdData[slot].Parm = (ushort)(slot * 257);
            NEXTWUSB.cmdData[slot].Data1 = (uint)slot * 16843009;
            NEXTWUSB.cmdData[slot].Data2 = ~((uint)slot * 65537);
#if SLOTS_OF_16_BYTES
            NEXTWUSB.cmdData[slot].Data3 = (uint)slot * 3;
#endif
        }
        if (!NEXTWUSB.ECMUSBWrite())
            return Fails("ECMUSBWrite");
        Console.WriteLine("cmdData[0].Parm is 0x{0:X4}", NEXTWUSB.cmdData[0].Parm);
        NEXTWUSB.respData[5].Data1 = 12345;
        bool read = NEXTWUSB.ECMUSBRead();
        Console.WriteLine("read {0}, CRC {1}, respData[5].Data1 is {2}", read,
            NEXTWUSB.respData[0].Parm >> 8 != 0 ? "there" : "0", NEXTWUSB.respData[5].Data1);
        if (!read)
            Console.WriteLine(NEXTWUSBDiagnostics.LastError.Substring(0, 21));
        // Off, after the board has booted again: SET_EX with neither bit.
        NEXTWUSB.ClearCmdData();
        NEXTWUSB.cmdData[0].CMD = NEXTWUSB.SET_EX;
        NEXTWUSB.ECMUSBWrite();
        NEXTWUSB.ECMUSBRead();
        NEXTWUSB.cmdData[0].CMD = NEXTWUSB.SW_RESET;
        NEXTWUSB.ECMUSBWrite();
        while (!NEXTWUSB.OpenECMUSB())
            if (arguments.Length > 0)
                return Fails("OpenECMUSB");
        read = NEXTWUSB.ECMUSBRead();
        Console.WriteLine("read {0}, CRC {1}", read, NEXTWUSB.respData[0].Parm >> 8 != 0 ? "there" : "0");
        NEXTWUSB.CloseECMUSB();
        return 0;
    }

    static int Fails(string function)
    {
        Console.WriteLine("{0}: {1}", function, NEXTWUSBDiagnostics.LastError);
        return 1;
    }
}
