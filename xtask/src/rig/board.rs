//! Builds the kernel module in `tests/rig/board`, which behaves as a board on SPI, for the guest's kernel.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use super::packages::{self, Packages};
use crate::command;
use crate::error::Error;
use crate::project::Project;

/// The source of the kernel module that behaves as a board on SPI, and the file that the kernel's build system reads.
const SOURCES: [&str; 2] = ["ecm_board.c", "Kbuild"];
const MODULE: &str = "ecm_board.ko";

/// Builds the kernel module; returns its path.
pub fn build(project: &Project, packages: &Packages, folder: &Path) -> Result<PathBuf, Error> {
    // The kernel's build system writes its results into the folder of the source, so the source is copied.
    let built = folder.join("board");
    packages::empty(&built)?;
    for source in SOURCES {
        let from = project.root.join("tests/rig/board").join(source);
        fs::copy(&from, built.join(source)).map_err(Error::file("copy", &from))?;
    }
    let mut make = Command::new("make");
    // The Makefile of the headers package includes that of the common headers by its installed path. That path does not
    // exist on this machine, so the Makefile of the common headers is given to make by its path in the unpacked package.
    make.arg("-C").arg(packages.headers()).arg("-f").arg(packages.common_headers().join("Makefile"));
    make.arg(format!("M={}", built.display()));
    // BTF type information is switched off, because making it needs the kernel's uncompressed image, which is in no package.
    make.args(["CONFIG_DEBUG_INFO_BTF_MODULES=", "KCFLAGS=-Werror", "--quiet", "modules"]);
    make.env("LD_LIBRARY_PATH", packages.root.join("usr/lib/x86_64-linux-gnu"));
    command::run(&mut make)?;
    Ok(built.join(MODULE))
}
