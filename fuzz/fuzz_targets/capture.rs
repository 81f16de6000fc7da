//! Any packets as a capture of usbmon or USBPcap: frames, or an error that says where; the counts fit the frames.

#![no_main]

use ecmsk::recording::{Address, Recording};
use libfuzzer_sys::fuzz_target;

/// LINKTYPE_USB_LINUX, LINKTYPE_USB_LINUX_MMAPPED, LINKTYPE_USBPCAP.
const LINK_TYPES: [u32; 3] = [189, 220, 249];

/// A pcap file of the packets in `bytes`: each its length in two bytes, then as many bytes as there are of it.
fn file(link_type: u32, mut bytes: &[u8]) -> Vec<u8> {
    let header = [0xA1B2_C3D4, 2 | 4 << 16, 0, 0, 65_535, link_type];
    let mut file: Vec<u8> = header.iter().flat_map(|word: &u32| word.to_le_bytes()).collect();
    while let Some((length, rest)) = bytes.split_first_chunk::<2>() {
        let (packet, rest) = rest.split_at(rest.len().min(u16::from_le_bytes(*length).into()));
        let words = [0, 0, packet.len() as u32, packet.len() as u32];
        file.extend(words.iter().flat_map(|word: &u32| word.to_le_bytes()));
        file.extend(packet);
        bytes = rest;
    }
    file
}

fuzz_target!(|bytes: &[u8]| {
    let Some((&choice, packets)) = bytes.split_first() else { return };
    let file = file(LINK_TYPES[usize::from(choice) % LINK_TYPES.len()], packets);
    let Ok(mut recording) = Recording::new(&file[..], "fuzz") else { panic!("the header is right") };
    if choice & 0x80 != 0 {
        recording = recording.only(Address { bus: 1, device: 1 });
    }
    let mut frames = 0;
    for frame in recording.by_ref() {
        match frame {
            Ok(_) => frames += 1,
            Err(error) => assert!(!error.to_string().is_empty()),
        }
    }
    let seen: u64 = recording.devices().iter().map(|seen| seen.written + seen.read).sum();
    assert!(frames <= seen + recording.skipped().taken_back);
});
