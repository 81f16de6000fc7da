//! The compiled files: their public members, their documentation, their bytes.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use crate::dotnet::packages::with_packages;
use crate::dotnet::runtime::Runtime::Mono;
use support::dotnet::{ASSEMBLIES, EXAMPLES, Pair, VENDOR_ASSEMBLIES, VIRTUAL, compiled, test_program, vendor_program};
use support::{self, out_dir, root};

fn assembly(name: &str) -> PathBuf {
    Pair::X86.ours(name)
}

/// Which lines of the table count.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Whose {
    Vendors,
    Ours,
}

/// The lines of the table for an assembly.
fn facts(assembly: &str, pair: Pair, whose: Whose) -> String {
    let table = fs::read_to_string(root().join("tests/capi/dotnet/surface.txt")).expect("the table");
    // The assembly of the guides' samples is the one with slots of 12 bytes.
    let listed = if assembly == "NEXTWUSB_dotNET" { "NEXTWUSB_dotNET_12B" } else { assembly };
    let (_, part) = table.split_once(&format!("\n assembly {listed} ")).expect("it is in the table");
    let part = part.split("\n assembly ").next().expect("the part of it").trim_end();
    let (first, rest) = part.split_once('\n').expect("lines");
    let mut text = format!("assembly {listed} {first}\n");
    for line in rest.lines() {
        let (mark, line) = line.split_at(1);
        let of_pair = line.trim_start().strip_prefix('x').and_then(|_| line.trim_start().split_once(": "));
        let line = match of_pair {
            Some((name, _)) if name != pair.name() => continue,
            Some((_, kind)) => format!("  {kind}"),
            None => line.to_owned(),
        };
        match (mark, whose) {
            (" ", _) | ("-", Whose::Vendors) | ("+", Whose::Ours) => text.extend([line.as_str(), "\n"]),
            ("-" | "+", _) => {}
            _ => panic!("a line begins with a blank, - or +: {mark}{line}"),
        }
    }
    text.replace(listed, assembly)
}

/// The metadata of a file.
fn metadata(file: &Path) -> String {
    let program = test_program("Surface", "NEXTWUSB_dotNET");
    support::run(Mono.command(&program, VIRTUAL).arg(file)).success()
}

/// LIB-29, LIB-30, LIB-31, LIB-32, LIB-34, NET-1, NET-14, NET-15, NET-16, NET-17, NET-18, NET-19 The metadata of this
/// project's assemblies, of either pair, are those of the table: file, versions, references, members, types, values.
#[test]
fn our_metadata_are_those_of_the_table() {
    for name in ASSEMBLIES {
        for pair in Pair::ALL {
            let said = metadata(&pair.ours(name));
            assert_eq!(said, facts(name, pair, Whose::Ours), "{name} {pair:?}");
        }
    }
}

/// The stand-in for the vendor's assemblies has exactly the members of the table, too: it imports the library by
/// ordinals 1 to 4. So a program compiled against it equals one compiled against the vendor's.
#[test]
fn the_stand_ins_metadata_are_those_of_the_table() {
    for name in VENDOR_ASSEMBLIES {
        for pair in Pair::ALL {
            let said = metadata(&pair.stand_in(name));
            assert_eq!(said, facts(name, pair, Whose::Vendors), "{name} {pair:?}");
        }
    }
}

/// LIB-31 The constants are those of the C headers, by name and value; the vendor's two names of commands are beside the headers'.
#[test]
fn constants_are_those_of_the_headers() {
    for (name, header) in [("NEXTWUSB_dotNET_12B", "NEXTWUSBLib_12B.h"), ("NEXTWUSB_dotNET_16B", "NEXTWUSBLib_16B.h")] {
        let said = metadata(&assembly(name));
        let constants = said.lines().filter_map(|line| line.trim().strip_prefix("public const "));
        let constants: BTreeSet<(String, i64)> = constants
            .map(|line| line.split_once(' ').expect("a type").1.split_once(" = ").expect("a value"))
            .map(|(name, value)| (name.to_owned(), value.parse().expect("a number")))
            .collect();
        let text = fs::read_to_string(support::include_dir().join(header)).expect("the header");
        let defines = text.lines().filter_map(|line| line.trim().strip_prefix("#define ")?.split_once(' '));
        let mut defines: BTreeSet<(String, i64)> = defines
            .filter_map(|(name, value)| {
                let hex = value.strip_prefix("0x").map(|digits| i64::from_str_radix(digits, 16).ok());
                Some((name.to_owned(), hex.unwrap_or_else(|| value.parse().ok())?))
            })
            .collect();
        defines.extend([("SDO_EX".to_owned(), 4), ("SDO_FIFO".to_owned(), 5)]);
        assert_eq!(constants, defines, "{name}");
        assert!(constants.len() > 35, "{}", constants.len());
    }
}

