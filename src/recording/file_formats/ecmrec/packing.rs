//! Packets stored as differences from the previous packet in the same direction.
//!
//! From one cycle to the next few bytes of a frame change, and these by nearly the same amount: counters, targets,
//! positions. So each 32-bit word of a packet is stored as its difference from the same word in the previous packet of
//! this direction. The differences of one word in all packets are stored together: a word that never changes takes no
//! byte, and one that changes evenly becomes a run of equal bytes, which compress well. A word that accelerates and
//! brakes, as the target of an axis does, has small second differences, the differences of its differences. The second
//! differences of a noisy measured value are larger than its first differences. So for each word the kind of
//! differences that is smaller is stored.
//!
//! The contents of a block, with numbers in LEB128, and signed numbers in zigzag encoding:
//!
//! 1. the number of packets, and the number of words of the longest packet
//! 2. a byte for each packet: bit 0 is its direction (1: from the board); bit 1 is set if its length differs from that
//!    of the previous packet in this direction
//! 3. the lengths of the packets whose bit 1 is set, bytes
//! 4. for each packet, ns: the time since the previous packet in this direction, minus the same time of that previous
//!    packet
//! 5. for each direction: a bit for each word that says whether it changes in any packet; a bit for each word that says
//!    whether it is stored as second differences (not in version 1 of the format); and then, for each word that changes,
//!    its differences in all packets

use crate::sk::Dir;

use super::header::BYTES_MAX;

/// The most packets of a block that are read; more are an error. \[OURS] Blocks that this crate writes have a fortieth
/// of this.
const PACKETS_MAX: usize = 1 << 16;
/// The size of a word in bytes. Differences between packets are stored word by word.
const WORD: usize = size_of::<u32>();

const FROM_BOARD: u8 = 1;
const OTHER_LENGTH: u8 = 2;

/// A packet to pack.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Packet<'a> {
    /// The time of the packet as the file has it, ns.
    pub at_ns: u64,
    pub dir: Dir,
    pub bytes: &'a [u8],
}

/// The previous packet of one direction, from which the next one is stored as a difference.
#[derive(Clone, Debug, Default)]
struct Before {
    words: Vec<u32>,
    /// The difference of each word between the previous packet and the one before that.
    steps: Vec<u32>,
    len: usize,
    at_ns: u64,
    /// The time between the previous packet and the one before that, ns.
    since_ns: u64,
}

impl Before {
    fn begin(&mut self, at_ns: u64) {
        self.words.fill(0);
        self.steps.fill(0);
        (self.len, self.at_ns, self.since_ns) = (0, at_ns, 0);
    }

    fn make_room(&mut self, words: usize) {
        if self.words.len() < words {
            self.words.resize(words, 0);
            self.steps.resize(words, 0);
        }
    }
}

/// Packs packets. Its buffers grow to the size of the longest block and are reused.
#[derive(Debug, Default)]
pub(crate) struct Packer {
    before: [Before; 2],
    /// The differences of all words, packet by packet.
    differences: Vec<u32>,
    /// For each direction, the indices of its packets in the block, from 0.
    of_dir: [Vec<usize>; 2],
    /// For each direction and word, all differences of the block combined by OR; 0: the word never changes.
    changed: [Vec<u32>; 2],
    /// The differences of one word in all packets of one direction.
    column: Vec<u32>,
}

impl Packer {
    /// Begins a block that can be read without earlier ones: the words of the previous packets count as 0, and their
    /// times as `at_ns`. `at_ns` is the earliest time of the block, which the reader finds in the header.
    pub fn begin(&mut self, at_ns: u64) {
        self.before.iter_mut().for_each(|before| before.begin(at_ns));
    }

