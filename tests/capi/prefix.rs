//! The library, the headers, the pkg-config file and the tool of this build in the folders in which `cargo xtask stage`
//! installs them; a shell that finds them there, and commands of pages in it.
#![cfg(target_os = "linux")]

use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use support::{console, library, out_dir, root};

/// The folder that has `bin/`, `lib/` and `include/`.
pub fn prefix() -> &'static PathBuf {
    static PREFIX: OnceLock<PathBuf> = OnceLock::new();
    PREFIX.get_or_init(|| {
        let moved = out_dir().join("prefix to be moved");
        let prefix = out_dir().join("prefix");
        [&moved, &prefix].map(fs::remove_dir_all).into_iter().for_each(drop);
        let (bin, pkgconfig) = (moved.join("bin"), moved.join("lib/pkgconfig"));
        for folder in [&bin, &pkgconfig] {
            fs::create_dir_all(folder).expect("a folder in the target folder");
        }
        for name in ["libNEXTWUSBLib.so", "libNEXTWUSBLib.so.0"] {
            symlink(library().dir.join(name), moved.join("lib").join(name)).expect("a symbolic link");
        }
        symlink(support::tool(), bin.join("ecmsk")).expect("a symbolic link");
        symlink(support::include_dir(), moved.join("include")).expect("a symbolic link");
        let template = fs::read_to_string(root().join("capi/nextwusblib.pc.in")).expect("capi/nextwusblib.pc.in");
        let file = template.replace("@VERSION@", env!("CARGO_PKG_VERSION")).replace("@PRIVATE_LIBS@", "");
        fs::write(pkgconfig.join("nextwusblib.pc"), file).expect("a file in the target folder");
        // The installed folder may be moved: no file in it has its path.
        fs::rename(&moved, &prefix).expect("a folder can be moved");
        prefix
    })
}

/// A shell in that folder, with the tool and the library as they are installed.
pub fn shell(program: &str, folder: &Path) -> Command {
    let path = std::env::var("PATH").expect("it is set");
    let mut shell = Command::new(program);
    shell.current_dir(folder).env("PATH", format!("{}:{path}", prefix().join("bin").display()));
    shell.env("PKG_CONFIG_PATH", prefix().join("lib/pkgconfig")).env("HOME", folder).env("XDG_CONFIG_HOME", folder);
    for variable in ["ECMSK_LINK", "ECMSK_LOG", "LD_LIBRARY_PATH"] {
        shell.env_remove(variable);
    }
    shell
}

/// Runs the commands of a page's `console` blocks in that folder. Each prints what the page shows. Returns how many there are.
#[track_caller]
pub fn shows(page: &str, folder: &Path) -> usize {
    let shown = console::commands(page);
    let said = console::run(&mut shell("bash", folder), shown.iter().map(|shown| &shown.command));
    for (shown, said) in shown.iter().zip(said) {
        assert_eq!(said, shown.output, "$ {}", shown.command);
    }
    shown.len()
}
