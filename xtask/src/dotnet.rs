//! `cargo xtask dotnet`: compiles the .NET assemblies and the C# programs of `examples/` with Mono's compiler. The same sources
//! give the same bytes, so the tested assemblies are those that are shipped.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::dist::{self, Native};
use crate::error::Error;
use crate::needs::{DOTNET_CORE, MCS, Need, PIP, PYTHON, ZIP};
use crate::project::Project;
use crate::wheel::DOTNET_CORE_3;
use crate::{command, needs};

#[derive(clap::Args)]
pub struct Arguments {
    /// Folder for the compiled files, created if it does not exist
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Fetch the runtime of .NET Core, too, and print the path of its program `dotnet`
    #[arg(long)]
    runtime: bool,
    /// Make the NuGet packages for this machine, too, with this libNEXTWUSBLib.so; those of a release, for all platforms, are
    /// made by `cargo xtask dist`
    #[arg(long, value_name = "FILE")]
    library: Option<PathBuf>,
}

/// The programs that compiling needs.
pub const NEEDS: &[Need] = &[MCS];
/// The program that the option `--library` needs to make packages.
const PACKAGE_NEEDS: &[Need] = &[ZIP];
/// The programs that the option `--runtime` needs to fetch .NET Core.
pub const RUNTIME_NEEDS: &[Need] = &[PYTHON, PIP, DOTNET_CORE];

const ASSEMBLIES_SOURCE: &str = "capi/dotnet";
const PROGRAMS_SOURCE: &str = "examples/csharp";
const ECMSK_SOURCE: &str = "dotnet/Ecmsk";
/// Sources in [`ASSEMBLIES_SOURCE`] that Ecmsk contains, too: how the library is found and loaded.
const SHARED: [&str; 2] = ["Loader.cs", "Places.cs"];

/// The assemblies, all from the sources in [`ASSEMBLIES_SOURCE`]: the name of each, and the conditional compilation symbol that
/// selects its variant.
const ASSEMBLIES: [(&str, &str); 3] = [
    ("NEXTWUSB_dotNET_12B", "NAMED_12B"),
    ("NEXTWUSB_dotNET_16B", "SLOTS_OF_16_BYTES"),
    ("NEXTWUSB_dotNET", "NAMED_AS_IN_SAMPLES"),
];

/// A C# program in [`PROGRAMS_SOURCE`].
struct Program {
    name: &'static str,
    /// The names, without `.cs`, of the further source files that are compiled into the program.
    with: &'static [&'static str],
    assembly: &'static str,
    define: Option<&'static str>,
}

const PROGRAMS: [Program; 4] = [
    Program { name: "GuideExample", with: &[], assembly: "NEXTWUSB_dotNET", define: None },
    Program { name: "OperatorPanel", with: &["Ecm", "Homing"], assembly: "NEXTWUSB_dotNET", define: None },
    Program { name: "TwoAxes12B", with: &["Ecm"], assembly: "NEXTWUSB_dotNET", define: None },
    Program { name: "TwoAxes16B", with: &["Ecm"], assembly: "NEXTWUSB_dotNET_16B", define: Some("SLOTS_OF_16_BYTES") },
];

/// The C# version of Visual Studio 2010, the development environment in the vendor's guide. So the assemblies and the
/// examples compile there, too.
const LANGUAGE: &str = "-langversion:4";
/// The C# version of Ecmsk: what Debian's compiler has.
const ECMSK_LANGUAGE: &str = "-langversion:7";

/// The runtime configuration for programs that were compiled without one: they run on any .NET Core from 2.1 on.
const RUNTIME_CONFIG: &str = r#"{
  "runtimeOptions": {
    "framework": { "name": "Microsoft.NETCore.App", "version": "2.1.0" },
    "rollForward": "Major",
    "configProperties": { "System.Globalization.Invariant": true }
  }
}
"#;

/// The folders of the compiled files.
pub struct Compiled {
    /// The folder of the assemblies for any CPU, each with its documentation (`.xml`). The packages contain the same files.
    pub assemblies: PathBuf,
    /// The folder of the assemblies for x86-64 only.
    pub assemblies_x64: PathBuf,
    /// The folder of Ecmsk, for any CPU, with its documentation (`.xml`).
    pub ecmsk: PathBuf,
    /// The folder of the programs, with copies of the assemblies, and with the runtime configuration `core.json` for `dotnet
    /// exec --runtimeconfig`.
    pub programs: PathBuf,
}

