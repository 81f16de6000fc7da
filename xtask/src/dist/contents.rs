//! Checks that the packages have exactly the expected files, and that no file contains a path of the machine on which it was
//! built.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use super::machine::Machine;
use super::release::Release;
use super::tree::files;
use super::{ForLinux, Made, folder, msi};
use crate::error::Error;
use crate::needs::{MSIEXTRACT, UNZIP};
use crate::project::Project;
use crate::{command, remapped};

/// The list of the files that the packages have to contain: each line has the name of a package, or several
/// with `|` between them, and a path in it.
const LIST: &str = include_str!("contents.txt");

/// Unpacks the packages and checks their contents.
pub fn check(project: &Project, release: &Release, made: &Made) -> Result<(), Error> {
    let unpacked = folder(project).join("unpacked");
    if unpacked.exists() {
        fs::remove_dir_all(&unpacked).map_err(Error::file("remove", &unpacked))?;
    }
    fs::create_dir_all(&unpacked).map_err(Error::file("make", &unpacked))?;
    // A NuGet package has the libraries of the machines for which packages were made.
    let is_made = |machine: &Machine| made.linux.iter().any(|packages| packages.machine == *machine);
    let left_out = Machine::ALL.into_iter().filter(|machine| !is_made(machine)).filter_map(Machine::rid);
    let left_out: Vec<String> = left_out.map(|rid| format!("runtimes/{rid}/")).collect();
    let mut problems = Vec::new();
    for (package, machine, file) in packages(release, made) {
        let to = unpacked.join(file.file_name().unwrap_or_default());
        fs::create_dir_all(&to).map_err(Error::file("make", &to))?;
        let top = unpack(&file, &to)?;
        problems.extend(differences(&package, machine, &left_out, &files(&top)?));
        problems.extend(paths_of_this_machine(project, &top)?);
        problems.extend(times_of_linking(&top)?);
    }
    if problems.is_empty() {
        return Ok(());
    }
    Err(Error::Package(format!(
        "what is packed is not what xtask/src/dist/contents.txt lists, or names this machine:\n    {}\nlook there: {}",
        problems.join("\n    "),
        unpacked.display()
    )))
}

/// Each package by the name that it has in [`LIST`], the machine that it is for, and its path.
fn packages(release: &Release, made: &Made) -> Vec<(String, Machine, PathBuf)> {
    let mut found = vec![("windows.zip".to_owned(), Machine::Amd64, made.zip.clone())];
    found.extend(made.on_windows.iter().map(|wheel| ("windows.whl".to_owned(), Machine::Amd64, wheel.clone())));
    found.extend(made.installers.iter().map(|(_, file)| ("windows.msi".to_owned(), Machine::Amd64, file.clone())));
    for id in ["Ecmsk", "NEXTWUSB.Compat"] {
        let package = made.folder.join(format!("{id}.{}.nupkg", release.version));
        found.push((format!("{id}.nupkg"), Machine::Amd64, package));
    }
    for ForLinux { machine, tar, wheel, debs, .. } in &made.linux {
        found.push(("linux.tar.gz".to_owned(), *machine, made.folder.join(tar)));
        found.push(("linux.whl".to_owned(), *machine, wheel.clone()));
        for deb in debs {
            let name = deb.file_name().unwrap_or_default().to_string_lossy().into_owned();
            found.push((name.split('_').next().unwrap_or_default().to_owned(), *machine, deb.clone()));
        }
    }
    found
}

/// Unpacks a package; returns the folder to which its paths in [`LIST`] are relative.
fn unpack(file: &Path, to: &Path) -> Result<PathBuf, Error> {
    let kind = file.extension().unwrap_or_default();
    if kind == "deb" {
        command::output(Command::new("dpkg-deb").arg("--extract").arg(file).arg(to))?;
        return Ok(to.to_owned());
    }
    if kind == "msi" {
        command::output(Command::new(MSIEXTRACT.program).arg("--directory").arg(to).arg(file))?;
        let places = msi::EXTRACTED.map(|place| to.join(place));
        return Ok(places.into_iter().find(|place| place.exists()).unwrap_or_else(|| to.to_owned()));
    }
    // These two have no folder around their files.
    let is_flat = kind == "nupkg" || kind == "whl";
    let is_zip = kind == "zip" || is_flat;
    let mut unpack = match is_zip {
        true => Command::new(UNZIP.program),
        false => Command::new("tar"),
    };
    match is_zip {
        true => unpack.arg("-q").arg(file).arg("-d").arg(to),
        false => unpack.arg("--extract").arg("--file").arg(file).arg("--directory").arg(to),
    };
    command::output(&mut unpack)?;
    if is_flat {
        return Ok(to.to_owned());
    }
    let mut inside = fs::read_dir(to).map_err(Error::file("list", to))?.flatten().map(|entry| entry.path());
    match (inside.next(), inside.next()) {
        (Some(top), None) => Ok(top),
        _ => Err(Error::Package(format!("{} does not unpack into one folder; pack it again", file.display()))),
    }
}

