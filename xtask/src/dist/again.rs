//! Makes the release packages a second time, from a copy of the sources in another folder, and checks that they are the
//! same (reproducible builds).

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use super::release::Release;
use super::{Made, make};
use crate::command;
use crate::error::Error;
use crate::project::Project;
use crate::system::path_of;

/// Makes the packages again, and compares them byte by byte.
pub fn compare(project: &Project, release: &Release, first: &Made) -> Result<(), Error> {
    let place = place(&project.target);
    println!(
        "making everything once more in {}: all is compiled anew, which takes 3 GB and, on two free cores, ten minutes",
        place.display()
    );
    if place.exists() {
        fs::remove_dir_all(&place).map_err(Error::file("remove", &place))?;
    }
    // The copy's paths differ from those of the first build in content, length and alphabetical order, so that a dependence on
    // any of them shows.
    let copy =
        Project { root: place.join("sources of ecmsk"), target: place.join("built"), for_tests: false, quick: false };
    copy_sources(&project.root, &copy.root)?;
    let second = make(&copy, release, &place.join("packages"))?;
    let differing = differing(first, &second)?;
    if differing.is_empty() {
        println!("{} files are the same, byte for byte", first.names.len());
        return fs::remove_dir_all(&place).map_err(Error::file("remove", &place));
    }
    Err(Error::Package(format!(
        "made twice, these differ: {}; compare {} and {} (diffoscope shows where)",
        differing.join(", "),
        first.folder.display(),
        second.folder.display()
    )))
}

/// A folder that comes before `/usr` in the alphabet if `target` comes after it, and the other way round. Linkers sort
/// inputs by path, so a file that depends on this order would differ in the second build.
fn place(target: &Path) -> PathBuf {
    let other = if target < Path::new("/usr") { "/var/tmp" } else { "/tmp" };
    Path::new(other).join("ecmsk-once-more")
}

/// Copies the source files: those that git tracks, and new ones that it does not ignore.
fn copy_sources(from: &Path, to: &Path) -> Result<(), Error> {
    let mut git = Command::new("git");
    git.current_dir(from).args(["ls-files", "-z", "--cached", "--others", "--exclude-standard"]);
    let listed = command::output(&mut git)?;
    let names = listed.split(|byte| *byte == 0).filter(|name| !name.is_empty());
    // git also lists a file that was deleted since the last commit.
    for name in names.map(path_of).filter(|name| from.join(name).exists()) {
        let file = to.join(&name);
        let folder = file.parent().unwrap_or(to);
        fs::create_dir_all(folder).map_err(Error::file("make", folder))?;
        fs::copy(from.join(&name), &file).map_err(Error::file("copy", &file))?;
    }
    Ok(())
}

/// The names of files that exist in only one of the two builds, or whose contents differ.
fn differing(first: &Made, second: &Made) -> Result<Vec<String>, Error> {
    let mut names: Vec<&String> = first.names.iter().chain(&second.names).collect();
    names.sort();
    names.dedup();
    let read = |made: &Made, name: &str| match made.names.iter().any(|known| known == name) {
        true => fs::read(made.folder.join(name)).map(Some).map_err(Error::file("read", &made.folder.join(name))),
        false => Ok(None),
    };
    let mut differing = Vec::new();
    for name in names {
        if read(first, name)? != read(second, name)? {
            differing.push(name.clone());
        }
    }
    Ok(differing)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The comparison reports a file that differs in a byte, and one that is missing on either side.
    #[test]
    fn what_differs_is_told() {
        let folders = [(); 2].map(|()| tempfile::tempdir().unwrap());
        let made = |at: usize, files: &[(&str, &str)]| {
            for (name, text) in files {
                fs::write(folders[at].path().join(name), text).unwrap();
            }
            let names = files.iter().map(|(name, _)| (*name).to_owned()).collect();
            Made {
                folder: folders[at].path().to_owned(),
                names,
                zip: PathBuf::new(),
                installers: Vec::new(),
                on_windows: Vec::new(),
                linux: Vec::new(),
            }
        };
        let first = made(0, &[("a", "same"), ("b", "one"), ("c", "")]);
        let second = made(1, &[("a", "same"), ("b", "other")]);
        assert_eq!(differing(&first, &second).unwrap(), ["b", "c"]);
        assert_eq!(differing(&first, &first).unwrap(), [""; 0]);
    }
}