    /// Packs the packets of one block or piece, and appends the result to `out`.
    pub fn pack<'a>(&mut self, packets: impl Iterator<Item = Packet<'a>> + Clone, out: &mut Vec<u8>) {
        let (mut count, mut words) = (0, 0);
        for packet in packets.clone() {
            count += 1;
            words = words.max(packet.bytes.len().div_ceil(WORD));
        }
        put(out, count as u64);
        put(out, words as u64);
        self.make_room(count, words);
        let lengths = self.packets(packets.clone(), words, out);
        out.extend(lengths);
        self.times(packets, out);
        for dir in 0..2 {
            self.columns(dir, words, out);
        }
    }

    /// Appends the differences of the packets of one direction to `out`.
    fn columns(&mut self, dir: usize, words: usize, out: &mut Vec<u8>) {
        let packets = &self.of_dir[dir];
        let changed_at = out.len();
        let seconds_at = changed_at + words.div_ceil(8);
        out.resize(seconds_at + words.div_ceil(8), 0);
        if packets.is_empty() {
            return;
        }
        let set = |out: &mut Vec<u8>, at: usize, word: usize| out[at + word / 8] |= 1 << (word % 8);
        for (word, step) in self.before[dir].steps.iter_mut().enumerate().take(words) {
            if self.changed[dir][word] == 0 {
                *step = 0;
                continue;
            }
            set(out, changed_at, word);
            self.column.clear();
            self.column.extend(packets.iter().map(|packet| self.differences[packet * words + word]));
            let before = std::mem::replace(step, self.column.last().copied().unwrap_or_default());
            let seconds = || {
                self.column
                    .iter()
                    .scan(before, |before, step| Some(zigzag(step.wrapping_sub(std::mem::replace(before, *step)))))
            };
            let firsts = || self.column.iter().map(|step| zigzag(*step));
            if bits(seconds()) < bits(firsts()) {
                set(out, seconds_at, word);
                seconds().for_each(|number| put(out, number));
            } else {
                firsts().for_each(|number| put(out, number));
            }
        }
    }

    fn make_room(&mut self, count: usize, words: usize) {
        self.differences.clear();
        self.differences.resize(count * words, 0);
        for (before, changed) in self.before.iter_mut().zip(&mut self.changed) {
            before.make_room(words);
            changed.clear();
            changed.resize(words, 0);
        }
        self.of_dir.iter_mut().for_each(Vec::clear);
    }

    /// For each packet appends a byte to `out`: its direction, and whether its length differs from that of the previous
    /// packet in this direction. Also calculates the difference of each word from the same word of that previous
    /// packet. Returns the encoded lengths of the packets whose length differs.
    fn packets<'a>(&mut self, packets: impl Iterator<Item = Packet<'a>>, words: usize, out: &mut Vec<u8>) -> Vec<u8> {
        let mut lengths = Vec::new();
        for (number, packet) in packets.enumerate() {
            let dir = index(packet.dir);
            let before = &mut self.before[dir];
            let has_other_length = before.len != packet.bytes.len();
            out.push((dir as u8 * FROM_BOARD) | if has_other_length { OTHER_LENGTH } else { 0 });
            if has_other_length {
                put(&mut lengths, packet.bytes.len() as u64);
                before.len = packet.bytes.len();
            }
            self.of_dir[dir].push(number);
            let differences = &mut self.differences[number * words..][..words];
            let changed = &mut self.changed[dir];
            for (((bytes, before), difference), changed) in
                packet.bytes.chunks(WORD).zip(&mut before.words).zip(differences).zip(changed)
            {
                let word = word(bytes);
                *difference = word.wrapping_sub(*before);
                *before = word;
                *changed |= *difference;
            }
        }
        lengths
    }

    fn times<'a>(&mut self, packets: impl Iterator<Item = Packet<'a>>, out: &mut Vec<u8>) {
        for packet in packets {
            let before = &mut self.before[index(packet.dir)];
            let since_ns = packet.at_ns.wrapping_sub(before.at_ns);
            let difference = since_ns.wrapping_sub(before.since_ns) as i64;
            put(out, (difference << 1 ^ difference >> 63) as u64);
            (before.at_ns, before.since_ns) = (packet.at_ns, since_ns);
        }
    }
}

/// Unpacks the packets of a block.
#[derive(Debug, Default)]
pub(crate) struct Unpacker {
    before: [Before; 2],
    /// Direction, length in bytes and time in ns of each packet.
    packets: Vec<(Dir, usize, u64)>,
    differences: Vec<u32>,
    words: usize,
    next: usize,
}

/// The error of contents that are not packed packets.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct NotPacked;

impl Unpacker {
    /// Begins a block that can be read without earlier ones, with the same `at_ns` as in [`Packer::begin`].
    pub fn begin(&mut self, at_ns: u64) {
        self.before.iter_mut().for_each(|before| before.begin(at_ns));
        self.packets.clear();
        self.next = 0;
    }

    /// Decodes the uncompressed contents of a block or piece that has the version `version` of the format.
    /// [`Self::next`] then returns its packets.
    ///
    /// # Errors
    /// The contents are damaged; there are no packets then.
    pub fn take(&mut self, version: u8, bytes: &[u8]) -> Result<(), NotPacked> {
        self.packets.clear();
        self.next = 0;
        let taken = self.read(version, bytes);
        if taken.is_none() {
            self.packets.clear();
        }
        taken.ok_or(NotPacked)
    }

