//! The NuGet packages, unpacked as NuGet does it, and programs on them. NuGet itself is not run: on Debian no program that
//! restores packages can be had.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use crate::dotnet::runtime::Runtime;
use support::dotnet::{REAL, VIRTUAL, WITH_IO, against_ecmsk, compile_into, sources, told_moves};
use support::{self, Ended, Program, out_dir, root};

/// The output of `cargo xtask dotnet` with packages.
pub fn with_packages() -> &'static Path {
    static PACKAGES: OnceLock<PathBuf> = OnceLock::new();
    PACKAGES.get_or_init(|| {
        let library = support::library().shared.to_str().expect("UTF-8");
        compile_into(&out_dir().join("compiled again"), &["--library", library]).0
    })
}

/// A package, unpacked into a folder as NuGet has its folder of packages: `ID/VERSION/` in small letters.
fn unpacked(id: &str) -> PathBuf {
    static FOLDERS: [OnceLock<PathBuf>; 2] = [const { OnceLock::new() }; 2];
    FOLDERS[usize::from(id != "Ecmsk")]
        .get_or_init(|| {
            let version = env!("CARGO_PKG_VERSION");
            let folder = out_dir().join("packages").join(id.to_lowercase()).join(version);
            let _ = fs::remove_dir_all(&folder);
            fs::create_dir_all(&folder).expect("a folder in the target folder");
            let package = with_packages().join("nuget").join(format!("{id}.{version}.nupkg"));
            support::succeed(Command::new("unzip").arg("-q").arg(package).arg("-d").arg(&folder));
            folder
        })
        .clone()
}

/// Compiles a source against the package Ecmsk, into a folder.
fn against_package(source: &Path, folder: &Path) -> Program {
    against_ecmsk(source, &unpacked("Ecmsk").join("lib/netstandard2.0/Ecmsk.dll"), folder)
}

/// Puts the files of a package beside a program, as for a program that is published: the assembly and the native library.
fn publish(folder: &Path) {
    let package = unpacked("Ecmsk");
    for file in ["lib/netstandard2.0/Ecmsk.dll", "runtimes/linux-x64/native/libNEXTWUSBLib.so"] {
        let file = package.join(file);
        fs::copy(&file, folder.join(file.file_name().expect("a name"))).expect("a copy");
    }
}

/// Runs a program without a library on the search path.
fn run(runtime: Runtime, program: &Program, arguments: &[&str]) -> Ended {
    support::run(runtime.command(program, "").env_remove("LD_LIBRARY_PATH").args(arguments))
}

fn published(name: &str, folder: &Path) -> Program {
    publish(folder);
    against_package(&sources().join(name).with_extension("cs"), folder)
}

/// A program goes to OP, switches axes on, moves them, transfers objects, counts and ends; with both sizes of slots and on the
/// machine's clock.
pub fn moves(runtime: Runtime) {
    let folder = tempfile::tempdir().expect("a folder");
    let program = published("EcmskMoves", folder.path());
    let expected = told_moves();
    for (keys, slot) in [("", "slots of 12"), ("&slot=16", "slots of 16")] {
        let ended = run(runtime, &program, &[&format!("{WITH_IO}{keys}")]);
        assert_eq!(ended.stderr, "", "{runtime:?} {slot}");
        assert_eq!(ended.success(), expected.replace("slots of 12", slot), "{runtime:?}");
    }
}

/// What goes wrong: exceptions with the texts of the library, twice disposed of, used after that, and under two threads.
pub fn errors(runtime: Runtime) {
    let folder = tempfile::tempdir().expect("a folder");
    let program = published("EcmskErrors", folder.path());
    let ended = run(runtime, &program, &[VIRTUAL]);
    assert_eq!(ended.stderr, "", "{runtime:?}");
    support::snapshot("ecmsk_errors", &ended.success());
    let ended = run(runtime, &program, &[REAL, "waits"]);
    assert_eq!((ended.stderr.as_str(), ended.stdout.as_str()), ("", "ok\n"), "{runtime:?}");

    // Without the library the exception says where it was searched.
    fs::remove_file(folder.path().join("libNEXTWUSBLib.so")).expect("a file");
    let ended = run(runtime, &program, &[VIRTUAL]);
    assert!(
        !ended.status.success() && ended.stderr.contains("no libNEXTWUSBLib.so for this 64-bit process"),
        "{ended:?}"
    );
}

/// Calls of several threads, and calls that end by exceptions. The script is that of the program.
pub fn threads(runtime: Runtime) {
    let folder = tempfile::tempdir().expect("a folder");
    let program = published("EcmskThreads", folder.path());
    let script = folder.path().join("script");
    let events = [
        "at 10s io 3 inputs 1",
        "at 10s full for 1s",
        "at 10s sdo-delay 1 800ms",
        "at 10500ms mute 2 for 100ms",
        "at 20s alarm 1 0x7500",
    ];
    fs::write(&script, events.join("\n")).expect("a script");
    let ended = run(runtime, &program, &[&format!("{WITH_IO}&script={}", script.display())]);
    assert_eq!((ended.stderr.as_str(), ended.stdout.as_str()), ("", "ok\n"), "{runtime:?}");
}

