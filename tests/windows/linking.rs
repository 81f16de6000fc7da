//! Linking with the import libraries, by every name that programs use for the functions, with declarations of the
//! test's own.

use std::process::Command;

use object::read::pe::{ImageNtHeaders, Import, PeFile, PeFile32, PeFile64};

use crate::fixture::{DLL, Folder, Width, source};
use support::{self, succeed};

const LINK: &str = "sim:?slaves=drive*2&clock=virtual";

/// Sources and how they declare the functions.
const SPELLINGS: [(&str, &[&str]); 3] = [("declared.c", &[]), ("declared.cpp", &["-DEXTERN_C"]), ("declared.cpp", &[])];

/// A program's imports from the DLL.
fn imports_of<P: ImageNtHeaders>(file: &PeFile<'_, P>) -> Vec<String> {
    let table = file.import_table().expect("readable").expect("a table of imports");
    let mut descriptors = table.descriptors().expect("readable");
    let mut found = Vec::new();
    while let Some(descriptor) = descriptors.next().expect("readable") {
        let name = table.name(descriptor.name.get(object::LittleEndian)).expect("readable");
        if name != DLL.as_bytes() {
            continue;
        }
        let first = descriptor.original_first_thunk.get(object::LittleEndian);
        let mut thunks = table.thunks(first).expect("readable");
        while let Some(thunk) = thunks.next::<P>().expect("readable") {
            found.push(match table.import::<P>(thunk).expect("readable") {
                Import::Name(_, name) => String::from_utf8_lossy(name).into_owned(),
                Import::Ordinal(ordinal) => format!("#{ordinal}"),
            });
        }
    }
    found.sort();
    found
}

fn imports(folder: &Folder, program: &str) -> Vec<String> {
    let bytes = std::fs::read(folder.path().join(program)).expect("the program");
    match folder.width {
        Width::X64 => imports_of(&PeFile64::parse(&*bytes).expect("a 64-bit program")),
        Width::X86 => imports_of(&PeFile32::parse(&*bytes).expect("a 32-bit program")),
    }
}

/// The exit code says which step failed.
fn works(folder: &Folder, program: &str) {
    let ended = folder.run(program, LINK, [""; 0]);
    assert_eq!((ended.status.code(), ended.stderr.as_str()), (Some(0), ""), "{program}");
}

/// The linker of MinGW, for a program that begins at `start` and needs no C library.
fn mingw(width: Width, input: &str) -> Command {
    let compiler = if input.ends_with(".c") { "gcc" } else { "g++" };
    let mut gcc = Command::new(format!("{}-w64-mingw32-{compiler}", width.machine()));
    let start = if width == Width::X86 { "-Wl,-e,_start" } else { "-Wl,-e,start" };
    gcc.args(["-O1", "-Wall", "-Wextra", "-Werror", "-nostartfiles", "-nostdlib", start]).arg(source(input));
    gcc
}

