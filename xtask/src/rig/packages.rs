//! Fetches Debian packages for the guest without installing them, so that the host is not changed.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::command;
use crate::error::Error;

/// The package that depends on the newest kernel of this Debian release. The other flavour, "cloud", has no USB.
const KERNEL: &str = "linux-image-amd64";
/// The packages of the guest besides the kernel's. busybox provides the guest's commands, usbip attaches boards that are
/// served over USB/IP, the link `usb:` loads libusb and libudev, and the programs of linux-kbuild load libelf1.
const OTHERS: [&str; 5] = ["busybox-static", "usbip", "libusb-1.0-0", "libudev1", "libelf1"];
/// The folders of kernel modules that are kept: those for the devices of the guests. All others, most of the package, are
/// removed.
const KEPT: [&str; 9] = [
    "drivers/hid",
    "drivers/usb",
    "drivers/virtio",
    "fs/9p",
    "fs/configfs",
    "fs/fscache",
    "fs/netfs",
    "fs/overlayfs",
    "net/9p",
];
/// The file in the folder of unpacked packages that lists them. If the list differs, the folder is made anew.
const MADE_OF: &str = "made-of";

/// The packages, unpacked into one folder.
pub struct Packages {
    /// The folder into which the packages are unpacked, as if it were `/`.
    pub root: PathBuf,
    /// The kernel's release, such as `6.1.0-40-amd64`.
    pub release: String,
}

/// Fetches and unpacks the packages, if they are not there yet.
pub fn fetch(folder: &Path) -> Result<Packages, Error> {
    if !command::succeeds(Command::new("apt-get").arg("--version")) {
        return Err(Error::Rig("the guest is made of Debian's packages, and there is no apt-get; run it on Debian 12"));
    }
    let image = kernel_package()?;
    let release = image.trim_start_matches("linux-image-").to_owned();
    let root = folder.join(format!("root-{release}"));
    let names = names(&image, &release);
    let made_of = format!("{} with {}", names.join(" "), KEPT.join(" "));
    if fs::read_to_string(root.join(MADE_OF)).ok().as_ref() != Some(&made_of) {
        let (debs, unpacked) = (folder.join("debs"), folder.join("unpacking"));
        for folder in [&debs, &unpacked] {
            empty(folder)?;
        }
        println!("fetching for the guest: {}", names.join(" "));
        command::run(Command::new("apt-get").current_dir(&debs).args(["-qq", "download"]).args(names))?;
        for deb in list(&debs)? {
            unpack(&deb, &unpacked)?;
        }
        remove_modules(&unpacked.join("lib/modules").join(&release).join("kernel"))?;
        fs::remove_dir_all(&debs).map_err(Error::file("remove", &debs))?;
        let list = unpacked.join(MADE_OF);
        fs::write(&list, made_of).map_err(Error::file("write", &list))?;
        if root.exists() {
            fs::remove_dir_all(&root).map_err(Error::file("remove", &root))?;
        }
        // The folder gets its final name last, so that a folder of that name is complete.
        fs::rename(&unpacked, &root).map_err(Error::file("rename", &unpacked))?;
    }
    Ok(Packages { root, release })
}

impl Packages {
    /// The headers for building modules for this kernel.
    pub fn headers(&self) -> PathBuf {
        self.root.join(format!("usr/src/linux-headers-{}", self.release))
    }

    /// The headers that all flavours of the kernel have in common.
    pub fn common_headers(&self) -> PathBuf {
        self.root.join("usr/src").join(common_headers(&self.release))
    }

    /// The libraries with these file names: for each its path in the guest and its path on this machine. A name without a
    /// library is left out.
    pub fn libraries(&self, names: &[&str]) -> Result<Vec<(String, PathBuf)>, Error> {
        let mut found = Vec::new();
        for folder in ["lib", "usr/lib"].map(|folder| self.root.join(folder)).iter().filter(|folder| folder.is_dir()) {
            for machine in list(folder)? {
                for library in names.iter().map(|name| machine.join(name)).filter(|library| library.is_file()) {
                    let place = library.strip_prefix(&self.root).unwrap_or(&library).to_string_lossy().into_owned();
                    found.push((place, library));
                }
            }
        }
        Ok(found)
    }
}

