//! The kernel module that is a board on SPI, `tests/rig/board`: built for the guest's kernel, loaded there alone.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use super::packages::{self, Packages};
use crate::command;
use crate::error::Error;
use crate::project::Project;

/// Its source and what the kernel's own Makefile wants to know of it.
const SOURCES: [&str; 2] = ["ecm_board.c", "Kbuild"];
const MODULE: &str = "ecm_board.ko";

/// Builds it.
pub fn build(project: &Project, packages: &Packages, folder: &Path) -> Result<PathBuf, Error> {
    // It is built where its source lies.
    let built = folder.join("board");
    packages::empty(&built)?;
    for source in SOURCES {
        let from = project.root.join("tests/rig/board").join(source);
        fs::copy(&from, built.join(source)).map_err(Error::file("copy", &from))?;
    }
    let mut make = Command::new("make");
    // The headers' own Makefile looks for the other half where it would be installed.
    make.arg("-C").arg(packages.headers()).arg("-f").arg(packages.common_headers().join("Makefile"));
    make.arg(format!("M={}", built.display()));
    // Types for tracing are made of a kernel that is not in the packages.
    make.args(["CONFIG_DEBUG_INFO_BTF_MODULES=", "KCFLAGS=-Werror", "--quiet", "modules"]);
    make.env("LD_LIBRARY_PATH", packages.root.join("usr/lib/x86_64-linux-gnu"));
    command::run(&mut make)?;
    Ok(built.join(MODULE))
}
