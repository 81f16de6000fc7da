//! The compiled files: what they show to programs, their documentation, their bytes.

use std::collections::BTreeSet;
use std::fs;

use crate::dotnet::runtime::Runtime::Mono;
use support::dotnet::{ASSEMBLIES, EXAMPLES, VIRTUAL, compile_into, compiled, test_program};
use support::{self, out_dir, root};

fn assembly(name: &str) -> std::path::PathBuf {
    compiled().join("assemblies").join(name).with_extension("dll")
}

/// LIB-29, LIB-30, LIB-31, LIB-32, LIB-34, NET-1 All that the assemblies show to programs, and that they run at any width and
/// need nothing but .NET itself, of version 4.
#[test]
fn the_surface() {
    let program = test_program("Surface", "NEXTWUSB_dotNET");
    let mut command = Mono.command(&program, VIRTUAL);
    let said = support::run(command.args(ASSEMBLIES.map(assembly))).success();
    support::snapshot("dotnet_surface", &said);
}

/// LIB-31, LIB-34 Constants stand in fields of slots, in cases of a switch and in variables of any type that they fit.
#[test]
fn constants() {
    let program = test_program("Constants", "NEXTWUSB_dotNET_12B");
    assert_eq!(Mono.run(&program, VIRTUAL, &[]).success(), "21 17 18 2 3 34 8\n");
}

/// LIB-31, LIB-34 The constants are those of the C headers, by name and value.
#[test]
fn constants_are_those_of_the_headers() {
    let program = test_program("Surface", "NEXTWUSB_dotNET");
    for (name, header) in [("NEXTWUSB_dotNET_12B", "NEXTWUSBLib_12B.h"), ("NEXTWUSB_dotNET_16B", "NEXTWUSBLib_16B.h")] {
        let said = support::run(Mono.command(&program, VIRTUAL).arg(assembly(name))).success();
        let constants = said.lines().filter_map(|line| line.trim().strip_prefix("const Int32 "));
        let constants: BTreeSet<(String, i64)> = constants
            .map(|line| line.split_once(" = ").expect("a value"))
            .map(|(name, value)| (name.to_owned(), value.parse().expect("a number")))
            .collect();
        let text = fs::read_to_string(support::include_dir().join(header)).expect("the header");
        let defines = text.lines().filter_map(|line| line.trim().strip_prefix("#define ")?.split_once(' '));
        let defines: BTreeSet<(String, i64)> = defines
            .filter_map(|(name, value)| {
                let hex = value.strip_prefix("0x").map(|digits| i64::from_str_radix(digits, 16).ok());
                Some((name.to_owned(), hex.unwrap_or_else(|| value.parse().ok())?))
            })
            .collect();
        assert_eq!(constants, defines, "{name}");
        assert!(constants.len() > 35, "{}", constants.len());
    }
}

/// NET-1 Everything that programs see is documented, and nothing else is.
#[test]
fn documentation() {
    let surface = fs::read_to_string(root().join("tests/snapshots/dotnet_surface.txt")).expect("the snapshot");
    for name in ASSEMBLIES {
        let text = fs::read_to_string(assembly(name).with_extension("xml")).expect("the documentation");
        let xml = roxmltree::Document::parse(&text).expect("XML");
        let members = xml.descendants().filter(|node| node.has_tag_name("member"));
        let documented: BTreeSet<String> = members
            .filter(|node| node.text().is_some())
            .map(|node| node.attribute("name").expect("a name")[2..].to_owned())
            .collect();
        let (_, own) = surface.split_once(&format!("assembly {name}, ")).expect("it is in the list");
        let own = own.split("assembly ").next().expect("the part of it");
        assert_eq!(documented, members_of(own), "{name}");
    }
}

/// The full names of what a part of the surface lists.
fn members_of(surface: &str) -> BTreeSet<String> {
    let mut names = BTreeSet::new();
    let mut owner = String::new();
    for line in surface.lines().skip(1).filter(|line| !line.contains("needs ") && !line.contains(" bytes")) {
        if let Some(member) = line.strip_prefix("    ") {
            let words: Vec<&str> = member.split(' ').filter(|word| !["static", "const"].contains(word)).collect();
            let name = words[1].split('(').next().expect("a name");
            names.insert(format!("{owner}.{name}"));
        } else {
            owner = line.rsplit(' ').next().expect("a name").replace('+', ".");
            names.insert(owner.clone());
        }
    }
    names
}

/// NET-10 The same sources give the same bytes.
#[test]
fn compiled_twice_the_bytes_are_the_same() {
    let (again, _) = compile_into(&out_dir().join("compiled again"), &[]);
    let mut compared = 0;
    for folder in ["assemblies", "programs"] {
        for entry in fs::read_dir(compiled().join(folder)).expect("the folder") {
            let file = entry.expect("readable").path();
            let other = again.join(folder).join(file.file_name().expect("a name"));
            assert!(fs::read(&file).expect("a file") == fs::read(&other).expect("a file"), "{}", file.display());
            compared += 1;
        }
    }
    assert!(compared > 10, "{compared}");
}

/// NET-4 Every program of the folder is one of those that are run.
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
