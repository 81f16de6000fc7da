// The loop of a program in C#: a frame out, a response in. By NEXTWUSB_dotNET; with the argument `declared` by declarations of its
// own; with `copy` no calls, but what goes along with them: a copy of the frame and one of the response. A line with a number of
// rounds comes in, the time of one in nanoseconds goes out, until there is no line any more.
using System;
using System.Diagnostics;
using System.Globalization;
using System.Runtime.InteropServices;
using NEXTWUSB_dotNET;

static class Loop
{
    [DllImport("NEXTWUSBLib")]
    [return: MarshalAs(UnmanagedType.I1)]
    static extern bool ECMUSBWrite(byte[] data, uint dwlength);
    [DllImport("NEXTWUSBLib")]
    [return: MarshalAs(UnmanagedType.I1)]
    static extern bool ECMUSBRead(byte[] data, uint dwlength);

    const int LENGTH = 504;
    static readonly byte[] command = new byte[LENGTH];
    static readonly byte[] response = new byte[LENGTH];
    static readonly IntPtr memory = Marshal.AllocHGlobal(LENGTH);

    static bool ByAssembly(int rounds)
    {
        for (int i = 0; i < rounds; i++)
        {
            NEXTWUSB.cmdData[1].Data1 = (uint)i;
            if (!NEXTWUSB.ECMUSBWrite() || !NEXTWUSB.ECMUSBRead())
                return false;
        }
        return true;
    }

    static bool ByDeclarations(int rounds)
    {
        for (int i = 0; i < rounds; i++)
        {
            command[16] = (byte)i;
            if (!ECMUSBWrite(command, LENGTH) || !ECMUSBRead(response, LENGTH))
                return false;
        }
        return true;
    }

    static bool Copies(int rounds)
    {
        for (int i = 0; i < rounds; i++)
        {
            command[16] = (byte)i;
            Marshal.Copy(command, 0, memory, LENGTH);
            Marshal.Copy(memory, response, 0, LENGTH);
        }
        return response[16] == (byte)(rounds - 1);
    }

    static int Main(string[] arguments)
    {
        string way = arguments.Length > 0 ? arguments[0] : "";
        Func<int, bool> run = way == "declared" ? ByDeclarations : way == "copy" ? Copies : (Func<int, bool>)ByAssembly;
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
            if (!run(rounds))
                return 1;
            double nanoseconds = time.ElapsedTicks * 1e9 / Stopwatch.Frequency;
            Console.WriteLine((nanoseconds / rounds).ToString("F1", CultureInfo.InvariantCulture));
        }
        return 0;
    }
}
