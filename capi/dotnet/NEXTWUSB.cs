// The class that programs use: constants, cmdData, respData and five functions, as UG17 4.3 has them. One source for the
// three assemblies; the symbols are given to the compiler by `cargo xtask dotnet`.
//
// A new method goes into NEXTWUSBDiagnostics.cs: this class has what the vendor's has, and nothing else (NET-1).

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
    /// One board for a process. A thread that reads and another one that writes may run at the same time. No function throws:
    /// why one gave false, <see cref="NEXTWUSBDiagnostics.LastError"/> says.
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
        public const int GET_STATUS = 0x00;
        /// <summary>Command of the ECM: go to the state of the network in Data1.</summary>
        public const int SET_STATE = 0x01;
        /// <summary>Command of the ECM: the kinds of eight slaves, a nibble each of Data1; Parm is the group of eight.</summary>
        public const int SET_AXIS = 0x02;
        /// <summary>Command of the ECM: cycle time in us in Data1, distributed clocks.</summary>
        public const int SET_DC = 0x03;
        /// <summary>Command of the ECM: CRC-8 of commands and responses on or off.</summary>
        public const int SET_EX = 0x04;
        /// <summary>Command of the ECM: the command FIFO.</summary>
        public const int SET_FIFO = 0x05;
        /// <summary>Command of a slave: mode of operation in Data1, synchronisation in Data2.</summary>
        public const int DRIVE_MODE = 0x06;
        /// <summary>Command in the last slot: read an SDO.</summary>
        public const int SDO_RD = 0x07;
        /// <summary>Command in the last slot: write an SDO.</summary>
        public const int SDO_WR = 0x08;
        /// <summary>Command of a slave: clear its alarm.</summary>
        public const int ALM_CLR = 0x10;
        /// <summary>Command of a slave: servo on.</summary>
        public const int SV_ON = 0x11;
        /// <summary>Command of a slave: servo off.</summary>
        public const int SV_OFF = 0x12;
        /// <summary>Command of an IO slave: read its inputs.</summary>
        public const int IO_RD = 0x13;
        /// <summary>Command of an IO slave: set its outputs.</summary>
        public const int IO_WR = 0x14;
        /// <summary>Command of a slave: target position in counts in Data1.</summary>
        public const int CSP = 0x15;
        /// <summary>Command of a slave: target velocity in Data1.</summary>
        public const int CSV = 0x16;
        /// <summary>Command of a slave: target torque in Data1.</summary>
        public const int CST = 0x17;
        /// <summary>Command of a slave: begin homing.</summary>
        public const int GO_HOME = 0x18;
        /// <summary>Command of a slave: end homing.</summary>
        public const int ABORT_HOME = 0x19;
        /// <summary>Command of the ECM: read its own inputs.</summary>
        public const int LIO_RD = 0x21;
        /// <summary>Command of the ECM: set its own outputs.</summary>
        public const int LIO_WR = 0x22;
        /// <summary>Command of the ECM: boot anew; the connection is lost.</summary>
        public const int SW_RESET = 0xBB;

        /// <summary>Mode of a drive: homing.</summary>
        public const int HOMING_MODE = 6;
        /// <summary>Mode of a drive: cyclic synchronous position.</summary>
        public const int CSP_MODE = 8;
        /// <summary>Mode of a drive: cyclic synchronous velocity.</summary>
        public const int CSV_MODE = 9;
        /// <summary>Mode of a drive: cyclic synchronous torque.</summary>
        public const int CST_MODE = 10;

        /// <summary>Synchronisation of a drive: none.</summary>
        public const int FREERUN = 0;
        /// <summary>Synchronisation of a drive: by distributed clocks.</summary>
        public const int DCSYNC = 1;

        /// <summary>Kind of a slave: servo drive.</summary>
        public const int DRIVE = 0x0;
        /// <summary>Kind of a slave: digital inputs and outputs.</summary>
        public const int IO = 0x1;
        /// <summary>Kind of a slave: NEXTW's pulse module.</summary>
        public const int HSP = 0x2;
        /// <summary>Kind of a slave: stepper drive.</summary>
        public const int STEP = 0x3;
        /// <summary>Kind of a slave: there is none.</summary>
        public const int None = 0xF;

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

        /// <summary>What <see cref="ECMUSBWrite"/> sends: <see cref="DEF_MA_MAX"/> slots, the ECM's first.</summary>
        public static transData[] cmdData = new transData[DEF_MA_MAX];
        /// <summary>What <see cref="ECMUSBRead"/> has received: <see cref="DEF_MA_MAX"/> slots, the ECM's first.</summary>
        public static transData[] respData = new transData[DEF_MA_MAX];

        // Bytes of a frame, 504 or 512: a multiple of 8.
