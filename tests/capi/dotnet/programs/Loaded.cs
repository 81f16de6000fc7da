// A program that loads NEXTWUSBLib itself, by LoadLibrary and GetProcAddress, and releases it by FreeLibrary while a thread reads.
// Argument: `gone`, the only reference to it; `kept`, one of two, so that the reason of the read's end can be queried.
using System;
using System.Runtime.InteropServices;
using System.Threading;

static class Loaded
{
    [DllImport("kernel32", CharSet = CharSet.Unicode, ExactSpelling = true)]
    static extern IntPtr LoadLibraryW(string file);
    [DllImport("kernel32", CharSet = CharSet.Unicode, ExactSpelling = true)]
    static extern IntPtr GetModuleHandleW(string file);
    [DllImport("kernel32", CharSet = CharSet.Ansi, ExactSpelling = true, BestFitMapping = false)]
    static extern IntPtr GetProcAddress(IntPtr module, string name);
    [DllImport("kernel32", ExactSpelling = true)]
    static extern bool FreeLibrary(IntPtr module);

    [UnmanagedFunctionPointer(CallingConvention.StdCall)]
    [return: MarshalAs(UnmanagedType.I1)]
    delegate bool OpenFunction();
    [UnmanagedFunctionPointer(CallingConvention.StdCall)]
    delegate void CloseFunction();
    [UnmanagedFunctionPointer(CallingConvention.StdCall)]
    [return: MarshalAs(UnmanagedType.I1)]
    delegate bool MoveFunction(byte[] data, uint length);
    [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
    delegate IntPtr TextFunction();

    const string DLL = "NEXTWUSBLib.dll";
    const int LENGTH = 504;
    static readonly byte[] frame = new byte[LENGTH], response = new byte[LENGTH];
    static int reads;
    static string why;

    static Delegate Function(IntPtr dll, string name, Type type)
    {
        IntPtr address = GetProcAddress(dll, name);
        Check.That(address != IntPtr.Zero, name + " is there");
        return Marshal.GetDelegateForFunctionPointer(address, type);
    }

    static void Main(string[] arguments)
    {
        bool kept = arguments[0] == "kept";
        IntPtr dll = LoadLibraryW(DLL);
        Check.That(dll != IntPtr.Zero, "it loads");
        Check.That(!kept || LoadLibraryW(DLL) == dll, "it loads twice");
        var open = (OpenFunction)Function(dll, "OpenECMUSB", typeof(OpenFunction));
        var close = (CloseFunction)Function(dll, "CloseECMUSB", typeof(CloseFunction));
        var write = (MoveFunction)Function(dll, "ECMUSBWrite", typeof(MoveFunction));
        var read = (MoveFunction)Function(dll, "ECMUSBRead", typeof(MoveFunction));
        var lastError = (TextFunction)Function(dll, "ecmsk_last_error", typeof(TextFunction));
        Check.That(!read(response, LENGTH) && !write(frame, LENGTH), "nothing is open");
        Check.That(open() && write(frame, LENGTH) && read(response, LENGTH), "the board answers");
        Check.That(response[2] == 2, "the network is in PreOP");

        var reader = new Thread(() =>
        {
            while (read(response, LENGTH))
                reads++;
            // After releasing it no function may be called.
            if (kept)
                why = Marshal.PtrToStringAnsi(lastError());
        });
        reader.Start();
        Wait(3);
        Check.That(FreeLibrary(dll), "FreeLibrary");
        Check.That(GetModuleHandleW(DLL) == dll, "it stays while a board is open");
        Wait(3);
        close();
        reader.Join();
        if (kept)
        {
            Check.That(why.Contains("closed") || why.Contains("OpenECMUSB"), "the read says why it ended: " + why);
            Check.That(!read(response, LENGTH) && !write(frame, LENGTH), "it is closed");
            Check.That(FreeLibrary(dll), "FreeLibrary again");
        }
        while (GetModuleHandleW(DLL) != IntPtr.Zero)
            Thread.Sleep(1);
        Console.WriteLine("ok");
    }

    // For that many more reads.
    static void Wait(int more)
    {
        int before = Volatile.Read(ref reads);
        while (Volatile.Read(ref reads) < before + more)
            Thread.Sleep(1);
    }
}
