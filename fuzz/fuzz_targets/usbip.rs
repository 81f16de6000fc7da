//! Any bytes as what a USB/IP client sends: each transfer gets one answer at most, or was taken back; an error says
//! what is wrong; never a panic.

#![no_main]

use ecmsk::port::usbip::Identity;
use ecmsk::port::usbip::descriptors::Descriptors;
use ecmsk::port::usbip::device::Device;
use ecmsk::port::usbip::wire::{self, BUS_ID_LEN, Command, Direction, HEADER_LEN, OP_LEN, Op};
use ecmsk::sk::Frame;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    request(bytes);
    Host::default().traffic(bytes);
});

fn request(bytes: &[u8]) {
    let Some((op, rest)) = bytes.split_first_chunk::<OP_LEN>() else { return };
    if let Err(error) = Op::parse(op) {
        assert!(!error.to_string().is_empty());
    }
    if let Some((id, _)) = rest.split_first_chunk::<BUS_ID_LEN>() {
        assert!(
            wire::bus_id(id).is_ok_and(|id| id.len() <= BUS_ID_LEN && !id.contains('\0'))
                || id.iter().any(|byte| *byte > 127)
        );
    }
}

/// What a message asked for, and whether it was answered.
enum Asked {
    Transfer { direction: Direction, over: bool },
    Unlink { victim: u32, over: bool },
}

#[derive(Default)]
struct Host {
    /// By sequence.
    asked: Vec<Asked>,
}

impl Host {
    /// Messages one after the other; between two of them a byte says what the board does.
    fn traffic(&mut self, mut bytes: &[u8]) {
        let mut device = Device::new(Descriptors::new(&Identity::default()).expect("the default is right"));
        let (mut frame, mut replies, mut giving) = (Frame::new(), Vec::new(), false);
        while let Some((header, rest)) = bytes.split_first_chunk::<HEADER_LEN>() {
            bytes = rest;
            match Command::parse(&self.numbered(*header)) {
                Err(error) => return assert!(!error.to_string().is_empty()),
                Ok(Command::Submit(transfer)) => {
                    self.asked.push(Asked::Transfer { direction: transfer.direction, over: false });
                    let len = if transfer.direction == Direction::Out { transfer.length as usize } else { 0 };
                    let (data, rest) = bytes.split_at(len.min(bytes.len()));
                    bytes = rest;
                    if device.submit(&transfer, data).is_err() {
                        return;
                    }
                }
                Ok(Command::Unlink { sequence, victim, .. }) => {
                    self.asked.push(Asked::Unlink { victim, over: false });
                    device.unlink(sequence, victim);
                }
            }
            let Some((does, rest)) = bytes.split_first() else { break };
            bytes = rest;
            if does & 1 != 0 {
                device.report(&frame);
            }
            if does & 2 != 0 {
                device.deliver();
            }
            if does & 4 != 0 {
                giving |= device.begin_write(&mut frame);
            }
            if does & 8 != 0 && std::mem::take(&mut giving) {
                device.written();
            }
            if does & 16 != 0 && std::mem::take(&mut giving) {
                device.not_written();
            }
            if does & 32 != 0 {
                device.begin_read();
            }
            device.take_replies(&mut replies);
            self.hear(&replies);
        }
    }

    /// The message with the next number, and a victim that there was.
    fn numbered(&self, mut header: [u8; HEADER_LEN]) -> [u8; HEADER_LEN] {
        let sequence = self.asked.len() as u32;
        header[4..8].copy_from_slice(&sequence.to_be_bytes());
        if header[..4] == [0, 0, 0, 2] {
            let victim = number(&header, 20) % (sequence + 1);
            header[20..24].copy_from_slice(&victim.to_be_bytes());
        }
        header
    }

    fn hear(&mut self, mut replies: &[u8]) {
        while !replies.is_empty() {
            let (header, rest) = replies.split_at(HEADER_LEN);
            let (command, sequence, status) = (number(header, 0), number(header, 4), number(header, 20) as i32);
            replies = rest;
            match &mut self.asked[sequence as usize] {
                Asked::Transfer { direction, over } => {
                    assert!(command == 3 && !std::mem::replace(over, true), "answered twice: {sequence}");
                    if *direction == Direction::In {
                        replies = &replies[number(header, 24) as usize..];
                    }
                }
                Asked::Unlink { victim, over } => {
                    assert!(command == 4 && !std::mem::replace(over, true), "answered twice: {sequence}");
                    let victim = *victim as usize;
                    if status == -104 {
                        let Asked::Transfer { over, .. } = &mut self.asked[victim] else {
                            panic!("an unlink was taken back");
                        };
                        assert!(!std::mem::replace(over, true), "taken back after its answer: {victim}");
                    }
                }
            }
        }
    }
}

fn number(bytes: &[u8], at: usize) -> u32 {
    u32::from_be_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
}
