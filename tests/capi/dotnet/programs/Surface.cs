// Prints what each of the assemblies named shows to programs, one member a line.
using System;
using System.Collections.Generic;
using System.Linq;
using System.Reflection;

static class Surface
{
    const BindingFlags ALL =
        BindingFlags.Public | BindingFlags.Static | BindingFlags.Instance | BindingFlags.DeclaredOnly;

    static void Main(string[] files)
    {
        foreach (string file in files)
        {
            Assembly assembly = Assembly.LoadFrom(file);
            PortableExecutableKinds kinds;
            ImageFileMachine machine;
            assembly.ManifestModule.GetPEKind(out kinds, out machine);
            Console.WriteLine("assembly {0}, {1}, {2}", assembly.GetName().Name, kinds, machine);
            foreach (AssemblyName needed in assembly.GetReferencedAssemblies().OrderBy(name => name.Name))
                Console.WriteLine("  needs {0} {1}", needed.Name, needed.Version);
            foreach (Type type in assembly.GetExportedTypes().OrderBy(type => type.FullName, StringComparer.Ordinal))
            {
                string kind = type.IsValueType ? "struct" : type.IsAbstract && type.IsSealed ? "static class" : "class";
                Console.WriteLine("  {0} {1}", kind, type.FullName);
                if (type.IsValueType)
                    Console.WriteLine("    of {0} bytes", System.Runtime.InteropServices.Marshal.SizeOf(type));
                foreach (string member in Members(type))
                    Console.WriteLine("    " + member);
            }
        }
    }

    // In the order in which they were written.
    static IEnumerable<string> Members(Type type)
    {
        foreach (MemberInfo member in type.GetMembers(ALL).OrderBy(member => member.MetadataToken & 0xFFFFFF)
            .OrderBy(member => member.MemberType))
        {
            var field = member as FieldInfo;
            var method = member as MethodInfo;
            var property = member as PropertyInfo;
            if (field != null && field.IsLiteral)
                yield return string.Format("const {0} {1} = {2}", field.FieldType.Name, field.Name, field.GetRawConstantValue());
            else if (field != null)
                yield return string.Format("{0}{1} {2}", field.IsStatic ? "static " : "", Named(field.FieldType), field.Name);
            else if (property != null)
                yield return string.Format("static {0} {1} {{ get;{2} }}", property.PropertyType.Name, property.Name,
                    property.CanWrite ? " set;" : "");
            else if (method != null && !method.IsSpecialName)
                yield return string.Format("static {0} {1}({2})", method.ReturnType.Name, method.Name,
                    string.Join(", ", method.GetParameters().Select(parameter => parameter.ParameterType.Name)));
        }
    }

    static string Named(Type type)
    {
        return type.IsArray ? type.GetElementType().FullName + "[]" : type.Name;
    }
}
