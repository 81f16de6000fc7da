//! The descriptors of a USB device, from the file `descriptors` in its folder in sysfs, which libusb reads as well. Format:
//! USB 2.0 chapter 9.6; numbers are little endian.

use super::{NotTheBoard, ReportInterface};
use crate::io::descriptors::{HID, TO_HOST, carries_reports};

// The types of descriptors, values of bDescriptorType (USB 2.0 table 9-5).
const DEVICE: u8 = 1;
const CONFIGURATION: u8 = 2;
const INTERFACE: u8 = 4;
const ENDPOINT: u8 = 5;

/// The length of a device descriptor in bytes.
const DEVICE_LEN: usize = 18;

/// Finds the interface of a board's reports in the configuration with this number, or in the first one if it is `None`.
///
/// # Errors
/// Why the device cannot be a board.
pub fn report_interface(bytes: &[u8], configuration: Option<u8>) -> Result<ReportInterface, NotTheBoard> {
    let mut rest = bytes.split_at_checked(DEVICE_LEN).ok_or(NotTheBoard::Descriptors).and_then(|(device, rest)| {
        let is_device = usize::from(device[0]) == DEVICE_LEN && device[1] == DEVICE;
        if is_device { Ok(rest) } else { Err(NotTheBoard::Descriptors) }
    })?;
    let mut wanted = Selection::Before;
    let mut setting = None;
    let mut why = NotTheBoard::NoHid;
    while let [len, kind, ..] = *rest {
        // A length of 0 or 1 would make this loop endless, and one beyond the end of the file is wrong.
        let len = usize::from(len);
        let (descriptor, after) = rest.split_at_checked(len).filter(|_| len >= 2).ok_or(NotTheBoard::Descriptors)?;
        rest = after;
        match (kind, descriptor) {
            (CONFIGURATION, [_, _, _, _, _, value, ..]) => {
                if wanted == Selection::Inside {
                    break;
                }
                let is_it = configuration.is_none_or(|number| number == *value);
                wanted = if is_it { Selection::Inside } else { Selection::Before };
                setting = None;
            }
            _ if wanted != Selection::Inside => {}
            (INTERFACE, [_, _, number, _, _, class, ..]) => {
                setting = (*class == HID).then_some(Setting { interface: *number, input: None, output: None });
                if setting.is_some() {
                    why = NotTheBoard::OtherReports;
                }
            }
            (ENDPOINT, [_, _, address, attributes, low, high, ..]) => {
                let fits = carries_reports(*attributes, u16::from_le_bytes([*low, *high]));
                if let Some(setting) = setting.as_mut().filter(|_| fits) {
                    setting.take(*address);
                    if let Some(interface) = setting.report_interface() {
                        return Ok(interface);
                    }
                }
            }
            (CONFIGURATION | INTERFACE | ENDPOINT, _) => return Err(NotTheBoard::Descriptors),
            // Other descriptors, such as those of the HID class, are skipped.
            _ => {}
        }
    }
    if wanted == Selection::Inside && rest.len() != 1 { Err(why) } else { Err(NotTheBoard::Descriptors) }
}

/// The parser's position relative to the wanted configuration: before it, or inside it.
#[derive(PartialEq)]
enum Selection {
    Before,
    Inside,
}

/// A HID interface in one of its alternate settings, with the endpoints read so far.
struct Setting {
    interface: u8,
    input: Option<u8>,
    output: Option<u8>,
}

impl Setting {
    fn take(&mut self, address: u8) {
        let end = if address & TO_HOST == 0 { &mut self.output } else { &mut self.input };
        // If there are several endpoints of one direction, the first one counts.
        end.get_or_insert(address);
    }

