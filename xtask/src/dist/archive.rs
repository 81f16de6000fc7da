//! Makes archives of the folders that become packages, and checksums of files.

use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::Write as _;
use std::path::Path;
use std::process::Stdio;

use super::release::Release;
use super::tree::Tree;
use crate::command;
use crate::error::Error;

/// Packs a tree as `.tar.gz`: one folder with the name of the tree's root. Its files are owned by root and sorted by name.
/// `level`: the option for gzip's level.
pub fn tar(release: &Release, level: &str, tree: &Tree, file: &Path) -> Result<(), Error> {
    let plain = file.with_extension("");
    let mut tar = release.command("tar");
    tar.args(["--format=ustar", "--sort=name", "--owner=root:0", "--group=root:0"]);
    tar.arg(format!("--mtime=@{}", release.epoch)).arg("--create").arg("--file").arg(&plain);
    let (folder, name) = parts(tree.root());
    command::run(tar.arg("--directory").arg(folder).arg(name))?;
    // gzip stores neither the name nor the time of the file.
    command::run(release.command("gzip").args(["--no-name", level, "--force", "--"]).arg(&plain))
}

/// Packs a tree as `.zip`: one folder with the name of the tree's root, its files sorted by name. `level`: the option for
/// zip's level.
pub fn zip(release: &Release, level: &str, tree: &Tree, file: &Path) -> Result<(), Error> {
    let (folder, name) = parts(tree.root());
    zip_below(release, level, tree, folder, Path::new(name), file)
}

/// As [`zip`], but without a folder around the files.
pub fn zip_flat(release: &Release, level: &str, tree: &Tree, file: &Path) -> Result<(), Error> {
    zip_below(release, level, tree, tree.root(), Path::new(""), file)
}

/// Packs the files of the tree by their paths relative to `folder`; `prefix` is the tree's own one.
fn zip_below(
    release: &Release,
    level: &str,
    tree: &Tree,
    folder: &Path,
    prefix: &Path,
    file: &Path,
) -> Result<(), Error> {
    tree.set_time(release.epoch)?;
    if file.exists() {
        fs::remove_file(file).map_err(Error::file("remove", file))?;
    }
    let names: String = tree.files()?.iter().map(|file| format!("{}\n", prefix.join(file).display())).collect();
    // -X: no user ids; -D: no entries for folders; -@: names from standard input.
    let mut zip = release.command("zip");
    zip.current_dir(folder).args(["-q", "-X", "-D", level, "-@"]).arg(file);
    let shown = command::shown(&zip);
    let mut running =
        zip.stdin(Stdio::piped()).spawn().map_err(|source| Error::Start { command: shown.clone(), source })?;
    let wrote = running.stdin.take().map_or(Ok(()), |mut input| input.write_all(names.as_bytes()));
    wrote.map_err(Error::file("write", file))?;
    let status = running.wait().map_err(|source| Error::Start { command: shown.clone(), source })?;
    if status.success() { Ok(()) } else { Err(Error::Failed { command: shown, status: status.to_string() }) }
}

/// The SHA-256 of a file.
pub fn sha256(file: &Path) -> Result<String, Error> {
    let opened = File::open(file).map_err(Error::file("read", file))?;
    let said = command::output(std::process::Command::new("sha256sum").stdin(opened))?;
    Ok(String::from_utf8_lossy(&said).split_whitespace().next().unwrap_or_default().to_owned())
}

/// The SHA-256 checksums of the files `names` in `folder`, as lines that `sha256sum -c` reads.
pub fn sums(folder: &Path, names: &[String]) -> Result<String, Error> {
    let lines: Result<Vec<String>, Error> =
        names.iter().map(|name| Ok(format!("{}  {name}\n", sha256(&folder.join(name))?))).collect();
    lines.map(|lines| lines.concat())
}

fn parts(root: &Path) -> (&Path, &OsStr) {
    (root.parent().unwrap_or(Path::new("/")), root.file_name().unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dist::tree::PROGRAM;
    use std::process::Command;

    const RELEASE: Release = Release { version: "0.1.0", epoch: 1_795_305_600 };

    fn tree(folder: &Path) -> Tree {
        let tree = Tree::new(folder.join("made/ecmsk-0.1.0")).unwrap();
        tree.write("b", "text\n").unwrap();
        tree.write("a/c", "more text\n").unwrap();
        tree.copy(Path::new("/bin/true"), "bin/true", PROGRAM).unwrap();
        tree
    }

    #[test]
    fn a_tar_is_the_same_in_another_folder_at_another_time() {
        let [one, other] = [(); 2].map(|()| tempfile::tempdir().unwrap());
        let bytes = [(&one, 1_000_000_000), (&other, 1_100_000_000)].map(|(folder, time)| {
            let file = folder.path().join("x.tar.gz");
            let tree = tree(folder.path());
            tree.set_time(time).unwrap();
            tar(&RELEASE, "-9", &tree, &file).unwrap();
            fs::read(file).unwrap()
        });
        assert!(bytes[0] == bytes[1]);
        let mut list = Command::new("tar");
        list.env("TZ", "UTC").args(["--list", "--verbose", "--file"]).arg(one.path().join("x.tar.gz"));
        let list = String::from_utf8(command::output(&mut list).unwrap()).unwrap();
        let names: Vec<&str> = list.lines().filter_map(|line| line.split_whitespace().last()).collect();
        let expected = ["", "a/", "a/c", "b", "bin/", "bin/true"].map(|name| format!("ecmsk-0.1.0/{name}"));
        assert_eq!(names, expected);
        for line in list.lines() {
            assert!(line.contains("root/root") && line.contains("2026-11-22 00:00"), "{line}");
        }
    }

    #[test]
    fn sums_are_those_that_sha256sum_takes() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("a"), "a\n").unwrap();
        let lines = sums(folder.path(), &["a".to_owned()]).unwrap();
        assert_eq!(lines, "87428fc522803d31065e7bce3cf03fe475096631e5e07bbd7a0fde60c4cf25c7  a\n");
    }
}
