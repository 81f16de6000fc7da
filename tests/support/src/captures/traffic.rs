//! Traffic on a bus, which a test makes packet by packet.

use ecmsk::sk::Frame;

use super::convert::Event;

/// -ENOENT: the host took the transfer back.
pub const TAKEN_BACK: i32 = -2;

/// Packets in the order in which they pass, a microframe apart.
#[derive(Default)]
pub struct Traffic {
    pub events: Vec<Event>,
    pub transfers: u64,
}

/// A frame with that number in it; byte 3 is 0.
pub fn numbered(n: u8) -> Frame {
    let mut frame = Frame::new();
    frame.bytes_mut()[16] = n;
    frame
}

impl Traffic {
    /// `pipe`: kind of transfer and endpoint.
    fn push(&mut self, what: u8, pipe: (u8, u8), device: u8, status: i32, length: u32, data: Option<Vec<u8>>) {
        let at_us = 1_600_000_000_000_000 + 125 * self.events.len() as u64;
        let id = 0xFFFF_8880_0000_0000 + self.transfers;
        let (setup, (transfer, endpoint)) = (None, pipe);
        self.events.push(Event { id, what, transfer, endpoint, device, bus: 3, setup, status, length, data, at_us });
    }

    /// The host submits a frame that the device has not answered yet; returns the transfer's id.
    pub fn submitted(&mut self, device: u8, bytes: &[u8]) -> u64 {
        self.transfers += 1;
        self.push(b'S', (1, 0x02), device, -115, bytes.len() as u32, Some(bytes.to_vec()));
        self.events[self.events.len() - 1].id
    }

    /// The end of that transfer.
    pub fn completed(&mut self, device: u8, id: u64, status: i32, moved: u32) -> &mut Self {
        self.push(b'C', (1, 0x02), device, status, moved, None);
        let last = self.events.len() - 1;
        self.events[last].id = id;
        self
    }

    /// A frame to the device, which takes it.
    pub fn write(&mut self, device: u8, bytes: &[u8]) -> &mut Self {
        let id = self.submitted(device, bytes);
        self.completed(device, id, 0, bytes.len() as u32)
    }

    /// A report from the device.
    pub fn read(&mut self, device: u8, bytes: &[u8]) -> &mut Self {
        self.read_ended(device, 0, Some(bytes.to_vec()))
    }

    /// A read that ends with that status.
    pub fn read_ended(&mut self, device: u8, status: i32, data: Option<Vec<u8>>) -> &mut Self {
        self.transfers += 1;
        self.push(b'S', (1, 0x81), device, -115, 512, None);
        let length = data.as_ref().map_or(0, Vec::len) as u32;
        self.push(b'C', (1, 0x81), device, status, length, data);
        self
    }

    /// A bulk transfer to the device.
    pub fn bulk(&mut self, device: u8, bytes: &[u8]) -> &mut Self {
        self.transfers += 1;
        self.push(b'S', (3, 0x02), device, -115, bytes.len() as u32, Some(bytes.to_vec()));
        self.push(b'C', (3, 0x02), device, 0, bytes.len() as u32, None);
        self
    }

    /// A control transfer: its setup packet, then what the host sends or the device answers.
    pub fn control(&mut self, device: u8, setup: [u8; 8], bytes: &[u8]) -> &mut Self {
        self.transfers += 1;
        let to_host = setup[0] & 0x80 != 0;
        let (length, endpoint) = (u32::from(u16::from_le_bytes([setup[6], setup[7]])), setup[0] & 0x80);
        let sent = (!to_host).then(|| bytes.to_vec());
        self.push(b'S', (2, endpoint), device, -115, length, sent);
        let last = self.events.len() - 1;
        self.events[last].setup = Some(setup);
        self.push(b'C', (2, endpoint), device, 0, bytes.len() as u32, to_host.then(|| bytes.to_vec()));
        self
    }

    /// GET_DESCRIPTOR of the device, and its answer.
    pub fn descriptor(&mut self, device: u8, (vendor, product): (u16, u16)) -> &mut Self {
        let ids = [vendor.to_le_bytes(), product.to_le_bytes()].concat();
        let descriptor = [&[18, 1, 0, 2, 0, 0, 0, 64][..], &ids, &[0, 1, 1, 2, 3, 1]].concat();
        self.control(device, [0x80, 6, 0, 1, 0, 0, 18, 0], &descriptor)
    }

    /// HID's SET_REPORT of an output report.
    pub fn set_report(&mut self, device: u8, bytes: &[u8]) -> &mut Self {
        let length = (bytes.len() as u16).to_le_bytes();
        self.control(device, [0x21, 9, 0, 2, 0, 0, length[0], length[1]], bytes)
    }
}