#if SLOTS_OF_16_BYTES
        const int FrameLength = DEF_MA_MAX * 16;
#else
        const int FrameLength = DEF_MA_MAX * 12;
#endif
        // The bytes of a frame, which are copied at once.
        unsafe struct Frame
        {
            public fixed byte Bytes[FrameLength];
        }
        // Where a frame has its CRC-8.
        const int CrcByte = 3;

        /// <summary>Opens the board.</summary>
        /// <returns>True if it is open, also if it was already. False if there is none, or its library is not there.</returns>
        public static bool OpenECMUSB()
        {
            Library library = Library.Get();
            return library != null && Reason.Of(library.Open(), library);
        }

        /// <summary>Closes the board; reads and writes of other threads end. Harmless if it is closed.</summary>
        public static void CloseECMUSB()
        {
            Library library = Library.Get();
            if (library != null)
                library.Close();
        }

        /// <summary>Sends <see cref="cmdData"/> with its CRC-8; the array itself stays as it is.</summary>
        /// <returns>
        /// True if the board took it. False if none is open, the board is gone, or the array is null or not of
        /// <see cref="DEF_MA_MAX"/> slots.
        /// </returns>
        public static unsafe bool ECMUSBWrite()
        {
            transData[] slots = cmdData;
            if (!IsFrame(slots, "cmdData"))
                return false;
            Library library = Library.Get();
            if (library == null)
                return false;
            Frame frame;
            fixed (transData* from = slots)
                frame = *(Frame*)from;
            byte* bytes = frame.Bytes;
            bytes[CrcByte] = 0;
            bytes[CrcByte] = Crc8.Of(bytes, FrameLength);
            return Reason.Of(library.Write(bytes, (UIntPtr)FrameLength), library);
        }

        /// <summary>Waits for the board's next response and puts it into <see cref="respData"/>.</summary>
        /// <returns>
        /// True if there is one. False, and the array as it was, if no board is open, it is gone or closed meanwhile, the
        /// CRC-8 of the response is wrong, or the array is null or not of <see cref="DEF_MA_MAX"/> slots. A response
        /// whose byte 3 is 0 passes as one without CRC.
        /// </returns>
        public static unsafe bool ECMUSBRead()
        {
            transData[] slots = respData;
            // Before a response is used up.
            if (!IsFrame(slots, "respData"))
                return false;
            Library library = Library.Get();
            if (library == null)
                return false;
            Frame frame;
            byte* bytes = frame.Bytes;
            if (!Reason.Of(library.Read(bytes, (UIntPtr)FrameLength), library))
                return false;
            byte crc = bytes[CrcByte];
            // A right CRC may be 0 too, so 0 says nothing. [OURS]
            if (crc != 0)
            {
                bytes[CrcByte] = 0;
                byte expected = Crc8.Of(bytes, FrameLength);
                if (crc != expected)
                    return Reason.Is("CRC-8 of the response is 0x{0:X2} instead of 0x{1:X2}; if this comes again and again, the board's CONFIG2 or the link says another slot size than that of this assembly", crc, expected);
                bytes[CrcByte] = crc;
            }
            fixed (transData* to = slots)
                *(Frame*)to = frame;
            return true;
        }

        /// <summary>Makes all of <see cref="cmdData"/> 0.</summary>
        public static void ClearCmdData()
        {
            transData[] slots = cmdData;
            if (slots == null)
                cmdData = new transData[DEF_MA_MAX];
            else
                Array.Clear(slots, 0, slots.Length);
        }

        // A program may put arrays of its own in their places. [OURS] Any other length is refused: a part of a frame is none.
        static bool IsFrame(transData[] slots, string name)
        {
            if (slots == null)
                return Reason.Is("{0} is null; it must be an array of {1} transData (DEF_MA_MAX)", name, DEF_MA_MAX);
            if (slots.Length != DEF_MA_MAX)
                return Reason.Is("{0} has {1} slots; it must have {2} (DEF_MA_MAX)", name, slots.Length, DEF_MA_MAX);
            return true;
        }
    }
}
