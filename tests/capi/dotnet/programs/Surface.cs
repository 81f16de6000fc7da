// Prints the public members of each named assembly, one per line, and its file's properties.
using System;
using System.Collections.Generic;
using System.Diagnostics;
using System.IO;
using System.Linq;
using System.Reflection;
using System.Runtime.InteropServices;

static class Surface
{
    const BindingFlags PUBLIC =
        BindingFlags.Public | BindingFlags.Static | BindingFlags.Instance | BindingFlags.DeclaredOnly;
    const BindingFlags ALL = PUBLIC | BindingFlags.NonPublic;

    static void Main(string[] files)
    {
        foreach (string file in files)
        {
            // Loaded from its bytes: by name or path another assembly of the same name might be loaded.
            byte[] bytes = File.ReadAllBytes(file);
            Assembly assembly = Assembly.Load(bytes);
            AssemblyName name = assembly.GetName();
            byte[] key = name.GetPublicKeyToken();
            FileVersionInfo version = FileVersionInfo.GetVersionInfo(file);
            Console.WriteLine("assembly {0} {1}, {2}signed, file version {3}, company {4}", name.Name, name.Version,
                key == null || key.Length == 0 ? "not " : "", version.FileVersion, version.CompanyName);
            PortableExecutableKinds kinds;
            ImageFileMachine machine;
            assembly.ManifestModule.GetPEKind(out kinds, out machine);
            Console.WriteLine("  {0}, {1}, {2}, {3}", Format(bytes), machine, kinds & ~PortableExecutableKinds.PE32Plus,
                assembly.ImageRuntimeVersion);
            foreach (AssemblyName needed in assembly.GetReferencedAssemblies().OrderBy(other => other.Name))
                Console.WriteLine("  needs {0} {1}", needed.Name, needed.Version);
            foreach (IGrouping<string, DllImportAttribute> imported in Imports(assembly).GroupBy(import => import.Value)
                .OrderBy(group => group.Key, StringComparer.Ordinal))
                Console.WriteLine("  imports {0}: {1}", imported.Key, string.Join(" ",
                    imported.Select(import => import.EntryPoint).Distinct().OrderBy(entry => entry, StringComparer.Ordinal)));
            foreach (Type type in assembly.GetExportedTypes().OrderBy(type => type.FullName, StringComparer.Ordinal))
            {
                Console.WriteLine("  public {0} {1}{2}", Kind(type), type.FullName,
                    type.IsValueType ? ", " + Marshal.SizeOf(type) + " bytes" : "");
                foreach (string member in Members(type))
                    Console.WriteLine("    public " + member);
            }
        }
    }

    // Mono has no property for it: the magic number of the file's optional header.
    static string Format(byte[] bytes)
    {
        return BitConverter.ToUInt16(bytes, BitConverter.ToInt32(bytes, 0x3C) + 24) == 0x20B ? "PE32+" : "PE32";
    }

    static string Kind(Type type)
    {
        if (type.IsValueType)
            return type.IsLayoutSequential ? "sequential struct" : "struct";
        return type.IsAbstract && type.IsSealed ? "static class" : "class";
    }

    static IEnumerable<DllImportAttribute> Imports(Assembly assembly)
    {
        return assembly.GetTypes().SelectMany(type => type.GetMethods(ALL)).Select(Import).Where(import => import != null);
    }

    static DllImportAttribute Import(MethodInfo method)
    {
        return (DllImportAttribute)Attribute.GetCustomAttribute(method, typeof(DllImportAttribute));
    }

    // In the order of the source.
    static IEnumerable<string> Members(Type type)
    {
        foreach (MemberInfo member in type.GetMembers(PUBLIC).OrderBy(member => member.MetadataToken & 0xFFFFFF)
            .OrderBy(member => member.MemberType))
        {
            var field = member as FieldInfo;
            var method = member as MethodInfo;
            var property = member as PropertyInfo;
            if (field != null && field.IsLiteral)
                yield return string.Format("const {0} {1} = {2}", field.FieldType.Name, field.Name, field.GetRawConstantValue());
            else if (field != null)
                yield return string.Format("{0}{1}{2} {3}", field.IsStatic ? "static " : "", field.IsInitOnly ? "readonly " : "",
                    Named(field.FieldType), field.Name);
            else if (property != null)
                yield return string.Format("static {0} {1} {{ get;{2} }}", property.PropertyType.Name, property.Name,
                    property.CanWrite ? " set;" : "");
            else if (method != null && method.Name.StartsWith("op_"))
                yield return string.Format("static {0} {1}({2})", Named(method.ReturnType), method.Name,
                    string.Join(", ", method.GetParameters().Select(parameter => Named(parameter.ParameterType))));
            else if (method != null && !method.IsSpecialName)
                yield return string.Format("static {0} {1}({2}){3}", method.ReturnType.Name, method.Name, string.Join(", ",
                    method.GetParameters().Select(parameter => Named(parameter.ParameterType) + " " + parameter.Name)),
                    HowImported(method));
        }
    }

    // A result without MarshalAs that is a bool has four bytes.
    static string HowImported(MethodInfo method)
    {
        DllImportAttribute import = Import(method);
        if (import == null)
            return "";
        bool isMarshalled = method.ReturnParameter.IsDefined(typeof(MarshalAsAttribute), false);
        return string.Format(", imported as {0}, {1}{2}", import.EntryPoint, import.CallingConvention,
            isMarshalled ? ", MarshalAs" : "");
    }

    static string Named(Type type)
    {
        if (type.IsArray)
            return Named(type.GetElementType()) + "[]";
        return type.Namespace == "System" ? type.Name : type.FullName;
    }
}
