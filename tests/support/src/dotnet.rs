//! The .NET files: those that `cargo xtask dotnet` compiles, and programs for the tests alone.

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use crate::{Program, out_dir, root, target_dir};

/// Two drives on virtual time.
pub const VIRTUAL: &str = "sim:?slaves=drive*2&clock=virtual";
/// Two drives on the real clock.
pub const REAL: &str = "sim:?slaves=drive*2&clock=real";

/// The assemblies by the vendor's names.
pub const VENDOR_ASSEMBLIES: [&str; 2] = ["NEXTWUSB_dotNET_12B", "NEXTWUSB_dotNET_16B"];
/// The assemblies.
pub const ASSEMBLIES: [&str; 3] = ["NEXTWUSB_dotNET", "NEXTWUSB_dotNET_12B", "NEXTWUSB_dotNET_16B"];

/// Every program of `examples/csharp/` with its snapshot, which it may share with a program in C++, and the keys of its
/// link.
pub const EXAMPLES: [(&str, &str, &str); 4] = [
    ("GuideExample", "dotnet_guide_example", ""),
    ("OperatorPanel", "operator_panel", "&script=SCRIPTS/alarm.ecmscript"),
    ("TwoAxes12B", "two_axes_12b", ""),
    ("TwoAxes16B", "two_axes_16b", "&slot=16"),
];

/// The link for the program `EcmskMoves`, which runs on the package Ecmsk: two drives and an IO slave on virtual time.
pub const WITH_IO: &str = "sim:?slaves=drive*2,io&clock=virtual";

/// What `EcmskMoves` prints, on slots of 12 bytes.
pub fn told_moves() -> String {
    format!(
        "slots of 12, in PreOP\ndevice type 0x00020192\n1000 frames, 0 lost\nmoved 10000 and -10000\n\
         PreOP > SafeOP; SafeOP > OP; OP > PreOP; \nNEXTWUSBLib {}\n",
        env!("CARGO_PKG_VERSION")
    )
}

/// Compiles a source against that Ecmsk.dll into a folder, with the configuration by which .NET Core runs it.
pub fn against_ecmsk(source: &Path, assembly: &Path, folder: &Path) -> Program {
    let exe = folder.join(source.file_name().expect("a name")).with_extension("exe");
    let mut mcs = Command::new("mcs");
    mcs.args(["-warn:4", "-warnaserror", "-r:System.Core.dll"]).arg(format!("-r:{}", assembly.display()));
    crate::succeed(mcs.arg(format!("-out:{}", exe.display())).arg(source));
    fs::copy(compiled().join("programs/core.json"), folder.join("core.json")).expect("a copy");
    Program { exe }
}

/// The output of `cargo xtask dotnet`, in the folders `assemblies`, `assemblies-x64`, `ecmsk` and `programs`.
pub fn compiled() -> &'static Path {
    static COMPILED: OnceLock<PathBuf> = OnceLock::new();
    COMPILED.get_or_init(|| compile_into(&target_dir().join("xtask/dotnet"), &[]).0)
}

/// Runs `cargo xtask dotnet`; returns the folder and its output.
pub fn compile_into(out: &Path, arguments: &[&str]) -> (PathBuf, String) {
    let mut cargo = crate::cargo();
    cargo.args(["run", "--quiet", "--package", "xtask", "--target-dir"]).arg(target_dir());
    // The command asks cargo for the target folder.
    cargo.env("CARGO_TARGET_DIR", target_dir());
    let said = crate::succeed(cargo.args(["--", "dotnet", "--out"]).arg(out).args(arguments));
    (out.to_path_buf(), said)
}

/// A program of `examples/csharp/`.
pub fn example(name: &str) -> Program {
    Program { exe: compiled().join("programs").join(name).with_extension("exe") }
}

/// Which of two pairs of assemblies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pair {
    /// For any processor, as the vendor's pair for x86.
    X86,
    /// Bound to x86-64.
    X64,
}

impl Pair {
    /// Both.
    pub const ALL: [Self; 2] = [Self::X86, Self::X64];

    /// The name of the folder with `NEXTWUSBLib.dll`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::X86 => "x86",
            Self::X64 => "x64",
        }
    }

    /// This project's assembly of that name.
    pub fn ours(self, assembly: &str) -> PathBuf {
        let folder = match self {
            Self::X86 => "assemblies",
            Self::X64 => "assemblies-x64",
        };
        compiled().join(folder).join(format!("{assembly}.dll"))
    }

    /// The stand-in for the vendor's assembly of that name, see `StandIn.cs`.
    pub fn stand_in(self, assembly: &str) -> PathBuf {
        let dll = out_dir().join(format!("vendor-{}", self.name())).join(format!("{assembly}.dll"));
        let platform = if self == Self::X64 { "x64" } else { "anycpu" };
        once(&dll, || {
            let mut mcs = mcs(&dll, assembly, None, &["StandIn"]);
            mcs.arg("-target:library").arg(format!("-platform:{platform}"));
            mcs
        });
        dll
    }
}

