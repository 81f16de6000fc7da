//! The package as it is in the tree, with the module of the tests' build in it.

use std::fs;
use std::os::unix::fs::symlink;
use std::path::PathBuf;
use std::process::Command;
use std::sync::OnceLock;

use support::{out_dir, python_module, root, run};

/// A folder from which Python imports the package.
pub fn folder() -> &'static PathBuf {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        let folder = out_dir().join("package");
        let package = folder.join("ecmsk");
        // Links of an earlier run may name files that are gone.
        let _ = fs::remove_dir_all(&folder);
        fs::create_dir_all(&package).expect("a folder in the target folder");
        for entry in fs::read_dir(root().join("python/ecmsk")).expect("the package") {
            let file = entry.expect("readable").path();
            symlink(&file, package.join(file.file_name().expect("a name"))).expect("a symbolic link");
        }
        symlink(python_module(), package.join("_ecmsk.abi3.so")).expect("a symbolic link");
        folder
    })
}

/// Python with the package, at the root of the project.
pub fn python() -> Command {
    let mut python = Command::new("python3");
    python.current_dir(root()).env("PYTHONPATH", folder()).env("PYTHONDONTWRITEBYTECODE", "1");
    python.env_remove("ECMSK_LINK").env_remove("ECMSK_LOG");
    python
}

/// Runs a program that has to end well.
pub fn succeed(command: &mut Command) -> String {
    run(command).success()
}
