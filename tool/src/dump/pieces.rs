//! Joins consecutive exchanges that are shorter than a packet. A driver transfers single bytes while it searches for
//! the packet size, and a driver with a small buffer transfers each packet in parts.

use ecmsk::link::Dir;
use ecmsk::recording::exchanges::RecordedBytes;
use ecmsk::xf::{DataSize, Resync};

/// The largest number of bytes of one direction that are joined. A longer sequence is shown in several parts. \[OURS]
const BYTES_MAX: usize = 1 << 20;

/// The joined pieces of packets in one direction.
#[derive(Debug, Default)]
pub struct Pieces {
    pub bytes: Vec<u8>,
    /// The number of exchanges that were joined.
    pub count: u64,
    /// The numbers of the first and the last piece in the recording. `since_ns` has their times since the first packet,
    /// in nanoseconds. `recorded_ns` is the recorded time of the first piece.
    pub numbers: [u64; 2],
    pub since_ns: [i64; 2],
    pub recorded_ns: u64,
}

impl Pieces {
    /// Whether an exchange transferred only a piece of a packet: its number of bytes is not a packet size.
    pub fn is_one(recorded: &RecordedBytes) -> bool {
        DataSize::of_packet(recorded.bytes.len()).is_none()
    }

    /// Appends the bytes of one exchange. `number` is its number in the recording.
    pub fn add(&mut self, number: u64, since_ns: i64, recorded: &RecordedBytes) {
        if self.count == 0 {
            (self.numbers[0], self.since_ns[0], self.recorded_ns) = (number, since_ns, recorded.at_ns);
        }
        (self.numbers[1], self.since_ns[1]) = (number, since_ns);
        self.bytes.extend_from_slice(&recorded.bytes);
        self.count += 1;
    }

    /// Whether the limit of joined bytes is reached.
    pub const fn is_full(&self) -> bool {
        self.bytes.len() >= BYTES_MAX
    }

    /// The packets in the joined bytes, and the number of bytes outside of packets. Equal consecutive packets are
    /// returned as one packet with a count.
    pub fn packets(&self, dir: Dir) -> (Vec<(u64, RecordedBytes)>, usize) {
        let (mut reader, mut rest, mut in_packets) = (Resync::new(), &self.bytes[..], 0);
        let mut packets: Vec<(u64, RecordedBytes)> = Vec::new();
        while !rest.is_empty() {
            rest = &rest[reader.push(rest)..];
            while let Some(packet) = reader.next_packet() {
                in_packets += packet.len();
                match packets.last_mut() {
                    Some((times, last)) if last.bytes == packet => *times += 1,
                    _ => packets.push((1, RecordedBytes { at_ns: self.recorded_ns, dir, bytes: packet.to_vec() })),
                }
            }
        }
        (packets, self.bytes.len() - in_packets)
    }

    /// The numbers of bytes, pieces and packets as text.
    pub fn summary(&self, packets: &[(u64, RecordedBytes)], in_none: usize) -> String {
        let (bytes, count) = (self.bytes.len(), self.count);
        let found: u64 = packets.iter().map(|(times, _)| times).sum();
        format!("{bytes} bytes in {count} pieces: {found} packets, and {in_none} bytes in none")
    }
}
