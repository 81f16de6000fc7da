//! Defines each Debian package: its files with their installed paths, its dependencies and its description.

use std::fs;
use std::path::Path;
use std::process::Command;

use crate::command;
use crate::dist::machine::Machine;
use crate::dist::tree::{DATA, PROGRAM, Tree};
use crate::error::Error;
use crate::project::Project;
use crate::stage::{ARCHIVE, LINK_NAME, SLEEP_LIBRARY, SONAME, UDEV_RULE};

/// Replaces `@` in a path of a package by the name of the sub-folder of `/usr/lib` for libraries of the machine, such as
/// `x86_64-linux-gnu`.
pub fn path(machine: Machine, path: &str) -> String {
    path.replace('@', machine.gnu())
}

/// The definition of one Debian package.
pub struct Part {
    pub package: &'static str,
    pub section: &'static str,
    /// The packages of this project that this package needs in exactly the same version.
    pub depends_on_own: &'static [&'static str],
    pub recommends: &'static [&'static str],
    pub suggests: &'static [&'static str],
    /// The control field `Multi-Arch`; `same` allows the packages of several architectures to be installed at once.
    pub multi_arch: Option<&'static str>,
    /// The description: its first line, and the text after it.
    pub description: (&'static str, &'static str),
    /// The programs and libraries of the package, from which the dependencies are computed; paths as for [`path`].
    pub programs: &'static [&'static str],
    /// Further control files (name, content), such as the triggers that make dpkg run ldconfig.
    pub control: &'static [(&'static str, &'static str)],
    pub fill: fn(&Project, Machine, &Path, &Tree) -> Result<(), Error>,
}

/// The package of the library. Debian requires a name that contains the SONAME.
pub const LIBRARY: &str = "libnextwusblib0";
/// The package of the headers and the static library.
pub const DEVELOPMENT: &str = "libnextwusblib-dev";

const BOARD: &str = "The ECM-SK (EC01M, by NEXTW) is a board that drives EtherCAT slaves for a host on USB or SPI. ";

pub const PARTS: &[Part] = &[
    Part {
        package: LIBRARY,
        section: "libs",
        depends_on_own: &[],
        // The library loads libusb at run time when a board on USB is opened, so it is no hard dependency.
        recommends: &["libusb-1.0-0"],
        suggests: &["ecmsk"],
        multi_arch: Some("same"),
        description: (
            "library for the ECM-SK EtherCAT board, with a simulated one",
            "This is a drop-in replacement for its library NEXTWUSBLib: programs that were written for that one are \
             compiled with this project's header and run on a simulated board, on one that another machine serves, or on \
             a real one.",
        ),
        programs: &["usr/lib/@/libNEXTWUSBLib.so.0"],
        control: &[
            ("shlibs", "libNEXTWUSBLib 0 libnextwusblib0 (>= @VERSION@)\n"),
            ("triggers", "activate-noawait ldconfig\n"),
        ],
        fill: library,
    },
    Part {
        package: DEVELOPMENT,
        section: "libdevel",
        depends_on_own: &[LIBRARY],
        recommends: &["pkg-config"],
        suggests: &[],
        multi_arch: Some("same"),
        description: (
            "headers and archive of the library for the ECM-SK board",
            "This package compiles and links programs in C and C++ with a drop-in replacement for its library \
             NEXTWUSBLib: the vendor's headers for both slot sizes, ecmsk.h for what those lack, and the library as an \
             archive.",
        ),
        programs: &[],
        control: &[],
        fill: development,
    },
    Part {
        package: "ecmsk",
        section: "electronics",
        depends_on_own: &[LIBRARY],
        recommends: &["libusb-1.0-0", "udev"],
        suggests: &[DEVELOPMENT],
        multi_arch: None,
        description: (
            "tool for the ECM-SK EtherCAT board, real or simulated",
            "The tool homes and moves axes, runs programs that were written for the board, records every frame, shows and \
             compares what happened, and shares a board with other programs and machines. Users get the right to open \
             a board by a rule for udev.",
        ),
        programs: &["usr/bin/ecmsk", "usr/lib/@/ecmsk/libecmsk_sleep.so"],
        control: &[("conffiles", "/etc/ecmsk-board.conf\n")],
        fill: tool,
    },
];

/// The text of a package's description below its first line: a sentence that says what the board is, then the package's own
/// text.
pub fn long_description(part: &Part) -> String {
    format!("{BOARD}{}", part.description.1)
}

