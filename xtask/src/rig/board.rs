//! Builds the kernel module that is a board on SPI, `tests/rig/board`, for the guest's kernel.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use super::packages::{self, Packages};
use crate::command;
use crate::error::Error;
use crate::project::Project;

/// The source, and the file that the kernel's Makefile reads.
const SOURCES: [&str; 2] = ["ecm_board.c", "Kbuild"];
const MODULE: &str = "ecm_board.ko";

/// Builds the module; returns its path.
pub fn build(project: &Project, packages: &Packages, folder: &Path) -> Result<PathBuf, Error> {
    // The kernel's Makefile builds a module in the folder of its source.
    let built = folder.join("board");
    packages::empty(&built)?;
    for source in SOURCES {
        let from = project.root.join("tests/rig/board").join(source);
        fs::copy(&from, built.join(source)).map_err(Error::file("copy", &from))?;
    }
    let mut make = Command::new("make");
    // The Makefile of the headers expects the common headers at their installed place.
    make.arg("-C").arg(packages.headers()).arg("-f").arg(packages.common_headers().join("Makefile"));
    make.arg(format!("M={}", built.display()));
    // Type information for tracing needs a kernel that is not in the packages.
    make.args(["CONFIG_DEBUG_INFO_BTF_MODULES=", "KCFLAGS=-Werror", "--quiet", "modules"]);
    make.env("LD_LIBRARY_PATH", packages.root.join("usr/lib/x86_64-linux-gnu"));
    command::run(&mut make)?;
    Ok(built.join(MODULE))
}
