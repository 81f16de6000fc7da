// Opens the board and prints by which library, or why not. (Wine would not run a program with the name of one of Windows' own,
// where.exe.)
using System;
using NEXTWUSB_dotNET;

static class LookUp
{
    static string Try(Func<bool> call)
    {
        try
        {
            return call().ToString();
        }
        catch (DllNotFoundException missing)
        {
            return missing.Message == NEXTWUSBDiagnostics.LastError ? "DllNotFoundException" : "not the reason: " + missing.Message;
        }
    }

    static void Main()
    {
        string open = Try(NEXTWUSB.OpenECMUSB);
        Console.WriteLine("{0} {1}", open, NEXTWUSBDiagnostics.LibraryFile ?? "-");
        Console.WriteLine(NEXTWUSBDiagnostics.LastError);
        Console.WriteLine("{0} {1}", Try(NEXTWUSB.ECMUSBWrite), Try(NEXTWUSB.ECMUSBRead));
        string close = Try(() => { NEXTWUSB.CloseECMUSB(); return true; });
        if (close != "True")
            Console.WriteLine("close {0}", close);
    }
}
