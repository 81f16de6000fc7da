//! Tests for every runtime: the programs of `examples/csharp/`, programs that were compiled against the vendor's
//! assemblies, and programs that misuse them.

use std::fs;
use std::path::Path;

use ecmsk::link::Dir;
use ecmsk::recording::Recording;
use ecmsk::sk::SlotSize;

use crate::dotnet::runtime::Runtime;
use support::dotnet::{
    EXAMPLES, Pair, REAL, VENDOR_ASSEMBLIES, VIRTUAL, beside, example, test_program, told_types, vendor_program,
};
use support::{Language, Program, out_dir, root};

fn scripted(keys: &str) -> String {
    keys.replace("SCRIPTS", root().join("examples/scripts").to_str().expect("UTF-8"))
}

/// The examples print their snapshots, on both firmwares.
pub fn examples(runtime: Runtime) {
    for (name, snapshot, keys) in EXAMPLES {
        let link = format!("{VIRTUAL}{}", scripted(keys));
        runtime.prints(name, snapshot, &link);
        runtime.prints(name, snapshot, &format!("{link}&fw=1.5"));
    }
}

/// A program whose axis has an alarm reports it, exits with 1, and leaves the axes off and the network in PreOP.
pub fn an_end_by_an_alarm(runtime: Runtime) {
    let file = out_dir().join(format!("alarm-{runtime:?}.pcapng"));
    let link = format!("{VIRTUAL}{}&record={}", scripted("&script=SCRIPTS/alarm.ecmscript"), file.display());
    let ended = runtime.run(&example("TwoAxes12B"), &link, &[]);
    assert_eq!((ended.status.code(), ended.stderr.as_str()), (Some(1), "failed: an axis does not arrive\n"));
    support::both_axes_are_off_in_preop(&file);
}

/// A program writes the CRC of its frames itself, and the board refuses a wrong one; a response with a wrong CRC is
/// read, and the program sees that when it checks.
pub fn the_crc(runtime: Runtime) {
    for (assembly, size) in [("NEXTWUSB_dotNET_12B", SlotSize::Bytes12), ("NEXTWUSB_dotNET_16B", SlotSize::Bytes16)] {
        let slot = size.bytes();
        let program = test_program("Frames", assembly);
        let file = out_dir().join(format!("frames-{slot}-{runtime:?}.pcapng"));
        let link = format!("{VIRTUAL}&slot={slot}&record={}", file.display());
        let said = runtime.run(&program, &link, &[]).success();
        let expected = "as it comes: read True, CRC right True, there, old data False\n\
                        commands are checked: errors 0\nnot signed: errors 1\nsigned: errors 1\nsigned wrongly: errors 2\n\
                        with CRC: read True, CRC right True, there, old data False\n\
                        commands are not checked: errors 0\n\
                        without CRC: read True, CRC right False, 0, old data False\n";
        assert_eq!(said, expected, "{slot}");
        let frames = Recording::open(&file).expect("the recording").map(|recorded| recorded.expect("a frame"));
        let first = frames.into_iter().find(|recorded| recorded.dir == Dir::Write).expect("a frame").frame;
        let bytes = &first.bytes()[..size.frame_len()];
        assert_eq!((bytes[2], bytes[3], bytes[slot + 2], bytes[slot + 4]), (0, 0xA5, 1, 1), "as the program wrote it");

        let lies = format!("{VIRTUAL}&slot={slot}&fault.corrupt.read=1");
        let said = runtime.run(&program, &lies, &["once"]).success();
        assert!(
            said.starts_with("as it comes: read True, CRC right False, ") && said.ends_with("old data False\n"),
            "{said}"
        );
    }
}

/// A program that was compiled against the vendor's assembly, byte for byte the same, runs on this project's assembly
/// in its place.
pub fn swapped(runtime: Runtime) {
    for assembly in VENDOR_ASSEMBLIES {
        let program = vendor_program("Types", assembly);
        let link = format!("{VIRTUAL}&slot={}", if assembly.ends_with("16B") { 16 } else { 12 });
        for pair in Pair::ALL {
            let folder = tempfile::tempdir().expect("a folder");
            let program = beside(&program, &pair.ours(assembly), folder.path());
            let ended = runtime.run(&program, &link, &[]);
            assert_eq!(ended.stderr, "", "{assembly} {pair:?}");
            assert_eq!(ended.success(), told_types(assembly), "{assembly} {pair:?}");
        }
    }
}

