//! `ecmsk doctor DIR`: a Windows program's folder, checked from Linux.
#![cfg(any(target_os = "linux", windows))]

use std::fs;
use std::path::Path;

use crate::common::{Ran, json_lines, run};
use serde_json::Value;
use support::pe::{ARM64, IL_ONLY, PREFERS_32, Pe, REQUIRES_32, X64, X86, ours, vendors};
use tempfile::TempDir;

/// Makes a folder with these files, each a name and a content.
fn folder(files: &[(&str, Vec<u8>)]) -> TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    for (name, bytes) in files {
        let file = folder.path().join(name);
        fs::create_dir_all(file.parent().expect("a folder")).expect("a folder");
        fs::write(file, bytes).expect("a file");
    }
    folder
}

fn doctor(folder: &Path) -> (Ran, Vec<Value>) {
    let folder = folder.display().to_string();
    let (text, json) = (run(["doctor", &folder]), run(["doctor", "--json", &folder]));
    assert_eq!(text.code, json.code, "{text:?} {json:?}");
    let findings = json_lines(&json.out);
    (text, findings)
}

/// The state, the text and the next step of the finding of a check about one file.
fn told<'a>(findings: &'a [Value], check: &str, subject: &str) -> (&'a str, &'a str, &'a str) {
    let mut fitting = findings.iter().filter(|finding| finding["check"] == check && finding["subject"] == subject);
    let finding = fitting.next().unwrap_or_else(|| panic!("no {check} {subject} in {findings:?}"));
    assert!(fitting.next().is_none(), "{check} {subject} twice");
    let text = |name: &str| finding[name].as_str().unwrap_or_default();
    (text("state"), text("found"), text("next"))
}

/// A Windows program for a machine (of the PE format) that links the library, as the linker of a C++ compiler leaves it.
fn program(machine: u16) -> Vec<u8> {
    Pe::program(machine).text(b"NEXTWUSBLib.dll\0").bytes()
}

/// If everything fits there is no wrong finding, and the output names the library that the program loads, its maker,
/// its width and its version.
#[test]
fn a_folder_in_which_everything_fits_has_nothing_wrong() {
    let there = folder(&[
        ("press.EXE", program(X86)),
        ("nextwusblib.DLL", ours(X86)),
        ("ecmsk.toml", b"link = \"sim:?slaves=drive*2\"\n".to_vec()),
        ("readme.txt", b"text".to_vec()),
    ]);
    let (ran, findings) = doctor(there.path());
    assert_eq!(ran.code, Some(0), "{ran:?}");
    assert_eq!(
        told(&findings, "program", "press.EXE"),
        ("ok", "32-bit; takes nextwusblib.DLL (this project's, version 0.1.0)", "")
    );
    assert_eq!(told(&findings, "library", "nextwusblib.DLL"), ("ok", "32-bit, this project's, version 0.1.0", ""));
    assert_eq!(told(&findings, "config", "ecmsk.toml"), ("ok", "sim:?slaves=drive*2", ""));
    assert_eq!(findings.len(), 3, "{findings:?}");
    assert!(ran.out.ends_with("nothing is wrong, 0 could be better\n"), "{}", ran.out);
}

/// A library of the wrong width is wrong. The finding has the error text of Windows, and names the library to put there. A
/// missing library and a broken one are wrong, too. Programs that do not use the library are ignored.
#[test]
fn a_library_of_the_wrong_width_missing_or_broken_is_wrong() {
    for (machine, other, width, others, name) in
        [(X86, X64, "32-bit", "64-bit", "x86"), (X64, X86, "64-bit", "32-bit", "x64")]
    {
        let there = folder(&[("press.exe", program(machine)), ("NEXTWUSBLib.dll", ours(other))]);
        let (ran, findings) = doctor(there.path());
        assert_eq!(ran.code, Some(1), "{ran:?}");
        let found = format!(
            "{width}, and the NEXTWUSBLib.dll beside it is {others} (this project's, version 0.1.0): Windows does not load \
             it (error 193, in .NET a BadImageFormatException)"
        );
        let next = format!("put {name}\\NEXTWUSBLib.dll of this project's package in its place");
        assert_eq!(told(&findings, "program", "press.exe"), ("wrong", &found[..], &next[..]));
        assert!(ran.out.contains(&format!("do: {next}\n")), "{}", ran.out);

        // If the library of the right width is in the sub-folder `x86` or `x64`, as in the package, the next step is to put
        // that one in place.
        fs::create_dir(there.path().join(name)).expect("a folder");
        fs::write(there.path().join(name).join("NEXTWUSBLib.dll"), ours(machine)).expect("a file");
        let (_, findings) = doctor(there.path());
        let (state, _, next) = told(&findings, "program", "press.exe");
        assert_eq!((state, next), ("wrong", &format!("put {name}\\NEXTWUSBLib.dll in its place")[..]));
    }
    let (ran, findings) = doctor(folder(&[("press.exe", program(X64))]).path());
    assert_eq!(ran.code, Some(1));
    let next = "copy x64\\NEXTWUSBLib.dll of this project's package beside it";
    assert_eq!(
        told(&findings, "program", "press.exe"),
        ("wrong", "64-bit, and there is no NEXTWUSBLib.dll for it", next)
    );
    let short = ours(X64)[..0x300].to_vec();
    let (ran, findings) = doctor(folder(&[("press.exe", program(X64)), ("NEXTWUSBLib.dll", short)]).path());
    assert_eq!(ran.code, Some(1));
    assert_eq!(told(&findings, "library", "NEXTWUSBLib.dll").0, "wrong");
    assert!(told(&findings, "program", "press.exe").1.contains("is broken"));

    let uninstaller = Pe::program(X86).bytes();
    let there =
        folder(&[("press.exe", program(X64)), ("unins000.exe", uninstaller), ("NEXTWUSBLib.dll", vendors(X64))]);
    let (ran, findings) = doctor(there.path());
    assert_eq!(ran.code, Some(0), "{ran:?}");
    assert_eq!(told(&findings, "library", "NEXTWUSBLib.dll").1, "64-bit, by Maker Inc., version 1, 2, 0, 3");
    assert!(told(&findings, "program", "unins000.exe").1.contains("does not use it"));
    let arm = doctor(folder(&[("press.exe", program(ARM64)), ("NEXTWUSBLib.dll", ours(X64))]).path());
    assert_eq!((arm.0.code, told(&arm.1, "program", "press.exe").0), (Some(1), "wrong"));
}

