//! Makes the import libraries: the files that a linker reads instead of the DLL, with every name by which programs refer to its
//! functions.
//!
//! Programs refer to a vendor's function by one of two names: some copies of the vendor's headers declare it inside `extern
//! "C"`, and with the others a C++ program uses the mangled name. Both names are mapped to the same export, whose name is
//! undecorated.

use std::fs::{self, File};
use std::path::Path;
use std::process::Command;

use ar_archive_writer::{COFFShortExport, MachineTypes, write_import_library};

use super::DLL;
use super::Width;
use crate::command;
use crate::error::Error;

/// The import library for Microsoft's linker.
pub const MSVC: &str = "NEXTWUSBLib.lib";
/// The import library for MinGW's linker.
pub const MINGW: &str = "libNEXTWUSBLib.dll.a";

/// The list of exports, in the order of their ordinals.
const EXPORTS: &str = include_str!("../../../capi/exports.txt");

/// The names by which programs refer to one of the vendor's functions.
struct Vendor {
    name: &'static str,
    /// The size of its arguments in bytes on x86, which is a part of its `__stdcall` name.
    stdcall: u8,
    /// The suffix of its mangled name with Microsoft's compiler, for x86 and for x64.
    msvc: [&'static str; 2],
    /// Its mangled name with MinGW's compiler (Itanium C++ ABI), the same for both widths.
    itanium: &'static str,
}

/// The vendor's functions. Their types are `bool(void)`, `void(void)` and `bool(unsigned char *, unsigned long)`.
const VENDOR: [Vendor; 4] = [
    Vendor { name: "OpenECMUSB", stdcall: 0, msvc: ["@@YG_NXZ", "@@YA_NXZ"], itanium: "_Z10OpenECMUSBv" },
    Vendor { name: "CloseECMUSB", stdcall: 0, msvc: ["@@YGXXZ", "@@YAXXZ"], itanium: "_Z11CloseECMUSBv" },
    Vendor { name: "ECMUSBWrite", stdcall: 8, msvc: ["@@YG_NPAEK@Z", "@@YA_NPEAEK@Z"], itanium: "_Z11ECMUSBWritePhm" },
    Vendor { name: "ECMUSBRead", stdcall: 8, msvc: ["@@YG_NPAEK@Z", "@@YA_NPEAEK@Z"], itanium: "_Z10ECMUSBReadPhm" },
];

/// Writes the import libraries for both linkers into the folder `place`.
pub fn write(width: Width, place: &Path) -> Result<(), Error> {
    msvc(width, &place.join(MSVC))?;
    mingw(width, place)
}

/// An entry of an import library: the symbol that a program uses, the export that it refers to, and its ordinal.
type Entry = (String, &'static str, u16);

fn exports() -> impl Iterator<Item = (&'static str, u16)> {
    let names = EXPORTS.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#'));
    names.zip(1..)
}

/// The entries for the symbols that Microsoft's compiler uses.
fn msvc_entries(width: Width) -> Vec<Entry> {
    let entries = exports().flat_map(|(name, ordinal)| {
        let vendor = VENDOR.iter().find(|vendor| vendor.name == name);
        let symbols = match (vendor, width) {
            (Some(vendor), Width::X86) => {
                vec![format!("_{name}@{}", vendor.stdcall), format!("?{name}{}", vendor.msvc[0])]
            }
            (Some(vendor), Width::X64) => vec![name.to_owned(), format!("?{name}{}", vendor.msvc[1])],
            (None, Width::X86) => vec![format!("_{name}")],
            (None, Width::X64) => vec![name.to_owned()],
        };
        symbols.into_iter().map(move |symbol| (symbol, name, ordinal))
    });
    entries.collect()
}

fn msvc(width: Width, path: &Path) -> Result<(), Error> {
    let machine = match width {
        Width::X86 => MachineTypes::I386,
        Width::X64 => MachineTypes::AMD64,
    };
    let export = |(symbol, name, ordinal): Entry| COFFShortExport {
        // If the symbol differs from the export's name, the entry tells the linker to find the export by removing the
        // decoration of the symbol.
        name: name.to_owned(),
        symbol_name: Some(symbol),
        ext_name: None,
        import_name: None,
        export_as: None,
        // The hint: the index in the export table at which the loader looks first. Ordinals count from 1, indexes from 0.
        ordinal: ordinal - 1,
        noname: false,
        data: false,
        private: false,
        constant: false,
    };
    let exports: Vec<COFFShortExport> = msvc_entries(width).into_iter().map(export).collect();
    let mut file = File::create(path).map_err(Error::file("write", path))?;
    write_import_library(&mut file, DLL, &exports, machine, false, false, &[]).map_err(Error::file("write", path))
}

/// The module definition file for dlltool. Each line has a symbol (without the leading underscore that all symbols have on
/// x86), the ordinal, and after `==` the name of the export.
fn mingw_definition(width: Width) -> String {
    let mut lines = vec![format!("LIBRARY {DLL}"), "EXPORTS".to_owned()];
    for (name, ordinal) in exports() {
        let Some(vendor) = VENDOR.iter().find(|vendor| vendor.name == name) else {
            lines.push(format!("{name} @{ordinal}"));
            continue;
        };
        for symbol in [name, vendor.itanium] {
            let decorated = match width {
                Width::X86 => format!("{symbol}@{}", vendor.stdcall),
                Width::X64 => symbol.to_owned(),
            };
            let same = if decorated == name { String::new() } else { format!(" == {name}") };
            lines.push(format!("{decorated} @{ordinal}{same}"));
        }
    }
    lines.join("\n") + "\n"
}

fn mingw(width: Width, place: &Path) -> Result<(), Error> {
    // File names without folders are passed, because dlltool makes symbols of these names.
    let definition = Path::new("NEXTWUSBLib.def");
    let path = place.join(definition);
    fs::write(&path, mingw_definition(width)).map_err(Error::file("write", &path))?;
    let mut dlltool = Command::new(format!("{}-dlltool", width.mingw()));
    // These options make the output reproducible. Otherwise the members of the library would be named by temporary files, whose
    // names contain the process id.
    dlltool.current_dir(place).args(["--deterministic-libraries", "--temp-prefix", "NEXTWUSBLib", "--input-def"]);
    command::run(dlltool.arg(definition).args(["--output-lib", MINGW]))?;
    fs::remove_file(&path).map_err(Error::file("remove", &path))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn symbols(width: Width) -> Vec<String> {
        msvc_entries(width).into_iter().map(|(symbol, _, _)| symbol).collect()
    }

    #[test]
    fn a_vendors_function_has_both_names() {
        assert_eq!(
            symbols(Width::X86)[..8],
            [
                "_OpenECMUSB@0",
                "?OpenECMUSB@@YG_NXZ",
                "_CloseECMUSB@0",
                "?CloseECMUSB@@YGXXZ",
                "_ECMUSBWrite@8",
                "?ECMUSBWrite@@YG_NPAEK@Z",
                "_ECMUSBRead@8",
                "?ECMUSBRead@@YG_NPAEK@Z",
            ]
        );
        assert_eq!(symbols(Width::X86)[8], "_ecmsk_version");
        assert_eq!(symbols(Width::X64)[..2], ["OpenECMUSB", "?OpenECMUSB@@YA_NXZ"]);
        assert_eq!(symbols(Width::X64)[8], "ecmsk_version");
    }

    #[test]
    fn a_definition_leads_every_symbol_to_its_export() {
        let definition = mingw_definition(Width::X86);
        assert!(definition.contains("\nOpenECMUSB@0 @1 == OpenECMUSB\n_Z10OpenECMUSBv@0 @1 == OpenECMUSB\n"));
        assert!(mingw_definition(Width::X64).contains("\nOpenECMUSB @1\n_Z10OpenECMUSBv @1 == OpenECMUSB\n"));
    }
}
