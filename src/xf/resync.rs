//! Finds packets in a stream of bytes in which the position and the length of packets are unknown.
//!
//! Such a stream occurs on SPI when a host starts while the chip is running, and on a USB serial port. The method is
//! the one of the vendor's driver (OBS): an end word followed by a start word is a border between packets, and two such
//! borders give n. Data may contain the same words, so this reader also requires a valid check word between the
//! borders, of either type and with any coverage. Once n is known, start word and end word alone identify a packet. A
//! packet with a wrong check word then reaches the parser, which reports the error.

use super::{DataSize, END_WORD, FIXED_CHECK, HEADER_LEN, MAX_PACKET, NOT_READY, START_WORD};

/// Length of a border in bytes: end word and start word.
const BORDER: usize = 8;
/// Capacity of the reader in bytes: two packets of the maximum length and one border. This is enough to keep the packet
/// before a border until the next border arrives.
const CAPACITY: usize = 2 * MAX_PACKET + BORDER;

/// \[OURS] After this many bytes in a row that belong to no packet, a size that the reader has found by itself counts
/// as wrong, and the reader searches again. The size may come from a damaged packet. With the right size, at least one
/// whole packet comes within these bytes.
const FRUITLESS_MAX: usize = 2 * MAX_PACKET;

/// A reader that takes bytes and returns packets. It holds at most 2888 bytes.
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
    /// Number of received bytes in the buffer `bytes`, from its beginning on.
    held: usize,
    /// Number of bytes at the beginning of `bytes` that were returned as a packet. The next call of `push` or
    /// `next_packet` removes them.
    given: usize,
    /// All borders before this position of `bytes` were already compared with the borders before them. Without it, each
    /// new byte would cause all pairs of borders to be compared again.
    compared: usize,
    size: Option<DataSize>,
    /// True if the reader itself has found the packet size; false if the caller has set it or it is unknown.
    found: bool,
    /// Number of bytes outside packets since the newest packet, or since the size was found.
    fruitless: usize,
    dropped: u64,
}

impl Default for Resync {
    fn default() -> Self {
        Self::new()
    }
}

impl Resync {
    /// A reader that finds n (the size of the data segment) by itself.
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

    /// A reader for packets whose data segment has this size.
    pub const fn with_size(size: DataSize) -> Self {
        Self { size: Some(size), ..Self::new() }
    }

    /// The size of the data segment, once it is known.
    pub const fn size(&self) -> Option<DataSize> {
        self.size
    }

    /// Sets the size of packets from now on, as after SPI_RECONFIG_OP; with `None` the reader finds it again. Held
    /// bytes are kept.
    pub const fn set_size(&mut self, size: Option<DataSize>) {
        self.compared = 0;
        (self.found, self.fruitless) = (false, 0);
        self.size = size;
    }

    /// The number of bytes that were skipped because they were not part of a packet.
    pub const fn dropped(&self) -> u64 {
        self.dropped
    }

    /// Takes as many bytes as there is room for, and returns their number. There is room for at least one if
    /// [`Self::next_packet`] has just returned `None`.
    pub fn push(&mut self, bytes: &[u8]) -> usize {
        self.forget_given();
        let taken = bytes.len().min(CAPACITY - self.held);
        self.bytes[self.held..self.held + taken].copy_from_slice(&bytes[..taken]);
        self.held += taken;
        taken
    }

    /// The next packet, n + 32 bytes with valid start and end words; `None` if more bytes are needed.
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

    /// Whether this word is at byte `at`.
    fn has(&self, at: usize, word: u32) -> bool {
        self.bytes[..self.held].get(at..at + 4) == Some(&word.to_le_bytes())
    }

    /// Whether a border, an end word followed by a start word, is at byte `at`.
    fn is_border(&self, at: usize) -> bool {
        self.has(at, END_WORD) && self.has(at + 4, START_WORD)
    }

    /// Whether a complete packet of `len` bytes begins at byte `at`.
    fn is_packet(&self, at: usize, len: usize) -> bool {
        self.has(at, START_WORD) && self.has(at + len - 4, END_WORD)
    }

    /// Whether the check word at byte `at` is constant (fixed or "not ready"), so that it proves nothing about the
    /// bytes before it.
    fn has_constant_check(&self, at: usize) -> bool {
        self.has(at, FIXED_CHECK) || self.has(at, NOT_READY)
    }

    /// `[OURS]` Whether the packet of `len` bytes at the beginning is more likely two packets. Without a CRC, the
    /// reader finds a size that is too large if the border between two packets was damaged during the search.
    fn is_joined(&self, len: usize) -> bool {
        let shortest = DataSize::MIN.packet_len();
        let is_end = |at: usize| self.has_constant_check(at - 4) && self.is_border(at);
        self.has_constant_check(len - 8) && (shortest..=len.saturating_sub(shortest)).any(|end| is_end(end - 4))
    }

    /// The number of bytes before the first position at which a packet of `len` bytes begins. A start word whose packet
    /// is still incomplete counts as such a position.
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

    /// Finds the data segment size n. Bytes that cannot belong to a packet any more are dropped to make room.
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
            // The buffer holds the longest packet, and the border after it, for each border before position
            // `undecided`. So every border that can end that packet was tried, and no packet with a valid check word
            // begins at such a border.
            let undecided = CAPACITY + 1 - (MAX_PACKET + BORDER);
            // If no complete border (end word, start word) follows, the last bytes are kept: a border may begin in them.
            let border = (undecided..places).find(|at| self.is_border(*at)).unwrap_or(places);
            // The packet that ends at that border may be complete, so it is kept.
            let earliest = border + 4 - MAX_PACKET;
            let kept = (earliest..border).find(|at| self.has(*at, START_WORD)).unwrap_or(border);
            self.drop_front(kept);
        }
        None
    }

    /// The data segment size for the first of the lengths `lens`, in ascending order, with which the packet at byte
    /// `packet` has a valid check word.
    ///
    /// `[OURS]` The check of the check word is an addition: the vendor's driver relies on the borders alone.
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

    /// The total length of complete packets of `len` bytes directly before byte `packet`.
    fn packets_before(&self, packet: usize, len: usize) -> usize {
        let mut whole = 0;
        while packet - whole >= len && self.is_packet(packet - whole - len, len) {
            whole += len;
        }
        whole
    }
}
