//! Writes the control files of a package.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::process::Command;

use super::parts::{Part, long_description};
use crate::command;
use crate::dist::machine::Machine;
use crate::dist::release::Release;
use crate::dist::tree::Tree;
use crate::error::Error;
use crate::project::Project;

/// The maintainer in the packages' control files. The address is invalid because the project has no mail address. \[OURS]
pub const MAINTAINER: &str = "The ecmsk authors <ecmsk@packages.invalid>";

/// Writes the folder `DEBIAN`, which contains the control files of a package.
pub fn write(part: &Part, machine: Machine, version: &str, libraries: Option<&str>, tree: &Tree) -> Result<(), Error> {
    // Size and checksums are those of the installed files, so they are computed before the folder DEBIAN is there.
    let (size, sums) = (installed_size(tree)?, md5sums(tree)?);
    let own = part.depends_on_own.iter().map(|package| format!("{package} (= {version})"));
    let depends: Vec<String> = own.chain(libraries.map(str::to_owned)).collect();
    let mut text = format!(
        "Package: {}\nSource: ecmsk\nVersion: {version}\nArchitecture: {}\nMaintainer: {MAINTAINER}\n\
         Installed-Size: {size}\n",
        part.package,
        machine.debian()
    );
    let fields = [
        ("Depends", depends.join(", ")),
        ("Recommends", part.recommends.join(", ")),
        ("Suggests", part.suggests.join(", ")),
        ("Section", part.section.to_owned()),
        ("Priority", "optional".to_owned()),
        ("Multi-Arch", part.multi_arch.unwrap_or_default().to_owned()),
        ("Description", description(part)),
    ];
    for (name, value) in fields.iter().filter(|(_, value)| !value.is_empty()) {
        text += &format!("{name}: {value}\n");
    }
    tree.write("DEBIAN/control", text)?;
    tree.write("DEBIAN/md5sums", sums)?;
    let upstream = version.rsplit_once('-').map_or(version, |(upstream, _)| upstream);
    for (name, text) in part.control {
        tree.write(&format!("DEBIAN/{name}"), text.replace("@VERSION@", upstream))?;
    }
    Ok(())
}

/// The description field of a Debian package: a first line, then lines that begin with a blank, as the control file
/// requires.
fn description(part: &Part) -> String {
    let mut lines = vec![part.description.0.to_owned(), String::new()];
    for word in long_description(part).split_whitespace() {
        let line = lines.last_mut().expect("there are two");
        if line.len() + 1 + word.len() > 79 {
            lines.push(format!(" {word}"));
        } else {
            *line += &format!(" {word}");
        }
    }
    lines.join("\n")
}

/// The installed size in KiB as dpkg-gencontrol computes it: each file rounded up to a KiB, and 1 KiB for each folder or link.
fn installed_size(tree: &Tree) -> Result<u64, Error> {
    let mut size = 0;
    let mut folders = BTreeSet::new();
    for path in tree.files()? {
        folders.extend(path.ancestors().skip(1).map(Path::to_path_buf));
        let file = tree.root().join(path);
        let metadata = fs::symlink_metadata(&file).map_err(Error::file("look at", &file))?;
        size += if metadata.is_file() { metadata.len().div_ceil(1024) } else { 1 };
    }
    Ok(size + folders.len() as u64)
}

fn md5sums(tree: &Tree) -> Result<String, Error> {
    let mut lines = String::new();
    for path in tree.files()? {
        let file = tree.root().join(&path);
        if !file.is_symlink() {
            let opened = fs::File::open(&file).map_err(Error::file("read", &file))?;
            let said = command::output(Command::new("md5sum").stdin(opened))?;
            let said = String::from_utf8_lossy(&said).into_owned();
            let sum = said.split_whitespace().next().unwrap_or_default();
            lines += &format!("{sum}  {}\n", path.display());
        }
    }
    Ok(lines)
}

/// The copyright file of a Debian package: who holds the copyright, and the licences (DEP-5).
pub fn copyright(project: &Project, release: &Release) -> Result<String, Error> {
    let file = project.root.join("LICENSE-MIT");
    let text = fs::read_to_string(&file).map_err(Error::file("read", &file))?;
    let holder = text.lines().find_map(|line| line.strip_prefix("Copyright (c) ")).unwrap_or("The ecmsk authors");
    let (_, terms) = text.split_once(holder).unwrap_or(("", &text));
    let terms: String = terms
        .trim()
        .lines()
        .map(|line| if line.is_empty() { " .\n".to_owned() } else { format!(" {line}\n") })
        .collect();
    let year = release.date("+%Y")?;
    Ok(format!(
        "Format: https://www.debian.org/doc/packaging-manuals/copyright-format/1.0/\nUpstream-Name: ecmsk\n\
         Comment:\n Parts by others that the programs contain, each with its licence, are listed in\n \
         third-party-licenses.gz beside this file.\n\n\
         Files: *\nCopyright: {year} {holder}\nLicense: Expat or Apache-2.0\n\n\
         License: Expat\n{terms}\nLicense: Apache-2.0\n On Debian systems the text of the Apache License, version 2.0, is in\n \
         /usr/share/common-licenses/Apache-2.0.\n"
    ))
}
