//! Programs of .NET on Microsoft's .NET Core for Windows, under Wine, from the same files that Mono and .NET Core run on Linux.

use std::fs;
use std::path::Path;

use crate::fixture::{DLL, Folder, Width, given, lines};
use crate::vb;
use support::dotnet::{
    ASSEMBLIES, EXAMPLES, Pair, REAL, VENDOR_ASSEMBLIES, VIRTUAL, WITH_IO, against_ecmsk, beside, compiled, example,
    sources, test_program, told_moves, told_types, vendor_program,
};
use support::{self, Ended, Program, both_axes_are_off_in_preop, root, snapshot};

/// Every program of `examples/vb/` with its snapshot.
const VB: [(&str, &str); 1] = [("GuideExample", "dotnet_guide_example")];

/// The pair of assemblies for that width.
const fn pair(width: Width) -> Pair {
    match width {
        Width::X86 => Pair::X86,
        Width::X64 => Pair::X64,
    }
}

/// A link to a board with the assembly's slot size.
fn link_for(assembly: &str) -> String {
    format!("{VIRTUAL}&slot={}", if assembly.ends_with("16B") { 16 } else { 12 })
}

/// Runs a program that was compiled against the vendor's assembly on the stand-in for it, and on this project's
/// assembly.
fn swap(width: Width, test: &str, assembly: &str, program: &Program) {
    for file in [pair(width).stand_in(assembly), pair(width).ours(assembly), Pair::X86.ours(assembly)] {
        let folder = Folder::with_dll(width, &format!("dotnet-{test}"));
        let placed = beside(program, &file, &folder.path());
        let name = placed.exe.file_name().expect("a name").to_str().expect("UTF-8").to_owned();
        let expected = told_types(assembly);
        assert_eq!(said(&folder, &name, &link_for(assembly), &[]), expected, "{}", file.display());
    }
}

/// Copies a program into the folder, with the assemblies and the configuration by which .NET Core runs it.
fn place(folder: &Folder, program: &Program) -> String {
    let name = program.exe.file_name().expect("a name").to_str().expect("UTF-8").to_owned();
    let copy = |name: &str| {
        let from = program.exe.with_file_name(name);
        if from.exists() {
            fs::copy(from, folder.path().join(name)).expect("a copy");
        }
    };
    ASSEMBLIES.iter().for_each(|assembly| copy(&format!("{assembly}.dll")));
    copy("core.json");
    copy(&name);
    name
}

/// Runs a program of the folder.
fn run(folder: &Folder, program: &str, link: &str, arguments: &[&str]) -> Ended {
    let dotnet = given("ECMSK_WINE_DOTNET");
    let mut command = folder.command(dotnet.to_str().expect("UTF-8"), link);
    command.args(["exec", "--runtimeconfig", "core.json", program]).args(arguments);
    let mut ended = folder.run_command(&mut command);
    ended.stdout = lines(&ended.stdout);
    ended
}

/// It must end successfully, with nothing on standard error.
fn said(folder: &Folder, program: &str, link: &str, arguments: &[&str]) -> String {
    let ended = run(folder, program, link, arguments);
    assert_eq!(ended.stderr, "", "{program} {arguments:?} on {link}");
    ended.success()
}

/// A folder with the DLL and a program of the tests.
fn with_program(width: Width, test: &str, name: &str) -> (Folder, String) {
    on_assembly(width, test, name, "NEXTWUSB_dotNET")
}

/// The same for a program that is compiled against that assembly.
fn on_assembly(width: Width, test: &str, name: &str, assembly: &str) -> (Folder, String) {
    let folder = Folder::with_dll(width, &format!("dotnet-{test}"));
    let program = place(&folder, &test_program(name, assembly));
    (folder, program)
}

/// The keys of a link, with the script that they name copied beside the program.
fn scripted(folder: &Folder, keys: &str) -> String {
    for name in keys.split("SCRIPTS/").skip(1).map(|rest| rest.split('&').next().expect("a name")) {
        fs::copy(root().join("examples/scripts").join(name), folder.path().join(name)).expect("the script");
    }
    keys.replace("SCRIPTS/", "")
}

