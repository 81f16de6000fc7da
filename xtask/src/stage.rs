//! `cargo xtask stage`: installs the library, its headers and pkg-config file, and the tool with its manual pages and
//! completions, into a folder.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::error::Error;
use crate::project::Project;
use crate::system::symlink;
use crate::{command, remapped};

#[derive(clap::Args)]
pub struct Arguments {
    /// Folder for bin/, include/, lib/ and share/, created if it does not exist
    #[arg(long, value_name = "DIR")]
    prefix: PathBuf,
    /// Build profile of cargo
    #[arg(long, default_value = "release")]
    profile: String,
}

/// The packages that are installed, in the order in which they are built.
pub const PACKAGES: [&str; 3] = ["NEXTWUSBLib", SLEEP_PACKAGE, TOOL_PACKAGE];
/// The name of the tool's cargo package.
pub const TOOL_PACKAGE: &str = "ecmsk-tool";
/// The cargo package of the library that `ecmsk exec --clock virtual` preloads.
pub const SLEEP_PACKAGE: &str = "ecmsk-sleep";
/// That library below the folder of libraries. It is in a folder of its own, because no program links it.
pub const SLEEP_LIBRARY: &str = "ecmsk/libecmsk_sleep.so";
/// The SONAME: the name by which programs load the library. The library's build script sets the same.
pub const SONAME: &str = "libNEXTWUSBLib.so.0";
/// The file name that the linker searches for `-lNEXTWUSBLib`.
pub const LINK_NAME: &str = "libNEXTWUSBLib.so";
/// The udev rule that lets users open a board.
pub const UDEV_RULE: &str = "60-ecmsk.rules";
pub const ARCHIVE: &str = "libNEXTWUSBLib.a";
/// A small group of tests. cargo compiles the library with all features that the packages of one command need. With a group
/// of tests among them these are the features that the library has in the tests.
const GROUP: &str = "rooms";
/// The system libraries that a program needs when it links the static library, because Rust's standard library uses them.
pub const PRIVATE_LIBS: &str = "-lgcc_s -lutil -lrt -lpthread -lm -ldl -lc";
const PKGCONFIG_TEMPLATE: &str = include_str!("../../capi/nextwusblib.pc.in");

pub fn run(project: &Project, arguments: &Arguments) -> Result<(), Error> {
    build_into(project, &arguments.prefix, &arguments.profile)?;
    println!("installed into {}", arguments.prefix.display());
    Ok(())
}

/// Builds with the cargo profile `profile` and installs into the folder `prefix`. The libraries name no folder of this
/// machine.
pub fn build_into(project: &Project, prefix: &Path, profile: &str) -> Result<(), Error> {
    // What cargo has built elsewhere without the wrapper would count as built.
    let target = project.target.join("xtask/stage-build");
    let wrapper = target.join("rustc");
    remapped::write(project, remapped::own_rustc(), &target, &wrapper)?;
    // The packages are built one after the other: built together, the library would also get the features that only the tool
    // needs.
    for package in PACKAGES {
        let mut cargo = project.cargo();
        cargo.env("CARGO_TARGET_DIR", &target).env("RUSTC_WRAPPER", &wrapper);
        command::run(cargo.args(["build", "--profile", profile, "--package", package]))?;
    }
    install_into(project, &target.join(profile_folder(profile)), None, prefix)?;
    let folders: Vec<String> = remapped::folders(project).collect();
    [SONAME, SLEEP_LIBRARY].iter().try_for_each(|library| {
        let library = prefix.join("lib").join(library);
        split_debug(&library)?;
        check(&library, &folders)
    })
}

/// Builds with the profile and features of the tests, and installs into a folder, whose path is returned.
pub fn build_for_tests(project: &Project) -> Result<PathBuf, Error> {
    let prefix = project.target.join("xtask/stage");
    build_as_in_tests_into(project, &prefix)?;
    Ok(prefix)
}

/// Builds what `cargo xtask test` builds, too, and installs it into the folder `prefix`.
pub fn build_as_in_tests_into(project: &Project, prefix: &Path) -> Result<(), Error> {
    command::run(&mut project.cargo_as_in_tests("build", GROUP, &["--lib", "--bins"]))?;
    install_into(project, &project.target.join(profile_folder("dev")), None, prefix)?;
    [SONAME, SLEEP_LIBRARY].iter().try_for_each(|library| split_debug(&prefix.join("lib").join(library)))
}

/// Checks that a library has no debug information but refers to that beside it, and that it names none of these folders.
fn check(library: &Path, folders: &[String]) -> Result<(), Error> {
    let file = library.display();
    let sections = command::output(Command::new("objdump").args(["-h", "--"]).arg(library))?;
    let sections = String::from_utf8_lossy(&sections).into_owned();
    if sections.contains(".debug_") || !sections.contains(".gnu_debuglink") {
        return Err(Error::Package(format!("{file} has debug information, or no reference to it; stage it again")));
    }
    let name = library.file_name().unwrap_or_default().to_string_lossy();
    let debug = library.with_file_name(".debug").join(format!("{name}.debug"));
    if !debug.is_file() {
        return Err(Error::Package(format!("{} is missing; stage {file} again", debug.display())));
    }
    let bytes = fs::read(library).map_err(Error::file("read", library))?;
    let is_named = |folder: &&String| bytes.windows(folder.len()).any(|at| at == folder.as_bytes());
    match folders.iter().find(is_named) {
        Some(folder) => Err(Error::Package(format!("{file} names the folder {folder}; see xtask/src/remapped.rs"))),
        None => Ok(()),
    }
}

