// What calls throw. Messages are the library's own, or say what happened, to what, and what to do, as they do.

using System;
using System.Globalization;

namespace Ecmsk
{
    /// <summary>The kind of an error. Those below 0 are the result codes of <c>include/ecmsk.h</c>.</summary>
    public enum ErrorKind
    {
        /// <summary>The URI or another argument is not valid.</summary>
        Argument = -1,
        /// <summary>Nothing has come, or the effect of a command was not seen, within the limit.</summary>
        Timeout = -3,
        /// <summary>The link has virtual time, and the board makes no reports however long one waits.</summary>
        Silent = -4,
        /// <summary>The board was unplugged or does not answer any more: dispose of it and open it again.</summary>
        Lost = -5,
        /// <summary>The board was closed during the call.</summary>
        Closed = -6,
        /// <summary>There is no board that the link could open.</summary>
        NoBoard = -7,
        /// <summary>Another program, or another <see cref="Board"/>, uses the board.</summary>
        InUse = -8,
        /// <summary>The link does not support the call.</summary>
        Unsupported = -9,
        /// <summary>A call of the operating system has failed.</summary>
        Io = -10,
        /// <summary>A defect of the library.</summary>
        Internal = -11,
        /// <summary>Neither the link nor a report shows the size of a slot: see <see cref="BoardOptions.SlotSize"/>.</summary>
        SlotUnknown = 1,
        /// <summary>The configuration cannot be used. Nothing of it was sent.</summary>
        Config = 2,
        /// <summary>The state of the network does not allow the call.</summary>
        WrongState = 3,
        /// <summary>A change of state has ended in another state.</summary>
        StateStuck = 4,
        /// <summary>The board has found another number of slaves than are configured.</summary>
        SlaveCount = 5,
        /// <summary>No slave of that number is configured.</summary>
        NoSuchSlave = 6,
        /// <summary>The slave has no axis, or no inputs and outputs.</summary>
        WrongKind = 7,
        /// <summary>The drive has an alarm: see <see cref="AlarmException"/>.</summary>
        Alarm = 8,
        /// <summary>A slave has aborted an SDO transfer: see <see cref="SdoAbortedException"/>.</summary>
        SdoAborted = 9,
        /// <summary>A target is further from the actual position than the guard of the axis allows.</summary>
        TooFar = 10,
        /// <summary>The axis is not in Operation enabled, or another call has switched it off while it was switched on.</summary>
        NotEnabled = 11,
        /// <summary>A value is outside of what the call takes.</summary>
        Setting = 12,
        /// <summary>The board has one stream at a time, and it is open.</summary>
        Busy = 13,
        /// <summary>The value of an object does not fit the type with which it was read.</summary>
        SdoTooWide = 14,
    }

    /// <summary>An error of the library or of the board. Its message says what happened and what to do.</summary>
    public class EcmskException : Exception
    {
        /// <summary>An error of that kind.</summary>
        /// <param name="kind">What kind of error it is.</param>
        /// <param name="message">What happened, to what, and what to do.</param>
        public EcmskException(ErrorKind kind, string message) : base(message)
        {
            Kind = kind;
        }

        /// <summary>What kind of error it is.</summary>
        public ErrorKind Kind { get; private set; }

        internal static EcmskException Of(ErrorKind kind, string format, params object[] values)
        {
            return new EcmskException(kind, string.Format(CultureInfo.InvariantCulture, format, values));
        }
    }

    /// <summary>The drive has an alarm.</summary>
    public sealed class AlarmException : EcmskException
    {
        internal AlarmException(int slave, ushort code)
            : base(ErrorKind.Alarm, string.Format(
                CultureInfo.InvariantCulture,
                "slave {0} has alarm 0x{1:X4}; remove the cause (drive's manual), then ClearAlarm and ServoOn", slave, code))
        {
            Slave = slave;
            Code = code;
        }

        /// <summary>The number of the slave, from 1.</summary>
        public int Slave { get; private set; }

        /// <summary>The error code, object 0x603F; 0 for a pulse module, whose reports have none.</summary>
        public ushort Code { get; private set; }
    }

    /// <summary>A slave has aborted an SDO transfer.</summary>
    public sealed class SdoAbortedException : EcmskException
    {
        internal SdoAbortedException(bool isRead, int slave, SdoObject address, uint code)
            : base(ErrorKind.SdoAborted, string.Format(
                CultureInfo.InvariantCulture,
                "{0} {1} of slave {2} was aborted with 0x{3:X8}{4}; check object, size and state in the slave's manual",
                isRead ? "reading" : "writing", address, slave, code, Meaning(code)))
        {
            Slave = slave;
            Object = address;
            Code = code;
        }

        /// <summary>The number of the slave, from 1.</summary>
        public int Slave { get; private set; }

        /// <summary>Index and sub-index of the object.</summary>
        public SdoObject Object { get; private set; }

        /// <summary>The abort code (ETG.1000.6), for example 0x06020000: there is no such object.</summary>
        public uint Code { get; private set; }

        // The codes that programs meet.
        static string Meaning(uint code)
        {
            switch (code)
            {
                case 0x05040000: return ": SDO protocol timeout";
                case 0x06010001: return ": attempt to read a write-only object";
                case 0x06010002: return ": attempt to write a read-only object";
                case 0x06020000: return ": object does not exist in the object dictionary";
                case 0x06070010: return ": data type does not match, length of service parameter does not match";
                case 0x06070012: return ": data type does not match, length of service parameter too high";
                case 0x06070013: return ": data type does not match, length of service parameter too low";
                case 0x06090011: return ": sub-index does not exist";
                case 0x06090030: return ": value range of parameter exceeded";
                case 0x08000000: return ": general error";
                case 0x08000022: return ": data cannot be transferred or stored because of the present device state";
                default: return "";
            }
        }
    }
}
