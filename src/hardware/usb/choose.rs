//! Selects the board among the devices on the bus that have its vendor and product id.

use std::fmt::Write as _;

use super::options::UsbOptions;
use crate::io::hid::{FoundDevice, NotTheBoard, ReportInterface, Sysfs};
use crate::link::LinkError;

/// Selects the only board among the found devices. If the link gives a serial number or a path, the board has to have
/// it. The error says why no board or no single board fits.
pub(super) fn choose<'a>(
    name: &str,
    found: &'a [FoundDevice],
    options: &UsbOptions,
    system: &Sysfs,
) -> Result<(&'a FoundDevice, ReportInterface), LinkError> {
    // On Windows the serial number may have to be read from the device itself. This is done only if it is needed: if
    // the link gives one, or there are several devices.
    let may_ask = options.serial.is_some() || found.len() > 1;
    let facts: Vec<Facts<'_>> = found.iter().map(|found| Facts::of(found, system, may_ask)).collect();
    let index =
        index_of_board(&facts, options).map_err(|reason| LinkError::NoBoard { name: name.to_owned(), reason })?;
    match found[index].interface {
        Ok(interface) => Ok((&found[index], interface)),
        Err(why) => Err(LinkError::NoBoard { name: name.to_owned(), reason: why.to_string() }),
    }
}

/// The properties of a device on the bus that decide whether it is the board that the link names.
struct Facts<'a> {
    path: &'a str,
    serial: Option<String>,
    name: Option<String>,
    why_no_board: Option<NotTheBoard>,
}

impl<'a> Facts<'a> {
    fn of(found: &'a FoundDevice, system: &Sysfs, may_ask: bool) -> Self {
        let (name, serial) = found.texts(system, may_ask);
        Self { path: &found.path, serial, name, why_no_board: found.interface.err() }
    }

    /// How a device is named in error messages: `1-2.3 (ECM-SK, serial 7)`.
    fn shown(&self) -> String {
        let serial = self.serial.as_ref().map(|serial| format!("serial {serial}"));
        let known: Vec<String> = self.name.clone().into_iter().chain(serial).collect();
        if known.is_empty() { self.path.to_owned() } else { format!("{} ({})", self.path, known.join(", ")) }
    }
}

/// The index of the only board that fits the options, or the reason why there is none or more than one.
fn index_of_board(found: &[Facts<'_>], options: &UsbOptions) -> Result<usize, String> {
    let fits = |facts: &Facts<'_>| {
        facts.why_no_board.is_none()
            && options
                .serial
                .as_deref()
                .is_none_or(|serial| facts.serial.as_deref().is_some_and(|its| same(its, serial)))
            && options.path.as_deref().is_none_or(|path| same(facts.path, path))
    };
    let fitting: Vec<usize> = (0..found.len()).filter(|index| fits(&found[*index])).collect();
    match fitting[..] {
        [index] => Ok(index),
        [] => Err(why_none(found, options)),
        _ => {
            let all: Vec<String> = fitting.iter().map(|index| found[*index].shown()).collect();
            let example = found[fitting[0]].path;
            Err(format!("there are {}: {}; choose one, e.g. usb:?path={example}", all.len(), all.join(", ")))
        }
    }
}

/// Whether the serial number or the path of a device is the given one; on Windows the case may differ.
fn same(its: &str, given: &str) -> bool {
    if cfg!(windows) { its.eq_ignore_ascii_case(given) } else { its == given }
}

