//! What is compiled: by `cargo xtask dotnet`, and of programs for the tests alone.

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

/// The assemblies.
pub const ASSEMBLIES: [&str; 3] = ["NEXTWUSB_dotNET", "NEXTWUSB_dotNET_12B", "NEXTWUSB_dotNET_16B"];

/// Every program of `examples/csharp/` with its snapshot, which a program in C++ shares where there is such a one, and the
/// keys of its link.
pub const EXAMPLES: [(&str, &str, &str); 4] = [
    ("GuideExample", "dotnet_guide_example", ""),
    ("OperatorPanel", "operator_panel", "&script=SCRIPTS/alarm.ecmscript"),
    ("TwoAxes12B", "two_axes_12b", ""),
    ("TwoAxes16B", "two_axes_16b", "&slot=16"),
];

/// What `cargo xtask dotnet` has compiled, in folders `assemblies` and `programs`.
pub fn compiled() -> &'static Path {
    static COMPILED: OnceLock<PathBuf> = OnceLock::new();
    COMPILED.get_or_init(|| compile_into(&target_dir().join("xtask/dotnet"), &[]).0)
}

/// Runs `cargo xtask dotnet`; gives the folder, and what it printed.
pub fn compile_into(out: &Path, arguments: &[&str]) -> (PathBuf, String) {
    let mut cargo = crate::cargo();
    cargo.args(["run", "--quiet", "--package", "xtask", "--target-dir"]).arg(target_dir());
    // It asks cargo where to build to.
    cargo.env("CARGO_TARGET_DIR", target_dir());
    let said = crate::succeed(cargo.args(["--", "dotnet", "--out"]).arg(out).args(arguments));
    (out.to_path_buf(), said)
}

/// A program of `examples/csharp/`.
pub fn example(name: &str) -> Program {
    Program { exe: compiled().join("programs").join(name).with_extension("exe") }
}

/// Compiles a program of `tests/capi/dotnet/programs/` against an assembly, once.
pub fn test_program(name: &str, assembly: &str) -> Program {
    static DONE: Mutex<BTreeMap<PathBuf, Arc<OnceLock<()>>>> = Mutex::new(BTreeMap::new());
    let folder = out_dir().join(format!("on-{assembly}"));
    let exe = folder.join(name).with_extension("exe");
    let once = Arc::clone(DONE.lock().unwrap_or_else(PoisonError::into_inner).entry(exe.clone()).or_default());
    once.get_or_init(|| {
        fs::create_dir_all(&folder).expect("a folder in the target folder");
        let programs = compiled().join("programs");
        for file in [format!("{assembly}.dll"), "core.json".to_owned()] {
            place(&programs.join(&file), &folder.join(&file));
        }
        let sources = root().join("tests/capi/dotnet/programs");
        let mut mcs = Command::new("mcs");
        mcs.args(["-warn:4", "-warnaserror", "-langversion:4", "-r:System.Core.dll"]);
        mcs.arg(format!("-r:{}", folder.join(assembly).with_extension("dll").display()));
        mcs.arg(format!("-out:{}", exe.display())).arg(sources.join(name).with_extension("cs"));
        if assembly.ends_with("16B") {
            mcs.arg("-define:SLOTS_OF_16_BYTES");
        } else if assembly == "NEXTWUSB_dotNET" {
            mcs.arg(sources.join("Check.cs"));
        }
        crate::succeed(&mut mcs);
    });
    Program { exe }
}

/// A link at `to`, whoever else makes the same one meanwhile.
pub fn place(from: &Path, to: &Path) {
    let own = to.with_extension(format!("{:?}", std::thread::current().id()));
    let _ = fs::remove_file(&own);
    symlink(from, &own).expect("a symbolic link");
    fs::rename(&own, to).expect("it can be named");
}
