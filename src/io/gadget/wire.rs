//! The bytes that are written to and read from endpoint 0 of FunctionFS. No other file knows their offsets. Numbers are
//! little-endian; a setup packet is as on the bus.
//!
//! Source: include/uapi/linux/usb/functionfs.h of Linux.

/// `FUNCTIONFS_DESCRIPTORS_MAGIC_V2`: the first number of the write with the descriptors.
const DESCRIPTORS: u32 = 3;
/// `FUNCTIONFS_STRINGS_MAGIC`: the first number of the write with the strings.
const STRINGS: u32 = 2;
/// `FUNCTIONFS_HAS_HS_DESC`: the descriptors that follow are for high speed. As no other flag is set, there are none
/// for other speeds.
const HIGH_SPEED: u32 = 2;

/// The length in bytes of four numbers: magic, length, flags, and the number of descriptors.
const DESCRIPTORS_HEAD: usize = 16;
/// The length in bytes of four numbers: magic, length, the number of strings and the number of languages.
const STRINGS_HEAD: usize = 16;

/// The length of `struct usb_functionfs_event` in bytes: a setup packet, the type, and three unused bytes.
pub const EVENT_LEN: usize = 12;
/// The length of a setup packet in bytes.
pub const SETUP_LEN: usize = 8;

/// The first write to endpoint 0: the descriptors of the function at high speed. `descriptors` contains these
/// descriptors one after the other.
pub fn descriptors(descriptors: &[u8]) -> Vec<u8> {
    let (mut count, mut rest) = (0_u32, descriptors);
    // Each descriptor begins with its length. A length of 0 is invalid; the loop ends there, because it would not
    // advance.
    while let [length @ 1..=u8::MAX, ..] = rest {
        rest = rest.get(usize::from(*length)..).unwrap_or_default();
        count += 1;
    }
    head([DESCRIPTORS, (DESCRIPTORS_HEAD + descriptors.len()) as u32, HIGH_SPEED, count], descriptors)
}

/// The second write to endpoint 0: the function has no strings of its own.
pub fn strings() -> Vec<u8> {
    head([STRINGS, STRINGS_HEAD as u32, 0, 0], &[])
}

fn head(numbers: [u32; 4], rest: &[u8]) -> Vec<u8> {
    numbers.iter().flat_map(|number| number.to_le_bytes()).chain(rest.iter().copied()).collect()
}

/// What has happened to the function (`enum usb_functionfs_event_type`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// The gadget was bound to a controller.
    Bound,
    /// The gadget was unbound from its controller.
    Unbound,
    /// A host has selected the configuration: from now on the endpoints can transfer reports.
    Enabled,
    /// The host is gone, has reset the device or deselected the configuration.
    Disabled,
    /// A request of the host on endpoint 0, which has to be answered: its setup packet.
    Setup([u8; SETUP_LEN]),
    /// The bus has been idle for 3 ms: the host sleeps.
    Suspended,
    /// The host is awake again.
    Resumed,
    /// An event of a newer kernel.
    Unknown(u8),
}

impl Event {
    /// Decodes an event.
    pub fn parse(bytes: &[u8; EVENT_LEN]) -> Self {
        let [setup @ .., kind, _, _, _] = *bytes;
        match kind {
            0 => Self::Bound,
            1 => Self::Unbound,
            2 => Self::Enabled,
            3 => Self::Disabled,
            4 => Self::Setup(setup),
            5 => Self::Suspended,
            6 => Self::Resumed,
            other => Self::Unknown(other),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn descriptors_are_counted_and_for_high_speed_alone() {
        let two = [4, 1, 0xAA, 0xBB, 2, 5];
        let expected = [&[3, 0, 0, 0, 22, 0, 0, 0, 2, 0, 0, 0, 2, 0, 0, 0][..], &two].concat();
        assert_eq!(descriptors(&two), expected);
        // Bytes that are no list of descriptors are passed on, and the kernel refuses them. The number of descriptors in the
        // header counts only those before the first wrong byte.
        for wrong in [&[0, 1, 2][..], &[9, 4], &[1]] {
            assert_eq!(descriptors(wrong).len(), 16 + wrong.len());
        }
    }

    #[test]
    fn there_are_no_strings() {
        assert_eq!(strings(), [2, 0, 0, 0, 16, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
    }

    #[test]
    fn events_are_told_by_their_type() {
        let event = |kind: u8| Event::parse(&[0xA1, 1, 2, 3, 4, 5, 6, 7, kind, 0, 0, 0]);
        let expected = [
            Event::Bound,
            Event::Unbound,
            Event::Enabled,
            Event::Disabled,
            Event::Setup([0xA1, 1, 2, 3, 4, 5, 6, 7]),
            Event::Suspended,
            Event::Resumed,
            Event::Unknown(7),
            Event::Unknown(8),
        ];
        assert_eq!((0..9).map(event).collect::<Vec<_>>(), expected);
        assert_eq!(event(255), Event::Unknown(255));
    }
}
