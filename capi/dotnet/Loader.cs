// The system's functions that load libraries.

using System;
using System.IO;
using System.Runtime.InteropServices;
using System.Text;

namespace Ecmsk
{
    abstract class Loader
    {
        // Of the system that this process runs on.
        public static readonly Loader Here =
            Path.DirectorySeparatorChar == '\\' ? (Loader)new WindowsLoader() : new UnixLoader();

        // What NEXTWUSBLib's file may be called.
        public abstract string[] Names { get; }

        // Zero, and the problem, if it does not load.
        public abstract IntPtr Load(string file, out string problem);

        // Zero if it has none of that name.
        public abstract IntPtr Find(IntPtr module, string function);

        // A text in UTF-8 that ends with 0.
        public static string Text(IntPtr text)
        {
            if (text == IntPtr.Zero)
                return "";
            int length = 0;
            while (Marshal.ReadByte(text, length) != 0)
                length++;
            byte[] bytes = new byte[length];
            Marshal.Copy(text, bytes, 0, length);
            return Encoding.UTF8.GetString(bytes);
        }
    }

    sealed class WindowsLoader : Loader
    {
        // What the library itself needs is looked for beside it.
        const uint LOAD_WITH_ALTERED_SEARCH_PATH = 8;
        const int ERROR_MOD_NOT_FOUND = 126;
        const int ERROR_BAD_EXE_FORMAT = 193;

        [DllImport("kernel32", CharSet = CharSet.Unicode, SetLastError = true, ExactSpelling = true)]
        static extern IntPtr LoadLibraryExW(string file, IntPtr reserved, uint flags);
        [DllImport("kernel32", CharSet = CharSet.Ansi, ExactSpelling = true, BestFitMapping = false)]
        static extern IntPtr GetProcAddress(IntPtr module, string name);

        public override string[] Names
        {
            get { return new[] { "NEXTWUSBLib.dll" }; }
        }

        public override IntPtr Load(string file, out string problem)
        {
            problem = null;
            IntPtr module = LoadLibraryExW(file, IntPtr.Zero, Path.IsPathRooted(file) ? LOAD_WITH_ALTERED_SEARCH_PATH : 0);
            if (module == IntPtr.Zero)
            {
                int error = Marshal.GetLastWin32Error();
                problem = error == ERROR_BAD_EXE_FORMAT ? "is for a process of another width, or broken"
                    : error == ERROR_MOD_NOT_FOUND ? "is not there, or something that it needs is not"
                    : "does not load (Windows' error " + error + ")";
            }
            return module;
        }

        public override IntPtr Find(IntPtr module, string function)
        {
            return GetProcAddress(module, function);
        }
    }

    sealed class UnixLoader : Loader
    {
        const int RTLD_NOW = 2;

        [DllImport("libdl.so.2", EntryPoint = "dlopen")]
        static extern IntPtr OpenByLibdl(string file, int flags);
        [DllImport("libdl.so.2", EntryPoint = "dlsym")]
        static extern IntPtr FindByLibdl(IntPtr module, string name);
        [DllImport("libdl.so.2", EntryPoint = "dlerror")]
        static extern IntPtr ErrorByLibdl();
        // Where the C library has them itself.
        [DllImport("libc", EntryPoint = "dlopen")]
        static extern IntPtr OpenByLibc(string file, int flags);
        [DllImport("libc", EntryPoint = "dlsym")]
        static extern IntPtr FindByLibc(IntPtr module, string name);
        [DllImport("libc", EntryPoint = "dlerror")]
        static extern IntPtr ErrorByLibc();

        readonly bool libdl;

        public UnixLoader()
        {
            try
            {
                ErrorByLibdl();
                libdl = true;
            }
            catch (DllNotFoundException)
            {
                libdl = false;
            }
        }

        public override string[] Names
        {
            get { return new[] { "libNEXTWUSBLib.so", "libNEXTWUSBLib.so.0" }; }
        }

        public override IntPtr Load(string file, out string problem)
        {
            IntPtr module = libdl ? OpenByLibdl(file, RTLD_NOW) : OpenByLibc(file, RTLD_NOW);
            problem = module == IntPtr.Zero ? Text(libdl ? ErrorByLibdl() : ErrorByLibc()) : null;
            // dlopen says the name of the file again.
            if (problem != null && problem.StartsWith(file + ": ", StringComparison.Ordinal))
                problem = problem.Substring(file.Length + 2);
            return module;
        }

        public override IntPtr Find(IntPtr module, string function)
        {
            return libdl ? FindByLibdl(module, function) : FindByLibc(module, function);
        }
    }
}
