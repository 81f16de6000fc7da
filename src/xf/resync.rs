//! Finds packets in a stream of bytes: nobody knows where in the stream one begins, or how long it is.
//!
//! That is so on SPI when a host starts while the chip runs, and on USB behind a serial port. What the vendor's driver
//! does is seen in it (OBS): where an end word and a start word follow each other there is a border between packets,
//! and two such borders show n. A border may stand in data as well, so that here the check word between the two has to
//! be right too, by either of its types and any coverage. Once n is known, start word and end word alone tell a
//! packet, so that one with a wrong check word reaches the parser, which names the error.

use super::{DataSize, END_WORD, FIXED_CHECK, HEADER_LEN, MAX_PACKET, NOT_READY, START_WORD};

/// Bytes of a border: end word and start word.
const BORDER: usize = 8;
/// Bytes that the reader holds: two packets of the longest kind and the beginning of a third one, so that the packet in
/// front of a border is not lost while the next border has not come.
const CAPACITY: usize = 2 * MAX_PACKET + BORDER;

/// \[OURS] So many bytes in no packet show that a size is wrong which the reader has found by itself: that of a damaged packet, perhaps.
const FRUITLESS_MAX: usize = 2 * MAX_PACKET;

/// A reader that takes bytes and gives packets. It holds 2888 bytes at most.
///
/// ```
/// use ecmsk::xf::{CheckRule, CommandHeader, DataSize, MAX_PACKET, Resync, request::InfoUpdate, write_request};
///
/// let mut buffer = [0; MAX_PACKET];
/// let header = CommandHeader::with_index(1);
/// let packet = write_request(&mut buffer, DataSize::MANUAL, CheckRule::CRC32, header, &InfoUpdate)?;
///
/// let mut reader = Resync::new();
/// let mut found = 0;
/// for bytes in [&packet[100..], packet, packet, packet] {
///     let mut rest = bytes;
///     while !rest.is_empty() {
///         rest = &rest[reader.push(rest)..];
///         while let Some(received) = reader.next_packet() {
///             assert_eq!(received, packet);
///             found += 1;
///         }
///     }
/// }
/// assert_eq!((reader.size(), found, reader.dropped()), (Some(DataSize::MANUAL), 3, 44));
/// # Ok::<(), ecmsk::xf::WriteError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Resync {
    bytes: [u8; CAPACITY],
    /// Bytes that are held, from the beginning of `bytes`.
    held: usize,
    /// Bytes at the beginning that were given away as a packet.
    given: usize,
    /// Where the first border may be that was not yet compared with those in front of it. Without it a stream that is
    /// full of borders would be compared anew with each byte that comes.
    compared: usize,
    size: Option<DataSize>,
    /// The reader found the size by itself.
    found: bool,
    /// Bytes in no packet since the newest one, or since the size was found.
    fruitless: usize,
    dropped: u64,
}

impl Default for Resync {
    fn default() -> Self {
        Self::new()
    }
}

impl Resync {
    /// A reader that finds n by itself.
    pub const fn new() -> Self {
        Self {
            bytes: [0; CAPACITY],
            held: 0,
            given: 0,
            compared: 0,
            size: None,
            found: false,
            fruitless: 0,
            dropped: 0,
        }
    }

    /// A reader for packets of that size.
    pub const fn with_size(size: DataSize) -> Self {
        Self { size: Some(size), ..Self::new() }
    }

    /// The size of the data segment, if it is known.
    pub const fn size(&self) -> Option<DataSize> {
        self.size
    }

    /// From now on packets have that size, as after SPI_RECONFIG_OP; with `None` the reader finds it again. Bytes that
    /// are held stay.
    pub const fn set_size(&mut self, size: Option<DataSize>) {
        self.compared = 0;
        (self.found, self.fruitless) = (false, 0);
        self.size = size;
    }

    /// How many bytes were in no packet.
    pub const fn dropped(&self) -> u64 {
        self.dropped
    }

    /// Takes bytes and returns how many: all that there is room for, and at least one whenever [`Self::next_packet`]
    /// has just given nothing.
    pub fn push(&mut self, bytes: &[u8]) -> usize {
        self.forget_given();
        let taken = bytes.len().min(CAPACITY - self.held);
        self.bytes[self.held..self.held + taken].copy_from_slice(&bytes[..taken]);
        self.held += taken;
        taken
    }

    /// The next packet, n + 32 bytes with a right start word and a right end word; `None` until more bytes have come.
    pub fn next_packet(&mut self) -> Option<&[u8]> {
        self.forget_given();
        let len = loop {
            let size = match self.size {
                Some(size) => size,
                None => {
                    let size = self.find_size()?;
                    self.found = true;
                    size
                }
            };
            self.size = Some(size);
            let len = size.packet_len();
            let skipped = self.find_packet(len);
            self.drop_front(skipped);
            self.fruitless += skipped;
            if self.found && self.fruitless > FRUITLESS_MAX {
                self.set_size(None);
                continue;
            }
            if self.held < len || !self.is_packet(0, len) {
                return None;
            }
            if !(self.found && self.is_joined(len)) {
                break len;
            }
            self.set_size(None);
        };
        (self.given, self.fruitless) = (len, 0);
        Some(&self.bytes[..len])
    }

