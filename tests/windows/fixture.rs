//! DLLs, compilers and Wine, as set up by `cargo xtask test --windows`, and programs on them.

use std::ffi::OsStr;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs};

use support::{self, Ended, root};

/// The DLL's file.
pub const DLL: &str = "NEXTWUSBLib.dll";

/// Message of Wine 8 when its own connection between a program and its server fails. That happens to a thread which
/// creates another one while its process ends: of 1000 programs without this project's DLL whose last call was
/// CreateThread, 6 printed it.
const WINE_FAILED: &str = "wine client error:";
/// The signal by which 32-bit Wine 8 ends a program if the process ends while a new thread has not begun to run: Wine
/// ends the thread by a signal before it has saved the thread's segment register %gs, and that signal's handler then
/// reads through %gs = 0. 28 of 400 programs without this project's DLL whose last call was CreateThread ended so. So
/// did 5 of 1500 programs of .NET that closed the board during a read and returned; no 64-bit one did.
///
/// A fault in a DLL ends differently: a page fault, a jump to an invalid address, a full stack and an illegal
/// instruction cause an exit code and a text of Wine's on standard error, abort an exit code. One fault ends the same
/// way: an invalid stack pointer. A program is therefore run at most [`WINE_RUNS`] times, and a fault that happens each
/// time still fails.
const SIGSEGV: i32 = 11;
/// The maximum number of runs of a program if Wine itself fails.
const WINE_RUNS: usize = 4;

/// A width of programs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Width {
    X64,
    X86,
}

/// The compiler and linker, which define the conventions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Toolchain {
    /// gcc and GNU ld.
    MinGw,
    /// clang for `*-pc-windows-msvc` and lld-link, on the declarations in `msvc/`.
    Msvc,
}

impl Width {
    /// The name that xtask uses.
    pub const fn name(self) -> &'static str {
        match self {
            Self::X64 => "x64",
            Self::X86 => "x86",
        }
    }

    /// The begin of compilers' target triples.
    pub const fn machine(self) -> &'static str {
        match self {
            Self::X64 => "x86_64",
            Self::X86 => "i686",
        }
    }

    /// The folder with the files that xtask has built for this width.
    pub fn stage(self) -> PathBuf {
        given("ECMSK_WINDOWS_STAGE").join(self.name())
    }

    /// The DLL's bytes.
    pub fn dll(self) -> Vec<u8> {
        fs::read(self.stage().join(DLL)).expect("the DLL")
    }
}

/// A path that xtask passes in this variable.
pub fn given(variable: &str) -> PathBuf {
    match env::var_os(variable) {
        Some(value) => value.into(),
        None => panic!("{variable} is not set; run this test by `cargo xtask test --windows`"),
    }
}

/// A folder for programs, which is visible to Wine, too.
pub struct Folder {
    /// The width of its programs.
    pub width: Width,
    /// Its name below the folder of all programs.
    name: String,
}

impl Folder {
    /// An empty one, with the DLL in it.
    pub fn with_dll(width: Width, name: &str) -> Self {
        let folder = Self::empty(width, name);
        fs::copy(width.stage().join(DLL), folder.path().join(DLL)).expect("the DLL");
        folder
    }

    /// An empty one.
    pub fn empty(width: Width, name: &str) -> Self {
        let folder = Self { width, name: name.to_owned() };
        let _ = fs::remove_dir_all(folder.path());
        fs::create_dir_all(folder.path()).expect("a folder of Wine's");
        folder
    }

    /// Its path on this system.
    pub fn path(&self) -> PathBuf {
        given("ECMSK_WINE_PROGRAMS").join(&self.name)
    }

    /// Compiles `source`, and links it with the toolchain's import library.
    pub fn build(&self, toolchain: Toolchain, source: &Path, program: &str) {
        self.build_with(toolchain, source, program, &[]);
    }

    /// The same with options for the compiler.
    pub fn build_with(&self, toolchain: Toolchain, source: &Path, program: &str, options: &[&str]) {
        match toolchain {
            Toolchain::MinGw => {
                let mut gcc = self.gcc(source);
                gcc.args(options).arg(source).arg("-o").arg(self.path().join(program));
                // Linked statically, so that the program needs no DLL of the compiler's.
                gcc.args(["-static", "-L"]).arg(self.width.stage()).arg("-lNEXTWUSBLib");
                support::succeed(&mut gcc);
            }
            Toolchain::Msvc => {
                let start = self.object(&root().join("tests/windows/msvc/start.c"), &format!("{program}-start"), &[]);
                let object = self.object(source, program, options);
                let mut link = self.lld_link(program);
                link.arg(object).arg(start).arg("/entry:mainCRTStartup");
                // MinGW's libraries have no table of exception handlers, which Microsoft's linker requires on x86.
                link.arg("/safeseh:no").args(["msvcrt", "kernel32"].map(|name| self.mingw_library(name)));
                support::succeed(&mut link);
            }
        }
    }

    fn gcc(&self, source: &Path) -> Command {
        let (compiler, standard) = if is_c(source) { ("gcc", "gnu99") } else { ("g++", "gnu++17") };
        let mut gcc = Command::new(format!("{}-w64-mingw32-{compiler}-posix", self.width.machine()));
        gcc.arg(format!("-std={standard}")).args(["-O1", "-Wall", "-Wextra", "-Werror", "-I"]);
        gcc.arg(support::include_dir());
        gcc
    }

