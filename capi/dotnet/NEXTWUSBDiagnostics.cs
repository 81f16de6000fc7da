// What the vendor's assembly has not: why a call failed. A class of its own, so that NEXTWUSB stays what programs know.

using Ecmsk;

#if SLOTS_OF_16_BYTES
namespace NEXTWUSB_dotNET_16B
#elif NAMED_12B
namespace NEXTWUSB_dotNET_12B
#else
namespace NEXTWUSB_dotNET
#endif
{
    /// <summary>Why a function of <see cref="NEXTWUSB"/> gave false, and which library it works with. [OURS]</summary>
    public static class NEXTWUSBDiagnostics
    {
        /// <summary>
        /// Why this thread's last call that gave false did so, with the next step to do; if none of its calls did, why the last
        /// <see cref="NEXTWUSB.OpenECMUSB"/> of the process that failed did. Empty if nothing has failed, or if NEXTWUSBLib is
        /// one that gives no reasons. One line of English text.
        /// </summary>
        public static string LastError
        {
            get { return Reason.Last(); }
        }

        /// <summary>
        /// The NEXTWUSBLib that calls go to: its file, or its name alone if the system found it by that; null as long as none is
        /// loaded, which the first call does.
        /// </summary>
        public static string LibraryFile
        {
            get
            {
                Library library = Library.Loaded;
                return library == null ? null : library.File;
            }
        }
    }
}
