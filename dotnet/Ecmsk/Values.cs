// What programs pass and get, in the words of the native API (docs/GUIDE.md).

using System;
using System.Globalization;

namespace Ecmsk
{
    /// <summary>A state of the network.</summary>
    public enum MasterState
    {
        /// <summary>Init: no communication with the slaves.</summary>
        Init = 1,
        /// <summary>PreOP: SDO transfers; here the network is configured.</summary>
        PreOp = 2,
        /// <summary>SafeOP: inputs are exchanged.</summary>
        SafeOp = 4,
        /// <summary>OP: inputs and outputs are exchanged.</summary>
        Op = 8,
    }

    /// <summary>The state byte of a report: the state of the network, or a failure.</summary>
    public struct StateByte : IEquatable<StateByte>
    {
        const byte Failed = 0x10;
        readonly byte value;

        /// <summary>The state byte of that value.</summary>
        /// <param name="value">Byte 2 of slot 0 of a report.</param>
        public StateByte(byte value)
        {
            this.value = value;
        }

        /// <summary>Byte 2 of slot 0 of a report.</summary>
        public byte Value
        {
            get { return value; }
        }

        /// <summary>
        /// The last state that all slaves have reached; null while the network is initialised, and if no slave was found.
        /// </summary>
        public MasterState? State
        {
            get
            {
                int state = value & 0x0F;
                bool isKnown = (value & ~(Failed | 0x0F)) == 0 && (state == 1 || state == 2 || state == 4 || state == 8);
                return isKnown ? (MasterState?)state : null;
            }
        }

        /// <summary>Whether no slave was found, or a slave has not reached a state, or has left it.</summary>
        public bool IsFailed
        {
            get { return value != 0 && ((value & Failed) != 0 || State == null); }
        }

        /// <summary>Whether all slaves are in that state.</summary>
        /// <param name="state">The state.</param>
        /// <returns>False after a failure, too.</returns>
        public bool Is(MasterState state)
        {
            return value == (byte)state;
        }

        /// <summary>Whether two state bytes are the same.</summary>
        /// <param name="other">The other one.</param>
        /// <returns>Whether the values are the same.</returns>
        public bool Equals(StateByte other)
        {
            return value == other.value;
        }

        /// <summary>Whether it is the same state byte.</summary>
        /// <param name="obj">Anything.</param>
        /// <returns>Whether that is a state byte of the same value.</returns>
        public override bool Equals(object obj)
        {
            return obj is StateByte && Equals((StateByte)obj);
        }

        /// <summary>The value.</summary>
        /// <returns>The value.</returns>
        public override int GetHashCode()
        {
            return value;
        }

        /// <summary>The state in words, for example <c>OP</c> or <c>PreOP (a slave failed)</c>.</summary>
        /// <returns>The text.</returns>
        public override string ToString()
        {
            MasterState? state = State;
            if (value == 0)
                return "network initialising";
            if (value == Failed)
                return "no slave found";
            if (state == null)
                return string.Format(
                    CultureInfo.InvariantCulture, "unknown 0x{0:X2} (no slave found, or a slave failed)", value);
            return Name(state.Value) + (IsFailed ? " (a slave failed)" : "");
        }

        // As the guides spell it.
        internal static string Name(MasterState state)
        {
            switch (state)
            {
                case MasterState.PreOp: return "PreOP";
                case MasterState.SafeOp: return "SafeOP";
                case MasterState.Op: return "OP";
                default: return state.ToString();
            }
        }
    }

    /// <summary>The size of a slot in a frame. The pin CONFIG2 of the board selects it.</summary>
    public enum SlotSize
    {
        /// <summary>12 bytes: up to 40 slaves.</summary>
        Bytes12 = 12,
        /// <summary>16 bytes: up to 30 slaves.</summary>
        Bytes16 = 16,
    }

    /// <summary>What a slave is. The board maps its process data by it.</summary>
    public enum SlaveKind
    {
        /// <summary>A servo drive.</summary>
        Drive = 0,
        /// <summary>16 inputs and 16 outputs.</summary>
        Io = 1,
        /// <summary>NEXTW's pulse module, of one or two channels.</summary>
        Hsp = 2,
        /// <summary>A stepper drive.</summary>
        Step = 3,
        /// <summary>Connected, but not used: it stays in PreOP.</summary>
        Unused = 0xF,
    }

    /// <summary>The mode of operation of an axis.</summary>
    public enum Mode
    {
        /// <summary>Cyclic synchronous position.</summary>
        Csp = 8,
        /// <summary>Cyclic synchronous velocity.</summary>
        Csv = 9,
        /// <summary>Cyclic synchronous torque.</summary>
        Cst = 10,
    }

    /// <summary>How a drive is synchronised with the cycle.</summary>
    public enum DriveSync
    {
        /// <summary>The drive runs on its own clock.</summary>
        FreeRun = 0,
        /// <summary>By distributed clocks.</summary>
        DcSync = 1,
    }

    /// <summary>The configuration of one slave, for <see cref="Board.Configure"/>.</summary>
    public sealed class Slave
    {
        // One turn of a motor with a 17-bit encoder.
        const uint DefaultGuard = 131072;

        Slave(SlaveKind kind, Mode mode, DriveSync sync, uint? guard)
        {
            Kind = kind;
            Mode = mode;
            Sync = sync;
            Guard = guard;
        }

        /// <summary>What the slave is.</summary>
        public SlaveKind Kind { get; private set; }

        /// <summary>The mode of operation of its axis.</summary>
        public Mode Mode { get; private set; }

