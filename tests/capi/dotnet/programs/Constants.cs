// Constants stand wherever a number does: in fields of a slot, and in variables of any type that they fit.
using System;
using NEXTWUSB_dotNET_12B;

static class Constants
{
    const int COPY = NEXTWUSB.STATE_OPERATIONAL;

    static void Main()
    {
        NEXTWUSB.cmdData[0].CMD = NEXTWUSB.SET_AXIS;
        NEXTWUSB.cmdData[0].Data1 = NEXTWUSB.STATE_PRE_OP;
        NEXTWUSB.cmdData[1].CMD = NEXTWUSB.SW_RESET;
        NEXTWUSB.cmdData[1].Parm = NEXTWUSB.None;
        NEXTWUSB.cmdData[1].Data1 = NEXTWUSB.CST_MODE;
        NEXTWUSB.cmdData[1].Data2 = NEXTWUSB.DCSYNC;
        byte small = NEXTWUSB.CSP;
        short signed = NEXTWUSB.SV_ON;
        ushort unsigned = NEXTWUSB.SV_OFF;
        int whole = NEXTWUSB.HSP;
        uint wide = NEXTWUSB.STEP;
        long wider = NEXTWUSB.LIO_WR;
        switch (NEXTWUSB.cmdData[1].CMD)
        {
            case NEXTWUSB.SW_RESET:
                Console.WriteLine("{0} {1} {2} {3} {4} {5} {6}", small, signed, unsigned, whole, wide, wider, COPY);
                break;
        }
        NEXTWUSB.ClearCmdData();
        foreach (NEXTWUSB.transData slot in NEXTWUSB.cmdData)
            if (slot.CMD != 0 || slot.Parm != 0 || slot.Data1 != 0 || slot.Data2 != 0)
                Console.WriteLine("not cleared");
    }
}
