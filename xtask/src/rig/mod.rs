//! `cargo xtask test --rig`: runs the wire tests in a small guest system, in which the USB, HID, SPI and GPIO code of a real
//! kernel is between the board's model and the program. `cargo xtask bench --rig` measures these wires.
//!
//! The guest consists of Debian's kernel and an archive in memory: kernel modules, the one of `tests/rig/board` among them,
//! Debian's `usbip`, the tool and the test program. QEMU boots it without privileges and without KVM. Everything that is
//! fetched stays in `target/xtask/rig/`.
//!
//! Files:
//!
//! - `packages.rs`, `kernel.rs`, `modules.rs`, `board.rs`: Debian's packages, the kernel, its modules, and the module that
//!   behaves as a board on SPI
//! - `programs.rs`: the programs that run in the guest
//! - `initrd.rs`, `guest.rs`: the archive format of the guest's root, and the content of that root
//! - `qemu.rs`, `files.rs`: boots the guest, and receives the files that it prints

mod board;
mod files;
mod guest;
pub mod initrd;
pub mod kernel;
pub mod modules;
pub mod packages;
pub mod programs;
pub mod qemu;

use std::path::PathBuf;

use crate::error::Error;
use crate::needs::{CXX, GCC, MAKE, Need, PKG_CONFIG, QEMU, STRIP, XZ};
use crate::project::Project;

use packages::Packages;
use programs::Programs;
use qemu::Machine;

/// The command that the guest runs for the wire tests, and (next constant) for the bench of the wires.
const TESTS: &str = "/rig/tests --test-threads=1";
const BENCH: &str = "/rig/bench";

/// Test filters that split the wire tests into two halves of about equal time. Each half runs in a guest of its own at the same
/// time, because a guest has one processor.
const HALF: [&[&str]; 2] =
    [&["gadget::", "unchanged::", "usb::"], &["--skip=gadget::", "--skip=unchanged::", "--skip=usb::"]];

/// The programs that the wire tests need besides cargo.
pub const NEEDS: &[Need] = &[QEMU, XZ, STRIP, CXX, GCC, MAKE, PKG_CONFIG];

/// Runs the wire tests in the guest: those whose names contain one of `names`, or all.
pub fn run(project: &Project, names: &[String]) -> Result<(), Error> {
    let folder = project.target.join("xtask/rig");
    let packages = packages::fetch(&folder)?;
    let programs = programs::tests(project, &packages, &folder)?;
    let booted = Booted::prepare(project, &packages, &programs, TESTS)?;
    let said =
        if names.is_empty() { booted.run_two(HALF)? } else { booted.run("console.log", names, qemu::is_result)? };
    if said.iter().any(|line| line == "running 0 tests") {
        return Err(Error::NoTest { names: names.join(" ") });
    }
    files::keep(&said, &folder.join("files"))
}

/// Runs the bench of the wires in the guest; returns the lines that it prints.
pub fn bench(project: &Project) -> Result<Vec<String>, Error> {
    let packages = packages::fetch(&project.target.join("xtask/rig"))?;
    let programs = programs::bench(project)?;
    let booted = Booted::prepare(project, &packages, &programs, BENCH)?;
    booted.run("console.log", &[], |line| line.starts_with("GUEST-BEGIN"))
}

/// The files from which a guest is booted.
struct Booted {
    kernel: PathBuf,
    initrd: PathBuf,
    folder: PathBuf,
}

impl Booted {
    fn prepare(project: &Project, packages: &Packages, programs: &Programs, command: &str) -> Result<Self, Error> {
        let folder = project.target.join("xtask/rig");
        let kernel = kernel::unpack(packages, &folder)?;
        let board = board::build(project, packages, &folder)?;
        let initrd = guest::pack(packages, &board, command, programs, &folder)?;
        Ok(Self { kernel, initrd, folder })
    }

    /// Runs a guest; `words` are further arguments of the command that it runs. Returns its output, which also goes to the
    /// file `log`.
    fn run(&self, log: &str, words: &[String], is_shown: fn(&str) -> bool) -> Result<Vec<String>, Error> {
        qemu::boot(&self.machine(), words, &self.folder.join(log), is_shown)
    }

    /// Runs two guests at the same time, each with one set of further arguments for the command that it runs; returns the
    /// output of both.
    fn run_two(&self, words: [&[&str]; 2]) -> Result<Vec<String>, Error> {
        qemu::boot_two(&self.machine(), words, &self.folder, qemu::is_result)
    }

    fn machine(&self) -> Machine<'_> {
        Machine { kernel: &self.kernel, initrd: &self.initrd, memory_mb: 512, folders: &[] }
    }
}
