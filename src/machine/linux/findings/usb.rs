//! Judges boards on USB: why one cannot be opened, and what makes it slow.

use super::{Finding, Machine};
use crate::address::keys::Scheme;
use crate::address::uri::LinkUri;
use crate::machine::Access;
use crate::machine::holders::Holders;
use crate::machine::udev::{RELOAD, Rule};
use crate::machine::usb::UsbDevice;

/// The file name of the library that the link `usb:` loads.
const LIBUSB: &str = "libusb-1.0.so.0";
/// The kernel's driver for HID devices.
const HID: &str = "usbhid";
/// The driver name that the kernel shows while a program uses the device by libusb.
const PROGRAM: &str = "usbfs";
/// The driver that exports a device to another machine by USB/IP.
const EXPORTED: &str = "usbip-host";

impl Machine {
    pub(super) fn usb_findings(&self, wanted: Option<&LinkUri>) -> Vec<Finding> {
        let wanted = wanted.filter(|link| link.scheme() == Scheme::Usb);
        let devices = self.usb_devices();
        let (boards, others): (Vec<_>, Vec<_>) = devices.into_iter().partition(|device| device.interface.is_ok());
        let mut all = vec![self.presence(&boards, &others, wanted)];
        let rule = self.udev_rule();
        let files: Vec<String> = boards.iter().flat_map(UsbDevice::files).collect();
        let holders = self.holders(&files);
        for board in &boards {
            all.extend(self.board_findings(board, &holders, &rule));
        }
        all.push(rule_finding(&rule));
        all.push(self.libusb(wanted.is_some()));
        all
    }

    /// The results of all checks of one board. Reasons why it cannot be opened come first.
    pub fn board_findings(&self, board: &UsbDevice, holders: &Holders, rule: &Rule) -> Vec<Finding> {
        let all = [
            configured(board),
            self.permission(board, rule),
            held(board, holders),
            speed(board),
            sleep(board),
            hub(board),
        ];
        all.into_iter().map(|finding| finding.of(&board.path)).collect()
    }

    fn presence(&self, boards: &[UsbDevice], others: &[UsbDevice], wanted: Option<&LinkUri>) -> Finding {
        const CHECK: &str = "usb";
        let key = |name| wanted.and_then(|link| link.value(name));
        let fits = |board: &&UsbDevice| {
            key("serial").is_none_or(|serial| board.serial.as_deref() == Some(serial))
                && key("path").is_none_or(|path| board.path == path)
        };
        let list = |devices: &mut dyn Iterator<Item = &UsbDevice>| {
            let shown = devices.map(|device| match device.shown() {
                Some(name) => format!("{} ({name})", device.path),
                None => device.path.clone(),
            });
            shown.collect::<Vec<_>>().join(", ")
        };
        let fitting: Vec<&UsbDevice> = boards.iter().filter(fits).collect();
        // Like the link `usb:`, this skips boards that are not configured if another board is configured.
        let on: Vec<&UsbDevice> = fitting.iter().copied().filter(|board| board.configured).collect();
        let fitting = if on.is_empty() { fitting } else { on };
        match (&fitting[..], boards) {
            ([board], _) => Finding::fine(CHECK, format!("board at {}", list(&mut [*board].into_iter()))),
            ([first, _, ..], _) => Finding::wrong_if(
                wanted.is_some(),
                CHECK,
                format!("{} boards: {}", fitting.len(), list(&mut fitting.iter().copied())),
                format!("choose one, e.g. ECMSK_LINK='{}'", first.link()),
            ),
            ([], [_, ..]) => Finding::wrong(
                CHECK,
                format!("no board as the link wants it, but {}", list(&mut boards.iter())),
                "correct path= or serial= of the link",
            ),
            ([], []) if !self.has_usb() => {
                let next = "use a machine with USB, or its kernel module usbcore";
                Finding::wrong_if(wanted.is_some(), CHECK, "this machine has no USB", next)
            }
            ([], []) => {
                let but = match others {
                    [] => String::new(),
                    _ => format!(", only other devices with its ids: {}", list(&mut others.iter())),
                };
                let next = "plug it in, set CONFIG0 to USB, and give it power enough; without one simulate: \
                            --link 'sim:?slaves=drive*2'";
                Finding::wrong_if(wanted.is_some(), CHECK, format!("no board{but}"), next)
            }
        }
    }

    /// The finding on libusb, which the link `usb:` loads: whether it is installed, and where.
    fn libusb(&self, wanted: bool) -> Finding {
        const CHECK: &str = "libusb";
        match self.library(LIBUSB) {
            Some(file) => Finding::fine(CHECK, file),
            None if wanted => Finding::advice(
                CHECK,
                format!("no {LIBUSB} where libraries usually are"),
                "sudo apt-get install libusb-1.0-0, unless it is somewhere else",
            ),
            None => Finding::fine(CHECK, format!("no {LIBUSB} where libraries usually are")),
        }
    }

    fn permission(&self, board: &UsbDevice, rule: &Rule) -> Finding {
        const CHECK: &str = "usb-permission";
        let Some(node) = &board.node else {
            let next = "pull it and plug it in again";
            return Finding::wrong(CHECK, "the kernel does not say where it is", next).blocking();
        };
        match self.access(node) {
            Access::Granted => Finding::fine(CHECK, format!("this user may open {node}")),
            Access::Missing => Finding::wrong(
                CHECK,
                format!("there is no {node}"),
                "give this container or chroot /dev/bus/usb, or start udev",
            )
            .blocking(),
            Access::Denied => Finding::wrong(CHECK, format!("this user may not open {node}"), allow(rule)).blocking(),
        }
    }
}

