//! CANopen over EtherCAT: SDO, expedited, normal and in segments.

use std::collections::{BTreeMap, BTreeSet};

/// The transfer of a value that does not fit into one message.
enum Transfer {
    Upload { rest: Vec<u8>, toggle: u8 },
    Download { at: (u16, u8), value: Vec<u8>, len: usize, toggle: u8 },
}

/// The objects of a slave, and what is odd about them.
#[derive(Default)]
pub struct Coe {
    /// All values, by index and sub-index.
    pub objects: BTreeMap<(u16, u8), Vec<u8>>,
    /// Read-only objects.
    pub read_only: BTreeSet<u16>,
    /// The abort code for writes of assignment and mapping, if these are fixed.
    pub fixed: Option<u32>,
    /// The only entries that can be mapped; others are refused, also where the mapping is not fixed. `None`: all can be.
    pub mappable: Option<BTreeSet<u32>>,
    /// The abort code for writes of synchronization types, if the slave does not support the wanted ones.
    pub refuses_sync_types: Option<u32>,
    /// The slave has no complete access.
    pub lacks_complete: bool,
    /// Fragments of SDO information do not have the bit for more to come.
    pub marks_no_fragments: bool,
    /// The slave refuses SDO information, with this code.
    pub refuses_information: Option<u32>,
    /// The slave aborts with the service of answers.
    pub aborts_as_answer: bool,
    transfer: Option<Transfer>,
    /// All writes so far.
    pub written: Vec<(u16, u8, Vec<u8>)>,
}

/// A number of that many bytes.
pub fn number(bytes: usize, value: u32) -> Vec<u8> {
    value.to_le_bytes()[..bytes].to_vec()
}

const NO_OBJECT: u32 = 0x0602_0000;
const NO_SUB_INDEX: u32 = 0x0609_0011;
const READ_ONLY: u32 = 0x0601_0002;
const NO_COMPLETE_ACCESS: u32 = 0x0601_0004;
const TOGGLE: u32 = 0x0503_0000;
const COMMAND: u32 = 0x0504_0001;
const LENGTH: u32 = 0x0607_0010;
const COUNT_FIRST: u32 = 0x0601_0003;
const NOT_MAPPABLE: u32 = 0x0604_0041;

impl Coe {
    /// A value.
    pub fn value(&self, index: u16, sub: u8) -> Option<&[u8]> {
        self.objects.get(&(index, sub)).map(Vec::as_slice)
    }

    /// A number of up to 4 bytes; 0 if the object is missing.
    pub fn get(&self, index: u16, sub: u8) -> u32 {
        let mut bytes = [0; 4];
        bytes.iter_mut().zip(self.value(index, sub).unwrap_or_default()).for_each(|(to, from)| *to = *from);
        u32::from_le_bytes(bytes)
    }

    /// Sets a number, with the length that it has.
    pub fn set(&mut self, index: u16, sub: u8, value: u32) {
        if let Some(place) = self.objects.get_mut(&(index, sub)) {
            place.iter_mut().zip(value.to_le_bytes()).for_each(|(to, from)| *to = from);
        }
    }

    pub(super) fn answer(&mut self, body: &[u8], room: usize, state: u8) -> Vec<Vec<u8>> {
        let Some([head @ .., _, _]) = body.first_chunk::<4>() else { return Vec::new() };
        match u16::from_le_bytes(*head) >> 12 {
            2 => self.sdo(&body[2..], room, state).into_iter().collect(),
            8 => self.information(&body[2..], room),
            _ => Vec::new(),
        }
    }

    fn message(sdo: &[u8]) -> Option<Vec<u8>> {
        let mut message = 0x3000_u16.to_le_bytes().to_vec();
        message.extend(sdo);
        message.resize(message.len().max(10), 0);
        Some(message)
    }

    fn abort(&self, (index, sub): (u16, u8), code: u32) -> Option<Vec<u8>> {
        let service: u16 = if self.aborts_as_answer { 0x3000 } else { 0x2000 };
        let mut message = service.to_le_bytes().to_vec();
        message.push(0x80);
        message.extend(index.to_le_bytes());
        message.push(sub);
        message.extend(code.to_le_bytes());
        Some(message)
    }

    fn lacks(&self, (index, sub): (u16, u8)) -> Option<Vec<u8>> {
        let has_index = self.objects.keys().any(|(other, _)| *other == index);
        self.abort((index, sub), if has_index { NO_SUB_INDEX } else { NO_OBJECT })
    }

