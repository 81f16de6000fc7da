' The example of the vendor's guide, chapter 4.4.2: open, an empty frame out, a response in, close. Here with what the calls
' gave, and what the response says.
Imports System
Imports NEXTWUSB_dotNET

Module Program
    Sub Main()
        Console.WriteLine("OpenECMUSB: {0}", NEXTWUSB.OpenECMUSB())
        NEXTWUSB.ClearCmdData()
        Console.WriteLine("ECMUSBWrite: {0}", NEXTWUSB.ECMUSBWrite())
        Console.WriteLine("ECMUSBRead: {0}", NEXTWUSB.ECMUSBRead())
        Console.WriteLine("state {0}", NEXTWUSB.respData(0).Parm And &HFF)
        NEXTWUSB.CloseECMUSB()
        Console.WriteLine("closed")
    End Sub
End Module
