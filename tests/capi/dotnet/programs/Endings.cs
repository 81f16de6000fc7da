// Programs that end without Close. Arguments: how. `return` while a background thread reads;
// `exit` from another thread; `throw`; `closed` by another thread, whereupon the read ends. With `silent` behind it the board
// sends nothing, and the thread stays in its read; with `handler` a handler of ProcessExit closes the board.
using System;
using System.Threading;
using NEXTWUSB_dotNET;

static class Endings
{
    static bool ended;
    static volatile bool reading;
    static int reads;

    static void Read()
    {
        reading = true;
        while (NEXTWUSB.ECMUSBRead())
            reads++;
        ended = true;
    }

    static void Main(string[] arguments)
    {
        Check.That(NEXTWUSB.OpenECMUSB(), "the board opens");
        var reader = new Thread(Read) { IsBackground = true };
        reader.Start();
        bool silent = Array.IndexOf(arguments, "silent") > 0;
        while (silent ? !reading : reads < 3)
            Thread.Sleep(1);
        // Until it is in the read.
        if (silent)
            Thread.Sleep(50);
        if (Array.IndexOf(arguments, "handler") > 0)
            AppDomain.CurrentDomain.ProcessExit += (sender, nothing) => NEXTWUSB.CloseECMUSB();
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
