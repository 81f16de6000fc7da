//! A C# program under Mono against the same in C, on virtual time. `dotnet_declared`: by declarations of its own, which hand over
//! arrays, against C's plain calls; a copy of each array, measured beside it (`dotnet_copy`), is taken off first: so it may be as
//! long as 1.5 times C's and that copy. `dotnet_loop`: by the assembly, which makes two copies of each response, against
//! C that does so too.

#[path = "../../benches/common/mod.rs"]
mod common;

use std::io::{BufRead, BufReader, Write};
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::{env, fs};

use common::Demand;

const LINK: &str = "sim:?slaves=drive*2&clock=virtual";
/// What either may take of C's time.
const TARGET: f64 = 1.5;
const BLOCKS: usize = 31;
/// Rounds of a block: some 10 ms.
const ROUNDS: u32 = 5_000;
/// Rounds before it counts: Mono has compiled all that it will by then.
const WARM_UP: u32 = 50_000;

fn main() {
    if !["mcs", "mono", "cc"].iter().all(|program| is_there(program)) {
        eprintln!("left out: they need mcs, mono and cc (sudo apt-get install mono-mcs mono-runtime gcc)");
        return;
    }
    let target = Path::new(env!("CARGO_TARGET_TMPDIR")).parent().expect("it lies in the target folder");
    let folder = target.join("tmp/dotnet-bench");
    let library = library(target, &folder);
    let assembly = assembly(target, &folder);

    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("benches/loops");
    let (in_c, in_cs) = (folder.join("loop"), folder.join("Loop.exe"));
    let mut cc = Command::new("cc");
    cc.args(["-O2", "-std=c99", "-I"]).arg(source.join("../../../include")).arg(source.join("loop.c"));
    run(cc.arg("-o").arg(&in_c).arg("-L").arg(&library).arg("-lNEXTWUSBLib"));
    let mut mcs = Command::new("mcs");
    mcs.arg("-optimize").arg(format!("-r:{}", assembly.display())).arg(format!("-out:{}", in_cs.display()));
    run(mcs.arg(source.join("Loop.cs")));

    let start = |mut command: Command, argument: &str| {
        command.args(Some(argument).filter(|argument| !argument.is_empty()));
        Loop::start(command, &library)
    };
    let by_mono = |argument: &str| {
        let mut mono = Command::new("mono");
        mono.arg(&in_cs);
        start(mono, argument)
    };
    let mut copies = by_mono("copy");
    let copy = common::median((0..BLOCKS).map(|_| copies.block(ROUNDS)).collect());
    common::fact("dotnet_copy", copy, "ns");
    for (name, cs_argument, c_argument, less) in
        [("dotnet_declared", "declared", "", copy), ("dotnet_loop", "", "copies", 0.0)]
    {
        let mut ours = by_mono(cs_argument);
        let mut baseline = start(Command::new(&in_c), c_argument);
        let demand = Demand { name, target: Some(TARGET), allowance: None, against: None };
        common::pair_of_blocks(demand, BLOCKS, || ours.block(ROUNDS) - less, || baseline.block(ROUNDS));
    }
}

/// A program that goes round for us.
struct Loop {
    child: Child,
    rounds: ChildStdin,
    times: BufReader<ChildStdout>,
}

impl Loop {
    fn start(mut command: Command, library: &Path) -> Self {
        command.env("ECMSK_LINK", LINK).env("LD_LIBRARY_PATH", library);
        let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().expect("it starts");
        let rounds = child.stdin.take().expect("piped");
        let times = BufReader::new(child.stdout.take().expect("piped"));
        let mut started = Self { child, rounds, times };
        started.block(WARM_UP);
        started
    }

    /// Nanoseconds of a round.
    fn block(&mut self, rounds: u32) -> f64 {
        writeln!(self.rounds, "{rounds}").expect("it reads");
        let mut line = String::new();
        self.times.read_line(&mut line).expect("it answers");
        line.trim().parse().expect("a time")
    }
}

impl Drop for Loop {
    fn drop(&mut self) {
        // It has nothing that is not lost anyhow.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The library as it is measured everywhere, in a folder by the names that linkers look for.
fn library(target: &Path, folder: &Path) -> PathBuf {
    run(cargo(target).args(["build", "--quiet", "--profile", "bench", "--package", "NEXTWUSBLib"]));
    let library = folder.join("lib");
    let _ = fs::remove_dir_all(&library);
    fs::create_dir_all(&library).expect("a folder in the target folder");
    for name in ["libNEXTWUSBLib.so", "libNEXTWUSBLib.so.0"] {
        symlink(target.join("release/libNEXTWUSBLib.so"), library.join(name)).expect("a symbolic link");
    }
    library
}

/// The assembly of the guides' samples, beside the program that will use it.
fn assembly(target: &Path, folder: &Path) -> PathBuf {
    let out = folder.join("compiled");
    run(cargo(target).args(["run", "--quiet", "--package", "xtask", "--", "dotnet", "--out"]).arg(&out));
    let name = "NEXTWUSB_dotNET.dll";
    fs::copy(out.join("assemblies").join(name), folder.join(name)).expect("it is compiled");
    folder.join(name)
}

fn cargo(target: &Path) -> Command {
    let mut cargo = Command::new(env!("CARGO"));
    // As it is without a bench that is told its package: a build script that looks at these (ring's does) would be run again.
    let told = env::vars_os().map(|(name, _)| name.to_string_lossy().into_owned());
    for name in told.filter(|name| name.starts_with("CARGO_PKG_") || name.starts_with("CARGO_MANIFEST_")) {
        cargo.env_remove(name);
    }
    cargo.env("CARGO_TARGET_DIR", target).current_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join(".."));
    cargo
}

fn is_there(program: &str) -> bool {
    Command::new(program).arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status().is_ok()
}

/// Figures alone go to standard output.
fn run(command: &mut Command) {
    let output = command.stderr(Stdio::inherit()).output().expect("it starts");
    assert!(output.status.success(), "{command:?}");
}
