// What the file says of itself. Its version number is the one that every assembly has by default, [OURS]: a program that was
// compiled against the vendor's asks for a version, and .NET takes no older one. That of the project stands in the others.

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
[assembly: AssemblyVersion("1.0.0.0")]
[assembly: ComVisible(false)]
