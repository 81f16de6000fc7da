// The `ecmsk_*` functions of NEXTWUSBLib (include/ecmsk.h). The library is loaded by its path, as by the assemblies for existing
// programs: a file of the wrong width is passed over, and an error lists every place that was searched.

using System;
using System.Runtime.InteropServices;
using System.Text;
using System.Threading;

namespace Ecmsk
{
    sealed class Native
    {
        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        public delegate int OpenFunction(byte[] uri, out IntPtr board);
        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        public delegate int CloseFunction(IntPtr board);
        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        public delegate int MoveFunction(BoardHandle board, [In, Out] byte[] data, UIntPtr length, long timeoutMs);
        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        public delegate int CountFunction(BoardHandle board, [In, Out] ulong[] counts);
        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        public delegate int NameFunction(BoardHandle board, [In, Out] byte[] buffer, UIntPtr length, out UIntPtr needed);
        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        delegate IntPtr TextFunction();
        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        delegate IntPtr ReasonFunction(uint kind);

        public const long WaitForever = -1;
        const int HandleError = -2;

        public readonly string File;
        public readonly OpenFunction Open;
        public readonly CloseFunction Close;
        public readonly MoveFunction Write;
        public readonly MoveFunction Read;
        public readonly CountFunction GetStats;
        public readonly CountFunction GetCounters;
        public readonly NameFunction GetLinkName;
        readonly TextFunction version;
        readonly TextFunction lastError;
        readonly ReasonFunction rejectName;

        static readonly object gate = new object();
        static volatile Native loaded;

        // It stays loaded until the process ends.
        public static Native Need()
        {
            return loaded ?? Load();
        }

        static Native Load()
        {
            lock (gate)
            {
                if (loaded != null)
                    return loaded;
                var tried = new StringBuilder();
                foreach (string file in Places.Files())
                {
                    string problem;
                    IntPtr module = Loader.Here.Load(file, out problem);
                    string missing = null;
                    if (module != IntPtr.Zero)
                    {
                        var native = new Native(file, module, ref missing);
                        if (missing == null)
                            return loaded = native;
                        problem = "has no function " + missing + ": it is the vendor's, or older than this assembly";
                    }
                    tried.Append("; ").Append(file).Append(": ").Append(problem);
                }
                throw new DllNotFoundException(Places.NotFound(tried.ToString()));
            }
        }

        Native(string file, IntPtr module, ref string missing)
        {
            File = file;
            Open = Function<OpenFunction>(module, "ecmsk_open", ref missing);
            Close = Function<CloseFunction>(module, "ecmsk_close", ref missing);
            Write = Function<MoveFunction>(module, "ecmsk_write", ref missing);
            Read = Function<MoveFunction>(module, "ecmsk_read", ref missing);
            GetStats = Function<CountFunction>(module, "ecmsk_get_stats", ref missing);
            GetCounters = Function<CountFunction>(module, "ecmsk_get_counters", ref missing);
            GetLinkName = Function<NameFunction>(module, "ecmsk_get_link_name", ref missing);
            version = Function<TextFunction>(module, "ecmsk_version", ref missing);
            lastError = Function<TextFunction>(module, "ecmsk_last_error", ref missing);
            rejectName = Function<ReasonFunction>(module, "ecmsk_reject_name", ref missing);
        }

        static T Function<T>(IntPtr module, string name, ref string missing) where T : class
        {
            IntPtr address = Loader.Here.Find(module, name);
            if (address != IntPtr.Zero)
                return (T)(object)Marshal.GetDelegateForFunctionPointer(address, typeof(T));
            missing = missing ?? name;
            return null;
        }

        public string Version()
        {
            return Loader.Text(version());
        }

        // The name of the reason with that index; null if there is none.
        public string RejectName(uint kind)
        {
            IntPtr name = rejectName(kind);
            return name == IntPtr.Zero ? null : Loader.Text(name);
        }

        // The exception for a result below 0. The text is of this thread, so ask before another call of it.
        public EcmskException Error(int result)
        {
            // The handles are the library's own, so the board was closed between the beginning of the call and its look at it.
            if (result == HandleError)
                return new EcmskException(ErrorKind.Closed, "the board was closed during the call; open it again with Board.Open");
            return new EcmskException((ErrorKind)result, Loader.Text(lastError()));
        }

        public void Check(int result)
        {
            if (result < 0)
                throw Error(result);
        }

        // A text for a C function: in UTF-8, with a 0 at its end.
        public static byte[] Text(string text)
        {
            byte[] bytes = Encoding.UTF8.GetBytes(text);
            Array.Resize(ref bytes, bytes.Length + 1);
            return bytes;
        }
    }

    // A handle of `ecmsk_open`. It is closed once, by Dispose or by the garbage collector.
    sealed class BoardHandle : SafeHandle
    {
        readonly Native native;
        int closed;

        public BoardHandle(Native native, IntPtr board) : base(IntPtr.Zero, true)
        {
            this.native = native;
            SetHandle(board);
        }

        public override bool IsInvalid
        {
            get { return handle == IntPtr.Zero; }
        }

        public bool HasEnded
        {
            get { return Volatile.Read(ref closed) != 0; }
        }

        // Ends the calls of other threads. Without that a thread that waits in a read would keep the board open.
        protected override void Dispose(bool disposing)
        {
            if (disposing)
                CloseOnce();
            base.Dispose(disposing);
        }

        // [OURS] At the end of the process the board is left to the library, which ends it as one of a program that did not close
        // it: a server then brings the axes to a standstill (docs/SAFETY.md).
        protected override bool ReleaseHandle()
        {
            return Environment.HasShutdownStarted || CloseOnce();
        }

        bool CloseOnce()
        {
            return Interlocked.Exchange(ref closed, 1) != 0 || native.Close(handle) == 0;
        }
    }
}