pub fn run(project: &Project, arguments: &Arguments) -> Result<(), Error> {
    needs::require(project, NEEDS)?;
    let out = arguments.out.clone().unwrap_or_else(|| project.target.join("xtask/dotnet"));
    let compiled = compile_into(project, &out)?;
    println!("assemblies: {}", compiled.assemblies.display());
    println!("  for x64:  {}", compiled.assemblies_x64.display());
    println!("Ecmsk:      {}", compiled.ecmsk.display());
    println!("programs:   {}", compiled.programs.display());
    if let Some(library) = &arguments.library {
        needs::require(project, PACKAGE_NEEDS)?;
        let native = Native { rid: dist::RID_HERE, file: library.clone() };
        let packages = dist::nuget_packages(project, &compiled, &[native], &out)?;
        println!("packages:   {}", packages.display());
    }
    if arguments.runtime {
        needs::require(project, RUNTIME_NEEDS)?;
        println!("dotnet:     {}", DOTNET_CORE_3.program(project).display());
    }
    Ok(())
}

/// Compiles the assemblies and the C# programs into folders of `out`.
pub fn compile_into(project: &Project, out: &Path) -> Result<Compiled, Error> {
    let [assemblies, assemblies_x64, ecmsk, programs] =
        ["assemblies", "assemblies-x64", "ecmsk", "programs"].map(|folder| out.join(folder));
    for folder in [&assemblies, &assemblies_x64, &ecmsk, &programs] {
        fs::create_dir_all(folder).map_err(Error::file("make", folder))?;
    }
    let sources = sources(&project.root, ASSEMBLIES_SOURCE)?;
    for (name, define) in ASSEMBLIES {
        let file = assemblies.join(name).with_extension("dll");
        let library = |file: &Path| {
            let mut mcs = compiler(project, file, LANGUAGE);
            mcs.args(["-target:library", "-unsafe"]).arg(format!("-define:{define}")).args(&sources);
            mcs
        };
        command::run(library(&file).arg(option("-doc:", &file.with_extension("xml"))))?;
        command::run(library(&assemblies_x64.join(name).with_extension("dll")).arg("-platform:x64"))?;
        let beside = programs.join(name).with_extension("dll");
        fs::copy(&file, &beside).map_err(Error::file("copy", &file))?;
    }
    compile_ecmsk(project, &ecmsk)?;
    for program in &PROGRAMS {
        let reference = programs.join(program.assembly).with_extension("dll");
        let mut mcs = compiler(project, &programs.join(program.name).with_extension("exe"), LANGUAGE);
        mcs.arg("-target:exe").arg(option("-reference:", &reference)).arg("-reference:System.Core.dll");
        mcs.args(program.define.map(|define| format!("-define:{define}")));
        for name in [program.name].iter().chain(program.with) {
            mcs.arg(format!("{PROGRAMS_SOURCE}/{name}.cs"));
        }
        command::run(&mut mcs)?;
    }
    let config = programs.join("core.json");
    fs::write(&config, RUNTIME_CONFIG).map_err(Error::file("write", &config))?;
    Ok(Compiled { assemblies, assemblies_x64, ecmsk, programs })
}

/// Compiles Ecmsk. It refers to the core library by the name that .NET Framework has for it, which each .NET with .NET
/// Standard 2.0 knows, too. \[OURS]: Debian has no reference assembly of .NET Standard.
fn compile_ecmsk(project: &Project, out: &Path) -> Result<(), Error> {
    let file = out.join("Ecmsk.dll");
    let mut mcs = compiler(project, &file, ECMSK_LANGUAGE);
    mcs.args(["-target:library", "-reference:System.Core.dll"]).arg(option("-doc:", &file.with_extension("xml")));
    mcs.args(sources(&project.root, ECMSK_SOURCE)?);
    command::run(mcs.args(SHARED.map(|name| format!("{ASSEMBLIES_SOURCE}/{name}"))))
}

/// The compiler, with paths relative to the root, so that no path of this machine is compiled in.
fn compiler(project: &Project, out: &Path, language: &str) -> Command {
    let mut mcs = Command::new(MCS.program);
    mcs.current_dir(&project.root).args(["-deterministic", "-optimize", "-warn:4", "-warnaserror", language]);
    mcs.arg(option("-out:", out));
    mcs
}

fn option(name: &str, path: &Path) -> std::ffi::OsString {
    let mut option = std::ffi::OsString::from(name);
    option.push(path);
    option
}

/// The C# sources of a folder, relative to the root, in a fixed order.
fn sources(root: &Path, folder: &str) -> Result<Vec<PathBuf>, Error> {
    let absolute = root.join(folder);
    let entries = fs::read_dir(&absolute).and_then(Iterator::collect::<std::io::Result<Vec<_>>>);
    let mut files: Vec<PathBuf> = entries
        .map_err(Error::file("list", &absolute))?
        .iter()
        .map(|entry| Path::new(folder).join(entry.file_name()))
        .filter(|file| file.extension().is_some_and(|extension| extension == "cs"))
        .collect();
    files.sort();
    Ok(files)
}