/// The output of `Rows` on a library that returns the written frame.
const ROWS: &str = "\
before any read: CRC right False
open True
write True, byte 3 stays 96
true read True: 1000 9601 11110000 FFFF0000, LAST
CRC right: False
false read False: 1000 9600 11110000 FFFF0000, LAST
CRC right: False
left alone, read False: 0000 0000 00000000 00000000, CRC right: False
signed, read True, CRC right True, again True
after a change True
signed, read False, CRC right True, again True
after a change True
5 written True, read True: 1004 A504 11110004 FFFEFFFC
50 written True, read True: LAST
5 read True: 1004 A504 11110004 FFFEFFFC, 5
50 read True: LAST, 7
null read False
cleared True, the same array True
clear 5: IndexOutOfRangeException, 0
clear null: NullReferenceException
5A 8D 28
AD AD 5A
NullReferenceException
ArgumentNullException buffer
ArgumentOutOfRangeException
ArgumentOutOfRangeException
ArgumentOutOfRangeException
ArgumentOutOfRangeException
ArgumentOutOfRangeException
";

/// The same with the last slot of an assembly.
fn rows(assembly: &str) -> String {
    let last = if assembly.ends_with("16B") { 31 } else { 41 };
    let slot = format!(
        "{:04X} {:04X} {:08X} {:08X}",
        0x1000 + last,
        0xA500 + last,
        0x1111_0000 + last,
        0xFFFF_0000_u32 - last
    );
    ROWS.replace("LAST", &slot)
}

/// A folder with the library `loopback.c`.
fn with_loopback() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    compile_shared("loopback.c", &folder.path().join("libNEXTWUSBLib.so"));
    folder
}

fn compile_shared(source: &str, to: &Path) {
    let mut compiler = Language::C("c99").compiler();
    compiler.args(["-shared", "-fPIC", "-o"]).arg(to).arg(root().join("tests/capi/dotnet/programs").join(source));
    support::succeed(&mut compiler);
}

/// The behaviour of the vendor's class, row by row.
pub fn behaviour(runtime: Runtime) {
    for assembly in VENDOR_ASSEMBLIES {
        let folder = with_loopback();
        let program = beside(&vendor_program("Rows", assembly), &Pair::X86.ours(assembly), folder.path());
        assert_eq!(runtime.run(&program, "", &[]).success(), rows(assembly), "{assembly}");
    }
}

/// The output of `Rows` without a library.
const MISSING: &str = "before any read: CRC right False\nopen DllNotFoundException\nwrite DllNotFoundException\nread False\n\
                       close DllNotFoundException\n";

/// Without a library Open, Write and Close throw what DllImport throws, and a read is false.
pub fn no_library(runtime: Runtime) {
    for assembly in VENDOR_ASSEMBLIES {
        let folder = tempfile::tempdir().expect("a folder");
        let program = beside(&vendor_program("Rows", assembly), &Pair::X86.ours(assembly), folder.path());
        let mut command = runtime.command(&program, VIRTUAL);
        let ended = support::run(command.env_remove("LD_LIBRARY_PATH").arg("missing"));
        assert_eq!(ended.success(), MISSING, "{assembly}");
    }
}

/// The vendor's own assembly beside a program, with the map that DOTNET.md shows for Mono.
fn with_stand_in(program: &str, assembly: &str, folder: &Path) -> Program {
    let page = fs::read_to_string(root().join("docs/DOTNET.md")).expect("the page");
    let map = page.split_once("```xml\n").and_then(|(_, rest)| rest.split_once("```")).expect("a map").0;
    fs::write(folder.join(format!("{assembly}.dll.config")), map).expect("a file");
    beside(&vendor_program(program, assembly), &Pair::X86.stand_in(assembly), folder)
}

/// The stand-in for the vendor's assembly behaves as the rows say, so that it is tested like this project's.
pub fn behaviour_of_the_stand_in() {
    for assembly in VENDOR_ASSEMBLIES {
        let folder = with_loopback();
        let program = with_stand_in("Rows", assembly, folder.path());
        let mut command = Runtime::Mono.command(&program, "");
        let ended = support::run(command.env("LD_LIBRARY_PATH", folder.path()));
        assert_eq!(ended.success(), rows(assembly), "{assembly}");

        let folder = tempfile::tempdir().expect("a folder");
        let program = with_stand_in("Rows", assembly, folder.path());
        let mut command = Runtime::Mono.command(&program, VIRTUAL);
        let ended = support::run(command.env_remove("LD_LIBRARY_PATH").arg("missing"));
        assert_eq!(ended.success(), MISSING, "{assembly}");
    }
}

