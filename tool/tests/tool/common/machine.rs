//! A machine made of files: the contents of `/sys`, `/proc` and `/dev` below a folder.

use std::fs;
use std::os::fd::AsRawFd;
use std::os::unix::fs::{PermissionsExt, symlink};
use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::Command;
use std::sync::OnceLock;

use serde_json::Value;
use tempfile::TempDir;

use super::{Ran, ecmsk, json_lines};

/// The USB descriptors of a board (SK-9): one HID interface, interrupt endpoints 0x81 and 0x02 of 512 bytes.
#[rustfmt::skip]
pub const BOARD: [u8; 59] = [
    18, 1, 0x00, 0x02, 0, 0, 0, 64, 0xC0, 0x16, 0xDF, 0x05, 0x00, 0x01, 1, 2, 3, 1,
    9, 2, 41, 0, 1, 1, 0, 0x80, 50,
    9, 4, 0, 0, 2, 3, 0, 0, 0,
    9, 0x21, 0x11, 0x01, 0, 1, 0x22, 26, 0,
    7, 5, 0x81, 3, 0x00, 0x02, 1,
    7, 5, 0x02, 3, 0x00, 0x02, 1,
];

/// A relay card with the board's ids: a HID interface with one endpoint of 8 bytes.
#[rustfmt::skip]
pub const RELAY: [u8; 52] = [
    18, 1, 0x10, 0x01, 0, 0, 0, 8, 0xC0, 0x16, 0xDF, 0x05, 0x00, 0x01, 1, 2, 0, 1,
    9, 2, 34, 0, 1, 1, 0, 0x80, 10,
    9, 4, 0, 0, 1, 3, 0, 0, 0,
    9, 0x21, 0x01, 0x01, 0, 1, 0x22, 22, 0,
    7, 5, 0x81, 3, 0x08, 0x00, 10,
];

/// The id of a user without rights: nobody.
const NOBODY: u32 = 65534;

/// A machine made of files: a folder that stands for `/`, for the hidden option `--root` of the tool.
pub struct FakeMachine {
    folder: TempDir,
}

