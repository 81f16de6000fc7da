//! A USB/IP client written from the document (Documentation/usb/usbip_protocol.rst of Linux), with its own offsets.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::Duration;

/// Longer than any wait here: a test that hangs fails.
const PATIENCE: Duration = Duration::from_secs(20);

/// Board 1-1: bus 1, device 1.
pub const DEVICE_ID: u32 = 0x0001_0001;

pub const OUT: u32 = 0;
pub const IN: u32 = 1;

pub fn be32(bytes: &[u8], at: usize) -> u32 {
    u32::from_be_bytes(bytes[at..at + 4].try_into().unwrap())
}

pub fn be16(bytes: &[u8], at: usize) -> u16 {
    u16::from_be_bytes(bytes[at..at + 2].try_into().unwrap())
}

/// USBIP_CMD_SUBMIT's header.
pub fn submit(sequence: u32, direction: u32, endpoint: u32, length: u32, setup: [u8; 8]) -> [u8; 48] {
    let mut header = [0xA5; 48];
    for (at, value) in [(0, 1), (4, sequence), (8, DEVICE_ID), (12, direction), (16, endpoint), (20, 0x200)] {
        header[at..at + 4].copy_from_slice(&u32::to_be_bytes(value));
    }
    // Start frame and interval have any value; there are no isochronous packets.
    header[24..28].copy_from_slice(&length.to_be_bytes());
    header[32..36].copy_from_slice(&u32::MAX.to_be_bytes());
    header[40..48].copy_from_slice(&setup);
    header
}

/// USBIP_CMD_UNLINK's header.
pub fn unlink(sequence: u32, victim: u32) -> [u8; 48] {
    let mut header = [0; 48];
    for (at, value) in [(0, 2), (4, sequence), (8, DEVICE_ID), (20, victim)] {
        header[at..at + 4].copy_from_slice(&u32::to_be_bytes(value));
    }
    header
}

/// An answer. The caller, who knows the direction, counts only bytes to the host.
#[derive(Debug, PartialEq, Eq)]
pub struct Reply {
    /// 3: RET_SUBMIT, 4: RET_UNLINK.
    pub command: u32,
    pub sequence: u32,
    pub status: i32,
    pub actual: u32,
}

impl Reply {
    pub fn parse(header: &[u8]) -> Self {
        // devid, direction and ep are 0 in answers.
        assert_eq!(header[8..20], [0; 12], "{header:x?}");
        Self {
            command: be32(header, 0),
            sequence: be32(header, 4),
            status: be32(header, 20) as i32,
            actual: be32(header, 24),
        }
    }

    pub fn done(sequence: u32, actual: u32) -> Self {
        Self { command: 3, sequence, status: 0, actual }
    }

    pub fn stalled(sequence: u32) -> Self {
        Self { command: 3, sequence, status: -32, actual: 0 }
    }

    pub fn unlinked(sequence: u32) -> Self {
        Self { command: 4, sequence, status: -104, actual: 0 }
    }

    pub fn too_late(sequence: u32) -> Self {
        Self { command: 4, sequence, status: 0, actual: 0 }
    }
}

/// A connection to a server.
pub struct Client {
    pub stream: TcpStream,
    sequence: u32,
}

impl Client {
    pub fn connect(server: SocketAddr) -> Self {
        let stream = TcpStream::connect(server).expect("the server listens");
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        stream.set_nodelay(true).unwrap();
        Self { stream, sequence: 0 }
    }

    /// OP_REQ_DEVLIST: the devices' bus ids and all bytes after the number of devices.
    pub fn devices(mut self) -> (Vec<String>, Vec<u8>) {
        self.send(&[0x01, 0x11, 0x80, 0x05, 0, 0, 0, 0]);
        let head = self.receive(12);
        assert_eq!(head[..8], [0x01, 0x11, 0x00, 0x05, 0, 0, 0, 0]);
        let mut rest = Vec::new();
        self.stream.read_to_end(&mut rest).expect("the server closes after the list");
        assert_eq!(rest.len(), be32(&head, 8) as usize * 316, "a device and its one interface");
        let ids = rest.chunks(316).map(|device| text(&device[256..288])).collect();
        (ids, rest)
    }