/// Sets another machine in a DLL's header than that of its code, so that Windows refuses the file.
fn of_another_width(mut dll: Vec<u8>) -> Vec<u8> {
    let header = u32::from_le_bytes(dll[0x3C..0x40].try_into().expect("four bytes")) as usize;
    let machine = &mut dll[header + 4..header + 6];
    let other: u16 = if *machine == 0x8664_u16.to_le_bytes() { 0x014C } else { 0x8664 };
    machine.copy_from_slice(&other.to_le_bytes());
    dll
}

crate::for_each_width! {
    /// LIB-29, LIB-30, NET-4, NET-11 The programs of `examples/csharp/` print the same as on Linux.
    #[test]
    fn examples_in_csharp(width: Width) {
        let folder = Folder::with_dll(width, "dotnet-examples");
        for (name, kept, keys) in EXAMPLES {
            let program = place(&folder, &example(name));
            let link = format!("{VIRTUAL}{}", scripted(&folder, keys));
            snapshot(kept, &said(&folder, &program, &link, &[]));
        }
    }

    /// NET-4, NET-11 A program that fails prints the reason, and its axes are off.
    #[test]
    fn an_end_by_an_alarm(width: Width) {
        let folder = Folder::with_dll(width, "dotnet-alarm");
        let program = place(&folder, &example("TwoAxes12B"));
        let script = scripted(&folder, "&script=SCRIPTS/alarm.ecmscript");
        let ended = run(&folder, &program, &format!("{VIRTUAL}{script}&record=alarm.pcapng"), &[]);
        let says = lines(&ended.stderr);
        assert_eq!((ended.status.code(), says.as_str()), (Some(1), "failed: an axis does not arrive\n"));
        both_axes_are_off_in_preop(&folder.path().join("alarm.pcapng"));
    }

    /// LIB-33, NET-11, NET-20, NET-21 A program signs its frames, and requests the CRC-8 of responses.
    #[test]
    fn the_crc(width: Width) {
        for (assembly, slot) in [("NEXTWUSB_dotNET_12B", 12), ("NEXTWUSB_dotNET_16B", 16)] {
            let (folder, program) = on_assembly(width, &format!("crc-{slot}"), "Frames", assembly);
            let link = format!("{VIRTUAL}&slot={slot}");
            let expected = "as it comes: read True, CRC right True, there, old data False\n\
                            commands are checked: errors 0\nnot signed: errors 1\nsigned: errors 1\n\
                            signed wrongly: errors 2\nwith CRC: read True, CRC right True, there, old data False\n\
                            commands are not checked: errors 0\n\
                            without CRC: read True, CRC right False, 0, old data False\n";
            assert_eq!(said(&folder, &program, &link, &[]), expected, "{slot}");
            let lies = said(&folder, &program, &format!("{link}&fault.corrupt.read=1"), &["once"]);
            assert!(lies.starts_with("as it comes: read True, CRC right False, "), "{lies}");
        }
    }

    /// LIB-29, NET-11, NET-14, NET-15, NET-16, NET-17, NET-18, NET-19, NET-24 A program in C# that was compiled against
    /// the vendor's assembly runs on it with this DLL, and on this project's assembly.
    #[test]
    fn swapped(width: Width) {
        for assembly in VENDOR_ASSEMBLIES {
            swap(width, &format!("swapped-{assembly}"), assembly, &vendor_program("Types", assembly));
        }
    }

    /// LIB-29, NET-11, NET-14, NET-15, NET-16, NET-17, NET-18, NET-19, NET-24 The same in VB.NET, with Option Strict On.
    #[test]
    fn swapped_in_vb(width: Width) {
        for assembly in VENDOR_ASSEMBLIES {
            swap(width, &format!("swapped-vb-{assembly}"), assembly, &vb::vendor_program("Types", assembly));
        }
    }

    /// NET-5, NET-6, NET-7, NET-11, NET-22 Arrays of other lengths, calls while nothing is open, calls of finalisers.
    #[test]
    fn misuse(width: Width) {
        let (folder, program) = with_program(width, "misuse", "Misuse");
        for link in [VIRTUAL, REAL] {
            assert_eq!(said(&folder, &program, link, &[]), "ok\n", "{link}");
        }
    }

    /// NET-8, NET-11, NET-12, LIB-48, WIN-12 Programs end without Close, whatever their threads are doing.
    #[test]
    fn endings(width: Width) {
        let (folder, program) = with_program(width, "endings", "Endings");
        for link in [VIRTUAL, REAL] {
            for (how, code) in [("return", 0), ("exit", 7), ("closed", 0)] {
                let ended = run(&folder, &program, link, &[how]);
                assert_eq!((ended.status.code(), ended.stdout.as_str()), (Some(code), "reading\n"), "{how}: {ended:?}");
            }
        }
        for (how, code) in [("return", 0), ("exit", 7), ("closed", 0)] {
            for more in [&[how, "silent"][..], &[how, "silent", "handler"]] {
                let ended = run(&folder, &program, &format!("{REAL}&fault.drop.read=1"), more);
                assert_eq!((ended.status.code(), ended.stdout.as_str()), (Some(code), "reading\n"), "{more:?}: {ended:?}");
            }
        }
        // How it ends after that depends on Wine's debugger.
        let ended = run(&folder, &program, REAL, &["throw"]);
        assert!(ended.stdout.starts_with("reading\n") && ended.stderr.contains("on purpose"), "{ended:?}");
    }

    /// A program on the assembly of the package Ecmsk moves axes as on Linux.
    #[test]
    fn on_ecmsk(width: Width) {
        let folder = Folder::with_dll(width, "dotnet-ecmsk");
        let assembly = compiled().join("ecmsk/Ecmsk.dll");
        fs::copy(&assembly, folder.path().join("Ecmsk.dll")).expect("a copy");
        against_ecmsk(&sources().join("EcmskMoves.cs"), &assembly, &folder.path());
        assert_eq!(said(&folder, "EcmskMoves.exe", "", &[WITH_IO]), told_moves());
    }

    /// NET-9, NET-13, LIB-3, LIB-4 DllImport by I1, by BOOL and by ordinals.
    #[test]
    fn declared(width: Width) {
        let (folder, program) = with_program(width, "declared", "Declared");
        let expected = "not open: False False 0\nI1: True True True\nstate 2\nnumbers: 1 1\nnull: False False\n\
                        BOOL: True True True\nstate 2\nclosed: False 0\n";
        assert_eq!(said(&folder, &program, VIRTUAL, &[]), expected);
        let expected = "I1: False True True True\nstate 2\nBOOL: True\nclosed: False False\n";
        assert_eq!(said(&folder, &program, VIRTUAL, &["ordinals"]), expected);
    }

    /// NET-13, LIB-48, WIN-11 LoadLibrary and GetProcAddress; FreeLibrary while a thread reads.
    #[test]
    fn unloaded_during_a_read(width: Width) {
        let (folder, program) = with_program(width, "loaded", "Loaded");
        for how in ["gone", "kept"] {
            assert_eq!(said(&folder, &program, REAL, &[how]), "ok\n", "{how}");
        }
    }

    /// NET-3, NET-6, WIN-7 An error in the configuration is reported with file, line and key.
    #[test]
    fn configuration(width: Width) {
        let (folder, program) = with_program(width, "configuration", "LookUp");
        let open = |text: &str| {
            fs::write(folder.path().join("ecmsk.toml"), text).expect("a file of the folder");
            said(&folder, &program, "", &[])
        };
        for (text, parts) in [
            ("link = 3\n", ["ecmsk.toml, line 1", "link"]),
            ("\nlnk = \"sim:\"\n", ["ecmsk.toml, line 2", "lnk"]),
            ("link = \"sim:?slaves=lathe\"\n", ["ecmsk.toml", "lathe"]),
        ] {
            let said = open(text);
            assert!(said.starts_with("False ") && parts.iter().all(|part| said.contains(part)), "{said}");
            assert!(said.ends_with("\nFalse False\n"), "{said}");
        }
        let good = open(&format!("link = \"{VIRTUAL}\"\n"));
        assert!(good.starts_with("True ") && good.ends_with("\n\nTrue True\n"), "{good}");
    }

    /// NET-2, NET-3, NET-6 The DLL is found beside the assembly and in the folder for the width; a DLL of the other
    /// width is skipped; without a DLL the error lists the places that were tried.
    #[test]
    fn search(width: Width) {
        let (folder, program) = with_program(width, "search", "LookUp");
        let open = || {
            let said = said(&folder, &program, VIRTUAL, &[]);
            let mut lines = said.lines().map(str::to_owned);
            [(); 3].map(|()| lines.next().expect("three lines"))
        };
        let found = |place: &str| {
            let [first, why, last] = open();
            assert!(first.starts_with("True Z:\\") && first.ends_with(place), "{first}");
            assert_eq!((why.as_str(), last.as_str()), ("", "True True"));
        };
        found(&format!("\\{}\\{DLL}", folder.path().file_name().expect("a name").to_str().expect("UTF-8")));

        let dll = folder.path().join(DLL);
        fs::write(&dll, of_another_width(width.dll())).expect("a file of the folder");
        let [first, why, last] = open();
        assert_eq!((first.as_str(), last.as_str()), ("DllNotFoundException -", "DllNotFoundException False"));
        let (bits, name) = if width == Width::X64 { (64, "x64") } else { (32, "x86") };
        assert!(why.starts_with(&format!("no {DLL} for this {bits}-bit process was found; ")), "{why}");
        assert!(why.contains(&format!("\\{DLL}: is for a process of another width, or broken")), "{why}");
        assert!(why.ends_with(&format!("Put the {bits}-bit one beside the program, or into the folder {name} there")), "{why}");

        fs::create_dir(folder.path().join(name)).expect("a folder");
        fs::copy(width.stage().join(DLL), folder.path().join(name).join(DLL)).expect("the DLL");
        found(&format!("\\{name}\\{DLL}"));
    }
}

