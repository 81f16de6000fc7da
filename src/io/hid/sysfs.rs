//! Information about a USB device that Linux provides in sysfs and /proc, besides the device's descriptors. Nothing is
//! sent to the device. On other systems all results are empty.

use std::fmt;
use std::fs;
use std::path::{Path, PathBuf};

/// Reads sysfs and /proc below a root folder, which is `/` except in tests.
#[derive(Clone, Debug)]
pub struct Sysfs {
    /// The folder in which `sys` and `proc` are; `None` on systems other than Linux.
    root: Option<PathBuf>,
}

/// A problem with the connection of a device that a user should know.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum DeviceWarning {
    /// The device does not run at high speed, 480 Mbit/s.
    Slow {
        /// The device's speed in Mbit/s; `None` if the system does not report it.
        mbit: Option<String>,
    },
    /// The kernel suspends the device while no program has it open (autosuspend).
    Autosuspend {
        /// The file in sysfs that switches autosuspend off.
        control: PathBuf,
    },
    /// The device's port has cut the power because of an over-current.
    OverCurrent {
        /// How many over-currents the port has had since its hub was connected.
        times: u32,
    },
}

impl fmt::Display for DeviceWarning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Slow { mbit } => {
                let speed = mbit.as_deref().map(|mbit| format!(" but at {mbit} Mbit/s")).unwrap_or_default();
                write!(
                    f,
                    "it does not run at high speed{speed}, too slow for a report in each cycle; plug it into another \
                     port, and not behind a hub of USB 1.1"
                )
            }
            Self::Autosuspend { control } => write!(
                f,
                "the system may put it to sleep while no program has it; `echo on | sudo tee {}` keeps it awake",
                control.display()
            ),
            Self::OverCurrent { times } => write!(
                f,
                "its port has cut the power, {times} times (over-current); plug it into a hub with a power supply of \
                 its own"
            ),
        }
    }
}

/// A process that has a device open.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DeviceHolder {
    /// The process id.
    pub pid: u32,
    /// The process's name; empty if it has just ended.
    pub name: String,
}

impl fmt::Display for DeviceHolder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.pid == std::process::id() {
            return write!(f, "this process");
        }
        write!(f, "{} (PID {})", self.name, self.pid)
    }
}

impl Sysfs {
    /// The system of this machine. Its files are read anew at each call.
    pub fn of_this_machine() -> Self {
        Self { root: cfg!(target_os = "linux").then(|| "/".into()) }
    }

    /// The serial number of the device at `path`, such as `1-2.3`; `None` if it has none, and on systems other than
    /// Linux.
    pub fn serial(&self, path: &str) -> Option<String> {
        self.attribute(path, "serial")
    }

    /// The product name of the device at `path`; `None` if it has none, and on systems other than Linux.
    pub fn name(&self, path: &str) -> Option<String> {
        self.attribute(path, "product")
    }

    /// Problems with the connection of the device at `path`: low speed, autosuspend, over-currents. `high_speed`:
    /// whether the device runs at 480 Mbit/s.
    pub fn warnings(&self, path: &str, high_speed: bool) -> Vec<DeviceWarning> {
        let mut remarks = Vec::new();
        if !high_speed {
            remarks.push(DeviceWarning::Slow { mbit: self.attribute(path, "speed") });
        }
        let never = self.attribute(path, "power/autosuspend_delay_ms").is_some_and(|delay| delay.starts_with('-'));
        if self.attribute(path, "power/control").as_deref() == Some("auto")
            && !never
            && let Some(device) = self.device(path)
        {
            remarks.push(DeviceWarning::Autosuspend { control: device.join("power/control") });
        }
        let times = self.over_currents(path);
        if times > 0 {
            remarks.push(DeviceWarning::OverCurrent { times });
        }
        remarks
    }

    /// How many times the port of the device at `path` has cut the power because of an over-current, since its hub was
    /// connected.
    pub fn over_currents(&self, path: &str) -> u32 {
        // The folder of a port is below its hub's interface: 1-2-port3 of hub 1-2, usb1-port2 of the root hub of bus 1.
        let (hub, interface, port) = match (path.rsplit_once('.'), path.split_once('-')) {
            (Some((hub, port)), _) => (hub.to_owned(), format!("{hub}:1.0"), port),
            (None, Some((bus, port))) => (format!("usb{bus}"), format!("{bus}-0:1.0"), port),
            (None, None) => return 0,
        };
        let count = self.attribute(&interface, &format!("{hub}-port{port}/over_current_count"));
        count.and_then(|count| count.parse().ok()).unwrap_or(0)
    }

    /// The processes that have the device with this bus number and address open. Only root can see processes of other
    /// users.
    pub fn holders(&self, (bus, address): (u8, u8)) -> Vec<DeviceHolder> {
        let node = PathBuf::from(format!("/dev/bus/usb/{bus:03}/{address:03}"));
        let processes = self.root.iter().flat_map(|root| fs::read_dir(root.join("proc"))).flatten().flatten();
        let mut holders: Vec<DeviceHolder> = processes
            .filter_map(|process| {
                let pid = process.file_name().to_str()?.parse().ok()?;
                let folder = process.path();
                let mut files = fs::read_dir(folder.join("fd")).ok()?.flatten();
                let holds = files.any(|file| fs::read_link(file.path()).is_ok_and(|target| target == node));
                holds.then(|| DeviceHolder { pid, name: first_line(&folder.join("comm")).unwrap_or_default() })
            })
            .collect();
        holders.sort_by_key(|holder| holder.pid);
        holders
    }