/// The vendor's own assembly, which imports functions by their ordinals, runs on this library under Mono with a map.
pub fn mapped() {
    for assembly in VENDOR_ASSEMBLIES {
        let folder = tempfile::tempdir().expect("a folder");
        let program = with_stand_in("Types", assembly, folder.path());
        let link = format!("{VIRTUAL}&slot={}", if assembly.ends_with("16B") { 16 } else { 12 });
        assert_eq!(Runtime::Mono.run(&program, &link, &[]).success(), told_types(assembly), "{assembly}");
        // Without the map it does not work.
        fs::remove_file(folder.path().join(format!("{assembly}.dll.config"))).expect("a file");
        let ended = Runtime::Mono.run(&program, &link, &[]);
        assert!(!ended.status.success() && ended.stderr.contains("EntryPointNotFoundException"), "{ended:?}");
    }
}

/// Other arrays, calls while nothing is open, calls of finalisers.
pub fn misuse(runtime: Runtime) {
    for link in [VIRTUAL, REAL] {
        runtime.passes("Misuse", link);
    }
}

/// A write does not wait for a read that waits.
pub fn together(runtime: Runtime) {
    runtime.passes("Together", &format!("{REAL}&fault.drop.read=1"));
}

/// Programs end, whatever their threads are doing, with their own exit code.
pub fn endings(runtime: Runtime) {
    let program = test_program("Endings", "NEXTWUSB_dotNET");
    for link in [VIRTUAL, REAL] {
        for (how, code) in [("return", 0), ("exit", 7), ("closed", 0)] {
            let ended = runtime.run(&program, link, &[how]);
            assert_eq!((ended.status.code(), ended.stdout.as_str()), (Some(code), "reading\n"), "{how}: {ended:?}");
        }
        let ended = runtime.run(&program, link, &["throw"]);
        assert!(!ended.status.success() && ended.stderr.contains("on purpose"), "{ended:?}");
    }
    let silent = format!("{REAL}&fault.drop.read=1");
    for (how, code) in [("return", 0), ("exit", 7), ("closed", 0)] {
        for more in [&[how, "silent"][..], &[how, "silent", "handler"]] {
            // Mono waits for a read without end, unless the program closes the board.
            if runtime == Runtime::Mono && how != "closed" && more.len() == 2 {
                continue;
            }
            let ended = runtime.run(&program, &silent, more);
            assert_eq!((ended.status.code(), ended.stdout.as_str()), (Some(code), "reading\n"), "{more:?}: {ended:?}");
        }
    }
}

/// A program's own declarations, by I1 and by BOOL.
pub fn declared(runtime: Runtime) {
    let folder = tempfile::tempdir().expect("a folder");
    let program = alone(&test_program("Declared", "NEXTWUSB_dotNET"), folder.path());
    // .NET Core looks for a file of the declaration's exact name, and accepts no symbolic link.
    fs::copy(&support::library().shared, folder.path().join("NEXTWUSBLib.dll")).expect("a copy");
    let expected = "not open: False False 0\nI1: True True True\nstate 2\nnumbers: 1 1\nnull: False False\n\
                    BOOL: True True True\nstate 2\nclosed: False 0\n";
    assert_eq!(runtime.run(&program, VIRTUAL, &[]).success(), expected);
}

