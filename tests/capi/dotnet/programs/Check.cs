// Shared by the test programs: a false condition ends the program with its text.
using System;

static class Check
{
    public static void That(bool holds, string what)
    {
        if (holds)
            return;
        Console.Error.WriteLine("not so: " + what);
        Environment.Exit(1);
    }

    public static void Says(string part)
    {
        string said = NEXTWUSB_dotNET.NEXTWUSBDiagnostics.LastError;
        That(said.Contains(part), "\"" + said + "\" says \"" + part + "\"");
    }
}
