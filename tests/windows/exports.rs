//! The contents of the files.

use std::collections::BTreeMap;

use object::Object as _;
use object::pe::{IMAGE_REL_BASED_DIR64, IMAGE_REL_BASED_HIGHLOW};
use object::read::pe::{ExportTarget, ImageNtHeaders, ImageOptionalHeader as _, PeFile, PeFile32, PeFile64};

use crate::fixture::Width;
use support::root;

/// Exports of the DLL: name and ordinal.
fn exports_of<P: ImageNtHeaders>(file: &PeFile<'_, P>) -> Vec<(String, u16)> {
    let table = file.export_table().expect("readable").expect("a table of exports");
    let exports = table.exports().expect("readable");
    let code = |target: &ExportTarget<'_>| matches!(target, ExportTarget::Address(_));
    assert!(exports.iter().all(|export| code(&export.target)), "an export leads to another DLL");
    let name = |name: Option<&[u8]>| String::from_utf8_lossy(name.expect("every export has a name")).into_owned();
    let mut exports: Vec<_> = exports.iter().map(|export| (name(export.name), export.ordinal.0)).collect();
    exports.sort_by_key(|(_, ordinal)| *ordinal);
    exports
}

/// DLLs that the loader looks for.
fn imports_of<P: ImageNtHeaders>(file: &PeFile<'_, P>) -> Vec<String> {
    let table = file.import_table().expect("readable").expect("a table of imports");
    let mut descriptors = table.descriptors().expect("readable");
    let mut names = Vec::new();
    while let Some(descriptor) = descriptors.next().expect("readable") {
        let name = table.name(descriptor.name.get(object::LittleEndian)).expect("readable");
        names.push(String::from_utf8_lossy(name).to_ascii_lowercase());
    }
    names
}

/// Base relocations by kind, and how many of 32 bits relocate a value that is no address in the DLL.
fn relocations_of<P: ImageNtHeaders>(file: &PeFile<'_, P>) -> (BTreeMap<u16, usize>, usize) {
    let sections = file.section_table();
    let base = file.relative_address_base();
    let image = base..base + u64::from(file.nt_headers().optional_header().size_of_image());
    let blocks = file.data_directories().relocation_blocks(file.data(), &sections).expect("readable");
    let mut blocks = blocks.expect("Windows loads it where it likes");
    let (mut kinds, mut wrong) = (BTreeMap::new(), 0);
    while let Some(block) = blocks.next().expect("readable") {
        for relocation in block {
            *kinds.entry(relocation.typ.0).or_default() += 1;
            if relocation.typ == IMAGE_REL_BASED_HIGHLOW {
                let place = sections.pe_data_at(file.data(), relocation.virtual_address).expect("in a section");
                let value = u32::from_le_bytes(place[..4].try_into().expect("four bytes"));
                wrong += usize::from(!image.contains(&value.into()));
            }
        }
    }
    (kinds, wrong)
}

/// Offsets of the DLL's sections in the file.
fn places_of<P: ImageNtHeaders>(file: &PeFile<'_, P>) -> Vec<u32> {
    let sections = file.section_table();
    sections.iter().map(|section| section.pointer_to_raw_data.get(object::LittleEndian)).collect()
}

/// Applies to the DLL of a width.
macro_rules! of_dll {
    ($width:expr, $bytes:expr, $function:ident) => {
        match $width {
            Width::X64 => $function(&PeFile64::parse($bytes).expect("a 64-bit DLL")),
            Width::X86 => $function(&PeFile32::parse($bytes).expect("a 32-bit DLL")),
        }
    };
}

/// The preferred base address.
fn base_of<P: ImageNtHeaders>(file: &PeFile<'_, P>) -> u64 {
    file.relative_address_base()
}

/// That of a width's DLL.
pub fn base(width: Width) -> u64 {
    of_dll!(width, &*width.dll(), base_of)
}