/// A .NET program has the width that its CLI header requests from a 64-bit Windows. The assemblies of this project look for the
/// library in the folders `x86` and `x64` as well; a DllImport of the program itself does not.
#[test]
fn a_dotnet_program_has_the_width_of_its_cli_header() {
    let managed = |machine, flags| Pe::program(machine).managed(flags).text(b"NEXTWUSBLib.dll\0");
    let cases = [
        (managed(X86, IL_ONLY), "x64", "for .NET and any CPU, 64-bit on a 64-bit Windows"),
        (managed(X86, IL_ONLY | REQUIRES_32 | PREFERS_32), "x86", "for .NET and any CPU, 32-bit preferred"),
        (managed(X86, IL_ONLY | REQUIRES_32), "x86", "32-bit, for .NET"),
        (managed(X64, IL_ONLY), "x64", "64-bit, for .NET"),
    ];
    for (program, width, kind) in cases {
        let (right, wrong) = if width == "x64" { (X64, X86) } else { (X86, X64) };
        let program = program.bytes();
        let good = doctor(folder(&[("press.exe", program.clone()), ("NEXTWUSBLib.dll", ours(right))]).path());
        assert_eq!(good.0.code, Some(0), "{kind}: {:?}", good.0);
        assert!(told(&good.1, "program", "press.exe").1.starts_with(kind), "{kind}: {:?}", good.1);
        let bad = doctor(folder(&[("press.exe", program), ("NEXTWUSBLib.dll", ours(wrong))]).path());
        let (state, found, next) = told(&bad.1, "program", "press.exe");
        assert_eq!((bad.0.code, state), (Some(1), "wrong"), "{kind}");
        assert!(found.contains("BadImageFormatException") && next.contains(width), "{found} {next}");
    }

    // The assemblies of this project have the company of the vendor's in their version resource, too. Only the product differs.
    let assembly = |product: &str| {
        let texts = [("CompanyName", "NEXTW"), ("FileVersion", "2.0.0.0"), ("ProductName", product)];
        Pe::library(X86).managed(IL_ONLY).wide("NEXTWUSBLib.dll").version(&texts).bytes()
    };
    let program = Pe::program(X86).managed(IL_ONLY).text(b"NEXTWUSB_dotNET_12B\0").bytes();
    let files = |product: &str| {
        [
            ("press.exe", program.clone()),
            ("NEXTWUSB_dotNET_12B.dll", assembly(product)),
            ("x64/NEXTWUSBLib.dll", ours(X64)),
            ("x86/NEXTWUSBLib.dll", ours(X86)),
        ]
    };
    let (ran, findings) = doctor(folder(&files("ecmsk")).path());
    assert_eq!(ran.code, Some(0), "{ran:?}");
    assert!(told(&findings, "program", "press.exe").1.contains("takes x64\\NEXTWUSBLib.dll"), "{findings:?}");
    assert_eq!(told(&findings, "assembly", "NEXTWUSB_dotNET_12B.dll").1, "this project's, version 2.0.0.0");
    let (ran, findings) = doctor(folder(&files("NEXTWUSB_dotNET_12B")).path());
    assert_eq!(ran.code, Some(1), "another assembly looks beside itself: {ran:?}");
    assert_eq!(told(&findings, "program", "press.exe").2, "copy x64\\NEXTWUSBLib.dll beside it");

    // .NET 5 and later: the program is a small Windows host, and its code is in a library of the same name.
    let parts = [("Press.exe", Pe::program(X64).bytes()), ("press.dll", managed(X86, IL_ONLY).bytes())];
    let (ran, findings) = doctor(folder(&parts).path());
    assert_eq!((ran.code, told(&findings, "program", "Press.exe").0), (Some(1), "wrong"), "it uses the library");
    let odd = folder(&[("press.exe", Pe::program(X64).bytes()), ("x86/NEXTWUSBLib.dll", ours(X64))]);
    let (ran, findings) = doctor(odd.path());
    assert_eq!(ran.code, Some(1));
    assert!(told(&findings, "library", "x86\\NEXTWUSBLib.dll").1.contains("in a folder for the other width"));
}