/// Moves the debug information of a library to the file `.debug/NAME.debug` beside it, where debuggers look for it. The
/// library then has a tenth of its size.
fn split_debug(library: &Path) -> Result<(), Error> {
    let name = library.file_name().unwrap_or_default().to_string_lossy();
    let folder = library.with_file_name(".debug");
    fs::create_dir_all(&folder).map_err(Error::file("make", &folder))?;
    let debug = folder.join(format!("{name}.debug"));
    command::run(Command::new("objcopy").args(["--only-keep-debug", "--"]).args([library, &debug]))?;
    command::run(Command::new("strip").args(["--strip-unneeded", "--"]).arg(library))?;
    let mut link = std::ffi::OsString::from("--add-gnu-debuglink=");
    link.push(&debug);
    command::run(Command::new("objcopy").arg(link).arg("--").arg(library))
}

/// Builds the tool with the profile and features of the tests; returns its path.
pub fn build_tool(project: &Project) -> Result<PathBuf, Error> {
    command::run(&mut project.cargo_as_in_tests("build", GROUP, &["--bin=ecmsk"]))?;
    Ok(project.target.join("debug/ecmsk"))
}

/// Installs the files that cargo has built in the folder `built` into the folder `prefix`. `tool`: a tool that runs on this
/// machine, which writes its manual pages and completions; `None`: the one in `built`.
pub fn install_into(project: &Project, built: &Path, tool: Option<&Path>, prefix: &Path) -> Result<(), Error> {
    let [bin, include, lib] = ["bin", "include", "lib"].map(|folder| prefix.join(folder));
    let (pkgconfig, rules) = (lib.join("pkgconfig"), lib.join("udev/rules.d"));
    for folder in [&bin, &include, &pkgconfig, &rules] {
        fs::create_dir_all(folder).map_err(Error::file("make", folder))?;
    }
    copy(&built.join("ecmsk"), &bin.join("ecmsk"))?;
    copy(&built.join(LINK_NAME), &lib.join(SONAME))?;
    copy(&built.join(ARCHIVE), &lib.join(ARCHIVE))?;
    link(SONAME, &lib.join(LINK_NAME))?;
    let sleep = lib.join(SLEEP_LIBRARY);
    if let (Some(folder), Some(name)) = (sleep.parent(), sleep.file_name()) {
        fs::create_dir_all(folder).map_err(Error::file("make", folder))?;
        copy(&built.join(name), &sleep)?;
    }
    install_headers(project, &include)?;

    // udev looks into this folder if the prefix is /usr or /usr/local.
    copy(&project.root.join("share/udev").join(UDEV_RULE), &rules.join(UDEV_RULE))?;
    for folder in MSVC_FOLDERS {
        let to = prefix.join("share/ecmsk").join(folder);
        fs::create_dir_all(&to).map_err(Error::file("make", &to))?;
        for header in headers(&project.root.join("share").join(folder))? {
            copy(&header, &to.join(header.file_name().unwrap_or_default()))?;
        }
    }

    for (folder, file) in FOR_OTHERS {
        let to = prefix.join("share/ecmsk").join(folder);
        fs::create_dir_all(&to).map_err(Error::file("make", &to))?;
        copy(&project.root.join("share").join(folder).join(file), &to.join(file))?;
    }

    let file = pkgconfig.join("nextwusblib.pc");
    fs::write(&file, pkgconfig_file()).map_err(Error::file("write", &file))?;
    share(tool.unwrap_or(&bin.join("ecmsk")), &prefix.join("share"))
}

/// Files below `share` for other programs, each with its folder: the plugin of Wireshark, the dashboard of Grafana.
const FOR_OTHERS: [(&str, &str); 2] = [("wireshark", "ecmsk.lua"), ("grafana", "ecmsk.json")];

/// The folders in `share` with headers that stand in for those of Windows: with them console programs of Visual Studio
/// compile on Linux. `Windows.h` has a folder of its own, because some file systems do not distinguish it from `windows.h`.
const MSVC_FOLDERS: [&str; 2] = ["msvc", "msvc/capital"];

/// Installs the headers into `include`.
pub fn install_headers(project: &Project, include: &Path) -> Result<(), Error> {
    fs::create_dir_all(include).map_err(Error::file("make", include))?;
    for header in headers(&project.root.join("include"))? {
        copy(&header, &include.join(header.file_name().unwrap_or_default()))?;
    }
    Ok(())
}

