//! A Windows program in the guest, with the DLL beside it.

use std::fs::{self, File};
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::thread;

use support::served::PATIENCE;

/// The guest's folder with the programs and the DLL of a width, and a local folder, from which Wine loads more
/// reliably.
const GIVEN: &str = "/rig";
const OWN: &str = "/tmp/programs";
const STDERR: &str = "/tmp/program.stderr";

/// A width of programs.
#[derive(Clone, Copy, Debug)]
pub enum Width {
    X64,
    X86,
}

impl Width {
    pub const fn name(self) -> &'static str {
        match self {
            Self::X64 => "x64",
            Self::X86 => "x86",
        }
    }
}

/// A program that runs.
pub struct Program {
    child: Child,
    lines: Receiver<String>,
    folder: PathBuf,
    what: String,
}

impl Program {
    /// Starts it under Wine.
    #[track_caller]
    pub fn start(width: Width, program: &str, link: &str, arguments: &[&str]) -> Self {
        let folder = folder(width);
        let mut wine = wine(&folder, program, link, arguments);
        wine.stdout(Stdio::piped());
        let mut child = wine.stderr(File::create(STDERR).expect("/tmp is there")).spawn().expect("Wine starts");
        let said = BufReader::new(child.stdout.take().expect("it is a pipe"));
        let (sender, lines) = mpsc::channel();
        thread::spawn(move || {
            said.lines().map_while(Result::ok).try_for_each(|line| sender.send(line.trim_end().to_owned()))
        });
        Self { child, lines, folder, what: format!("{width:?} {program} {arguments:?} on {link}") }
    }

    /// The next line that it prints.
    #[track_caller]
    pub fn says(&mut self, line: &str) {
        match self.lines.recv_timeout(PATIENCE) {
            Ok(said) => assert_eq!(said, line, "{}: {}", self.what, complaints()),
            Err(why) => panic!("{}: no `{line}` ({why}): {}", self.what, complaints()),
        }
    }

    /// Its lines until it ends successfully, with nothing on standard error.
    #[track_caller]
    pub fn all(mut self) -> Vec<String> {
        let mut all = Vec::new();
        loop {
            match self.lines.recv_timeout(PATIENCE) {
                Ok(line) => all.push(line),
                Err(RecvTimeoutError::Disconnected) => break,
                Err(why) => panic!("{}: no end ({why}): {}", self.what, complaints()),
            }
        }
        self.ends_well();
        all
    }

    /// Signals it by creating this file.
    pub fn tell(&self, file: &str) {
        fs::write(self.folder.join(file), "").expect("its folder is there");
    }

    /// It prints `ok` and ends successfully, with nothing on standard error.
    #[track_caller]
    pub fn passes(mut self) {
        self.says("ok");
        self.ends_well();
    }

    #[track_caller]
    fn ends_well(&mut self) {
        let status = self.child.wait().expect("it ends");
        assert!(status.success(), "{}: {status}: {}", self.what, complaints());
        assert_eq!(complaints(), "", "{}", self.what);
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        // It has ended, or a test has failed.
        let _ = self.child.kill();
        let _ = self.child.wait();
        for file in ["back", "end"] {
            let _ = fs::remove_file(self.folder.join(file));
        }
    }
}

/// Runs a program of the tests that prints `ok`.
#[track_caller]
pub fn passes(width: Width, program: &str, link: &str, arguments: &[&str]) {
    Program::start(width, program, link, arguments).passes();
}

/// The number of boards that `ecmsk list` shows under Wine.
#[track_caller]
pub fn listed() -> usize {
    let output = wine(&folder(Width::X64), "ecmsk", "", &["list", "--json"]).output().expect("Wine starts");
    // A board that goes at this moment is a line with a reason.
    String::from_utf8_lossy(&output.stdout).lines().filter(|line| line.contains("\"board\":true")).count()
}

/// A call of a program under Wine.
fn wine(folder: &Path, program: &str, link: &str, arguments: &[&str]) -> Command {
    let mut wine = Command::new("wine");
    wine.current_dir(folder).arg(format!("{program}.exe")).args(arguments);
    wine.env("ECMSK_LINK", link).stdin(Stdio::null());
    wine
}

fn complaints() -> String {
    fs::read_to_string(STDERR).unwrap_or_default()
}

/// The local folder with the programs of a width, which the first call fills.
fn folder(width: Width) -> PathBuf {
    let folder = Path::new(OWN).join(width.name());
    if !folder.exists() {
        fs::create_dir_all(&folder).expect("a folder in /tmp");
        for file in fs::read_dir(Path::new(GIVEN).join(width.name())).expect("the programs are there") {
            let file = file.expect("it is listed").path();
            fs::copy(&file, folder.join(file.file_name().expect("a file"))).expect("it is copied");
        }
    }
    folder
}
