//! Code that groups of tests share, here and in `tool/`: boards, programs on the library, recordings, servers.
//!
//! - a slave with an object of any length: `blob`
//! - networks and buses for the engine: `fieldbus_rig`, `bus_wrapper`, `slave_wrapper`, `ahead_bus`, `swift`, `images`
//! - on a network card: `lying_wire`, which changes working counters; `odd_line`, slaves written independently of the
//!   models, each as odd as a test wants
//! - behind an ECM-XF: `chip_line` with the chip, `faulty_wire` with faults, `late_host` with a PC that stalls, `chip_axis`
//!   an axis, `ears` drives that record their targets
//! - the guide's tables: `guide`, `homing_tables`; random numbers: `dice`, `schedules`
//! - programs and their recordings: `examples`, `script_client`, `recording`, `recorded`, `captures`, `dotnet`, `pe`
//! - how long a program's start takes: `start`
//! - commands of pages: `console`
//! - servers and logs: `served`, `tcp`, `usbip_client`, `heard`
//! - programs whose system calls fail: `failing_calls`
//!
//! At the top, C and C++ programs on the library of this build: it is built once, programs are compiled against `include/`,
//! linked with the library and run with the link that the test names.

pub mod ahead_bus;
pub mod blob;
pub mod bus_wrapper;
pub mod captures;
pub mod chip_axis;
pub mod chip_line;
pub mod console;
pub mod dice;
#[cfg(unix)]
pub mod dotnet;
pub mod ears;
pub mod examples;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
pub mod failing_calls;
pub mod faulty_wire;
pub mod fieldbus_rig;
pub mod guide;
pub mod heard;
pub mod homing_tables;
pub mod images;
pub mod late_host;
pub mod lying_wire;
pub mod odd_line;
pub mod pe;
pub mod recorded;
pub mod recording;
pub mod schedules;
pub mod script_client;
#[cfg(target_os = "linux")]
pub mod served;
pub mod slave_wrapper;
pub mod start;
pub mod swift;
#[cfg(any(unix, windows))]
pub mod tcp;
#[cfg(target_os = "linux")]
pub mod usbip_client;

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Output, Stdio};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::thread;
use std::time::{Duration, Instant};
use std::{env, fs, io};

use ecmsk::link::Dir;
use ecmsk::recording::Recording;
use ecmsk::sk::{DriveResponse, MasterResponse, MasterState, SlotSize, StateByte};

/// Every program of the tests takes a fraction of this, also under valgrind: a program that takes longer hangs.
const HANG: Duration = Duration::from_secs(300);

/// The root of the repository.
pub fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).expect("tests/ is in it")
}

/// Cargo's target folder, found by the path of this test program.
pub fn target_dir() -> &'static Path {
    static TARGET: OnceLock<PathBuf> = OnceLock::new();
    TARGET.get_or_init(|| {
        let program = env::current_exe().expect("the test knows its file");
        // PROFILE/deps/PROGRAM
        program.ancestors().nth(3).expect("it lies in the target folder").to_path_buf()
    })
}

/// `include/`.
pub fn include_dir() -> PathBuf {
    root().join("include")
}

/// A folder of this test program's own for the files that it makes.
pub fn out_dir() -> PathBuf {
    let program = env::current_exe().expect("the test knows its file");
    let name = program.file_stem().expect("it has a name").to_string_lossy().into_owned();
    // Without the hash that cargo appends.
    let name = name.rsplit_once('-').map_or(name.as_str(), |(name, _)| name);
    let dir = target_dir().join("tmp").join(name);
    fs::create_dir_all(&dir).expect("a folder in the target folder");
    dir
}

/// The library as it was just built.
pub struct Library {
    /// `libNEXTWUSBLib.so`, as cargo names it.
    pub shared: PathBuf,
    /// `libNEXTWUSBLib.a`.
    pub archive: PathBuf,
    /// A folder with the library under the names that linker and loader look for.
    pub dir: PathBuf,
}

/// cargo, with the environment as if no other cargo had started it.
pub fn cargo() -> Command {
    let mut cargo = Command::new(env!("CARGO"));
    // Cargo tells a test its package by these variables. A build script that reads them (ring's does) would be run
    // again, and all crates above it compiled again, here and the next time without a test.
    let told = env::vars_os().map(|(name, _)| name.to_string_lossy().into_owned());
    for name in told.filter(|name| name.starts_with("CARGO_PKG_") || name.starts_with("CARGO_MANIFEST_")) {
        cargo.env_remove(name);
    }
    cargo.current_dir(root());
    cargo
}

