// What the file says of itself: version and company of the vendor's. A program that was compiled against the vendor's asks for
// 2.0.0.0, and .NET Core takes no older one. The product tells ours from the vendor's.

using System.Reflection;
using System.Runtime.InteropServices;

#if SLOTS_OF_16_BYTES
[assembly: AssemblyTitle("NEXTWUSB_dotNET_16B")]
[assembly: AssemblyDescription("NEXTWUSBLib for .NET, slots of 16 bytes")]
#elif NAMED_12B
[assembly: AssemblyTitle("NEXTWUSB_dotNET_12B")]
[assembly: AssemblyDescription("NEXTWUSBLib for .NET, slots of 12 bytes")]
#else
[assembly: AssemblyTitle("NEXTWUSB_dotNET")]
[assembly: AssemblyDescription("NEXTWUSBLib for .NET, slots of 12 bytes")]
#endif
[assembly: AssemblyProduct("ecmsk")]
[assembly: AssemblyCompany("NEXTW")]
[assembly: AssemblyVersion("2.0.0.0")]
[assembly: AssemblyFileVersion("2.0.0.0")]
[assembly: ComVisible(false)]
