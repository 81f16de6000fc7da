// The class that programs use, member by member that of the vendor's assemblies of 2019, and three names of UG17 4.3 beside
// them. One source for all assemblies; the symbols are given to the compiler by `cargo xtask dotnet`.
//
// A new method goes into NEXTWUSBDiagnostics.cs: this class is frozen (tests/capi/dotnet/surface.txt).

using System;
using System.Runtime.InteropServices;

using Ecmsk;

#if SLOTS_OF_16_BYTES
namespace NEXTWUSB_dotNET_16B
#elif NAMED_12B
namespace NEXTWUSB_dotNET_12B
#else
namespace NEXTWUSB_dotNET
#endif
{
    /// <summary>
    /// The ECM-SK on USB, or what stands in its place: fill <see cref="cmdData"/>, call <see cref="ECMUSBWrite"/>; call
    /// <see cref="ECMUSBRead"/>, look at <see cref="respData"/>.
    /// </summary>
    /// <remarks>
    /// One board for a process. A thread that reads and another one that writes may run at the same time. Why a function gave
    /// false, <see cref="NEXTWUSBDiagnostics.LastError"/> says.
    /// </remarks>
    public static class NEXTWUSB
    {
#if SLOTS_OF_16_BYTES
        /// <summary>Slots of a frame: the ECM, 30 slaves, one for SDOs.</summary>
        public const int DEF_MA_MAX = 32;
#else
        /// <summary>Slots of a frame: the ECM, 40 slaves, one for SDOs.</summary>
        public const int DEF_MA_MAX = 42;
#endif

        /// <summary>State of the network: NIC initialisation. States stand in SET_STATE's Data1 and in byte 2 of a response.</summary>
        public const int NIC_INIT = 0;
        /// <summary>State of the network: EtherCAT Init.</summary>
        public const int STATE_INIT = 1;
        /// <summary>State of the network: EtherCAT PreOP.</summary>
        public const int STATE_PRE_OP = 2;
        /// <summary>State of the network: EtherCAT SafeOP.</summary>
        public const int STATE_SAFE_OP = 4;
        /// <summary>State of the network: EtherCAT OP.</summary>
        public const int STATE_OPERATIONAL = 8;

        /// <summary>Command: get status, what an all-zero slot says.</summary>
        public const ushort GET_STATUS = 0x00;
        /// <summary>Command of the ECM: go to the state of the network in Data1.</summary>
        public const ushort SET_STATE = 0x01;
        /// <summary>Command of the ECM: the kinds of eight slaves, a nibble each of Data1; Parm is the group of eight.</summary>
        public const ushort SET_AXIS = 0x02;
        /// <summary>Command of the ECM: cycle time in us in Data1, distributed clocks.</summary>
        public const ushort SET_DC = 0x03;
        /// <summary>Command of the ECM: CRC-8 of commands and responses on or off. The vendor's name.</summary>
        public const ushort SDO_EX = 0x04;
        /// <summary>Command of the ECM: the command FIFO. The vendor's name.</summary>
        public const ushort SDO_FIFO = 0x05;
        /// <summary>The guide's name of <see cref="SDO_EX"/>.</summary>
        public const ushort SET_EX = SDO_EX;
        /// <summary>The guide's name of <see cref="SDO_FIFO"/>.</summary>
        public const ushort SET_FIFO = SDO_FIFO;
        /// <summary>Command of a slave: mode of operation in Data1, synchronisation in Data2.</summary>
        public const ushort DRIVE_MODE = 0x06;
        /// <summary>Command in the last slot: read an SDO.</summary>
        public const ushort SDO_RD = 0x07;
        /// <summary>Command in the last slot: write an SDO.</summary>
        public const ushort SDO_WR = 0x08;
        /// <summary>Command of a slave: clear its alarm.</summary>
        public const ushort ALM_CLR = 0x10;
        /// <summary>Command of a slave: servo on.</summary>
        public const ushort SV_ON = 0x11;
        /// <summary>Command of a slave: servo off.</summary>
        public const ushort SV_OFF = 0x12;
        /// <summary>Command of an IO slave: read its inputs.</summary>
        public const ushort IO_RD = 0x13;
        /// <summary>Command of an IO slave: set its outputs.</summary>
        public const ushort IO_WR = 0x14;
        /// <summary>Command of a slave: target position in counts in Data1.</summary>
        public const ushort CSP = 0x15;
        /// <summary>Command of a slave: target velocity in Data1.</summary>
        public const ushort CSV = 0x16;
        /// <summary>Command of a slave: target torque in Data1.</summary>
        public const ushort CST = 0x17;
        /// <summary>Command of a slave: begin homing.</summary>
        public const ushort GO_HOME = 0x18;
        /// <summary>Command of a slave: end homing.</summary>
        public const ushort ABORT_HOME = 0x19;
        /// <summary>Command of the ECM: read its own inputs.</summary>
        public const ushort LIO_RD = 0x21;
        /// <summary>Command of the ECM: set its own outputs.</summary>
        public const ushort LIO_WR = 0x22;
        /// <summary>Command of the ECM: boot anew; the connection is lost.</summary>
        public const ushort SW_RESET = 0xBB;

        /// <summary>Mode of a drive: homing.</summary>
        public const uint HOMING_MODE = 6;
        /// <summary>Mode of a drive: cyclic synchronous position.</summary>
        public const uint CSP_MODE = 8;
        /// <summary>Mode of a drive: cyclic synchronous velocity.</summary>
        public const uint CSV_MODE = 9;
        /// <summary>Mode of a drive: cyclic synchronous torque.</summary>
        public const uint CST_MODE = 10;

        /// <summary>Synchronisation of a drive: none.</summary>
        public const uint FREERUN = 0;
        /// <summary>Synchronisation of a drive: by distributed clocks.</summary>
        public const uint DCSYNC = 1;

        /// <summary>Kind of a slave: servo drive.</summary>
        public const short DRIVE = 0x0;
        /// <summary>Kind of a slave: digital inputs and outputs.</summary>
        public const short IO = 0x1;
        /// <summary>Kind of a slave: NEXTW's pulse module.</summary>
        public const short HSP = 0x2;
        /// <summary>Kind of a slave: stepper drive.</summary>
        public const short STEP = 0x3;
        /// <summary>Kind of a slave: there is none.</summary>
        public const short None = 0xF;

        /// <summary>A slot of a command or of a response.</summary>
        [StructLayout(LayoutKind.Sequential)]
        public struct transData
        {
            /// <summary>The command; in a response what it answers.</summary>
            public ushort CMD;
            /// <summary>Its parameter; in a response of the ECM its state and the CRC-8, of a drive the statusword.</summary>
            public ushort Parm;
            /// <summary>First value: a target, an object's index, a position.</summary>
            public uint Data1;
            /// <summary>Second value: an SDO's value, limits, in a drive's upper half its alarm code.</summary>
            public uint Data2;
#if SLOTS_OF_16_BYTES
            /// <summary>Third value, of NEXTW's pulse module alone.</summary>
            public uint Data3;
#endif
        }

#if SLOTS_OF_16_BYTES
        /// <summary>A slot of NEXTW's pulse module in CSP: two channels, each with a target and outputs.</summary>
        [StructLayout(LayoutKind.Sequential)]
        public struct CSCHSP
        {
            /// <summary>The command; in a response what it answers.</summary>
            public ushort CMD;
            /// <summary>Its parameter.</summary>
            public ushort Parm;
            /// <summary>Channel 1: a position in pulses.</summary>
            public uint Pulse1;
            /// <summary>Channel 1: outputs, in a response inputs.</summary>
            public ushort InOut1;
            /// <summary>Channel 2: a position in pulses.</summary>
            public uint Pulse2;
            /// <summary>Channel 2: outputs, in a response inputs.</summary>
            public ushort InOut2;

            /// <summary>The two channels of a slot.</summary>
            public static explicit operator CSCHSP(transData slot)
            {
                return new CSCHSP
                {
                    CMD = slot.CMD,
                    Parm = slot.Parm,
                    Pulse1 = slot.Data1,
                    InOut1 = unchecked((ushort)slot.Data2),
                    Pulse2 = slot.Data2 >> 16 | slot.Data3 << 16,
                    InOut2 = (ushort)(slot.Data3 >> 16),
                };
            }

            /// <summary>The slot of two channels.</summary>
            public static explicit operator transData(CSCHSP channels)
            {
                return new transData
                {
                    CMD = channels.CMD,
                    Parm = channels.Parm,
                    Data1 = channels.Pulse1,
                    Data2 = channels.InOut1 | channels.Pulse2 << 16,
                    Data3 = channels.Pulse2 >> 16 | (uint)channels.InOut2 << 16,
                };
            }
        }
#endif

        /// <summary>What <see cref="ECMUSBWrite"/> sends: <see cref="DEF_MA_MAX"/> slots, the ECM's first.</summary>
        public static transData[] cmdData = new transData[DEF_MA_MAX];
        /// <summary>What <see cref="ECMUSBRead"/> has received: <see cref="DEF_MA_MAX"/> slots, the ECM's first.</summary>
        public static transData[] respData = new transData[DEF_MA_MAX];

        // Bytes of a frame.
#if SLOTS_OF_16_BYTES
        const int FrameLength = DEF_MA_MAX * 16;
#else
        const int FrameLength = DEF_MA_MAX * 12;
#endif
        // Where a frame has its CRC-8.
        const int CrcByte = 3;
        // Bytes of the buffer for a report, and the length that is asked for, as the vendor's. The library fills 512 at most.
        const int ReportLength = 612;

        // What is copied at once.
        unsafe struct Frame
        {
            public fixed byte Bytes[FrameLength];
        }
        unsafe struct Report
        {
            public fixed byte Bytes[ReportLength];
        }

        // The frame that the last read of any thread has left, and its lock.
        static readonly byte[] lastRead = new byte[FrameLength];

        /// <summary>Opens the board.</summary>
        /// <returns>True if it is open, also if it was already. False if there is none.</returns>
        /// <exception cref="DllNotFoundException">There is no NEXTWUSBLib of this process's width.</exception>
        public static bool OpenECMUSB()
        {
            Library library = Library.Need();
            return Reason.Of(library.Open(), library);
        }

        /// <summary>Closes the board; reads and writes of other threads end. Harmless if it is closed.</summary>
        /// <exception cref="DllNotFoundException">There is no NEXTWUSBLib of this process's width.</exception>
        public static void CloseECMUSB()
        {
            Library.Need().Close();
        }

        /// <summary>
        /// Sends <see cref="cmdData"/> as it is. While the board checks the CRC-8 of commands, the program computes it first
        /// (<see cref="CRC8"/>).
        /// </summary>
        /// <returns>
        /// True if the board took it. False if none is open, the board is gone, or the array is null. Of an array of another
        /// length the first <see cref="DEF_MA_MAX"/> slots are sent; slots that it has not are 0.
        /// </returns>
        /// <exception cref="DllNotFoundException">There is no NEXTWUSBLib of this process's width.</exception>
        public static unsafe bool ECMUSBWrite()
        {
            Library library = Library.Need();
            transData[] slots = cmdData;
            // [OURS]
            if (slots == null)
                return Reason.Is("cmdData is null; it must be an array of {0} transData (DEF_MA_MAX)", DEF_MA_MAX);
            if (slots.Length < DEF_MA_MAX)
                Array.Resize(ref slots, DEF_MA_MAX);
            fixed (transData* frame = slots)
                return Reason.Of(library.Write((byte*)frame, (UIntPtr)FrameLength), library);
        }

        /// <summary>
        /// Waits for the board's next response and puts it into <see cref="respData"/>, whatever its CRC-8 is
        /// (<see cref="checkCRCValue"/>). If there is none, <see cref="respData"/> gets what the library has left in its place,
        /// as a rule the last command frame: so the state and positions of before do not stay there.
        /// </summary>
        /// <returns>
        /// True if there is one. False if no board is open, it is gone or closed meanwhile, the library is not found, or the
        /// array is null. An array of another length is filled as far as it goes. No exception comes out of it.
        /// </returns>
        public static unsafe bool ECMUSBRead()
        {
            try
            {
                Library library = Library.Get();
                if (library == null)
                    return false;
                // [OURS] 0 before the call: a library that leaves it alone when it fails must not leave an old report in it.
                Report report = new Report();
                byte* bytes = report.Bytes;
                bool hasRead = Reason.Of(library.Read(bytes, (UIntPtr)ReportLength), library);
                lock (lastRead)
                    fixed (byte* to = lastRead)
                        *(Frame*)to = *(Frame*)bytes;
                transData[] slots = respData;
                if (slots == null)
                    return Reason.Is("respData is null; it must be an array of {0} transData (DEF_MA_MAX)", DEF_MA_MAX);
                if (slots.Length >= DEF_MA_MAX)
                    fixed (transData* to = slots)
                        *(Frame*)to = *(Frame*)bytes;
                else
                    for (int i = 0; i < slots.Length; i++)
                        slots[i] = ((transData*)bytes)[i];
                return hasRead;
            }
            catch (Exception problem)
            {
                return Reason.Is("ECMUSBRead: {0}", problem.Message);
            }
        }

        /// <summary>Makes all of <see cref="cmdData"/> 0.</summary>
        /// <exception cref="NullReferenceException">The array is null.</exception>
        /// <exception cref="IndexOutOfRangeException">
        /// The array has less than <see cref="DEF_MA_MAX"/> entries; those that it has are 0 then.
        /// </exception>
        public static void ClearCmdData()
        {
            transData[] slots = cmdData;
            int count = Math.Max(slots.Length, DEF_MA_MAX);
            for (int i = 0; i < count; i++)
                slots[i] = new transData();
        }

        /// <summary>
        /// Whether the frame that the last <see cref="ECMUSBRead"/> has left carries its CRC-8. Call it after each read if the
        /// board fills it in.
        /// </summary>
        /// <returns>False, too, before any read, and if the frame carries none.</returns>
        public static bool checkCRCValue()
        {
            lock (lastRead)
            {
                byte crc = lastRead[CrcByte];
                lastRead[CrcByte] = 0;
                bool isRight = CRC8.CRC(lastRead) == crc;
                lastRead[CrcByte] = crc;
                return isRight;
            }
        }
    }
}