/// Unpacks a package without its documentation.
fn unpack(deb: &Path, to: &Path) -> Result<(), Error> {
    let mut shell = Command::new("sh");
    // If dpkg-deb fails, tar fails as well because the archive is incomplete, so the shell line fails.
    let line = "dpkg-deb --fsys-tarfile \"$0\" | tar --extract --directory \"$1\" --exclude=./usr/share/doc";
    command::run(shell.args(["-ec", line]).arg(deb).arg(to))
}

/// Removes the modules in `folder` that are in none of the folders in [`KEPT`].
fn remove_modules(folder: &Path) -> Result<(), Error> {
    // find runs in the folder itself and matches relative paths, because the folder's own path may contain characters of
    // patterns.
    let mut find = Command::new("find");
    find.current_dir(folder).args([".", "-name", "*.ko"]);
    for kept in KEPT {
        find.args(["-not", "-path", &format!("./{kept}/*")]);
    }
    command::run(find.arg("-delete"))
}

/// The names of all packages to fetch: the kernel, the packages for building modules for it, and the others.
fn names(image: &str, release: &str) -> Vec<String> {
    let headers = [format!("linux-headers-{release}"), common_headers(release), kbuild(release)];
    let kernel = std::iter::once(image.to_owned()).chain(headers);
    kernel.chain(OTHERS.map(str::to_owned)).collect()
}

/// The package of the common headers, named like the kernel without its flavour: `6.1.0-40-amd64` has the flavour
/// `amd64`.
fn common_headers(release: &str) -> String {
    format!("linux-headers-{}-common", release.rsplit_once('-').map_or(release, |(version, _)| version))
}

/// The package linux-kbuild, named by the first two numbers of the version.
fn kbuild(release: &str) -> String {
    let numbers: Vec<&str> = release.splitn(3, '.').take(2).collect();
    format!("linux-kbuild-{}", numbers.join("."))
}

/// The name of the kernel's package, on which [`KERNEL`] depends.
fn kernel_package() -> Result<String, Error> {
    if let Some(image) = depends()? {
        return Ok(image);
    }
    // A fresh system has no lists of packages yet.
    command::run(Command::new("apt-get").args(["-qq", "update"]))?;
    depends()?.ok_or(Error::Rig("apt knows no kernel (linux-image-amd64); run `sudo apt-get update`"))
}

fn depends() -> Result<Option<String>, Error> {
    let mut ask = Command::new("apt-cache");
    let said = command::output(ask.args(["depends", "--important", KERNEL]))?;
    Ok(image_of(&String::from_utf8_lossy(&said)))
}

fn image_of(said: &str) -> Option<String> {
    let depends = said.lines().filter_map(|line| line.trim().strip_prefix("Depends: "));
    depends.map(str::trim).find(|name| name.starts_with("linux-image-")).map(str::to_owned)
}

/// Makes an empty folder; an existing one is removed first.
pub fn empty(folder: &Path) -> Result<(), Error> {
    if folder.exists() {
        fs::remove_dir_all(folder).map_err(Error::file("remove", folder))?;
    }
    fs::create_dir_all(folder).map_err(Error::file("make", folder))
}

/// The contents of a folder, sorted by name.
pub fn list(folder: &Path) -> Result<Vec<PathBuf>, Error> {
    let entries =
        fs::read_dir(folder).and_then(Iterator::collect::<Result<Vec<_>, _>>).map_err(Error::file("list", folder))?;
    let mut paths: Vec<PathBuf> = entries.iter().map(fs::DirEntry::path).collect();
    paths.sort();
    Ok(paths)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_kernel_has_its_headers() {
        assert_eq!(
            names("linux-image-6.1.0-40-amd64", "6.1.0-40-amd64")[..4],
            [
                "linux-image-6.1.0-40-amd64",
                "linux-headers-6.1.0-40-amd64",
                "linux-headers-6.1.0-40-common",
                "linux-kbuild-6.1"
            ]
        );
    }

    #[test]
    fn the_kernel_is_what_the_newest_depends_on() {
        let said = "linux-image-amd64\n  Depends: linux-image-6.1.0-40-amd64\n";
        assert_eq!(image_of(said).as_deref(), Some("linux-image-6.1.0-40-amd64"));
        assert_eq!(image_of(""), None);
        assert_eq!(image_of("linux-image-amd64\n"), None);
    }
}
