//! A wrapper between cargo and rustc that replaces the paths of this machine's folders in the built files by fixed names.
//! Flags of cargo with the same effect would change the names of a static library's members.

use std::env;
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::command;
use crate::error::Error;
use crate::project::{Project, cargo_home};
use crate::system::set_mode;

/// Writes the wrapper to the file `wrapper`, for builds by the compiler `rustc` in the folder `target`.
pub fn write(project: &Project, rustc: OsString, target: &Path, wrapper: &Path) -> Result<(), Error> {
    if let Some(folder) = wrapper.parent() {
        fs::create_dir_all(folder).map_err(Error::file("make", folder))?;
    }
    fs::write(wrapper, text(&names(project, rustc, target)?)).map_err(Error::file("write", wrapper))?;
    set_mode(wrapper, 0o755).map_err(Error::file("make executable", wrapper))
}

/// The compiler that cargo starts on this machine.
pub fn own_rustc() -> OsString {
    env::var_os("RUSTC").unwrap_or_else(|| "rustc".into())
}

/// The folders of this machine that built files must not name: the project's, its target folder, and cargo's home. Short
/// paths such as `/` or `/src` are left out, because they are the beginning of many other paths.
pub fn folders(project: &Project) -> impl Iterator<Item = String> {
    let all = [Some(project.root.clone()), Some(project.target.clone()), cargo_home()];
    all.into_iter().flatten().map(|path| path.display().to_string()).filter(|path| path.len() > 6)
}

/// The folders whose paths are replaced in the built files, and their replacements. If several match a path the last one
/// applies.
fn names(project: &Project, rustc: OsString, target: &Path) -> Result<Vec<(PathBuf, String)>, Error> {
    let ask = |arguments: &[&str]| -> Result<String, Error> {
        let said = command::output(Command::new(&rustc).current_dir(&project.root).args(arguments))?;
        Ok(String::from_utf8_lossy(&said).trim().to_owned())
    };
    // rustc writes paths to the sources of the standard library: their path on this machine if they are installed,
    // otherwise `/rustc/COMMIT`. The first is replaced by the second.
    let sources = Path::new(&ask(&["--print", "sysroot"])?).join("lib/rustlib/src/rust");
    let version = ask(&["-vV"])?;
    let commit = version.lines().find_map(|line| line.strip_prefix("commit-hash: ")).unwrap_or("unknown");
    let mut names = vec![(sources, format!("/rustc/{commit}"))];
    names.extend(cargo_home().map(|home| (home, "cargo".to_owned())));
    names.push((project.root.clone(), "ecmsk".to_owned()));
    names.push((target.to_owned(), "target".to_owned()));
    Ok(names)
}

fn text(names: &[(PathBuf, String)]) -> String {
    let options = names.iter().map(|(folder, name)| {
        let quoted = folder.to_string_lossy().replace('\'', r"'\''");
        format!(" \\\n  --remap-path-prefix='{quoted}'={name}")
    });
    format!("#!/bin/sh\nexec \"$@\"{}\n", options.collect::<String>())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_stands_before_rustc_can_be_read_by_a_shell() {
        let folder = tempfile::tempdir().unwrap();
        let script = folder.path().join("rustc");
        let names = [(PathBuf::from("/a folder/of $HOME's"), "ecmsk".to_owned()), ("/b".into(), "target".to_owned())];
        fs::write(&script, text(&names)).unwrap();
        let said = command::output(Command::new("sh").arg(&script).args(["printf", "%s\n", "-v"])).unwrap();
        let said = str::from_utf8(&said).unwrap();
        assert_eq!(said, "-v\n--remap-path-prefix=/a folder/of $HOME's=ecmsk\n--remap-path-prefix=/b=target\n");
    }
}
