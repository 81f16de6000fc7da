//! `ecmsk exec`: which library a program gets, and that it is found before all others.
#![cfg(target_os = "linux")]

use std::ffi::OsStr;
use std::fs;
use std::os::unix::fs::symlink;
use std::path::Path;
use std::process::Command;

use crate::common::exec::{ExecFolder, install};
use crate::common::{Ran, ecmsk};

/// The first folder of the search path is private and has only the library, under both its names.
#[test]
fn the_library_is_found_first() {
    let place = ExecFolder::new();
    let script = "first=${LD_LIBRARY_PATH%%:*}; stat -c %a \"$first\"; cd \"$first\"; for f in *; do echo \"$f\"; readlink \"$f\"; done";
    let out = place.run(&["--link", "sim:"], script).expect_quiet();
    let library = place.path().join("libNEXTWUSBLib.so");
    let library = library.display();
    assert_eq!(out, format!("700\nlibNEXTWUSBLib.so\n{library}\nlibNEXTWUSBLib.so.0\n{library}\n"));
}

/// The user's search path follows the folder of the library. An empty search path, which would mean the current folder, is not
/// kept.
#[test]
fn the_search_path_is_kept() {
    let place = ExecFolder::new();
    for (before, after) in [("/a:/b", ":/a:/b"), ("", "")] {
        let mut command = place.exec(&[]);
        command
            .args(["--", "sh", "-c", ": > \"$ECMSK_OPENED\"; echo \"$LD_LIBRARY_PATH\""])
            .env("LD_LIBRARY_PATH", before);
        let out = Ran::from(command.output().expect("the tool starts")).expect_quiet();
        let own = out.trim_end().strip_suffix(after).expect("the user's folders stand at the end");
        assert!(own.starts_with(place.tmp().to_str().expect("UTF-8")) && !own.contains(':'), "{out}");
    }
}

/// `--library` names the library: as a file, or as a folder that has it by either of its names.
#[test]
fn the_option_library_names_a_file_or_a_folder() {
    let place = ExecFolder::new();
    let file = place.path().join("build-7.so");
    fs::copy("/bin/sh", &file).expect("a copy");
    let only_soname = place.path().join("runtime");
    fs::create_dir(&only_soname).expect("a folder");
    symlink(&file, only_soname.join("libNEXTWUSBLib.so.0")).expect("a link");
    for name in [&file, &only_soname] {
        let script = ": > \"$ECMSK_OPENED\"; readlink -f \"${LD_LIBRARY_PATH%%:*}/libNEXTWUSBLib.so.0\"";
        let mut command = ecmsk(["exec", "--library"]);
        command.arg(name).args(["--", "sh", "-c", script]).env("TMPDIR", place.tmp());
        let out = Ran::from(command.output().expect("the tool starts")).expect_quiet();
        assert_eq!(Path::new(out.trim_end()), fs::canonicalize(&file).expect("a file"));
    }
}

/// Without --library the tool searches the library beside itself, then in ../lib, as `cargo xtask stage` installs both, then in
/// Debian's folder of libraries for this architecture.
#[test]
fn the_library_is_looked_for_beside_the_tool() {
    let place = ExecFolder::new();
    let (bin, lib) = (place.path().join("stage/bin"), place.path().join("stage/lib"));
    fs::create_dir_all(&bin).expect("a folder");
    let debian = lib.join(format!("{}-linux-gnu", std::env::consts::ARCH));
    fs::create_dir_all(&debian).expect("a folder");
    let tool = bin.join("ecmsk");
    install(Path::new(env!("CARGO_BIN_EXE_ecmsk")), &tool, "755");
    let run = || {
        let mut command = Command::new(&tool);
        command.args([
            "exec",
            "--",
            "sh",
            "-c",
            ": > \"$ECMSK_OPENED\"; readlink \"${LD_LIBRARY_PATH%%:*}/libNEXTWUSBLib.so\"",
        ]);
        Ran::from(command.env("TMPDIR", place.tmp()).output().expect("the tool starts"))
    };
    let bin = fs::canonicalize(&bin).expect("a folder");
    let [lib, debian] = [lib, debian].map(|folder| fs::canonicalize(folder).expect("a folder"));
    run().expect_failure(
        125,
        &["no libNEXTWUSBLib.so in", &format!("{} or {}", bin.display(), lib.display())],
        "name it with --library",
    );
    for folder in [debian, lib, bin] {
        let library = folder.join("libNEXTWUSBLib.so");
        fs::copy("/bin/sh", &library).expect("a copy");
        assert_eq!(Path::new(run().expect_quiet().trim_end()), library);
    }
}

/// A file that is no library is an error of the tool: the dynamic linker would silently load another one.
#[test]
fn what_is_no_library_is_refused() {
    let place = ExecFolder::new();
    let run = |library: &OsStr| {
        let mut command = ecmsk(["exec", "--library"]);
        command.arg(library).args(["--", "sh", "-c", "echo started"]).env("TMPDIR", place.tmp());
        let ran = Ran::from(command.output().expect("the tool starts"));
        assert_eq!(ran.out, "", "the program was started");
        ran
    };
    let text = place.path().join("text.so");
    fs::write(&text, "no library").expect("a file");
    run(text.as_os_str()).expect_failure(125, &["text.so is no shared library", "no ELF file"], "with --library");
    fs::write(&text, "").expect("a file");
    run(text.as_os_str()).expect_failure(125, &["too short"], "with --library");
    run(OsStr::new("/nowhere")).expect_failure(125, &["no libNEXTWUSBLib.so in /nowhere"], "with --library");
}