    /// Compiles for Microsoft's conventions.
    pub fn object(&self, source: &Path, name: &str, options: &[&str]) -> PathBuf {
        let ours = root().join("tests/windows/msvc");
        let mut clang = Command::new("clang-14");
        clang.arg(format!("--target={}-pc-windows-msvc", self.width.machine()));
        if is_c(source) {
            clang.arg("-std=c99");
        } else {
            clang.args(["-std=c++17", "-fno-exceptions", "-fno-rtti", "-nostdinc++", "-isystem"]).arg(ours.join("cpp"));
        }
        let object = self.path().join(format!("{name}.obj"));
        clang.args(["-O1", "-Wall", "-Wextra", "-Werror", "-isystem"]).arg(ours.join("c"));
        clang.arg("-I").arg(support::include_dir()).args(options).arg("-c").arg(source).arg("-o").arg(&object);
        support::succeed(&mut clang);
        object
    }

    /// lld-link, which is compatible with Microsoft's linker, with the import library for it.
    pub fn lld_link(&self, program: &str) -> Command {
        let mut link = Command::new("lld-link-14");
        link.args(["/nologo", "/nodefaultlib", "/subsystem:console"]);
        link.arg(format!("/out:{}", self.path().join(program).display()));
        link.arg(self.width.stage().join("NEXTWUSBLib.lib"));
        link
    }

    fn mingw_library(&self, name: &str) -> PathBuf {
        Path::new("/usr").join(format!("{}-w64-mingw32/lib/lib{name}.a", self.width.machine()))
    }

    /// The command that runs a program of the folder with that link.
    pub fn command(&self, program: &str, link: &str) -> Command {
        let mut command = Command::new(given("ECMSK_WINE"));
        command.arg(&self.name).arg(program);
        command.env("ECMSK_LINK", link).env_remove("ECMSK_LOG");
        command
    }

    /// Runs it to its end.
    pub fn run<A: AsRef<OsStr>>(&self, program: &str, link: &str, arguments: impl IntoIterator<Item = A>) -> Ended {
        let mut command = self.command(program, link);
        command.args(arguments);
        self.run_command(&mut command)
    }

    /// Runs a command of [`Self::command`] to its end. A run in which Wine itself failed ([`WINE_FAILED`], [`SIGSEGV`])
    /// is repeated, since it proves nothing about the program.
    pub fn run_command(&self, command: &mut Command) -> Ended {
        for _ in 1..WINE_RUNS {
            let ended = support::run(command);
            let Some(fault) = fault_of_wine(self.width, &ended) else {
                return ended;
            };
            println!("run again, since Wine failed: {command:?}: {fault}");
        }
        support::run(command)
    }

    /// Runs a program that checks itself and prints `ok`.
    pub fn passes(&self, program: &str, link: &str, arguments: &[&str]) {
        let ended = self.run(program, link, arguments);
        assert_eq!(ended.stderr, "", "{program} {arguments:?} on {link}");
        assert_eq!(lines(&ended.success()), "ok\n", "{program} {arguments:?} on {link}");
    }
}

/// Wine's own fault in this run, if any.
fn fault_of_wine(width: Width, ended: &Ended) -> Option<String> {
    if ended.stderr.contains(WINE_FAILED) {
        return Some(ended.stderr.trim_end().to_owned());
    }
    let by_signal = width == Width::X86 && ended.status.signal() == Some(SIGSEGV) && ended.stderr.is_empty();
    by_signal.then(|| "its process was ended by SIGSEGV, without a word to standard error".to_owned())
}

crate::for_each_width! {
    /// A program is run again only for a fault of Wine.
    #[test]
    fn faults_of_wine(width: Width) {
        use std::process::ExitStatus;

        let fault = |status, stderr: &str| {
            let status = ExitStatus::from_raw(status);
            let ended = Ended { status, stdout: "reading\n".to_owned(), stderr: stderr.to_owned() };
            fault_of_wine(width, &ended).is_some()
        };
        let page_fault = "wine: Unhandled page fault on write access to 00000010 at address 652014F7 (thread 0724)";
        assert!(fault(0, "wine client error:5ec: sendmsg: Socket operation on non-socket\n"));
        // Exit code 5 is the lowest byte of the access violation's, 0xC0000005.
        for (status, stderr) in [(0, ""), (0, "more"), (5 << 8, ""), (5 << 8, page_fault), (SIGSEGV, page_fault), (6, "")] {
            assert!(!fault(status, stderr), "{status} {stderr}");
        }
        assert_eq!(fault(SIGSEGV, ""), width == Width::X86);
    }
}

/// A source in `tests/windows/programs/`.
pub fn source(name: &str) -> PathBuf {
    root().join("tests/windows/programs").join(name)
}

/// A text written by Windows' C library, with this system's line ends.
pub fn lines(text: &str) -> String {
    text.replace("\r\n", "\n")
}

fn is_c(source: &Path) -> bool {
    source.extension() == Some(OsStr::new("c"))
}
