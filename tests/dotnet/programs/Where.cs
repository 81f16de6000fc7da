// Opens the board and says by which library, or why not.
using System;
using NEXTWUSB_dotNET;

static class Where
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