/// Errors of the configuration are reported with file, line and key.
pub fn configuration(runtime: Runtime) {
    let look_up = test_program("LookUp", "NEXTWUSB_dotNET");
    let folder = tempfile::tempdir().expect("a folder");
    let program = alone(&look_up, folder.path());
    fs::copy(&support::library().shared, folder.path().join("libNEXTWUSBLib.so")).expect("a copy");
    let open = |text: Option<&str>| {
        if let Some(text) = text {
            fs::write(folder.path().join("ecmsk.toml"), text).expect("a file");
        }
        let mut command = runtime.command(&program, "");
        command.env_remove("ECMSK_LINK").env_remove("LD_LIBRARY_PATH");
        // A machine with libusb has no board, either, except one on which this test should not be run.
        support::without_libusb(&mut command);
        support::run(&mut command).success()
    };
    let none = open(None);
    assert!(none.starts_with("False ") && none.contains("libusb") && none.ends_with("False False\n"), "{none}");
    for (text, parts) in [
        ("link = 3\n", ["ecmsk.toml, line 1", "link"]),
        ("\nlnk = \"sim:\"\n", ["ecmsk.toml, line 2", "lnk"]),
        ("link = \"sim:?slaves=lathe\"\n", ["ecmsk.toml", "lathe"]),
    ] {
        let said = open(Some(text));
        assert!(said.starts_with("False ") && parts.iter().all(|part| said.contains(part)), "{said}");
    }
    let good = open(Some(&format!("link = \"{VIRTUAL}\"\n")));
    assert!(good.starts_with("True ") && good.ends_with("\n\nTrue True\n"), "{good}");
}

/// The library is found beside the assembly, in the folder for its width, beside the program, by its name; and the
/// searched places are listed when there is none.
pub fn search(runtime: Runtime) {
    let look_up = test_program("LookUp", "NEXTWUSB_dotNET");
    let folder = tempfile::tempdir().expect("a folder");
    let program = alone(&look_up, folder.path());
    let library = &support::library().shared;
    let run = |in_path: bool| {
        let mut command = runtime.command(&program, VIRTUAL);
        if !in_path {
            command.env_remove("LD_LIBRARY_PATH");
        }
        let said = support::run(&mut command).success();
        let mut lines = said.lines().map(str::to_owned);
        [(); 3].map(|()| lines.next().expect("three lines"))
    };
    let at = |name: &str| folder.path().join(name);
    let found = |file: &Path| [format!("True {}", file.display()), String::new(), "True True".to_owned()];

    let [first, why, last] = run(false);
    assert_eq!((first.as_str(), last.as_str()), ("DllNotFoundException -", "DllNotFoundException False"));
    assert!(why.starts_with("no libNEXTWUSBLib.so for this 64-bit process was found; libNEXTWUSBLib.so: "), "{why}");
    assert!(why.ends_with("Put the 64-bit one beside the program, or into the folder x64 there"), "{why}");

    assert_eq!(run(true)[0], "True libNEXTWUSBLib.so", "by its name, on the search path");

    // The file of a 32-bit process: its header is enough for the loader.
    let mut head = fs::read(library).expect("the library")[..64].to_vec();
    head[4] = 1;
    fs::write(at("libNEXTWUSBLib.so"), &head).expect("a file");
    let why = &run(false)[1];
    assert!(why.contains(&format!("{}: ", at("libNEXTWUSBLib.so").display())) && why.contains("ELF"), "{why}");

    fs::create_dir(at("x64")).expect("a folder");
    fs::copy(library, at("x64/libNEXTWUSBLib.so")).expect("a copy");
    assert_eq!(run(false), found(&at("x64/libNEXTWUSBLib.so")));

    // Another name, then its own name, beside the assembly: both come before the folder.
    fs::copy(library, at("libNEXTWUSBLib.so.0")).expect("a copy");
    assert_eq!(run(true), found(&at("libNEXTWUSBLib.so.0")));
    fs::remove_file(at("libNEXTWUSBLib.so")).expect("a file");
    fs::copy(library, at("libNEXTWUSBLib.so")).expect("a copy");
    assert_eq!(run(true), found(&at("libNEXTWUSBLib.so")));
}

/// With a library that has the vendor's four functions alone.
pub fn a_library_as_the_vendors(runtime: Runtime) {
    let folder = tempfile::tempdir().expect("a folder");
    let program = alone(&test_program("LookUp", "NEXTWUSB_dotNET"), folder.path());
    let library = folder.path().join("libNEXTWUSBLib.so");
    compile_shared("vendor.c", &library);
    let said = runtime.run(&program, VIRTUAL, &[]).success();
    assert_eq!(said, format!("True {}\n\nTrue False\n", library.display()));
}

/// A copy of a program, with its assembly, in a folder of its own.
fn alone(program: &Program, folder: &Path) -> Program {
    let exe = folder.join(program.exe.file_name().expect("a name"));
    for name in [program.exe.file_name().expect("a name").to_str().expect("UTF-8"), "NEXTWUSB_dotNET.dll", "core.json"]
    {
        fs::copy(program.exe.with_file_name(name), folder.join(name)).expect("a copy");
    }
    Program { exe }
}