/// What differs between the files of a package and those of [`LIST`]; `left_out`: folders that it does not have this time.
fn differences(package: &str, machine: Machine, left_out: &[String], found: &[PathBuf]) -> Vec<String> {
    let of_it = |line: &'static str| {
        let (packages, path) = line.split_once(' ')?;
        packages.split('|').any(|name| name == package).then_some(path)
    };
    let here = |path: &str| path.replace('@', machine.gnu()).replace("VERSION", env!("CARGO_PKG_VERSION"));
    let listed: Vec<String> = LIST.lines().filter_map(of_it).map(here).collect();
    let is_left_out = |path: &String| left_out.iter().any(|folder| path.starts_with(folder));
    let listed: Vec<String> = listed.into_iter().filter(|path| !is_left_out(path)).collect();
    let fits = |pattern: &str, path: &str| match pattern.split_once('*') {
        Some((begin, _)) => path.strip_prefix(begin).is_some_and(|rest| !rest.contains('/')),
        None => path == pattern,
    };
    let found: Vec<String> = found.iter().map(|path| path.display().to_string()).collect();
    let missing = listed.iter().filter(|pattern| !found.iter().any(|path| fits(pattern, path)));
    let missing = missing.map(|pattern| format!("{package}: {pattern} is missing"));
    let surplus = found.iter().filter(|path| !listed.iter().any(|pattern| fits(pattern, path)));
    missing.chain(surplus.map(|path| format!("{package}: {path} is not in the list"))).collect()
}

fn paths_of_this_machine(project: &Project, folder: &Path) -> Result<Vec<String>, Error> {
    let mut problems = Vec::new();
    for path in remapped::folders(project) {
        let mut grep = Command::new("grep");
        grep.env("LC_ALL", "C");
        // With `--recursive` grep does not follow symbolic links. Its exit code is 1 if no file contains the path.
        grep.args(["--recursive", "--text", "--fixed-strings", "--files-with-matches", "-e", &path, "--"]).arg(folder);
        let output = grep.output().map_err(|source| Error::Start { command: command::shown(&grep), source })?;
        if output.status.code().is_none_or(|code| code > 1) {
            return Err(Error::Failed { command: command::shown(&grep), status: output.status.to_string() });
        }
        let found = String::from_utf8_lossy(&output.stdout).into_owned();
        problems.extend(found.lines().map(|file| format!("{file} names {path}")));
    }
    Ok(problems)
}

/// A problem for each DLL or program of this project whose header contains the time of linking, which differs in each build.
fn times_of_linking(folder: &Path) -> Result<Vec<String>, Error> {
    let mut problems = Vec::new();
    for file in files(folder)?.iter().filter(|file| file.starts_with("x86") || file.starts_with("x64")) {
        let path = folder.join(file);
        let bytes = fs::read(&path).map_err(Error::file("read", &path))?;
        if time_of_linking(&bytes) != Some(0) {
            problems.push(format!(
                "{} has the time when it was linked; remove target/xtask/windows/build, so that it is linked anew",
                file.display()
            ));
        }
    }
    Ok(problems)
}

/// The time of linking in the header of a PE file; `None` if the file is no PE file.
fn time_of_linking(bytes: &[u8]) -> Option<u32> {
    let word = |at: usize| Some(u32::from_le_bytes(bytes.get(at..at.checked_add(4)?)?.try_into().ok()?));
    // In a PE file (a Windows program or DLL) the offset of the header is at 0x3C. The time follows the signature, the
    // machine and the number of sections.
    let header = word(0x3C)? as usize;
    (bytes.get(header..)?.starts_with(b"PE\0\0")).then(|| word(header + 8))?
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A DLL with a time of linking is reported, and so is a file without a PE header, in which no time can be read.
    #[test]
    fn a_time_of_linking_is_found() {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("x64")).unwrap();
        let mut dll = vec![0; 0x60];
        dll[0x3C] = 0x40;
        dll[0x40..0x44].copy_from_slice(b"PE\0\0");
        let file = folder.path().join("x64/a.dll");
        fs::write(&file, &dll).unwrap();
        assert_eq!(times_of_linking(folder.path()).unwrap(), [""; 0]);
        dll[0x4B] = 0x6B;
        for bytes in [&dll[..], b"MZ"] {
            fs::write(&file, bytes).unwrap();
            let said = times_of_linking(folder.path()).unwrap();
            assert!(said.len() == 1 && said[0].starts_with("x64/a.dll has the time"), "{said:?}");
        }
    }

    /// A file of the list that is missing in a package and a file that is not in the list are reported.
    #[test]
    fn each_difference_is_told() {
        let listed = LIST.lines().filter_map(|line| line.strip_prefix("libnextwusblib0 "));
        let all: Vec<PathBuf> = listed.map(|path| path.replace('@', "x86_64-linux-gnu").into()).collect();
        assert_eq!(differences("libnextwusblib0", Machine::Amd64, &[], &all), [""; 0]);
        let other = [&all[1..], &[PathBuf::from("usr/lib/x")]].concat();
        let said = differences("libnextwusblib0", Machine::Amd64, &[], &other);
        assert_eq!(said[0], format!("libnextwusblib0: {} is missing", all[0].display()));
        assert_eq!(said[1..], ["libnextwusblib0: usr/lib/x is not in the list"]);
        let said = differences("libnextwusblib0", Machine::Amd64, &["usr/".to_owned()], &all[..1]);
        assert_eq!(said, [format!("libnextwusblib0: {} is not in the list", all[0].display())]);
    }

    /// A file that contains a path of this machine is reported.
    #[test]
    fn a_path_of_this_machine_is_found() {
        let folder = tempfile::tempdir().unwrap();
        let project = Project {
            root: "/a/place/of/mine".into(),
            target: "/another/place".into(),
            for_tests: false,
            quick: false,
        };
        fs::write(folder.path().join("good"), b"\0/a/place/of/yours\0").unwrap();
        assert_eq!(paths_of_this_machine(&project, folder.path()).unwrap(), [""; 0]);
        fs::write(folder.path().join("bad"), b"\0/a/place/of/mine/src/lib.rs\0").unwrap();
        let said = paths_of_this_machine(&project, folder.path()).unwrap();
        assert_eq!(said.len(), 1);
        assert!(said[0].ends_with("bad names /a/place/of/mine"), "{said:?}");
    }
}