    fn read(&mut self, version: u8, mut bytes: &[u8]) -> Option<()> {
        let bytes = &mut bytes;
        let count = usize::try_from(get(bytes)?).ok().filter(|count| *count <= PACKETS_MAX)?;
        self.words = usize::try_from(get(bytes)?).ok().filter(|words| *words <= BYTES_MAX / WORD)?;
        let differences = count.checked_mul(self.words).filter(|words| *words <= BYTES_MAX / WORD)?;
        let (kinds, rest) = bytes.split_at_checked(count)?;
        *bytes = rest;
        for kind in kinds {
            let dir = if kind & FROM_BOARD == 0 { Dir::Write } else { Dir::Read };
            let before = &mut self.before[index(dir)];
            if kind & OTHER_LENGTH != 0 {
                before.len = usize::try_from(get(bytes)?).ok()?;
            }
            if before.len > self.words * WORD {
                return None;
            }
            self.packets.push((dir, before.len, 0));
        }
        for (dir, _, at_ns) in &mut self.packets {
            let before = &mut self.before[index(*dir)];
            let number = get(bytes)?;
            let difference = (number >> 1) as i64 ^ -((number & 1) as i64);
            before.since_ns = before.since_ns.wrapping_add(difference as u64);
            before.at_ns = before.at_ns.wrapping_add(before.since_ns);
            *at_ns = before.at_ns;
        }
        self.differences.clear();
        self.differences.resize(differences, 0);
        [Dir::Write, Dir::Read].into_iter().try_for_each(|dir| self.read_differences(version, dir, bytes))
    }

    fn read_differences(&mut self, version: u8, dir: Dir, bytes: &mut &[u8]) -> Option<()> {
        let words = self.words;
        let before = &mut self.before[index(dir)];
        before.make_room(words);
        let (changed, rest) = bytes.split_at_checked(words.div_ceil(8))?;
        let (seconds, rest) = if version > 1 { rest.split_at_checked(words.div_ceil(8))? } else { (&[][..], rest) };
        *bytes = rest;
        let is_set = |bits: &[u8], word: usize| bits.get(word / 8).is_some_and(|byte| byte & 1 << (word % 8) != 0);
        let packets = || self.packets.iter().enumerate().filter(|(_, packet)| packet.0 == dir);
        let has_packets = packets().next().is_some();
        for (word, step) in before.steps.iter_mut().enumerate().take(words) {
            if !is_set(changed, word) {
                if has_packets {
                    *step = 0;
                }
                continue;
            }
            for (number, _) in packets() {
                let difference = unzigzag(u32::try_from(get(bytes)?).ok()?);
                *step = if is_set(seconds, word) { step.wrapping_add(difference) } else { difference };
                self.differences[number * words + word] = *step;
            }
        }
        Some(())
    }

    /// The number of packets that [`Self::next`] has not returned yet.
    pub const fn left(&self) -> usize {
        self.packets.len() - self.next
    }

    /// Appends the bytes of the next packet to `out`. Returns its direction and its time in ns; `None`: there are no
    /// more packets.
    pub fn next(&mut self, out: &mut Vec<u8>) -> Option<(Dir, u64)> {
        let (dir, len, at_ns) = *self.packets.get(self.next)?;
        let differences = &self.differences[self.next * self.words..][..self.words];
        self.next += 1;
        let begin = out.len();
        let words = &mut self.before[index(dir)].words;
        out.resize(begin + len.next_multiple_of(WORD), 0);
        for ((word, difference), bytes) in words.iter_mut().zip(differences).zip(out[begin..].as_chunks_mut::<WORD>().0)
        {
            *word = word.wrapping_add(*difference);
            *bytes = word.to_le_bytes();
        }
        out.truncate(begin + len);
        Some((dir, at_ns))
    }
}

const fn index(dir: Dir) -> usize {
    match dir {
        Dir::Write => 0,
        Dir::Read => 1,
    }
}

/// The next word of a packet, little endian. If the packet ends within the word, the missing bytes count as 0.
fn word(bytes: &[u8]) -> u32 {
    match bytes.first_chunk() {
        Some(bytes) => u32::from_le_bytes(*bytes),
        None => bytes.iter().rev().fold(0, |word, byte| word << 8 | u32::from(*byte)),
    }
}

/// Zigzag encoding: small differences of either sign become small numbers, which take few bytes in LEB128.
const fn zigzag(difference: u32) -> u64 {
    (difference << 1 ^ (difference as i32 >> 31) as u32) as u64
}

const fn unzigzag(number: u32) -> u32 {
    number >> 1 ^ (number & 1).wrapping_neg()
}

/// The number of bits that the numbers need, which is about what they take in a compressed block.
fn bits(numbers: impl Iterator<Item = u64>) -> u32 {
    numbers.map(|number| u64::BITS - number.leading_zeros()).sum()
}