fn library(_: &Project, machine: Machine, stage: &Path, tree: &Tree) -> Result<(), Error> {
    tree.copy(&stage.join("lib").join(SONAME), &path(machine, &format!("usr/lib/@/{SONAME}")), DATA)
}

fn development(_: &Project, machine: Machine, stage: &Path, tree: &Tree) -> Result<(), Error> {
    tree.copy_all(&stage.join("include"), "usr/include", &[".h"])?;
    tree.copy_all(&stage.join("share/ecmsk/msvc"), "usr/share/ecmsk/msvc", &[".h"])?;
    tree.copy(&stage.join("lib").join(ARCHIVE), &path(machine, &format!("usr/lib/@/{ARCHIVE}")), DATA)?;
    tree.link(&path(machine, &format!("usr/lib/@/{LINK_NAME}")), SONAME)?;
    let file = stage.join("lib/pkgconfig/nextwusblib.pc");
    let text = fs::read_to_string(&file).map_err(Error::file("read", &file))?;
    tree.write(&path(machine, "usr/lib/@/pkgconfig/nextwusblib.pc"), pkgconfig(&text, machine))
}

/// The pkg-config file with Debian's absolute folders instead of folders relative to the file.
fn pkgconfig(text: &str, machine: Machine) -> String {
    let lines = text.lines().map(|line| match line.split_once('=') {
        Some(("prefix", _)) => "prefix=/usr".to_owned(),
        Some(("libdir", _)) => path(machine, "libdir=${prefix}/lib/@"),
        _ => line.to_owned(),
    });
    lines.map(|line| line + "\n").collect()
}

fn tool(project: &Project, machine: Machine, stage: &Path, tree: &Tree) -> Result<(), Error> {
    tree.copy(&stage.join("bin/ecmsk"), "usr/bin/ecmsk", PROGRAM)?;
    let sleep = path(machine, &format!("usr/lib/@/{SLEEP_LIBRARY}"));
    tree.copy(&stage.join("lib").join(SLEEP_LIBRARY), &sleep, DATA)?;
    let rule = project.root.join("share/udev").join(UDEV_RULE);
    tree.copy(&rule, &format!("usr/lib/udev/rules.d/{UDEV_RULE}"), DATA)?;
    // The package does not enable the service. The administrator does that on a machine that is to be a board.
    let services = project.root.join("share/systemd");
    tree.copy(&services.join("ecmsk-board.service"), "usr/lib/systemd/system/ecmsk-board.service", DATA)?;
    tree.copy(&services.join("ecmsk-board.conf"), "etc/ecmsk-board.conf", DATA)?;
    tree.copy_all(&stage.join("share/man/man1"), "usr/share/man/man1", &[".1"])?;
    for page in tree.files()?.iter().filter(|file| file.extension().is_some_and(|kind| kind == "1")) {
        let mut gzip = Command::new("gzip");
        command::run(gzip.args(["--no-name", "--best", "--force", "--"]).arg(tree.root().join(page)))?;
    }
    let share = stage.join("share");
    for (from, to) in [
        ("bash-completion/completions/ecmsk", "bash-completion/completions/ecmsk"),
        // In Debian the folder `site-functions` of zsh belongs to the administrator, and packages use `vendor-completions`.
        ("zsh/site-functions/_ecmsk", "zsh/vendor-completions/_ecmsk"),
        ("fish/vendor_completions.d/ecmsk.fish", "fish/vendor_completions.d/ecmsk.fish"),
        ("ecmsk/wireshark/ecmsk.lua", "ecmsk/wireshark/ecmsk.lua"),
        ("ecmsk/grafana/ecmsk.json", "ecmsk/grafana/ecmsk.json"),
    ] {
        tree.copy(&share.join(from), &format!("usr/share/{to}"), DATA)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pkg_config_is_told_debians_folders() {
        let text = "prefix=${pcfiledir}/../..\nlibdir=${prefix}/lib\nincludedir=${prefix}/include\n\nName: x\n";
        let expected = "prefix=/usr\nlibdir=${prefix}/lib/x86_64-linux-gnu\nincludedir=${prefix}/include\n\nName: x\n";
        assert_eq!(pkgconfig(text, Machine::Amd64), expected);
    }

    /// Debian's rule for the name of a library package: the SONAME in lower case without `.so.`.
    #[test]
    fn the_package_of_the_library_has_the_name_of_its_soname() {
        let (name, number) = SONAME.split_once(".so.").unwrap();
        assert_eq!(LIBRARY, format!("{}{number}", name.to_lowercase()));
    }
}