    fn sdo(&mut self, sdo: &[u8], room: usize, state: u8) -> Option<Vec<u8>> {
        let command = *sdo.first()?;
        let [low, high, sub] = *sdo.get(1..4)?.first_chunk()?;
        let at = (u16::from_le_bytes([low, high]), sub);
        let is_complete = command & 0x10 != 0;
        match command >> 5 {
            1 | 2 if is_complete && self.lacks_complete => self.abort(at, NO_COMPLETE_ACCESS),
            1 => self.download(command, at, sdo.get(4..)?, state),
            2 => self.upload(at, is_complete, room),
            0 => self.download_segment(command, sdo),
            3 => self.upload_segment(command, room),
            4 => {
                self.transfer = None;
                None
            }
            _ => self.abort(at, COMMAND),
        }
    }

    fn whole(&self, index: u16, first: u8) -> Vec<u8> {
        let entries = self.objects.range((index, first)..=(index, u8::MAX));
        entries.flat_map(|((_, sub), value)| if *sub == 0 { vec![value[0], 0] } else { value.clone() }).collect()
    }

    fn upload(&mut self, at: (u16, u8), is_complete: bool, room: usize) -> Option<Vec<u8>> {
        let Some(mut value) = self.objects.get(&at).cloned() else { return self.lacks(at) };
        let mut command = 0x40;
        if is_complete {
            value = self.whole(at.0, at.1);
            command |= 0x10;
        }
        let mut sdo = vec![0];
        sdo.extend(at.0.to_le_bytes());
        sdo.push(at.1);
        if !is_complete && (1..=4).contains(&value.len()) {
            sdo[0] = command | 0x03 | (4 - value.len() as u8) << 2;
            sdo.extend(value);
            return Self::message(&sdo);
        }
        sdo[0] = command | 0x01;
        sdo.extend((value.len() as u32).to_le_bytes());
        let rest = value.split_off(value.len().min(room - 16));
        sdo.extend(value);
        self.transfer = (!rest.is_empty()).then_some(Transfer::Upload { rest, toggle: 0 });
        Self::message(&sdo)
    }

    fn upload_segment(&mut self, command: u8, room: usize) -> Option<Vec<u8>> {
        let Some(Transfer::Upload { rest, toggle }) = &mut self.transfer else { return self.abort((0, 0), COMMAND) };
        if command >> 4 & 1 != *toggle {
            self.transfer = None;
            return self.abort((0, 0), TOGGLE);
        }
        let behind = rest.split_off(rest.len().min(room - 9));
        let mut segment = std::mem::replace(rest, behind);
        let (shown, is_last, lacks) = (*toggle, rest.is_empty(), 7_usize.saturating_sub(segment.len()));
        *toggle ^= 1;
        segment.resize(segment.len() + lacks, 0);
        let mut sdo = vec![shown << 4 | (lacks as u8) << 1 | u8::from(is_last)];
        sdo.extend(segment);
        if is_last {
            self.transfer = None;
        }
        Self::message(&sdo)
    }

    fn download(&mut self, command: u8, at: (u16, u8), data: &[u8], state: u8) -> Option<Vec<u8>> {
        let value = match command & 3 {
            3 => data.get(..4 - usize::from(command >> 2 & 3))?.to_vec(),
            2 => data.get(..4)?.to_vec(),
            _ => {
                let len = u32::from_le_bytes(*data.first_chunk()?) as usize;
                let value: Vec<u8> = data[4..].iter().copied().take(len).collect();
                if value.len() < len {
                    self.transfer = Some(Transfer::Download { at, value, len, toggle: 0 });
                    return self.taken(at);
                }
                value
            }
        };
        if command & 0x10 != 0 { self.store_whole(at, &value, state) } else { self.store(at, value, state) }
    }

    fn download_segment(&mut self, command: u8, sdo: &[u8]) -> Option<Vec<u8>> {
        let Some(Transfer::Download { at, value, len, toggle }) = &mut self.transfer else {
            return self.abort((0, 0), COMMAND);
        };
        let (at, shown) = (*at, *toggle);
        if command >> 4 & 1 != shown {
            self.transfer = None;
            return self.abort(at, TOGGLE);
        }
        let lacks = if sdo.len() <= 8 { usize::from(command >> 1 & 7) } else { 0 };
        value.extend(&sdo[1..sdo.len() - lacks]);
        *toggle ^= 1;
        if command & 1 == 1 {
            let (value, len) = (std::mem::take(value), *len);
            self.transfer = None;
            if value.len() != len {
                return self.abort(at, LENGTH);
            }
            self.written.push((at.0, at.1, value.clone()));
            self.objects.insert(at, value);
        }
        Self::message(&[0x20 | shown << 4])
    }

