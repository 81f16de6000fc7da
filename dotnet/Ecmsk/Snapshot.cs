// A decoded report.

using System;

namespace Ecmsk
{
    /// <summary>
    /// A decoded report: the board and all slaves in the same cycle. Slots of slaves are refreshed in OP only.
    /// </summary>
    public sealed class Snapshot
    {
        readonly byte[] frame;
        readonly Slave[] slaves;

        internal Snapshot(byte[] frame, SlotSize size, Slave[] slaves, long sequence)
        {
            this.frame = frame;
            this.slaves = slaves;
            SlotSize = size;
            Sequence = sequence;
        }

        // The same report for another configuration.
        internal Snapshot(Snapshot of, Slave[] slaves) : this(of.frame, of.SlotSize, slaves, of.Sequence)
        {
        }

        /// <summary>The size of the slots.</summary>
        public SlotSize SlotSize { get; private set; }

        /// <summary>The number of the report among those that this <see cref="Board"/> has read, from 1.</summary>
        public long Sequence { get; private set; }

        /// <summary>The state of the network.</summary>
        public StateByte State
        {
            get { return new StateByte(frame[2]); }
        }

        /// <summary>
        /// Firmware 1.7: the count of command frames with a wrong CRC, which wraps at 256. Firmware 1.5: a code without a
        /// published meaning.
        /// </summary>
        public byte ErrorByte
        {
            get { return frame[1]; }
        }

        /// <summary>In OP: the free entries of the board's FIFO, 0 to 160.</summary>
        public int FifoFree
        {
            get { return (int)(this[0].Data2 & 0xFFFF); }
        }

        /// <summary>In OP: the count of command frames that found the FIFO full and were lost.</summary>
        public int FullCount
        {
            get { return (int)(this[0].Data2 >> 16); }
        }

        /// <summary>A slot: 0 of the board, then those of the slaves, the last one of SDO transfers.</summary>
        /// <param name="number">Its number: 0 to 41, with slots of 16 bytes 0 to 31.</param>
        /// <returns>A copy of the slot.</returns>
        /// <exception cref="ArgumentOutOfRangeException">There is no such slot.</exception>
        public Slot this[int number]
        {
            get { return Slot.Read(frame, Frames.Number(number, SlotSize), (int)SlotSize); }
        }

        /// <summary>The number of configured slaves.</summary>
        public int Slaves
        {
            get { return slaves.Length; }
        }

        /// <summary>The slot of a drive or a stepper.</summary>
        /// <param name="slave">The number of the slave, from 1.</param>
        /// <returns>What it reports; null if the slave is neither, or not configured.</returns>
        public DriveResponse? Drive(int slave)
        {
            SlaveKind kind = Kind(slave);
            bool isDrive = kind == SlaveKind.Drive || kind == SlaveKind.Step;
            return isDrive ? new DriveResponse(this[slave]) : (DriveResponse?)null;
        }

        /// <summary>The inputs of an IO slave.</summary>
        /// <param name="slave">The number of the slave, from 1.</param>
        /// <returns>
        /// Bit k is input k. Null if the slave is no IO slave or not configured, and while its slot answers a command that has set
        /// its outputs, and so shows those.
        /// </returns>
        public ushort? Inputs(int slave)
        {
            bool isInput = Kind(slave) == SlaveKind.Io && this[slave].Id != (byte)Command.IoWrite;
            return isInput ? (ushort)this[slave].Data1 : (ushort?)null;
        }

        /// <summary>The actual position of a slave's first axis.</summary>
        /// <param name="slave">The number of the slave, from 1.</param>
        /// <returns>Counts; null if the slave has no axis, or is not configured.</returns>
        public int? Position(int slave)
        {
            return HasAxis(slave) ? unchecked((int)this[slave].Data1) : (int?)null;
        }

        /// <summary>The statusword of a slave's first axis, object 0x6041.</summary>
        /// <param name="slave">The number of the slave, from 1.</param>
        /// <returns>The statusword; null if the slave has no axis, or is not configured.</returns>
        public ushort? Statusword(int slave)
        {
            return HasAxis(slave) ? this[slave].Parm : (ushort?)null;
        }

        /// <summary>The bytes of the report: 504, with slots of 16 bytes 512.</summary>
        /// <returns>A copy.</returns>
        public byte[] ToArray()
        {
            var copy = new byte[Frames.Length(SlotSize)];
            Array.Copy(frame, copy, copy.Length);
            return copy;
        }

        internal bool HasAxis(int slave)
        {
            return slave >= 1 && slave <= slaves.Length && slaves[slave - 1].HasAxis;
        }

        internal bool IsEnabled(int slave)
        {
            return (this[slave].Parm & DriveResponse.StateMask) == DriveResponse.OperationEnabled;
        }

        internal bool HasFault(int slave)
        {
            return (this[slave].Parm & DriveResponse.Fault) != 0;
        }

        // The exception for a slave with an alarm.
        internal AlarmException Alarm(int slave)
        {
            DriveResponse? drive = Drive(slave);
            return new AlarmException(slave, drive.HasValue ? drive.Value.ErrorCode : (ushort)0);
        }

        SlaveKind Kind(int slave)
        {
            return slave >= 1 && slave <= slaves.Length ? slaves[slave - 1].Kind : SlaveKind.Unused;
        }
    }

    /// <summary>What a drive or a stepper reports.</summary>
    public struct DriveResponse
    {
        // CiA 402: bits of the statusword that show the state, and their values in Operation enabled.
        internal const int StateMask = 0x6F;
        internal const int OperationEnabled = 0x27;
        internal const int Fault = 0x08;

        readonly Slot slot;

        internal DriveResponse(Slot slot)
        {
            this.slot = slot;
        }

        /// <summary>The statusword, object 0x6041.</summary>
        public ushort Statusword
        {
            get { return slot.Parm; }
        }

        /// <summary>Whether the drive is in Operation enabled.</summary>
        public bool IsEnabled
        {
            get { return (slot.Parm & StateMask) == OperationEnabled; }
        }

        /// <summary>Whether the drive has an alarm.</summary>
        public bool HasAlarm
        {
            get { return (slot.Parm & Fault) != 0; }
        }

        /// <summary>The actual position, object 0x6064, counts.</summary>
        public int Position
        {
            get { return unchecked((int)slot.Data1); }
        }

        /// <summary>The actual torque, object 0x6077, 0.1 % of the rated torque.</summary>
        public short Torque
        {
            get { return unchecked((short)slot.Data2); }
        }

        /// <summary>The error code, object 0x603F; 0: no error.</summary>
        public ushort ErrorCode
        {
            get { return (ushort)(slot.Data2 >> 16); }
        }
    }
}
