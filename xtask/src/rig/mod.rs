//! `cargo xtask test --rig`: the wire tests in a small guest, where a real kernel's USB, HID, SPI and GPIO code stands
//! between the two ends.
//!
//! The guest is Debian's kernel, an archive in memory with its modules and the one of `tests/rig/board`, Debian's
//! `usbip`, the tool and the test program, and nothing else; QEMU boots it without privileges and without KVM. All that
//! is fetched stays in `target/xtask/rig/`.

mod board;
mod files;
mod guest;
mod initrd;
mod kernel;
mod modules;
mod packages;
mod programs;
mod qemu;

use crate::error::Error;
use crate::needs::{CXX, GCC, MAKE, Need, PKG_CONFIG, QEMU, STRIP, XZ};
use crate::project::Project;

/// What the rig needs beside cargo.
pub const NEEDS: &[Need] = &[QEMU, XZ, STRIP, CXX, GCC, MAKE, PKG_CONFIG];

/// Runs the wire tests in the guest: those whose names contain one of `names`, or all.
pub fn run(project: &Project, names: &[String]) -> Result<(), Error> {
    let folder = project.target.join("xtask/rig");
    let packages = packages::fetch(&folder)?;
    let kernel = kernel::unpack(&packages, &folder)?;
    let board = board::build(project, &packages, &folder)?;
    let programs = programs::build(project, &folder)?;
    let initrd = guest::pack(&packages, &board, &programs, &folder)?;
    qemu::boot(&kernel, &initrd, names, &folder)
}
