// The CRC-8 of a frame (UG17 2.2): x^8+x^2+x+1, initial value 0x5A, over the frame with its byte 3 as 0.

using System;

namespace Ecmsk
{
    static class Crc8
    {
        const byte Polynomial = 0x07;
        const byte Initial = 0x5A;

        // Modulo this polynomial x^127 is 1, and so is x^1016: bytes that are 127 apart count the same.
        const int Period = 127;

        // Eight tables of 256: what a byte does to the CRC with 0 to 7 bytes behind it.
        const int TableSize = 256;
        static readonly byte[] Tables = MakeTables();

        // What is folded: a multiple of 8 that has a period.
        const int FoldedLength = 128;

        unsafe struct Folded
        {
            public fixed byte Bytes[FoldedLength];
        }

        static byte[] MakeTables()
        {
            byte[] tables = new byte[8 * TableSize];
            for (int value = 0; value < TableSize; value++)
            {
                int crc = value;
                for (int bit = 0; bit < 8; bit++)
                    crc = (crc & 0x80) != 0 ? crc << 1 ^ Polynomial : crc << 1;
                tables[value] = (byte)crc;
            }
            for (int i = TableSize; i < tables.Length; i++)
                tables[i] = tables[tables[i - TableSize]];
            return tables;
        }

        // Of more than two periods. Every frame is gone through twice a cycle, so it is folded to one period first, eight bytes at a
        // time: a quarter of the look-ups.
        public static unsafe byte Of(byte* bytes, int length)
        {
            Folded folded;
            ulong* sum = (ulong*)folded.Bytes;
            // The last two periods, each with the byte before it: so they are a multiple of 8.
            byte* last = bytes + length - FoldedLength;
            byte* other = last - Period;
            for (int i = 0; i < FoldedLength / 8; i++)
                sum[i] = *(ulong*)(last + 8 * i) ^ *(ulong*)(other + 8 * i);
            // Those before them; the first one is seldom whole.
            byte* period = folded.Bytes + 1;
            byte* block = other + 1;
            while (block > bytes)
            {
                int part = Math.Min(Period, (int)(block - bytes));
                block -= part;
                Add(block, part, period + Period - part);
                // The initial value counts as a change of the frame's first byte.
                if (block == bytes)
                    period[Period - part] ^= Initial;
            }
            // In front of them stands what was too much; 0 does nothing to a CRC that begins with 0.
            folded.Bytes[0] = 0;
            return Plain(folded.Bytes, FoldedLength);
        }

        static unsafe void Add(byte* from, int length, byte* to)
        {
            int i = 0;
            for (; i + 8 <= length; i += 8)
                *(ulong*)(to + i) ^= *(ulong*)(from + i);
            for (; i < length; i++)
                to[i] ^= from[i];
        }

        // With the initial value 0, of a multiple of 8 bytes.
        static unsafe byte Plain(byte* bytes, int length)
        {
            fixed (byte* table = Tables)
            {
                uint crc = 0;
                for (byte* end = bytes + length; bytes < end; bytes += 8)
                {
                    // Two loads instead of eight: little-endian, as every machine that .NET runs on.
                    uint low = *(uint*)bytes ^ crc;
                    uint high = *(uint*)(bytes + 4);
                    crc = (uint)(table[7 * TableSize + (low & 0xFF)] ^ table[6 * TableSize + (low >> 8 & 0xFF)]
                        ^ table[5 * TableSize + (low >> 16 & 0xFF)] ^ table[4 * TableSize + (low >> 24)]
                        ^ table[3 * TableSize + (high & 0xFF)] ^ table[2 * TableSize + (high >> 8 & 0xFF)]
                        ^ table[TableSize + (high >> 16 & 0xFF)] ^ table[high >> 24]);
                }
                return (byte)crc;
            }
        }
    }
}
