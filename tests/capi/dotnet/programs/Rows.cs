// The behaviour of the vendor's class, row by row, on a library that returns the written frame (loopback.c). With the argument
// `missing`, without a library.
using System;
using System.Runtime.InteropServices;
#if SLOTS_OF_16_BYTES
using NEXTWUSB_dotNET_16B;
#else
using NEXTWUSB_dotNET_12B;
#endif

static class Rows
{
    const int LAST = NEXTWUSB.DEF_MA_MAX - 1;

    static string Try(Func<object> call)
    {
        try
        {
            return Convert.ToString(call());
        }
        catch (ArgumentException problem)
        {
            return problem.GetType().Name + (problem is ArgumentNullException ? " " + problem.ParamName : "");
        }
        catch (Exception problem)
        {
            return problem.GetType().Name;
        }
    }

    static string Done(Action call)
    {
        return Try(() => { call(); return "no exception"; });
    }

    static byte[] Bytes(NEXTWUSB.transData[] slots)
    {
        GCHandle pinned = GCHandle.Alloc(slots, GCHandleType.Pinned);
        byte[] bytes = new byte[slots.Length * Marshal.SizeOf(typeof(NEXTWUSB.transData))];
        Marshal.Copy(pinned.AddrOfPinnedObject(), bytes, 0, bytes.Length);
        pinned.Free();
        return bytes;
    }

    // A frame in which no bit is 0 in all bytes. Byte 2 selects the library's answer: 1 true, 0 false, 9 false with the buffer
    // unchanged.
    static void Fill(ushort answer)
    {
        NEXTWUSB.cmdData = new NEXTWUSB.transData[NEXTWUSB.DEF_MA_MAX];
        for (int i = 0; i < NEXTWUSB.DEF_MA_MAX; i++)
        {
            NEXTWUSB.cmdData[i].CMD = (ushort)(0x1000 + i);
            NEXTWUSB.cmdData[i].Parm = (ushort)(0xA500 + i);
            NEXTWUSB.cmdData[i].Data1 = 0x11110000u + (uint)i;
            NEXTWUSB.cmdData[i].Data2 = 0xFFFF0000u - (uint)i;
        }
        NEXTWUSB.cmdData[0].Parm = (ushort)(0x9600 | answer);
    }

    static void Sign()
    {
        NEXTWUSB.cmdData[0].Parm &= 0xFF;
        NEXTWUSB.cmdData[0].Parm |= (ushort)(CRC8.CRC(Bytes(NEXTWUSB.cmdData)) << 8);
    }

    static string Slot(NEXTWUSB.transData[] slots, int at)
    {
        return string.Format("{0:X4} {1:X4} {2:X8} {3:X8}", slots[at].CMD, slots[at].Parm, slots[at].Data1, slots[at].Data2);
    }

    static void Frames()
    {
        Fill(1);
        Console.WriteLine("write {0}, byte 3 stays {1:X2}", NEXTWUSB.ECMUSBWrite(), NEXTWUSB.cmdData[0].Parm >> 8);
        Console.WriteLine("true read {0}: {1}, {2}", NEXTWUSB.ECMUSBRead(), Slot(NEXTWUSB.respData, 0), Slot(NEXTWUSB.respData, LAST));
        Console.WriteLine("CRC right: {0}", NEXTWUSB.checkCRCValue());
        Fill(0);
        NEXTWUSB.ECMUSBWrite();
        Console.WriteLine("false read {0}: {1}, {2}", NEXTWUSB.ECMUSBRead(), Slot(NEXTWUSB.respData, 0), Slot(NEXTWUSB.respData, LAST));
        Console.WriteLine("CRC right: {0}", NEXTWUSB.checkCRCValue());
        Fill(9);
        NEXTWUSB.ECMUSBWrite();
        Console.WriteLine("left alone, read {0}: {1}, CRC right: {2}", NEXTWUSB.ECMUSBRead(), Slot(NEXTWUSB.respData, 0),
            NEXTWUSB.checkCRCValue());
        foreach (ushort answer in new ushort[] { 1, 0 })
        {
            Fill(answer);
            Sign();
            NEXTWUSB.ECMUSBWrite();
            Console.WriteLine("signed, read {0}, CRC right {1}, again {2}", NEXTWUSB.ECMUSBRead(), NEXTWUSB.checkCRCValue(),
                NEXTWUSB.checkCRCValue());
            // The frame counts, whatever the program does with the array.
            NEXTWUSB.respData[3].Data1 ^= 1;
            Console.WriteLine("after a change {0}", NEXTWUSB.checkCRCValue());
        }
    }