/// Builds the static library of `examples/firmware`, outside the workspace and with its own features, with these further
/// arguments; returns cargo's output, which is messages in JSON.
pub fn build_firmware(more: &[&str]) -> Output {
    let mut cargo = cargo();
    cargo.args(["build", "--release", "--locked", "--message-format=json"]);
    cargo.args(["--manifest-path=examples/firmware/Cargo.toml", "--target-dir"]).arg(firmware_dir()).args(more);
    // Flags of this test's own build (coverage, a linker) do not apply to a firmware.
    cargo.env_remove("RUSTFLAGS").env_remove("CARGO_ENCODED_RUSTFLAGS");
    cargo.output().expect("cargo can be started")
}

fn firmware_dir() -> PathBuf {
    target_dir().join("tmp/firmware")
}

/// The static library of `examples/firmware` for this machine, built.
pub fn firmware() -> PathBuf {
    let built = build_firmware(&[]);
    assert!(built.status.success(), "{}", String::from_utf8_lossy(&built.stderr));
    firmware_dir().join("release/libcontroller.a")
}

/// The library of this build.
pub fn library() -> &'static Library {
    static LIBRARY: OnceLock<Library> = OnceLock::new();
    LIBRARY.get_or_init(|| {
        let built = built();
        let (shared, archive) = (built.join("libNEXTWUSBLib.so"), built.join("libNEXTWUSBLib.a"));
        let dir = out_dir().join("lib");
        fs::create_dir_all(&dir).expect("a folder in the target folder");
        link(&shared, &dir.join("libNEXTWUSBLib.so.0"));
        link(Path::new("libNEXTWUSBLib.so.0"), &dir.join("libNEXTWUSBLib.so"));
        Library { shared, archive, dir }
    })
}

/// The module of the Python package that is written in Rust, as cargo names it.
pub fn python_module() -> PathBuf {
    built().join("libecmsk_python.so")
}

/// The tool, for tests of other packages than its own.
pub fn tool() -> PathBuf {
    built().join(format!("ecmsk{}", env::consts::EXE_SUFFIX))
}

/// The tool with these words, in an environment that names no link.
pub fn tool_without_link(words: &[&str]) -> Command {
    let nowhere = out_dir();
    let mut tool = Command::new(tool());
    tool.args(words).current_dir(&nowhere).env("HOME", &nowhere).env("XDG_CONFIG_HOME", &nowhere);
    for variable in ["ECMSK_LINK", "ECMSK_LOG", "CLICOLOR_FORCE"] {
        tool.env_remove(variable);
    }
    tool
}

/// A program of `examples/rust/`.
pub fn example(name: &str) -> Command {
    Command::new(built().join("examples").join(format!("{name}{}", env::consts::EXE_SUFFIX)))
}

/// Builds the libraries, the tool and the examples, once per test program, with the test's profile into the test's
/// target folder; returns their folder. All of the workspace is chosen, with the examples, so that the library has the
/// features which it has for `cargo test --workspace`, and is not compiled once more. The other parts of `cargo xtask
/// test --all` build what is installed as it is installed.
fn built() -> &'static Path {
    static BUILT: OnceLock<PathBuf> = OnceLock::new();
    BUILT.get_or_init(|| {
        let mut cargo = cargo();
        cargo.args(["build", "--quiet", "--workspace", "--lib", "--bin=ecmsk", "--examples", "--target-dir"]);
        cargo.arg(target_dir());
        let profile = if cfg!(debug_assertions) {
            "debug"
        } else {
            cargo.arg("--release");
            "release"
        };
        succeed(&mut cargo);
        target_dir().join(profile)
    })
}

#[cfg(unix)]
fn link(to: &Path, at: &Path) {
    match fs::remove_file(at) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => panic!("{}: {error}", at.display()),
        _ => std::os::unix::fs::symlink(to, at).expect("a symbolic link"),
    }
}

#[cfg(not(unix))]
fn link(to: &Path, at: &Path) {
    let from = at.parent().expect("a folder").join(to);
    fs::copy(from, at).expect("a copy");
}

