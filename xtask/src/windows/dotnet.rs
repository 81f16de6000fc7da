//! Tests C# and VB.NET programs on Microsoft's .NET Core for Windows, under Wine. C# is compiled by Mono's compiler, as in all
//! tests. VB.NET is compiled by Microsoft's compiler, which runs only on the 64-bit .NET Core; the tests get its path.

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

/// The prefix of the names of the .NET tests: the module that they are in.
pub const MODULE: &str = "dotnet::";

/// The file name of the program that runs .NET Core programs.
const PROGRAM: &str = "dotnet.exe";

/// Whether `name` selects .NET tests of this width. It is a filter: the name of a test, or its beginning.
pub fn takes(width: Width, name: &str) -> bool {
    width.has(name) && is_of_it(name)
}

/// Whether `name` selects .NET tests: it begins with their module. It is a filter: the name of a test, or its beginning.
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
    dotnet::compile_into(project, &out)?;
    // The VB.NET compiler is a 64-bit program, so it needs the 64-bit Wine too.
    let compiler = if width == Width::X64 { None } else { Some(wine::set_up(project, Width::X64)?) };
    let vb = DOTNET_X64.folder(project);
    run_tests(project, width, names, &[], |cargo| {
        cargo.env("ECMSK_WINDOWS_STAGE", &prefix).env("ECMSK_WINE", &wine.script);
        cargo.env("ECMSK_WINE_PROGRAMS", &wine.programs).env("ECMSK_WINE_DOTNET", &dotnet);
        cargo.env("ECMSK_VB_WINE", &compiler.as_ref().unwrap_or(&wine).script);
        cargo.env("ECMSK_VB_DOTNET", vb.join(PROGRAM)).env("ECMSK_VBC", vb.join(VBC));
        cargo.env("ECMSK_DOTNET", DOTNET_CORE_3.program(project));
    })?;
    if let Some(compiler) = compiler {
        compiler.clear()?;
    }
    wine.clear()
}

/// The path of `dotnet.exe`, as Wine sees it. 64-bit Wine sees the folders of this system, 32-bit Wine those of its Debian
/// system.
fn runtime(project: &Project, width: Width, wine: &Wine) -> Result<PathBuf, Error> {
    if width == Width::X64 {
        return Ok(DOTNET_X64.folder(project).join(PROGRAM));
    }
    // 32-bit Wine runs in another root, so .NET Core has to be inside that root. Its files are only read there, so they are
    // hard links and take no space.
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
