// Calls at wrong times and with other arrays: they do no harm, and a call that returns false has a reason.
using System;
using System.Threading;
using NEXTWUSB_dotNET;

static class Misuse
{
    static readonly string[] RESULTS = new string[2];

    // Sometimes objects' finalisers make the calls that a program has forgotten.
    class Forgotten
    {
        ~Forgotten()
        {
            RESULTS[0] = string.Format("{0} {1}", NEXTWUSB.ECMUSBWrite(), NEXTWUSB.ECMUSBRead());
            NEXTWUSB.CloseECMUSB();
            RESULTS[1] = string.Format("{0} {1}", NEXTWUSB.ECMUSBWrite(), NEXTWUSBDiagnostics.LastError);
        }
    }

    static void NothingIsOpen()
    {
        Check.That(!NEXTWUSB.ECMUSBWrite(), "a write is false");
        Check.Says("OpenECMUSB");
        Check.That(!NEXTWUSB.ECMUSBRead(), "a read is false");
        Check.Says("OpenECMUSB");
        NEXTWUSB.CloseECMUSB();
        NEXTWUSB.CloseECMUSB();
    }

    static bool Throws<E>(Action call) where E : Exception
    {
        try
        {
            call();
            return false;
        }
        catch (E)
        {
            return true;
        }
    }

    static void OtherArrays()
    {
        NEXTWUSB.transData[] commands = NEXTWUSB.cmdData, responses = NEXTWUSB.respData;
        foreach (int length in new[] { 0, 1, NEXTWUSB.DEF_MA_MAX - 1, NEXTWUSB.DEF_MA_MAX + 1, 10000 })
        {
            NEXTWUSB.cmdData = new NEXTWUSB.transData[length];
            Check.That(NEXTWUSB.ECMUSBWrite(), "a write of " + length + " slots is true");
            NEXTWUSB.respData = new NEXTWUSB.transData[length];
            Check.That(NEXTWUSB.ECMUSBRead(), "a read of " + length + " slots is true");
            if (length > 0)
                Check.That((NEXTWUSB.respData[0].Parm & 0xFF) == NEXTWUSB.STATE_PRE_OP, "the response is in it");
            Check.That(Throws<IndexOutOfRangeException>(NEXTWUSB.ClearCmdData) == (length < NEXTWUSB.DEF_MA_MAX), "ClearCmdData");
            Check.That(NEXTWUSB.cmdData.Length == length, "ClearCmdData leaves the array in its place");
        }
        NEXTWUSB.cmdData = null;
        Check.That(!NEXTWUSB.ECMUSBWrite(), "a write of null is false");
        Check.Says("cmdData is null");
        NEXTWUSB.respData = null;
        Check.That(!NEXTWUSB.ECMUSBRead(), "a read to null is false");
        Check.Says("respData is null");
        Check.That(Throws<NullReferenceException>(NEXTWUSB.ClearCmdData), "ClearCmdData of null");
        NEXTWUSB.cmdData = commands;
        NEXTWUSB.respData = responses;
    }

    static void Works()
    {
        NEXTWUSB.ClearCmdData();
        Check.That(NEXTWUSB.ECMUSBWrite() && NEXTWUSB.ECMUSBRead(), "the board answers");
    }

    static void Main()
    {
        Check.That(NEXTWUSBDiagnostics.LastError == "" && NEXTWUSBDiagnostics.LibraryFile == null, "nothing has happened");
        NothingIsOpen();
        Check.That(NEXTWUSBDiagnostics.LibraryFile.Contains("NEXTWUSBLib"), "the library is named");
        Check.That(NEXTWUSB.OpenECMUSB(), "the board opens");
        OtherArrays();
        Works();
        // Another thread has its own error; this thread's error stays.
        Check.That(!Write(null), "null is refused");
        string other = null;
        var thread = new Thread(() => other = NEXTWUSBDiagnostics.LastError);
        thread.Start();
        thread.Join();
        Check.That(!other.Contains("cmdData"), "a thread has its own errors");
        Check.Says("cmdData is null");
        // An array of the program's own, of the right length, is valid.
        NEXTWUSB.respData = new NEXTWUSB.transData[NEXTWUSB.DEF_MA_MAX];
        Works();
        Check.That((NEXTWUSB.respData[0].Parm & 0xFF) == NEXTWUSB.STATE_PRE_OP, "the response is in it");
        Check.That(NEXTWUSB.OpenECMUSB(), "open while open");
        Works();
        NEXTWUSB.CloseECMUSB();
        NothingIsOpen();

        Check.That(NEXTWUSB.OpenECMUSB(), "the board opens again");
        Forget();
        for (int i = 0; i < 1000 && RESULTS[1] == null; i++)
        {
            GC.Collect();
            GC.WaitForPendingFinalizers();
            Thread.Sleep(1);
        }
        Check.That(RESULTS[0] == "True True", "a finaliser has the board: " + RESULTS[0]);
        Check.That(RESULTS[1].StartsWith("False ") && RESULTS[1].Contains("OpenECMUSB"), "it has closed it: " + RESULTS[1]);
        NothingIsOpen();
        Console.WriteLine("ok");
    }

    static bool Write(NEXTWUSB.transData[] slots)
    {
        NEXTWUSB.transData[] own = NEXTWUSB.cmdData;
        NEXTWUSB.cmdData = slots;
        bool written = NEXTWUSB.ECMUSBWrite();
        NEXTWUSB.cmdData = own;
        return written;
    }

    // In separate stack frames, which have ended when the collector runs.
    static void Forget()
    {
        var thread = new Thread(() => new Forgotten());
        thread.Start();
        thread.Join();
    }
}