/// The folder of programs for the tests.
pub fn sources() -> PathBuf {
    root().join("tests/capi/dotnet/programs")
}

/// Compiles a program of `tests/capi/dotnet/programs/` against an assembly, once.
pub fn test_program(name: &str, assembly: &str) -> Program {
    let folder = out_dir().join(format!("on-{assembly}"));
    let exe = folder.join(name).with_extension("exe");
    let programs = compiled().join("programs");
    let files: &[&str] = if assembly == "NEXTWUSB_dotNET" { &[name, "Check"] } else { &[name] };
    once(&exe, || {
        for file in [format!("{assembly}.dll"), "core.json".to_owned()] {
            place(&programs.join(&file), &folder.join(&file));
        }
        mcs(&exe, assembly, Some(&folder.join(assembly).with_extension("dll")), files)
    });
    Program { exe }
}

/// Compiles a program against the stand-in for the vendor's assembly, once. No assembly is beside it.
pub fn vendor_program(name: &str, assembly: &str) -> Program {
    let stand_in = Pair::X86.stand_in(assembly);
    let exe = out_dir().join(format!("against-{assembly}")).join(name).with_extension("exe");
    once(&exe, || mcs(&exe, assembly, Some(&stand_in), &[name]));
    Program { exe }
}

/// A copy of a program in a folder of its own, beside that assembly alone.
///
/// # Panics
/// If the copy is not that program, byte for byte.
pub fn beside(program: &Program, assembly: &Path, folder: &Path) -> Program {
    let exe = folder.join(program.exe.file_name().expect("a name"));
    let config = compiled().join("programs/core.json");
    for (from, to) in [
        (program.exe.as_path(), exe.clone()),
        (assembly, folder.join(assembly.file_name().expect("a name"))),
        (config.as_path(), folder.join("core.json")),
    ] {
        fs::copy(from, to).expect("a copy");
    }
    assert!(fs::read(&exe).expect("a copy") == fs::read(&program.exe).expect("a program"));
    Program { exe }
}

/// The constants as the programs `Types` print them: name, type and value, of the table `surface.txt` for that
/// assembly.
pub fn told_constants(assembly: &str) -> String {
    let table = fs::read_to_string(root().join("tests/capi/dotnet/surface.txt")).expect("the table");
    let (_, part) = table.split_once(&format!("assembly {assembly} ")).expect("it is in the table");
    let part = part.split("\n assembly ").next().expect("the part of it");
    let constants = part.lines().filter_map(|line| line.strip_prefix("     public const "));
    constants
        .map(|line| {
            let words: Vec<&str> = line.split(' ').collect();
            format!("{} {} {}\n", words[1], words[0], words[3])
        })
        .collect()
}

/// The whole output of the programs `Types`.
pub fn told_types(assembly: &str) -> String {
    let channels = match assembly {
        "NEXTWUSB_dotNET_16B" => "15 7 11223344 5566 CCDDAABB 7788\n15 7 11223344 AABC5566 7788CCDD\n",
        _ => "",
    };
    let constants = told_constants(assembly);
    assert_eq!(constants.lines().count(), 38, "{constants}");
    format!(
        "{constants}SV_ON CSP DRIVE_MODE drive on 0\n123F True 4 Step 10\nSV_OFF CSV DRIVE_MODE drive off 0\n\
         123F True 4 Step 10\n{channels}CRC EB 95 False\nopen True\nwrite True, read True, state 2, CRC True\nswapped 2\n\
         closed: write False, read False\n"
    )
}

/// Mono's compiler for a file, with sources of [`sources`].
fn mcs(out: &Path, assembly: &str, reference: Option<&Path>, names: &[&str]) -> Command {
    let mut mcs = Command::new("mcs");
    mcs.args(["-warn:4", "-warnaserror", "-langversion:4", "-r:System.Core.dll"]);
    mcs.args(reference.map(|reference| format!("-r:{}", reference.display())));
    mcs.arg(format!("-out:{}", out.display()));
    mcs.args(names.iter().map(|name| sources().join(name).with_extension("cs")));
    if assembly.ends_with("16B") {
        mcs.arg("-define:SLOTS_OF_16_BYTES");
    }
    mcs
}

/// Runs the command that makes a file, once per test program.
fn once(file: &Path, make: impl FnOnce() -> Command) {
    static DONE: Mutex<BTreeMap<PathBuf, Arc<OnceLock<()>>>> = Mutex::new(BTreeMap::new());
    let once = Arc::clone(DONE.lock().unwrap_or_else(PoisonError::into_inner).entry(file.to_owned()).or_default());
    once.get_or_init(|| {
        fs::create_dir_all(file.parent().expect("a folder")).expect("a folder in the target folder");
        crate::succeed(&mut make());
    });
}

/// Makes a link at `to`, even if another process makes the same one meanwhile.
pub fn place(from: &Path, to: &Path) {
    let own = to.with_extension(format!("{}-{:?}", std::process::id(), std::thread::current().id()));
    let _ = fs::remove_file(&own);
    symlink(from, &own).expect("a symbolic link");
    fs::rename(&own, to).expect("it can be named");
}