crate::for_each_width! {
    /// LIB-2, LIB-3, WIN-1 The DLL exports the vendor's four functions by names without decoration, with the ordinals 1
    /// to 4, then the others of the list, and nothing else.
    #[test]
    fn every_export_is_of_the_list(width: Width) {
        let list = std::fs::read_to_string(root().join("capi/exports.txt")).expect("capi/exports.txt");
        let names = list.lines().filter(|line| !line.is_empty() && !line.starts_with('#')).map(str::to_owned);
        let expected: Vec<(String, u16)> = names.zip(1..).collect();
        assert_eq!(expected[..4].iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>(), [
            "OpenECMUSB",
            "CloseECMUSB",
            "ECMUSBWrite",
            "ECMUSBRead"
        ]);
        let bytes = width.dll();
        assert_eq!(of_dll!(width, &*bytes, exports_of), expected);
    }

    /// WIN-2 It imports only DLLs that every Windows since 7 has.
    #[test]
    fn only_system_dlls_are_imported(width: Width) {
        let system = [
            "advapi32.dll", "bcrypt.dll", "cfgmgr32.dll", "gdi32.dll", "hid.dll", "kernel32.dll", "setupapi.dll", "shell32.dll", "msvcrt.dll", "ntdll.dll", "user32.dll", "userenv.dll", "ws2_32.dll"];
        for file in ["NEXTWUSBLib.dll", "ecmsk.exe"] {
            let bytes = std::fs::read(width.stage().join(file)).expect("a file of the stage");
            let imports = of_dll!(width, &*bytes, imports_of);
            assert!(imports.iter().all(|name| system.contains(&name.as_str())), "{file}: {imports:?}");
            assert!(imports.iter().any(|name| name == "kernel32.dll"), "{file}: {imports:?}");
        }
    }

    /// WIN-14 Loaded at another base, only addresses are relocated: thread-local data keep their offset.
    #[test]
    fn addresses_alone_are_relocated(width: Width) {
        let bytes = width.dll();
        let (kinds, wrong) = of_dll!(width, &*bytes, relocations_of);
        assert_eq!(wrong, 0, "{kinds:?}");
        let addresses = match width {
            Width::X64 => IMAGE_REL_BASED_DIR64,
            Width::X86 => IMAGE_REL_BASED_HIGHLOW,
        };
        assert!(kinds.get(&addresses.0).is_some_and(|count| *count > 1000), "{kinds:?}");
    }

    /// WIN-15 Each section begins at a page of the file, so that it can be mapped without copying.
    #[test]
    fn the_file_is_as_it_is_in_memory(width: Width) {
        let bytes = width.dll();
        let places = of_dll!(width, &*bytes, places_of);
        assert!(places.len() > 5 && places.iter().all(|place| place % 4096 == 0), "{places:x?}");
    }

    /// WIN-3 Windows shows the files' vendor and version.
    #[test]
    fn the_files_have_a_version(width: Width) {
        let wide = |text: &str| text.encode_utf16().flat_map(u16::to_le_bytes).collect::<Vec<u8>>();
        let has = |bytes: &[u8], part: &[u8]| bytes.windows(part.len()).any(|window| window == part);
        let number = |part: &str| part.parse::<u32>().expect("a number");
        let high = number(env!("CARGO_PKG_VERSION_MAJOR")) << 16 | number(env!("CARGO_PKG_VERSION_MINOR"));
        let low = number(env!("CARGO_PKG_VERSION_PATCH")) << 16;
        // Signature of VS_FIXEDFILEINFO, its own version, and the file's.
        let fixed: Vec<u8> = [0xFEEF_04BD_u32, 0x1_0000, high, low].into_iter().flat_map(u32::to_le_bytes).collect();
        for file in ["NEXTWUSBLib.dll", "ecmsk.exe"] {
            let bytes = std::fs::read(width.stage().join(file)).expect("a file of the stage");
            for text in ["VS_VERSION_INFO", "OriginalFilename", file, env!("CARGO_PKG_VERSION")] {
                assert!(has(&bytes, &wide(text)), "{file}: {text}");
            }
            assert!(has(&bytes, &fixed), "{file}");
        }
    }

    /// WIN-4 Neither file nor import libraries name a path of the machine that built them.
    #[test]
    fn no_path_of_the_builder(width: Width) {
        let mine = root().to_str().expect("UTF-8").as_bytes();
        let home = std::env::var("HOME").map(|home| format!("{home}/.cargo")).unwrap_or_default();
        for file in ["NEXTWUSBLib.dll", "ecmsk.exe", "NEXTWUSBLib.lib", "libNEXTWUSBLib.dll.a"] {
            let bytes = std::fs::read(width.stage().join(file)).expect("a file of the stage");
            for path in [mine, home.as_bytes()].into_iter().filter(|path| !path.is_empty()) {
                let found = bytes.windows(path.len()).position(|window| window == path);
                assert_eq!(found, None, "{file} names {}", String::from_utf8_lossy(path));
            }
        }
        let bytes = width.dll();
        let symbols = object::File::parse(&*bytes).expect("a DLL").symbols().count();
        assert_eq!(symbols, 0, "what a debugger needs is not in it");
    }
}