    static void Arrays()
    {
        Fill(1);
        NEXTWUSB.transData[] own = NEXTWUSB.cmdData;
        NEXTWUSB.cmdData = new NEXTWUSB.transData[5];
        Array.Copy(own, NEXTWUSB.cmdData, 5);
        Console.WriteLine("5 written {0}, read {1}: {2}", NEXTWUSB.ECMUSBWrite(), NEXTWUSB.ECMUSBRead(), Slot(NEXTWUSB.respData, 4));
        NEXTWUSB.cmdData = new NEXTWUSB.transData[50];
        Array.Copy(own, NEXTWUSB.cmdData, own.Length);
        Console.WriteLine("50 written {0}, read {1}: {2}", NEXTWUSB.ECMUSBWrite(), NEXTWUSB.ECMUSBRead(), Slot(NEXTWUSB.respData, LAST));
        NEXTWUSB.respData = new NEXTWUSB.transData[5];
        Console.WriteLine("5 read {0}: {1}, {2}", NEXTWUSB.ECMUSBRead(), Slot(NEXTWUSB.respData, 4), NEXTWUSB.respData.Length);
        NEXTWUSB.respData = new NEXTWUSB.transData[50];
        NEXTWUSB.respData[49].Data1 = 7;
        Console.WriteLine("50 read {0}: {1}, {2}", NEXTWUSB.ECMUSBRead(), Slot(NEXTWUSB.respData, LAST), NEXTWUSB.respData[49].Data1);
        NEXTWUSB.respData = null;
        Console.WriteLine("null read {0}", NEXTWUSB.ECMUSBRead());
        NEXTWUSB.respData = new NEXTWUSB.transData[NEXTWUSB.DEF_MA_MAX];

        NEXTWUSB.cmdData = own;
        NEXTWUSB.ClearCmdData();
        Console.WriteLine("cleared {0}, the same array {1}", Array.TrueForAll(Bytes(own), value => value == 0), own == NEXTWUSB.cmdData);
        NEXTWUSB.cmdData = new NEXTWUSB.transData[5];
        NEXTWUSB.cmdData[4].Data2 = 9;
        Console.WriteLine("clear 5: {0}, {1}", Done(NEXTWUSB.ClearCmdData), NEXTWUSB.cmdData[4].Data2);
        NEXTWUSB.cmdData = null;
        Console.WriteLine("clear null: {0}", Done(NEXTWUSB.ClearCmdData));
        NEXTWUSB.cmdData = own;
    }

    static void Crc()
    {
        byte[] bytes = { 0, 1, 2, 3, 4, 5, 6, 7 };
        Console.WriteLine("{0:X2} {1:X2} {2:X2}", CRC8.CRC(new byte[0]), CRC8.CRC(bytes), CRC8.CRC(bytes, 0, 4));
        // `len` is its length.
        Console.WriteLine("{0:X2} {1:X2} {2:X2}", CRC8.CRC(bytes, 2, 4), CRC8.CRC(new byte[] { 2, 3 }), CRC8.CRC(bytes, 5, 3));
        Console.WriteLine(Try(() => CRC8.CRC(null)));
        Console.WriteLine(Try(() => CRC8.CRC(null, 0, 0)));
        foreach (int[] range in new[] { new[] { -1, 2 }, new[] { 0, -1 }, new[] { 0, 9 }, new[] { 3, 6 }, new[] { 9, 0 } })
            Console.WriteLine(Try(() => CRC8.CRC(bytes, range[0], range[1])));
    }

    static int Main(string[] arguments)
    {
        Console.WriteLine("before any read: CRC right {0}", NEXTWUSB.checkCRCValue());
        if (arguments.Length > 0)
        {
            Console.WriteLine("open {0}", Try(() => NEXTWUSB.OpenECMUSB()));
            Console.WriteLine("write {0}", Try(() => NEXTWUSB.ECMUSBWrite()));
            Console.WriteLine("read {0}", Try(() => NEXTWUSB.ECMUSBRead()));
            Console.WriteLine("close {0}", Done(NEXTWUSB.CloseECMUSB));
            return 0;
        }
        Console.WriteLine("open {0}", NEXTWUSB.OpenECMUSB());
        Frames();
        Arrays();
        Crc();
        NEXTWUSB.CloseECMUSB();
        return 0;
    }
}
