//! Sets up Wine. 64-bit programs run on the host system's Wine. 32-bit programs run on Wine in a Debian system in a folder,
//! because the host's package mirror may not have 32-bit packages of the versions installed here.
//!
//! Each of these two installations of Wine has a folder for programs, and a script that runs one of them: `SCRIPT FOLDER
//! PROGRAM ARGUMENTS`. FOLDER is a sub-folder there and becomes the program's working directory.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use super::{Width, folder};
use crate::command;
use crate::debian::{self, System};
use crate::error::Error;
use crate::project::Project;
use crate::system::set_mode;

/// The Debian system with Wine for 32-bit and for 64-bit programs.
const SYSTEM: System = System {
    name: "debian",
    why: "32-bit Wine runs on a Debian of its own: fetching some 300 MB, which takes 800 MB and, on two free cores, two \
          minutes",
    also: Some("i386"),
    // The packages udev and libudev1 are for boards on USB in the guest: Wine finds devices by libudev, in either width.
    packages: &["wine", "wine64", "wine32:i386", "udev", "libudev1:i386"],
    // Documentation and translations are left out, because nobody reads them there.
    left_out: &["/usr/share/doc/*", "/usr/share/man/*", "/usr/share/locale/*"],
    // The DLLs are stripped now and not later, because Wine copies them into its prefix when it is set up.
    finish: |root| DLLS.iter().try_for_each(|(folder, _)| strip(&root.join(folder))),
};
/// The folder in the Debian system [`SYSTEM`] into which the programs to run are put.
const PROGRAMS: &str = "srv";
/// The folder in that Debian system for Wine's prefix: its drive C and its registry.
pub const PREFIX: &str = "wine";

/// An installation of Wine for programs of one width. Its prefix exists and its server runs.
pub struct Wine {
    /// The folder into which programs are put to be run.
    pub programs: PathBuf,
    /// The script that runs a program, see the head of this file.
    pub script: PathBuf,
}

/// Sets up Wine of a width, if that was not done before, and starts its server.
pub fn set_up(project: &Project, width: Width) -> Result<Wine, Error> {
    let folder = folder(project);
    let script = folder.join(format!("wine-{}", width.name()));
    let (programs, prefix, text) = match width {
        Width::X64 => {
            let (programs, prefix) = (folder.join("programs-x64"), folder.join("wine-prefix-x64"));
            let text = on_this_system(&programs, &prefix);
            (programs, prefix, text)
        }
        Width::X86 => {
            let root = set_up_debian(project)?;
            let text = in_its_own(&root);
            (root.join(PROGRAMS), root.join(PREFIX), text)
        }
    };
    for folder in [&programs, &prefix] {
        fs::create_dir_all(folder).map_err(Error::file("make", folder))?;
    }
    write_script(&script, &text)?;
    let wine = Wine { programs, script };
    if !prefix.join("system.reg").exists() {
        println!("setting up Wine for {} (10 s)", width.name());
        wine.run(".", &["wineboot.exe", "-i"])?;
        // `-w` waits for the end of Wine's server, which then has written everything to disk.
        wine.run("--server", &["-w"])?;
        match width {
            // 64-bit: the DLLs in this prefix are copies of those of the host system, which must not be changed.
            Width::X64 => strip(&prefix.join("drive_c"))?,
            Width::X86 => share_dlls(&wine.root(), &prefix)?,
        }
    }
    // `-k` ends a server that an interrupted run may have left.
    let _ = wine.run("--server", &["-k"]);
    // `-p` keeps the server running between programs; starting it for each one would take most of the time.
    wine.run("--server", &["-p"])?;
    // The first program starts Wine's services, which keep its standard output open. So the first program is one without
    // output.
    wine.run(".", &["cmd.exe", "/c", "exit"])?;
    Ok(wine)
}

/// Sets up the Debian system with Wine of both widths; returns its root.
pub fn set_up_debian(project: &Project) -> Result<PathBuf, Error> {
    debian::set_up(&folder(project), &SYSTEM)
}

impl Wine {
    /// The root of the Debian system that contains [`Self::programs`]. Valid only for 32-bit Wine.
    pub fn root(&self) -> PathBuf {
        self.programs.parent().map(Path::to_owned).unwrap_or_default()
    }

    /// Removes all folders in [`Self::programs`]; files stay. Each test makes its folder anew, with a copy of the DLL.
    pub fn clear(&self) -> Result<(), Error> {
        for entry in fs::read_dir(&self.programs).map_err(Error::file("list", &self.programs))?.flatten() {
            if entry.file_type().is_ok_and(|kind| kind.is_dir()) {
                fs::remove_dir_all(entry.path()).map_err(Error::file("remove", &entry.path()))?;
            }
        }
        Ok(())
    }

    /// Runs a program in a folder of [`Self::programs`]; returns what it prints, with the line ends of Linux.
    pub fn output(&self, folder: &str, words: &[&str]) -> Result<String, Error> {
        let said = command::output(Command::new(&self.script).arg(folder).args(words))?;
        Ok(String::from_utf8_lossy(&said).replace("\r\n", "\n"))
    }