    fn forget_given(&mut self) {
        self.bytes.copy_within(self.given..self.held, 0);
        self.held -= self.given;
        self.given = 0;
    }

    fn drop_front(&mut self, n: usize) {
        self.bytes.copy_within(n..self.held, 0);
        self.held -= n;
        self.compared = self.compared.saturating_sub(n);
        self.dropped += n as u64;
    }

    /// Whether the word at byte `at` is there and is this one.
    fn has(&self, at: usize, word: u32) -> bool {
        self.bytes[..self.held].get(at..at + 4) == Some(&word.to_le_bytes())
    }

    /// Whether an end word and a start word follow each other at byte `at`.
    fn is_border(&self, at: usize) -> bool {
        self.has(at, END_WORD) && self.has(at + 4, START_WORD)
    }

    /// Whether a packet of `len` bytes, all of which are held, stands at byte `at`.
    fn is_packet(&self, at: usize, len: usize) -> bool {
        self.has(at, START_WORD) && self.has(at + len - 4, END_WORD)
    }

    /// Whether a word that is no CRC stands at byte `at` as a check word: it says nothing about the bytes in front of
    /// it.
    fn has_constant_check(&self, at: usize) -> bool {
        self.has(at, FIXED_CHECK) || self.has(at, NOT_READY)
    }

    /// `[OURS]` Whether the packet of `len` bytes at the beginning is more likely two. Without a CRC that is what n is
    /// taken for if the border between two packets was damaged when n was looked for.
    fn is_joined(&self, len: usize) -> bool {
        let shortest = DataSize::MIN.packet_len();
        let is_end = |at: usize| self.has_constant_check(at - 4) && self.is_border(at);
        self.has_constant_check(len - 8) && (shortest..=len.saturating_sub(shortest)).any(|end| is_end(end - 4))
    }

    /// How many bytes are in front of the first place where a packet of that length is, or may be once more bytes have
    /// come.
    fn find_packet(&self, len: usize) -> usize {
        (0..self.held)
            .find(|&at| {
                let start = START_WORD.to_le_bytes();
                let here = &self.bytes[at..self.held];
                let begins = here.iter().zip(start).all(|(byte, word)| *byte == word);
                begins && (here.len() < len || self.has(at + len - 4, END_WORD))
            })
            .unwrap_or(self.held)
    }

    /// Finds n. What cannot belong to a packet any more is dropped, so that there is room for more.
    fn find_size(&mut self) -> Option<DataSize> {
        let places = (self.held + 1).saturating_sub(BORDER);
        let is_border = |at: &usize| self.is_border(*at);
        let found = (0..places).filter(is_border).find_map(|first| {
            let packet = first + 4;
            let behind = (self.compared.max(first + 1)..places).filter(is_border);
            Some((packet, self.checked(packet, behind.map(|second| second + 4 - packet))?))
        });
        if let Some((packet, size)) = found {
            let whole = self.packets_before(packet, size.packet_len());
            self.drop_front(packet - whole);
            return Some(size);
        }
        self.compared = places;
        if self.held == CAPACITY {
            // Borders in front of this place were compared with all that there can be behind them.
            let undecided = CAPACITY + 1 - (MAX_PACKET + BORDER);
            // The last bytes may be the beginning of a border.
            let border = (undecided..places).find(|at| self.is_border(*at)).unwrap_or(places);
            // The packet in front of that border may be a whole one.
            let earliest = border + 4 - MAX_PACKET;
            let kept = (earliest..border).find(|at| self.has(*at, START_WORD)).unwrap_or(border);
            self.drop_front(kept);
        }
        None
    }

    /// The first of the lengths, which ascend, with which the bytes from `packet` on have a right check word.
    ///
    /// `[OURS]` The vendor's driver goes by the borders alone.
    fn checked(&self, packet: usize, lens: impl Iterator<Item = usize>) -> Option<DataSize> {
        let bytes = &self.bytes[packet..self.held];
        let valid = HEADER_LEN + usize::from(u16::from_le_bytes([*bytes.get(0x0E)?, *bytes.get(0x0F)?]));
        let (mut digest, mut covered) = (crc32fast::Hasher::new(), 0);
        let mut of_valid = [valid, valid.next_multiple_of(4)].map(|end| (end, None));
        lens.filter_map(DataSize::of_packet).find(|size| {
            let end = HEADER_LEN + size.bytes();
            let Some(word) = bytes.get(end..end + 4) else { return false };
            let word = u32::from_le_bytes([word[0], word[1], word[2], word[3]]);
            digest.update(&bytes[covered..end]);
            covered = end;
            word == FIXED_CHECK
                || word == NOT_READY
                || word == digest.clone().finalize()
                || of_valid.iter_mut().any(|(valid, crc)| {
                    *valid <= end && word == *crc.get_or_insert_with(|| crc32fast::hash(&bytes[..*valid]))
                })
        })
    }

    /// How many bytes of whole packets of that length stand right in front of `packet`.
    fn packets_before(&self, packet: usize, len: usize) -> usize {
        let mut whole = 0;
        while packet - whole >= len && self.is_packet(packet - whole - len, len) {
            whole += len;
        }
        whole
    }
}
