//! Tests the Debian packages: installs, uses and removes them in a fresh Debian 12.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use super::parts::PARTS;
use crate::command;
use crate::debian::{self, System};
use crate::dist::{first_axis, tree};
use crate::error::Error;
use crate::project::Project;

/// The Debian system of the test: it has a compiler and nothing of this project.
const SYSTEM: System = System {
    name: "debian-packages",
    why: "the packages are installed in a Debian of its own: fetching some 150 MB, which takes 200 MB and, on two free \
          cores, a minute",
    also: None,
    packages: &["gcc", "libc6-dev", "pkg-config"],
    // The files of gcc for link-time optimisation and sanitizers are a third of the system, and no step uses them.
    left_out: &[
        "/usr/share/locale/*",
        "/usr/bin/*-lto-dump-*",
        "/usr/lib/gcc/*/*/lto1",
        "/usr/lib/x86_64-linux-gnu/lib*san.so.*",
    ],
    finish: |_| Ok(()),
};

/// The folder in the Debian system for the packages and programs of the test.
const PLACE: &str = "srv";
/// A C program that calls the functions of the vendor's API. The test compiles it with the installed library.
pub const PROGRAM: &str = include_str!("program.c");
/// The output of [`PROGRAM`] with a simulated board.
pub const EXPECTED: &str = "PreOP\n";
/// Paths that are ignored when the files before and after are compared: dpkg, the dynamic linker and the test itself change
/// them.
const CHANGING_PATHS: [&str; 7] = ["var/", "proc/", "run/", "tmp/", "srv/", "etc/ld.so.cache", "usr/share/info/dir"];

/// The steps that the test runs in the Debian system: shell lines with their expected output.
fn steps(version: &str) -> Vec<(&'static str, String)> {
    let compile = "cd /srv && gcc -Wall -Wextra -Werror program.c -o";
    let pkgconfig = "$(pkg-config --cflags --libs nextwusblib)";
    let archive = "$(pkg-config --variable=libdir nextwusblib)/libNEXTWUSBLib.a \
                   $(pkg-config --static --libs-only-l nextwusblib | sed s/-lNEXTWUSBLib//)";
    let line = |text: String| -> &'static str { Box::leak(text.into_boxed_str()) };
    vec![
        ("ecmsk --version", format!("ecmsk {version}\n")),
        ("pkg-config --modversion nextwusblib", format!("{version}\n")),
        (line(format!("{compile} program {pkgconfig}")), String::new()),
        ("ECMSK_LINK='sim:?clock=virtual' /srv/program", EXPECTED.to_owned()),
        ("ecmsk exec --link 'sim:?clock=virtual' -- /srv/program", EXPECTED.to_owned()),
        (line(format!("{compile} alone {archive}")), String::new()),
        ("ldd /srv/alone | grep NEXTWUSBLib || ECMSK_LINK='sim:?clock=virtual' /srv/alone", EXPECTED.to_owned()),
        ("bash -n /usr/share/bash-completion/completions/ecmsk", String::new()),
        ("zcat /usr/share/man/man1/ecmsk.1.gz | grep -c '^.TH ecmsk 1'", "1\n".to_owned()),
    ]
}

/// Sets up the Debian system in which packages are installed for the test; returns its root.
pub fn set_up_debian(project: &Project) -> Result<PathBuf, Error> {
    debian::set_up(&project.target.join("xtask"), &SYSTEM)
}

/// The line that installs the packages.
const INSTALL: &str = "apt-get -qq install -y --no-install-recommends ./srv/packages/*.deb";

/// Installs the packages, runs the steps, removes the packages, and checks that nothing is left of them.
pub fn test(project: &Project, packages: &[PathBuf], version: &str) -> Result<(), Error> {
    let root = set_up_debian(project)?;
    println!("installing the packages in {}", root.display());
    // An interrupted earlier run may have left the packages installed.
    purge(&root)?;
    let before = listed(&root)?;
    let place = root.join(PLACE).join("packages");
    if place.exists() {
        fs::remove_dir_all(&place).map_err(Error::file("remove", &place))?;
    }
    fs::create_dir_all(&place).map_err(Error::file("make", &place))?;
    for package in packages {
        let to = place.join(package.file_name().unwrap_or_default());
        fs::copy(package, &to).map_err(Error::file("copy", package))?;
    }
    let program = root.join(PLACE).join("program.c");
    fs::write(&program, PROGRAM).map_err(Error::file("write", &program))?;
    let said = |words: &[&str]| {
        let said = command::output(&mut debian::inside(&root, words))?;
        Ok::<_, Error>(String::from_utf8_lossy(&said).into_owned())
    };
    first_axis::timed("the Debian packages", first_axis::MOVED, || {
        said(&["sh", "-ec", INSTALL])?;
        said(&[&["ecmsk"][..], &first_axis::MOVE].concat())
    })?;
    for (line, expected) in steps(version) {
        let said = said(&["sh", "-ec", line])?;
        if said != expected {
            return Err(Error::Package(format!(
                "in a fresh Debian `{line}` printed {said:?} instead of {expected:?}; look there: chroot {}",
                root.display()
            )));
        }
    }
    purge(&root)?;
    let left: Vec<String> =
        listed(&root)?.symmetric_difference(&before).map(|path| path.display().to_string()).collect();
    if left.is_empty() {
        return Ok(());
    }
    Err(Error::Package(format!("removing the packages leaves, or takes with it: {}", left.join(", "))))
}

fn purge(root: &Path) -> Result<(), Error> {
    let mut words = vec!["dpkg", "--purge"];
    // In reverse order: a package is removed before the packages that it depends on.
    words.extend(PARTS.iter().rev().map(|part| part.package));
    let (known, ours) = (root.join("var/lib/dpkg/status"), PARTS[0].package);
    let status = fs::read_to_string(&known).map_err(Error::file("read", &known))?;
    if status.lines().any(|line| line.strip_prefix("Package: ") == Some(ours)) {
        command::output(&mut debian::inside(root, &words))?;
    }
    Ok(())
}

/// All paths in the system except those below [`CHANGING_PATHS`].
fn listed(root: &Path) -> Result<BTreeSet<PathBuf>, Error> {
    let files = tree::files(root)?.into_iter();
    Ok(files.filter(|file| !CHANGING_PATHS.iter().any(|note| file.to_string_lossy().starts_with(note))).collect())
}
