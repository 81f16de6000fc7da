// A program with declarations of its own for NEXTWUSBLib, as used in the field: bool as I1, and by .NET's default as a BOOL of four
// bytes. With the argument `ordinals` by ordinals, only on Windows.
using System;
using System.Runtime.InteropServices;

static class OneByte
{
    [DllImport("NEXTWUSBLib.dll", CallingConvention = CallingConvention.StdCall)]
    [return: MarshalAs(UnmanagedType.I1)]
    public static extern bool OpenECMUSB();
    [DllImport("NEXTWUSBLib.dll", CallingConvention = CallingConvention.StdCall)]
    public static extern void CloseECMUSB();
    [DllImport("NEXTWUSBLib.dll", CallingConvention = CallingConvention.StdCall)]
    [return: MarshalAs(UnmanagedType.I1)]
    public static extern bool ECMUSBWrite(byte[] data, uint dwlength);
    [DllImport("NEXTWUSBLib.dll", CallingConvention = CallingConvention.StdCall)]
    [return: MarshalAs(UnmanagedType.I1)]
    public static extern bool ECMUSBRead(byte[] data, uint dwlength);
}

static class FourBytes
{
    [DllImport("NEXTWUSBLib.dll")]
    public static extern bool OpenECMUSB();
    [DllImport("NEXTWUSBLib.dll")]
    public static extern void CloseECMUSB();
    [DllImport("NEXTWUSBLib.dll")]
    public static extern bool ECMUSBWrite(IntPtr data, uint dwlength);
    [DllImport("NEXTWUSBLib.dll")]
    public static extern bool ECMUSBRead(IntPtr data, uint dwlength);
    // The number, all four bytes of it.
    [DllImport("NEXTWUSBLib.dll", EntryPoint = "OpenECMUSB")]
    public static extern int Open();
    [DllImport("NEXTWUSBLib.dll", EntryPoint = "ECMUSBRead")]
    public static extern int Read(byte[] data, uint dwlength);
}

// By their ordinals on Windows.
static class ByOrdinal
{
    [DllImport("NEXTWUSBLib.dll", EntryPoint = "#1")]
    [return: MarshalAs(UnmanagedType.I1)]
    public static extern bool Open();
    [DllImport("NEXTWUSBLib.dll", EntryPoint = "#2")]
    public static extern void Close();
    [DllImport("NEXTWUSBLib.dll", EntryPoint = "#3")]
    [return: MarshalAs(UnmanagedType.I1)]
    public static extern bool Write(byte[] data, uint dwlength);
    [DllImport("NEXTWUSBLib.dll", EntryPoint = "#4")]
    [return: MarshalAs(UnmanagedType.I1)]
    public static extern bool Read(byte[] data, uint dwlength);
    [DllImport("NEXTWUSBLib.dll", EntryPoint = "#4")]
    public static extern bool ReadAsBool(byte[] data, uint dwlength);
}

static class Declared
{
    static readonly byte[] frame = new byte[504], response = new byte[504];

    static void ByOrdinals()
    {
        Console.WriteLine("I1: {0} {1} {2} {3}", ByOrdinal.Write(frame, 504), ByOrdinal.Open(), ByOrdinal.Write(frame, 504),
            ByOrdinal.Read(response, 504));
        Console.WriteLine("state {0}", response[2]);
        Console.WriteLine("BOOL: {0}", ByOrdinal.ReadAsBool(response, 504));
        ByOrdinal.Close();
        Console.WriteLine("closed: {0} {1}", ByOrdinal.Read(response, 504), ByOrdinal.ReadAsBool(response, 504));
    }

    static void Main(string[] arguments)
    {
        if (arguments.Length > 0)
        {
            ByOrdinals();
            return;
        }
        Console.WriteLine("not open: {0} {1} {2}", OneByte.ECMUSBWrite(frame, 504), OneByte.ECMUSBRead(response, 504),
            FourBytes.Read(response, 504));
        Console.WriteLine("I1: {0} {1} {2}", OneByte.OpenECMUSB(), OneByte.ECMUSBWrite(frame, 504),
            OneByte.ECMUSBRead(response, 504));
        Console.WriteLine("state {0}", response[2]);
        Console.WriteLine("numbers: {0} {1}", FourBytes.Open(), FourBytes.Read(response, 504));
        Console.WriteLine("null: {0} {1}", OneByte.ECMUSBWrite(null, 504), OneByte.ECMUSBRead(null, 504));
        OneByte.CloseECMUSB();

        IntPtr memory = Marshal.AllocHGlobal(504);
        Marshal.Copy(frame, 0, memory, 504);
        Console.WriteLine("BOOL: {0} {1} {2}", FourBytes.OpenECMUSB(), FourBytes.ECMUSBWrite(memory, 504),
            FourBytes.ECMUSBRead(memory, 504));
        Console.WriteLine("state {0}", Marshal.ReadByte(memory, 2));
        FourBytes.CloseECMUSB();
        Console.WriteLine("closed: {0} {1}", FourBytes.ECMUSBRead(memory, 504), FourBytes.Read(response, 504));
        Marshal.FreeHGlobal(memory);
    }
}
