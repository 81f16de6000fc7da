//! The machines for which Linux packages are made: PCs, and small computers such as the Raspberry Pi.

use std::path::Path;
use std::process::Command;

use crate::debian_rust;
use crate::project::Project;

/// A kind of machine, as Debian names its architectures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Machine {
    Amd64,
    Arm64,
    Armhf,
}

impl Machine {
    pub const ALL: [Self; 3] = [Self::Amd64, Self::Arm64, Self::Armhf];
    /// The machines for which `cargo xtask test --all` makes packages. It leaves out the others, whose packages take as
    /// long again.
    pub const QUICK: [Self; 1] = [Self::Amd64];

    /// The machines for which packages are made: only [`Self::QUICK`] in a quick build for tests, otherwise all.
    pub const fn made(project: &Project) -> &'static [Self] {
        if project.quick { &Self::QUICK } else { &Self::ALL }
    }

    /// Debian's name of the architecture.
    pub const fn debian(self) -> &'static str {
        match self {
            Self::Amd64 => "amd64",
            Self::Arm64 => "arm64",
            Self::Armhf => "armhf",
        }
    }

    /// The name of the processor in file names, as `uname -m` prints it.
    pub const fn processor(self) -> &'static str {
        match self {
            Self::Amd64 => "x86_64",
            Self::Arm64 => "aarch64",
            Self::Armhf => "armv7l",
        }
    }

    /// The runtime identifier of .NET, for machines whose library is in the NuGet packages.
    pub const fn rid(self) -> Option<&'static str> {
        match self {
            Self::Amd64 => Some("linux-x64"),
            Self::Arm64 => Some("linux-arm64"),
            Self::Armhf => None,
        }
    }

    /// The tag of Python's wheels for the machine: any Linux with at least this version of the C library, as auditwheel
    /// finds it.
    pub const fn wheel(self) -> &'static str {
        match self {
            Self::Amd64 => "manylinux_2_34_x86_64",
            Self::Arm64 => "manylinux_2_34_aarch64",
            Self::Armhf => "manylinux_2_34_armv7l",
        }
    }

    /// rustc's target triple.
    pub const fn target(self) -> &'static str {
        match self {
            Self::Amd64 => "x86_64-unknown-linux-gnu",
            Self::Arm64 => "aarch64-unknown-linux-gnu",
            Self::Armhf => "armv7-unknown-linux-gnueabihf",
        }
    }

    /// The prefix of GNU's programs for the machine, which is also the sub-folder of `/usr/lib` for its libraries.
    pub const fn gnu(self) -> &'static str {
        match self {
            Self::Amd64 => "x86_64-linux-gnu",
            Self::Arm64 => "aarch64-linux-gnu",
            Self::Armhf => "arm-linux-gnueabihf",
        }
    }

    /// The emulator that runs programs for the machine; `None`: this machine runs them itself.
    pub const fn emulator(self) -> Option<&'static str> {
        match self {
            Self::Amd64 => None,
            Self::Arm64 => Some("qemu-aarch64-static"),
            Self::Armhf => Some("qemu-arm-static"),
        }
    }

    /// The rustc whose standard library the programs for the machine contain: for foreign machines Debian's, because the
    /// project's toolchain has no standard library for them.
    pub const fn rustc(self) -> &'static str {
        match self {
            Self::Amd64 => "rustc",
            Self::Arm64 | Self::Armhf => debian_rust::RUSTC,
        }
    }

    /// Whether the programs are for another machine than this one.
    pub const fn is_foreign(self) -> bool {
        self.emulator().is_some()
    }

    /// A program of GNU's for the machine, such as `strip`.
    pub fn gnu_program(self, name: &str) -> Command {
        Command::new(if self.is_foreign() { format!("{}-{name}", self.gnu()) } else { name.to_owned() })
    }

    /// cargo for the machine, which builds in the folder `target`, without its subcommand and arguments.
    pub fn cargo(self, project: &Project, target: &Path) -> Command {
        let mut cargo = if self.is_foreign() {
            debian_rust::cargo(project, target, self.target(), self.gnu())
        } else {
            project.cargo()
        };
        cargo.env("CARGO_TARGET_DIR", target);
        let linker = format!("CARGO_TARGET_{}_LINKER", self.target().replace('-', "_").to_uppercase());
        if self.is_foreign() {
            cargo.env(linker, format!("{}-gcc", self.gnu()));
        }
        cargo
    }
}
