//! Tests Windows programs with a board on USB: under Wine in a guest system, so that Wine's HID code and the USB and HID code
//! of a real kernel take part.
//!
//! Kernel and modules are those of the wire tests (`rig`). The guest's root is the Debian system in which 32-bit programs run
//! on this machine. It is mounted read-only by 9p; changes stay in the guest's memory.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use super::files::{DLL, TOOL};
use super::{Width, build_width, folder, wine};
use crate::command;
use crate::error::Error;
use crate::project::Project;
use crate::rig::initrd::Archive;
use crate::rig::packages::Packages;
use crate::rig::programs::{build_test, stripped};
use crate::rig::qemu::{self, Machine};
use crate::rig::{kernel, modules, packages};
use crate::stage;

/// The group of tests of Windows programs on boards on USB, which runs in a guest system.
const TESTS: &str = "windows_usb";
/// The C programs that these tests run: one for these tests, two that run on any link, and a bench.
const PROGRAMS: [&str; 4] =
    ["tests/windows/usb/board.c", "tests/windows/programs/terminated.c", "tests/c/reset.c", "benches/windows/usb.c"];
/// The arguments of the test program that select the bench.
const BENCH: [&str; 3] = ["speed::", "--ignored", "--nocapture"];
/// Test filters that split the tests into two halves of about equal time: 64-bit programs take longer.
const HALF: [&[&str]; 2] =
    [&["boards::x64::", "--skip=boards::x64::a_reset_board"], &["boards::x86::", "boards::x64::a_reset_board"]];
/// The kernel modules that the guest loads: USB HID, the virtual host controller of USB/IP, and 9p for folders of this machine.
const MODULES: [&str; 7] = ["vhci-hcd", "usbhid", "hid-generic", "virtio_pci", "9pnet_virtio", "9p", "overlay"];
const MEMORY_MB: u32 = 2048;

/// Settings in Wine's registry: it uses hidraw devices and not SDL. If SDL were enabled but missing, Wine would stop searching
/// for devices.
const REGISTRY: &str = "REGEDIT4\n\n[HKEY_LOCAL_MACHINE\\System\\CurrentControlSet\\Services\\winebus]\n\
                        \"Enable SDL\"=dword:00000000\n\"DisableInput\"=dword:00000001\n\
                        \"DisableHidraw\"=dword:00000000\n";

/// The first program (init) of the guest in which Windows programs run. `@MODULES@` is replaced by the kernel modules in
/// the order of loading, `@PREFIX@` by the folder of Wine's prefix. Wine learns from the udev daemon that a board comes or
/// goes.
const INIT: &str = r#"#!/bin/busybox sh
/bin/busybox --install -s /bin
export PATH=/bin
mount -t proc proc /proc
mount -t sysfs sysfs /sys
mount -t devtmpfs dev /dev
for module in @MODULES@; do insmod "/modules/$module" || echo "insmod $module failed"; done
mkdir -p /lower /upper /new
p9="ro,trans=virtio,version=9p2000.L,msize=524288,cache=loose"
mount -t 9p -o "$p9" root /lower
mount -t tmpfs tmpfs /upper
mkdir /upper/over /upper/work
mount -t overlay -o lowerdir=/lower,upperdir=/upper/over,workdir=/upper/work overlay /new
mkdir -p /new/rig
mount -t 9p -o "$p9" rig /new/rig
for place in proc sys dev; do mount --move "/$place" "/new/$place"; done
mkdir -p /new/dev/shm
for place in tmp run dev/shm; do mount -t tmpfs tmpfs "/new/$place"; done
ifconfig lo up
exec </new/dev/null 2>&1
chroot /new /lib/systemd/systemd-udevd --daemon
echo "GUEST-BEGIN $(uname -r)"
export HOME=/@PREFIX@ WINEPREFIX=/@PREFIX@ WINEDEBUG=-all WINEDLLOVERRIDES='mscoree,mshtml='
export PATH=/usr/sbin:/usr/bin:/sbin:/bin
chroot /new wineserver -p
chroot /new wine cmd.exe /c exit >/new/dev/null
chroot /new /rig/tests --test-threads=1 --color=never $*
code=$?
echo "GUEST-END rc=$code"
# The code goes to isa-debug-exit; poweroff is for a QEMU without it.
printf "\\x$(printf %02x $code)" | /bin/dd of=/new/dev/port bs=1 seek=244 count=1 2>/new/dev/null
/bin/poweroff -f
"#;

/// Whether a test with this name runs in the guest: its name begins with the module `boards`.
pub fn takes(name: &str) -> bool {
    name.starts_with("boards::")
}

/// Runs the tests in the guest: those whose names contain one of `names`, or all.
pub fn test(project: &Project, names: &[String]) -> Result<(), Error> {
    let guest = Guest::prepare(project)?;
    let said = if names.is_empty() { guest.run_two(HALF)? } else { guest.run(names, qemu::is_result)? };
    if said.iter().any(|line| line == "running 0 tests") {
        return Err(Error::NoTest { names: names.join(" ") });
    }
    Ok(())
}

/// Measures the DLLs on a board on USB in the guest; returns the output of the bench.
pub fn bench(project: &Project) -> Result<String, Error> {
    let said = Guest::prepare(project)?.run(&BENCH.map(str::to_owned), |line| line.starts_with('{'))?;
    Ok(said.join("\n"))
}

