//! Arbitrary bytes.

use ecmsk::recording::{Address, Recording};
use proptest::prelude::*;

use support::captures::convert::{Parts, USB_LINUX, USB_LINUX_MMAPPED, USBPCAP, pcap, pcapng};
use support::captures::traffic::{TAKEN_BACK, Traffic, numbered};

/// Reads to the end, whatever the content: at most one error, and consistent counts.
fn exhaust(bytes: &[u8], only: Option<Address>) {
    let Ok(recording) = Recording::new(bytes, "any") else { return };
    let mut recording = match only {
        Some(only) => recording.only(only),
        None => recording,
    };
    let (frames, errors): (Vec<_>, Vec<_>) = recording.by_ref().partition(Result::is_ok);
    assert!(errors.len() <= 1);
    for error in errors.into_iter().filter_map(Result::err) {
        assert!(!error.to_string().is_empty());
    }
    let seen: u64 = recording.devices().iter().map(|seen| seen.written + seen.read).sum();
    assert!(frames.len() as u64 <= seen + recording.skipped().taken_back, "{} of {seen}", frames.len());
}

/// A bus with all kinds of traffic.
fn traffic() -> Traffic {
    let mut traffic = Traffic::default();
    let frame = numbered(1);
    traffic.descriptor(7, (0x16C0, 0x05DF)).write(7, frame.bytes()).read(7, frame.bytes());
    let back = traffic.submitted(7, frame.bytes());
    traffic.completed(7, back, TAKEN_BACK, 0).set_report(7, frame.bytes()).bulk(6, &[0; 31]).read(5, &[0; 8]);
    traffic
}

fn any_file() -> impl Strategy<Value = Vec<u8>> {
    (0..6_u8).prop_map(|kind| {
        let events = traffic().events;
        match kind {
            0 => pcap(&events, USB_LINUX, Parts::Two, 65_535),
            1 => pcap(&events, USB_LINUX_MMAPPED, Parts::Two, 65_535),
            2 => pcap(&events, USBPCAP, Parts::Two, 65_535),
            3 => pcap(&events, USBPCAP, Parts::Three, 65_535),
            4 => pcapng(&events, USB_LINUX_MMAPPED),
            _ => pcapng(&events, USBPCAP),
        }
    })
}

/// A pcap file of such packets, with few different values in their headers, so that they are often valid.
fn any_packets() -> impl Strategy<Value = Vec<u8>> {
    let byte = prop_oneof![0..4_u8, Just(b'S'), Just(b'C'), Just(0x81), any::<u8>()];
    let packet = proptest::collection::vec(byte, 0..96);
    let link_type = prop_oneof![Just(USB_LINUX), Just(USB_LINUX_MMAPPED), Just(USBPCAP)];
    (link_type, proptest::collection::vec(packet, 0..8)).prop_map(|(link_type, packets)| {
        let mut file = pcap(&[], link_type, Parts::Two, 65_535);
        for packet in packets {
            let len = (packet.len() as u32).to_le_bytes();
            file.extend([[0; 4], [0; 4], len, len].concat());
            file.extend(packet);
        }
        file
    })
}

fn any_device() -> impl Strategy<Value = Option<Address>> {
    prop_oneof![Just(None), (0..4_u16, 0..8_u8).prop_map(|(bus, device)| Some(Address { bus, device }))]
}

proptest! {
    #[test]
    fn no_packets_make_the_reader_panic(file in any_packets(), only in any_device()) {
        exhaust(&file, only);
    }

    #[test]
    fn no_damage_makes_the_reader_panic(
        file in any_file(),
        damage in proptest::collection::vec((any::<proptest::sample::Index>(), any::<u8>()), 0..8),
        end in any::<proptest::sample::Index>(),
        only in any_device(),
    ) {
        let mut file = file;
        for (at, byte) in damage {
            let at = at.index(file.len());
            file[at] = byte;
        }
        file.truncate(end.index(file.len() + 1));
        exhaust(&file, only);
    }
}
