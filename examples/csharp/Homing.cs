// Homing as programs for the ECM-SK do it: parameters by SDO, GO_HOME, bits 10, 12 and 13 of the statusword.
using NEXTWUSB_dotNET;

class Homing
{
    public int Method;           // 0x6098
    public uint SwitchSpeed;     // 0x6099:1, counts/s
    public uint ZeroSpeed;       // 0x6099:2, counts/s
    public uint Acceleration;    // 0x609A, counts/s^2
    public int Offset;           // 0x607C: the position at home, counts

    // How often a drive is asked for its mode.
    const int MODE_TRIES = 100;

    public static bool Attained(int axis) { return (Ecm.StatusWord(axis) & 0x1400) == 0x1400; }
    public static bool Error(int axis) { return (Ecm.StatusWord(axis) & 0x2000) != 0; }

    // Parameters and mode 6. Then waits until the statusword is that of mode 6: bit 12 means something else in CSP.
    public void Prepare(int axis)
    {
        Ecm.SdoWrite(axis, 0x6098, 0, 1, (uint)(Method & 0xFF));
        Ecm.SdoWrite(axis, 0x6099, 1, 4, SwitchSpeed);
        Ecm.SdoWrite(axis, 0x6099, 2, 4, ZeroSpeed);
        Ecm.SdoWrite(axis, 0x609A, 0, 4, Acceleration);
        Ecm.SdoWrite(axis, 0x607C, 0, 4, unchecked((uint)Offset));
        Ecm.SdoWrite(axis, 0x6060, 0, 1, NEXTWUSB.HOMING_MODE);
        uint mode = 0;
        for (int i = 0; mode != NEXTWUSB.HOMING_MODE || (Ecm.StatusWord(axis) & 0x3000) != 0; i++)
        {
            if (i == MODE_TRIES)
                throw new Failure("the drive does not enter homing mode");
            mode = Ecm.SdoRead(axis, 0x6061, 0);
        }
    }

    // Back to CSP, whether the board goes back by itself (firmware 1.7) or not.
    public static void End(int axis)
    {
        Ecm.SdoWrite(axis, 0x6060, 0, 1, NEXTWUSB.CSP_MODE);
        uint mode = 0;
        for (int i = 0; mode != NEXTWUSB.CSP_MODE; i++)
        {
            if (i == MODE_TRIES)
                throw new Failure("the drive does not return to CSP");
            mode = Ecm.SdoRead(axis, 0x6061, 0);
        }
    }
}