crate::for_each_width! {
    /// LIB-10, LIB-11, LIB-12, LIB-7, WIN-5 Microsoft's linker resolves extern "C" and C++ names to the undecorated exports.
    #[test]
    fn names_of_microsofts_compiler(width: Width) {
        let folder = Folder::with_dll(width, "linking-msvc");
        for (number, (input, options)) in SPELLINGS.into_iter().enumerate() {
            let program = format!("spelling{number}.exe");
            let object = folder.object(&source(input), &program, options);
            // Without `/safeseh:no`: the library allows it.
            succeed(folder.lld_link(&program).arg(object).arg("/entry:start"));
            assert_eq!(imports(&folder, &program), ["CloseECMUSB", "ECMUSBRead", "ECMUSBWrite", "OpenECMUSB"]);
            works(&folder, &program);
        }
    }

    /// LIB-12, LIB-7, WIN-5 MinGW's linker resolves extern "C" and C++ names to the undecorated exports.
    #[test]
    fn names_of_mingw(width: Width) {
        let folder = Folder::with_dll(width, "linking-mingw");
        for (number, (input, options)) in SPELLINGS.into_iter().enumerate() {
            let program = format!("spelling{number}.exe");
            let mut gcc = mingw(width, input);
            gcc.args(options).arg("-o").arg(folder.path().join(&program));
            succeed(gcc.arg("-L").arg(width.stage()).arg("-lNEXTWUSBLib"));
            assert_eq!(imports(&folder, &program), ["CloseECMUSB", "ECMUSBRead", "ECMUSBWrite", "OpenECMUSB"]);
            works(&folder, &program);
        }
    }

    /// LIB-3, WIN-6 A program may import the functions by their ordinals.
    #[test]
    fn imports_by_ordinal(width: Width) {
        let folder = Folder::with_dll(width, "linking-ordinals");
        let functions = [("OpenECMUSB", 0), ("CloseECMUSB", 0), ("ECMUSBWrite", 8), ("ECMUSBRead", 8)];
        let lines = functions.into_iter().zip(1..).map(|((name, bytes), ordinal)| match width {
            Width::X86 => format!("{name}@{bytes} @{ordinal} NONAME\n"),
            Width::X64 => format!("{name} @{ordinal} NONAME\n"),
        });
        let definition = folder.path().join("ordinals.def");
        let text = format!("LIBRARY {DLL}\nEXPORTS\n{}", lines.collect::<String>());
        std::fs::write(&definition, text).expect("a file of the folder");
        let library = folder.path().join("libordinals.a");
        let mut dlltool = Command::new(format!("{}-w64-mingw32-dlltool", width.machine()));
        succeed(dlltool.arg("--input-def").arg(&definition).arg("--output-lib").arg(&library));
        let program = "ordinals.exe";
        succeed(mingw(width, "declared.c").arg("-o").arg(folder.path().join(program)).arg(&library));
        assert_eq!(imports(&folder, program), ["#1", "#2", "#3", "#4"]);
        works(&folder, program);
    }

    /// LIB-3, LIB-5, LIB-39, LIB-40, WIN-6 LoadLibrary and GetProcAddress by name and by ordinal; all of EAX is 0 or 1; the functions
    /// take their arguments off the stack.
    #[test]
    fn functions_by_name_and_by_ordinal(width: Width) {
        let folder = Folder::with_dll(width, "linking-loaded");
        folder.build(crate::fixture::Toolchain::MinGw, &source("by_name.c"), "by_name.exe");
        assert_eq!(imports(&folder, "by_name.exe"), [""; 0], "it loads the DLL by name");
        folder.passes("by_name.exe", LINK, &[]);
        folder.passes("by_name.exe", LINK, &["ordinals"]);
    }

    /// WIN-5 Both import libraries also have this project's functions.
    #[test]
    fn libraries_have_the_other_functions(width: Width) {
        let list = std::fs::read_to_string(support::root().join("capi/exports.txt")).expect("capi/exports.txt");
        let underscore = if width == Width::X86 { "_" } else { "" };
        let mut nm = Command::new(format!("{}-w64-mingw32-nm", width.machine()));
        let symbols = succeed(nm.arg(width.stage().join("libNEXTWUSBLib.dll.a")).stderr(std::process::Stdio::null()));
        let bytes = std::fs::read(width.stage().join("NEXTWUSBLib.lib")).expect("the library");
        let archive = object::read::archive::ArchiveFile::parse(&*bytes).expect("an archive");
        let table = archive.symbols().expect("readable").expect("a table of symbols");
        let known: Vec<String> =
            table.map(|symbol| String::from_utf8_lossy(symbol.expect("readable").name()).into_owned()).collect();
        for name in list.lines().filter(|line| line.starts_with("ecmsk_")) {
            let symbol = format!("{underscore}{name}");
            assert!(symbols.contains(&format!(" T {symbol}\n")), "{symbol}");
            assert!(known.contains(&symbol) && known.contains(&format!("__imp_{symbol}")), "{symbol}: {known:?}");
        }
        // Symbols that Microsoft's linker requires itself, once per DLL.
        for part in ["__IMPORT_DESCRIPTOR_NEXTWUSBLib", "__NULL_IMPORT_DESCRIPTOR", "\u{7F}NEXTWUSBLib_NULL_THUNK_DATA"] {
            assert!(known.iter().any(|symbol| symbol == part), "{part}: {known:?}");
        }
    }
}
