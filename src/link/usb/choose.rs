//! Which of the devices on the bus is meant.

use std::fmt::Write as _;

use super::options::UsbOptions;
use crate::io::hid::{FoundDevice, NotTheBoard, ReportInterface, Sysfs};
use crate::link::LinkError;

/// The one board that fits.
pub(super) fn choose<'a>(
    name: &str,
    found: &'a [FoundDevice],
    options: &UsbOptions,
    system: &Sysfs,
) -> Result<(&'a FoundDevice, ReportInterface), LinkError> {
    // One board that need not be told from others is asked nothing.
    let may_ask = options.serial.is_some() || found.len() > 1;
    let facts: Vec<Facts<'_>> = found.iter().map(|found| Facts::of(found, system, may_ask)).collect();
    let index = one_of(&facts, options).map_err(|reason| LinkError::NoBoard { name: name.to_owned(), reason })?;
    match found[index].interface {
        Ok(interface) => Ok((&found[index], interface)),
        Err(why) => Err(LinkError::NoBoard { name: name.to_owned(), reason: why.to_string() }),
    }
}

/// What counts of a device.
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

    /// `1-2.3 (ECM-SK, serial 7)`.
    fn shown(&self) -> String {
        let mut text = self.path.to_owned();
        match (&self.name, &self.serial) {
            (Some(name), Some(serial)) => _ = write!(text, " ({name}, serial {serial})"),
            (Some(name), None) => _ = write!(text, " ({name})"),
            (None, Some(serial)) => _ = write!(text, " (serial {serial})"),
            (None, None) => {}
        }
        text
    }
}

/// The index of the one that fits, or why there is none.
fn one_of(found: &[Facts<'_>], options: &UsbOptions) -> Result<usize, String> {
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
        [] => Err(none(found, options)),
        _ => {
            let all: Vec<String> = fitting.iter().map(|index| found[*index].shown()).collect();
            let example = found[fitting[0]].path;
            Err(format!("there are {}: {}; choose one, e.g. usb:?path={example}", all.len(), all.join(", ")))
        }
    }
}

/// Windows writes names of devices now in capitals, now not.
fn same(its: &str, given: &str) -> bool {
    if cfg!(windows) { its.eq_ignore_ascii_case(given) } else { its == given }
}

fn none(found: &[Facts<'_>], options: &UsbOptions) -> String {
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
    // The pair of ids is shared by many hobby devices.
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

    /// WIRE-17, SK-9.2 Devices that share the pair are told from a board by more than it.
    #[test]
    fn a_device_with_the_boards_ids_is_no_board() {
        let other = || Facts {
            path: "1-1",
            serial: None,
            name: Some("Relay".into()),
            why_no_board: Some(NotTheBoard::OtherReports),
        };
        assert_eq!(one_of(&[other(), board("1-2", "7")], &ANY), Ok(1));
        let why = one_of(&[other()], &ANY).unwrap_err();
        assert!(why.contains("1-1 (Relay): its HID interface has no interrupt endpoints of 512 bytes"), "{why}");
    }

    /// WIRE-17
    #[test]
    fn of_several_boards_one_has_to_be_chosen() {
        let both = || [board("1-1", "7"), board("1-2.3", "8")];
        let why = one_of(&both(), &ANY).unwrap_err();
        assert_eq!(
            why,
            "there are 2: 1-1 (ECM-SK, serial 7), 1-2.3 (ECM-SK, serial 8); choose one, e.g. usb:?path=1-1"
        );
        assert_eq!(one_of(&both(), &with(Some("8"), None)), Ok(1));
        assert_eq!(one_of(&both(), &with(None, Some("1-1"))), Ok(0));
        assert_eq!(one_of(&both(), &with(Some("8"), Some("1-2.3"))), Ok(1));
    }

    /// WIRE-80, SK-9.17 A board without power is named before devices that are none.
    #[test]
    fn a_board_that_is_off_says_why() {
        let off = Facts { why_no_board: Some(NotTheBoard::Unconfigured), ..board("1-3", "7") };
        let relay = Facts { path: "1-1", serial: None, name: None, why_no_board: Some(NotTheBoard::NoHid) };
        let why = one_of(&[relay, off], &ANY).unwrap_err();
        assert!(why.starts_with("1-3 (ECM-SK, serial 7): this machine has not switched it on"), "{why}");
        assert!(why.ends_with("a hub with a power supply of its own"), "{why}");
    }

    /// WIRE-17, SK-9.17 Without a board the error says what to look at.
    #[test]
    fn without_a_board_the_error_says_what_to_do() {
        assert!(one_of(&[], &ANY).unwrap_err().ends_with("plug it in, set CONFIG0 to USB, and give it power enough"));
        let why = one_of(&[board("1-1", "7")], &with(Some("9"), None)).unwrap_err();
        assert_eq!(why, "there is none with serial number 9, but 1-1 (ECM-SK, serial 7); correct the link");
    }
}