        /// <summary>How its axis is synchronised.</summary>
        public DriveSync Sync { get; private set; }

        /// <summary>
        /// The largest distance, in counts, of a target of an <see cref="AxisStream"/> from the actual position; null: no guard.
        /// </summary>
        public uint? Guard { get; private set; }

        /// <summary>Whether the slave has an axis.</summary>
        public bool HasAxis
        {
            get { return Kind == SlaveKind.Drive || Kind == SlaveKind.Step || Kind == SlaveKind.Hsp; }
        }

        /// <summary>A servo drive.</summary>
        /// <param name="mode">Its mode of operation.</param>
        /// <param name="sync">How it is synchronised with the cycle.</param>
        /// <param name="guard">The guard of a stream, counts; null switches it off.</param>
        /// <returns>The configuration.</returns>
        public static Slave Drive(Mode mode = Mode.Csp, DriveSync sync = DriveSync.DcSync, uint? guard = DefaultGuard)
        {
            return new Slave(SlaveKind.Drive, mode, sync, guard);
        }

        /// <summary>A stepper drive, in CSP.</summary>
        /// <param name="sync">How it is synchronised with the cycle.</param>
        /// <param name="guard">The guard of a stream, counts; null switches it off.</param>
        /// <returns>The configuration.</returns>
        public static Slave Step(DriveSync sync = DriveSync.DcSync, uint? guard = DefaultGuard)
        {
            return new Slave(SlaveKind.Step, Mode.Csp, sync, guard);
        }

        /// <summary>NEXTW's pulse module, in CSP or CSV.</summary>
        /// <param name="mode">Its mode of operation.</param>
        /// <param name="sync">How it is synchronised with the cycle.</param>
        /// <param name="guard">The guard of a stream, counts; null switches it off.</param>
        /// <returns>The configuration.</returns>
        public static Slave Hsp(Mode mode = Mode.Csp, DriveSync sync = DriveSync.DcSync, uint? guard = DefaultGuard)
        {
            return new Slave(SlaveKind.Hsp, mode, sync, guard);
        }

        /// <summary>16 inputs and 16 outputs.</summary>
        public static readonly Slave Io = new Slave(SlaveKind.Io, 0, 0, null);

        /// <summary>A slave that is connected, but not used.</summary>
        public static readonly Slave Unused = new Slave(SlaveKind.Unused, 0, 0, null);
    }

    /// <summary>Index and sub-index of an object of a slave.</summary>
    public struct SdoObject : IEquatable<SdoObject>
    {
        readonly ushort index;
        readonly byte sub;

        /// <summary>The object of that index and sub-index.</summary>
        /// <param name="index">Its index, for example 0x6041.</param>
        /// <param name="subIndex">Its sub-index.</param>
        public SdoObject(ushort index, byte subIndex = 0)
        {
            this.index = index;
            sub = subIndex;
        }

        /// <summary>The index.</summary>
        public ushort Index
        {
            get { return index; }
        }

        /// <summary>The sub-index.</summary>
        public byte SubIndex
        {
            get { return sub; }
        }

        // Data1 of the SDO slot.
        internal uint Word
        {
            get { return (uint)index << 16 | sub; }
        }

        /// <summary>Whether two addresses are the same.</summary>
        /// <param name="other">The other one.</param>
        /// <returns>Whether index and sub-index are the same.</returns>
        public bool Equals(SdoObject other)
        {
            return Word == other.Word;
        }

        /// <summary>Whether it is the same address.</summary>
        /// <param name="obj">Anything.</param>
        /// <returns>Whether that is the same address.</returns>
        public override bool Equals(object obj)
        {
            return obj is SdoObject && Equals((SdoObject)obj);
        }

        /// <summary>Index and sub-index as one number.</summary>
        /// <returns>The number.</returns>
        public override int GetHashCode()
        {
            return (int)Word;
        }

        /// <summary>The address as the guides write it, for example <c>0x6041:0</c>.</summary>
        /// <returns>The text.</returns>
        public override string ToString()
        {
            return string.Format(CultureInfo.InvariantCulture, "0x{0:X4}:{1}", index, sub);
        }
    }

    /// <summary>The limits of waits, and the size of a slot.</summary>
    public sealed class BoardOptions
    {
        /// <summary>The options as they are by default.</summary>
        public BoardOptions()
        {
            ReadLimit = TimeSpan.FromSeconds(1);
            WriteLimit = TimeSpan.FromSeconds(1);
            StateLimit = TimeSpan.FromSeconds(30);
            SdoLimit = TimeSpan.FromSeconds(3);
            ServoLimit = TimeSpan.FromSeconds(5);
        }

        /// <summary>The size of a slot; null: what the link or the first reports show.</summary>
        public SlotSize? SlotSize { get; set; }

        /// <summary>How long a report may take. 1 s by default.</summary>
        public TimeSpan ReadLimit { get; set; }

        /// <summary>How long a frame may take to be written. 1 s by default.</summary>
        public TimeSpan WriteLimit { get; set; }

        /// <summary>How long a change of state may take. 30 s by default.</summary>
        public TimeSpan StateLimit { get; set; }

        /// <summary>How long an SDO transfer may take. 3 s by default.</summary>
        public TimeSpan SdoLimit { get; set; }

        /// <summary>How long switching axes and clearing alarms may take. 5 s by default.</summary>
        public TimeSpan ServoLimit { get; set; }

        internal BoardOptions Copy()
        {
            return (BoardOptions)MemberwiseClone();
        }
    }
}