    /// Runs a program in a folder of [`Self::programs`].
    pub fn run(&self, folder: &str, words: &[&str]) -> Result<(), Error> {
        let mut script = Command::new(&self.script);
        // Wine's warnings about missing features are not of interest.
        script.arg(folder).args(words).stdout(Stdio::null()).stderr(Stdio::null());
        command::run(&mut script)
    }
}

impl Drop for Wine {
    fn drop(&mut self) {
        // Errors are ignored: a server that keeps running does no harm.
        let _ = self.run("--server", &["-k"]);
    }
}

/// For each width the folder of Wine's DLLs in the Debian system, and the folder in `windows/` of a prefix that has copies of
/// them.
const DLLS: [(&str, &str); 2] = [
    ("usr/lib/x86_64-linux-gnu/wine/x86_64-windows", "system32"),
    ("usr/lib/i386-linux-gnu/wine/i386-windows", "syswow64"),
];

/// The extensions of files that Wine loads as Windows binaries: DLLs, drivers and programs.
const LOADED: &[&str] = &["acm", "ax", "com", "cpl", "dll", "drv", "ds", "exe", "ocx", "sys"];

/// Removes debug information and symbols, three quarters of the size of Wine's DLLs, from all files below a folder. The
/// alignment of sections in the files stays the same: with a smaller one Wine could not map a file and would read it into
/// memory. Files that objcopy does not know stay unchanged.
fn strip(folder: &Path) -> Result<(), Error> {
    let mut find = Command::new("find");
    find.arg(folder).args(["-type", "f", "-regex"]).arg(format!(r".*\.\({}\)", LOADED.join(r"\|")));
    // MinGW's 64-bit objcopy processes files of both widths.
    let objcopy = format!("{}-objcopy", Width::X64.mingw());
    find.args(["-exec", &objcopy, "--strip-all", "--file-alignment=4096", "{}", ";"]);
    command::run(&mut find)
}

/// Replaces the copies of DLLs in Wine's prefix by hard links to the originals, which saves disk space. A program that
/// changes one of these DLLs changes the original, too; no other prefix uses the originals.
fn share_dlls(root: &Path, prefix: &Path) -> Result<(), Error> {
    for (from, to) in DLLS.map(|(from, to)| (root.join(from), prefix.join("drive_c/windows").join(to))) {
        for entry in fs::read_dir(&from).map_err(Error::file("list", &from))?.flatten() {
            let (original, copy) = (entry.path(), to.join(entry.file_name()));
            let bytes = |path: &Path| fs::read(path).map_err(Error::file("read", path));
            if copy.is_file() && bytes(&original)? == bytes(&copy)? {
                fs::remove_file(&copy).map_err(Error::file("remove", &copy))?;
                fs::hard_link(&original, &copy).map_err(Error::file("link", &copy))?;
            }
        }
    }
    Ok(())
}

/// The environment variables for Wine: the given prefix, and neither .NET nor HTML support nor debug output.
fn environment(prefix: &Path) -> String {
    format!(
        "export WINEPREFIX={} WINEARCH=win64 WINEDEBUG=-all WINEDLLOVERRIDES='mscoree,mshtml=' HOME={0}",
        quoted(prefix)
    )
}

fn on_this_system(programs: &Path, prefix: &Path) -> String {
    format!(
        "#!/bin/sh\n{}\nfolder=$1\nshift\n\
         [ \"$folder\" = --server ] && exec /usr/lib/wine/wineserver64 \"$@\"\n\
         cd {}/\"$folder\" && exec /usr/lib/wine/wine64 \"$@\"\n",
        environment(prefix),
        quoted(programs)
    )
}

/// The script that runs a program in the Debian system in `root` (chroot). Programs there need /proc. It is mounted in a
/// mount namespace that ends with the program, so that nothing stays mounted.
fn in_its_own(root: &Path) -> String {
    let inside = format!(
        "{}\nfolder=$1\nshift\n[ \"$folder\" = --server ] && exec wineserver \"$@\"\n\
         cd /{PROGRAMS}/\"$folder\" && exec wine \"$@\"\n",
        environment(&Path::new("/").join(PREFIX))
    );
    format!(
        "#!/bin/sh\nexport ROOT={} PATH=/usr/sbin:/usr/bin:/sbin:/bin\n\
         exec unshare --mount sh -c 'mount -t proc proc \"$ROOT/proc\" && exec chroot \"$ROOT\" sh -c \"$0\" sh \"$@\"' \\\n{} \"$@\"\n",
        quoted(root),
        quoted(Path::new(&inside))
    )
}

fn quoted(path: &Path) -> String {
    format!("'{}'", path.to_string_lossy().replace('\'', r"'\''"))
}

fn write_script(script: &Path, text: &str) -> Result<(), Error> {
    fs::write(script, text).map_err(Error::file("write", script))?;
    set_mode(script, 0o755).map_err(Error::file("make executable", script))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The scripts are valid shell code whatever characters the paths contain.
    #[test]
    fn scripts_can_be_read_by_a_shell() {
        let odd = Path::new("/a folder/of $HOME's");
        for text in [on_this_system(odd, odd), in_its_own(odd)] {
            let mut shell = Command::new("sh");
            assert!(command::succeeds(shell.args(["-n", "-c", &text])), "{text}");
        }
    }
}
