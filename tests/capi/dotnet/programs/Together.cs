// A thread waits in a read of a board that sends nothing; another one writes meanwhile, and ends the read by Close.
using System;
using System.Threading;
using NEXTWUSB_dotNET;

static class Together
{
    static volatile bool reading, hasRead = true;

    static void Main()
    {
        Check.That(NEXTWUSB.OpenECMUSB(), "the board opens");
        var reader = new Thread(() =>
        {
            reading = true;
            hasRead = NEXTWUSB.ECMUSBRead();
        });
        reader.Start();
        while (!reading)
            Thread.Sleep(1);
        // Until it is in the read.
        Thread.Sleep(50);
        for (int i = 0; i < 10; i++)
            Check.That(NEXTWUSB.ECMUSBWrite(), "a write beside a read");
        Check.That(!NEXTWUSB.checkCRCValue(), "nothing was read");
        Check.That(reader.IsAlive, "the read still waits");
        NEXTWUSB.CloseECMUSB();
        reader.Join();
        Check.That(!hasRead, "Close ends the read");
        Console.WriteLine("ok");
    }
}