    /// OP_REQ_IMPORT: the status, and the device if it is 0.
    pub fn import(&mut self, bus_id: &str) -> Result<Vec<u8>, u32> {
        let mut request = vec![0x01, 0x11, 0x80, 0x03, 0, 0, 0, 0];
        request.extend_from_slice(bus_id.as_bytes());
        request.resize(8 + 32, 0);
        self.send(&request);
        let head = self.receive(8);
        assert_eq!(head[..4], [0x01, 0x11, 0x00, 0x03]);
        match be32(&head, 4) {
            0 => Ok(self.receive(312)),
            status => Err(status),
        }
    }

    /// A client that has board 1-1, configured.
    pub fn attached(server: SocketAddr) -> Self {
        let mut client = Self::connect(server);
        client.import("1-1").expect("the board is free");
        assert_eq!(client.control([0x00, 9, 1, 0, 0, 0, 0, 0], &[]).0, 0, "SET_CONFIGURATION");
        client
    }

    /// As [`Self::attached`], waiting until the board is there and free.
    pub fn attached_in_time(server: SocketAddr) -> Self {
        loop {
            let mut client = Self::connect(server);
            match client.import("1-1") {
                Ok(_) => {
                    client.control([0x00, 9, 1, 0, 0, 0, 0, 0], &[]);
                    return client;
                }
                Err(_) => std::thread::sleep(Duration::from_millis(5)),
            }
        }
    }

    pub fn send(&mut self, bytes: &[u8]) {
        self.stream.write_all(bytes).expect("the server takes it");
    }

    pub fn receive(&mut self, len: usize) -> Vec<u8> {
        let mut bytes = vec![0; len];
        self.stream.read_exact(&mut bytes).expect("an answer");
        bytes
    }

    /// Whether the server has closed the connection, waiting for it.
    pub fn is_cut(&mut self) -> bool {
        let mut rest = Vec::new();
        match self.stream.read_to_end(&mut rest) {
            Ok(_) => true,
            Err(error) => !matches!(error.kind(), std::io::ErrorKind::WouldBlock | std::io::ErrorKind::TimedOut),
        }
    }

    pub fn next_sequence(&mut self) -> u32 {
        self.sequence += 1;
        self.sequence
    }

    /// Submits a read of a report; returns its sequence number.
    pub fn want_report(&mut self) -> u32 {
        let sequence = self.next_sequence();
        self.send(&submit(sequence, IN, 1, 512, [0; 8]));
        sequence
    }

    /// Submits a frame; returns its sequence number.
    pub fn give(&mut self, data: &[u8]) -> u32 {
        let sequence = self.next_sequence();
        let mut message = submit(sequence, OUT, 2, data.len() as u32, [0; 8]).to_vec();
        message.extend_from_slice(data);
        self.send(&message);
        sequence
    }

    pub fn take_back(&mut self, victim: u32) -> u32 {
        let sequence = self.next_sequence();
        self.send(&unlink(sequence, victim));
        sequence
    }

    pub fn reply(&mut self) -> Reply {
        Reply::parse(&self.receive(48))
    }

    /// The next answer, which has a report.
    pub fn report(&mut self) -> (Reply, Vec<u8>) {
        let reply = self.reply();
        let data = self.receive(reply.actual as usize);
        (reply, data)
    }

    /// Runs a control transfer; returns its status and data.
    pub fn control(&mut self, setup: [u8; 8], out: &[u8]) -> (i32, Vec<u8>) {
        let length = u16::from_le_bytes([setup[6], setup[7]]);
        let direction = if setup[0] & 0x80 != 0 && length > 0 { IN } else { OUT };
        let sequence = self.next_sequence();
        let mut message = submit(sequence, direction, 0, u32::from(length), setup).to_vec();
        message.extend_from_slice(out);
        self.send(&message);
        let reply = self.reply();
        assert_eq!((reply.command, reply.sequence), (3, sequence));
        let data = if direction == IN { self.receive(reply.actual as usize) } else { Vec::new() };
        (reply.status, data)
    }
}

fn text(field: &[u8]) -> String {
    let end = field.iter().position(|byte| *byte == 0).expect("a zero ends it");
    String::from_utf8(field[..end].to_vec()).unwrap()
}