/// The next step for a user who may not open a board.
fn allow(rule: &Rule) -> String {
    match rule {
        Rule::None => "sudo ecmsk doctor --write-udev-rule".to_owned(),
        Rule::Ours(file) | Rule::OtherVersion(file) | Rule::Other(file) => format!(
            "{file} is there: plug the board in again, or sudo {}; who is logged in over the network has to be in the \
             rule's group: sudo usermod -aG plugdev $USER, then log in again",
            RELOAD.join(" && sudo ")
        ),
    }
}

fn rule_finding(rule: &Rule) -> Finding {
    const CHECK: &str = "udev-rule";
    match rule {
        Rule::Ours(file) => Finding::fine(CHECK, file),
        Rule::Other(file) => Finding::fine(CHECK, format!("{file}, not ours")),
        Rule::OtherVersion(file) => Finding::advice(
            CHECK,
            format!("{file} is not that of this version"),
            format!("sudo rm {file} && sudo ecmsk doctor --write-udev-rule"),
        ),
        Rule::None => {
            Finding::advice(CHECK, "none: root alone may open a board on USB", "sudo ecmsk doctor --write-udev-rule")
        }
    }
}

fn configured(board: &UsbDevice) -> Finding {
    const CHECK: &str = "usb-configuration";
    if !board.authorized {
        let next = format!("echo 1 | sudo tee /sys/bus/usb/devices/{}/authorized, or a rule of USBGuard", board.path);
        return Finding::wrong(CHECK, "this machine does not allow the device", next).blocking();
    }
    if !board.configured {
        let power = board.max_power.as_ref().map_or(String::new(), |power| format!(" (it asks for {power})"));
        return Finding::wrong(
            CHECK,
            format!("the kernel has not switched it on: its port does not give the power{power}"),
            "plug it into a port of the machine, or into a hub with a power supply",
        )
        .blocking();
    }
    Finding::fine(CHECK, "switched on by the kernel")
}

fn held(board: &UsbDevice, holders: &Holders) -> Finding {
    const CHECK: &str = "usb-holder";
    let driver = |wanted: &str| board.drivers.iter().find(|driver| driver.name == wanted);
    if driver(EXPORTED).is_some() {
        let next = format!("sudo usbip unbind -b {}", board.path);
        return Finding::wrong(CHECK, "it is given to another machine by usbip", next).blocking();
    }
    let held = holders.of(&board.files());
    if !held.is_empty() {
        let found = format!("another program has it: {}", held.join(", "));
        return Finding::wrong(CHECK, found, "end that program, or share the board by `ecmsk serve tcp`").blocking();
    }
    if driver(PROGRAM).is_some() {
        let next = "sudo ecmsk doctor names it; end it, or share the board by `ecmsk serve tcp`";
        return Finding::wrong(CHECK, "a program that this user cannot see has it", next).blocking();
    }
    let hidden = match holders.hidden {
        0 => String::new(),
        1 => ", as far as this user sees (1 process hidden)".to_owned(),
        n => format!(", as far as this user sees ({n} processes hidden)"),
    };
    let names: Vec<&str> = board.drivers.iter().map(|driver| driver.name.as_str()).collect();
    match names[..] {
        [] => Finding::fine(CHECK, format!("nobody has it{hidden}")),
        [HID] => {
            Finding::fine(CHECK, format!("no program has it{hidden}; usb: takes it from the driver {HID} while open"))
        }
        _ => Finding::fine(CHECK, format!("no program has it{hidden}; usb: takes it from {}", names.join(", "))),
    }
}

fn speed(board: &UsbDevice) -> Finding {
    const CHECK: &str = "usb-speed";
    match &board.speed {
        Some(_) if board.is_high_speed() => Finding::fine(CHECK, "high speed (480 Mbit/s)"),
        Some(speed) => Finding::wrong(
            CHECK,
            format!("{speed} Mbit/s, not high speed (480)"),
            "plug it into another port with another cable, and not behind a hub of USB 1.1",
        ),
        None => Finding::wrong(CHECK, "not known: the kernel does not say", "pull it and plug it in again"),
    }
}

fn sleep(board: &UsbDevice) -> Finding {
    const CHECK: &str = "usb-autosuspend";
    let sleep = &board.autosuspend;
    if !sleep.may_sleep() {
        return Finding::fine(CHECK, "stays awake");
    }
    let now = if sleep.status.as_deref() == Some("suspended") { ", and sleeps now" } else { "" };
    let after = sleep.delay_ms.map_or(String::new(), |delay| format!(" after {delay} ms"));
    let next = format!(
        "echo on | sudo tee /sys/bus/usb/devices/{}/power/control; the rule of --write-udev-rule does it for good",
        board.path
    );
    Finding::wrong(CHECK, format!("the kernel may put it to sleep{after}{now}"), next)
}

fn hub(board: &UsbDevice) -> Finding {
    const CHECK: &str = "usb-power";
    let next = "plug it into a port of the machine, or into a hub with a power supply";
    if board.over_current > 0 {
        let times = if board.over_current == 1 { "once" } else { "more than once" };
        return Finding::wrong(CHECK, format!("its port was switched off for too much current, {times}"), next);
    }
    let Some(hub) = &board.hub else { return Finding::fine(CHECK, "a port of the machine itself") };
    match hub.self_powered {
        Some(true) => Finding::fine(CHECK, format!("behind the hub {}, which has a power supply", hub.path)),
        Some(false) => {
            Finding::advice(CHECK, format!("behind the hub {}, which has no power supply of its own", hub.path), next)
        }
        None => Finding::fine(CHECK, format!("behind the hub {}; it does not say where its power is from", hub.path)),
    }
}
