//! `cargo xtask dotnet`: the .NET assemblies and the C# programs of `examples/`, compiled by Mono's compiler. The same
//! sources give the same bytes, so what is tested here is what is shipped.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::error::Error;
use crate::needs::{DOTNET_CORE, MCS, Need, PIP, PYTHON};
use crate::project::Project;
use crate::wheel::DOTNET_CORE_3;
use crate::{command, needs};

#[derive(clap::Args)]
pub struct Arguments {
    /// Folder for what is compiled; it is made if it is not there
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Fetch the runtime of .NET Core, too, and print where its program `dotnet` is
    #[arg(long)]
    runtime: bool,
}

/// What the sources of the assemblies are compiled by.
pub const NEEDS: &[Need] = &[MCS];
/// What `--runtime` needs.
pub const RUNTIME_NEEDS: &[Need] = &[PYTHON, PIP, DOTNET_CORE];

const ASSEMBLIES_SOURCE: &str = "capi/dotnet";
const PROGRAMS_SOURCE: &str = "examples/csharp";

/// Of [`ASSEMBLIES_SOURCE`]: an assembly and what its one source is told.
const ASSEMBLIES: [(&str, &str); 3] = [
    ("NEXTWUSB_dotNET_12B", "NAMED_12B"),
    ("NEXTWUSB_dotNET_16B", "SLOTS_OF_16_BYTES"),
    ("NEXTWUSB_dotNET", "NAMED_AS_IN_SAMPLES"),
];

/// A program of [`PROGRAMS_SOURCE`], by its file.
struct Program {
    name: &'static str,
    /// The sources that it shares with others.
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

/// The language of Visual Studio 2010, which the vendor's guide uses.
const LANGUAGE: &str = "-langversion:4";

/// Tells .NET Core what programs that know nothing of it run on: the version that is there, of 2.1 and later.
const RUNTIME_CONFIG: &str = r#"{
  "runtimeOptions": {
    "framework": { "name": "Microsoft.NETCore.App", "version": "2.1.0" },
    "rollForward": "Major",
    "configProperties": { "System.Globalization.Invariant": true }
  }
}
"#;

/// What is compiled.
pub struct Compiled {
    /// The assemblies, each with its documentation (`.xml`): what is shipped.
    pub assemblies: PathBuf,
    /// The programs, with copies of the assemblies, and `core.json`, which `dotnet exec --runtimeconfig` wants.
    pub programs: PathBuf,
}

pub fn run(project: &Project, arguments: &Arguments) -> Result<(), Error> {
    needs::require(project, NEEDS)?;
    let out = arguments.out.clone().unwrap_or_else(|| project.target.join("xtask/dotnet"));
    let compiled = compile_into(project, &out)?;
    println!("assemblies: {}", compiled.assemblies.display());
    println!("programs:   {}", compiled.programs.display());
    if arguments.runtime {
        needs::require(project, RUNTIME_NEEDS)?;
        println!("dotnet:     {}", DOTNET_CORE_3.program(project).display());
    }
    Ok(())
}

/// Compiles everything into folders of `out`.
pub fn compile_into(project: &Project, out: &Path) -> Result<Compiled, Error> {
    let [assemblies, programs] = ["assemblies", "programs"].map(|folder| out.join(folder));
    for folder in [&assemblies, &programs] {
        fs::create_dir_all(folder).map_err(Error::file("make", folder))?;
    }
    let sources = sources(&project.root, ASSEMBLIES_SOURCE)?;
    for (name, define) in ASSEMBLIES {
        let file = assemblies.join(name).with_extension("dll");
        let documentation = file.with_extension("xml");
        let mut mcs = compiler(project, &file);
        mcs.args(["-target:library", "-unsafe"]).arg(format!("-define:{define}"));
        mcs.arg(option("-doc:", &documentation)).args(&sources);
        command::run(&mut mcs)?;
        let beside = programs.join(name).with_extension("dll");
        fs::copy(&file, &beside).map_err(Error::file("copy", &file))?;
    }
    for program in &PROGRAMS {
        let reference = programs.join(program.assembly).with_extension("dll");
        let mut mcs = compiler(project, &programs.join(program.name).with_extension("exe"));
        mcs.arg("-target:exe").arg(option("-reference:", &reference)).arg("-reference:System.Core.dll");
        mcs.args(program.define.map(|define| format!("-define:{define}")));
        for name in [program.name].iter().chain(program.with) {
            mcs.arg(format!("{PROGRAMS_SOURCE}/{name}.cs"));
        }
        command::run(&mut mcs)?;
    }
    let config = programs.join("core.json");
    fs::write(&config, RUNTIME_CONFIG).map_err(Error::file("write", &config))?;
    Ok(Compiled { assemblies, programs })
}

/// Sources are named from the root: paths of this machine's are no part of what is compiled.
fn compiler(project: &Project, out: &Path) -> Command {
    let mut mcs = Command::new(MCS.program);
    mcs.current_dir(&project.root).args(["-deterministic", "-optimize", "-warn:4", "-warnaserror", LANGUAGE]);
    mcs.arg(option("-out:", out));
    mcs
}

fn option(name: &str, path: &Path) -> std::ffi::OsString {
    let mut option = std::ffi::OsString::from(name);
    option.push(path);
    option
}

/// The C# sources of a folder, from the root, always in the same order.
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
