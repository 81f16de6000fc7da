// Programs that end without Close. Argument: how. `return` while a background thread reads;
// `exit` from another thread; `throw`; `closed` by another thread, whereupon the read ends.
using System;
using System.Threading;
using NEXTWUSB_dotNET;

static class Endings
{
    static bool ended;
    static int reads;

    static void Read()
    {
        while (NEXTWUSB.ECMUSBRead())
            reads++;
        ended = true;
    }

    static void Main(string[] arguments)
    {
        Check.That(NEXTWUSB.OpenECMUSB(), "the board opens");
        var reader = new Thread(Read) { IsBackground = true };
        reader.Start();
        while (reads < 3)
            Thread.Sleep(1);
        Console.WriteLine("reading");
        switch (arguments[0])
        {
            case "exit":
                new Thread(() => Environment.Exit(7)).Start();
                Thread.Sleep(Timeout.Infinite);
                break;
            case "throw":
                throw new InvalidOperationException("on purpose");
            case "closed":
                NEXTWUSB.CloseECMUSB();
                reader.Join();
                Check.That(ended, "Close ends the read");
                break;
        }
    }
}
