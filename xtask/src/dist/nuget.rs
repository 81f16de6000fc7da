//! The NuGet packages: `Ecmsk`, the .NET API with `NEXTWUSBLib` for each platform, and `NEXTWUSB.Compat`, the assemblies for
//! existing programs. A package is a zip file with a manifest (`.nuspec`) and two files by which Open Packaging Conventions
//! name what is in it. It is packed with `zip`, because no tool of .NET that packs runs on Debian.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use super::release::Release;
use super::tree::{DATA, Tree};
use super::{archive, first_axis};
use crate::command;
use crate::dotnet::Compiled;
use crate::error::Error;
use crate::needs::{MCS, MONO, UNZIP};
use crate::project::Project;

/// The folder with the manifests, build files and front pages of the packages.
const SOURCES: &str = "dotnet/packages";

/// A native library in the packages.
pub struct Native {
    /// The runtime identifier of .NET for its platform, such as `linux-x64`.
    pub rid: &'static str,
    pub file: PathBuf,
}

/// A NuGet package.
#[derive(Clone, Copy)]
struct Package {
    /// The id of the package, which is also the name of its files in [`SOURCES`].
    id: &'static str,
    /// The folders for MSBuild files. MSBuild takes the nearest framework; .NET Core has none of these.
    build: &'static [&'static str],
    /// Copies the assemblies into the tree.
    assemblies: fn(&Tree, &Compiled) -> Result<(), Error>,
}

const PACKAGES: [Package; 2] = [
    Package {
        id: "Ecmsk",
        build: &["build/net461", "buildTransitive/net461"],
        assemblies: |tree, compiled| tree.copy_all(&compiled.ecmsk, "lib/netstandard2.0", &[".dll", ".xml"]),
    },
    Package {
        id: "NEXTWUSB.Compat",
        build: &["build/net40", "buildTransitive/net40"],
        assemblies: |tree, compiled| {
            for folder in ["lib/net40", "lib/netstandard2.0"] {
                tree.copy_all(&compiled.assemblies, folder, &[".dll", ".xml"])?;
            }
            tree.copy_all(&compiled.assemblies_x64, "x64", &[".dll"])
        },
    },
];

/// The types of the parts of a package, as Open Packaging Conventions want them, by the ends of their names.
const TYPES: [(&str, &str); 8] = [
    ("rels", "application/vnd.openxmlformats-package.relationships+xml"),
    ("nuspec", "application/octet"),
    ("dll", "application/octet"),
    ("so", "application/octet"),
    ("xml", "application/octet"),
    ("targets", "application/octet"),
    ("md", "application/octet"),
    ("txt", "application/octet"),
];

/// Makes the packages in `out`; returns their file names. `others`: the licences of other projects' code in the native
/// libraries.
pub fn make(
    project: &Project,
    release: &Release,
    compiled: &Compiled,
    natives: &[Native],
    others: &str,
    work: &Path,
    out: &Path,
) -> Result<Vec<String>, Error> {
    fs::create_dir_all(out).map_err(Error::file("make", out))?;
    let mut names = Vec::new();
    for package in PACKAGES {
        let tree = Tree::new(work.join(package.id))?;
        fill(project, release, &tree, package, compiled, natives, others)?;
        let name = format!("{}.{}.nupkg", package.id, release.version);
        archive::zip_flat(release, project.archive_level(), &tree, &out.join(&name))?;
        names.push(name);
    }
    Ok(names)
}

/// A program on the package `Ecmsk`, and its link.
const PROGRAM: (&str, &str) = ("tests/capi/dotnet/programs/EcmskMoves.cs", "sim:?slaves=drive*2,io&clock=virtual");

/// Unpacks the package `Ecmsk` into the folder `place`, compiles a program against it, and moves two axes on Mono.
pub fn first_axis(project: &Project, package: &Path, place: &Path) -> Result<(), Error> {
    let (source, link) = PROGRAM;
    let program = place.join("program");
    fs::create_dir_all(&program).map_err(Error::file("make", &program))?;
    first_axis::timed("the NuGet package Ecmsk on Mono", "\nmoved 10000 and -10000\n", || {
        command::output(Command::new(UNZIP.program).arg("-q").arg(package).arg("-d").arg(place))?;
        let native = format!("runtimes/{}/native/libNEXTWUSBLib.so", super::RID_HERE);
        for file in ["lib/netstandard2.0/Ecmsk.dll", &native] {
            let from = place.join(file);
            let to = program.join(from.file_name().unwrap_or_default());
            fs::copy(&from, &to).map_err(Error::file("copy", &from))?;
        }
        let exe = program.join("moves.exe");
        let mut mcs = Command::new(MCS.program);
        mcs.args(["-r:System.Core.dll", "-r:Ecmsk.dll"]).arg(format!("-lib:{}", program.display()));
        command::output(mcs.arg(format!("-out:{}", exe.display())).arg(project.root.join(source)))?;
        let mut mono = Command::new(MONO.program);
        let said = command::output(mono.env_remove("LD_LIBRARY_PATH").env_remove("ECMSK_LINK").arg(exe).arg(link))?;
        Ok(String::from_utf8_lossy(&said).into_owned())
    })
}