/// The shells, each with the path of its completion file in `share`.
const COMPLETIONS: [(&str, &str); 3] = [
    ("bash", "bash-completion/completions/ecmsk"),
    ("zsh", "zsh/site-functions/_ecmsk"),
    ("fish", "fish/vendor_completions.d/ecmsk.fish"),
];

/// Writes the tool's manual pages and completions.
fn share(tool: &Path, share: &Path) -> Result<(), Error> {
    let man = share.join("man/man1");
    command::output(Command::new(tool).args(["man", "--out"]).arg(&man))?;
    for (shell, place) in COMPLETIONS {
        let script = command::output(Command::new(tool).args(["completions", shell]))?;
        let file = share.join(place);
        if let Some(folder) = file.parent() {
            fs::create_dir_all(folder).map_err(Error::file("make", folder))?;
        }
        fs::write(&file, script).map_err(Error::file("write", &file))?;
    }
    Ok(())
}

/// The sub-folder of the target folder for a cargo profile: it has the profile's name, except for built-in profiles.
fn profile_folder(profile: &str) -> &str {
    match profile {
        "dev" | "test" => "debug",
        "bench" => "release",
        named => named,
    }
}

/// Replaces the file `to` by a copy of `from`. It is a new file, so a program that runs from the old one is not affected.
fn copy(from: &Path, to: &Path) -> Result<(), Error> {
    remove(to)?;
    fs::copy(from, to).map(drop).map_err(Error::file("copy", from))
}

fn link(target: &str, at: &Path) -> Result<(), Error> {
    remove(at)?;
    symlink(target, at).map_err(Error::file("make the link", at))
}

fn remove(path: &Path) -> Result<(), Error> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(Error::file("replace", path)(error)),
        _ => Ok(()),
    }
}

fn headers(folder: &Path) -> Result<Vec<PathBuf>, Error> {
    let entries = fs::read_dir(folder).and_then(Iterator::collect::<io::Result<Vec<_>>>);
    let mut files: Vec<PathBuf> =
        entries.map_err(Error::file("list", folder))?.iter().map(fs::DirEntry::path).collect();
    files.retain(|file| file.extension().is_some_and(|extension| extension == "h"));
    files.sort();
    Ok(files)
}

/// The pkg-config file. It finds its prefix relative to its own path, so that the installed folder can be moved.
fn pkgconfig_file() -> String {
    PKGCONFIG_TEMPLATE.replace("@VERSION@", env!("CARGO_PKG_VERSION")).replace("@PRIVATE_LIBS@", PRIVATE_LIBS)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pkgconfig_file_has_no_path_of_the_build() {
        let file = pkgconfig_file();
        assert!(file.starts_with("prefix=${pcfiledir}/../..\n"), "{file}");
        assert!(file.contains("\nLibs: -L${libdir} -lNEXTWUSBLib\n"), "{file}");
        assert!(!file.contains('@') && !file.contains(env!("CARGO_MANIFEST_DIR")), "{file}");
    }

    /// After splitting, the library has no debug information and no path of its build; it refers to the debug file
    /// (.gnu_debuglink), which has the debug information. The check of a staged library refuses others.
    #[test]
    fn what_a_debugger_wants_is_a_file_of_its_own() {
        let folder = tempfile::tempdir().unwrap();
        let [source, library] = ["x.c", "libx.so.0"].map(|name| folder.path().join(name));
        let path = folder.path().to_string_lossy().into_owned();
        let compile = |text: &str| {
            fs::write(&source, text).unwrap();
            command::run(Command::new("gcc").args(["-g", "-shared", "-fPIC", "-o"]).args([&library, &source])).unwrap();
        };
        compile("const char *of_the_library(void) { return __FILE__; }\n");
        check(&library, &[]).unwrap_err();
        split_debug(&library).unwrap();
        check(&library, &[]).unwrap();
        check(&library, std::slice::from_ref(&path)).unwrap_err();
        compile("int of_the_library(int x) { return x + 1; }\n");
        split_debug(&library).unwrap();
        check(&library, &[path]).unwrap();
        let sections = |file: &Path| {
            let said = command::output(Command::new("objdump").arg("-h").arg(file)).unwrap();
            String::from_utf8_lossy(&said).into_owned()
        };
        let kept = sections(&library);
        assert!(!kept.contains(".debug_info") && kept.contains(".gnu_debuglink") && kept.contains(".dynsym"), "{kept}");
        let debug = folder.path().join(".debug/libx.so.0.debug");
        assert!(sections(&debug).contains(".debug_info"));
        fs::remove_file(debug).unwrap();
        check(&library, &[]).unwrap_err();
    }

    #[test]
    fn a_copy_replaces_a_file_and_a_link() {
        let folder = tempfile::tempdir().unwrap();
        let [from, to, behind] = ["from", "to", "behind"].map(|name| folder.path().join(name));
        fs::write(&from, "new").unwrap();
        fs::write(&behind, "kept").unwrap();
        symlink(&behind, &to).unwrap();
        copy(&from, &to).unwrap();
        assert_eq!(fs::read_to_string(&to).unwrap(), "new");
        assert_eq!(fs::read_to_string(&behind).unwrap(), "kept");
    }
}