/// A language as a compiler's option names it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Language {
    /// C of that standard.
    C(&'static str),
    /// C++ of that standard.
    Cpp(&'static str),
}

impl Language {
    /// `gcc` or `g++` with every warning an error.
    pub fn compiler(self) -> Command {
        let (program, variable, standard) = match self {
            Self::C(standard) => ("gcc", "CC", standard),
            Self::Cpp(standard) => ("g++", "CXX", standard),
        };
        let mut command = Command::new(env::var_os(variable).unwrap_or_else(|| program.into()));
        command.arg(format!("-std={standard}")).args(["-Wall", "-Wextra", "-pedantic", "-Werror", "-g", "-O1"]);
        command.arg("-I").arg(include_dir());
        command
    }
}

/// Compiles a program against the shared library, once per test program.
///
/// # Panics
/// If it does not compile without a warning.
pub fn compile(source: &Path, language: Language) -> Program {
    static DONE: Mutex<BTreeMap<PathBuf, Arc<OnceLock<()>>>> = Mutex::new(BTreeMap::new());
    let stem = source.file_stem().expect("a file").to_string_lossy();
    let (Language::C(standard) | Language::Cpp(standard)) = language;
    let exe = out_dir().join(format!("{stem}-{}", standard.replace('+', "p")));
    let once = Arc::clone(DONE.lock().unwrap_or_else(PoisonError::into_inner).entry(exe.clone()).or_default());
    once.get_or_init(|| {
        let mut compiler = language.compiler();
        compiler.arg(source).arg("-o").arg(&exe).arg("-L").arg(&library().dir).args(["-lNEXTWUSBLib", "-pthread"]);
        succeed(&mut compiler);
    });
    Program { exe }
}

/// Runs a command to its end and gives its standard output.
///
/// # Panics
/// If it cannot be started or ends with an error; the message has its output.
pub fn succeed(command: &mut Command) -> String {
    let output = match command.output() {
        Ok(output) => output,
        Err(error) => panic!("{command:?}: {error}; install the packages that CONTRIBUTING.md names"),
    };
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{command:?}: {}\n{said}", output.status);
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// A compiled program.
pub struct Program {
    /// Its file.
    pub exe: PathBuf,
}

/// How a program ended.
#[derive(Debug)]
pub struct Ended {
    /// Its exit status.
    pub status: ExitStatus,
    /// Standard output.
    pub stdout: String,
    /// Standard error.
    pub stderr: String,
}

impl Ended {
    /// The standard output of a program that ended well.
    ///
    /// # Panics
    /// If it did not; the message has all its output.
    pub fn success(self) -> String {
        assert!(self.status.success(), "{}\n--- stdout\n{}\n--- stderr\n{}", self.status, self.stdout, self.stderr);
        self.stdout
    }
}

impl Program {
    /// The program with the link in `ECMSK_LINK`, the library of this build, and nothing of the user's configuration.
    pub fn command(&self, link: &str) -> Command {
        on_library(Command::new(&self.exe), link)
    }

    /// The same under another program, such as valgrind.
    pub fn under(&self, tool: &str, args: &[&str], link: &str) -> Command {
        let mut command = Command::new(tool);
        command.args(args).arg(&self.exe);
        on_library(command, link)
    }

    /// Runs it to its end.
    pub fn run<A: AsRef<OsStr>>(&self, link: &str, args: impl IntoIterator<Item = A>) -> Ended {
        run(self.command(link).args(args))
    }
}

/// Makes the program find a file that is no libusb in its place.
pub fn without_libusb(command: &mut Command) {
    let folder = out_dir().join("no-libusb");
    fs::create_dir_all(&folder).expect("a folder in the target folder");
    fs::write(folder.join("libusb-1.0.so.0"), "no library").expect("a file in the target folder");
    let given = command.get_envs().find(|(name, _)| *name == "LD_LIBRARY_PATH").and_then(|(_, value)| value);
    let mut folders = vec![folder];
    folders.extend(given.map(std::env::split_paths).into_iter().flatten());
    command.env("LD_LIBRARY_PATH", std::env::join_paths(folders).expect("no colon in it"));
}

fn on_library(mut command: Command, link: &str) -> Command {
    let nowhere = out_dir().join("no-configuration");
    command
        .env("LD_LIBRARY_PATH", &library().dir)
        .env("ECMSK_LINK", link)
        .env("XDG_CONFIG_HOME", &nowhere)
        .env("HOME", &nowhere)
        .env_remove("ECMSK_LOG")
        .current_dir(out_dir());
    command
}

/// Runs a program under valgrind's memcheck. It must succeed, use no memory that is not its own or not initialised, and
/// leak none.
///
/// # Panics
/// If memcheck finds an error, or is not installed.
pub fn memcheck(program: &Program, link: &str, arguments: &[&str]) -> String {
    let tool = [
        "--quiet",
        "--error-exitcode=99",
        "--leak-check=full",
        // The stack of a thread that runs when the program ends is "possibly lost".
        "--show-leak-kinds=definite",
        "--errors-for-leak-kinds=definite",
        // Its threads run one at a time. By default a thread that never waits, a reader in virtual time, may keep all
        // others from running.
        "--fair-sched=yes",
    ];
    if Command::new("valgrind").arg("--version").output().is_err() {
        panic!(
            "valgrind is not there; `apt-get install valgrind libc6-dbg`, or skip the tests in modules needs_valgrind"
        );
    }
    let ended = run(program.under("valgrind", &tool, link).args(arguments));
    assert_eq!(ended.stderr, "", "{} on {link}", program.exe.display());
    ended.success()
}

/// Runs a command to its end.
///
/// # Panics
/// If it cannot be started or does not end.
pub fn run(command: &mut Command) -> Ended {
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = match command.spawn() {
        Ok(child) => child,
        Err(error) => panic!("{command:?}: {error}; install the packages that CONTRIBUTING.md names"),
    };
    let stdout = drain(child.stdout.take().expect("piped"));
    let stderr = drain(child.stderr.take().expect("piped"));
    let status = wait(&mut child);
    let [stdout, stderr] = [stdout, stderr].map(|thread| thread.join().expect("no panic"));
    match status {
        Some(status) => Ended { status, stdout, stderr },
        None => panic!("{command:?} hangs\n--- stdout\n{stdout}\n--- stderr\n{stderr}"),
    }
}

fn drain(mut from: impl Read + Send + 'static) -> thread::JoinHandle<String> {
    thread::spawn(move || {
        let mut bytes = Vec::new();
        from.read_to_end(&mut bytes).expect("a pipe can be read");
        String::from_utf8_lossy(&bytes).into_owned()
    })
}

fn wait(child: &mut Child) -> Option<ExitStatus> {
    let start = Instant::now();
    while start.elapsed() < HANG {
        if let Some(status) = child.try_wait().expect("a child can be waited for") {
            return Some(status);
        }
        thread::sleep(Duration::from_millis(2));
    }
    child.kill().expect("a child can be ended");
    child.wait().expect("a child can be waited for");
    None
}

/// A full pipe: it takes no more bytes until somebody reads it. It is filled with dots.
///
/// # Panics
/// If the system gives no pipe.
#[cfg(unix)]
pub fn full_pipe() -> (io::PipeReader, io::PipeWriter) {
    use rustix::fs::{OFlags, fcntl_setfl};
    use std::io::Write as _;

    let (reader, mut writer) = io::pipe().expect("a pipe");
    fcntl_setfl(&writer, OFlags::NONBLOCK).expect("a pipe");
    while writer.write(&[b'.'; 4096]).is_ok() {}
    while writer.write(b".").is_ok() {}
    fcntl_setfl(&writer, OFlags::empty()).expect("a pipe");
    (reader, writer)
}

/// Checks a program's output against `tests/snapshots/NAME.txt`, see [`kept`].
///
/// # Panics
/// If they differ.
pub fn snapshot(name: &str, actual: &str) {
    kept(&root().join("tests/snapshots").join(format!("{name}.txt")), actual);
}

/// Checks a text against a file of the repository. With `ECMSK_BLESS` set the file is written instead.
///
/// # Panics
/// If they differ.
pub fn kept(path: &Path, actual: &str) {
    if env::var_os("ECMSK_BLESS").is_some() {
        fs::create_dir_all(path.parent().expect("a folder")).expect("a folder of the repository");
        fs::write(path, actual).expect("the file can be written");
    }
    let kept = fs::read_to_string(path).unwrap_or_default();
    assert!(
        kept == actual,
        "{} differs; look at it, and if it is right run the test with ECMSK_BLESS=1\n--- kept\n{kept}\n--- now\n{actual}",
        path.display()
    );
}

/// In the last report of that recording drives 1 and 2 are off and the network is in PreOP.
#[track_caller]
pub fn both_axes_are_off_in_preop(recording: &Path) {
    let frames = Recording::open(recording).expect("the recording").map(|recorded| recorded.expect("a frame"));
    let last = frames.filter(|recorded| recorded.dir == Dir::Read).last().expect("a report").frame;
    let state = MasterResponse::decode(&last.slot(SlotSize::Bytes12, 0)).state;
    assert_eq!(state, StateByte::reached(MasterState::PreOp));
    let word = |slave| DriveResponse::decode(&last.slot(SlotSize::Bytes12, slave)).statusword;
    assert!(!word(1).is_enabled() && !word(2).is_enabled());
}
