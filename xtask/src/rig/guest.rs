//! Packs the root file system of the guest.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use super::initrd::Archive;
use super::packages::Packages;
use super::programs::{self, Programs};
use super::{modules, packages};
use crate::error::Error;

/// The kernel modules that the guest loads at its start: the virtual host controller of USB/IP, USB HID, and the capture of USB
/// traffic.
const MODULES: [&str; 4] = ["vhci-hcd", "usbhid", "hid-generic", "usbmon"];

/// The kernel modules for a USB device made by the guest itself: a device controller that is connected to the guest's own host,
/// and FunctionFS. Only tests that need them load them, because captures of all buses would show that controller.
const GADGET_MODULES: [&str; 2] = ["dummy_hcd", "usb_f_fs"];
/// The file in the guest with the names of [`GADGET_MODULES`] and their dependencies, in the order of loading.
const GADGET_ORDER: &str = "modules/gadget";

/// The libraries that the link `usb:` loads at run time.
const LOADED: [&str; 2] = ["libusb-1.0.so.0", "libudev.so.1"];

/// The guest's first program (init). `@` is replaced by the kernel modules in the order of loading, `COMMAND` by the program to
/// run.
const INIT: &str = r#"#!/bin/busybox sh
/bin/busybox --install -s /bin
export PATH=/bin:/rig
mount -t proc proc /proc
mount -t sysfs sysfs /sys
mount -t devtmpfs dev /dev
for module in @; do insmod "/modules/$module" || echo "insmod $module failed"; done
ifconfig lo up
echo "GUEST-BEGIN $(uname -r)"
cd /tmp
# One heap for all threads, and nothing freed is kept apart: a test looks whether it grows.
export GLIBC_TUNABLES=glibc.malloc.arena_max=1:glibc.malloc.tcache_count=0
COMMAND $* 2>&1
code=$?
echo "GUEST-END rc=$code"
# The code goes to isa-debug-exit; poweroff is for a QEMU without it.
printf "\\x$(printf %02x $code)" | dd of=/dev/port bs=1 seek=244 count=1 2>/dev/null
poweroff -f
"#;

/// Packs the guest's root into an archive for the kernel (initrd); returns its path. `board` is the kernel module that
/// behaves as a board on SPI, `command` the program to run.
pub fn pack(
    packages: &Packages,
    board: &Path,
    command: &str,
    programs: &Programs,
    folder: &Path,
) -> Result<PathBuf, Error> {
    let mut archive = Archive::default();
    for empty in ["proc", "sys", "dev", "tmp", "var", "run"] {
        archive.folder(empty);
    }
    // The program usbip stores its state below /var/run.
    archive.link("var/run", "/run");
    archive.copy("bin/busybox", &packages.root.join("bin/busybox"))?;

    let modules = packages.root.join("lib/modules").join(&packages.release);
    let mut order = modules::in_order(&modules, &MODULES)?;
    // The guest loads the modules in the order of this list, each after those that it depends on. The module of the board on
    // SPI depends on none of them, so it can come last.
    order.push(board.to_owned());
    let names = pack_modules(&mut archive, &order)?;
    let mut gadget = modules::in_order(&modules, &GADGET_MODULES)?;
    gadget.retain(|module| !order.contains(module));
    let gadget = pack_modules(&mut archive, &gadget)?;
    archive.file(GADGET_ORDER, 0o644, gadget.join("\n").as_bytes());
    let init = INIT.replace('@', &names.join(" ")).replace("COMMAND", command);
    archive.file("init", 0o755, init.as_bytes());

    let stripped = folder.join("stripped");
    packages::empty(&stripped)?;
    let mut libraries = BTreeSet::new();
    for (number, (name, program)) in programs.iter().enumerate() {
        let small = stripped.join(number.to_string());
        programs::stripped(program, &small)?;
        archive.copy(&format!("rig/{name}"), &small)?;
        libraries.extend(programs::libraries(program)?);
    }
    for (place, library) in packages.libraries(&LOADED)? {
        libraries.extend(programs::libraries(&library)?);
        archive.copy(&place, &library)?;
        libraries.extend(programs::libraries(&library)?);
    }
    for library in libraries {
        archive.copy(library.to_string_lossy().trim_start_matches('/'), &library)?;
    }

    // The archive contains the stripped programs, so their folder is not needed any more.
    fs::remove_dir_all(&stripped).map_err(Error::file("remove", &stripped))?;

    let initrd = folder.join("initrd");
    fs::write(&initrd, archive.finish()).map_err(Error::file("write", &initrd))?;
    Ok(initrd)
}

/// Adds kernel modules to the archive; returns their file names.
fn pack_modules(archive: &mut Archive, modules: &[PathBuf]) -> Result<Vec<String>, Error> {
    let mut names = Vec::new();
    for module in modules {
        let name = module.file_name().unwrap_or_default().to_string_lossy().into_owned();
        archive.copy(&format!("modules/{name}"), module)?;
        names.push(name);
    }
    Ok(names)
}
