// What the file says of itself. The version is that of Cargo.toml, which a test compares.

using System.Reflection;
using System.Runtime.InteropServices;

[assembly: AssemblyTitle("Ecmsk")]
[assembly: AssemblyDescription("The ECM-SK, an EtherCAT master board, for .NET")]
[assembly: AssemblyProduct("ecmsk")]
[assembly: AssemblyVersion("0.1.0.0")]
[assembly: AssemblyFileVersion("0.1.0.0")]
[assembly: ComVisible(false)]
