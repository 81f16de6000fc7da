// The example of the vendor's guide, chapter 4.4.1: open, an empty frame out, a response in, close. Here with what the calls
// gave, and what the response says.
using System;
using System.Collections.Generic;
using System.Linq;
using System.Text;
using NEXTWUSB_dotNET;

class Program
{
    static void Main(string[] args)
    {
        Console.WriteLine("OpenECMUSB: {0}", NEXTWUSB.OpenECMUSB());
        NEXTWUSB.ClearCmdData();
        Console.WriteLine("ECMUSBWrite: {0}", NEXTWUSB.ECMUSBWrite());
        Console.WriteLine("ECMUSBRead: {0}", NEXTWUSB.ECMUSBRead());
        Console.WriteLine("state {0}", NEXTWUSB.respData[0].Parm & 0xFF);
        NEXTWUSB.CloseECMUSB();
        Console.WriteLine("closed");
    }
}