    fn taken(&self, (index, sub): (u16, u8)) -> Option<Vec<u8>> {
        let [low, high] = index.to_le_bytes();
        Self::message(&[0x60, low, high, sub])
    }

    fn refusal(&self, at: (u16, u8), len: usize, state: u8) -> Option<u32> {
        let is_mapping = (0x1600..0x1C40).contains(&at.0) && !matches!(at.0, 0x1C32 | 0x1C33);
        if let Some(code) = self.fixed.filter(|_| is_mapping) {
            return Some(code);
        }
        if let Some(code) = self.refuses_sync_types.filter(|_| matches!(at, (0x1C32 | 0x1C33, 1))) {
            return Some(code);
        }
        if !self.objects.contains_key(&at) {
            let has_index = self.objects.keys().any(|(other, _)| *other == at.0);
            return Some(if has_index { NO_SUB_INDEX } else { NO_OBJECT });
        }
        if self.read_only.contains(&at.0) {
            return Some(READ_ONLY);
        }
        if is_mapping && state != 2 {
            return Some(0x0800_0022);
        }
        if is_mapping && at.1 > 0 && self.get(at.0, 0) > 0 {
            return Some(COUNT_FIRST);
        }
        let fits = self.objects[&at].len() == len || at.0 >= 0x2000 && at.0 < 0x3000;
        (!fits).then_some(LENGTH)
    }

    fn store(&mut self, at: (u16, u8), value: Vec<u8>, state: u8) -> Option<Vec<u8>> {
        if let Some(code) = self.refusal(at, value.len(), state) {
            return self.abort(at, code);
        }
        let is_entry = (0x1600..0x1C00).contains(&at.0) && at.1 > 0;
        let entry = value.first_chunk().map(|four| u32::from_le_bytes(*four));
        if is_entry && entry.is_some_and(|entry| self.mappable.as_ref().is_some_and(|all| !all.contains(&entry))) {
            return self.abort(at, NOT_MAPPABLE);
        }
        self.written.push((at.0, at.1, value.clone()));
        self.objects.insert(at, value);
        self.taken(at)
    }

    /// Complete access: sub-index 0 with a padding byte, then the others.
    fn store_whole(&mut self, at: (u16, u8), value: &[u8], state: u8) -> Option<Vec<u8>> {
        let Some(count) = value.first() else { return self.abort(at, LENGTH) };
        let mut rest = value.get(2..).unwrap_or_default();
        self.store((at.0, 0), vec![0], state);
        for sub in 1..=*count {
            let Some(len) = self.objects.get(&(at.0, sub)).map(Vec::len).filter(|len| *len <= rest.len()) else {
                return self.abort(at, LENGTH);
            };
            let (entry, behind) = rest.split_at(len);
            self.store((at.0, sub), entry.to_vec(), state);
            rest = behind;
        }
        self.store((at.0, 0), vec![*count], state)
    }

    /// The sync managers of outputs and inputs, as object 0x1C00 says.
    pub fn process_managers(&self) -> [usize; 2] {
        let of = |kind: u32| (1..=self.get(0x1C00, 0) as u8).find(|sub| self.get(0x1C00, *sub) == kind);
        [of(3), of(4)].map(|sub| sub.map_or(usize::from(u8::MAX), |sub| usize::from(sub) - 1))
    }

    /// The entries that are mapped to a sync manager: index, sub-index and bits as an object has them.
    pub fn mapped(&self, manager: usize) -> Vec<u32> {
        let subs = |index: u16| (1..=self.get(index, 0) as u8).map(move |sub| (index, sub));
        let pdos = subs(0x1C10 + manager as u16).map(|(index, sub)| self.get(index, sub) as u16);
        pdos.flat_map(subs).map(|(index, sub)| self.get(index, sub)).collect()
    }

    /// How many bytes are mapped to a sync manager.
    pub fn mapped_bytes(&self, manager: usize) -> usize {
        self.mapped(manager).iter().map(|entry| *entry as usize & 0xFF).sum::<usize>().div_ceil(8)
    }
}