/// Tests that run once, for one width.
mod on_linux {
    mod x64 {
        use super::super::*;

        /// Runs a program by Mono and by .NET Core on Linux; the output of each.
        fn by_each(program: &Program, link: &str, tell: impl Fn(&str)) {
            let core = given("ECMSK_DOTNET");
            let config = program.exe.with_file_name("core.json");
            let config = ["exec", "--runtimeconfig", config.to_str().expect("UTF-8")];
            for (runtime, arguments) in [("mono", &[][..]), (core.to_str().expect("UTF-8"), &config[..])] {
                let ended = support::run(&mut program.under(runtime, arguments, link));
                assert_eq!(ended.stderr, "", "{} by {runtime}", program.exe.display());
                tell(&ended.success());
            }
        }

        /// NET-4, NET-11 The programs of `examples/vb/` print the same under Wine, under Mono and under .NET Core on Linux, from
        /// one file each.
        #[test]
        fn examples_in_vb() {
            let entries = fs::read_dir(root().join("examples/vb")).expect("the folder");
            let sources = entries.map(|entry| entry.expect("readable").path());
            let is_source = |path: &Path| path.extension().is_some_and(|extension| extension == "vb");
            assert_eq!(sources.filter(|path| is_source(path)).count(), VB.len(), "a program is left out");
            let folder = Folder::with_dll(Width::X64, "dotnet-vb");
            let assembly = Pair::X86.ours("NEXTWUSB_dotNET");
            for (name, kept) in VB {
                let program = vb::compile(&root().join("examples/vb").join(name).with_extension("vb"), &assembly);
                let here = tempfile::tempdir().expect("a folder");
                let placed = beside(&program, &assembly, &folder.path());
                let file = placed.exe.file_name().expect("a name").to_str().expect("UTF-8").to_owned();
                snapshot(kept, &said(&folder, &file, VIRTUAL, &[]));
                by_each(&beside(&program, &assembly, here.path()), VIRTUAL, |said| snapshot(kept, said));
            }
        }

        /// LIB-29, NET-14, NET-15, NET-16, NET-17, NET-18, NET-19, NET-24 A program in VB.NET that was compiled against
        /// the vendor's assembly runs on this project's, of either pair, by Mono and by .NET Core on Linux.
        #[test]
        fn swapped_in_vb_on_linux() {
            for assembly in VENDOR_ASSEMBLIES {
                let program = vb::vendor_program("Types", assembly);
                for pair in Pair::ALL {
                    let folder = tempfile::tempdir().expect("a folder");
                    let placed = beside(&program, &pair.ours(assembly), folder.path());
                    by_each(&placed, &link_for(assembly), |said| assert_eq!(said, told_types(assembly), "{pair:?}"));
                }
            }
        }
    }
}
