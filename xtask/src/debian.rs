//! Makes a Debian system in a folder, by debootstrap: for programs that the host system cannot run, and for testing
//! installations in a fresh system.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::command;
use crate::error::Error;

/// The Debian release. The tests were written with its version of Wine, and the Debian packages of this project are made
/// for it.
const RELEASE: &str = "bookworm";
/// The file in the system's root that lists its packages. If the list differs, the system is made anew.
const MADE_OF: &str = "made-of";

/// What a Debian system consists of: the minimal system, further packages, and changes.
pub struct System {
    /// The name of the system's folder below the folder for all systems.
    pub name: &'static str,
    /// Its purpose, and the download, disk space and time that it takes, for the user.
    pub why: &'static str,
    /// A second architecture (`i386`) from which packages are installed too.
    pub also: Option<&'static str>,
    pub packages: &'static [&'static str],
    /// The files that are not installed, as patterns of paths.
    pub left_out: &'static [&'static str],
    /// Changes the files of a new system, before the system counts as complete. Gets the root of the system.
    pub finish: fn(&Path) -> Result<(), Error>,
}

/// Makes a system below `folder` if there is none; returns its root.
pub fn set_up(folder: &Path, system: &System) -> Result<PathBuf, Error> {
    let root = folder.join(system.name);
    let made_of = format!("{RELEASE}: {} without {}\n", system.packages.join(" "), system.left_out.join(" "));
    if fs::read_to_string(root.join(MADE_OF)).is_ok_and(|text| text == made_of) {
        return Ok(root);
    }
    let mirror = mirror()?;
    println!("{}: from {mirror} into {}; it stays there for the next time", system.why, root.display());
    let new = folder.join(format!("{}.new", system.name));
    for old in [&root, &new] {
        if old.exists() {
            fs::remove_dir_all(old).map_err(Error::file("remove", old))?;
        }
    }
    fs::create_dir_all(folder).map_err(Error::file("make", folder))?;
    let mut debootstrap = Command::new("debootstrap");
    debootstrap.args(["--variant=minbase", RELEASE]).arg(&new).arg(&mirror);
    command::output(&mut debootstrap)?;
    write(&new.join("etc/apt/apt.conf.d/90ecmsk"), "APT::Install-Recommends \"0\";\n")?;
    let left_out: String = system.left_out.iter().map(|files| format!("path-exclude={files}\n")).collect();
    write(&new.join("etc/dpkg/dpkg.cfg.d/90ecmsk"), &left_out)?;
    // The list of left-out files in dpkg.cfg.d applies only from now on. debootstrap has already unpacked such files, so
    // they are removed.
    let remove = format!("rm -rf {}", system.left_out.join(" "));
    command::output(&mut inside(&new, &["sh", "-c", &remove]))?;
    if let Some(architecture) = system.also {
        command::output(&mut inside(&new, &["dpkg", "--add-architecture", architecture]))?;
    }
    command::output(&mut inside(&new, &["apt-get", "-qq", "update"]))?;
    command::output(&mut inside(&new, &[&["apt-get", "-qq", "-y", "install"], system.packages].concat()))?;
    command::output(&mut inside(&new, &["apt-get", "clean"]))?;
    // Nothing else is fetched, so the package lists of apt are not needed any more.
    let lists = new.join("var/lib/apt/lists");
    fs::remove_dir_all(&lists).map_err(Error::file("remove", &lists))?;
    (system.finish)(&new)?;
    write(&new.join(MADE_OF), &made_of)?;
    // The folder gets its final name last, so that a folder of that name is complete.
    fs::rename(&new, &root).map_err(Error::file("rename", &new))?;
    Ok(root)
}

fn write(path: &Path, text: &str) -> Result<(), Error> {
    fs::write(path, text).map_err(Error::file("write", path))
}

/// The command `words`, which runs in the Debian system at `root` (chroot), with /proc mounted while it runs.
pub fn inside(root: &Path, words: &[&str]) -> Command {
    let mut unshare = Command::new("unshare");
    unshare.env("DEBIAN_FRONTEND", "noninteractive").env("PATH", "/usr/sbin:/usr/bin:/sbin:/bin");
    unshare.args(["--mount", "sh", "-c", r#"mount -t proc proc "$0/proc" && exec chroot "$0" "$@""#]);
    unshare.arg(root).args(words);
    unshare
}

/// The mirror that this machine gets its packages from.
fn mirror() -> Result<String, Error> {
    let lists = Path::new("/etc/apt/sources.list.d");
    let mut files = vec![PathBuf::from("/etc/apt/sources.list")];
    files.extend(fs::read_dir(lists).into_iter().flatten().flatten().map(|entry| entry.path()));
    let texts = files.iter().filter_map(|file| fs::read_to_string(file).ok());
    texts
        .into_iter()
        .find_map(|text| mirror_in(&text))
        .ok_or(Error::Rig("no mirror of Debian 12 in /etc/apt/sources.list or sources.list.d; run it on Debian 12"))
}

/// The URL of the first apt source that has the packages of the release itself (not its updates), in either format of an
/// apt source file.
fn mirror_in(text: &str) -> Option<String> {
    let in_a_line = text.lines().filter(|line| line.starts_with("deb ")).find_map(|line| {
        let words: Vec<&str> = line.split_whitespace().filter(|word| !word.starts_with('[')).collect();
        let options = words.iter().position(|word| word.contains("://"))?;
        (words.get(options + 1) == Some(&RELEASE)).then(|| words[options].to_owned())
    });
    let in_a_paragraph = text.split("\n\n").find_map(|paragraph| {
        let field = |name: &str| paragraph.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(':'));
        let suites = field("Suites")?;
        suites.split_whitespace().any(|suite| suite == RELEASE).then_some(())?;
        Some(field("URIs")?.split_whitespace().next()?.to_owned())
    });
    in_a_line.or(in_a_paragraph)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mirror_is_that_of_the_release_itself() {
        let lines = "# deb http://a/debian bookworm main\ndeb [signed-by=/k] http://b/updates bookworm-updates main\n\
                     deb [arch=amd64 signed-by=/k] http://c/debian bookworm main\n";
        assert_eq!(mirror_in(lines).as_deref(), Some("http://c/debian"));
        let paragraphs = "Types: deb\nURIs: http://s/security\nSuites: bookworm-security\n\n\
                          Types: deb\n# old\nURIs: http://d/debian http://e\nSuites: bookworm bookworm-updates\n";
        assert_eq!(mirror_in(paragraphs).as_deref(), Some("http://d/debian"));
        assert_eq!(mirror_in("deb https://x/y nodistro main\n"), None);
    }
}