/// A wrong `ecmsk.toml` is reported with file, line and key; so are invalid links, and links that Windows does not
/// have.
#[test]
fn a_wrong_ecmsk_toml_is_named_with_file_line_and_key() {
    let with = |text: &str| {
        let there = folder(&[("press.exe", program(X64)), ("NEXTWUSBLib.dll", ours(X64)), ("ecmsk.toml", text.into())]);
        let (ran, findings) = doctor(there.path());
        let (state, found, next) = told(&findings, "config", "ecmsk.toml");
        assert_eq!(ran.code, Some(i32::from(state == "wrong")), "{ran:?}");
        (state.to_owned(), found.to_owned(), next.to_owned())
    };
    for (text, words) in [
        ("link = \"usb:\"\nlinks = 1\n", &["ecmsk.toml, line 2", "links"][..]),
        ("\nlink = 5\n", &["line 2", "`link`", "not a string"]),
        ("link = \"sim:?slavs=1\"", &["sim:?slavs=1", "slavs"]),
        ("link = \"spi:/dev/spidev0.0\"", &["Windows has no spi: links"]),
        ("link = \"xf-usb:\"", &["Windows has no xf-usb: links"]),
    ] {
        let (state, found, next) = with(text);
        assert_eq!(state, "wrong", "{text}");
        assert!(words.iter().all(|word| found.contains(word)) && !next.is_empty(), "{text}: {found}; {next}");
    }
    for board in ["sim:", "xf-sim:?slaves=io"] {
        assert_eq!(with(&format!("link = \"{board}\"")), ("ok".to_owned(), board.to_owned(), String::new()));
    }
    let (_, _, next) = with("link = \"spi:/dev/spidev0.0\"");
    assert!(next.contains("ecmsk serve tcp"), "{next}");
    let (_, findings) = doctor(folder(&[("press.exe", program(X64)), ("NEXTWUSBLib.dll", ours(X64))]).path());
    let (state, found, _) = told(&findings, "config", "ecmsk.toml");
    assert!(state == "ok" && found.contains("usb:"), "{found}");
}

/// A missing folder, a file, and a folder without a program are failures with a next step.
#[test]
fn a_folder_without_a_program_is_a_failure_with_a_next_step() {
    let there = folder(&[("readme.txt", b"text".to_vec())]);
    let (ran, findings) = doctor(there.path());
    assert_eq!((ran.code, &findings[0]["state"]), (Some(1), &Value::from("wrong")));
    assert!(ran.out.contains("do: name the folder that the program's .exe is in"), "{}", ran.out);
    for other in ["readme.txt", "none"] {
        let ran = run(["doctor", &there.path().join(other).display().to_string()]);
        assert_eq!((ran.code, ran.out.as_str()), (Some(1), ""), "{ran:?}");
        assert!(ran.err.contains("name the folder that the program's .exe is in"), "{ran:?}");
    }
}

/// Files that are cut off, or have false headers, are reported as broken or by their headers; none ends the tool.
#[test]
fn files_that_lie_about_themselves_do_not_end_the_tool() {
    let whole = Pe::program(X64)
        .managed(IL_ONLY)
        .exports(&["OpenECMUSB", "x"])
        .version(&[("CompanyName", "\u{1b}[31mMaker"), ("FileVersion", "1")])
        .text(b"NEXTWUSBLib.dll\0")
        .bytes();
    // The file is cut at every third byte of its headers, and at some bytes of the rest.
    let lengths = (0..0x200).step_by(3).chain((0x200..whole.len()).step_by(37));
    let mut files: Vec<Vec<u8>> = lengths.map(|end| whole[..end].to_vec()).collect();
    let cut = files.len();
    for at in (0..whole.len()).filter(|at| whole[*at] != 0 || *at < 0x200) {
        for value in [0xFF, 0x80, whole[at] ^ 1] {
            let mut bytes = whole.clone();
            bytes[at] = value;
            files.push(bytes);
        }
    }
    let there = tempfile::tempdir().expect("a folder");
    for (number, bytes) in files.iter().enumerate() {
        fs::write(there.path().join(format!("{number:05}.exe")), bytes).expect("a file");
    }
    let (ran, findings) = doctor(there.path());
    assert_eq!(ran.code, Some(1), "{}", ran.err);
    assert_eq!(ran.err, "");
    let programs: Vec<&Value> = findings.iter().filter(|finding| finding["check"] == "program").collect();
    assert_eq!(programs.len(), files.len());
    for program in &programs[..cut] {
        assert_eq!(program["state"], "wrong", "what is cut off is broken: {program}");
        assert!(program["next"].as_str().is_some_and(|next| !next.is_empty()), "{program}");
    }
    assert!(!ran.out.contains('\u{1b}'), "a text of a file controls no terminal");
}
