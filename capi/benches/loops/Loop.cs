// The loop of a program on NEXTWUSB_dotNET: a frame out, a response in. A line with a number of rounds comes in, the time of one
// in nanoseconds goes out, until there is no line any more.
using System;
using System.Diagnostics;
using System.Globalization;
using NEXTWUSB_dotNET;

static class Loop
{
    static int Main()
    {
        if (!NEXTWUSB.OpenECMUSB())
        {
            Console.Error.WriteLine(NEXTWUSBDiagnostics.LastError);
            return 1;
        }
        string line;
        while ((line = Console.ReadLine()) != null)
        {
            int rounds = int.Parse(line, CultureInfo.InvariantCulture);
            Stopwatch time = Stopwatch.StartNew();
            for (int i = 0; i < rounds; i++)
            {
                NEXTWUSB.cmdData[1].Data1 = (uint)i;
                if (!NEXTWUSB.ECMUSBWrite() || !NEXTWUSB.ECMUSBRead())
                    return 1;
            }
            double nanoseconds = time.ElapsedTicks * 1e9 / Stopwatch.Frequency;
            Console.WriteLine((nanoseconds / rounds).ToString("F1", CultureInfo.InvariantCulture));
        }
        return 0;
    }
}
