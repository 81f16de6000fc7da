//! A device without a server: transfers in, answers out.

use ecmsk::port::usbip::descriptors::Descriptors;
use ecmsk::port::usbip::device::Device;
use ecmsk::port::usbip::wire::{Command, Submit};
use ecmsk::port::usbip::{Identity, wire};
use ecmsk::sk::Frame;

use support::usbip_client::{self as client, IN, OUT, Reply};

pub const SET_CONFIGURATION: [u8; 8] = [0x00, 9, 1, 0, 0, 0, 0, 0];

pub fn transfer(sequence: u32, direction: u32, endpoint: u32, length: u32, setup: [u8; 8]) -> Submit {
    match Command::parse(&client::submit(sequence, direction, endpoint, length, setup)) {
        Ok(Command::Submit(transfer)) => transfer,
        other => panic!("{other:?}"),
    }
}

/// A device, and functions to submit transfers.
pub struct Board {
    pub device: Device,
    replies: Vec<u8>,
}

impl Board {
    /// Attached and not configured yet.
    pub fn attached() -> Self {
        Self { device: Device::new(Descriptors::new(&Identity::default()).unwrap()), replies: Vec::new() }
    }

    /// Ready for frames.
    pub fn new() -> Self {
        let mut board = Self::attached();
        assert_eq!(board.control(SET_CONFIGURATION, &[]), Ok(Vec::new()));
        board
    }

    pub fn read(&mut self, sequence: u32, length: u32) {
        self.device.submit(&transfer(sequence, IN, 1, length, [0; 8]), &[]).unwrap();
    }

    pub fn write(&mut self, sequence: u32, data: &[u8]) {
        self.device.submit(&transfer(sequence, OUT, 2, data.len() as u32, [0; 8]), data).unwrap();
    }

    pub fn report(&mut self, fill: u8) {
        self.device.report(&Frame::from_bytes([fill; 512]));
    }

    /// First byte of the next frame for the board.
    pub fn next_frame(&mut self) -> Option<u8> {
        let mut frame = Frame::from_bytes([0xA5; 512]);
        self.device.begin_write(&mut frame).then(|| frame.bytes()[0])
    }

    /// All answers since the last call that have no data.
    pub fn replies(&mut self) -> Vec<Reply> {
        let bytes = self.bytes();
        assert_eq!(bytes.len() % 48, 0, "there are data");
        bytes.chunks(48).map(Reply::parse).collect()
    }

    /// All answers since the last call, with their data: those of transfers to the host.
    pub fn reports(&mut self) -> Vec<(Reply, Vec<u8>)> {
        let bytes = self.bytes();
        let mut rest = &bytes[..];
        let mut all = Vec::new();
        while !rest.is_empty() {
            let reply = Reply::parse(&rest[..48]);
            let (data, after) = rest[48..].split_at(reply.actual as usize);
            all.push((reply, data.to_vec()));
            rest = after;
        }
        all
    }

    fn bytes(&mut self) -> Vec<u8> {
        self.device.take_replies(&mut self.replies);
        self.replies.clone()
    }

    /// A control transfer: its data, or the status.
    pub fn control(&mut self, setup: [u8; 8], out: &[u8]) -> Result<Vec<u8>, i32> {
        let length = u16::from_le_bytes([setup[6], setup[7]]);
        let direction = if setup[0] & 0x80 != 0 && length > 0 { IN } else { OUT };
        self.control_as(direction, u32::from(length), setup, out)
    }

    pub fn control_as(&mut self, direction: u32, room: u32, setup: [u8; 8], out: &[u8]) -> Result<Vec<u8>, i32> {
        assert!(out.len() <= wire::TRANSFER_LIMIT as usize);
        self.device.submit(&transfer(99, direction, 0, room, setup), out).unwrap();
        let bytes = self.bytes();
        let reply = Reply::parse(&bytes[..48]);
        assert_eq!((reply.command, reply.sequence), (3, 99));
        let data = bytes[48..].to_vec();
        assert_eq!(reply.actual as usize, data.len());
        if reply.status == 0 { Ok(data) } else { Err(reply.status) }
    }
}
