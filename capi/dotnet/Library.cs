// NEXTWUSBLib and its functions. It is loaded by its path and not by DllImport, which would take the first file
// of that name whatever its width is.

using System;
using System.Runtime.InteropServices;
using System.Security;
using System.Text;

namespace Ecmsk
{
    sealed class Library
    {
        // C's `unsigned long` is as wide as UIntPtr but on 64-bit Windows, where the upper half of a register is not looked at.
        [UnmanagedFunctionPointer(CallingConvention.StdCall), SuppressUnmanagedCodeSecurity]
        public delegate uint OpenFunction();
        [UnmanagedFunctionPointer(CallingConvention.StdCall), SuppressUnmanagedCodeSecurity]
        public delegate void CloseFunction();
        [UnmanagedFunctionPointer(CallingConvention.StdCall), SuppressUnmanagedCodeSecurity]
        public unsafe delegate uint MoveFunction(byte* data, UIntPtr length);
        [UnmanagedFunctionPointer(CallingConvention.StdCall), SuppressUnmanagedCodeSecurity]
        delegate IntPtr TextFunction();

        public readonly string File;
        public readonly OpenFunction Open;
        public readonly CloseFunction Close;
        public readonly MoveFunction Write;
        public readonly MoveFunction Read;
        // Null if it is the vendor's.
        readonly TextFunction lastError;

        static readonly object gate = new object();
        static volatile Library loaded;

        // Null as long as none is.
        public static Library Loaded
        {
            get { return loaded; }
        }

        // Null if there is none; then the reason is kept. It stays loaded until the process ends.
        public static Library Get()
        {
            return loaded ?? Load();
        }

        // The same for functions that throw if there is none, as those that a program has declared by DllImport do.
        public static Library Need()
        {
            Library library = Get();
            if (library == null)
                throw new DllNotFoundException(Reason.Last());
            return library;
        }

        static Library Load()
        {
            lock (gate)
            {
                if (loaded != null)
                    return loaded;
                var tried = new StringBuilder();
                foreach (string file in Places.Files())
                {
                    string problem;
                    Library library = Load(file, out problem);
                    if (library != null)
                        return loaded = library;
                    tried.Append("; ").Append(file).Append(": ").Append(problem);
                }
                Reason.IsNotLoaded(Places.NotFound(tried.ToString()));
                return null;
            }
        }

        static Library Load(string file, out string problem)
        {
            IntPtr module = Loader.Here.Load(file, out problem);
            if (module == IntPtr.Zero)
                return null;
            foreach (string function in new[] { "OpenECMUSB", "CloseECMUSB", "ECMUSBWrite", "ECMUSBRead" })
                if (Loader.Here.Find(module, function) == IntPtr.Zero)
                {
                    problem = "has no function " + function;
                    return null;
                }
            return new Library(file, module);
        }

        Library(string file, IntPtr module)
        {
            File = file;
            Open = (OpenFunction)Function(module, "OpenECMUSB", typeof(OpenFunction));
            Close = (CloseFunction)Function(module, "CloseECMUSB", typeof(CloseFunction));
            Write = (MoveFunction)Function(module, "ECMUSBWrite", typeof(MoveFunction));
            Read = (MoveFunction)Function(module, "ECMUSBRead", typeof(MoveFunction));
            lastError = (TextFunction)Function(module, "ecmsk_last_error", typeof(TextFunction));
        }

        static Delegate Function(IntPtr module, string name, Type type)
        {
            IntPtr address = Loader.Here.Find(module, name);
            return address == IntPtr.Zero ? null : Marshal.GetDelegateForFunctionPointer(address, type);
        }

        public string LastError()
        {
            return lastError == null ? "" : Loader.Text(lastError());
        }
    }
}
