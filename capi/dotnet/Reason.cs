// Why calls failed: a text of ours, or what NEXTWUSBLib says. Like there, each thread has its own.

using System;
using System.Globalization;

namespace Ecmsk
{
    static class Reason
    {
        // Of this thread: a text of ours, unless the library's error is the newer one.
        [ThreadStatic]
        static string own;
        // Of all threads: why the library could not be loaded.
        static volatile string notLoaded;

        // What a call of the library gave. The vendor's gives a byte, ours a whole number of 0 or 1.
        public static bool Of(uint result, Library library)
        {
            if ((result & 0xFF) != 0)
                return true;
            // Asked for when somebody wants to know: a program that polls a closed board pays nothing.
            own = null;
            return false;
        }

        // Always false, for the caller to return.
        public static bool Is(string format, params object[] values)
        {
            own = string.Format(CultureInfo.InvariantCulture, format, values);
            return false;
        }

        public static void IsNotLoaded(string text)
        {
            own = notLoaded = text;
        }

        public static string Last()
        {
            if (own != null)
                return own;
            Library library = Library.Loaded;
            if (library == null)
                return notLoaded ?? "";
            return library.LastError();
        }
    }
}