/// Why no device on the bus is the board that the options describe.
fn why_none(found: &[Facts<'_>], options: &UsbOptions) -> String {
    let mut wanted = String::new();
    if let Some(serial) = &options.serial {
        _ = write!(wanted, " with serial number {serial}");
    }
    if let Some(path) = &options.path {
        _ = write!(wanted, " at {path}");
    }
    let boards: Vec<String> = found.iter().filter(|facts| facts.why_no_board.is_none()).map(Facts::shown).collect();
    if !boards.is_empty() {
        return format!("there is none{wanted}, but {}; correct the link", boards.join(", "));
    }
    if let Some(off) = found.iter().find(|facts| facts.why_no_board == Some(NotTheBoard::Unconfigured)) {
        return format!("{}: {}", off.shown(), NotTheBoard::Unconfigured);
    }
    let others: Vec<String> =
        found.iter().filter_map(|facts| Some(format!("{}: {}", facts.shown(), facts.why_no_board?))).collect();
    if others.is_empty() {
        return format!("there is none{wanted}; plug it in, set CONFIG0 to USB, and give it power enough");
    }
    // Many hobby devices have the same vendor and product id as the board, so the error lists the devices that were
    // found.
    format!("there is none{wanted}, only other devices with its ids ({}); plug the board in", others.join("; "))
}

#[cfg(test)]
mod tests {
    use super::*;

    const ANY: UsbOptions = UsbOptions { serial: None, path: None, transfers: 8 };

    fn board<'a>(path: &'a str, serial: &'a str) -> Facts<'a> {
        Facts { path, serial: Some(serial.into()), name: Some("ECM-SK".into()), why_no_board: None }
    }

    fn with(serial: Option<&str>, path: Option<&str>) -> UsbOptions {
        UsbOptions { serial: serial.map(str::to_owned), path: path.map(str::to_owned), ..ANY }
    }

    /// SK-9.2 A device that has the board's vendor and product id but not its HID interface is no board.
    #[test]
    fn a_device_with_the_boards_ids_is_no_board() {
        let other = || Facts {
            path: "1-1",
            serial: None,
            name: Some("Relay".into()),
            why_no_board: Some(NotTheBoard::OtherReports),
        };
        assert_eq!(index_of_board(&[other(), board("1-2", "7")], &ANY), Ok(1));
        let why = index_of_board(&[other()], &ANY).unwrap_err();
        assert!(why.contains("1-1 (Relay): its HID interface has no interrupt endpoints of 512 bytes"), "{why}");
    }

    /// If several boards fit the link, it does not open, and the error lists them; `serial=` and `path=` choose one.
    #[test]
    fn of_several_boards_the_link_has_to_name_one() {
        let both = || [board("1-1", "7"), board("1-2.3", "8")];
        let why = index_of_board(&both(), &ANY).unwrap_err();
        assert_eq!(
            why,
            "there are 2: 1-1 (ECM-SK, serial 7), 1-2.3 (ECM-SK, serial 8); choose one, e.g. usb:?path=1-1"
        );
        assert_eq!(index_of_board(&both(), &with(Some("8"), None)), Ok(1));
        assert_eq!(index_of_board(&both(), &with(None, Some("1-1"))), Ok(0));
        assert_eq!(index_of_board(&both(), &with(Some("8"), Some("1-2.3"))), Ok(1));
    }

    /// WIRE-80, SK-9.17 A device that has the board's ids and no active configuration may be the board. The error is
    /// about this device, and not about others with these ids, which are certainly no boards.
    #[test]
    fn a_board_that_is_not_switched_on_is_named_before_other_devices() {
        let off = Facts { why_no_board: Some(NotTheBoard::Unconfigured), ..board("1-3", "7") };
        let relay = Facts { path: "1-1", serial: None, name: None, why_no_board: Some(NotTheBoard::NoHid) };
        let why = index_of_board(&[relay, off], &ANY).unwrap_err();
        assert!(why.starts_with("1-3 (ECM-SK, serial 7): this machine has not configured it"), "{why}");
        assert!(why.ends_with("a hub with a power supply of its own"), "{why}");
    }

    /// SK-9.17 Without a board the error says what to look at.
    #[test]
    fn without_a_board_the_error_says_what_to_do() {
        assert!(
            index_of_board(&[], &ANY)
                .unwrap_err()
                .ends_with("plug it in, set CONFIG0 to USB, and give it power enough")
        );
        let why = index_of_board(&[board("1-1", "7")], &with(Some("9"), None)).unwrap_err();
        assert_eq!(why, "there is none with serial number 9, but 1-1 (ECM-SK, serial 7); correct the link");
    }
}