impl FakeMachine {
    /// A machine with USB and nothing else.
    pub fn bare() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        fs::set_permissions(folder.path(), fs::Permissions::from_mode(0o755)).expect("our own folder");
        let tree = Self { folder };
        tree.dir("/sys/bus/usb/devices");
        tree.dir("/etc/udev/rules.d");
        tree.file("/proc/sys/kernel/osrelease", "6.1.0-test\n");
        tree.file(
            "/proc/self/limits",
            "Limit                     Soft Limit           Hard Limit           Units     \n\
             Max locked memory         unlimited            unlimited            bytes     \n\
             Max realtime priority     90                   90                   \n",
        );
        tree.file("/proc/self/status", "Name:\tecmsk\nCapEff:\t0000000000000000\n");
        tree
    }

    /// Makes a machine without faults: a board at USB path 1-1, an SPI device with its GPIO lines, and rights for all of it.
    pub fn good() -> Self {
        let tree = Self::bare();
        tree.board("1-1", 4, "7");
        tree.spi("spidev0.0");
        tree.file("/usr/lib/x86_64-linux-gnu/libusb-1.0.so.0", "");
        tree.file("/sys/module/spidev/parameters/bufsiz", "4096\n");
        tree.file("/sys/module/spidev/initstate", "live\n");
        tree.file("/sys/bus/gpio/devices/gpiochip0/of_node/gpio-line-names", "ID_SDA\0\0-\0BUSY\0RESET\0");
        tree.file("/dev/gpiochip0", "");
        tree.file("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor", "performance\n");
        tree.file("/sys/devices/system/cpu/cpu1/cpufreq/scaling_governor", "performance\n");
        let rule = fs::read(support::root().join("share/udev/60-ecmsk.rules")).expect("the rule");
        tree.file("/etc/udev/rules.d/60-ecmsk.rules", rule);
        tree
    }

    /// Adds a network card that is up, with a link.
    pub fn card(&self, name: &str, index: u8, driver: &str) {
        let folder = format!("/sys/class/net/{name}");
        for (file, value) in [
            ("type", "1".to_owned()),
            ("flags", "0x1003".to_owned()),
            ("ifindex", index.to_string()),
            ("address", format!("00:1b:21:00:00:{index:02x}")),
            ("carrier", "1".to_owned()),
            ("speed", "1000".to_owned()),
        ] {
            self.file(&format!("{folder}/{file}"), format!("{value}\n"));
        }
        self.link(&format!("{folder}/device/driver"), &format!("../../../bus/pci/drivers/{driver}"));
        self.link(&format!("{folder}/device/subsystem"), "../../../bus/pci");
    }

    /// Gives this process the capability CAP_NET_RAW, so that it may send raw frames.
    pub fn allow_raw_frames(&self) {
        self.file("/proc/self/status", "Name:\tecmsk\nCapEff:\t0000000000002000\n");
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name.trim_start_matches('/'))
    }

    pub fn dir(&self, name: &str) {
        fs::create_dir_all(self.path(name)).expect("a folder");
    }

    pub fn file(&self, name: &str, content: impl AsRef<[u8]>) {
        let path = self.path(name);
        fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
        fs::write(&path, content).expect("a file");
        fs::set_permissions(path, fs::Permissions::from_mode(0o666)).expect("our own file");
    }

    pub fn link(&self, name: &str, target: &str) {
        let path = self.path(name);
        fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
        symlink(target, path).expect("a link");
    }

    pub fn remove(&self, name: &str) {
        let path = self.path(name);
        if path.is_dir() { fs::remove_dir_all(path) } else { fs::remove_file(path) }.expect("it is there");
    }

    /// Takes all rights to a file of the machine from everybody but root.
    pub fn deny(&self, name: &str) {
        fs::set_permissions(self.path(name), fs::Permissions::from_mode(0o000)).expect("our own file");
    }

    /// Sets an attribute of a USB device.
    pub fn usb(&self, path: &str, name: &str, value: &str) {
        self.file(&format!("/sys/bus/usb/devices/{path}/{name}"), format!("{value}\n"));
    }

    /// Adds a USB device with the board's vendor and product id and these descriptors at the USB path `path`, as device number
    /// `device` on bus 1.
    pub fn device(&self, path: &str, device: u16, descriptors: &[u8]) {
        for (name, value) in [
            ("idVendor", "16c0"),
            ("idProduct", "05df"),
            ("busnum", "1"),
            ("speed", "480"),
            ("bConfigurationValue", "1"),
            ("bMaxPower", "100mA"),
            ("authorized", "1"),
            ("power/control", "on"),
            ("power/autosuspend_delay_ms", "2000"),
            ("power/runtime_status", "active"),
            ("port/over_current_count", "0"),
        ] {
            self.usb(path, name, value);
        }
        self.usb(path, "devnum", &device.to_string());
        self.file(&format!("/sys/bus/usb/devices/{path}/descriptors"), descriptors);
        self.link(&format!("/sys/bus/usb/devices/{path}/driver"), "../../bus/usb/drivers/usb");
        self.driver(path, "usbhid");
        self.file(&format!("/dev/bus/usb/001/{device:03}"), "");
    }

    /// Adds a board on USB at the USB path `path`, with this device number and serial number.
    pub fn board(&self, path: &str, device: u16, serial: &str) {
        self.device(path, device, &BOARD);
        for (name, value) in [("product", "ECM-SK"), ("serial", serial), ("manufacturer", "NEXTW")] {
            self.usb(path, name, value);
        }
        let hid = format!("0003:16C0:05DF.{device:04X}");
        self.dir(&format!("/sys/bus/usb/devices/{path}:1.0/{hid}/hidraw/hidraw{device}"));
        self.file(&format!("/dev/hidraw{device}"), "");
    }

    /// Sets the kernel driver of the interface of a USB device.
    pub fn driver(&self, path: &str, name: &str) {
        let link = format!("/sys/bus/usb/devices/{path}:1.0/driver");
        let _ = fs::remove_file(self.path(&link));
        self.link(&link, &format!("../../../bus/usb/drivers/{name}"));
    }

    /// Adds a USB hub at the USB path `path`. `attributes` says whether it has a power supply of its own.
    pub fn hub(&self, path: &str, attributes: &str) {
        for (name, value) in [("idVendor", "05e3"), ("idProduct", "0608"), ("bmAttributes", attributes)] {
            self.usb(path, name, value);
        }
    }

    pub fn spi(&self, name: &str) {
        self.dir(&format!("/sys/class/spidev/{name}"));
        self.file(&format!("/dev/{name}"), "");
    }

    /// Adds a process with this id and name that has the file open.
    pub fn process(&self, pid: u32, program: &str, file: &str) {
        self.file(&format!("/proc/{pid}/comm"), format!("{program}\n"));
        self.link(&format!("/proc/{pid}/fd/0"), "/dev/null");
        self.link(&format!("/proc/{pid}/fd/5"), file);
    }

    /// The tool on this machine, as a user without rights, with no link named.
    pub fn tool(&self, arguments: &[&str]) -> Command {
        let mut command = self.tool_of_us(arguments);
        if rustix::process::geteuid().is_root() {
            let (mut as_nobody, program) = (Command::new(open_tool()), command);
            as_nobody.args(program.get_args()).stdin(std::process::Stdio::null());
            for (name, value) in program.get_envs() {
                match value {
                    Some(value) => as_nobody.env(name, value),
                    None => as_nobody.env_remove(name),
                };
            }
            as_nobody.uid(NOBODY).gid(NOBODY);
            command = as_nobody;
        }
        command
    }

    /// The tool on this machine, as the user of the test.
    pub fn tool_of_us(&self, arguments: &[&str]) -> Command {
        let mut command = ecmsk(arguments);
        command.arg("--root").arg(self.folder.path());
        command.env("HOME", self.path("/home/user")).env_remove("XDG_CONFIG_HOME");
        command
    }

    pub fn run(&self, arguments: &[&str]) -> Ran {
        self.tool(arguments).output().expect("the tool starts").into()
    }

    /// The findings of the tool for a link.
    pub fn doctor(&self, link: &str) -> Vec<Value> {
        let mut command = self.tool(&["doctor", "--quick", "--json"]);
        let ran = Ran::from(command.env("ECMSK_LINK", link).output().expect("the tool starts"));
        assert!(matches!(ran.code, Some(0 | 1)) && ran.err.is_empty(), "{ran:?}");
        json_lines(&ran.out)
    }

    /// The finding of one check for a link.
    pub fn finding(&self, link: &str, check: &str) -> Value {
        let mut found = self.doctor(link).into_iter().filter(|finding| finding["check"] == check);
        let one = found.next().unwrap_or_else(|| panic!("nothing is said of {check}"));
        assert!(found.next().is_none(), "{check} is said twice");
        one
    }

    /// The names of all files of the machine.
    pub fn files(&self) -> Vec<String> {
        let mut files = Vec::new();
        let mut folders = vec![self.folder.path().to_owned()];
        while let Some(folder) = folders.pop() {
            for entry in fs::read_dir(folder).expect("our own folder") {
                let path = entry.expect("an entry").path();
                if path.symlink_metadata().is_ok_and(|data| data.is_dir()) {
                    folders.push(path);
                } else {
                    let name = path.strip_prefix(self.folder.path()).expect("it is below");
                    files.push(format!("/{}", name.to_str().expect("UTF-8")));
                }
            }
        }
        files.sort();
        files
    }
}

/// The lines of the block of docs/TOOL-NETWORK.md that begins with `start`.
pub fn page_block(start: &str) -> Vec<String> {
    let page = fs::read_to_string(support::root().join("docs/TOOL-NETWORK.md")).expect("the page");
    let block = support::console::blocks(&page, "text").find(|block| block.starts_with(start)).expect("the block");
    block.lines().map(str::to_owned).collect()
}

/// A path to the open file of the tool, so that users who may not enter the target folder can execute it.
fn open_tool() -> PathBuf {
    static TOOL: OnceLock<fs::File> = OnceLock::new();
    let tool = TOOL.get_or_init(|| {
        let file = fs::File::open(env!("CARGO_BIN_EXE_ecmsk")).expect("the tool");
        rustix::io::fcntl_setfd(&file, rustix::io::FdFlags::empty()).expect("children inherit it");
        file
    });
    PathBuf::from(format!("/proc/self/fd/{}", tool.as_raw_fd()))
}
