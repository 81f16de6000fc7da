//! Sets up Wine. 64-bit programs run on this system's Wine, 32-bit ones on that of a Debian system in a folder,
//! because this system's mirrors may not have 32-bit packages of the installed versions.
//!
//! Both have a folder for programs and a script that runs one: `SCRIPT FOLDER PROGRAM ARGUMENTS`, where FOLDER is in
//! that folder and becomes the program's working directory.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use super::{Width, folder};
use crate::command;
use crate::debian::{self, System};
use crate::error::Error;
use crate::project::Project;
use crate::system::set_mode;

/// The Debian system with Wine of both widths.
const SYSTEM: System = System {
    name: "debian",
    why: "32-bit Wine runs on a Debian of its own: fetching some 300 MB, which takes 800 MB and, on two free cores, two \
          minutes",
    also: Some("i386"),
    // The last two are for USB in the guest: Wine finds devices by libudev, in either width.
    packages: &["wine", "wine64", "wine32:i386", "udev", "libudev1:i386"],
    // Files that nobody reads there.
    left_out: &["/usr/share/doc/*", "/usr/share/man/*", "/usr/share/locale/*"],
    // Here and not later, because Wine copies its DLLs into the prefix.
    finish: |root| DLLS.iter().try_for_each(|(folder, _)| strip(&root.join(folder))),
};
/// The folder for programs in that Debian system.
const PROGRAMS: &str = "srv";
/// The folder of Wine's drive C there.
pub const PREFIX: &str = "wine";

/// Wine, ready to run programs.
pub struct Wine {
    /// The folder for programs.
    pub programs: PathBuf,
    /// The script that runs a program.
    pub script: PathBuf,
}

/// Sets Wine up for a width; nothing is done if it is set up already.
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
            let root = debian::set_up(&folder, &SYSTEM)?;
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
        // Wine has written everything when its server has ended.
        wine.run("--server", &["-w"])?;
        match width {
            // The files in this prefix are copies of the system's files, which stay as they are.
            Width::X64 => strip(&prefix.join("drive_c"))?,
            Width::X86 => share_dlls(&wine.root(), &prefix)?,
        }
    }
    // Ends a server that an interrupted run may have left.
    let _ = wine.run("--server", &["-k"]);
    // The server keeps running, because starting it for each program would take most of the time.
    wine.run("--server", &["-p"])?;
    // Wine's services start with the first program and keep its output open, so the first one has no output.
    wine.run(".", &["cmd.exe", "/c", "exit"])?;
    Ok(wine)
}

impl Wine {
    /// The root of its programs, if it is not that of this system.
    pub fn root(&self) -> PathBuf {
        self.programs.parent().map(Path::to_owned).unwrap_or_default()
    }

    /// Removes the folders of [`Self::programs`]: each test makes its own anew, with a copy of the DLL. Files stay.
    pub fn clear(&self) -> Result<(), Error> {
        for entry in fs::read_dir(&self.programs).map_err(Error::file("list", &self.programs))?.flatten() {
            if entry.file_type().is_ok_and(|kind| kind.is_dir()) {
                fs::remove_dir_all(entry.path()).map_err(Error::file("remove", &entry.path()))?;
            }
        }
        Ok(())
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
        // A server that cannot be ended does no harm.
        let _ = self.run("--server", &["-k"]);
    }
}

/// Wine's folders of DLLs for each width, and where a prefix has its copies.
const DLLS: [(&str, &str); 2] = [
    ("usr/lib/x86_64-linux-gnu/wine/x86_64-windows", "system32"),
    ("usr/lib/i386-linux-gnu/wine/i386-windows", "syswow64"),
];

/// The endings of what Wine loads as Windows does: DLLs, drivers and programs.
const LOADED: &[&str] = &["acm", "ax", "com", "cpl", "dll", "drv", "ds", "exe", "ocx", "sys"];

/// Removes debug information and symbols, which are three quarters of Wine's DLLs, from all files below a folder. The
/// alignment in the files stays the same: Wine cannot map a file with a smaller one, and would read it into memory. Files
/// that objcopy does not know stay unchanged.
fn strip(folder: &Path) -> Result<(), Error> {
    let mut find = Command::new("find");
    find.arg(folder).args(["-type", "f", "-regex"]).arg(format!(r".*\.\({}\)", LOADED.join(r"\|")));
    // MinGW's objcopy of 64 bits knows either width.
    let objcopy = format!("{}-objcopy", Width::X64.mingw());
    find.args(["-exec", &objcopy, "--strip-all", "--file-alignment=4096", "{}", ";"]);
    command::run(&mut find)
}

/// Wine has copied all its DLLs into the prefix. Each copy is replaced by a hard link to its original, which only this
/// prefix uses.
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

/// The environment of Wine: without .NET, HTML and debug output, and with the given drive C.
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

/// Runs a command in its own root. The mount of /proc is not visible outside and ends with the program.
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

    /// The scripts are valid shell scripts, whatever is in the paths.
    #[test]
    fn scripts_can_be_read_by_a_shell() {
        let odd = Path::new("/a folder/of $HOME's");
        for text in [on_this_system(odd, odd), in_its_own(odd)] {
            let mut shell = Command::new("sh");
            assert!(command::succeeds(shell.args(["-n", "-c", &text])), "{text}");
        }
    }
}
