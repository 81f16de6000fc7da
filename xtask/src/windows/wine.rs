//! Wine: 64-bit programs run on this system's, 32-bit ones on that of a Debian of its own, since this system's mirrors need
//! not have 32-bit packages of the versions that are installed here.
//!
//! Either gets a folder for programs and a script that runs one: `SCRIPT FOLDER PROGRAM ARGUMENTS`, where FOLDER lies in
//! that folder and is the program's current one.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use super::{Width, folder};
use crate::command;
use crate::debian::{self, System};
use crate::error::Error;
use crate::project::Project;
use crate::system::set_mode;

/// The Debian with both Wines.
const SYSTEM: System = System {
    name: "debian",
    why: "32-bit Wine runs on a Debian of its own: fetching some 300 MB, which takes 2 GB and, on two free cores, two minutes",
    also: Some("i386"),
    // The last two are for USB in the guest: Wine looks for devices by libudev, of either width.
    packages: &["wine", "wine64", "wine32:i386", "udev", "libudev1:i386"],
    // What nobody reads there.
    left_out: "path-exclude=/usr/share/doc/*\npath-exclude=/usr/share/man/*\npath-exclude=/usr/share/locale/*\n",
};
/// Where programs lie in the Debian of its own.
const PROGRAMS: &str = "srv";
/// Where Wine keeps its drive C there.
pub const PREFIX: &str = "wine";

/// A Wine that is ready.
pub struct Wine {
    /// Folder for programs.
    pub programs: PathBuf,
    /// Runs one.
    pub script: PathBuf,
}

/// Sets Wine up for a width; a second time it is there at once.
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
        // It has written all when its server ends.
        wine.run("--server", &["-w"])?;
        if width == Width::X86 {
            share_dlls(&wine.root(), &prefix)?;
        }
    }
    // One that an interrupted run has left would be in the way; mostly there is none.
    let _ = wine.run("--server", &["-k"]);
    // The server stays until it is told to go: started anew for each program it would take most of the time.
    wine.run("--server", &["-p"])?;
    // Its services begin with the first program and keep what that one writes to open: this one writes to nobody.
    wine.run(".", &["cmd.exe", "/c", "exit"])?;
    Ok(wine)
}

impl Wine {
    /// The root that its programs see, if it is one of its own.
    pub fn root(&self) -> PathBuf {
        self.programs.parent().map(Path::to_owned).unwrap_or_default()
    }

    /// Runs a program in a folder of it.
    pub fn run(&self, folder: &str, words: &[&str]) -> Result<(), Error> {
        let mut script = Command::new(&self.script);
        // Wine's complaints about what it does not find here are none of ours.
        script.arg(folder).args(words).stdout(Stdio::null()).stderr(Stdio::null());
        command::run(&mut script)
    }
}

impl Drop for Wine {
    fn drop(&mut self) {
        // Nothing depends on it.
        let _ = self.run("--server", &["-k"]);
    }
}

/// Wine's folders in a Debian with the DLLs of each width, and where a prefix has its copies of them.
const DLLS: [(&str, &str); 2] = [
    ("usr/lib/x86_64-linux-gnu/wine/x86_64-windows", "system32"),
    ("usr/lib/i386-linux-gnu/wine/i386-windows", "syswow64"),
];

/// Wine has copied all its DLLs into the prefix, more than a gigabyte. Each copy becomes a second name of the file that it is
/// a copy of, which in a Debian of its own nobody else has.
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

/// What Wine is to know: nothing of .NET and HTML, no word about itself, a drive C of its own.
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

/// The mount of /proc is seen by nobody else, and gone with the program.
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

    /// The scripts are shell, whatever is in the paths.
    #[test]
    fn scripts_can_be_read_by_a_shell() {
        let odd = Path::new("/a folder/of $HOME's");
        for text in [on_this_system(odd, odd), in_its_own(odd)] {
            let mut shell = Command::new("sh");
            assert!(command::succeeds(shell.args(["-n", "-c", &text])), "{text}");
        }
    }
}
