//! Logical addressing: the FMMUs' mapping between bits of a datagram and bits of the memory.

use std::ops::Range;

use super::Controller;
use super::managers::Managers;
use super::memory::Memory;
use crate::ethercat::registers::{self, Fmmu, FmmuDirections};

/// The maximum number of FMMUs of a slave controller.
pub(super) const FMMUS_MAX: usize = 16;

/// One FMMU as the fast path needs it. The fast path applies if a datagram contains all logical bytes of the FMMU: one copy
/// exchanges them with the buffer of a sync manager.
#[derive(Clone, Copy, Debug, Default)]
struct Whole {
    /// The logical address of the first byte, and the number of bytes.
    logical: u32,
    len: u16,
    /// A mask with the bit of the sync manager whose area has the physical start address and the length of the FMMU. 0
    /// if there is no such sync manager, or if the FMMU maps single bits.
    area: u16,
}

/// The FMMUs, decoded when their registers are written.
#[derive(Clone, Debug, Default)]
#[repr(C)] // The fields that each frame uses are adjacent, at the beginning.
pub(super) struct Fmmus {
    /// The FMMUs that map outputs, and those that map inputs, one bit each.
    outputs: u16,
    inputs: u16,
    wholes: [Whole; FMMUS_MAX],
    all: [Fmmu; FMMUS_MAX],
}

impl Fmmus {
    /// Decodes the registers of `count` FMMUs and assigns each its sync manager.
    pub(super) fn decode(count: u8, memory: &Memory, managers: &Managers) -> Self {
        let mut fmmus = Self::default();
        for n in 0..count.min(FMMUS_MAX as u8) {
            let fmmu = Fmmu::decode(&memory.get(registers::fmmu(n)));
            let bit = u16::from(fmmu.enabled && fmmu.bits() > 0) << n;
            for (direction, bits) in
                [(FmmuDirections::WRITE, &mut fmmus.outputs), (FmmuDirections::READ, &mut fmmus.inputs)]
            {
                *bits |= if fmmu.directions.contains(direction) { bit } else { 0 };
            }
            let n = usize::from(n);
            let area = if fmmu.is_bytewise() { managers.of_area(fmmu.physical, fmmu.len) } else { 0 };
            fmmus.wholes[n] = Whole { logical: fmmu.logical, len: fmmu.len, area };
            fmmus.all[n] = fmmu;
        }
        fmmus
    }

    /// Classifies the overlap of FMMU `n` with a datagram of `data_len` bytes at logical `address`. `areas` has a bit for each
    /// sync manager that allows the fast path, see `Managers::writable` and `Managers::readable`.
    #[inline]
    fn share(&self, n: usize, areas: u16, address: u32, data_len: usize) -> Share {
        let Whole { logical, len, area } = self.wholes[n];
        let (data_len, len) = (data_len as u64, u64::from(len));
        // A negative difference wraps to a value far above any length.
        let at = u64::from(logical).wrapping_sub(address.into());
        let skipped = u64::from(address).wrapping_sub(logical.into());
        let area = area & areas;
        if area != 0 && len <= data_len && at <= data_len - len {
            return Share::Whole(area.trailing_zeros() as usize, at as usize..(at + len) as usize);
        }
        if at >= data_len && skipped >= len { Share::None } else { Share::Part }
    }
}

/// How an FMMU overlaps with a datagram.
enum Share {
    /// No overlap.
    None,
    /// The datagram contains all bytes of the FMMU, and one copy exchanges them with the whole buffer of a sync manager: the
    /// number of that sync manager, and the range of the bytes in the datagram.
    Whole(usize, Range<usize>),
    /// A possible overlap of single bytes or bits, which [`part_of`] computes exactly.
    Part,
}

/// Takes the lowest set bit out of `left` and returns its number.
#[inline]
const fn next(left: &mut u16) -> Option<usize> {
    if *left == 0 {
        return None;
    }
    let n = left.trailing_zeros() as usize;
    *left &= *left - 1;
    Some(n)
}

/// The overlapping part of an FMMU and a datagram.
struct Part {
    /// The offset of the part in the datagram, and its length, bytes.
    at: usize,
    len: usize,
    /// The number of bytes of the FMMU in front of the part.
    skipped: usize,
}

/// The part of an FMMU in a datagram at a logical address; `None` without overlap.
fn part_of(fmmu: &Fmmu, address: u32, data: &[u8]) -> Option<Part> {
    let (begin, end) = (u64::from(fmmu.logical), u64::from(fmmu.logical) + u64::from(fmmu.len));
    let (first, last) = (u64::from(address), u64::from(address) + data.len() as u64);
    let (from, to) = (begin.max(first), end.min(last));
    (from < to).then(|| Part {
        at: (from - first) as usize,
        len: (to - from) as usize,
        skipped: (from - begin) as usize,
    })
}

/// The mapped bits in the overlap of an FMMU and a datagram, as pairs of bit numbers: in the datagram, and in the memory
/// relative to the first mapped byte.
fn bits<'f>(fmmu: &'f Fmmu, part: &Part) -> impl Iterator<Item = (usize, usize)> + use<'f> {
    let (first, total) = (usize::from(fmmu.first_bit), fmmu.bits() as usize);
    let begin = 8 * part.skipped;
    let end = begin + 8 * part.len;
    let at = 8 * part.at;
    let physical = usize::from(fmmu.physical_bit);
    (begin.max(first)..end.min(first + total)).map(move |bit| (at + bit - begin, physical + bit - first))
}

