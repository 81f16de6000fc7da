// The CRC-8 of frames (UG17 2.2): x^8+x^2+x+1, initial value 0x5A. The vendor's class, with its exceptions and its loop.

using System;

#if SLOTS_OF_16_BYTES
namespace NEXTWUSB_dotNET_16B
#elif NAMED_12B
namespace NEXTWUSB_dotNET_12B
#else
namespace NEXTWUSB_dotNET
#endif
{
    /// <summary>
    /// The CRC-8 of frames. A program that has switched on the check of commands (<see cref="NEXTWUSB.SDO_EX"/>) puts it into
    /// the upper byte of Parm in slot 0, computed over the whole frame with 0 there.
    /// </summary>
    public static class CRC8
    {
        const byte Polynomial = 0x07;
        const byte Initial = 0x5A;

        static readonly byte[] Table = MakeTable();

        static byte[] MakeTable()
        {
            byte[] table = new byte[256];
            for (int value = 0; value < table.Length; value++)
            {
                int crc = value;
                for (int bit = 0; bit < 8; bit++)
                    crc = (crc & 0x80) != 0 ? crc << 1 ^ Polynomial : crc << 1;
                table[value] = (byte)crc;
            }
            return table;
        }

        /// <summary>The CRC-8 of all bytes of <paramref name="buffer"/>.</summary>
        /// <param name="buffer">The bytes, with 0 where a frame has its CRC-8.</param>
        /// <returns>The CRC-8.</returns>
        /// <exception cref="NullReferenceException"><paramref name="buffer"/> is null.</exception>
        public static byte CRC(byte[] buffer)
        {
            return CRC(buffer, 0, buffer.Length);
        }

        /// <summary>
        /// The CRC-8 of the bytes from index <paramref name="off"/> to before index <paramref name="len"/>.
        /// </summary>
        /// <param name="buffer">The bytes, with 0 where a frame has its CRC-8.</param>
        /// <param name="off">The index of the first byte.</param>
        /// <param name="len">The index behind the last byte: a length only if <paramref name="off"/> is 0.</param>
        /// <returns>The CRC-8; the initial value 0x5A if there is no byte.</returns>
        /// <exception cref="ArgumentNullException"><paramref name="buffer"/> is null.</exception>
        /// <exception cref="ArgumentOutOfRangeException">
        /// One of them is negative, or their sum is more than <paramref name="buffer"/> has.
        /// </exception>
        public static byte CRC(byte[] buffer, int off, int len)
        {
            if (buffer == null)
                throw new ArgumentNullException("buffer");
            if (off < 0)
                throw new ArgumentOutOfRangeException("off");
            // So that the sum has no overflow.
            if (len < 0 || len > buffer.Length - off)
                throw new ArgumentOutOfRangeException("len");
            byte crc = Initial;
            // As the vendor's, whose `len` is checked as a length and used as an end.
            for (int i = off; i < len; i++)
                crc = Table[crc ^ buffer[i]];
            return crc;
        }
    }
}
