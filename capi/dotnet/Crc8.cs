// The CRC-8 of a frame (UG17 2.2): x^8+x^2+x+1, initial value 0x5A, over the frame with its byte 3 as 0.

namespace Ecmsk
{
    static class Crc8
    {
        const byte Polynomial = 0x07;
        const byte Initial = 0x5A;

        // Eight tables of 256: what a byte does to the CRC with 0 to 7 bytes behind it. Every frame is gone through twice a
        // cycle, so eight bytes at a time.
        const int TableSize = 256;
        static readonly byte[] Tables = MakeTables();

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

        // `length` is a multiple of 8.
        public static unsafe byte Of(byte* bytes, int length)
        {
            fixed (byte* table = Tables)
            {
                uint crc = Initial;
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
