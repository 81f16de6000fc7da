// SDO transfers, one at a time.

using System;
using System.Collections.Generic;

namespace Ecmsk
{
    public sealed partial class Board
    {
        // Objects of every slave, one of which is read before a request that equals the last one: device type, vendor id.
        static readonly SdoObject[] InBetween = { new SdoObject(0x1000), new SdoObject(0x1018, 1) };
        // In the SDO slot of a report: the transfer was aborted, and Data2 is the abort code. [OURS]
        const int Aborted = 0x8000;

        /// <summary>Reads an object of a slave, in PreOP, SafeOP or OP.</summary>
        /// <typeparam name="T">byte, sbyte, ushort, short, uint or int.</typeparam>
        /// <param name="slave">The number of the slave, from 1.</param>
        /// <param name="index">The object's index.</param>
        /// <param name="subIndex">Its sub-index.</param>
        /// <returns>The value.</returns>
        /// <exception cref="SdoAbortedException">The slave has refused.</exception>
        /// <exception cref="EcmskException">No answer within <see cref="BoardOptions.SdoLimit"/>, or the value does not fit
        /// the type.</exception>
        /// <exception cref="ArgumentException">Another type.</exception>
        /// <exception cref="ObjectDisposedException">The board was disposed of before.</exception>
        /// <remarks>
        /// In OP the thread that steps a stream leaves a gap in its motion by this call. In another thread it does not.
        /// </remarks>
        public T SdoRead<T>(int slave, ushort index, byte subIndex = 0) where T : struct
        {
            int bytes = SizeOf(typeof(T));
            var address = new SdoObject(index, subIndex);
            uint raw = Transfer(true, slave, address, 0, 0);
            if (bytes < 4 && raw >> 8 * bytes != 0)
                throw EcmskException.Of(
                    ErrorKind.SdoTooWide, "{0} of slave {1} is 0x{2:X}, too wide for {3} bits; read it as a wider type",
                    address, slave, raw, 8 * bytes);
            unchecked
            {
                object value = typeof(T) == typeof(byte) ? (byte)raw
                    : typeof(T) == typeof(sbyte) ? (sbyte)raw
                    : typeof(T) == typeof(ushort) ? (ushort)raw
                    : typeof(T) == typeof(short) ? (short)raw
                    : typeof(T) == typeof(int) ? (int)raw
                    : (object)raw;
                return (T)value;
            }
        }

        /// <summary>Writes an object of a slave, in PreOP, SafeOP or OP, with the size of the type.</summary>
        /// <typeparam name="T">byte, sbyte, ushort, short, uint or int.</typeparam>
        /// <param name="slave">The number of the slave, from 1.</param>
        /// <param name="index">The object's index.</param>
        /// <param name="subIndex">Its sub-index.</param>
        /// <param name="value">The value.</param>
        /// <exception cref="SdoAbortedException">The slave has refused.</exception>
        /// <exception cref="EcmskException">As for <see cref="SdoRead{T}"/>.</exception>
        /// <exception cref="ArgumentException">Another type.</exception>
        /// <exception cref="ObjectDisposedException">The board was disposed of before.</exception>
        public void SdoWrite<T>(int slave, ushort index, byte subIndex, T value) where T : struct
        {
            int bytes = SizeOf(typeof(T));
            unchecked
            {
                object boxed = value;
                uint raw = boxed is byte ? (byte)boxed
                    : boxed is sbyte ? (byte)(sbyte)boxed
                    : boxed is ushort ? (ushort)boxed
                    : boxed is short ? (ushort)(short)boxed
                    : boxed is int ? (uint)(int)boxed
                    : (uint)boxed;
                Transfer(false, slave, new SdoObject(index, subIndex), bytes, raw);
            }
        }

        static int SizeOf(Type type)
        {
            if (type == typeof(byte) || type == typeof(sbyte))
                return 1;
            if (type == typeof(ushort) || type == typeof(short))
                return 2;
            if (type == typeof(uint) || type == typeof(int))
                return 4;
            throw new ArgumentException("an SDO value is byte, sbyte, ushort, short, uint or int, not " + type.Name, "T");
        }

        uint Transfer(bool isRead, int slave, SdoObject address, int bytes, uint value)
        {
            lock (calls)
            {
                Drain();
                StateByte found = Snapshot.State;
                if (found.State == null || found.State < MasterState.PreOp)
                    throw WrongState("an SDO", "PreOP, SafeOP or OP", found);
                int max = Frames.MaxSlaves(SlotSize);
                if (slave < 1 || slave > max)
                    throw EcmskException.Of(
                        ErrorKind.NoSuchSlave, "there is no slave {0}; with slots of {1} bytes slaves have the numbers 1 to {2}",
                        slave, (int)SlotSize, max);
                // The SDO slot shows an answer until the next one. An equal request would take the old answer for its own.
                if (isSdoLate || IsAnswer(Snapshot, isRead, slave, address))
                {
                    Once(true, slave, InBetween[address.Equals(InBetween[0]) ? 1 : 0], 0, 0);
                    isSdoLate = false;
                }
                Slot answer = Once(isRead, slave, address, bytes, value);
                if ((answer.Parm & Aborted) != 0)
                    throw new SdoAbortedException(isRead, slave, address, answer.Data2);
                return answer.Data2;
            }
        }

        // One transfer: its answer, which may be an abort.
        Slot Once(bool isRead, int slave, SdoObject address, int bytes, uint value)
        {
            int at = Frames.SdoSlot(SlotSize);
            var command = new Slot
            {
                Id = (byte)(isRead ? Command.SdoRead : Command.SdoWrite),
                Parm = (ushort)(slave | bytes << 8),
                Data1 = address.Word,
                Data2 = value,
            };
            isSdoLate = true;
            Snapshot report = Run(
                isRead ? "an SDO read" : "an SDO write",
                "see whether the slave is on the network, and give it more time with BoardOptions.SdoLimit",
                options.SdoLimit, new Dictionary<int, Slot> { { at, command } }, true,
                seen => string.Format("slave {0} has not answered for {1}", slave, address),
                seen => IsAnswer(seen, isRead, slave, address));
            isSdoLate = false;
            return report[at];
        }

        bool IsAnswer(Snapshot report, bool isRead, int slave, SdoObject address)
        {
            Slot slot = report[Frames.SdoSlot(SlotSize)];
            return slot.Id == (byte)(isRead ? Command.SdoRead : Command.SdoWrite)
                && (slot.Parm & ~Aborted) == slave && slot.Data1 == address.Word;
        }
    }
}