fn fill(
    project: &Project,
    release: &Release,
    tree: &Tree,
    package: Package,
    compiled: &Compiled,
    natives: &[Native],
    others: &str,
) -> Result<(), Error> {
    let Package { id, build, assemblies } = package;
    let sources = project.root.join(SOURCES);
    let manifest = sources.join(format!("{id}.nuspec"));
    let text = fs::read_to_string(&manifest).map_err(Error::file("read", &manifest))?;
    tree.write(&format!("{id}.nuspec"), text.replace("@VERSION@", release.version))?;
    tree.copy(&sources.join(format!("{id}.README.md")), "README.md", DATA)?;
    for license in ["LICENSE-MIT", "LICENSE-APACHE"] {
        tree.copy(&project.root.join(license), &format!("{license}.txt"), DATA)?;
    }
    tree.write("THIRD-PARTY-LICENSES.txt", others)?;
    for folder in build {
        let name = format!("{id}.targets");
        tree.copy(&sources.join(&name), &format!("{folder}/{name}"), DATA)?;
    }
    assemblies(tree, compiled)?;
    for Native { rid, file } in natives {
        // The file has this name, whatever the name of the link to it is.
        let name = if rid.starts_with("win") { crate::windows::DLL } else { "libNEXTWUSBLib.so" };
        tree.copy(file, &format!("runtimes/{rid}/native/{name}"), DATA)?;
    }
    tree.write("[Content_Types].xml", content_types())?;
    tree.write("_rels/.rels", relations(id))
}

fn content_types() -> String {
    let types: String = TYPES
        .map(|(extension, kind)| format!("  <Default Extension=\"{extension}\" ContentType=\"{kind}\" />\n"))
        .concat();
    let schema = "http://schemas.openxmlformats.org/package/2006/content-types";
    format!("<?xml version=\"1.0\" encoding=\"utf-8\"?>\n<Types xmlns=\"{schema}\">\n{types}</Types>\n")
}

fn relations(id: &str) -> String {
    let schema = "http://schemas.openxmlformats.org/package/2006/relationships";
    let manifest = "http://schemas.microsoft.com/packaging/2010/07/manifest";
    format!(
        "<?xml version=\"1.0\" encoding=\"utf-8\"?>\n<Relationships xmlns=\"{schema}\">\n  \
         <Relationship Type=\"{manifest}\" Target=\"/{id}.nuspec\" Id=\"R1\" />\n</Relationships>\n"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    const RELEASE: Release = Release { version: "0.1.0", epoch: 1_795_305_600 };

    fn root() -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().to_owned()
    }

    /// Makes the packages in a folder, of files that stand for the compiled ones.
    fn packages(folder: &Path) -> Vec<PathBuf> {
        let place = |name: &str| {
            let folder = folder.join(name);
            fs::create_dir_all(&folder).unwrap();
            for end in ["dll", "xml", "so"] {
                fs::write(folder.join(format!("A.{end}")), name).unwrap();
            }
            folder
        };
        let compiled = Compiled {
            assemblies: place("assemblies"),
            assemblies_x64: place("assemblies-x64"),
            ecmsk: place("ecmsk"),
            programs: place("programs"),
        };
        let native = |rid| Native { rid, file: place(rid).join("A.so") };
        let natives = [native("win-x86"), native("linux-x64")];
        let project = Project { root: root(), target: folder.join("target"), for_tests: false, quick: true };
        let out = folder.join("out");
        let names = make(&project, &RELEASE, &compiled, &natives, "none\n", &folder.join("work"), &out).unwrap();
        names.iter().map(|name| out.join(name)).collect()
    }

    fn contents(package: &Path) -> Vec<String> {
        let said = command::output(Command::new("unzip").args(["-Z", "-1"]).arg(package)).unwrap();
        String::from_utf8(said).unwrap().lines().map(str::to_owned).collect()
    }

    #[test]
    fn the_packages_are_the_same_in_another_folder() {
        let folders = [(); 2].map(|()| tempfile::tempdir().unwrap());
        let [one, other] = [&folders[0], &folders[1]].map(|folder| packages(folder.path()));
        for (one, other) in one.iter().zip(&other) {
            assert!(fs::read(one).unwrap() == fs::read(other).unwrap(), "{}", one.display());
        }
        // Each part has a type, and each package its manifest with the version.
        for package in &one {
            let parts = contents(package);
            for part in parts.iter().filter(|part| *part != "[Content_Types].xml") {
                assert!(TYPES.iter().any(|(end, _)| part.ends_with(&format!(".{end}"))), "{part}");
            }
            for part in
                ["[Content_Types].xml", "_rels/.rels", "README.md", "runtimes/linux-x64/native/libNEXTWUSBLib.so"]
            {
                assert!(parts.iter().any(|found| found == part), "{part}: {parts:?}");
            }
            let id = package.file_name().unwrap().to_str().unwrap().strip_suffix(".0.1.0.nupkg").unwrap();
            let manifest = command::output(Command::new("unzip").arg("-p").arg(package).arg(format!("{id}.nuspec")));
            let manifest = String::from_utf8(manifest.unwrap()).unwrap();
            assert!(manifest.contains("<version>0.1.0</version>") && manifest.contains(&format!("<id>{id}</id>")));
        }
    }
}