    fn report_interface(&self) -> Option<ReportInterface> {
        Some(ReportInterface { number: self.interface, input: self.input?, output: self.output? })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn device() -> Vec<u8> {
        let mut device = vec![0; DEVICE_LEN];
        device[..2].copy_from_slice(&[18, DEVICE]);
        device
    }

    fn configuration(number: u8) -> Vec<u8> {
        vec![9, CONFIGURATION, 0, 0, 1, number, 0, 0x80, 50]
    }

    fn interface(number: u8, class: u8) -> Vec<u8> {
        vec![9, INTERFACE, number, 0, 2, class, 0, 0, 0]
    }

    fn endpoint(address: u8, attributes: u8, size: u16) -> Vec<u8> {
        let [low, high] = size.to_le_bytes();
        vec![7, ENDPOINT, address, attributes, low, high, 1]
    }

    /// The HID descriptor, which follows the interface descriptor and precedes the endpoints.
    const HID_DESCRIPTOR: [u8; 9] = [9, 0x21, 0x11, 0x01, 0, 1, 0x22, 26, 0];

    fn board() -> Vec<u8> {
        let ends = [endpoint(0x81, 3, 512), endpoint(0x02, 3, 512)].concat();
        [device(), configuration(1), interface(0, HID), HID_DESCRIPTOR.to_vec(), ends].concat()
    }

    const INTERFACE_OF_BOARD: ReportInterface = ReportInterface { number: 0, input: 0x81, output: 0x02 };

    /// SK-9.2 A HID interface with interrupt endpoints of 512 bytes in both directions is a board, also if the device
    /// is not configured. An interface without one of the endpoints, or with endpoints of fewer bytes, is no board.
    #[test]
    fn a_board_is_told_from_other_devices() {
        assert_eq!(
            (report_interface(&board(), Some(1)), report_interface(&board(), None)),
            (Ok(INTERFACE_OF_BOARD), Ok(INTERFACE_OF_BOARD))
        );
        let with = |class, ends: &[Vec<u8>]| {
            let bytes = [device(), configuration(1), interface(0, class), ends.concat()].concat();
            report_interface(&bytes, Some(1))
        };
        let (input, output) = (endpoint(0x81, 3, 512), endpoint(0x02, 3, 512));
        assert_eq!(with(HID, std::slice::from_ref(&input)), Err(NotTheBoard::OtherReports));
        assert_eq!(with(HID, &[input.clone(), endpoint(0x02, 2, 512)]), Err(NotTheBoard::OtherReports), "bulk");
        assert_eq!(with(HID, &[input.clone(), endpoint(0x02, 3, 64)]), Err(NotTheBoard::OtherReports));
        assert_eq!(
            with(HID, &[endpoint(0x81, 3, 512 | 1 << 11), output.clone()]),
            Ok(INTERFACE_OF_BOARD),
            "two in a microframe"
        );
        assert_eq!(with(HID, &[endpoint(0x81, 3, 8)]), Err(NotTheBoard::OtherReports), "a relay card");
        assert_eq!(with(0xFF, &[input, output]), Err(NotTheBoard::NoHid));
        assert_eq!(with(HID, &[]), Err(NotTheBoard::OtherReports));
    }

    /// The active configuration decides; an interface of another configuration is ignored.
    #[test]
    fn the_active_configuration_counts() {
        let hobby = [configuration(2), interface(0, 0xFF)].concat();
        let both = [board(), hobby].concat();
        assert_eq!(
            (report_interface(&both, Some(1)), report_interface(&both, Some(2))),
            (Ok(INTERFACE_OF_BOARD), Err(NotTheBoard::NoHid))
        );
        assert_eq!(report_interface(&both, Some(3)), Err(NotTheBoard::Descriptors));
        let halves = [
            [device(), configuration(1), interface(0, HID), endpoint(0x81, 3, 512)].concat(),
            [interface(1, HID), endpoint(0x02, 3, 512)].concat(),
        ];
        assert_eq!(
            report_interface(&halves.concat(), None),
            Err(NotTheBoard::OtherReports),
            "both ends belong to one interface"
        );
    }

    /// Descriptors that are cut off or have a wrong length are an error, and cause no panic.
    #[test]
    fn descriptors_that_lie() {
        let board = board();
        for cut in 0..board.len() {
            assert!(report_interface(&board[..cut], Some(1)).is_err(), "cut at {cut}");
        }
        for (at, len) in [(18, 0), (18, 1), (27, 200), (0, 17)] {
            let mut lying = board.clone();
            lying[at] = len;
            assert_eq!(report_interface(&lying, Some(1)), Err(NotTheBoard::Descriptors), "{len} at {at}");
        }
    }

    /// The descriptors of the virtual board are recognized as those of a board.
    #[test]
    #[cfg(feature = "serve")]
    fn the_virtual_board_is_one() {
        use crate::port::usbip::Identity;
        use crate::port::usbip::descriptors::Descriptors;

        let descriptors = Descriptors::new(&Identity::default()).expect("a valid identity");
        let part = |kind| descriptors.get(kind, 0).expect("it has one").to_vec();
        assert_eq!(report_interface(&[part(DEVICE), part(CONFIGURATION)].concat(), Some(1)), Ok(INTERFACE_OF_BOARD));
    }

    proptest! {
        /// From any bytes in place of descriptors the result is an interface, or a reason why the device is not a board.
        #[test]
        fn any_bytes(tail in proptest::collection::vec(any::<u8>(), 0..300), number in any::<Option<u8>>()) {
            let _ = report_interface(&tail, number);
            if let Ok(found) = report_interface(&[device(), configuration(1), tail].concat(), Some(1)) {
                prop_assert!(found.input & TO_HOST != 0 && found.output & TO_HOST == 0);
            }
        }
    }
}
