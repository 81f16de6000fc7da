//! Folders for the tests of `ecmsk exec`, with a file in place of the library.

use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::Command;

use tempfile::TempDir;

use super::{Ran, ecmsk};

/// The shell command that reports an opened board, as the library does.
pub const OPEN_BOARD: &str = ": > \"$ECMSK_OPENED\";";

/// A folder with a stand-in for the library, which is a link to the tool, and with a sub-folder for temporary files.
pub struct ExecFolder {
    folder: TempDir,
}

impl ExecFolder {
    pub fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        fs::create_dir(folder.path().join("tmp")).expect("a folder");
        symlink(env!("CARGO_BIN_EXE_ecmsk"), folder.path().join("libNEXTWUSBLib.so")).expect("a link");
        Self { folder }
    }

    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    pub fn tmp(&self) -> PathBuf {
        self.path().join("tmp")
    }

    /// `ecmsk exec` with the stand-in for the library; this folder is the working directory.
    pub fn exec(&self, options: &[&str]) -> Command {
        let mut command = ecmsk(["exec", "--library"]);
        command.arg(self.path()).args(options).env("TMPDIR", self.tmp()).current_dir(self.path());
        command
    }

    /// Runs a shell script after [`OPEN_BOARD`], and checks that the folder for temporary files is empty afterwards.
    pub fn run(&self, options: &[&str], script: &str) -> Ran {
        let script = format!("{OPEN_BOARD} {script}");
        let ran = self.exec(options).args(["--", "sh", "-c", &script]).output().expect("the tool starts").into();
        self.is_clean();
        ran
    }

    /// Makes a file in this folder: its name, its content, and its permissions as `install -m` takes them.
    pub fn program(&self, name: &str, text: impl AsRef<[u8]>, mode: &str) {
        let source = self.path().join("source");
        fs::write(&source, text).expect("a file");
        install(&source, &self.path().join(name), mode);
    }

    #[track_caller]
    pub fn is_clean(&self) {
        let left: Vec<_> = fs::read_dir(self.tmp()).expect("a folder").flatten().map(|entry| entry.path()).collect();
        assert_eq!(left, Vec::<PathBuf>::new(), "left behind");
    }
}

/// Copies a file to be executed. Another process makes the copy: while this process has it open for writing, a
/// program that another test starts would have it open as well for a moment, and a file that is open for writing
/// cannot be executed.
pub fn install(from: &Path, to: &Path, mode: &str) {
    let status = Command::new("install").args(["-m", mode]).args([from, to]).status().expect("install starts");
    assert!(status.success(), "install {}", to.display());
}
