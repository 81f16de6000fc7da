//! What every runtime has to show: the programs of `examples/csharp/`, and programs that misuse the assembly.

use std::fs;
use std::path::Path;

use ecmsk::link::Dir;
use ecmsk::recording::Recording;
use ecmsk::sk::SlotSize;
use ecmsk::sk::crc::frame_crc;

use crate::dotnet::runtime::Runtime;
use support::dotnet::{EXAMPLES, REAL, VIRTUAL, example, test_program};
use support::{Language, Program, out_dir, root};

fn scripted(keys: &str) -> String {
    keys.replace("SCRIPTS", root().join("examples/scripts").to_str().expect("UTF-8"))
}

/// The examples print what their snapshots hold, on both firmwares.
pub fn examples(runtime: Runtime) {
    for (name, snapshot, keys) in EXAMPLES {
        let link = format!("{VIRTUAL}{}", scripted(keys));
        runtime.prints(name, snapshot, &link);
        runtime.prints(name, snapshot, &format!("{link}&fw=1.5"));
    }
}

/// A program whose axis has an alarm says so, ends with 1, and leaves the axes off and the network in PreOP.
pub fn an_end_by_an_alarm(runtime: Runtime) {
    let file = out_dir().join(format!("alarm-{runtime:?}.pcapng"));
    let link = format!("{VIRTUAL}{}&record={}", scripted("&script=SCRIPTS/alarm.ecmscript"), file.display());
    let ended = runtime.run(&example("TwoAxes12B"), &link, &[]);
    assert_eq!((ended.status.code(), ended.stderr.as_str()), (Some(1), "failed: an axis does not arrive\n"));
    support::both_axes_are_off_in_preop(&file);
}

/// Frames on the way have the right CRC, whatever stood in its place; a response with a wrong one is refused, one without
/// passes.
pub fn the_crc(runtime: Runtime) {
    for (assembly, size) in [("NEXTWUSB_dotNET_12B", SlotSize::Bytes12), ("NEXTWUSB_dotNET_16B", SlotSize::Bytes16)] {
        let slot = size.bytes();
        let program = test_program("Frames", assembly);
        let file = out_dir().join(format!("frames-{slot}-{runtime:?}.pcapng"));
        let link = format!("{VIRTUAL}&slot={slot}&record={}", file.display());
        let said = runtime.run(&program, &link, &[]).success();
        let expected = "cmdData[0].Parm is 0xA500\nread True, CRC there, respData[5].Data1 is 0\nread True, CRC 0\n";
        assert_eq!(said, expected, "{slot}");
        let frames = Recording::open(&file).expect("the recording").map(|recorded| recorded.expect("a frame"));
        let first = frames.into_iter().find(|recorded| recorded.dir == Dir::Write).expect("a frame").frame;
        let bytes = &first.bytes()[..size.frame_len()];
        assert_eq!(bytes[3], frame_crc(bytes), "{slot}");
        assert_eq!((bytes[2], bytes[slot + 2], bytes[slot + 4]), (0, 1, 1), "the rest is as the program wrote it");

        let lies = format!("{VIRTUAL}&slot={slot}&fault.corrupt.read=1");
        let said = runtime.run(&program, &lies, &["once"]).stdout;
        let refused = "read False, CRC 0, respData[5].Data1 is 12345\nCRC-8 of the response";
        assert!(said.contains(refused), "{said}");
    }
}

/// Wrong arrays, calls while nothing is open, calls of finalisers.
pub fn misuse(runtime: Runtime) {
    for link in [VIRTUAL, REAL] {
        runtime.passes("Misuse", link);
    }
}

/// Programs end, whatever their threads are at, with the code that they gave.
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
            // It waits for a read that has no end, unless the program closes the board.
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
    // .NET Core looks for a file of the very name that the declaration has, and takes no symbolic link for one.
    fs::copy(&support::library().shared, folder.path().join("NEXTWUSBLib.dll")).expect("a copy");
    let expected = "not open: False False 0\nI1: True True True\nstate 2\nnumbers: 1 1\nnull: False False\n\
                    BOOL: True True True\nstate 2\nclosed: False 0\n";
    assert_eq!(runtime.run(&program, VIRTUAL, &[]).success(), expected);
}

/// What is wrong with the configuration is said with file, line and key.
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
        // A machine with libusb has no board either, but for one on which this test should not be run.
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

/// The library is found beside the assembly, in the folder for its width, beside the program, by its name; and what was looked at
/// is said when there is none.
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
    assert_eq!((first.as_str(), last.as_str()), ("False -", "False False"));
    assert!(why.starts_with("no libNEXTWUSBLib.so for this 64-bit process was found; libNEXTWUSBLib.so: "), "{why}");
    assert!(why.ends_with("Put the 64-bit one beside the program, or into the folder x64 there"), "{why}");

    assert_eq!(run(true)[0], "True libNEXTWUSBLib.so", "by its name, on the search path");

    // The file of a 32-bit process: the head of one is enough for the loader.
    let mut head = fs::read(library).expect("the library")[..64].to_vec();
    head[4] = 1;
    fs::write(at("libNEXTWUSBLib.so"), &head).expect("a file");
    let why = &run(false)[1];
    assert!(why.contains(&format!("{}: ", at("libNEXTWUSBLib.so").display())) && why.contains("ELF"), "{why}");

    fs::create_dir(at("x64")).expect("a folder");
    fs::copy(library, at("x64/libNEXTWUSBLib.so")).expect("a copy");
    assert_eq!(run(false), found(&at("x64/libNEXTWUSBLib.so")));

    // Another name, then its own, beside: nearer than the folder.
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
    let mut compiler = Language::C("c99").compiler();
    compiler.args(["-shared", "-fPIC", "-o"]).arg(&library).arg(root().join("tests/capi/dotnet/programs/vendor.c"));
    support::succeed(&mut compiler);
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
