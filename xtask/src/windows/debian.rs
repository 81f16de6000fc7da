//! A Debian of its own in a folder, with both Wines in it.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::command;
use crate::error::Error;

/// The release; its Wine is the one that the tests were written with.
const RELEASE: &str = "bookworm";
/// File in the root that says what it was made of.
const MADE_OF: &str = "made-of";
/// The last two are for USB in the guest: Wine looks for devices by libudev, of either width.
const PACKAGES: &[&str] = &["wine", "wine64", "wine32:i386", "udev", "libudev1:i386"];
/// What nobody reads there.
const LEFT_OUT: &str =
    "path-exclude=/usr/share/doc/*\npath-exclude=/usr/share/man/*\npath-exclude=/usr/share/locale/*\n";

/// The root; made if it is not there.
pub fn set_up(folder: &Path) -> Result<PathBuf, Error> {
    let root = folder.join("debian");
    let made_of = format!("{RELEASE}: {}\n", PACKAGES.join(" "));
    if fs::read_to_string(root.join(MADE_OF)).is_ok_and(|text| text == made_of) {
        return Ok(root);
    }
    let mirror = mirror()?;
    println!(
        "32-bit Wine runs on a Debian of its own: fetching some 300 MB from {mirror} into {}, which takes 2 GB and, on two \
         free cores, two minutes; it stays there for the next time",
        root.display()
    );
    let new = folder.join("debian.new");
    for old in [&root, &new] {
        if old.exists() {
            fs::remove_dir_all(old).map_err(Error::file("remove", old))?;
        }
    }
    let mut debootstrap = Command::new("debootstrap");
    debootstrap.args(["--variant=minbase", RELEASE]).arg(&new).arg(&mirror);
    command::output(&mut debootstrap)?;
    write(&new.join("etc/apt/apt.conf.d/90ecmsk"), "APT::Install-Recommends \"0\";\n")?;
    write(&new.join("etc/dpkg/dpkg.cfg.d/90ecmsk"), LEFT_OUT)?;
    inside(&new, &["dpkg", "--add-architecture", "i386"])?;
    inside(&new, &["apt-get", "-qq", "update"])?;
    inside(&new, &[&["apt-get", "-qq", "-y", "install"], PACKAGES].concat())?;
    inside(&new, &["apt-get", "clean"])?;
    write(&new.join(MADE_OF), &made_of)?;
    // Named last, when all is in its place.
    fs::rename(&new, &root).map_err(Error::file("rename", &new))?;
    Ok(root)
}

fn write(path: &Path, text: &str) -> Result<(), Error> {
    fs::write(path, text).map_err(Error::file("write", path))
}

/// Runs a command in it, with a /proc that goes with the command.
fn inside(root: &Path, words: &[&str]) -> Result<(), Error> {
    let mut unshare = Command::new("unshare");
    unshare.env("DEBIAN_FRONTEND", "noninteractive").env("PATH", "/usr/sbin:/usr/bin:/sbin:/bin");
    unshare.args(["--mount", "sh", "-c", r#"mount -t proc proc "$0/proc" && exec chroot "$0" "$@""#]);
    command::output(unshare.arg(root).args(words)).map(drop)
}

/// Where this system has its packages from.
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

/// The first source of the release itself, in either form of the file.
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
