// Opens the board and says by which library, or why not. (A program by the name of one of Windows' own, where.exe, Wine would
// not run.)
using System;
using NEXTWUSB_dotNET;

static class LookUp
{
    static void Main()
    {
        bool open = NEXTWUSB.OpenECMUSB();
        Console.WriteLine("{0} {1}", open, NEXTWUSBDiagnostics.LibraryFile ?? "-");
        Console.WriteLine(NEXTWUSBDiagnostics.LastError);
        Console.WriteLine("{0} {1}", NEXTWUSB.ECMUSBWrite(), NEXTWUSB.ECMUSBRead());
        NEXTWUSB.CloseECMUSB();
    }
}
