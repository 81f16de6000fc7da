// Where NEXTWUSBLib is looked for. Shared with the package Ecmsk (dotnet/Ecmsk).

using System;
using System.Collections.Generic;
using System.IO;

namespace Ecmsk
{
    static class Places
    {
        // Files that are there: beside this assembly, beside the program (an assembly may be run from a copy of its own), each
        // with its folder for the width; then where .NET Core has files of NuGet packages; last the names alone, for which the
        // system looks where it looks for libraries. [OURS]
        public static IEnumerable<string> Files()
        {
            var seen = new List<string>();
            foreach (string folder in Folders())
                foreach (string name in Loader.Here.Names)
                {
                    string file = Path.Combine(folder, name);
                    if (seen.Contains(Path.GetFullPath(file)) || !File.Exists(file))
                        continue;
                    seen.Add(Path.GetFullPath(file));
                    yield return file;
                }
            foreach (string name in Loader.Here.Names)
                yield return name;
        }

        // The text of an error; `tried` has "; file: problem" for each file.
        public static string NotFound(string tried)
        {
            return string.Format(
                "no {0} for this {1}-bit process was found{2}. Put the {1}-bit one beside the program, or into the folder {3} there",
                Loader.Here.Names[0], IntPtr.Size * 8, tried, WidthFolder);
        }

        // The folder for libraries of this process's width. [OURS]
        static string WidthFolder
        {
            get { return IntPtr.Size == 8 ? "x64" : "x86"; }
        }

        static IEnumerable<string> Folders()
        {
            // Empty in a program that is one file.
            string assembly = typeof(Places).Assembly.Location;
            string beside = string.IsNullOrEmpty(assembly) ? null : Path.GetDirectoryName(Path.GetFullPath(assembly));
            if (beside != null)
            {
                yield return beside;
                yield return Path.Combine(beside, WidthFolder);
            }
            string program = AppDomain.CurrentDomain.BaseDirectory;
            if (!string.IsNullOrEmpty(program) && Path.GetDirectoryName(Path.Combine(program, "x")) != beside)
            {
                yield return program;
                yield return Path.Combine(program, WidthFolder);
            }
            // .NET Core alone has them: folders with native files, of packages, too.
            var native = AppDomain.CurrentDomain.GetData("NATIVE_DLL_SEARCH_DIRECTORIES") as string ?? "";
            foreach (string folder in native.Split(new[] { Path.PathSeparator }, StringSplitOptions.RemoveEmptyEntries))
                yield return folder;
        }
    }
}