/// The program on the front page of the package.
pub fn front_page(runtime: Runtime) {
    let page = fs::read_to_string(unpacked("Ecmsk").join("README.md")).expect("the page");
    let (_, rest) = page.split_once("```csharp\n").expect("a program");
    let program = rest.split_once("```").expect("its end").0;
    let guide = fs::read_to_string(root().join("docs/NUGET.md")).expect("the page");
    assert!(guide.contains(program), "docs/NUGET.md has the same program");
    let folder = tempfile::tempdir().expect("a folder");
    let source = folder.path().join("Front.cs");
    let virtual_time = program.replace("sim:?slaves=drive*2", VIRTUAL);
    assert_ne!(virtual_time, program);
    fs::write(&source, virtual_time).expect("a source");
    publish(folder.path());
    let ended = run(runtime, &against_package(&source, folder.path()), &[]);
    assert_eq!((ended.stderr.as_str(), ended.stdout.as_str()), ("", "device type 0x00020192\n"), "{runtime:?}");
}

/// .NET Core finds the assembly and the native library in the folder of packages by what `dotnet restore` and `dotnet build`
/// write: the list of dependencies beside the program.
pub fn restored(dotnet: &Path) {
    let folder = tempfile::tempdir().expect("a folder");
    let program = against_package(&sources().join("EcmskMoves.cs"), folder.path());
    let version = env!("CARGO_PKG_VERSION");
    let list = r#"{
  "runtimeTarget": { "name": ".NETCoreApp,Version=v2.1" },
  "targets": { ".NETCoreApp,Version=v2.1": {
    "EcmskMoves/1.0.0": { "dependencies": { "Ecmsk": "@" }, "runtime": { "EcmskMoves.exe": {} } },
    "Ecmsk/@": {
      "runtime": { "lib/netstandard2.0/Ecmsk.dll": {} },
      "runtimeTargets": { "runtimes/linux-x64/native/libNEXTWUSBLib.so": { "rid": "linux-x64", "assetType": "native" } }
    }
  } },
  "libraries": {
    "EcmskMoves/1.0.0": { "type": "project", "serviceable": false, "sha512": "" },
    "Ecmsk/@": { "type": "package", "serviceable": true, "sha512": "", "path": "ecmsk/@" }
  }
}
"#;
    fs::write(program.exe.with_extension("deps.json"), list.replace('@', version)).expect("a file");
    let mut exec = Command::new(dotnet);
    exec.args(["exec", "--runtimeconfig"]).arg(folder.path().join("core.json"));
    exec.arg("--depsfile").arg(program.exe.with_extension("deps.json"));
    exec.arg("--additionalprobingpath").arg(out_dir().join("packages"));
    exec.arg(&program.exe).arg(WITH_IO).env("HOME", out_dir()).env_remove("LD_LIBRARY_PATH").env_remove("ECMSK_LINK");
    let ended = support::run(&mut exec);
    assert_eq!(ended.stderr, "");
    assert_eq!(ended.success(), told_moves());
}

/// The assembly has the version of the package, and the packages have the manifests and files that NuGet looks for. A build
/// file copies files that are in its package.
pub fn contents() {
    let version = env!("CARGO_PKG_VERSION");
    let assembly = fs::read_to_string(root().join("dotnet/Ecmsk/Assembly.cs")).expect("the source");
    assert!(assembly.contains(&format!("AssemblyVersion(\"{version}.0\")")), "{assembly}");
    for (id, build, assemblies) in [
        ("Ecmsk", "net461", &["lib/netstandard2.0/Ecmsk.dll", "lib/netstandard2.0/Ecmsk.xml"][..]),
        (
            "NEXTWUSB.Compat",
            "net40",
            &[
                "lib/net40/NEXTWUSB_dotNET.dll",
                "lib/netstandard2.0/NEXTWUSB_dotNET_16B.xml",
                "x64/NEXTWUSB_dotNET_12B.dll",
            ],
        ),
    ] {
        let package = unpacked(id);
        let manifest = fs::read_to_string(package.join(format!("{id}.nuspec"))).expect("the manifest");
        let manifest = roxmltree::Document::parse(&manifest).expect("XML");
        let text = |name| manifest.descendants().find(|node| node.tag_name().name() == name)?.text();
        assert_eq!((text("id"), text("version")), (Some(id), Some(version)));
        for file in assemblies {
            assert!(package.join(file).exists(), "{id}: {file}");
        }
        for folder in ["build", "buildTransitive"] {
            let file = package.join(folder).join(build).join(format!("{id}.targets"));
            let text = fs::read_to_string(&file).expect("the build file");
            let targets = roxmltree::Document::parse(&text).expect("XML");
            // The libraries of this machine alone are in packages for tests.
            let copied = targets.descendants().filter_map(|node| node.attribute("Include"));
            let copied: Vec<&str> = copied.filter(|path| path.contains("libNEXTWUSBLib.so")).collect();
            assert_eq!(copied.len(), 1, "{text}");
            let at = file.parent().expect("a folder").join("../../runtimes/linux-x64/native/libNEXTWUSBLib.so");
            assert!(text.contains("$(MSBuildThisFileDirectory)../../runtimes/") && at.exists(), "{text}");
        }
    }
}

/// The public members of Ecmsk, by their names in its documentation, which the compiler demands for each. A change is one for
/// programs that use the package.
pub fn members() {
    let text = fs::read_to_string(unpacked("Ecmsk").join("lib/netstandard2.0/Ecmsk.xml")).expect("the documentation");
    let xml = roxmltree::Document::parse(&text).expect("XML");
    let mut names = Vec::new();
    for member in xml.descendants().filter(|node| node.has_tag_name("member")) {
        let name = member.attribute("name").expect("a name");
        let summary = member.children().find(|node| node.has_tag_name("summary"));
        assert!(summary.is_some_and(|node| node.has_children()), "{name}");
        names.push(format!("{name}\n"));
    }
    names.sort();
    support::snapshot("ecmsk_members", &names.concat());
}
