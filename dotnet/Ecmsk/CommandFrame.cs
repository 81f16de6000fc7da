// A command frame and its slots (docs/rules/board.md has what each command does). The offsets are those of the C headers.

using System;

namespace Ecmsk
{
    /// <summary>The fields of a slot, as <c>transData</c> of the C headers has them.</summary>
    public struct Slot
    {
        /// <summary>Byte 0: the command; in a report what it answers.</summary>
        public byte Id;
        /// <summary>Byte 1: an index that the program may choose; in a report that index, or an error.</summary>
        public byte Index;
        /// <summary>Bytes 2 and 3: a parameter; in a report of a drive the statusword.</summary>
        public ushort Parm;
        /// <summary>Bytes 4 to 7: a target, an object's address, a position.</summary>
        public uint Data1;
        /// <summary>Bytes 8 to 11: an SDO's value, torque and error code.</summary>
        public uint Data2;
        /// <summary>Bytes 12 to 15, of slots of 16 bytes alone: for NEXTW's pulse module.</summary>
        public uint Data3;

        internal bool IsZero
        {
            get { return Id == 0 && Index == 0 && Parm == 0 && Data1 == 0 && Data2 == 0 && Data3 == 0; }
        }

        internal static Slot Read(byte[] frame, int number, int size)
        {
            int at = number * size;
            return new Slot
            {
                Id = frame[at],
                Index = frame[at + 1],
                Parm = (ushort)(frame[at + 2] | frame[at + 3] << 8),
                Data1 = Word(frame, at + 4),
                Data2 = Word(frame, at + 8),
                Data3 = size == 16 ? Word(frame, at + 12) : 0,
            };
        }

        internal void Write(byte[] frame, int number, int size)
        {
            int at = number * size;
            frame[at] = Id;
            frame[at + 1] = Index;
            frame[at + 2] = (byte)Parm;
            frame[at + 3] = (byte)(Parm >> 8);
            PutWord(frame, at + 4, Data1);
            PutWord(frame, at + 8, Data2);
            if (size == 16)
                PutWord(frame, at + 12, Data3);
        }

        static uint Word(byte[] frame, int at)
        {
            return (uint)(frame[at] | frame[at + 1] << 8 | frame[at + 2] << 16 | frame[at + 3] << 24);
        }

        static void PutWord(byte[] frame, int at, uint word)
        {
            for (int i = 0; i < 4; i++)
                frame[at + i] = (byte)(word >> 8 * i);
        }
    }

    // The codes of commands (docs/rules/board.md, SK-4).
    enum Command : byte
    {
        GetStatus = 0x00,
        SetState = 0x01,
        SetAxis = 0x02,
        SetDc = 0x03,
        DriveMode = 0x06,
        SdoRead = 0x07,
        SdoWrite = 0x08,
        AlarmClear = 0x10,
        ServoOn = 0x11,
        ServoOff = 0x12,
        IoRead = 0x13,
        IoWrite = 0x14,
        Csp = 0x15,
        Csv = 0x16,
        Cst = 0x17,
    }

    /// <summary>
    /// A command frame: at most one command for the board, for each slave and for the SDO slot. In OP the board executes one
    /// frame in each cycle. <see cref="Board.Write"/> fills in the CRC.
    /// </summary>
    public sealed class CommandFrame
    {
        internal readonly byte[] Bytes;

        /// <summary>A frame without commands, for boards with slots of that size.</summary>
        /// <param name="size">The size of its slots: <see cref="Board.SlotSize"/>.</param>
        /// <exception cref="ArgumentOutOfRangeException">There is no such size.</exception>
        public CommandFrame(SlotSize size)
        {
            if (size != SlotSize.Bytes12 && size != SlotSize.Bytes16)
                throw new ArgumentOutOfRangeException("size", "a slot has 12 or 16 bytes");
            SlotSize = size;
            Bytes = new byte[Frames.Length(size)];
        }

        internal CommandFrame(CommandFrame of)
        {
            SlotSize = of.SlotSize;
            Bytes = (byte[])of.Bytes.Clone();
        }

        /// <summary>The size of the slots.</summary>
        public SlotSize SlotSize { get; private set; }

        /// <summary>
        /// A slot: 0 for the board, then those of the slaves, the last one for SDO transfers. Byte 3 of slot 0 is the CRC, which
        /// is filled in when the frame is written.
        /// </summary>
        /// <param name="number">Its number: 0 to 41, with slots of 16 bytes 0 to 31.</param>
        /// <returns>A copy of the slot.</returns>
        /// <exception cref="ArgumentOutOfRangeException">There is no such slot.</exception>
        public Slot this[int number]
        {
            get { return Slot.Read(Bytes, Frames.Number(number, SlotSize), (int)SlotSize); }
            set { value.Write(Bytes, Frames.Number(number, SlotSize), (int)SlotSize); }
        }