fn put(out: &mut Vec<u8>, mut number: u64) {
    while number >= 0x80 {
        out.push(number as u8 | 0x80);
        number >>= 7;
    }
    out.push(number as u8);
}

fn get(bytes: &mut &[u8]) -> Option<u64> {
    let mut number = 0;
    for shift in (0..u64::BITS).step_by(7) {
        let (byte, rest) = bytes.split_first()?;
        *bytes = rest;
        number |= u64::from(byte & 0x7F) << shift;
        if byte & 0x80 == 0 {
            return Some(number);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::header::VERSION;
    use super::*;

    type Owned = (u64, bool, Vec<u8>);

    fn packet((at_ns, is_read, bytes): &Owned) -> Packet<'_> {
        Packet { at_ns: *at_ns, dir: if *is_read { Dir::Read } else { Dir::Write }, bytes }
    }

    fn unpacked(unpacker: &mut Unpacker, bytes: &[u8]) -> Vec<Owned> {
        unpacker.take(VERSION, bytes).expect("it was packed");
        let mut found = Vec::new();
        loop {
            let mut bytes = Vec::new();
            let Some((dir, at_ns)) = unpacker.next(&mut bytes) else { return found };
            found.push((at_ns, dir == Dir::Read, bytes));
        }
    }

    fn packets() -> impl Strategy<Value = Vec<Owned>> {
        let packet =
            (any::<u64>(), any::<bool>(), prop::collection::vec(prop_oneof![3 => Just(0), 1 => any::<u8>()], 0..40));
        prop::collection::vec(packet, 0..20)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        /// Packets of any lengths and times are unpacked as they were packed: in one block, and in pieces that continue
        /// each other.
        #[test]
        fn packets_are_unpacked_as_they_were(pieces in prop::collection::vec(packets(), 1..4), begin in any::<u64>()) {
            let (mut packer, mut unpacker) = (Packer::default(), Unpacker::default());
            packer.begin(begin);
            unpacker.begin(begin);
            for piece in &pieces {
                let mut bytes = Vec::new();
                packer.pack(piece.iter().map(packet), &mut bytes);
                prop_assert_eq!(&unpacked(&mut unpacker, &bytes), piece);
            }
        }

        /// Bytes that are no packed packets are an error and no panic, and need no more memory than a block.
        #[test]
        fn other_bytes_are_refused(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            let mut unpacker = Unpacker::default();
            unpacker.begin(0);
            for version in 1..=VERSION {
                unpacker.begin(0);
                if unpacker.take(version, &bytes).is_ok() {
                    while unpacker.next(&mut Vec::new()).is_some() {}
                }
                prop_assert_eq!(unpacker.left(), 0);
            }
        }
    }

    /// A target that accelerates evenly is stored as second differences, which need one byte each although its
    /// steps need more. A value with noise is not.
    #[test]
    fn smaller_differences_are_stored() {
        let pack = |value: &dyn Fn(u32) -> u32| {
            let packets: Vec<Owned> = (0..200).map(|n| (n, false, value(n as u32).to_le_bytes().to_vec())).collect();
            let mut packed = Vec::new();
            let mut packer = Packer::default();
            packer.begin(0);
            packer.pack(packets.iter().map(packet), &mut packed);
            let mut unpacker = Unpacker::default();
            unpacker.begin(0);
            assert_eq!(unpacked(&mut unpacker, &packed), packets);
            // Two bytes for the numbers of packets and words, a byte for each packet, its length once, and the times.
            packed.split_off(3 + 200 + 1 + 200)
        };
        let even = pack(&|n| 25 * n * n);
        assert_eq!(even[..2], [1, 1]);
        assert!(even.len() < 2 + 200 + 4, "{}", even.len());
        let noisy = pack(&|n| n.wrapping_mul(n).wrapping_mul(0x9E37_79B1) >> 26);
        assert_eq!(noisy[..2], [1, 0]);
    }

    /// A block of version 1 of the format, with first differences alone, stays readable: two packets of one word, 5 and 12.
    #[test]
    fn version_1_stays_readable() {
        let packed = [2, 1, OTHER_LENGTH, 0, 4, 0, 20, 1, 10, 14, 0];
        let mut unpacker = Unpacker::default();
        unpacker.begin(1000);
        assert_eq!(unpacker.take(1, &packed), Ok(()));
        let mut bytes = Vec::new();
        assert_eq!([(); 2].map(|()| unpacker.next(&mut bytes)), [1000, 1010].map(|at_ns| Some((Dir::Write, at_ns))));
        assert_eq!(bytes, [5, 0, 0, 0, 12, 0, 0, 0]);
    }
}
