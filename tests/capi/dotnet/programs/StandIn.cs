// A stand-in for the vendor's assemblies of November 2019, written from the table (surface.txt), independently of this project's: the
// same surface, and the same behaviour as far as the rules define it. Programs are compiled against it, and run on this project's
// assembly.
using System;
using System.Reflection;
using System.Runtime.InteropServices;

[assembly: AssemblyVersion("2.0.0.0")]
[assembly: AssemblyFileVersion("2.0.0.0")]
[assembly: AssemblyCompany("NEXTW")]

#if SLOTS_OF_16_BYTES
namespace NEXTWUSB_dotNET_16B
#else
namespace NEXTWUSB_dotNET_12B
#endif
{
    public static class CRC8
    {
        public static byte CRC(byte[] buffer)
        {
            return CRC(buffer, 0, buffer.Length);
        }

        public static byte CRC(byte[] buffer, int off, int len)
        {
            if (buffer == null)
                throw new ArgumentNullException("buffer");
            if (off < 0 || len < 0 || (long)off + len > buffer.Length)
                throw new ArgumentOutOfRangeException();
            byte crc = 0x5A;
            for (int i = off; i < len; i++)
            {
                crc ^= buffer[i];
                for (int bit = 0; bit < 8; bit++)
                    crc = (byte)((crc << 1) ^ ((crc & 0x80) != 0 ? 0x07 : 0));
            }
            return crc;
        }
    }

    public static class NEXTWUSB
    {
#if SLOTS_OF_16_BYTES
        public const int DEF_MA_MAX = 32;
#else
        public const int DEF_MA_MAX = 42;
#endif
        public const int STATE_INIT = 1;
        public const int STATE_PRE_OP = 2;
        public const int STATE_SAFE_OP = 4;
        public const int STATE_OPERATIONAL = 8;

        public const ushort GET_STATUS = 0;
        public const ushort SET_STATE = 1;
        public const ushort SET_AXIS = 2;
        public const ushort SET_DC = 3;
        public const ushort SDO_EX = 4;
        public const ushort SDO_FIFO = 5;
        public const ushort DRIVE_MODE = 6;
        public const ushort SDO_RD = 7;
        public const ushort SDO_WR = 8;
        public const ushort ALM_CLR = 0x10;
        public const ushort SV_ON = 0x11;
        public const ushort SV_OFF = 0x12;
        public const ushort IO_RD = 0x13;
        public const ushort IO_WR = 0x14;
        public const ushort CSP = 0x15;
        public const ushort CSV = 0x16;
        public const ushort CST = 0x17;
        public const ushort GO_HOME = 0x18;
        public const ushort ABORT_HOME = 0x19;
        public const ushort LIO_RD = 0x21;
        public const ushort LIO_WR = 0x22;
        public const ushort SW_RESET = 0xBB;

        public const uint HOMING_MODE = 6;
        public const uint CSP_MODE = 8;
        public const uint CSV_MODE = 9;
        public const uint CST_MODE = 10;
        public const uint FREERUN = 0;
        public const uint DCSYNC = 1;

        public const short DRIVE = 0;
        public const short IO = 1;
        public const short HSP = 2;
        public const short STEP = 3;
        public const short None = 15;

        [StructLayout(LayoutKind.Sequential)]
        public struct transData
        {
            public ushort CMD;
            public ushort Parm;
            public uint Data1;
            public uint Data2;
#if SLOTS_OF_16_BYTES
            public uint Data3;
#endif
        }

#if SLOTS_OF_16_BYTES
        [StructLayout(LayoutKind.Sequential)]
        public struct CSCHSP
        {
            public ushort CMD;
            public ushort Parm;
            public uint Pulse1;
            public ushort InOut1;
            public uint Pulse2;
            public ushort InOut2;

            public static explicit operator CSCHSP(transData slot)
            {
                CSCHSP own = new CSCHSP();
                own.CMD = slot.CMD;
                own.Parm = slot.Parm;
                own.Pulse1 = slot.Data1;
                own.InOut1 = (ushort)(slot.Data2 % 65536);
                own.Pulse2 = slot.Data2 / 65536 + slot.Data3 % 65536 * 65536;
                own.InOut2 = (ushort)(slot.Data3 / 65536);
                return own;
            }

            public static explicit operator transData(CSCHSP own)
            {
                transData slot = new transData();
                slot.CMD = own.CMD;
                slot.Parm = own.Parm;
                slot.Data1 = own.Pulse1;
                slot.Data2 = own.InOut1 + own.Pulse2 % 65536 * 65536;
                slot.Data3 = own.Pulse2 / 65536 + (uint)own.InOut2 * 65536;
                return slot;
            }
        }
#endif

        public static transData[] cmdData = new transData[DEF_MA_MAX];
        public static transData[] respData = new transData[DEF_MA_MAX];

        static readonly object gate = new object();
        static readonly int SlotLength = Marshal.SizeOf(typeof(transData));
        static byte[] lastRead = new byte[612];

        [DllImport("NEXTWUSBLib.dll", EntryPoint = "#1", CallingConvention = CallingConvention.StdCall)]
        public static extern bool OpenECMUSB();

        [DllImport("NEXTWUSBLib.dll", EntryPoint = "#2", CallingConvention = CallingConvention.StdCall)]
        public static extern void CloseECMUSB();

        [DllImport("NEXTWUSBLib.dll", EntryPoint = "#3", CallingConvention = CallingConvention.StdCall)]
        static extern bool Write(byte[] data, uint dwlength);

        [DllImport("NEXTWUSBLib.dll", EntryPoint = "#4", CallingConvention = CallingConvention.StdCall)]
        static extern bool Read(byte[] data, uint dwlength);

        public static bool ECMUSBWrite()
        {
            lock (gate)
            {
                byte[] frame = new byte[DEF_MA_MAX * SlotLength];
                for (int i = 0; i < cmdData.Length && i < DEF_MA_MAX; i++)
                {
                    GCHandle slot = GCHandle.Alloc(cmdData[i], GCHandleType.Pinned);
                    Marshal.Copy(slot.AddrOfPinnedObject(), frame, i * SlotLength, SlotLength);
                    slot.Free();
                }
                return Write(frame, (uint)frame.Length);
            }
        }

        public static bool ECMUSBRead()
        {
            lock (gate)
            {
                try
                {
                    byte[] report = new byte[612];
                    bool read = Read(report, 612);
                    lastRead = report;
                    GCHandle all = GCHandle.Alloc(report, GCHandleType.Pinned);
                    for (int i = 0; i < respData.Length && i < DEF_MA_MAX; i++)
                        respData[i] = (transData)Marshal.PtrToStructure(
                            new IntPtr(all.AddrOfPinnedObject().ToInt64() + i * SlotLength), typeof(transData));
                    all.Free();
                    return read;
                }
                catch
                {
                    return false;
                }
            }
        }

        public static void ClearCmdData()
        {
            for (int i = 0; i < DEF_MA_MAX; i++)
                cmdData[i] = new transData();
        }

        public static bool checkCRCValue()
        {
            byte[] frame = (byte[])lastRead.Clone();
            frame[3] = 0;
            return CRC8.CRC(frame, 0, DEF_MA_MAX * SlotLength) == lastRead[3];
        }
    }
}
