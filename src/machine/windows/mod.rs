//! A machine with Windows, read from its HID driver. Nothing has to be installed, and no special rights are needed.

use super::findings::{Finding, FindingVerdict, timer};
use super::printable;
use super::timing::timer_resolution;
use crate::address::keys::Scheme;
use crate::address::uri::LinkUri;
use crate::io::hid::{self, Bus, NotTheBoard, Sysfs, UsbError};
use crate::sk::BOARD_IDS;

// The names of the checks, as findings report them.
const USB: &str = "usb";
const BOARD: &str = "usb-board";

/// The Windows machine that this process runs on.
#[derive(Clone, Copy, Debug)]
pub struct Machine;

/// A HID device with the board's vendor and product id. It may still be another device; see [`Self::why_no_board`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Board {
    /// The device's instance name in Windows, as the key `path=` of a link takes it.
    pub path: String,
    /// The product name, safe to print.
    pub name: Option<String>,
    /// The serial number, safe to print.
    pub serial: Option<String>,
    /// Why the device is not a board; `None` if it is one.
    pub why_no_board: Option<NotTheBoard>,
    /// The error with which Windows refuses to open the device; `None` if it opens.
    pub refused: Option<UsbError>,
}

impl Board {
    /// The URI of the link that opens this device.
    pub fn link(&self) -> String {
        format!("usb:?path={}", self.path)
    }

    /// Name and serial number, such as `ECM-SK, serial 7`.
    pub fn shown(&self) -> String {
        let name = self.name.as_deref().unwrap_or("a board without a name");
        self.serial.as_ref().map_or_else(|| name.to_owned(), |serial| format!("{name}, serial {serial}"))
    }

    /// Why the device cannot be opened, with the next step; `None` if it can. Windows does not report which program
    /// uses a device.
    pub fn obstacle(&self) -> Option<Finding> {
        let (found, next) = match self.refused? {
            UsbError::Busy => (
                "in use by a program that lets nobody else in (Windows does not say which)".to_owned(),
                "close programs for HID devices one by one, or share the board by `ecmsk serve tcp`",
            ),
            UsbError::Access => (
                "this user may not open it".to_owned(),
                "use an account that may: Device Manager shows the board under Human Interface Devices",
            ),
            UsbError::NoDevice => ("it went away while it was looked at".to_owned(), "plug it in again"),
            other => (format!("it does not open: {other}"), "pull it and plug it in again"),
        };
        Some(Finding::wrong(BOARD, found, next).of(&self.path).blocking())
    }
}

impl Machine {
    /// The machine that this process runs on.
    pub const fn here() -> Self {
        Self
    }

    /// All devices with the board's ids. Each is opened as a link opens it and closed again; nothing is sent.
    ///
    /// # Errors
    /// Why the devices cannot be listed, as a text that ends with the next step.
    pub fn boards(&self) -> Result<Vec<Board>, String> {
        let bus = Bus::open().map_err(|error| error.to_string())?;
        let (vendor, product) = BOARD_IDS;
        let found = hid::find(&bus, vendor, product)
            .map_err(|error| format!("Windows does not list its HID devices ({error}); restart Windows"))?;
        let system = Sysfs::of_this_machine();
        Ok(found
            .into_iter()
            .map(|found| {
                let (name, serial) = found.texts(&system, true);
                Board {
                    why_no_board: found.interface.err(),
                    refused: found.refused(),
                    name: name.as_deref().map(printable),
                    serial: serial.as_deref().map(printable),
                    path: found.path,
                }
            })
            .collect())
    }

    /// The results of all checks that need no waiting. Something that is missing counts as wrong if the link `wanted`
    /// needs it, and is only mentioned if other links need it.
    pub fn findings(&self, wanted: Option<&LinkUri>) -> Vec<Finding> {
        let mut all = self.usb_findings(wanted.is_some_and(|link| link.scheme() == Scheme::Usb));
        match wanted.map(LinkUri::scheme) {
            Some(Scheme::Spi) => all.push(Finding::wrong(
                "spi",
                "Windows has no spi: links",
                "serve the board by `ecmsk serve tcp` on the machine it is wired to, and use tcp://HOST:PORT here",
            )),
            Some(Scheme::XfSpi) => all.push(Finding::wrong(
                "spi",
                "Windows has no xf-spi: links",
                "run the program on a machine with Linux that the chip is wired to",
            )),
            _ => {}
        }
        all.push(timer(timer_resolution()));
        all
    }

    fn usb_findings(&self, wanted: bool) -> Vec<Finding> {
        let devices = match self.boards() {
            Ok(devices) => devices,
            Err(why) => {
                let (found, next) = why.rsplit_once("; ").unwrap_or((why.as_str(), "start Windows anew"));
                return vec![Finding::wrong_if(wanted, USB, found, next)];
            }
        };
        let mut all = Vec::new();
        let (others, boards): (Vec<_>, Vec<_>) = devices.into_iter().partition(|device| device.why_no_board.is_some());
        for other in &others {
            let why = other.why_no_board.map(|why| why.to_string()).unwrap_or_default();
            all.push(Finding::fine(USB, format!("another device with the board's ids: {why}")).of(&other.path));
        }
        if boards.is_empty() {
            let next = "plug it in, set CONFIG0 to USB, and give it power enough";
            all.push(Finding::wrong_if(wanted, USB, "no board on USB", next));
        }
        for board in &boards {
            let open = || {
                let found = format!(
                    "{}: can be opened; Windows does not say whether another program has it open too",
                    board.shown()
                );
                Finding::fine(BOARD, found).of(&board.path)
            };
            let mut finding = board.obstacle().unwrap_or_else(open);
            if finding.verdict == FindingVerdict::Wrong {
                finding.found = format!("{}: {}", board.shown(), finding.found);
            }
            all.push(finding);
        }
        all
    }
}
