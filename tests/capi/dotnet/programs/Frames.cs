// A program with the CRC-8 on: it signs its frames itself and checks the CRC-8 of responses itself. Argument: `once`, only one response.
using System;
using System.Runtime.InteropServices;
#if SLOTS_OF_16_BYTES
using NEXTWUSB_dotNET_16B;
#else
using NEXTWUSB_dotNET_12B;
#endif

static class Frames
{
    static byte[] Bytes(NEXTWUSB.transData[] slots)
    {
        GCHandle pinned = GCHandle.Alloc(slots, GCHandleType.Pinned);
        byte[] bytes = new byte[slots.Length * Marshal.SizeOf(typeof(NEXTWUSB.transData))];
        Marshal.Copy(pinned.AddrOfPinnedObject(), bytes, 0, bytes.Length);
        pinned.Free();
        return bytes;
    }

    static void Sign()
    {
        NEXTWUSB.cmdData[0].Parm &= 0xFF;
        NEXTWUSB.cmdData[0].Parm |= (ushort)(CRC8.CRC(Bytes(NEXTWUSB.cmdData)) << 8);
    }

    // The board's count of frames with a wrong CRC, after it has answered the written frames.
    static int Errors()
    {
        for (int i = 0; i < 3; i++)
            NEXTWUSB.ECMUSBRead();
        return NEXTWUSB.respData[0].CMD >> 8;
    }

    // The check of commands, bit 0, and the CRC of responses, bit 4, take effect after the board's next boot.
    static void Switch(uint switches, bool signed)
    {
        foreach (ushort command in new[] { NEXTWUSB.SDO_EX, NEXTWUSB.SW_RESET })
        {
            NEXTWUSB.ClearCmdData();
            NEXTWUSB.cmdData[0].CMD = command;
            NEXTWUSB.cmdData[0].Data1 = command == NEXTWUSB.SDO_EX ? switches : 0;
            if (signed)
                Sign();
            NEXTWUSB.ECMUSBWrite();
            if (command == NEXTWUSB.SDO_EX)
                NEXTWUSB.ECMUSBRead();
        }
        while (!NEXTWUSB.OpenECMUSB())
            continue;
        NEXTWUSB.ClearCmdData();
    }

    static void Read(string when)
    {
        NEXTWUSB.respData[5].Data1 = 12345;
        bool read = NEXTWUSB.ECMUSBRead();
        Console.WriteLine("{0}: read {1}, CRC right {2}, {3}, old data {4}", when, read, NEXTWUSB.checkCRCValue(),
            NEXTWUSB.respData[0].Parm >> 8 != 0 ? "there" : "0", NEXTWUSB.respData[5].Data1 == 12345);
    }

    static int Main(string[] arguments)
    {
        if (!NEXTWUSB.OpenECMUSB())
            return 1;
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
        NEXTWUSB.ECMUSBWrite();
        Read("as it comes");
        if (arguments.Length > 0)
            return 0;
        Switch(0x11, false);
        Console.WriteLine("commands are checked: errors {0}", Errors());
        NEXTWUSB.ECMUSBWrite();
        Console.WriteLine("not signed: errors {0}", Errors());
        Sign();
        NEXTWUSB.ECMUSBWrite();
        Console.WriteLine("signed: errors {0}", Errors());
        NEXTWUSB.cmdData[0].Parm ^= 0x100;
        NEXTWUSB.ECMUSBWrite();
        Console.WriteLine("signed wrongly: errors {0}", Errors());
        Read("with CRC");
        Switch(0, true);
        NEXTWUSB.ECMUSBWrite();
        Console.WriteLine("commands are not checked: errors {0}", Errors());
        Read("without CRC");
        NEXTWUSB.CloseECMUSB();
        return 0;
    }
}