        /// <summary>Removes all commands.</summary>
        public void Clear()
        {
            Array.Clear(Bytes, 0, Bytes.Length);
        }

        /// <summary>The target position of an axis in CSP.</summary>
        /// <param name="slave">The number of the slave, from 1.</param>
        /// <param name="target">The absolute target, counts.</param>
        /// <exception cref="ArgumentOutOfRangeException">There is no slot for that slave.</exception>
        public void Csp(int slave, int target)
        {
            Put(slave, Command.Csp, unchecked((uint)target));
        }

        /// <summary>The target velocity of an axis in CSV. The axis keeps it until another one comes.</summary>
        /// <param name="slave">The number of the slave, from 1.</param>
        /// <param name="velocity">The target, in the unit of the drive.</param>
        /// <exception cref="ArgumentOutOfRangeException">There is no slot for that slave.</exception>
        public void Csv(int slave, int velocity)
        {
            Put(slave, Command.Csv, unchecked((uint)velocity));
        }

        /// <summary>The target torque of an axis in CST. The axis keeps it until another one comes.</summary>
        /// <param name="slave">The number of the slave, from 1.</param>
        /// <param name="torque">The target, 0.1 % of the rated torque.</param>
        /// <exception cref="ArgumentOutOfRangeException">There is no slot for that slave.</exception>
        public void Cst(int slave, short torque)
        {
            Put(slave, Command.Cst, unchecked((uint)(int)torque));
        }

        /// <summary>The outputs of an IO slave.</summary>
        /// <param name="slave">The number of the slave, from 1.</param>
        /// <param name="bits">Bit k is output k.</param>
        /// <exception cref="ArgumentOutOfRangeException">There is no slot for that slave.</exception>
        public void Outputs(int slave, ushort bits)
        {
            Put(slave, Command.IoWrite, bits);
        }

        void Put(int slave, Command command, uint data1)
        {
            if (slave < 1 || slave > Frames.MaxSlaves(SlotSize))
                throw new ArgumentOutOfRangeException("slave", slave, "slaves have the numbers 1 to " + Frames.MaxSlaves(SlotSize));
            this[slave] = new Slot { Id = (byte)command, Data1 = data1 };
        }
    }

    // Lengths and the CRC-8 of frames.
    static class Frames
    {
        // Bytes of the longest frame; a report is read with this length.
        public const int MaxLength = 512;
        // Entries of the board's FIFO.
        public const int FifoEntries = 160;
        const int CrcByte = 3;

        public static int Slots(SlotSize size)
        {
            return size == SlotSize.Bytes12 ? 42 : 32;
        }

        public static int Length(SlotSize size)
        {
            return Slots(size) * (int)size;
        }

        public static int MaxSlaves(SlotSize size)
        {
            return Slots(size) - 2;
        }

        public static int SdoSlot(SlotSize size)
        {
            return Slots(size) - 1;
        }

        public static int Number(int number, SlotSize size)
        {
            if (number < 0 || number >= Slots(size))
                throw new ArgumentOutOfRangeException("number", number, "slots have the numbers 0 to " + (Slots(size) - 1));
            return number;
        }

        // The CRC-8 over a frame of that size, with byte 3 taken as 0: x^8+x^2+x+1, initial value 0x5A.
        public static byte Crc(byte[] frame, SlotSize size)
        {
            int crc = 0x5A;
            for (int i = 0; i < Length(size); i++)
            {
                crc ^= i == CrcByte ? 0 : frame[i];
                crc = Table[crc & 0xFF];
            }
            return (byte)crc;
        }

        public static byte CrcFound(byte[] frame)
        {
            return frame[CrcByte];
        }

        public static void FillCrc(byte[] frame, SlotSize size)
        {
            frame[CrcByte] = Crc(frame, size);
        }

        static readonly byte[] Table = MakeTable();

        static byte[] MakeTable()
        {
            var table = new byte[256];
            for (int value = 0; value < table.Length; value++)
            {
                int crc = value;
                for (int bit = 0; bit < 8; bit++)
                    crc = (crc & 0x80) != 0 ? crc << 1 ^ 0x07 : crc << 1;
                table[value] = (byte)crc;
            }
            return table;
        }
    }
}
