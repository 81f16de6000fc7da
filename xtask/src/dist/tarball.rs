//! The package for any Linux whose C library is not older than the one it was built with: the files that `cargo xtask stage`
//! installs, and documentation.

use std::fs;
use std::path::Path;

use super::machine::Machine;
use super::release::Release;
use super::tree::{DATA, PROGRAM, Tree, files};
use super::windows_zip::OTHERS;
use crate::error::Error;
use crate::project::Project;

const DOCUMENTS: [&str; 3] = ["CHANGELOG.md", "LICENSE-MIT", "LICENSE-APACHE"];

/// Copies the files of the `.tar.gz` package from a stage folder into the tree. `others` is the text with the licences of
/// crates and libraries of other projects.
pub fn fill(
    project: &Project,
    release: &Release,
    machine: Machine,
    tree: &Tree,
    stage: &Path,
    others: &str,
) -> Result<(), Error> {
    for file in files(stage)? {
        let (from, to) = (stage.join(&file), file.to_string_lossy());
        if from.is_symlink() {
            let target = fs::read_link(&from).map_err(Error::file("read", &from))?;
            tree.link(&to, &target.to_string_lossy())?;
        } else {
            tree.copy(&from, &to, if file.starts_with("bin") { PROGRAM } else { DATA })?;
        }
    }
    for name in DOCUMENTS {
        tree.copy(&project.root.join(name), name, DATA)?;
    }
    let file = project.root.join("share/linux/README.txt");
    let text = fs::read_to_string(&file).map_err(Error::file("read", &file))?;
    tree.write("README.txt", text.replace("@VERSION@", release.version).replace("@PROCESSOR@", machine.processor()))?;
    tree.write(OTHERS, others)
}
