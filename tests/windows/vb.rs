//! Compiles programs in VB.NET by Microsoft's compiler, against Mono's libraries and so for every .NET.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::fixture::given;
use support::dotnet::{Pair, sources};
use support::{self, Program, out_dir};

/// Options for any .NET: the runtime library of VB.NET is compiled into the program.
const OPTIONS: [&str; 8] = [
    "-nologo",
    "-deterministic+",
    "-optimize+",
    "-optionstrict+",
    "-warnaserror+",
    "-vbruntime*",
    r#"-define:_MYTYPE="Empty""#,
    "-target:exe",
];
/// Mono's libraries, which have the names of those of .NET Framework 4.
const MONO: &str = "/usr/lib/mono/4.5";

/// Compiles a program against an assembly.
pub fn compile(source: &Path, assembly: &Path) -> Program {
    let name = assembly.file_stem().expect("a name").to_str().expect("UTF-8");
    // A separate folder, since tests run in parallel.
    let folder = out_dir().join(format!("vb-{name}-{:?}", std::thread::current().id()));
    fs::create_dir_all(&folder).expect("a folder in the target folder");
    let exe = folder.join(source.file_stem().expect("a name")).with_extension("exe");
    let mut vbc = Command::new(given("ECMSK_VB_WINE"));
    vbc.arg(".").arg(given("ECMSK_VB_DOTNET")).arg(drive_z(&given("ECMSK_VBC"))).args(OPTIONS);
    if name.ends_with("16B") {
        vbc.arg("-define:SLOTS_OF_16_BYTES=True");
    }
    vbc.arg(format!("-sdkpath:{}", drive_z(Path::new(MONO))));
    for reference in [PathBuf::from(MONO).join("System.Core.dll"), assembly.to_owned()] {
        vbc.arg(format!("-reference:{}", drive_z(&reference)));
    }
    let output = vbc.arg(format!("-out:{}", drive_z(&exe))).arg(drive_z(source)).output().expect("the compiler runs");
    // The compiler writes its errors to standard output.
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&[output.stdout, output.stderr].concat()));
    Program { exe }
}

/// A program of the tests, compiled against the stand-in for the vendor's assembly of that name.
pub fn vendor_program(name: &str, assembly: &str) -> Program {
    compile(&sources().join(name).with_extension("vb"), &Pair::X86.stand_in(assembly))
}

/// A path of this system converted to Wine's.
fn drive_z(path: &Path) -> String {
    format!("Z:{}", path.display())
}