    fn device(&self, path: &str) -> Option<PathBuf> {
        Some(self.root.as_ref()?.join("sys/bus/usb/devices").join(path))
    }

    fn attribute(&self, path: &str, file: &str) -> Option<String> {
        first_line(&self.device(path)?.join(file))
    }
}

fn first_line(file: &Path) -> Option<String> {
    // The file is read as bytes, since a string descriptor of a device, such as its name, need not be UTF-8.
    let bytes = fs::read(file).ok()?;
    let text = String::from_utf8_lossy(&bytes).trim().to_owned();
    (!text.is_empty()).then_some(text)
}

#[cfg(all(test, unix))]
mod tests {
    use std::os::unix::fs::symlink;

    use super::*;

    struct Tree(tempfile::TempDir);

    impl Tree {
        fn new(files: &[(&str, &str)]) -> Self {
            let tree = Self(tempfile::tempdir().unwrap());
            for (path, text) in files {
                let path = tree.0.path().join(path);
                fs::create_dir_all(path.parent().unwrap()).unwrap();
                fs::write(path, text).unwrap();
            }
            tree
        }

        fn system(&self) -> Sysfs {
            Sysfs { root: Some(self.0.path().to_owned()) }
        }
    }

    /// WIRE-80 There are warnings for a device that is slow, may be suspended, or whose port has cut the power.
    #[test]
    fn what_starves_or_slows_a_board_is_remarked() {
        let tree = Tree::new(&[
            ("sys/bus/usb/devices/1-2.3/speed", "12\n"),
            ("sys/bus/usb/devices/1-2.3/power/control", "auto\n"),
            ("sys/bus/usb/devices/1-2.3/power/autosuspend_delay_ms", "2000\n"),
            ("sys/bus/usb/devices/1-2:1.0/1-2-port3/over_current_count", "4\n"),
        ]);
        let remarks = tree.system().warnings("1-2.3", false);
        let control = tree.0.path().join("sys/bus/usb/devices/1-2.3/power/control");
        let [slow, sleeps, starved] = &remarks[..] else { panic!("{remarks:?}") };
        assert_eq!(*slow, DeviceWarning::Slow { mbit: Some("12".into()) });
        assert!(slow.to_string().contains("at 12 Mbit/s") && slow.to_string().contains("another port"), "{slow}");
        assert_eq!(*sleeps, DeviceWarning::Autosuspend { control: control.clone() });
        assert!(sleeps.to_string().contains(&format!("echo on | sudo tee {}`", control.display())), "{sleeps}");
        assert_eq!(*starved, DeviceWarning::OverCurrent { times: 4 });
        assert!(starved.to_string().contains("power supply of its own"), "{starved}");
    }

    /// WIRE-80 A device without problems has no warnings. The files of a root hub's port are in another folder than
    /// those of a hub's port.
    #[test]
    fn a_board_without_trouble_has_no_remark() {
        let tree = Tree::new(&[
            ("sys/bus/usb/devices/1-2/speed", "480\n"),
            ("sys/bus/usb/devices/1-2/power/control", "on\n"),
            ("sys/bus/usb/devices/1-0:1.0/usb1-port2/over_current_count", "0\n"),
            ("sys/bus/usb/devices/1-0:1.0/usb1-port3/over_current_count", "1\n"),
            ("sys/bus/usb/devices/1-3/power/control", "auto\n"),
            ("sys/bus/usb/devices/1-3/power/autosuspend_delay_ms", "-1\n"),
        ]);
        assert_eq!(tree.system().warnings("1-2", true), []);
        assert_eq!(tree.system().warnings("1-3", true), [DeviceWarning::OverCurrent { times: 1 }], "it never sleeps");
        assert_eq!(Tree::new(&[]).system().warnings("1-2", true), [], "a system that says nothing");
    }

    /// LIB-46 A process with an open file descriptor of the device node is a holder of the device.
    #[test]
    fn holders_are_found_by_their_open_files() {
        let tree = Tree::new(&[
            ("proc/12/comm", "press\n"),
            ("proc/12/fd/0", ""),
            ("proc/900/comm", "other\n"),
            ("proc/900/fd/0", ""),
            ("proc/self/comm", "press\n"),
            ("proc/13/comm", "may not be looked into\n"),
        ]);
        let at = |place: &str| tree.0.path().join(place);
        symlink("/dev/bus/usb/001/005", at("proc/12/fd/9")).unwrap();
        symlink("/dev/bus/usb/001/006", at("proc/900/fd/3")).unwrap();
        symlink("/dev/bus/usb/001/005", at("proc/self/fd")).unwrap();
        let holders = tree.system().holders((1, 5));
        assert_eq!(holders, [DeviceHolder { pid: 12, name: "press".into() }]);
        assert_eq!(holders[0].to_string(), "press (PID 12)");
        assert_eq!(DeviceHolder { pid: std::process::id(), name: "test".into() }.to_string(), "this process");
        assert_eq!(tree.system().holders((2, 5)), []);
    }

    #[test]
    fn texts_of_a_device_are_shown_whatever_bytes_they_have() {
        let tree = Tree::new(&[("sys/bus/usb/devices/1-2/serial", "  \n")]);
        fs::write(tree.0.path().join("sys/bus/usb/devices/1-2/product"), b"ECM\xFF\n").unwrap();
        assert_eq!((tree.system().serial("1-2"), tree.system().name("1-2")), (None, Some("ECM\u{FFFD}".into())));
    }
}