/// The files from which QEMU boots a guest, and the folders that the guest mounts.
struct Guest {
    kernel: PathBuf,
    initrd: PathBuf,
    root: PathBuf,
    share: PathBuf,
    folder: PathBuf,
}

impl Guest {
    fn prepare(project: &Project) -> Result<Self, Error> {
        let folder = folder(project).join("usb");
        fs::create_dir_all(&folder).map_err(Error::file("make", &folder))?;
        let rig = project.target.join("xtask/rig");
        let packages = packages::fetch(&rig)?;
        let kernel = kernel::unpack(&packages, &rig)?;
        let root = set_up_root(project)?;
        let share = share(project, &folder)?;
        let initrd = pack(&packages, &folder)?;
        println!("running Windows programs in a guest system, some minutes on two free cores");
        Ok(Self { kernel, initrd, root, share, folder })
    }

    /// Runs a guest with `words` as arguments of its test program; returns its output.
    fn run(&self, words: &[String], is_shown: fn(&str) -> bool) -> Result<Vec<String>, Error> {
        self.with_machine(|machine| qemu::boot(machine, words, &self.folder.join("console.log"), is_shown))
    }

    /// Runs two guests at the same time, each with one set of arguments of its test program, because a guest uses only one
    /// processor. Returns the output of both.
    fn run_two(&self, words: [&[&str]; 2]) -> Result<Vec<String>, Error> {
        self.with_machine(|machine| qemu::boot_two(machine, words, &self.folder, qemu::is_result))
    }

    fn with_machine<T>(&self, call: impl FnOnce(&Machine<'_>) -> T) -> T {
        let folders = [("root", self.root.as_path()), ("rig", self.share.as_path())];
        call(&Machine { kernel: &self.kernel, initrd: &self.initrd, memory_mb: MEMORY_MB, folders: &folders })
    }
}

/// Sets up the Debian system with Wine of both widths, and Wine's registry.
fn set_up_root(project: &Project) -> Result<PathBuf, Error> {
    let wine = wine::set_up(project, Width::X86)?;
    let known = wine.programs.join("winebus.reg");
    if fs::read_to_string(&known).ok().as_deref() != Some(REGISTRY) {
        let new = wine.programs.join("winebus.new.reg");
        fs::write(&new, REGISTRY).map_err(Error::file("write", &new))?;
        wine.run(".", &["regedit.exe", "/S", "winebus.new.reg"])?;
        // The settings get their final file name only after Wine has read them, so that the next run reads them again if this
        // one is interrupted before.
        fs::rename(&new, &known).map_err(Error::file("rename", &new))?;
    }
    // Wine writes its registry to disk when its server ends. Dropping `wine` on return ends the server.
    Ok(wine.root())
}

/// Fills the folder that the guest mounts as `/rig`: the tests and the Linux tool, and for each width the programs, the DLL and
/// the tool.
fn share(project: &Project, folder: &Path) -> Result<PathBuf, Error> {
    let (stage, share) = (super::folder(project).join("stage"), folder.join("share"));
    packages::empty(&share)?;
    for width in Width::ALL {
        build_width(project, width, &stage)?;
        let place = share.join(width.name());
        fs::create_dir_all(&place).map_err(Error::file("make", &place))?;
        for file in [DLL, TOOL] {
            let built = stage.join(width.name()).join(file);
            fs::copy(&built, place.join(file)).map_err(Error::file("copy", &built))?;
        }
        for source in PROGRAMS.map(|source| project.root.join(source)) {
            let program = place.join(source.file_stem().unwrap_or_default()).with_extension("exe");
            let mut gcc = Command::new(format!("{}-gcc-posix", width.mingw()));
            gcc.args(["-std=gnu99", "-O1", "-Wall", "-Wextra", "-Werror", "-static"]);
            for include in [stage.join("include"), project.root.join("tests/c")] {
                gcc.arg("-I").arg(include);
            }
            gcc.arg(source).arg("-o").arg(program).arg("-L").arg(stage.join(width.name())).args([
                "-lNEXTWUSBLib",
                "-lhid",
                "-lsetupapi",
            ]);
            command::run(&mut gcc)?;
        }
    }
    stripped(&stage::build_tool(project)?, &share.join("ecmsk"))?;
    stripped(&build_test(project, TESTS)?, &share.join("tests"))?;
    Ok(share)
}

/// Packs the initial RAM file system of the guest.
fn pack(packages: &Packages, folder: &Path) -> Result<PathBuf, Error> {
    let mut archive = Archive::default();
    for empty in ["proc", "sys", "dev"] {
        archive.folder(empty);
    }
    archive.copy("bin/busybox", &packages.root.join("bin/busybox"))?;
    let order = modules::in_order(&packages.root.join("lib/modules").join(&packages.release), &MODULES)?;
    let mut names = Vec::new();
    for module in &order {
        let name = module.file_name().unwrap_or_default().to_string_lossy().into_owned();
        archive.copy(&format!("modules/{name}"), module)?;
        names.push(name);
    }
    let init = INIT.replace("@MODULES@", &names.join(" ")).replace("@PREFIX@", wine::PREFIX);
    archive.file("init", 0o755, init.as_bytes());
    let initrd = folder.join("initrd");
    fs::write(&initrd, archive.finish()).map_err(Error::file("write", &initrd))?;
    Ok(initrd)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_program_can_be_read_by_a_shell() {
        assert!(command::succeeds(Command::new("sh").args(["-n", "-c", INIT])));
    }
}
