//! Any bytes as a program and as the libraries in its folder: `ecmsk doctor FOLDER` says something of each that a terminal
//! shows as it is, and `ecmsk exec` takes no library that is none.

#![no_main]

#[path = "support/folder.rs"]
mod folder;

use ecmsk_tool::fuzzed;
use folder::Folder;
use libfuzzer_sys::fuzz_target;

/// Files of the folder that the second part of an input is; which of them says a bit each.
const BESIDE: [&str; 6] = [
    "NEXTWUSBLib.dll",
    "x86/nextwusblib.DLL",
    "x64/NEXTWUSBLib.dll",
    "NEXTWUSB_dotNET.dll",
    "Program.DLL",
    "second.exe",
];

fuzz_target!(|bytes: &[u8]| {
    let Some((&[which, low, high], rest)) = bytes.split_first_chunk() else { return };
    let (program, library) = rest.split_at(usize::from(u16::from_le_bytes([low, high])).min(rest.len()));
    let folder = Folder::make();
    let file = folder.write("program.exe", program);
    let beside = BESIDE.iter().enumerate().filter(|(bit, _)| which >> bit & 1 != 0);
    let beside: Vec<_> = beside.map(|(_, name)| folder.write(name, library)).collect();
    let [text, json] = fuzzed::doctor(folder.path()).expect("a folder");
    assert!(text.contains("program.exe") && text.lines().count() > beside.len(), "{text}");
    for shown in [&text, &json] {
        assert!(!shown.chars().any(|letter| letter.is_control() && letter != '\n'), "{shown:?}");
    }
    assert!(json.lines().all(|line| line.starts_with('{') && line.ends_with('}')), "{json}");
    // The dynamic linker would pass over what is no library without a word.
    let taken = fuzzed::library(&file);
    assert_eq!(taken.is_ok(), program.starts_with(b"\x7fELF"), "{taken:?}");
});