/// NET-14, NET-15, NET-16, NET-17 A program that needs the true type of each constant does not compile against constants of
/// another one: here `int`, as the guide's table has them.
#[test]
fn the_program_of_types_needs_them() {
    let folder = out_dir().join("of-int");
    fs::create_dir_all(&folder).expect("a folder in the target folder");
    let source = fs::read_to_string(support::dotnet::sources().join("StandIn.cs")).expect("the stand-in");
    for (which, line) in [("ushort", 1), ("uint", 2), ("short", 3)] {
        let of_int = source.replace(&format!("public const {which} "), "public const int ");
        assert_ne!(of_int, source);
        let (dll, file) = (folder.join("NEXTWUSB_dotNET_12B.dll"), folder.join("StandIn.cs"));
        fs::write(&file, of_int).expect("a source");
        let mcs = |out: &Path| {
            let mut mcs = std::process::Command::new("mcs");
            mcs.arg("-langversion:4").arg(format!("-out:{}", out.display()));
            mcs
        };
        support::succeed(mcs(&dll).arg("-target:library").arg(&file));
        let exe = folder.join(format!("Types-{line}.exe"));
        let mut compiler = mcs(&exe);
        compiler.arg(format!("-r:{}", dll.display())).arg(support::dotnet::sources().join("Types.cs"));
        let said = compiler.output().expect("mcs runs");
        assert!(!said.status.success(), "{which}");
        let text = String::from_utf8_lossy(&[said.stdout, said.stderr].concat()).into_owned();
        assert!(text.contains("error CS"), "{text}");
    }
    vendor_program("Types", "NEXTWUSB_dotNET_12B");
}

/// NET-1 All public members are documented, and no others are.
#[test]
fn documentation() {
    for name in ASSEMBLIES {
        let text = fs::read_to_string(assembly(name).with_extension("xml")).expect("the documentation");
        let xml = roxmltree::Document::parse(&text).expect("XML");
        let members = xml.descendants().filter(|node| node.has_tag_name("member"));
        let documented: BTreeSet<String> = members
            .filter(|node| node.text().is_some())
            .map(|node| node.attribute("name").expect("a name")[2..].split('(').next().expect("a name").to_owned())
            .collect();
        assert_eq!(documented, members_of(&facts(name, Pair::X86, Whose::Ours)), "{name}");
    }
}

/// The full names of what a part of the surface lists.
fn members_of(surface: &str) -> BTreeSet<String> {
    let mut names = BTreeSet::new();
    let mut owner = String::new();
    for line in surface.lines() {
        if let Some(member) = line.strip_prefix("    public ") {
            let words: Vec<&str> = member.split(' ').filter(|word| !["static", "const"].contains(word)).collect();
            let name = words[1].split('(').next().expect("a name");
            names.insert(format!("{owner}.{name}"));
        } else if let Some(kind) = line.strip_prefix("  public ") {
            let name = kind.split(", ").next().expect("a name").rsplit(' ').next().expect("a name");
            owner = name.replace('+', ".");
            names.insert(owner.clone());
        }
    }
    names
}

/// NET-10 The same sources give the same bytes.
#[test]
fn compiled_twice_the_bytes_are_the_same() {
    let again = with_packages();
    let mut compared = 0;
    for folder in ["assemblies", "assemblies-x64", "ecmsk", "programs"] {
        for entry in fs::read_dir(compiled().join(folder)).expect("the folder") {
            let file = entry.expect("readable").path();
            let other = again.join(folder).join(file.file_name().expect("a name"));
            assert!(fs::read(&file).expect("a file") == fs::read(&other).expect("a file"), "{}", file.display());
            compared += 1;
        }
    }
    assert!(compared > 10, "{compared}");
}

/// NET-4 Every program of the folder is run by a test.
#[test]
fn no_program_is_left_out() {
    let entries = fs::read_dir(root().join("examples/csharp")).expect("the folder");
    let files = entries.map(|entry| entry.expect("readable").path());
    let mut names: Vec<String> = files
        .filter(|file| file.extension().is_some_and(|extension| extension == "cs"))
        .filter(|file| fs::read_to_string(file).expect("a source").contains(" Main("))
        .map(|file| file.file_stem().expect("a name").to_string_lossy().into_owned())
        .collect();
    names.sort();
    assert_eq!(names, EXAMPLES.map(|(name, _, _)| name));
}