fn bit_of(bytes: &[u8], bit: usize) -> bool {
    bytes[bit / 8] & 1 << (bit % 8) != 0
}

fn set_bit(bytes: &mut [u8], bit: usize, value: bool) {
    let mask = 1 << (bit % 8);
    if value {
        bytes[bit / 8] |= mask;
    } else {
        bytes[bit / 8] &= !mask;
    }
}

impl Controller {
    /// Writes the data that FMMUs map as outputs into the memory. Returns whether anything was written.
    #[inline]
    pub(super) fn write_mapped(&mut self, address: u32, data: &[u8]) -> bool {
        if self.is_write_protected() {
            return false;
        }
        let (mut done, mut left) = (false, self.fmmus.outputs);
        while let Some(n) = next(&mut left) {
            done |= match self.fmmus.share(n, self.managers.writable(), address, data.len()) {
                Share::None => false,
                Share::Whole(manager, bytes) => {
                    if self.managers.write_whole(manager, &data[bytes], &mut self.memory) {
                        self.watchdog.trigger(self.arrival, &mut self.memory);
                    }
                    true
                }
                Share::Part => self.write_part(n, address, data),
            };
        }
        done
    }

    /// Writes to the memory those bytes of an FMMU that a datagram contains. Returns whether anything was written.
    #[inline(never)]
    fn write_part(&mut self, n: usize, address: u32, data: &[u8]) -> bool {
        let fmmu = self.fmmus.all[n];
        match part_of(&fmmu, address, data) {
            None => false,
            Some(part) if fmmu.is_bytewise() => {
                self.write(usize::from(fmmu.physical) + part.skipped, &data[part.at..][..part.len])
            }
            Some(part) => self.write_bits(&fmmu, &part, data),
        }
    }

    /// Writes the bits of an FMMU that does not map whole bytes. Slave controllers keep the unmapped bits of the same
    /// bytes only in the digital output registers; \[OURS] here the unmapped bits keep their values in the whole
    /// memory.
    fn write_bits(&mut self, fmmu: &Fmmu, part: &Part, data: &[u8]) -> bool {
        let Some((first, last)) = bounds(fmmu, part) else { return false };
        let address = usize::from(fmmu.physical) + first / 8;
        let len = last / 8 - first / 8 + 1;
        let mut bytes = self.take_scratch(len);
        let present = self.memory.slice(address, len);
        bytes[..present.len()].copy_from_slice(present);
        for (from, to) in bits(fmmu, part) {
            set_bit(&mut bytes, to - first / 8 * 8, bit_of(data, from));
        }
        let done = self.write(address, &bytes);
        self.scratch = bytes;
        done
    }

    /// Reads the memory that FMMUs map as inputs into the datagram; other bits are left unchanged. Returns whether anything
    /// was read.
    #[inline]
    pub(super) fn read_mapped(&mut self, address: u32, data: &mut [u8]) -> bool {
        let (mut done, mut left) = (false, self.fmmus.inputs);
        while let Some(n) = next(&mut left) {
            done |= match self.fmmus.share(n, self.managers.readable(), address, data.len()) {
                Share::None => false,
                Share::Whole(manager, bytes) => {
                    self.managers.read_whole(manager, &mut data[bytes], &self.memory);
                    true
                }
                Share::Part => self.read_part(n, address, data),
            };
        }
        done
    }

    /// Reads from the memory into a datagram those bytes of an FMMU that the datagram contains. Returns whether anything was
    /// read.
    #[inline(never)]
    fn read_part(&mut self, n: usize, address: u32, data: &mut [u8]) -> bool {
        let fmmu = self.fmmus.all[n];
        match part_of(&fmmu, address, data) {
            None => false,
            Some(part) if fmmu.is_bytewise() => {
                self.read(usize::from(fmmu.physical) + part.skipped, &mut data[part.at..][..part.len])
            }
            Some(part) => self.read_bits(&fmmu, &part, data),
        }
    }

    fn read_bits(&mut self, fmmu: &Fmmu, part: &Part, data: &mut [u8]) -> bool {
        let Some((first, last)) = bounds(fmmu, part) else { return false };
        let len = last / 8 - first / 8 + 1;
        let mut bytes = self.take_scratch(len);
        let done = self.read(usize::from(fmmu.physical) + first / 8, &mut bytes);
        if done {
            for (to, from) in bits(fmmu, part) {
                set_bit(data, to, bit_of(&bytes, from - first / 8 * 8));
            }
        }
        self.scratch = bytes;
        done
    }
}

/// The numbers of the first and of the last memory bit that the overlap of an FMMU and a datagram maps, counted from the first
/// mapped byte; `None` if the overlap maps no bit.
fn bounds(fmmu: &Fmmu, part: &Part) -> Option<(usize, usize)> {
    let mut all = bits(fmmu, part);
    let first = all.next()?.1;
    Some((first, all.last().map_or(first, |(_, last)| last)))
}
