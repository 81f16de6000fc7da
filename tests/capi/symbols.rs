//! The symbols of the built library for linker and loader.
#![cfg(target_os = "linux")]

use std::collections::BTreeSet;
use std::fs;

use object::read::elf::ElfFile64;
use object::{Endianness, Object as _, ObjectSymbol as _, elf};

fn listed() -> BTreeSet<String> {
    let list = fs::read_to_string(support::root().join("capi/exports.txt")).expect("capi/exports.txt");
    list.lines().filter(|line| !line.is_empty() && !line.starts_with('#')).map(str::to_owned).collect()
}

/// LIB-1 The shared library exports the four functions by their C names, the `ecmsk_*` ones, and nothing else: what
/// `capi/exports.txt` lists.
#[test]
fn only_the_listed_symbols_are_exported() {
    let bytes = fs::read(&support::library().shared).expect("the library");
    let file = ElfFile64::<Endianness>::parse(&*bytes).expect("an ELF file");
    let exported: BTreeSet<String> = file
        .dynamic_symbols()
        .filter(|symbol| symbol.is_definition())
        .map(|symbol| symbol.name().expect("a name").to_owned())
        .collect();
    assert_eq!(exported, listed());
    for name in ["OpenECMUSB", "CloseECMUSB", "ECMUSBWrite", "ECMUSBRead"] {
        assert!(exported.contains(name), "{name}");
    }
    assert!(exported.iter().skip_while(|name| !name.starts_with("ecmsk_")).all(|name| name.starts_with("ecmsk_")));
}

/// LIB-1 The library has a versioned SONAME, stays in memory when a program unloads it, and needs nothing but the C library.
#[test]
fn the_loader_finds_a_versioned_name_and_no_strange_needs() {
    let bytes = fs::read(&support::library().shared).expect("the library");
    let file = ElfFile64::<Endianness>::parse(&*bytes).expect("an ELF file");
    let table = file.elf_dynamic_table().expect("a dynamic section");
    let texts = |tag| {
        let entries = table.iter().filter(move |entry| entry.tag == tag);
        entries.map(|entry| String::from_utf8_lossy(table.string(entry).expect("a string")).into_owned())
    };
    assert_eq!(texts(elf::DT_SONAME).collect::<Vec<_>>(), ["libNEXTWUSBLib.so.0"]);
    let system = ["libc.so.6", "libm.so.6", "libgcc_s.so.1", "libpthread.so.0", "libdl.so.2", "ld-linux-x86-64.so.2"];
    for needed in texts(elf::DT_NEEDED) {
        assert!(system.contains(&needed.as_str()) || needed.starts_with("ld-linux"), "needs {needed}");
    }
    let flags = table.iter().find(|entry| entry.tag == elf::DT_FLAGS_1).expect("DT_FLAGS_1");
    assert_ne!(flags.val & elf::DF_1_NODELETE.0, 0);
}

/// LIB-1 The static library has the same functions.
#[test]
fn the_static_library_has_the_same_functions() {
    let bytes = fs::read(&support::library().archive).expect("the static library");
    let archive = object::read::archive::ArchiveFile::parse(&*bytes).expect("an archive");
    let mut missing = listed();
    for member in archive.members() {
        let data = member.expect("a member").data(&*bytes).expect("its bytes");
        let Ok(file) = object::File::parse(data) else { continue };
        for symbol in file.symbols().filter(|symbol| symbol.is_definition() && symbol.is_global()) {
            missing.remove(symbol.name().expect("a name"));
        }
    }
    assert_eq!(missing, BTreeSet::new());
}
