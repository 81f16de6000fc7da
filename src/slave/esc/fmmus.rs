//! Logical addressing: which bits of a datagram are which bits of the memory.

use super::Controller;
use crate::ethercat::registers::{Fmmu, FmmuDirections};

/// The part of an FMMU that a datagram has.
struct Part {
    /// The first of its bytes in the datagram, and how many bytes there are.
    at: usize,
    len: usize,
    /// How many bytes of the FMMU come before.
    skipped: usize,
}

/// The bytes of a datagram at a logical address that an FMMU maps.
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

/// The bits of the part as pairs of bit numbers: in the datagram, and in the memory from its first byte on.
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
    /// The next FMMU of those in `left`, a bit each, that is for a direction.
    fn next_mapped(&self, direction: FmmuDirections, left: &mut u16) -> Option<Fmmu> {
        while *left != 0 {
            let fmmu = &self.fmmus[left.trailing_zeros() as usize];
            *left &= *left - 1;
            if fmmu.directions.contains(direction) {
                return Some(*fmmu);
            }
        }
        None
    }

    /// Writes what FMMUs map for outputs. Whether anything was written.
    pub(super) fn write_mapped(&mut self, address: u32, data: &[u8]) -> bool {
        let (mut done, mut left) = (false, self.fmmus_enabled);
        while let Some(fmmu) = self.next_mapped(FmmuDirections::WRITE, &mut left) {
            let Some(part) = part_of(&fmmu, address, data) else { continue };
            done |= if fmmu.is_bytewise() {
                self.write(usize::from(fmmu.physical) + part.skipped, &data[part.at..][..part.len])
            } else {
                self.write_bits(&fmmu, &part, data)
            };
        }
        done
    }

    /// \[OURS] Bits beside the mapped ones keep their values everywhere, not in the digital outputs alone.
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

    /// Reads what FMMUs map for inputs; other bits stay as they came. Whether anything was read.
    pub(super) fn read_mapped(&mut self, address: u32, data: &mut [u8]) -> bool {
        let (mut done, mut left) = (false, self.fmmus_enabled);
        while let Some(fmmu) = self.next_mapped(FmmuDirections::READ, &mut left) {
            let Some(part) = part_of(&fmmu, address, data) else { continue };
            done |= if fmmu.is_bytewise() {
                self.read(usize::from(fmmu.physical) + part.skipped, &mut data[part.at..][..part.len])
            } else {
                self.read_bits(&fmmu, &part, data)
            };
        }
        done
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

/// The first and the last bit of the memory that a part maps.
fn bounds(fmmu: &Fmmu, part: &Part) -> Option<(usize, usize)> {
    let mut all = bits(fmmu, part);
    let first = all.next()?.1;
    Some((first, all.last().map_or(first, |(_, last)| last)))
}
