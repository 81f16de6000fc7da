//! Tests programs in C# and VB.NET on Microsoft's .NET Core for Windows, under Wine. C# is compiled by `dotnet.rs` as
//! everywhere; VB.NET by Microsoft's compiler, which runs on that .NET Core only, against Mono's libraries and so for
//! every .NET.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use super::wine::{self, Wine};
use super::{Width, build_width, folder, run_tests};
use crate::command;
use crate::dotnet;
use crate::error::Error;
use crate::npm::{DOTNET_X64, DOTNET_X86, VBC};
use crate::project::Project;
use crate::wheel::DOTNET_CORE_3;

/// The module of the tests.
pub const MODULE: &str = "dotnet::";

const VB_SOURCE: &str = "examples/vb";
const VB_PROGRAMS: [&str; 1] = ["GuideExample"];
/// Options for any .NET: the runtime library of VB.NET is compiled into the program.
const VB_OPTIONS: [&str; 8] = [
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

/// Whether a test with that name may belong to this width and this module.
pub fn takes(width: Width, name: &str) -> bool {
    width.has(name) && is_of_it(name)
}

/// Whether a test with that name is in this module.
pub fn is_of_it(name: &str) -> bool {
    name.starts_with(MODULE)
}

/// Runs the tests of a width: those whose names contain one of `names`, or all.
pub fn test(project: &Project, width: Width, names: &[String]) -> Result<(), Error> {
    let all = [MODULE.to_owned()];
    let names = if names.is_empty() { &all } else { names };
    let wine = wine::set_up(project, width)?;
    let dotnet = runtime(project, width, &wine)?;
    let prefix = folder(project).join("stage");
    build_width(project, width, &prefix)?;
    let out = project.target.join("xtask/dotnet");
    let compiled = dotnet::compile_into(project, &out)?;
    // VB.NET programs are compiled for both widths by the 64-bit compiler, and tested once.
    if width == Width::X64 {
        compile_vb(project, &wine, &dotnet, &compiled, &out.join("vb"))?;
    }
    run_tests(project, width, names, &[], |cargo| {
        cargo.env("ECMSK_WINDOWS_STAGE", &prefix).env("ECMSK_WINE", &wine.script);
        cargo.env("ECMSK_WINE_PROGRAMS", &wine.programs).env("ECMSK_WINE_DOTNET", &dotnet);
        cargo.env("ECMSK_VB_PROGRAMS", out.join("vb")).env("ECMSK_DOTNET", DOTNET_CORE_3.program(project));
    })?;
    wine.clear()
}

/// The path of `dotnet.exe` in Wine.
fn runtime(project: &Project, width: Width, wine: &Wine) -> Result<PathBuf, Error> {
    const PROGRAM: &str = "dotnet.exe";
    if width == Width::X64 {
        return Ok(DOTNET_X64.folder(project).join(PROGRAM));
    }
    // 32-bit Wine runs in another root, so its files have to be there, too; they are only read.
    let from = DOTNET_X86.folder(project);
    let name = from.file_name().unwrap_or_default();
    let copy = wine.root().join(name);
    if !copy.exists() {
        let new = copy.with_extension("new");
        command::run(Command::new("cp").args(["--recursive", "--link", "--no-target-directory"]).arg(&from).arg(&new))?;
        fs::rename(&new, &copy).map_err(Error::file("rename", &new))?;
    }
    Ok(Path::new("/").join(name).join(PROGRAM))
}

/// Compiles the programs of [`VB_SOURCE`] into `out`, with the assembly that they use.
fn compile_vb(
    project: &Project,
    wine: &Wine,
    dotnet: &Path,
    compiled: &dotnet::Compiled,
    out: &Path,
) -> Result<(), Error> {
    const ASSEMBLY: &str = "NEXTWUSB_dotNET.dll";
    fs::create_dir_all(out).map_err(Error::file("make", out))?;
    for file in [ASSEMBLY, "core.json"] {
        let from = compiled.programs.join(file);
        fs::copy(&from, out.join(file)).map_err(Error::file("copy", &from))?;
    }
    for name in VB_PROGRAMS {
        let mut vbc = Command::new(&wine.script);
        vbc.arg(".").arg(dotnet).arg(drive_z(&DOTNET_X64.folder(project).join(VBC))).args(VB_OPTIONS);
        vbc.arg(format!("-sdkpath:{}", drive_z(Path::new(MONO))));
        for reference in [Path::new(MONO).join("System.Core.dll"), out.join(ASSEMBLY)] {
            vbc.arg(format!("-reference:{}", drive_z(&reference)));
        }
        vbc.arg(format!("-out:{}", drive_z(&out.join(name).with_extension("exe"))));
        command::run(vbc.arg(drive_z(&project.root.join(VB_SOURCE).join(name).with_extension("vb"))))?;
    }
    Ok(())
}

/// A path of this system as a path of Wine.
fn drive_z(path: &Path) -> String {
    format!("Z:{}", path.display())
}
